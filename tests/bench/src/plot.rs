//! Run time against error, the detector on the left and the whole chain on the right: what is below and to the left of
//! something else is better in both.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::Failure;

/// A way to the decision.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) label: String,
    pub(crate) time: f64,
    pub(crate) error: f64,
    /// Somebody else's.
    pub(crate) is_peer: bool,
}

const FONT: &str = "sans-serif";
const SIZE: (u32, u32) = (1240, 520);
/// Okabe and Ito (2008).
const OURS: RGBColor = RGBColor(0, 114, 178);
const PEER: RGBColor = RGBColor(213, 94, 0);

/// Draws both panels.
pub(crate) fn draw(path: &Path, detector: &[Point], chain: &[Point]) -> Result<(), Failure> {
    // The same letters on every machine.
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| "the built-in font cannot be read")?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let area = BitMapBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let (left, right) = area.split_horizontally(SIZE.0 / 2);
    panel(
        &left,
        detector,
        "Detector: time of a map against stick ratio",
        ["us a map (best)", "stick ratio off by, mean, 1/10,000"],
    )?;
    panel(
        &right,
        chain,
        "Whole chain: time of a frame against stick ratio",
        [
            "camera crop to decision, ms (over all scenes)",
            "stick ratio off by, mean",
        ],
    )?;
    area.present()?;
    Ok(())
}

fn panel(
    area: &DrawingArea<BitMapBackend<'_>, Shift>,
    points: &[Point],
    title: &str,
    axes: [&str; 2],
) -> Result<(), Failure> {
    let most = |value: fn(&Point) -> f64| points.iter().map(value).fold(0.0, f64::max);
    let least = points.iter().map(|point| point.time).fold(f64::MAX, f64::min);
    let top = most(|point| point.error).max(1e-3);
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 18))
        .margin(14)
        .x_label_area_size(42)
        .y_label_area_size(56)
        .build_cartesian_2d(
            (0.6 * least..9.0 * most(|point| point.time)).log_scale(),
            -0.05 * top..1.4 * top,
        )?;
    chart
        .configure_mesh()
        .x_desc(axes[0])
        .y_desc(axes[1])
        .x_labels(6)
        .x_label_formatter(&|value| {
            if *value < 10.0 {
                format!("{value:.2}")
            } else {
                format!("{value:.0}")
            }
        })
        .y_label_formatter(&|value| format!("{value:.2}"))
        .label_style((FONT, 13))
        .axis_desc_style((FONT, 14))
        .light_line_style(WHITE)
        .draw()?;
    chart.draw_series(LineSeries::new(front(points), BLACK.mix(0.35)))?;
    // Labels of neighbours in turn above and below, further away the more of them share a place.
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| a.time.total_cmp(&b.time));
    for (number, point) in sorted.into_iter().enumerate() {
        let colour = if point.is_peer { PEER } else { OURS };
        let up = [-20, -38, -56, -74][number % 4];
        let label = EmptyElement::at((point.time, point.error))
            + Circle::new((0, 0), 5, colour.filled())
            + PathElement::new([(0, 0), (0, up + 12)], BLACK.mix(0.25))
            + Text::new(
                point.label.clone(),
                (2, up),
                (FONT, 13).into_font().color(&colour),
            );
        chart.draw_series([label])?;
    }
    Ok(())
}

/// From the fastest to the most exact, in steps.
fn front(points: &[Point]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| a.time.total_cmp(&b.time));
    let mut line: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        match line.last() {
            Some(&(_, error)) if point.error >= error => {}
            Some(&(_, error)) => line.extend([(point.time, error), (point.time, point.error)]),
            None => line.push((point.time, point.error)),
        }
    }
    line
}
