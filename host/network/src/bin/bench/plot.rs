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
const SIZE: (u32, u32) = (900, 560);

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
            0.0..1.15 * most(|point| point.error),
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
            .draw_series(of_kind.clone().map(|point| {
                let style = if kind == Kind::Skipping {
                    colour.stroke_width(2)
                } else {
                    colour.filled()
                };
                Circle::new((point.time_ms, point.error), 5, style)
            }))?
            .label(kind.legend())
            .legend(move |(x, y)| Circle::new((x + 8, y), 5, colour.filled()));
        for (number, point) in of_kind.enumerate() {
            // Neighbours' labels one above and one below.
            let down = match (kind, number % 2) {
                (Kind::Full, _) | (Kind::Skipping, 0) => -20,
                (Kind::Skipping, _) | (Kind::Peer, 0) => 8,
                (Kind::Peer, _) => -20,
                (Kind::Int8, _) => 24,
            };
            let label = EmptyElement::at((point.time_ms, point.error))
                + Text::new(point.label.clone(), (-8, down), (FONT, 13));
            chart.draw_series([label])?;
        }
    }
    chart
        .configure_series_labels()
        .label_font((FONT, 13))
        .background_style(WHITE.mix(0.9))
        .border_style(BLACK.mix(0.3))
        .position(SeriesLabelPosition::LowerLeft)
        .draw()?;
    area.present()?;
    Ok(())
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
