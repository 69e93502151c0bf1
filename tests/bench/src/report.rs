//! What was measured: tables for people, JSON for programs, points for the plot, bounds and whether they held.

use std::fmt::Write as _;

use gripline_network::InstructionSet;
use serde_json::{Value, json};

use crate::chain::Row as ChainRow;
use crate::detectors::{Row, Variant};
use crate::plot::Point;
use crate::scenes::{FRAMES_PER_SECOND, Kind};

/// The detector over one set of maps.
pub(crate) struct Stage {
    pub(crate) name: &'static str,
    pub(crate) maps: usize,
    pub(crate) mean_active: f64,
    pub(crate) numpy: Option<String>,
    pub(crate) rows: Vec<Row>,
}

pub(crate) struct Report {
    pub(crate) instructions: InstructionSet,
    pub(crate) stages: Vec<Stage>,
    pub(crate) chain: Vec<ChainRow>,
}

/// A figure and its bound.
pub(crate) struct Measure {
    pub(crate) what: String,
    pub(crate) value: f64,
    /// The bound is a maximum, else a minimum.
    pub(crate) is_upper_bound: bool,
    pub(crate) bound: f64,
}

impl Measure {
    pub(crate) fn held(&self) -> bool {
        if self.is_upper_bound {
            self.value <= self.bound
        } else {
            self.value >= self.bound
        }
    }
}

/// The part of sorted values below which a share of them lies.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = (share * (sorted.len().max(1) - 1) as f64).round() as usize;
    sorted.get(place).copied().unwrap_or(f64::NAN)
}

fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// What a frame takes while nothing else wants the processor: the lower quartile.
fn quiet(values: &[f64]) -> f64 {
    quantile(values, 0.25)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

impl ChainRow {
    /// Time of a frame: full and skipped ones by how many there are, without what else the machine did meanwhile.
    fn frame_us(&self) -> f64 {
        let share = |times: &[f64]| {
            if times.is_empty() {
                0.0
            } else {
                quiet(times) * times.len() as f64
            }
        };
        (share(&self.full_us) + share(&self.skipped_us)) / self.frames as f64
    }
}

impl Stage {
    fn row(&self, variant: Variant) -> Option<&Row> {
        self.rows.iter().find(|row| row.variant == variant)
    }

    /// How often faster: the best times of each, and the quartiles of the ratios round by round.
    fn ratio(&self, ours: Variant, other: Variant) -> Option<[f64; 3]> {
        let (ours, other) = (self.row(ours)?, self.row(other)?);
        let ratios: Vec<f64> = other
            .times_s
            .iter()
            .zip(&ours.times_s)
            .map(|(other, ours)| other / ours)
            .collect();
        Some([
            other.best_s(self.maps) / ours.best_s(self.maps),
            quantile(&ratios, 0.25),
            quantile(&ratios, 0.75),
        ])
    }
}

/// What of ours is compared with NumPy, in words.
const PAIRS: [(Variant, Variant, &str); 7] = [
    (
        Variant::FixedSparse,
        Variant::NumpyFrames,
        "taxels that travel in memory, one call a map each",
    ),
    (
        Variant::FixedDense,
        Variant::NumpyFrames,
        "whole maps in memory, one call a map each",
    ),
    (
        Variant::FixedFromNewtons,
        Variant::NumpyFrames,
        "the same f32 newtons, rounding included, one call a map each",
    ),
    (
        Variant::FixedSparse,
        Variant::NumpyBatch,
        "taxels that travel; NumPy gets all maps in one call",
    ),
    (
        Variant::FixedDense,
        Variant::NumpyBatch,
        "whole maps; NumPy gets all maps in one call",
    ),
    (
        Variant::FixedFromNewtons,
        Variant::NumpyBatch,
        "the same f32 newtons, rounding included; NumPy gets all maps in one call",
    ),
    (
        Variant::Single,
        Variant::NumpyBatch,
        "f32 in Rust; NumPy gets all maps in one call",
    ),
];

impl Report {
    /// What must hold.
    pub(crate) fn measures(&self) -> Vec<Measure> {
        let mut measures = Vec::new();
        let mut max = |what: String, value: f64| {
            measures.push(Measure {
                what,
                value,
                is_upper_bound: true,
                bound: 0.0,
            });
        };
        for stage in &self.stages {
            for variant in [
                Variant::FixedFromNewtons,
                Variant::FixedDense,
                Variant::FixedSparse,
                Variant::Incremental,
            ] {
                if let Some(errors) = stage.row(variant).and_then(|row| row.errors) {
                    max(
                        format!(
                            "{}, {}: maps decided otherwise than by exact arithmetic",
                            stage.name,
                            variant.name()
                        ),
                        errors.flips as f64,
                    );
                }
            }
        }
        let differ: usize = self.chain.iter().map(|row| row.wire.differ).sum();
        max(
            "maps whose sums the sparse wire or the way packet by packet changed".to_owned(),
            differ as f64,
        );
        for (name, [decisions, states]) in self.changed() {
            max(
                format!("{name}: slip decisions changed by skipping"),
                decisions as f64,
            );
            max(
                format!("{name}: states changed by skipping, INCIPIENT included"),
                states as f64,
            );
        }
        for stage in &self.stages {
            for (ours, what) in [
                (Variant::FixedSparse, "taxels that travel"),
                (Variant::FixedDense, "whole maps"),
            ] {
                if let Some([ratio, ..]) = stage.ratio(ours, Variant::NumpyFrames) {
                    measures.push(Measure {
                        what: format!(
                            "detector against NumPy, {}, {what}, one call a map: times faster",
                            stage.name
                        ),
                        value: ratio,
                        is_upper_bound: false,
                        bound: 50.0,
                    });
                }
            }
        }
        measures
    }

    /// Decisions and states that each way of skipping changed, over all scenes.
    fn changed(&self) -> Vec<(String, [usize; 2])> {
        let mut sums: Vec<(String, [usize; 2])> = Vec::new();
        for row in self
            .chain
            .iter()
            .filter(|row| row.choice.is_judged(self.instructions))
        {
            let name = row.choice.name();
            if let Some((_, sum)) = sums.iter_mut().find(|(other, _)| *other == name) {
                *sum = [sum[0] + row.changed[0], sum[1] + row.changed[1]];
            } else {
                sums.push((name, row.changed));
            }
        }
        sums
    }

    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        for stage in &self.stages {
            stage.text(&mut text);
        }
        self.chain_text(&mut text);
        let _ = writeln!(text, "\n== bounds");
        for measure in self.measures() {
            let sense = if measure.is_upper_bound {
                "at most"
            } else {
                "at least"
            };
            let held = if measure.held() { "held" } else { "MISSED" };
            let _ = writeln!(
                text,
                "  {}: {:.3}, {sense} {}: {held}",
                measure.what, measure.value, measure.bound
            );
        }
        text
    }

    fn chain_text(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "\n== whole chain: camera crop to decision, one core, {}; errors against the contact's true forces",
            self.instructions
        );
        let _ = writeln!(
            text,
            "  {:<14} {:<27} {:>8} {:>8} {:>8} {:>7} {:>7} {:>7} {:>6} {:>8} {:>8} {:>8} {:>8}",
            "scene",
            "way",
            "frame us",
            "full us",
            "skip us",
            "skipped",
            "F_N %",
            "F_T %",
            "ratio",
            "flips",
            "lead ms",
            "changed",
            "wire B"
        );
        for row in &self.chain {
            let optional = |value: f64, places: usize| {
                if value.is_nan() {
                    "–".to_owned()
                } else {
                    format!("{value:.places$}")
                }
            };
            let _ = writeln!(
                text,
                "  {:<14} {:<27} {:>8.1} {:>8} {:>8} {:>5.0} % {:>7} {:>7} {:>6} {:>4}/{:<3} {:>8} {:>3}, {:<3} {:>8.0}",
                row.kind.name(),
                row.choice.label(self.instructions),
                row.frame_us(),
                optional(quiet(&row.full_us), 1),
                optional(quiet(&row.skipped_us), 1),
                100.0 * row.skipped_us.len() as f64 / row.frames as f64,
                optional(100.0 * median(&row.normal_off), 1),
                optional(100.0 * median(&row.shear_off), 1),
                optional(mean(&row.ratio_off), 3),
                row.flips,
                row.frames,
                row.lead_ms
                    .map_or_else(|| "–".to_owned(), |ms| format!("{ms:.0}")),
                row.changed[0],
                row.changed[1],
                row.wire.bytes as f64 / row.frames as f64,
            );
        }
        let _ = writeln!(
            text,
            "  frame: lower quartiles of full and skipped frames, weighted by how often each comes\n  changed: frames whose slip decision, and whose state, differ from the same network's with nothing skipped"
        );
        let _ = writeln!(
            text,
            "\n== what skipping saves: time of a frame over that with nothing skipped; bytes over a dense map's"
        );
        for kind in Kind::ALL {
            let rows: Vec<&ChainRow> = self.chain.iter().filter(|row| row.kind == kind).collect();
            let mut line = format!("  {:<14}", kind.name());
            for row in &rows {
                let plain = rows
                    .iter()
                    .find(|other| other.choice.network == row.choice.network && other.choice.is_measure());
                if let Some(plain) = plain.filter(|_| !row.choice.is_measure()) {
                    let share = row.frame_us() / plain.frame_us();
                    let _ = write!(line, " {}: {:.2};", row.choice.name(), share);
                }
            }
            let bytes: usize = rows.iter().map(|row| row.wire.bytes).sum();
            let dense: usize = rows.iter().map(|row| row.wire.dense_bytes).sum();
            let _ = writeln!(text, "{line} sparse wire: {:.2}", bytes as f64 / dense as f64);
        }
    }

    pub(crate) fn json(&self) -> Value {
        let chain: Vec<Value> = self
            .chain
            .iter()
            .map(|row| {
                json!({
                    "scene": row.kind.name(), "way": row.choice.label(self.instructions), "frames": row.frames, "frame_us": row.frame_us(),
                    "full_us": quiet(&row.full_us), "skipped_us": quiet(&row.skipped_us), "skipped": row.skipped_us.len(),
                    "normal_force_median_error": median(&row.normal_off), "shear_force_median_error": median(&row.shear_off),
                    "stick_ratio_mean_error": mean(&row.ratio_off), "decision_flips": row.flips, "lead_ms": row.lead_ms,
                    "decisions_changed": row.changed[0], "states_changed": row.changed[1], "wire_bytes": row.wire.bytes,
                    "dense_wire_bytes": row.wire.dense_bytes, "wire_sums_differ": row.wire.differ,
                })
            })
            .collect();
        let measures: Vec<Value> = self
            .measures()
            .iter()
            .map(|one| json!({"what": one.what, "value": one.value, "sense": if one.is_upper_bound { "<=" } else { ">=" }, "bound": one.bound, "held": one.held()}))
            .collect();
        let stages: Vec<Value> = self.stages.iter().map(Stage::json).collect();
        json!({"detector": stages, "chain": chain, "measures": measures})
    }

    /// Detector: microseconds a map against the mean error of the stick ratio in ten thousandths.
    pub(crate) fn detector_points(&self) -> Vec<Point> {
        let stage = self.stages.first();
        let rows = stage.iter().flat_map(|stage| &stage.rows);
        rows.filter_map(|row| {
            let errors = row.errors?;
            Some(Point {
                label: row.variant.name().to_owned(),
                time: row.best_s(stage.map_or(1, |stage| stage.maps)) * 1e6,
                error: 1e4 * errors.ratio,
                is_peer: matches!(row.variant, Variant::NumpyBatch | Variant::NumpyFrames),
            })
        })
        .collect()
    }

    /// Chain: mean milliseconds a frame over all scenes against wrong slip decisions a minute.
    pub(crate) fn chain_points(&self) -> Vec<Point> {
        let mut points: Vec<Point> = Vec::new();
        for choice in crate::chain::choices(self.instructions) {
            let rows: Vec<&ChainRow> = self.chain.iter().filter(|row| row.choice == choice).collect();
            let times: Vec<f64> = rows.iter().map(|row| row.frame_us()).collect();
            let [flips, frames] = [|row: &ChainRow| row.flips, |row: &ChainRow| row.frames]
                .map(|count| rows.iter().map(|row| count(row)).sum::<usize>() as f64);
            points.push(Point {
                label: choice.label(self.instructions),
                time: mean(&times) * 1e-3,
                error: flips / (frames / FRAMES_PER_SECOND / 60.0),
                is_peer: false,
            });
        }
        points
    }
}

impl Stage {
    fn text(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "\n== detector: {}; {} maps, {:.0} taxels carried on average, one core",
            self.name, self.maps, self.mean_active
        );
        let _ = writeln!(
            text,
            "  {:<25} {:>8} {:>17} {:>10} {:>9} {:>8} {:>8} {:>10}",
            "variant", "best us", "median, q75", "F off N", "ratio off", "flips", "first ms", "MCU instr."
        );
        for row in &self.rows {
            let errors = row.errors.unwrap_or_default();
            let force = if errors.force_n.is_nan() {
                "–".to_owned()
            } else {
                format!("{:.1e}", errors.force_n)
            };
            let _ = writeln!(
                text,
                "  {:<25} {:>8.3} {:>8.3}, {:<7.3} {:>10} {:>9.1e} {:>8} {:>8.0} {:>10}",
                row.variant.name(),
                row.best_s(self.maps) * 1e6,
                median(&row.times_s) * 1e6,
                quantile(&row.times_s, 0.75) * 1e6,
                force,
                errors.ratio,
                errors.flips,
                errors.lead_ms,
                row.instructions
                    .map_or_else(|| "–".to_owned(), |count| format!("{count:.0}")),
            );
        }
        let _ = writeln!(
            text,
            "  errors against exact arithmetic on the f32 newtons; first: first slip of a scene, later than the truth's"
        );
        let Some(version) = &self.numpy else {
            let _ = writeln!(text, "  NumPy: not asked (no --numpy FOLDER)");
            return;
        };
        let _ = writeln!(
            text,
            "  times faster than NumPy {version} on one thread, best times (quartiles round by round); below 1 NumPy wins:"
        );
        for (ours, other, what) in PAIRS {
            if let Some([ratio, low, high]) = self.ratio(ours, other) {
                let _ = writeln!(
                    text,
                    "    {ratio:>7.1} ({low:.1}–{high:.1})  {}, {what}",
                    ours.name()
                );
            }
        }
    }

    fn json(&self) -> Value {
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                let errors = row.errors.unwrap_or_default();
                json!({
                    "variant": row.variant.name(), "us_best": row.best_s(self.maps) * 1e6, "us_median": median(&row.times_s) * 1e6, "us_q25": quantile(&row.times_s, 0.25) * 1e6,
                    "us_q75": quantile(&row.times_s, 0.75) * 1e6, "force_error_n": errors.force_n, "stick_ratio_error": errors.ratio,
                    "decision_flips": errors.flips, "first_slip_ms": errors.lead_ms, "mcu_instructions": row.instructions,
                })
            })
            .collect();
        let against: Vec<Value> = PAIRS
            .iter()
            .filter_map(|(ours, other, what)| {
                let [ratio, low, high] = self.ratio(*ours, *other)?;
                Some(json!({"ours": ours.name(), "numpy": other.name(), "what": what, "times_faster": ratio, "q25": low, "q75": high}))
            })
            .collect();
        json!({"maps": self.name, "count": self.maps, "mean_taxels": self.mean_active, "numpy": self.numpy, "rows": rows, "against_numpy": against})
    }
}
