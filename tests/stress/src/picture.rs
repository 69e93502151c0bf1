//! Plain line pictures: curves over an axis, each labelled. Colours that stay apart for colour-blind readers.

use std::error::Error;
use std::path::Path;

use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

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

const FONT: &str = "sans-serif";
const SIZE: (u32, u32) = (900, 480);
/// Okabe and Ito (2008).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// Draws the picture into a PNG file.
///
/// # Errors
/// A folder or file that cannot be written.
pub fn draw(picture: &Picture, folder: &Path) -> Result<(), Box<dyn Error>> {
    // The same letters on every machine.
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| "the built-in font cannot be read")?;
    std::fs::create_dir_all(folder)?;
    let path = folder.join(picture.file);
    let area = BitMapBackend::new(&path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area);
    chart
        .margin(16)
        .margin_right(24)
        .x_label_area_size(44)
        .y_label_area_size(72);
    let [x, y] = [0, 1].map(|axis| span(picture, axis));
    match picture.is_log {
        [false, false] => finish(&area, picture, chart.build_cartesian_2d(x, y)?)?,
        [true, false] => finish(&area, picture, chart.build_cartesian_2d(x.log_scale(), y)?)?,
        [false, true] => finish(&area, picture, chart.build_cartesian_2d(x, y.log_scale())?)?,
        [true, true] => finish(
            &area,
            picture,
            chart.build_cartesian_2d(x.log_scale(), y.log_scale())?,
        )?,
    }
    Ok(())
}

fn coordinate(point: (f64, f64), axis: usize) -> f64 {
    if axis == 0 { point.0 } else { point.1 }
}

/// From the least to the greatest value on an axis, with room above.
fn span(picture: &Picture, axis: usize) -> std::ops::Range<f64> {
    let is_log = picture.is_log[axis];
    let values = || {
        picture
            .curves
            .iter()
            .flat_map(|(_, points)| points)
            .map(|point| coordinate(*point, axis))
            .filter(|value| value.is_finite() && (!is_log || *value > 0.0))
    };
    let least = values().fold(f64::MAX, f64::min);
    let most = values().fold(f64::MIN, f64::max);
    if least > most {
        return 0.1..1.0;
    }
    match (is_log, axis) {
        (true, 0) => least..most,
        (true, _) => least / 2.0..most * 2.0,
        (false, 0) => least..most.max(least + 1e-9),
        (false, _) => {
            // For the legend.
            let room = (0.25 * (most - least)).max(1e-9);
            (if least >= 0.0 && least < most - least {
                0.0
            } else {
                least - room
            })..most + room
        }
    }
}

fn finish<'a, X, Y>(
    area: &DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>,
    picture: &Picture,
    mut chart: ChartContext<'a, BitMapBackend<'a>, Cartesian2d<X, Y>>,
) -> Result<(), Box<dyn Error>>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let text = |is_log: bool| {
        move |value: &f64| {
            if is_log && (*value < 0.01 || *value >= 10_000.0) {
                format!("{value:.0e}")
            } else if value.abs() >= 100.0 {
                format!("{value:.0}")
            } else {
                let text = format!("{value:.3}");
                text.trim_end_matches('0').trim_end_matches('.').to_owned()
            }
        }
    };
    chart
        .configure_mesh()
        .x_desc(picture.axes[0])
        .y_desc(picture.axes[1])
        .x_labels(9)
        .y_labels(8)
        .x_label_formatter(&text(picture.is_log[0]))
        .y_label_formatter(&text(picture.is_log[1]))
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .light_line_style(WHITE)
        .draw()?;
    let ends = [0, 1].map(|axis| span(picture, axis).start);
    for (number, (label, points)) in picture.curves.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        // What does not fit a logarithm stands at its lower end.
        let shown = points.iter().map(|(x, y)| {
            let at = |value: f64, axis: usize| {
                if picture.is_log[axis] {
                    value.max(ends[axis])
                } else {
                    value
                }
            };
            (at(*x, 0), at(*y, 1))
        });
        chart
            .draw_series(LineSeries::new(shown, colour.stroke_width(2)))?
            .label(label.clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3)));
    }
    chart
        .configure_series_labels()
        .label_font((FONT, 14))
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .position(SeriesLabelPosition::UpperRight)
        .draw()?;
    area.present()?;
    Ok(())
}
