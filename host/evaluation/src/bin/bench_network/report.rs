//! What was measured, as a table for people, as JSON for programs, and as points to plot.

use std::fmt::Write as _;

use gripline_network::metrics::Scores;
use gripline_network::{Architecture, InstructionSet};
use serde_json::{Map, Value, json};

use crate::accuracy::Accuracy;
use crate::models::default_of;
use crate::plot::{Kind, Point};
use crate::timing::Times;

/// Shares of the image's area that change between frames in the measurement of skipping, and what they are called.
pub(crate) const CHANGED: [(f64, &str); 2] = [(0.1, "10 %"), (0.3, "30 %")];

/// What the same is called where the camera's noise changes all other pixels too.
pub(crate) const WITH_NOISE: [&str; 2] = ["10 % and noise", "30 % and noise"];

/// The architecture that the engines are held to.
const UNET: &str = Architecture::Unet.name();
const TRACKED: &str = Architecture::Tracked.name();

/// The contestant that the gate skips.
pub(crate) const GATED: &str = "gated";

/// The network after the tracker.
pub(crate) const AFTER_TRACKER: &str = "tracked, network";

/// The same in f32.
pub(crate) const AFTER_TRACKER_F32: &str = "tracked, network in f32";

/// The engine in eight bits.
pub(crate) const INT8: &str = "onnxruntime int8";

/// The name of a contestant that is another engine with a model's weights.
pub(crate) fn engine(model: &str, engine: &str) -> String {
    format!("{model} in {engine}")
}

/// The name of a contestant that shows a part of a model's work.
pub(crate) fn part(model: &str, part: &str) -> String {
    format!("{model}, {part}")
}

pub(crate) struct Report {
    /// What our engine used.
    pub(crate) instructions: InstructionSet,
    /// Whether the other engines can have found nothing wider than AVX2; otherwise they chose for themselves.
    pub(crate) limited: bool,
    pub(crate) sets: Vec<InstructionSet>,
    /// Of a frame of the unet.
    pub(crate) multiply_adds: usize,
    /// Of a turn of the contestant "limit".
    pub(crate) limit_multiply_adds: usize,
    pub(crate) allocations_per_frame: u64,
    /// The system's load averages.
    pub(crate) load: String,
    pub(crate) models: Vec<String>,
    /// Those of them that are there in eight bits too.
    pub(crate) rounded: Vec<usize>,
    /// Of the models in their order, then of those in eight bits.
    pub(crate) accuracies: Vec<Accuracy>,
    pub(crate) times: Vec<Times>,
}

/// A figure, how far it may be off because of the samples it is from, and its bound.
struct Measure {
    key: &'static str,
    value: f64,
    spread: Option<f64>,
    sense: &'static str,
    bound: f64,
}

impl Measure {
    fn held(&self) -> bool {
        if self.sense == "<=" {
            self.value <= self.bound
        } else {
            self.value >= self.bound
        }
    }

    fn line(&self) -> String {
        let spread = self
            .spread
            .map_or(String::new(), |spread| format!("±{spread:.3}"));
        format!(
            "  {:<27} {:>7.3} {spread:<7} {} {:<5} {}",
            self.key,
            self.value,
            self.sense,
            self.bound,
            if self.held() { "held" } else { "MISSED" }
        )
    }
}

impl Report {
    fn times(&self, name: &str) -> &Times {
        let found = self.times.iter().find(|times| times.name == name);
        found.expect("every contestant has times")
    }

    fn median_us(&self, name: &str) -> f64 {
        self.times(name).median_us()
    }

    /// The unet alone.
    fn dense_us(&self) -> f64 {
        self.median_us(&self.instructions.to_string())
    }

    /// One of the models that the engine carries, without what a frame takes before it.
    fn network_us(&self, model: usize) -> f64 {
        if self.models[model] == UNET {
            self.dense_us()
        } else {
            self.median_us(AFTER_TRACKER)
        }
    }

    /// Multiply-adds per microsecond are 1e-3 GMAC/s.
    fn limit_gmac_per_s(&self) -> f64 {
        self.limit_multiply_adds as f64 / self.median_us("limit") * 1e-3
    }

    fn gmac_per_s(&self) -> f64 {
        self.multiply_adds as f64 / self.dense_us() * 1e-3
    }

    /// What is the same whichever network is the default.
    fn of_engines(&self) -> Vec<Measure> {
        let dense = self.dense_us();
        let tracked = self.median_us(AFTER_TRACKER);
        [
            (
                "tracked_vs_onnxruntime",
                tracked / self.median_us(&engine(TRACKED, "onnxruntime")),
                "<=",
                0.6,
            ),
            (
                "tracked_vs_onnxruntime_int8",
                tracked / self.median_us(&engine(TRACKED, INT8)),
                "<=",
                0.9,
            ),
            (
                "tracked_vs_rten",
                tracked / self.median_us(&engine(TRACKED, "rten")),
                "<=",
                0.6,
            ),
            (
                "tracked_vs_tract",
                tracked / self.median_us(&engine(TRACKED, "tract")),
                "<=",
                0.6,
            ),
            (
                "unet_vs_onnxruntime",
                dense / self.median_us(&engine(UNET, "onnxruntime")),
                "<=",
                1.0,
            ),
            (
                "unet_vs_tract",
                dense / self.median_us(&engine(UNET, "tract")),
                "<=",
                0.6,
            ),
            (
                "fraction_of_limit",
                self.gmac_per_s() / self.limit_gmac_per_s(),
                ">=",
                0.8,
            ),
            (
                "allocations_per_frame",
                self.allocations_per_frame as f64,
                "<=",
                0.0,
            ),
        ]
        .map(|(key, value, sense, bound)| Measure {
            key,
            value,
            spread: None,
            sense,
            bound,
        })
        .into()
    }

    /// What every network is held to, if it is the default.
    fn of_model(&self, index: usize) -> Vec<Measure> {
        let (name, Accuracy { scores, spread }) = (&self.models[index], &self.accuracies[index]);
        let frame = self.median_us(name);
        let share = |of: &str| self.median_us(&part(name, of)) / frame;
        let gated = self.median_us(GATED);
        let rmse = ["rmse_x_of_p99", "rmse_y_of_p99", "rmse_z_of_p99"];
        let mut measures: Vec<Measure> = (0..3)
            .map(|k| {
                (
                    rmse[k],
                    scores.rmse_of_p99[k],
                    Some(spread.rmse_of_p99[k]),
                    "<=",
                    0.04,
                )
            })
            .chain([
                (
                    "total_normal_error_median",
                    scores.total_normal_error_median,
                    Some(spread.normal_error),
                    "<=",
                    0.02,
                ),
                (
                    "shear_error_median",
                    scores.shear_error_median,
                    Some(spread.shear_error),
                    "<=",
                    0.06,
                ),
                (
                    "stick_ratio_mae",
                    scores.stick_ratio_mae,
                    Some(spread.stick_ratio_mae),
                    "<=",
                    0.07,
                ),
                (
                    "slip_agreement",
                    scores.slip_agreement,
                    Some(spread.slip_agreement),
                    ">=",
                    0.945,
                ),
                // Of a processor that reaches 50 GMAC/s in f32.
                ("frame_ms_median", 1e-3 * frame, None, "<=", 1.0),
                (
                    "frame_ms_gmac_per_s",
                    1e-3 * frame * self.limit_gmac_per_s(),
                    None,
                    "<=",
                    50.0,
                ),
                ("skip_10pct_vs_full", share(CHANGED[0].1), None, "<=", 0.4),
                ("skip_30pct_vs_full", share(CHANGED[1].1), None, "<=", 0.6),
                ("skip_10pct_noise_vs_full", share(WITH_NOISE[0]), None, "<=", 0.4),
                ("skip_30pct_noise_vs_full", share(WITH_NOISE[1]), None, "<=", 0.6),
                // A full frame passes the gate too.
                ("gated_vs_full", gated / (gated + frame), None, "<=", 0.02),
            ])
            .map(|(key, value, spread, sense, bound)| Measure {
                key,
                value,
                spread,
                sense,
                bound,
            })
            .collect();
        measures.push(Measure {
            key: "unchanged_vs_full",
            value: share("same"),
            spread: None,
            sense: "<=",
            bound: 0.02,
        });
        measures
    }

    fn default_model(&self) -> usize {
        default_of(self.models.iter().map(String::as_str))
    }

    /// The default network with each fingertip's gain from presses on a scale.
    fn calibrated(&self) -> &Accuracy {
        &self.accuracies[self.accuracies.len() - 1]
    }

    pub(crate) fn json(&self) -> Value {
        let mut object = Map::new();
        for measure in self
            .of_engines()
            .into_iter()
            .chain(self.of_model(self.default_model()))
        {
            object.insert(measure.key.to_owned(), json!(measure.value));
        }
        let mut networks = Map::new();
        for (index, name) in self.models.iter().enumerate() {
            let mut of_network = Map::new();
            for measure in self.of_model(index) {
                of_network.insert(measure.key.to_owned(), json!(measure.value));
                if let Some(spread) = measure.spread {
                    of_network.insert(format!("{}_standard_error", measure.key), json!(spread));
                }
            }
            let scores = json!(self.accuracies[index].scores);
            of_network.insert("scores".to_owned(), scores);
            networks.insert(name.clone(), Value::Object(of_network));
        }
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
        for (key, value) in [
            ("default_network", json!(Architecture::default().name())),
            ("networks", Value::Object(networks)),
            (
                "unet_int8_scores",
                json!(self.accuracies[self.models.len()].scores),
            ),
            (
                "tracked_int8_scores",
                json!(self.accuracies[self.models.len() + 1].scores),
            ),
            ("calibrated_scores", json!(self.calibrated().scores)),
            ("times_us", Value::Object(times)),
            ("instructions", json!(self.instructions.to_string())),
            ("peers_limited_to_avx2", json!(self.limited)),
            ("multiply_adds", json!(self.multiply_adds)),
            ("gmac_per_s", json!(self.gmac_per_s())),
            ("limit_gmac_per_s", json!(self.limit_gmac_per_s())),
            ("load_average", json!(self.load.trim())),
        ] {
            object.insert(key.to_owned(), value);
        }
        Value::Object(object)
    }

    pub(crate) fn table(&self) -> String {
        let mut text = String::new();
        let mut line = |line: String| writeln!(text, "{line}").expect("a string takes any text");
        line(format!(
            "one thread; unet: {:.2} million multiply-adds a frame; instruction sets here: {}; load averages: {}",
            self.multiply_adds as f64 * 1e-6,
            self.sets
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", "),
            self.load.trim()
        ));
        line(format!(
            "the other engines {}",
            if self.limited {
                "found AVX2 and nothing wider, as ours"
            } else {
                "chose the widest instructions that they know"
            }
        ));
        line(format!(
            "{:<28} {:>9} {:>9} {:>9} {:>9}",
            "us a frame", "least", "p10", "median", "p90"
        ));
        for times in self.times.iter().filter(|times| times.name != "limit") {
            let at = |share| times.quantile_us(share);
            line(format!(
                "{:<28} {:>9.1} {:>9.1} {:>9.1} {:>9.1}",
                times.name,
                at(0.0),
                at(0.1),
                at(0.5),
                at(0.9)
            ));
        }
        line(format!(
            "{} reaches {:.1} of {:.1} GMAC/s",
            self.instructions,
            self.gmac_per_s(),
            self.limit_gmac_per_s()
        ));
        for measure in self.of_engines() {
            line(measure.line());
        }
        for (index, name) in self.models.iter().enumerate() {
            let default = if index == self.default_model() {
                ", the default network"
            } else {
                ""
            };
            let samples = self.accuracies[index].scores.samples;
            line(format!(
                "{name}{default}; errors on {samples} samples, ± standard error over their streams"
            ));
            for measure in self.of_model(index) {
                line(measure.line());
            }
        }
        let Scores {
            total_normal_error_median: normal,
            shear_error_median: shear,
            ..
        } = self.calibrated().scores;
        line(format!(
            "the default network with each fingertip's gain from presses on a scale: F_N off by {:.1} %, shear by {:.1} %",
            100.0 * normal,
            100.0 * shear
        ));
        for (place, &model) in self.rounded.iter().enumerate() {
            let name = &self.models[model];
            let [float, int8] =
                [model, self.models.len() + place].map(|index| &self.accuracies[index].scores);
            let time = self.median_us(&engine(name, INT8));
            line(format!(
                "eight bits, {name} (onnxruntime, up-convolutions and last layer in f32): {:.2} of its f32 time, {:.2} of ours; \
                 stick ratio off by {:.3} (f32: {:.3}), shear {:.1} % ({:.1} %), taxels {:.1} % ({:.1} %)",
                time / self.median_us(&engine(name, "onnxruntime")),
                time / self.network_us(model),
                int8.stick_ratio_mae,
                float.stick_ratio_mae,
                100.0 * int8.shear_error_median,
                100.0 * float.shear_error_median,
                taxel_error(int8),
                taxel_error(float),
            ));
        }
        text
    }

    /// Run time of a whole frame against error.
    pub(crate) fn points(&self) -> Vec<Point> {
        let mut points = Vec::new();
        for (index, name) in self.models.iter().enumerate() {
            let error = taxel_error(&self.accuracies[index].scores);
            let mut point = |label: String, time: &str, kind| {
                points.push(Point {
                    label,
                    time_ms: 1e-3 * self.median_us(time),
                    error,
                    kind,
                });
            };
            point(name.clone(), name, Kind::Full);
            for (_, share) in CHANGED {
                point(format!("{name}, {share}"), &part(name, share), Kind::Skipping);
            }
        }
        // Other engines, with the time that a frame takes before the network.
        for (place, &model) in self.rounded.iter().enumerate() {
            let name = &self.models[model];
            let before = (self.median_us(name) - self.network_us(model)).max(0.0);
            for (of, accuracy, kind) in [
                ("onnxruntime", model, Kind::Peer),
                ("tract", model, Kind::Peer),
                ("rten", model, Kind::Peer),
                (INT8, self.models.len() + place, Kind::Int8),
            ] {
                points.push(Point {
                    label: format!("{name}, {of}"),
                    time_ms: 1e-3 * (before + self.median_us(&engine(name, of))),
                    error: taxel_error(&self.accuracies[accuracy].scores),
                    kind,
                });
            }
        }
        points
    }
}

/// Mean over the components of the root mean square error, per cent of the 99th percentile.
fn taxel_error(scores: &gripline_network::metrics::Scores) -> f64 {
    100.0 * scores.rmse_of_p99.iter().sum::<f64>() / 3.0
}
