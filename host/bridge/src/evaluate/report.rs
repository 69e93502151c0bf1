//! What `gripline evaluate paper` says: every figure, as an object for programs and as a page for people.

use std::collections::BTreeMap;

use gripline_protocol::message::Configuration;
use gripline_protocol::{Health, LSB_PER_NEWTON, PER_UNIT};
use serde::Serialize;

use super::chain::{Frame, Recorded};
use super::detectors::{Each, PAPER_FRICTION, PAPER_THRESHOLD, PaperSettings, Sight};
use super::document::{number, scores_cell, table};
use super::judged::{Judged, Meaning, Notice, confusion, hold_alarms, notice};
use super::metrics::{Confusion, Scores};
use super::paper::PaperArgs;
use super::plan::{PAPER_OBJECTS, PAPER_ROTATION, PAPER_TRANSLATION, Planned, Purpose};
use super::trial::Kind;
use crate::detect::replay::moved_to;
use crate::units::ratio;

/// Noise of the camera for the sensitivity, grey levels; sensors have 1 to 3.5.
pub const NOISE_LEVELS: [f64; 4] = [0.0, 2.0, 4.0, 8.0];
/// Assumed over true friction.
const FRICTION_SHARES: [f64; 7] = [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Thresholds on the stick ratio.
const THRESHOLDS: [f64; 6] = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
/// Bounds of contact sizes, taxels that the true map loads.
const CONTACT_SIZES: [usize; 5] = [1, 16, 21, 31, 400];

/// Figures of one object.
#[derive(Debug, Serialize)]
pub struct ObjectScores {
    name: String,
    mass_g: f64,
    /// Over its runs.
    friction: [f64; 2],
    grip_n: [f64; 2],
    #[serde(flatten)]
    scores: Each<Scores>,
}

/// Tables of one meaning of slip.
#[derive(Debug, Serialize)]
pub struct Tables {
    objects: Vec<ObjectScores>,
    all: Each<Scores>,
    translation: Each<Scores>,
    rotation: Each<Scores>,
}

/// A figure of the sensitivity: at this value, these scores.
#[derive(Debug, Serialize)]
pub struct At {
    value: f64,
    frames: u64,
    stick_ratio: Scores,
    gripline: Scores,
}

/// What depends on what.
#[derive(Debug, Serialize)]
pub struct Sensitivity {
    /// Detector's friction over the true one, run by run.
    friction_assumed_over_true: Vec<At>,
    threshold: Vec<At>,
    camera_noise_levels: Vec<At>,
    /// Least number of loaded taxels of each size.
    contact_taxels_from: Vec<At>,
}

/// Everything.
#[derive(Debug, Serialize)]
pub struct Report {
    network: String,
    data: &'static str,
    quick: bool,
    seed: u64,
    runs: u64,
    sensors: [u64; 2],
    frames: usize,
    doubtful_frames: usize,
    /// Our detector's settings.
    settings: BTreeMap<&'static str, f64>,
    #[serde(flatten)]
    tables: Tables,
    gross_slip_only: Tables,
    perfect_sensor: Each<Scores>,
    lead_time_ms_median: Option<f64>,
    slips: BTreeMap<&'static str, Each<Notice>>,
    hold_minutes: f64,
    alarms_per_minute: f64,
    alarms_per_minute_of: Each<f64>,
    sensitivity: Sensitivity,
    /// Runs that ended early, and why.
    pub unsolved: Vec<String>,
}

impl Report {
    /// Of these runs.
    #[must_use]
    pub fn new(
        args: &PaperArgs,
        planned: &[Planned],
        recorded: &[Recorded],
        noisy: &[Vec<(Planned, Recorded)>],
        ours: &Configuration,
    ) -> Self {
        let judged = judged_by(planned, recorded, Sight::Seen, |_| {
            (PaperSettings::default(), *ours)
        });
        let exact = judged_by(planned, recorded, Sight::Exact, |_| {
            (PaperSettings::default(), *ours)
        });
        let of = |kind: Option<Kind>| notice(&judged, kind);
        let slips = BTreeMap::from([
            ("all", of(None)),
            ("rotation", of(Some(Kind::Rotation))),
            ("translation", of(Some(Kind::Translation))),
        ]);
        let holds = judged.iter().filter(|run| run.planned.purpose == Purpose::Hold);
        let (hold_minutes, alarms) = hold_alarms(holds);
        let sensors = planned.iter().map(|planned| planned.trial.sensor);
        let frames = recorded.iter().flat_map(|run| &run.frames);
        Self {
            network: args.network.to_string(),
            data: args.data.name(),
            quick: args.quick,
            seed: args.seed,
            runs: if args.quick { 1 } else { args.runs },
            sensors: [
                sensors.clone().min().unwrap_or_default(),
                sensors.max().unwrap_or_default(),
            ],
            frames: frames.clone().count(),
            doubtful_frames: frames
                .filter(|frame| !frame.health.without(Health::SATURATED).is_good())
                .count(),
            settings: settings_of(ours),
            tables: tables(&judged, Meaning::Incipient),
            gross_slip_only: tables(&judged, Meaning::Gross),
            perfect_sensor: scores(&confusion(sequences(&exact), Meaning::Incipient, |_| true)),
            lead_time_ms_median: slips["all"].gripline.lead_ms_median,
            slips,
            hold_minutes,
            alarms_per_minute: alarms.gripline,
            alarms_per_minute_of: alarms,
            sensitivity: sensitivity(&judged, planned, recorded, noisy, ours),
            unsolved: planned
                .iter()
                .zip(recorded)
                .filter_map(|(planned, run)| {
                    let why = run.unsolved.as_ref()?;
                    Some(format!(
                        "{}, run {}: {why}",
                        planned.trial.object.name, planned.run
                    ))
                })
                .collect(),
        }
    }
}

fn settings_of(ours: &Configuration) -> BTreeMap<&'static str, f64> {
    BTreeMap::from([
        ("friction", ratio(ours.friction)),
        (
            "contact_min_n",
            f64::from(ours.contact_min) / f64::from(LSB_PER_NEWTON),
        ),
        ("slip_threshold", ratio(ours.slip_threshold)),
        ("slip_leave", ratio(ours.slip_leave)),
        ("incipient_threshold", ratio(ours.incipient_threshold)),
        ("incipient_horizon_ms", ours.incipient_horizon_ms.into()),
        ("dwell_ms", ours.dwell_ms.into()),
    ])
}

fn judged_by<'a>(
    planned: &'a [Planned],
    recorded: &'a [Recorded],
    sight: Sight,
    settings: impl Fn(&Recorded) -> (PaperSettings, Configuration),
) -> Vec<Judged<'a>> {
    let runs = planned.iter().zip(recorded);
    runs.map(|(planned, recorded)| {
        let (paper, ours) = settings(recorded);
        Judged::new(planned, recorded, sight, paper, &ours)
    })
    .collect()
}

fn of_purpose<'a, 'b>(
    runs: &'b [Judged<'a>],
    purpose: Purpose,
) -> impl Iterator<Item = &'b Judged<'a>> + Clone {
    runs.iter().filter(move |run| run.planned.purpose == purpose)
}

fn sequences<'a, 'b>(runs: &'b [Judged<'a>]) -> impl Iterator<Item = &'b Judged<'a>> + Clone {
    of_purpose(runs, Purpose::Sequence)
}

fn scores(tables: &Each<Confusion>) -> Each<Scores> {
    tables.map(Confusion::scores)
}

fn tables(runs: &[Judged], meaning: Meaning) -> Tables {
    let everything = |_: &Frame| true;
    let mut objects = Vec::new();
    while let Some(first) = sequences(runs).find(|run| run.planned.object == objects.len()) {
        let own = sequences(runs).filter(|run| run.planned.object == objects.len());
        let range = |value: fn(&Recorded) -> f64| {
            let values = own.clone().map(|run| value(run.recorded));
            [
                values.clone().fold(f64::INFINITY, f64::min),
                values.fold(0.0, f64::max),
            ]
        };
        objects.push(ObjectScores {
            name: first.planned.trial.object.name.to_string(),
            mass_g: first.planned.trial.object.mass_g,
            friction: range(|run| run.friction),
            grip_n: range(|run| run.grip_n),
            scores: scores(&confusion(own.clone(), meaning, everything)),
        });
    }
    let of = |purpose| scores(&confusion(of_purpose(runs, purpose), meaning, everything));
    Tables {
        objects,
        all: of(Purpose::Sequence),
        translation: of(Purpose::Translation),
        rotation: of(Purpose::Rotation),
    }
}

fn at(value: f64, tables: &Each<Confusion>) -> At {
    let Confusion {
        hits,
        false_alarms,
        misses,
        quiet,
    } = tables.gripline;
    At {
        value,
        frames: hits + false_alarms + misses + quiet,
        stick_ratio: tables.stick_ratio.scores(),
        gripline: tables.gripline.scores(),
    }
}

fn sensitivity(
    judged: &[Judged],
    planned: &[Planned],
    recorded: &[Recorded],
    noisy: &[Vec<(Planned, Recorded)>],
    ours: &Configuration,
) -> Sensitivity {
    let everything = |_: &Frame| true;
    let again = |settings: &dyn Fn(&Recorded) -> (PaperSettings, Configuration)| {
        let judged = judged_by(planned, recorded, Sight::Seen, settings);
        confusion(sequences(&judged), Meaning::Incipient, everything)
    };
    let friction = FRICTION_SHARES.map(|share| {
        let tables = again(&|run| {
            let friction = share * run.friction;
            let paper = PaperSettings {
                friction,
                ..PaperSettings::default()
            };
            let ours = Configuration {
                friction: (friction * f64::from(PER_UNIT)).round() as u16,
                ..*ours
            };
            (paper, ours)
        });
        at(share, &tables)
    });
    let threshold = THRESHOLDS.map(|threshold| {
        let tables = again(&|_| {
            let paper = PaperSettings {
                threshold,
                ..PaperSettings::default()
            };
            (
                paper,
                moved_to(ours, (threshold * f64::from(PER_UNIT)).round() as u16),
            )
        });
        at(threshold, &tables)
    });
    let noise = NOISE_LEVELS
        .iter()
        .zip(noisy)
        .filter(|(_, runs)| !runs.is_empty());
    let noise = noise.map(|(level, runs)| {
        let judged: Vec<Judged> = runs
            .iter()
            .map(|(planned, run)| Judged::new(planned, run, Sight::Seen, PaperSettings::default(), ours))
            .collect();
        at(*level, &confusion(&judged, Meaning::Incipient, everything))
    });
    let sizes = CONTACT_SIZES.windows(2).map(|bounds| {
        let tables = confusion(sequences(judged), Meaning::Incipient, |frame: &Frame| {
            let loaded = frame.exact.taxels.iter().filter(|taxel| taxel.z > 0).count();
            (bounds[0]..bounds[1]).contains(&loaded)
        });
        at(bounds[0] as f64, &tables)
    });
    Sensitivity {
        friction_assumed_over_true: friction.into(),
        threshold: threshold.into(),
        camera_noise_levels: noise.collect(),
        contact_taxels_from: sizes.collect(),
    }
}

impl Report {
    /// The page.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut page = self.head();
        page += "\n### Per frame: accuracy / precision / recall, percent\n\n";
        page += &self.objects_table();
        let [baseline, stick_ratio, gripline] =
            self.perfect_sensor.named().map(|(_, scores)| scores_cell(scores));
        page += "\nOn the true maps of a perfect sensor the same detectors reach ";
        page += &[baseline, stick_ratio, gripline].join(", ");
        page += " (baseline, stick ratio, Gripline).\n";
        page += "\n### The same with gross slip alone as the truth\n\n";
        page += &gross_table(&self.gross_slip_only);
        page += "\nWhoever warns 50 ms and more before gross slip has three and more frames a slip against its precision \
                 here: a bound on this precision and one on lead time exclude each other at these lengths of slips.\n";
        page += "\n### Lead time, kinds of slip, false alarms\n\n";
        page += &self.notice_table();
        page += "\n### What it depends on\n\nAccuracy / precision / recall, percent, over the sequences.\n\n";
        page += &self.sensitivity_tables();
        page
    }

    fn head(&self) -> String {
        let quick = if self.quick {
            " --quick (coarse grid, short runs: no evidence)"
        } else {
            ""
        };
        let settings: Vec<String> = self
            .settings
            .iter()
            .map(|(name, value)| format!("{name} {value:.4}"))
            .map(|text| text.trim_end_matches('0').trim_end_matches('.').to_owned())
            .collect();
        format!(
            "## The paper's experiment\n\n`gripline evaluate paper --data {} --seed {} --runs {}{quick}`: {} frames, \
             network {}, {} of them doubtful.\n\n\
             Five objects with the paper's masses in the contact world, gripped by a constant force; a hand (a spring of \
             1 mm/N) pulls until the object slides and lets go, as T-T-R-T-T, translation only (three slips) and rotation \
             only. Every frame is a rendered picture with the sensor's noise, light and lens, through gate, force \
             network, quantised map and the microcontroller's own detector. What the objects were, the paper does not \
             say: shapes, friction, grips and hands are assumed.\n\n\
             Truth: a frame slips when less than half of the contact area sticks in the world, or the contact slides as \
             a whole. That is the paper's own threshold, on the truth, and counts incipient slip, which is what a stick \
             ratio is for. The paper labelled by hand from what could be seen, which lies between this and gross slip \
             alone; both are reported.\n\n\
             The baseline and the stick ratio have the paper's settings (friction {PAPER_FRICTION}, threshold \
             {PAPER_THRESHOLD}). Gripline says slip in its states INCIPIENT and SLIP, with the settings that `gripline \
             run` has by default: {}. They were chosen on other objects, seeds and sensors (`--data tuning`: sensors from \
             7000000 on); sensors here: {} to {}.\n",
            self.data,
            self.seed,
            self.runs,
            self.frames,
            self.network,
            self.doubtful_frames,
            settings.join(", "),
            self.sensors[0],
            self.sensors[1],
        )
    }

    fn objects_table(&self) -> String {
        let is_papers = self.data == "report";
        let mut rows = Vec::new();
        for (number, object) in self.tables.objects.iter().enumerate() {
            let papers = is_papers.then(|| PAPER_OBJECTS[number]);
            let cell = |which: usize| papers.map_or_else(String::new, |both| scores_cell(&both[which]));
            rows.push(vec![
                object.name.clone(),
                format!("{:.2} to {:.2}", object.friction[0], object.friction[1]),
                cell(0),
                cell(1),
                scores_cell(&object.scores.baseline),
                scores_cell(&object.scores.stick_ratio),
                scores_cell(&object.scores.gripline),
            ]);
        }
        let more = [
            ("all five", self.tables.all, None),
            (
                "translation only",
                self.tables.translation,
                Some(PAPER_TRANSLATION),
            ),
            ("rotation only", self.tables.rotation, Some(PAPER_ROTATION)),
        ];
        for (name, scores, papers) in more {
            rows.push(vec![
                name.to_owned(),
                String::new(),
                String::new(),
                papers.map_or_else(String::new, |papers| scores_cell(&papers)),
                scores_cell(&scores.baseline),
                scores_cell(&scores.stick_ratio),
                scores_cell(&scores.gripline),
            ]);
        }
        table(
            &[
                "object",
                "true friction",
                "paper: baseline",
                "paper: stick ratio",
                "baseline",
                "stick ratio",
                "Gripline",
            ],
            &rows,
        )
    }

    fn notice_table(&self) -> String {
        let mut rows = Vec::new();
        for kind in ["translation", "rotation", "all"] {
            for (name, notice) in self.slips[kind].named() {
                rows.push(vec![
                    kind.to_owned(),
                    name.to_owned(),
                    format!("{} of {}", notice.noticed, notice.slips),
                    notice.before.to_string(),
                    number(notice.lead_ms_median, 0),
                    number(notice.lead_ms_p5, 0),
                ]);
            }
        }
        let alarms = self.alarms_per_minute_of;
        table(
            &[
                "slips",
                "detector",
                "noticed",
                "before gross slip",
                "lead, median ms",
                "lead, 5th percentile ms",
            ],
            &rows,
        ) + &format!(
            "\nAlarms a minute in {:.1} minutes of steady holds (shear 10 to 32 % of the normal force, with tremor): \
             baseline {:.2}, stick ratio {:.2}, Gripline {:.2}.\n",
            self.hold_minutes, alarms.baseline, alarms.stick_ratio, alarms.gripline
        )
    }

    fn sensitivity_tables(&self) -> String {
        let Sensitivity {
            friction_assumed_over_true,
            threshold,
            camera_noise_levels,
            contact_taxels_from,
        } = &self.sensitivity;
        let mut text = String::new();
        for (name, digits, figures) in [
            (
                "detector's friction over the true one",
                1,
                friction_assumed_over_true,
            ),
            (
                "threshold on the stick ratio (ours: all its levels move with it)",
                1,
                threshold,
            ),
            (
                "noise of the camera, grey levels (first runs)",
                0,
                camera_noise_levels,
            ),
            ("contact: loaded taxels from", 0, contact_taxels_from),
        ] {
            let rows: Vec<Vec<String>> = figures
                .iter()
                .map(|at| {
                    vec![
                        format!("{:.digits$}", at.value),
                        at.frames.to_string(),
                        scores_cell(&at.stick_ratio),
                        scores_cell(&at.gripline),
                    ]
                })
                .collect();
            text += &table(&[name, "frames", "stick ratio", "Gripline"], &rows);
            text.push('\n');
        }
        text
    }
}

fn gross_table(tables: &Tables) -> String {
    let mut rows: Vec<Vec<String>> = tables
        .objects
        .iter()
        .map(|object| (object.name.clone(), object.scores))
        .chain([
            ("all five".to_owned(), tables.all),
            ("translation only".to_owned(), tables.translation),
            ("rotation only".to_owned(), tables.rotation),
        ])
        .map(|(name, scores)| {
            vec![
                name,
                scores_cell(&scores.baseline),
                scores_cell(&scores.stick_ratio),
                scores_cell(&scores.gripline),
            ]
        })
        .collect();
    rows.shrink_to_fit();
    table(&["object", "baseline", "stick ratio", "Gripline"], &rows)
}

#[cfg(test)]
mod tests;
