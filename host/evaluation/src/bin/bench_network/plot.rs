//! Run time against error: what is below and to the left of something else is better in both.

use std::path::Path;

use gripline_chart::{
    Axis, BLUE, Chart, ChartError, Colour, Figure, GREEN, GREY, INK, Legend, Mark, Note, Panel, SKY, Series,
    VERMILION, pareto_front,
};

/// What a point stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A network of ours, whole frames.
    Full,
    /// The same with a part of the picture changed.
    Skipping,
    /// The same weights in another's engine.
    Peer,
    /// In eight bits.
    Int8,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Full, Self::Skipping, Self::Peer, Self::Int8];

    const fn look(self) -> (&'static str, Colour, Mark) {
        match self {
            Self::Full => ("ours, every frame in full", BLUE, Mark::Dots(5)),
            Self::Skipping => ("ours, 10 % and 30 % of the picture changed", SKY, Mark::Rings(5)),
            Self::Peer => ("other engines, same weights", VERMILION, Mark::Dots(5)),
            Self::Int8 => ("eight bits", GREEN, Mark::Dots(5)),
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

/// Draws the points and the front: what nothing beats in both.
pub(crate) fn draw(path: &Path, points: &[Point]) -> Result<(), ChartError> {
    let at = |point: &Point| (point.time_ms, point.error);
    let range = |value: fn(&Point) -> f64| {
        let values = points.iter().map(value);
        values.fold((f64::MAX, 0.0_f64), |(min, max), value| {
            (min.min(value), max.max(value))
        })
    };
    let (fastest, slowest) = range(|point| point.time_ms);
    let (lowest, highest) = range(|point| point.error);
    // Skipping depends on the scene and stays out of the front.
    let whole = points.iter().filter(|point| point.kind != Kind::Skipping);
    let front = pareto_front(&whole.map(at).collect::<Vec<_>>());
    let mut series = vec![Series::new("", GREY, Mark::Line(1), front)];
    for kind in Kind::ALL {
        let (label, colour, mark) = kind.look();
        let own = points.iter().filter(|point| point.kind == kind).map(at);
        series.push(Series::new(label, colour, mark, own.collect()));
    }
    let chart = Chart {
        title: "Force networks: time of a frame on one core against error".to_owned(),
        x: Axis::log(
            "camera crop to forces, ms (median)",
            [0.7 * fastest, 1.6 * slowest],
        ),
        y: Axis::new(
            "taxel RMSE, mean of x, y, z, % of the 99th percentile",
            [0.9 * lowest, 1.05 * highest],
        ),
        legend: Legend::LowerLeft,
        series,
        notes: points
            .iter()
            .map(|point| Note {
                at: at(point),
                text: point.label.clone(),
                offset: None,
                colour: INK,
            })
            .collect(),
    };
    Figure::single(1_000, 640, Panel::Chart(chart)).save(path)
}
