//! Which runs are played, and the paper's own figures. Tuning and reporting share no object, seed or sensor: what is chosen,
//! is chosen on [`Data::Tuning`], and is reported on [`Data::Report`].

use gripline_simulation::grasp::{OBJECTS, Object};

use super::metrics::Scores;
use super::trial::{Kind, Script, Trial};

/// Which data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Data {
    /// The five objects with the paper's masses: what is reported.
    #[default]
    Report,
    /// Twelve other objects, other seeds and sensors: what settings are chosen on.
    Tuning,
}

impl Data {
    /// Its objects.
    #[must_use]
    pub fn objects(self) -> &'static [Object] {
        match self {
            Self::Report => &OBJECTS[..5],
            Self::Tuning => &OBJECTS[5..],
        }
    }

    /// Its first number of a sensor; training and calibration have theirs from 2⁶⁰ on.
    #[must_use]
    pub const fn first_sensor(self) -> u64 {
        match self {
            Self::Report => 8_000_000,
            Self::Tuning => 7_000_000,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Report => "report",
            Self::Tuning => "tuning",
        }
    }
}

/// What a run is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The paper's sequence.
    Sequence,
    /// Translation only.
    Translation,
    /// Rotation only.
    Rotation,
    /// A steady hold.
    Hold,
}

/// How much is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Amount {
    /// Runs of the paper's sequence per object.
    pub runs: u64,
    /// The sequence and the runs of one kind of slip are cut short.
    pub short: bool,
    /// Length of a hold, s.
    pub hold_s: f64,
}

/// A run and what it is for.
#[derive(Debug, Clone)]
pub struct Planned {
    /// Number of its object.
    pub object: usize,
    /// Number among the runs of that object.
    pub run: usize,
    /// What for.
    pub purpose: Purpose,
    /// The run.
    pub trial: Trial,
}

/// All runs.
#[must_use]
pub fn plan(data: Data, seed: u64, amount: Amount) -> Vec<Planned> {
    let (t, r) = (Kind::Translation, Kind::Rotation);
    let slips = |kinds: &[Kind], short: usize| {
        let count = if amount.short { short } else { kinds.len() };
        Script::Slips(kinds[kinds.len() - count..].to_vec())
    };
    let mut all = Vec::new();
    for (number, object) in data.objects().iter().enumerate() {
        let sequences = (0..amount.runs).map(|_| (Purpose::Sequence, slips(&[t, t, r, t, t], 3)));
        let others = [
            (Purpose::Translation, slips(&[t; 3], 1)),
            (Purpose::Rotation, slips(&[r; 3], 1)),
            (Purpose::Hold, Script::Hold(amount.hold_s)),
        ];
        for (run, (purpose, script)) in sequences.chain(others).enumerate() {
            let own = seed * 10_000 + number as u64 * 100 + run as u64;
            all.push(Planned {
                object: number,
                run,
                purpose,
                trial: Trial {
                    object: object.clone(),
                    script,
                    // The two kinds of data have other sensors, whose numbers serve as seeds too.
                    seed: data.first_sensor() + own,
                    sensor: data.first_sensor() + own,
                },
            });
        }
    }
    all
}

const fn scores(accuracy: f64, precision: f64, recall: f64) -> Scores {
    Scores {
        accuracy: Some(accuracy),
        precision: Some(precision),
        recall: Some(recall),
    }
}

/// The paper's own figures, percent, object by object: baseline and stick ratio.
pub const PAPER_OBJECTS: [[Scores; 2]; 5] = [
    [scores(79.01, 64.19, 61.60), scores(79.99, 65.02, 89.30)],
    [scores(74.40, 83.02, 62.93), scores(84.80, 87.22, 69.35)],
    [scores(75.71, 76.00, 57.45), scores(80.56, 60.75, 96.02)],
    [scores(78.12, 79.61, 65.17), scores(93.64, 90.47, 87.55)],
    [scores(76.10, 60.83, 63.20), scores(79.00, 66.33, 71.71)],
];
/// The paper's stick ratio, translation only.
pub const PAPER_TRANSLATION: Scores = scores(85.98, 83.21, 85.65);
/// The paper's stick ratio, rotation only.
pub const PAPER_ROTATION: Scores = scores(86.86, 94.19, 79.51);

#[cfg(test)]
mod tests {
    use super::*;

    const AMOUNT: Amount = Amount {
        runs: 3,
        short: false,
        hold_s: 24.0,
    };

    #[test]
    fn the_report_is_the_papers_five_objects_three_runs_each_and_no_sensor_twice() {
        let all = plan(Data::Report, 1, AMOUNT);
        let sequences = all.iter().filter(|planned| planned.purpose == Purpose::Sequence);
        assert_eq!(sequences.count(), 15);
        let masses: Vec<f64> = (0..5)
            .filter_map(|number| all.iter().find(|planned| planned.object == number))
            .map(|planned| planned.trial.object.mass_g)
            .collect();
        assert_eq!(masses, [11.90, 17.82, 91.11, 57.50, 92.66]);
        let mut sensors: Vec<u64> = all.iter().map(|planned| planned.trial.sensor).collect();
        sensors.sort_unstable();
        sensors.dedup();
        assert_eq!(sensors.len(), all.len());
    }

    #[test]
    fn tuning_and_report_share_no_object_seed_or_sensor() {
        let of = |data: Data| plan(data, 1, AMOUNT);
        for planned in of(Data::Tuning) {
            for other in of(Data::Report) {
                assert_ne!(planned.trial.seed, other.trial.seed);
                assert_ne!(planned.trial.sensor, other.trial.sensor);
                assert_ne!(planned.trial.object.name, other.trial.object.name);
            }
        }
    }
}
