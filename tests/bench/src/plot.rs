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
    let plane = chart.plotting_area();
    let (columns, rows) = plane.get_pixel_range();
    let mut places = Places::within([columns.start, rows.start, columns.end, rows.end]);
    let at = |point: &Point| plane.map_coordinate(&(point.time, point.error));
    for point in points {
        places.take(around(at(point), 6));
    }
    // From the right: so the labels rise to the left, and no line to a label crosses another one.
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| b.time.total_cmp(&a.time));
    for point in sorted {
        let colour = if point.is_peer { PEER } else { OURS };
        let style = (FONT, 13).into_font().color(&colour);
        let (width, height) = plane.estimate_text_size(&point.label, &style)?;
        let [right, up] = places.find(at(point), [width as i32, height as i32]);
        let end = if up < 0 { up + height as i32 } else { up };
        let label = EmptyElement::at((point.time, point.error))
            + Circle::new((0, 0), 5, colour.filled())
            + PathElement::new([(0, 0), (0, end)], BLACK.mix(0.25))
            + Text::new(point.label.clone(), (right, up), style);
        plane.draw(&label)?;
    }
    Ok(())
}

/// A rectangle of pixels: left, top, right, bottom.
type Pixels = [i32; 4];

fn around((x, y): (i32, i32), reach: i32) -> Pixels {
    [x - reach, y - reach, x + reach, y + reach]
}

fn are_apart([left, top, right, bottom]: Pixels, other: Pixels) -> bool {
    right <= other[0] || other[2] <= left || bottom <= other[1] || other[3] <= top
}

/// Where there is something already.
struct Places {
    within: Pixels,
    taken: Vec<Pixels>,
    /// To labels; they may lie on each other, but no label on them.
    lines: Vec<Pixels>,
}

impl Places {
    fn within(within: Pixels) -> Self {
        Self {
            within,
            taken: Vec::new(),
            lines: Vec::new(),
        }
    }

    fn take(&mut self, place: Pixels) {
        self.taken.push(place);
    }

    fn is_free(&self, place: Pixels) -> bool {
        let apart = |other: &Pixels| are_apart(place, *other);
        self.taken.iter().all(apart) && self.lines.iter().all(apart)
    }

    /// Takes the nearest free place for a label of this size, and for the line to it, and tells it as seen from its point:
    /// above the point or below it, to the right of the line, and to the left only where it is too wide for the right. Where
    /// nothing is free, the line may cross labels.
    fn find(&mut self, (x, y): (i32, i32), [width, height]: [i32; 2]) -> [i32; 2] {
        const GAP: i32 = 3;
        const STEP: usize = 4;
        let [left, top, end, bottom] = self.within;
        for may_cross in [false, true] {
            for right in [GAP, -GAP - width] {
                for up in (8..400).step_by(STEP).flat_map(|far| [-far - height, far]) {
                    let label = [x + right, y + up, x + right + width, y + up + height];
                    // Away from the point, whose own place is taken.
                    let line = if up < 0 {
                        [x - 1, y + up, x + 1, y - 7]
                    } else {
                        [x - 1, y + 7, x + 1, y + up + height]
                    };
                    let fits = label[0] >= left && label[1] >= top && label[2] <= end && label[3] <= bottom;
                    let crosses = self.taken.iter().any(|other| !are_apart(line, *other));
                    if fits && self.is_free(label) && (may_cross || !crosses) {
                        self.take(label);
                        self.lines.push(line);
                        return [right, up];
                    }
                }
            }
        }
        [GAP, -8 - height]
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_points_in_one_place_do_not_overlap_and_stay_inside() {
        let within = [0, 0, 600, 400];
        let mut places = Places::within(within);
        let points = [(590, 390), (300, 390), (298, 390), (300, 390), (5, 395), (8, 395)];
        for point in points {
            places.take(around(point, 6));
        }
        for point in points {
            places.find(point, [120, 13]);
        }
        let labels: Vec<Pixels> = places.taken[points.len()..].to_vec();
        assert_eq!(labels.len(), points.len());
        for (number, label) in labels.iter().enumerate() {
            let own = Places {
                within,
                taken: labels[..number].to_vec(),
                lines: Vec::new(),
            };
            assert!(own.is_free(*label), "{label:?}");
            assert!(label[0] >= 0 && label[1] >= 0 && label[2] <= 600 && label[3] <= 400);
        }
    }
}
