//! What the paper's experiment must show, and whether it does. Percent, ms, alarms a minute.

use super::super::document::number;
use super::super::requirement::{Requirement, requirements_table};
use super::figures::{Report, Tables};
use crate::detectors::Each;
use crate::metrics::Scores;

/// Least accuracy, precision and recall of Gripline, object by object.
const OBJECT_MIN: [f64; 3] = [95.0, 90.0, 95.0];
/// Least recall of Gripline on rotation.
const ROTATION_RECALL_MIN: f64 = 95.0;
/// By how many points the stick ratio's recall on rotation is above the baseline's at least.
const STICK_RATIO_GAIN_MIN: f64 = 20.0;
/// Least median lead before gross slip, ms.
const LEAD_MS_MIN: f64 = 50.0;
/// Most alarms a minute in steady holds.
const ALARMS_MOST: f64 = 1.0;

/// Every bound of the experiment.
pub(super) fn bounds(tables: &Tables, lead_ms: Option<f64>, alarms_per_minute: f64) -> Vec<Requirement> {
    let mut all: Vec<Requirement> = tables
        .objects
        .iter()
        .map(|object| of_object(&object.name, &object.scores.gripline))
        .collect();
    let recall = tables.rotation.gripline.recall;
    all.push(Requirement::new(
        "rotation only: recall, %",
        format!("≥ {ROTATION_RECALL_MIN}"),
        number(recall, 1),
        at_least(recall, ROTATION_RECALL_MIN),
    ));
    let gain = |scores: &Each<Scores>| {
        let (ours, other) = (scores.stick_ratio.recall, scores.baseline.recall);
        ours.zip(other).map(|(ours, other)| ours - other)
    };
    let rotation = gain(&tables.rotation);
    all.push(Requirement::new(
        "stick ratio as in the paper against the Coulomb baseline: recall on rotation, points better (on translation: as it is)",
        format!("≥ {STICK_RATIO_GAIN_MIN}"),
        format!("{} ({})", number(rotation, 1), number(gain(&tables.translation), 1)),
        at_least(rotation, STICK_RATIO_GAIN_MIN),
    ));
    all.push(Requirement::new(
        "median lead before gross slip, ms",
        format!("≥ {LEAD_MS_MIN}"),
        number(lead_ms, 0),
        at_least(lead_ms, LEAD_MS_MIN),
    ));
    all.push(Requirement::new(
        "alarms a minute in steady holds",
        format!("≤ {ALARMS_MOST}"),
        number(Some(alarms_per_minute), 2),
        alarms_per_minute <= ALARMS_MOST,
    ));
    all
}

fn of_object(name: &str, scores: &Scores) -> Requirement {
    let [accuracy, precision, recall] = OBJECT_MIN;
    let held = at_least(scores.accuracy, accuracy)
        && at_least(scores.precision, precision)
        && at_least(scores.recall, recall);
    let figure = [scores.accuracy, scores.recall, scores.precision].map(|share| number(share, 1));
    Requirement::new(
        &format!("{name}: accuracy / recall / precision, %"),
        format!("≥ {accuracy} / {recall} / {precision}"),
        figure.join(" / "),
        held,
    )
}

fn at_least(figure: Option<f64>, min: f64) -> bool {
    figure.is_some_and(|figure| figure >= min)
}

impl Report {
    pub(super) fn bounds_table(&self) -> String {
        requirements_table(&self.bounds)
            + &format!(
                "\nFigures are Gripline's unless said otherwise. To tell one frame too early or too late at every beginning \
                 and end of a slip costs {:.1} points of accuracy in the sequences.\n",
                self.edge_percent
            )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_holds_only_if_every_part_of_it_does_and_is_there() {
        let held = |accuracy, precision, recall| {
            of_object(
                "ball",
                &Scores {
                    accuracy,
                    precision,
                    recall,
                },
            )
            .held
        };
        assert!(held(Some(95.0), Some(90.0), Some(95.0)));
        assert!(!held(Some(94.9), Some(99.0), Some(99.0)));
        assert!(!held(Some(99.0), Some(89.9), Some(99.0)));
        assert!(!held(Some(99.0), Some(99.0), Some(94.9)));
        assert!(!held(Some(99.0), None, Some(99.0)));
    }

    #[test]
    fn the_figures_stand_in_the_order_that_the_bound_names() {
        let scores = Scores {
            accuracy: Some(1.0),
            precision: Some(2.0),
            recall: Some(3.0),
        };
        assert_eq!(of_object("ball", &scores).figure, "1.0 / 3.0 / 2.0");
        assert_eq!(of_object("ball", &scores).bound, "≥ 95 / 95 / 90");
    }
}
