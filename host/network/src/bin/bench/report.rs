//! What was measured, as a table for people and as JSON for programs.

use std::fmt::Write as _;

use gripline_network::InstructionSet;
use serde_json::{Map, Value, json};

use crate::Times;

pub(crate) struct Report {
    pub(crate) widest: InstructionSet,
    pub(crate) sets: Vec<InstructionSet>,
    /// Of a frame.
    pub(crate) multiply_adds: usize,
    /// Of a turn of the contestant "limit".
    pub(crate) limit_multiply_adds: usize,
    pub(crate) allocations_per_frame: u64,
    /// The system's load averages.
    pub(crate) load: String,
    pub(crate) times: Vec<Times>,
}

impl Report {
    fn times(&self, name: &str) -> &Times {
        let found = self.times.iter().find(|times| times.name == name);
        found.expect("every contestant has times")
    }

    fn median_us(&self, name: &str) -> f64 {
        self.times(name).median_us()
    }

    fn dense(&self) -> f64 {
        self.median_us(&self.widest.to_string())
    }

    fn against(&self, name: &str) -> f64 {
        self.dense() / self.median_us(name)
    }

    fn share_of_dense(&self, name: &str) -> f64 {
        self.median_us(name) / self.dense()
    }

    /// Multiply-adds per microsecond are 1e-3 GMAC/s.
    fn limit_gmac_per_s(&self) -> f64 {
        self.limit_multiply_adds as f64 / self.median_us("limit") * 1e-3
    }

    fn gmac_per_s(&self) -> f64 {
        self.multiply_adds as f64 / self.dense() * 1e-3
    }

    /// The measures with bounds: key, value, whether it must be at most or at least the bound.
    fn bounded(&self) -> [(&'static str, f64, &'static str, f64); 12] {
        [
            ("unet_vs_onnxruntime", self.against("onnxruntime"), "<=", 1.0),
            ("unet_vs_tract", self.against("tract"), "<=", 0.6),
            (
                "fraction_of_limit",
                self.gmac_per_s() / self.limit_gmac_per_s(),
                ">=",
                0.8,
            ),
            ("frame_ms_median", self.median_us("whole frame") * 1e-3, "<=", 1.5),
            (
                "skip_10pct_vs_full",
                self.share_of_dense("10 % changed"),
                "<=",
                0.4,
            ),
            (
                "skip_30pct_vs_full",
                self.share_of_dense("30 % changed"),
                "<=",
                0.7,
            ),
            ("unchanged_vs_full", self.share_of_dense("unchanged"), "<=", 0.02),
            (
                "tracked_frame_ms_median",
                self.median_us("tracked") * 1e-3,
                "<=",
                1.5,
            ),
            (
                "tracked_skip_10pct_vs_full",
                self.median_us("tracked, 10 %") / self.median_us("tracked"),
                "<=",
                0.4,
            ),
            (
                "tracked_skip_30pct_vs_full",
                self.median_us("tracked, 30 %") / self.median_us("tracked"),
                "<=",
                0.7,
            ),
            (
                "tracked_unchanged_vs_full",
                self.median_us("tracked, same") / self.median_us("tracked"),
                "<=",
                0.02,
            ),
            (
                "allocations_per_frame",
                self.allocations_per_frame as f64,
                "<=",
                0.0,
            ),
        ]
    }

    pub(crate) fn json(&self) -> Value {
        let mut object: Map<String, Value> = self
            .bounded()
            .into_iter()
            .map(|(key, value, ..)| (key.to_owned(), json!(value)))
            .collect();
        let times: Map<String, Value> = self
            .times
            .iter()
            .filter(|times| times.name != "limit")
            .map(|times| {
                let value = json!({
                    "least": times.quantile_us(0.0),
                    "p10": times.quantile_us(0.1),
                    "median": times.median_us(),
                    "p90": times.quantile_us(0.9),
                });
                (times.name.clone(), value)
            })
            .collect();
        object.insert("times_us".to_owned(), Value::Object(times));
        object.insert("instructions".to_owned(), json!(self.widest.to_string()));
        object.insert("multiply_adds".to_owned(), json!(self.multiply_adds));
        object.insert("gmac_per_s".to_owned(), json!(self.gmac_per_s()));
        object.insert("limit_gmac_per_s".to_owned(), json!(self.limit_gmac_per_s()));
        object.insert("load_average".to_owned(), json!(self.load.trim()));
        Value::Object(object)
    }

    pub(crate) fn table(&self) -> String {
        let mut text = String::new();
        let mut line = |line: String| writeln!(text, "{line}").expect("a string takes any text");
        line(format!(
            "unet, {:.2} million multiply-adds a frame, one thread; instruction sets here: {}",
            self.multiply_adds as f64 * 1e-6,
            self.sets
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        ));
        line(format!("load averages: {}", self.load.trim()));
        line(format!(
            "{:<14} {:>9} {:>9} {:>9} {:>9}",
            "us a frame", "least", "p10", "median", "p90"
        ));
        for times in self.times.iter().filter(|times| times.name != "limit") {
            let at = |share| times.quantile_us(share);
            line(format!(
                "{:<14} {:>9.1} {:>9.1} {:>9.1} {:>9.1}",
                times.name,
                at(0.0),
                at(0.1),
                at(0.5),
                at(0.9)
            ));
        }
        line(format!(
            "{} reaches {:.1} of {:.1} GMAC/s",
            self.widest,
            self.gmac_per_s(),
            self.limit_gmac_per_s()
        ));
        for (key, value, sense, bound) in self.bounded() {
            let held = if sense == "<=" {
                value <= bound
            } else {
                value >= bound
            };
            line(format!(
                "{key:<27} {value:>7.3}  {sense} {bound:<5} {}",
                if held { "held" } else { "MISSED" }
            ));
        }
        text
    }
}
