//! Run time against error: what is below and to the left of something else is better in both.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::Failure;

/// What a point stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A network of ours, whole frames.
    Full,
    /// The same with a part of the picture changed.
    Skipping,
    /// The same weights in somebody else's engine.
    Peer,
    /// In eight bits.
    Int8,
}

impl Kind {
    /// Colours that stay apart for the colour-blind (Okabe and Ito 2008).
    fn colour(self) -> RGBColor {
        match self {
            Self::Full => RGBColor(0, 114, 178),
            Self::Skipping => RGBColor(86, 180, 233),
            Self::Peer => RGBColor(213, 94, 0),
            Self::Int8 => RGBColor(0, 158, 115),
        }
    }

    fn legend(self) -> &'static str {
        match self {
            Self::Full => "ours, every frame in full",
            Self::Skipping => "ours, 10 % and 30 % of the picture changed",
            Self::Peer => "other engines, same weights",
            Self::Int8 => "eight bits",
        }
    }
}

/// A network in an engine.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) label: String,
    pub(crate) time_ms: f64,
    /// Mean root mean square error of a taxel's components, per cent of their 99th percentile.
    pub(crate) error: f64,
    pub(crate) kind: Kind,
}

const FONT: &str = "sans-serif";
const SIZE: (u32, u32) = (1000, 640);
/// About what a letter of a label takes, pixels.
const LETTER: (i32, i32) = (7, 15);

/// Draws the points and the front: what nothing beats in both.
pub(crate) fn draw(path: &Path, points: &[Point]) -> Result<(), Failure> {
    // The same letters on every machine.
    register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| "the built-in font cannot be read")?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let most = |value: fn(&Point) -> f64| points.iter().map(value).fold(0.0, f64::max);
    let least_ms = points.iter().map(|point| point.time_ms).fold(f64::MAX, f64::min);
    let least_error = points.iter().map(|point| point.error).fold(f64::MAX, f64::min);
    let area = BitMapBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(
            "Force networks: time of a frame on one core against error",
            (FONT, 18),
        )
        .margin(14)
        .x_label_area_size(42)
        .y_label_area_size(56)
        .build_cartesian_2d(
            (0.7 * least_ms..1.6 * most(|point| point.time_ms)).log_scale(),
            0.9 * least_error..1.05 * most(|point| point.error),
        )?;
    chart
        .configure_mesh()
        .x_desc("camera crop to forces, ms (median)")
        .y_desc("taxel RMSE, mean of x, y, z, % of the 99th percentile")
        .x_labels(6)
        .x_label_formatter(&|ms| format!("{ms:.2}"))
        .label_style((FONT, 13))
        .axis_desc_style((FONT, 14))
        .light_line_style(WHITE)
        .draw()?;
    chart.draw_series(LineSeries::new(front(points), BLACK.mix(0.35)))?;
    for kind in [Kind::Full, Kind::Skipping, Kind::Peer, Kind::Int8] {
        let colour = kind.colour();
        let of_kind = points.iter().filter(|point| point.kind == kind);
        chart
            .draw_series(of_kind.map(|point| {
                let style = if kind == Kind::Skipping {
                    colour.stroke_width(2)
                } else {
                    colour.filled()
                };
                Circle::new((point.time_ms, point.error), 5, style)
            }))?
            .label(kind.legend())
            .legend(move |(x, y)| Circle::new((x + 8, y), 5, colour.filled()));
    }
    chart
        .configure_series_labels()
        .label_font((FONT, 13))
        .background_style(WHITE.mix(0.9))
        .border_style(BLACK.mix(0.3))
        .position(SeriesLabelPosition::LowerLeft)
        .draw()?;
    let places: Vec<(i32, i32)> = points
        .iter()
        .map(|point| chart.backend_coord(&(point.time_ms, point.error)))
        .collect();
    for (point, (place, label)) in points.iter().zip(places.iter().zip(labels(points, &places))) {
        let [left, top, right, bottom] = label;
        let to = (place.0.clamp(left, right), place.1.clamp(top, bottom));
        area.draw(&PathElement::new([*place, to], BLACK.mix(0.25)))?;
        area.draw(&Text::new(point.label.clone(), (left, top), (FONT, 13)))?;
    }
    area.present()?;
    Ok(())
}

/// Where labels go, as left, top, right and bottom: the nearest place to the point that covers neither a point nor a label
/// before it; to its right, over it, under it, to its left, then farther up and down.
fn labels(points: &[Point], places: &[(i32, i32)]) -> Vec<[i32; 4]> {
    let overlap = |a: &[i32; 4], b: &[i32; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    let mut taken: Vec<[i32; 4]> = places
        .iter()
        .map(|&(x, y)| [x - 6, y - 6, x + 6, y + 6])
        .collect();
    let mut labels = Vec::new();
    for (point, &(x, y)) in points.iter().zip(places) {
        let (width, height) = (point.label.len() as i32 * LETTER.0, LETTER.1);
        let steps = [0, 1, 2, 3, 4, 5, 6].map(|step| step * height);
        let candidates = [
            (x + 9, y - height / 2),
            (x - width / 2, y - height - 7),
            (x - width / 2, y + 7),
        ]
        .into_iter()
        .chain([(x - width - 9, y - height / 2)])
        .chain(steps.into_iter().flat_map(|step| {
            [
                (x - width / 2, y + 7 + step),
                (x - width / 2, y - height - 7 - step),
                (x - width - 9, y + step),
                (x + 9, y - step),
            ]
        }));
        let label = candidates
            .map(|(left, top)| [left, top, left + width, top + height])
            .filter(|label| label[2] < SIZE.0 as i32)
            .find(|label| !taken.iter().any(|other| overlap(label, other)))
            .unwrap_or([x, y, x + width, y + height]);
        taken.push(label);
        labels.push(label);
    }
    labels
}

/// From the fastest to the most exact, in steps. Skipping depends on the scene and stays out.
fn front(points: &[Point]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<&Point> = points
        .iter()
        .filter(|point| point.kind != Kind::Skipping)
        .collect();
    sorted.sort_by(|a, b| a.time_ms.total_cmp(&b.time_ms));
    let mut line: Vec<(f64, f64)> = Vec::new();
    for point in sorted {
        match line.last() {
            Some(&(_, error)) if point.error >= error => {}
            Some(&(_, error)) => line.extend([(point.time_ms, error), (point.time_ms, point.error)]),
            None => line.push((point.time_ms, point.error)),
        }
    }
    line
}
