//! The picture of `gripline evaluate grasps`: every grasp's mean force against its margin, a panel a policy.

use std::path::Path;

use plotters::prelude::*;

use super::play::Outcome;
use super::policy::Policy;
use crate::error::Failure;
use crate::plot::register_fonts;

const FONT: &str = "sans-serif";
const SIZE: (u32, u32) = (1_000, 620);
const INK: RGBColor = RGBColor(40, 40, 40);
const FAINT: RGBColor = RGBColor(215, 215, 215);
const HELD: RGBColor = RGBColor(0, 90, 181);
const DROPPED: RGBColor = RGBColor(220, 50, 32);
/// Margins beyond are drawn at the edge, percent.
const MARGINS: [f64; 2] = [-60.0, 300.0];
/// The margin that people keep, percent.
const HUMAN: [f64; 2] = [10.0, 40.0];

/// Draws the looking policies and the fixed force into a PNG.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn draw(path: &Path, outcomes: &[Outcome], fixed_n: f64) -> Result<(), Failure> {
    register_fonts().map_err(Failure::failed)?;
    panels(path, outcomes, fixed_n).map_err(|error| {
        Failure::failed(format!(
            "{}: cannot be drawn ({error}), expected a file in a folder that exists: choose another place",
            path.display()
        ))
    })
}

fn panels(path: &Path, outcomes: &[Outcome], fixed_n: f64) -> Result<(), Box<dyn std::error::Error>> {
    let root = BitMapBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let most_n = outcomes
        .iter()
        .filter(|outcome| !outcome.unsolved)
        .map(|outcome| outcome.mean_force_n)
        .fold(fixed_n, f64::max)
        * 1.05;
    for (area, policy) in root.split_evenly((2, 2)).iter().zip(Policy::LOOKING) {
        let own: Vec<&Outcome> = outcomes
            .iter()
            .filter(|outcome| outcome.policy == policy && !outcome.unsolved)
            .collect();
        let drops = own.iter().filter(|outcome| outcome.dropped).count();
        let title = format!("{}: {} grasps, {drops} dropped", policy.name(), own.len());
        let mut chart = ChartBuilder::on(area)
            .caption(title, (FONT, 17).into_font().color(&INK))
            .margin(10)
            .x_label_area_size(34)
            .y_label_area_size(44)
            .build_cartesian_2d(MARGINS[0]..MARGINS[1], 0.0..most_n)?;
        chart.draw_series([Rectangle::new(
            [(HUMAN[0], 0.0), (HUMAN[1], most_n)],
            RGBColor(225, 240, 225).filled(),
        )])?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(FAINT)
            .axis_style(INK)
            .x_labels(7)
            .y_labels(6)
            .x_desc("median margin over the needed force, %")
            .y_desc("mean force, N")
            .label_style((FONT, 13).into_font().color(&INK))
            .draw()?;
        let line = [(MARGINS[0], fixed_n), (MARGINS[1], fixed_n)];
        chart.draw_series(DashedLineSeries::new(line, 6, 4, INK.into()))?;
        chart.draw_series([EmptyElement::at((MARGINS[1], fixed_n))
            + Text::new("fixed force", (-75, 4), (FONT, 13).into_font().color(&INK))])?;
        let place = |outcome: &Outcome| {
            let margin = 100.0 * outcome.margin.unwrap_or(-1.0);
            (margin.clamp(MARGINS[0], MARGINS[1]), outcome.mean_force_n)
        };
        let held = own.iter().filter(|outcome| !outcome.dropped);
        chart.draw_series(held.map(|outcome| Circle::new(place(outcome), 2, HELD.mix(0.5).filled())))?;
        let lost = own.iter().filter(|outcome| outcome.dropped);
        chart.draw_series(lost.map(|outcome| Cross::new(place(outcome), 4, DROPPED.stroke_width(2))))?;
    }
    root.present()?;
    Ok(())
}
