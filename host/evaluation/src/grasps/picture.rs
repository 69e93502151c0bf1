//! The figures of `gripline evaluate grasps`: every grasp's mean force against its margin, a panel a policy; and drops
//! against margin, a point a policy.

use std::path::Path;

use gripline_chart::{Axis, BLUE, Chart, Colour, Figure, INK, Legend, Mark, Note, Panel, Series, VERMILION};

use super::play::Outcome;
use super::policy::Policy;
use crate::error::EvaluationError;

/// Margins beyond are drawn at the edge, percent.
const MARGINS: [f64; 2] = [-60.0, 300.0];
/// The margin that people keep, percent.
const HUMAN: [f64; 2] = [10.0, 40.0];
const HUMAN_COLOUR: Colour = Colour(225, 240, 225);

/// Draws the looking policies and the fixed force into a PNG.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw(path: &Path, outcomes: &[Outcome], fixed_n: Option<f64>) -> Result<(), EvaluationError> {
    let solved: Vec<&Outcome> = outcomes.iter().filter(|outcome| !outcome.unsolved).collect();
    let forces = solved.iter().map(|outcome| outcome.mean_force_n);
    let top_n = 1.05 * forces.fold(fixed_n.unwrap_or(1.0), f64::max);
    let panels: Vec<Panel> = Policy::LOOKING
        .into_iter()
        .filter(|policy| solved.iter().any(|outcome| outcome.policy == *policy))
        .map(|policy| Panel::Chart(panel(policy, &solved, fixed_n, top_n)))
        .collect();
    let figure = Figure {
        width: 1_000,
        rows: panels.chunks(2).map(|row| (310, row.to_vec())).collect(),
    };
    Ok(figure.save(path)?)
}

fn panel(policy: Policy, solved: &[&Outcome], fixed_n: Option<f64>, top_n: f64) -> Chart {
    let [first, last] = MARGINS;
    let points = |dropped: bool| -> Vec<(f64, f64)> {
        let own = solved
            .iter()
            .filter(|outcome| outcome.policy == policy && outcome.dropped == dropped);
        own.map(|outcome| {
            let margin = 100.0 * outcome.margin.unwrap_or(-1.0);
            (margin.clamp(first, last), outcome.mean_force_n)
        })
        .collect()
    };
    let (held, dropped) = (points(false), points(true));
    let title = format!(
        "{}: {} grasps, {} dropped",
        policy.name(),
        held.len() + dropped.len(),
        dropped.len()
    );
    let human = vec![(HUMAN[0], 0.0), (HUMAN[1], top_n)];
    Chart {
        title,
        x: Axis::new("median margin over the needed force, %", MARGINS),
        y: Axis::new("mean force, N", [0.0, top_n]),
        legend: Legend::None,
        series: vec![
            Series::new("", HUMAN_COLOUR, Mark::Boxes, human),
            Series::new(
                "",
                INK,
                Mark::Dashed,
                fixed_n.map_or_else(Vec::new, |fixed_n| vec![(first, fixed_n), (last, fixed_n)]),
            ),
            Series {
                opacity: 0.5,
                ..Series::new("", BLUE, Mark::Dots(2), held)
            },
            Series::new("", VERMILION, Mark::Crosses(4), dropped),
        ],
        notes: fixed_n
            .map(|fixed_n| Note {
                at: (last, fixed_n),
                text: "fixed force".to_owned(),
                offset: Some((-75, 4)),
                colour: INK,
            })
            .into_iter()
            .collect(),
    }
}

/// A policy in the picture of drops: its name, median margin in percent, drops of a thousand.
pub(super) type Point = (Policy, f64, f64);

/// Draws drops against margin into a file; its extension says how.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw_drops(path: &Path, points: &[Point]) -> Result<(), EvaluationError> {
    let max = |value: fn(&Point) -> f64| points.iter().map(value).fold(1.0, f64::max);
    let ours = [Policy::Gripline, Policy::GriplineSparing, Policy::GriplineSecure];
    let of = |own: bool| points.iter().filter(move |point| ours.contains(&point.0) == own);
    let places = |own: bool| of(own).map(|(_, margin, drops)| (*margin, *drops)).collect();
    let mut line: Vec<(f64, f64)> = places(true);
    line.sort_by(|a, b| a.0.total_cmp(&b.0));
    let chart = Chart {
        title: "Drops against margin".to_owned(),
        x: Axis::new(
            "median margin over the needed force, %",
            [0.0, 1.15 * max(|point| point.1)],
        ),
        y: Axis::new("dropped of 1,000", [0.0, 1.1 * max(|point| point.2)]),
        legend: Legend::None,
        series: vec![
            Series::new("", BLUE, Mark::Line(1), line),
            Series::new("", BLUE, Mark::Dots(5), places(true)),
            Series::new("", VERMILION, Mark::Dots(5), places(false)),
        ],
        notes: points
            .iter()
            .map(|(policy, margin, drops)| Note {
                at: (*margin, *drops),
                text: policy.name().to_owned(),
                offset: None,
                colour: INK,
            })
            .collect(),
    };
    let figure = Figure::single(900, 520, Panel::Chart(chart));
    Ok(figure.save(path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_of_drops_has_every_policy_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drops.svg");
        let points = [(Policy::Gripline, 60.0, 5.0), (Policy::Oracle, 40.0, 2.0)];
        draw_drops(&path, &points).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("Gripline") && text.contains("oracle") && text.contains("dropped of 1,000"));
        assert!(draw_drops(&folder.path().join("drops.gif"), &points).is_err());
    }
}
