//! What a sweep found, for people (table), for programs (JSON) and for the docs (Markdown).

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::picture::Picture;

/// A sweep's table, judgement and pictures.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Short name.
    pub name: &'static str,
    /// What was asked, in a sentence or two.
    pub about: String,
    /// Heads of the columns.
    pub columns: Vec<&'static str>,
    /// Numbers and words, one for each column.
    pub rows: Vec<Vec<Value>>,
    /// What must hold.
    pub checks: Vec<Check>,
    /// What else is worth knowing.
    pub notes: Vec<String>,
    /// Pictures.
    pub pictures: Vec<Picture>,
}

/// A figure that must not exceed its bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// Which figure.
    pub what: String,
    /// What was found.
    pub found: f64,
    /// The most it may be.
    pub max: f64,
}

impl Check {
    /// The figure is within its bound (no NaN is).
    #[must_use]
    pub fn holds(&self) -> bool {
        self.found <= self.max
    }
}

impl Sweep {
    pub(crate) fn new(name: &'static str, about: impl Into<String>, columns: &[&'static str]) -> Self {
        Self {
            name,
            about: about.into(),
            columns: columns.to_vec(),
            rows: Vec::new(),
            checks: Vec::new(),
            notes: Vec::new(),
            pictures: Vec::new(),
        }
    }

    pub(crate) fn row(&mut self, cells: Vec<Value>) {
        debug_assert_eq!(
            cells.len(),
            self.columns.len(),
            "{}: a cell for each column",
            self.name
        );
        self.rows.push(cells);
    }

    pub(crate) fn check(&mut self, what: impl Into<String>, found: f64, max: f64) {
        self.checks.push(Check {
            what: what.into(),
            found,
            max,
        });
    }

    pub(crate) fn none(&mut self, what: impl Into<String>, found: u64) {
        self.check(what, found as f64, 0.0);
    }

    /// All checks hold.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.checks.iter().all(Check::holds)
    }

    /// For programs.
    #[must_use]
    pub fn json(&self) -> Value {
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                let pairs = self
                    .columns
                    .iter()
                    .map(|name| (*name).to_owned())
                    .zip(row.iter().cloned());
                Value::Object(pairs.collect())
            })
            .collect();
        let checks: Vec<Value> = self
            .checks
            .iter()
            .map(|check| json!({"what": check.what, "found": check.found, "most": check.max, "holds": check.holds()}))
            .collect();
        json!({"name": self.name, "about": self.about, "holds": self.holds(), "rows": rows, "checks": checks, "notes": self.notes})
    }

    fn cells(&self) -> Vec<Vec<String>> {
        let head = self.columns.iter().map(|name| (*name).to_owned()).collect();
        let rows = self.rows.iter().map(|row| row.iter().map(cell).collect());
        std::iter::once(head).chain(rows).collect()
    }

    /// For a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("\n== {}\n{}\n\n", self.name, self.about);
        let cells = self.cells();
        let width = |column: usize| {
            let lengths = cells.iter().map(|row| row[column].chars().count());
            lengths.max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        for row in &cells {
            let mut line = String::new();
            for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
                if column == 0 {
                    let _ = write!(line, "{cell:<width$}");
                } else {
                    let _ = write!(line, "  {cell:>width$}");
                }
            }
            let _ = writeln!(text, "  {}", line.trim_end());
        }
        text.push('\n');
        for check in &self.checks {
            let _ = writeln!(text, "  {}", check.line());
        }
        for note in &self.notes {
            let _ = writeln!(text, "  {note}");
        }
        text
    }

    /// For the docs; pictures lie beside the page.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!("\n## {}\n\n{}\n\n", capital(self.name), self.about);
        for (number, row) in self.cells().iter().enumerate() {
            let _ = writeln!(text, "| {} |", row.join(" | "));
            if number == 0 {
                let _ = writeln!(text, "|{}", "---|".repeat(row.len()));
            }
        }
        text.push('\n');
        for check in &self.checks {
            let _ = writeln!(text, "- {}", check.line());
        }
        for note in &self.notes {
            let _ = writeln!(text, "- {note}");
        }
        for picture in &self.pictures {
            let _ = writeln!(text, "\n![{}]({})", picture.caption, picture.file);
        }
        text
    }
}

impl Check {
    fn line(&self) -> String {
        format!(
            "{}: {}, at most {}: {}",
            self.what,
            number(self.found),
            number(self.max),
            if self.holds() { "held" } else { "MISSED" }
        )
    }
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters
        .next()
        .map(|first| first.to_uppercase().chain(letters).collect())
        .unwrap_or_default()
}

fn cell(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(found) if found.is_f64() => number(found.as_f64().unwrap_or(f64::NAN)),
        Value::Null => "–".to_owned(),
        other => other.to_string(),
    }
}

/// Three figures that count; whole numbers whole.
fn number(value: f64) -> String {
    let magnitude = value.abs();
    if (1e-3..1e15).contains(&magnitude) || magnitude < 1e-300 {
        if value.fract().abs() < 1e-300 {
            return format!("{value:.0}");
        }
        let places = (2 - magnitude.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{value:.places$}");
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        return text;
    }
    format!("{value:.2e}")
}
