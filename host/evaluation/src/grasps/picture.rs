//! The figure of `gripline evaluate grasps`: every grasp's mean force against its margin, a panel a policy.

use std::path::Path;

use gripline_chart::{Axis, BLUE, Chart, Colour, Figure, INK, Legend, Mark, Note, Panel, Series, VERMILION};

use super::play::Outcome;
use super::policy::Policy;
use gripline_recording::error::Failure;

/// Margins beyond are drawn at the edge, percent.
const MARGINS: [f64; 2] = [-60.0, 300.0];
/// The margin that people keep, percent.
const HUMAN: [f64; 2] = [10.0, 40.0];
const HUMAN_COLOUR: Colour = Colour(225, 240, 225);

/// Draws the looking policies and the fixed force into a PNG.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw(path: &Path, outcomes: &[Outcome], fixed_n: f64) -> Result<(), Failure> {
    let solved: Vec<&Outcome> = outcomes.iter().filter(|outcome| !outcome.unsolved).collect();
    let forces = solved.iter().map(|outcome| outcome.mean_force_n);
    let top_n = 1.05 * forces.fold(fixed_n, f64::max);
    let panels: Vec<Panel> = Policy::LOOKING
        .into_iter()
        .map(|policy| Panel::Chart(panel(policy, &solved, fixed_n, top_n)))
        .collect();
    let figure = Figure {
        width: 1_000,
        rows: panels.chunks(2).map(|row| (310, row.to_vec())).collect(),
    };
    figure.save(path).map_err(Failure::failed)
}

fn panel(policy: Policy, solved: &[&Outcome], fixed_n: f64, top_n: f64) -> Chart {
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
            Series::new("", INK, Mark::Dashed, vec![(first, fixed_n), (last, fixed_n)]),
            Series {
                opacity: 0.5,
                ..Series::new("", BLUE, Mark::Dots(2), held)
            },
            Series::new("", VERMILION, Mark::Crosses(4), dropped),
        ],
        notes: vec![Note {
            at: (last, fixed_n),
            text: "fixed force".to_owned(),
            offset: Some((-75, 4)),
            colour: INK,
        }],
    }
}
