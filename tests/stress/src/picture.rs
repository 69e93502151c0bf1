//! Line charts of the sweeps.

use std::path::Path;

use gripline_chart::{Axis, COLOURS, Chart, ChartError, Figure, Legend, Mark, Panel, Series};

/// Curves to be drawn.
#[derive(Debug, Clone)]
pub struct Picture {
    /// File name.
    pub file: &'static str,
    /// What it shows, in a sentence.
    pub caption: String,
    /// What the axes are.
    pub axes: [&'static str; 2],
    /// Whether an axis is logarithmic; values of 0 then stand at the lower end.
    pub is_log: [bool; 2],
    /// Curves with their labels.
    pub curves: Vec<(String, Vec<(f64, f64)>)>,
}

/// Draws the picture into a PNG file.
///
/// # Errors
/// A folder or file that cannot be written.
pub fn draw(picture: &Picture, folder: &Path) -> Result<(), ChartError> {
    let curves = picture.curves.iter().zip(COLOURS.into_iter().cycle());
    let [x, y] = [0, 1].map(|number| axis(picture, number));
    let chart = Chart {
        title: String::new(),
        x,
        y,
        legend: Legend::UpperRight,
        series: curves
            .map(|((label, points), colour)| Series::new(label, colour, Mark::Line(2), points.clone()))
            .collect(),
        notes: Vec::new(),
    };
    Figure::single(900, 480, Panel::Chart(chart)).save(&folder.join(picture.file))
}

/// An axis over all values, with room for the legend above.
fn axis(picture: &Picture, number: usize) -> Axis {
    let is_log = picture.is_log[number];
    let points = picture.curves.iter().flat_map(|(_, points)| points);
    let values = points
        .map(|(x, y)| if number == 0 { *x } else { *y })
        .filter(|value| value.is_finite() && (!is_log || *value > 0.0));
    let (min, max) = values.fold((f64::MAX, f64::MIN), |(min, max), value| {
        (min.min(value), max.max(value))
    });
    let room = (0.25 * (max - min)).max(1e-9);
    let starts_at_zero = min >= 0.0 && min < max - min;
    let range = match (is_log, number) {
        _ if min > max => [0.1, 1.0],
        (_, 0) => [min, max],
        (true, _) => [min / 2.0, max * 2.0],
        (false, _) => [if starts_at_zero { 0.0 } else { min - room }, max + room],
    };
    Axis {
        is_log,
        ticks: 9,
        ..Axis::new(picture.axes[number], range)
    }
}
