//! Run time against error, the detector on the left and the whole chain on the right: what is below and to the left of
//! something else is better in both.

use std::path::Path;

use gripline_chart::{
    Axis, BLUE, Chart, ChartError, Figure, GREY, Legend, Mark, Note, Panel, Series, VERMILION, pareto_front,
};

/// A way to the decision.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) label: String,
    pub(crate) time: f64,
    pub(crate) error: f64,
    /// another's.
    pub(crate) is_peer: bool,
}

/// Draws both panels.
pub(crate) fn draw(path: &Path, detector: &[Point], chain: &[Point]) -> Result<(), ChartError> {
    let detector = panel(
        detector,
        "Detector: time of a map against stick ratio",
        "us a map (best)",
        "stick ratio off by, mean, 1/10,000",
    );
    let chain = panel(
        chain,
        "Whole chain: time of a frame against wrong decisions",
        "camera crop to decision, ms (over all scenes)",
        "slip decided otherwise than on the true forces, a minute",
    );
    let figure = Figure {
        width: 1_500,
        rows: vec![(640, vec![Panel::Chart(detector), Panel::Chart(chain)])],
    };
    figure.save(path)
}

fn panel(points: &[Point], title: &str, time: &str, error: &str) -> Chart {
    let max = |value: fn(&Point) -> f64| points.iter().map(value).fold(0.0, f64::max);
    let fastest = points.iter().map(|point| point.time).fold(f64::MAX, f64::min);
    let top = max(|point| point.error).max(1e-3);
    let at = |point: &Point| (point.time, point.error);
    let all: Vec<(f64, f64)> = points.iter().map(at).collect();
    let colour = |is_peer: bool| if is_peer { VERMILION } else { BLUE };
    let mut series = vec![Series::new("", GREY, Mark::Line(1), pareto_front(&all))];
    for is_peer in [false, true] {
        let own = points.iter().filter(|point| point.is_peer == is_peer).map(at);
        series.push(Series::new("", colour(is_peer), Mark::Dots(5), own.collect()));
    }
    Chart {
        title: title.to_owned(),
        // Room for labels on the right.
        x: Axis::log(time, [0.6 * fastest, 9.0 * max(|point| point.time)]),
        y: Axis::new(error, [-0.05 * top, 1.4 * top]),
        legend: Legend::None,
        series,
        notes: points
            .iter()
            .map(|point| Note {
                at: at(point),
                text: point.label.clone(),
                offset: None,
                colour: colour(point.is_peer),
            })
            .collect(),
    }
}
