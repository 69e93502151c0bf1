//! The table: what was measured against what, the bound, and the figure; as text and as JSON with stable keys.

use std::fmt::Write;

use serde_json::{Value, json};

/// What a figure has to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Bound {
    AtMost(f64),
    AtLeast(f64),
    /// Printed for the reader, never out of bounds.
    Reported,
}

/// One line of the table.
#[derive(Debug, Clone)]
struct Row {
    key: &'static str,
    measure: String,
    against: &'static str,
    bound: Bound,
    found: f64,
    unit: &'static str,
    /// Where the figure stands when it is the worst of many.
    at: String,
}

impl Row {
    fn ok(&self) -> bool {
        // A figure that is not a number is out of bounds.
        match self.bound {
            Bound::AtMost(bound) => self.found <= bound,
            Bound::AtLeast(bound) => self.found >= bound,
            Bound::Reported => self.found.is_finite(),
        }
    }
}

/// Every figure of a run.
#[derive(Debug, Default)]
pub(crate) struct Report {
    rows: Vec<Row>,
    failures: Vec<(&'static str, String)>,
}

/// Enough digits to see the figure, no more.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    match value.abs() {
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 0.01 => format!("{value:.3}"),
        _ => format!("{value:.1e}"),
    }
}

impl Report {
    /// Enters a figure. `unit` is "%" for shares already times 100.
    pub(crate) fn row(
        &mut self,
        key: &'static str,
        measure: &str,
        against: &'static str,
        bound: Bound,
        (found, unit): (f64, &'static str),
        at: &str,
    ) {
        let row = Row {
            key,
            measure: measure.to_owned(),
            against,
            bound,
            found,
            unit,
            at: at.to_owned(),
        };
        eprintln!("   {}", line(&row));
        self.rows.push(row);
    }

    /// A section that could not be run: out of bounds.
    pub(crate) fn failed(&mut self, section: &'static str, why: &str) {
        eprintln!("   FAILED {section}: {why}");
        self.failures.push((section, why.to_owned()));
    }

    pub(crate) fn ok(&self) -> bool {
        self.failures.is_empty() && self.rows.iter().all(Row::ok)
    }

    /// The table as Markdown: it is pasted into the docs page as it is.
    pub(crate) fn text(&self) -> String {
        let head = ["measure", "against", "bound", "found", "ok"].map(str::to_owned);
        let mut lines = vec![head];
        for row in &self.rows {
            let found = if row.at.is_empty() {
                with_unit(row.found, row.unit)
            } else {
                format!("{} ({})", with_unit(row.found, row.unit), row.at)
            };
            lines.push([
                row.measure.clone(),
                row.against.to_owned(),
                bound(row),
                found,
                if row.ok() { "yes" } else { "NO" }.to_owned(),
            ]);
        }
        let width = |k: usize| lines.iter().map(|l| l[k].chars().count()).max().unwrap_or(0);
        let widths = [0, 1, 2, 3, 4].map(width);
        let mut text = String::new();
        for (i, cells) in lines.iter().enumerate() {
            for (cell, width) in cells.iter().zip(widths) {
                let _ = write!(text, "| {cell:<width$} ");
            }
            text += "|\n";
            if i == 0 {
                for width in widths {
                    let _ = write!(text, "|{}", "-".repeat(width + 2));
                }
                text += "|\n";
            }
        }
        for (section, why) in &self.failures {
            let _ = writeln!(text, "FAILED {section}: {why}");
        }
        text
    }

    pub(crate) fn json(&self, seconds: f64) -> Value {
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                let (kind, limit) = match row.bound {
                    Bound::AtMost(v) => ("at most", Some(v)),
                    Bound::AtLeast(v) => ("at least", Some(v)),
                    Bound::Reported => ("reported", None),
                };
                json!({
                    "key": row.key, "measure": row.measure, "against": row.against, "bound_kind": kind,
                    "bound": limit, "found": row.found, "unit": row.unit, "at": row.at, "ok": row.ok(),
                })
            })
            .collect();
        let failures: Vec<Value> = self
            .failures
            .iter()
            .map(|(section, why)| json!({"section": section, "why": why}))
            .collect();
        json!({"ok": self.ok(), "seconds": seconds, "rows": rows, "failed_sections": failures})
    }
}

fn with_unit(value: f64, unit: &str) -> String {
    if unit.is_empty() {
        short(value)
    } else {
        format!("{} {unit}", short(value))
    }
}

fn bound(row: &Row) -> String {
    match row.bound {
        Bound::AtMost(bound) => format!("≤ {}", with_unit(bound, row.unit)),
        Bound::AtLeast(bound) => format!("≥ {}", with_unit(bound, row.unit)),
        Bound::Reported => "reported".to_owned(),
    }
}

fn line(row: &Row) -> String {
    format!(
        "{} {}: {} ({}){}",
        if row.ok() { "ok " } else { "OUT" },
        row.measure,
        with_unit(row.found, row.unit),
        bound(row),
        if row.at.is_empty() {
            String::new()
        } else {
            format!(", {}", row.at)
        },
    )
}

/// The worst of many figures, and where it was.
#[derive(Debug, Clone, Default)]
pub(crate) struct Worst {
    pub(crate) value: f64,
    pub(crate) at: String,
}

impl Worst {
    /// Keeps the larger magnitude.
    pub(crate) fn see(&mut self, value: f64, at: impl FnOnce() -> String) {
        // A figure that is not a number must win.
        if value.is_nan() || value.abs() > self.value {
            self.value = value.abs();
            self.at = at();
        }
    }
}
