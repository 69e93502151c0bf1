//! Axes with series of points.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::labels::{Rect, place};
use super::{Area, Colour, Drawn, FAINT, INK, NORMAL, SMALL, TITLE, style};

/// Room for the numbers and the name of the y axis.
const Y_AREA: u32 = 66;
const MARGIN: u32 = 10;

/// One axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// First and last value.
    pub range: [f64; 2],
    /// Logarithmic; values of 0 and less stand at the lower end.
    pub is_log: bool,
    /// About how many numbers; 0 for none.
    pub ticks: usize,
    /// Whether lines run through the chart at the numbers.
    pub has_grid: bool,
}

impl Axis {
    /// A linear axis with seven numbers and a grid.
    #[must_use]
    pub fn new(label: impl Into<String>, range: [f64; 2]) -> Self {
        Self {
            label: label.into(),
            range,
            is_log: false,
            ticks: 7,
            has_grid: true,
        }
    }

    /// A logarithmic axis.
    #[must_use]
    pub fn log(label: impl Into<String>, range: [f64; 2]) -> Self {
        Self {
            is_log: true,
            ..Self::new(label, range)
        }
    }

    fn coordinate(&self) -> Coordinate {
        let [start, end] = self.range;
        Coordinate {
            // Never empty: plotters divides by the length.
            range: start..if end > start { end } else { start + 1e-9 },
            is_log: self.is_log,
        }
    }
}

/// Where the legend stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Legend {
    /// Nowhere.
    None,
    /// In a line above the axes.
    Above,
    /// Inside, in this corner.
    UpperRight,
    /// Inside, in this corner.
    LowerRight,
    /// Inside, in this corner.
    LowerLeft,
}

/// How the points of a series are drawn. Widths and radii in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line of this width.
    Line(u32),
    /// A thin dashed line.
    Dashed,
    /// Discs of this radius.
    Dots(u32),
    /// Circles of this radius.
    Rings(u32),
    /// Crosses of this half width.
    Crosses(u32),
    /// Filled rectangles: every two points are opposite corners.
    Boxes,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    /// In the legend; empty for none.
    pub label: String,
    /// Colour of the marks.
    pub colour: Colour,
    /// 0 to 1: below 1 marks that lie on each other show.
    pub opacity: f64,
    /// What is drawn.
    pub mark: Mark,
    /// x and y in the axes' units.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// An opaque series.
    #[must_use]
    pub fn new(label: impl Into<String>, colour: Colour, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.into(),
            colour,
            opacity: 1.0,
            mark,
            points,
        }
    }
}

/// A text at a point.
#[derive(Debug, Clone)]
pub struct Note {
    /// The point, in the axes' units.
    pub at: (f64, f64),
    /// The text.
    pub text: String,
    /// From the point to the text's upper left corner, pixels. `None`: the nearest free place, joined to the point by a line.
    pub offset: Option<(i32, i32)>,
    /// Colour of the text.
    pub colour: Colour,
}

/// Axes with series of points, drawn in their order.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Above; empty for none.
    pub title: String,
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// Where the series' names stand.
    pub legend: Legend,
    /// The data.
    pub series: Vec<Series>,
    /// Texts beside the data.
    pub notes: Vec<Note>,
}

type Context<'a, B> = ChartContext<'a, B, Cartesian2d<Coordinate, Coordinate>>;

impl Chart {
    pub(crate) fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn<B> {
        let mut builder = ChartBuilder::on(area);
        builder.margin(MARGIN).margin_right(2 * MARGIN);
        if self.legend == Legend::Above {
            builder.margin_top(3 * MARGIN);
            self.draw_legend_above(area)?;
        }
        if !self.title.is_empty() {
            builder.caption(&self.title, style(TITLE, INK));
        }
        builder.y_label_area_size(Y_AREA);
        builder.x_label_area_size(match (self.x.ticks, self.x.label.is_empty()) {
            (0, _) => 4,
            (_, true) => 26,
            (_, false) => 42,
        });
        let mut chart = builder.build_cartesian_2d(self.x.coordinate(), self.y.coordinate())?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(WHITE)
            .bold_line_style(FAINT.mix(0.8))
            .axis_style(INK)
            .x_labels(self.x.ticks)
            .y_labels(self.y.ticks)
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .label_style(style(SMALL, INK))
            .axis_desc_style(style(NORMAL, INK));
        if !self.x.has_grid {
            mesh.disable_x_mesh();
        }
        if !self.y.has_grid {
            mesh.disable_y_mesh();
        }
        mesh.draw()?;
        for series in &self.series {
            series.draw(&mut chart, self.legend)?;
        }
        self.draw_notes(&chart)?;
        let position = match self.legend {
            Legend::None | Legend::Above => return Ok(()),
            Legend::UpperRight => SeriesLabelPosition::UpperRight,
            Legend::LowerRight => SeriesLabelPosition::LowerRight,
            Legend::LowerLeft => SeriesLabelPosition::LowerLeft,
        };
        if self.series.iter().all(|series| series.label.is_empty()) {
            return Ok(());
        }
        chart
            .configure_series_labels()
            .position(position)
            .label_font(style(NORMAL, INK))
            .background_style(WHITE.mix(0.85))
            .border_style(FAINT)
            .draw()
    }

    fn draw_legend_above<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn<B> {
        let mut x = Y_AREA as i32 + MARGIN as i32;
        for series in self.series.iter().filter(|series| !series.label.is_empty()) {
            let line = vec![(x, 15), (x + 22, 15)];
            area.draw(&PathElement::new(line, series.colour.stroke_width(2)))?;
            let text = style(NORMAL, INK);
            area.draw(&Text::new(series.label.clone(), (x + 28, 8), text.clone()))?;
            x += 52 + area.estimate_text_size(&series.label, &text)?.0 as i32;
        }
        Ok(())
    }

    fn draw_notes<B: DrawingBackend>(&self, chart: &Context<'_, B>) -> Drawn<B> {
        let plane = chart.plotting_area();
        let (free, fixed): (Vec<&Note>, Vec<&Note>) =
            self.notes.iter().partition(|note| note.offset.is_none());
        for note in fixed {
            let offset = note.offset.unwrap_or_default();
            let text = Text::new(note.text.clone(), offset, style(SMALL, note.colour));
            plane.draw(&(EmptyElement::at(note.at) + text))?;
        }
        let mut points = Vec::new();
        let mut sizes = Vec::new();
        for note in &free {
            points.push(plane.map_coordinate(&note.at));
            let (width, height) = plane.estimate_text_size(&note.text, &style(SMALL, note.colour))?;
            sizes.push([width as i32, height as i32]);
        }
        let (columns, rows) = plane.get_pixel_range();
        let within = Rect::new([columns.start, rows.start], [columns.end, rows.end]);
        let places = place(&points, &sizes, within);
        for ((note, (x, y)), to) in free.iter().zip(&points).zip(&places) {
            let end = to.nearest((*x, *y));
            let relative = |(px, py): (i32, i32)| (px - x, py - y);
            let text = Text::new(
                note.text.clone(),
                relative((to.left, to.top)),
                style(SMALL, note.colour),
            );
            plane.draw(
                &(EmptyElement::at(note.at) + PathElement::new([(0, 0), relative(end)], INK.mix(0.3)) + text),
            )?;
        }
        Ok(())
    }
}

impl Series {
    fn draw<B: DrawingBackend>(&self, chart: &mut Context<'_, B>, legend: Legend) -> Drawn<B> {
        let colour = self.colour.mix(self.opacity);
        let points = self.points.iter().copied();
        let drawn = match self.mark {
            Mark::Line(width) => chart.draw_series(LineSeries::new(points, colour.stroke_width(width)))?,
            Mark::Dashed => chart.draw_series(DashedLineSeries::new(points, 6, 4, colour.into()))?,
            Mark::Dots(radius) => {
                chart.draw_series(points.map(|at| Circle::new(at, radius, colour.filled())))?
            }
            Mark::Rings(radius) => {
                chart.draw_series(points.map(|at| Circle::new(at, radius, colour.stroke_width(2))))?
            }
            Mark::Crosses(radius) => {
                chart.draw_series(points.map(|at| Cross::new(at, radius, colour.stroke_width(2))))?
            }
            Mark::Boxes => {
                let (corners, _) = self.points.as_chunks::<2>();
                chart.draw_series(
                    corners
                        .iter()
                        .map(|corners| Rectangle::new(*corners, colour.filled())),
                )?
            }
        };
        if self.label.is_empty() || legend == Legend::Above {
            return Ok(());
        }
        let drawn = drawn.label(&self.label);
        let colour = self.colour;
        match self.mark {
            Mark::Line(_) | Mark::Dashed => {
                drawn.legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)))
            }
            Mark::Boxes => {
                drawn.legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 10, y + 5)], colour.filled()))
            }
            _ => drawn.legend(move |(x, y)| Circle::new((x + 9, y), 4, colour.filled())),
        };
        Ok(())
    }
}

/// The points that no other beats in both x and y, as a staircase from the least x to the least y.
#[must_use]
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut line: Vec<(f64, f64)> = Vec::new();
    for (x, y) in sorted {
        match line.last() {
            Some(&(_, lowest)) if y >= lowest => {}
            Some(&(_, lowest)) => line.extend([(x, lowest), (x, y)]),
            None => line.push((x, y)),
        }
    }
    line
}

/// A linear or logarithmic axis as plotters wants it.
#[derive(Debug, Clone)]
struct Coordinate {
    range: Range<f64>,
    is_log: bool,
}

impl Ranged for Coordinate {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        let scaled = |value: f64| {
            if self.is_log {
                value.max(self.range.start).log10()
            } else {
                value
            }
        };
        let [value, first, last] = [*value, self.range.start, self.range.end].map(scaled);
        start + ((value - first) / (last - first) * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if !self.is_log {
            return RangedCoordf64::from(self.range.clone()).key_points(hint);
        }
        let [first, last] = [self.range.start, self.range.end].map(f64::log10);
        // Between few powers of ten there is room for more numbers.
        let steps: &[f64] = if last - first < 2.5 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        (first.floor() as i32..=last.ceil() as i32)
            .flat_map(|power| steps.iter().map(move |step| step * 10_f64.powi(power)))
            .filter(|value| self.range.contains(value))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Coordinate {
    fn format(value: &f64) -> String {
        number(value)
    }
}

/// As few digits as tell the numbers of an axis apart.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "plotters hands out references")]
fn number(value: &f64) -> String {
    match value.abs() {
        // What rounding leaves of 0.
        size if size < 1e-12 => "0".to_owned(),
        size if !(0.001..10_000.0).contains(&size) => format!("{value:.0e}"),
        size if size >= 100.0 => format!("{value:.0}"),
        _ => {
            let text = format!("{value:.3}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_an_axis_have_no_needless_digits() {
        for (value, text) in [
            (0.3 - 0.1 - 0.2, "0"),
            (0.1 + 0.2, "0.3"),
            (12.0, "12"),
            (250.4, "250"),
            (2e-4, "2e-4"),
            (1e5, "1e5"),
            (-1.25, "-1.25"),
        ] {
            assert_eq!(number(&value), text);
        }
    }

    #[test]
    fn a_front_leaves_out_what_is_beaten_in_both() {
        let front = pareto_front(&[(3.0, 1.0), (1.0, 2.0), (2.0, 2.5)]);
        assert_eq!(front, [(1.0, 2.0), (3.0, 2.0), (3.0, 1.0)]);
    }

    #[test]
    fn a_logarithmic_axis_shows_zero_at_its_lower_end() {
        let axis = Axis::log("", [0.1, 10.0]).coordinate();
        assert_eq!(
            [0.0, 0.1, 1.0, 10.0].map(|value| axis.map(&value, (0, 100))),
            [0, 0, 50, 100]
        );
    }
}
