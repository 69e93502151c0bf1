//! What `gripline evaluate paper` says: every figure, as an object for programs and as a page for people.

mod bounds;
mod figures;
mod page;

use std::collections::BTreeMap;

use gripline_protocol::message::Configuration;
use gripline_protocol::{Health, LSB_PER_NEWTON, PER_UNIT};

pub use self::figures::{At, ObjectScores, Report, Sensitivity, Tables};
use super::chain::{Frame, Recorded};
use super::detectors::{Each, PaperSettings, Sight};
use super::judged::{Judged, Meaning, confusion, hold_alarms, notice};
use super::metrics::{Confusion, Scores};
use super::plan::{Planned, Purpose};
use super::trial::Kind;
use crate::arguments::PaperArgs;
use crate::detect::replay::moved_to;
use bounds::bounds;
use gripline_recording::units::ratio;

/// Noise of the camera for the sensitivity, grey levels; sensors have 1 to 3.5.
pub const NOISE_LEVELS: [f64; 4] = [0.0, 2.0, 4.0, 8.0];
/// Assumed over true friction.
const FRICTION_SHARES: [f64; 7] = [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Thresholds on the stick ratio.
const THRESHOLDS: [f64; 6] = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
/// Bounds of contact sizes, taxels that the true map loads.
const CONTACT_SIZES: [usize; 5] = [1, 16, 21, 31, 400];

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
        let judged_tables = tables(&judged, Meaning::Incipient);
        let lead_time_ms_median = slips["all"].gripline.lead_ms_median;
        Self {
            network: args.network.to_string(),
            data: args.data.name(),
            quick: args.quick,
            objects_played: args.objects,
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
            bounds: bounds(&judged_tables, lead_time_ms_median, alarms.gripline),
            edge_percent: edge_percent(sequences(&judged)),
            tables: judged_tables,
            gross_slip_only: tables(&judged, Meaning::Gross),
            perfect_sensor: scores(&confusion(sequences(&exact), Meaning::Incipient, |_| true)),
            lead_time_ms_median,
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

/// How many frames of these runs slip other than the frame before, percent.
fn edge_percent<'a: 'b, 'b>(runs: impl Iterator<Item = &'b Judged<'a>>) -> f64 {
    let (mut edges, mut frames) = (0, 0);
    for run in runs {
        let slips = |frame: &Frame| Meaning::Incipient.slips(&frame.truth);
        let pairs = run.recorded.frames.windows(2);
        edges += pairs.filter(|pair| slips(&pair[0]) != slips(&pair[1])).count();
        frames += run.recorded.frames.len();
    }
    100.0 * edges as f64 / frames.max(1) as f64
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

#[cfg(test)]
mod tests;
