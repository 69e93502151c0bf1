//! Draws a recording's picture on any of plotters' backends. Colours that stay apart for colour-blind readers.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::series::{Moment, Panel, Series};

type Error<B> = DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Who said slip.
type Says = fn(&Moment) -> bool;

const FONT: &str = "sans-serif";
/// Heights: traces of the stick ratio, strips of slip, traces of forces; the maps take the rest.
const HEIGHTS: [u32; 3] = [270, 110, 230];
/// Room for the numbers of the axes on the left, and on the right for labels.
const LEFT: u32 = 70;
const RIGHT: u32 = 20;

const INK: RGBColor = RGBColor(40, 40, 40);
const FAINT: RGBColor = RGBColor(205, 205, 205);
const DETECTOR: RGBColor = RGBColor(0, 90, 181);
const WORLD: RGBColor = RGBColor(120, 120, 120);
const SLIP: RGBColor = RGBColor(220, 50, 32);
const BASELINE: RGBColor = RGBColor(230, 159, 0);
const LINE: RGBColor = RGBColor(0, 130, 90);
/// Normal force of a taxel that sticks, and of one that slips, at full scale.
const STICKS: RGBColor = RGBColor(0, 80, 160);
const SLIPS: RGBColor = RGBColor(200, 60, 20);

/// The same letters on every machine, without a font library.
///
/// # Errors
/// When the font that comes with the program cannot be read.
pub(crate) fn register_fonts() -> Result<(), &'static str> {
    plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| "the built-in font cannot be read")
}

/// The whole picture.
///
/// # Errors
/// The backend's.
pub(super) fn draw<B: DrawingBackend>(root: &DrawingArea<B, Shift>, series: &Series) -> Result<(), Error<B>> {
    root.fill(&WHITE)?;
    let (ratio, rest) = root.split_vertically(HEIGHTS[0]);
    let (strips, rest) = rest.split_vertically(HEIGHTS[1]);
    let (forces, maps) = rest.split_vertically(HEIGHTS[2]);
    draw_stick_ratio(&ratio, series)?;
    draw_strips(&strips, series)?;
    draw_forces(&forces, series)?;
    draw_maps(&maps, series)?;
    root.present()
}

/// From the first frame to the last, never empty.
fn time(series: &Series) -> std::ops::Range<f64> {
    let first = series.moments.first().map_or(0.0, |moment| moment.t_s);
    let last = series.moments.last().map_or(1.0, |moment| moment.t_s);
    first..last.max(first + 1e-3)
}

fn label(size: u32) -> TextStyle<'static> {
    (FONT, size).into_font().color(&INK)
}

fn draw_stick_ratio<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    series: &Series,
) -> Result<(), Error<B>> {
    let mut chart = ChartBuilder::on(area)
        .margin_top(30)
        .margin_right(RIGHT)
        .x_label_area_size(4)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(time(series), 0.0..1.05)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(WHITE)
        .bold_line_style(FAINT)
        .axis_style(INK)
        .y_labels(6)
        .x_labels(0)
        .y_desc("stick ratio")
        .axis_desc_style(label(15))
        .label_style(label(13))
        .draw()?;
    // The parts of the script, where there is one.
    for (t_s, phase) in series.phases().into_iter().filter(|(_, phase)| !phase.is_empty()) {
        chart.draw_series([PathElement::new(vec![(t_s, 0.0), (t_s, 1.05)], FAINT)])?;
        chart.draw_series([
            EmptyElement::at((t_s, 0.0)) + Text::new(phase.to_owned(), (4, -16), label(12).color(&WORLD))
        ])?;
    }
    let ends = time(series);
    let threshold = [(ends.start, series.threshold), (ends.end, series.threshold)];
    chart.draw_series(DashedLineSeries::new(threshold, 6, 4, SLIP.into()))?;
    chart.draw_series([EmptyElement::at((ends.end, series.threshold))
        + Text::new(
            format!("slip below {:.2}", series.threshold),
            (-95, -15),
            label(12).color(&SLIP),
        )])?;
    trace(&mut chart, series, |moment| moment.true_stick_ratio, WORLD, 1)?;
    trace(&mut chart, series, |moment| moment.stick_ratio, DETECTOR, 2)?;
    for (panel, name) in series.panels.iter().zip('a'..) {
        let moment = &series.moments[panel.moment];
        let place = (moment.t_s, moment.stick_ratio.unwrap_or(0.0));
        chart.draw_series([EmptyElement::at(place)
            + Circle::new((0, 0), 4, DETECTOR.filled())
            + Text::new(name.to_string(), (-3, 7), label(14))])?;
    }
    legend(area, &[("detector", DETECTOR), ("world", WORLD)])
}

/// A trace, broken where there is nothing.
fn trace<B: DrawingBackend>(
    chart: &mut Chart<'_, B>,
    series: &Series,
    what: impl Fn(&Moment) -> Option<f64>,
    colour: RGBColor,
    width: u32,
) -> Result<(), Error<B>> {
    for line in series.lines(what) {
        chart.draw_series(LineSeries::new(line, colour.stroke_width(width)))?;
    }
    Ok(())
}

/// Names of the traces, above the chart.
fn legend<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    entries: &[(&str, RGBColor)],
) -> Result<(), Error<B>> {
    let mut x = LEFT as i32;
    for (name, colour) in entries {
        area.draw(&PathElement::new(
            vec![(x, 15), (x + 22, 15)],
            colour.stroke_width(2),
        ))?;
        area.draw(&Text::new((*name).to_owned(), (x + 28, 8), label(14)))?;
        x += 28 + 8 * name.chars().count() as i32 + 24;
    }
    Ok(())
}

/// When each of them said slip.
fn draw_strips<B: DrawingBackend>(area: &DrawingArea<B, Shift>, series: &Series) -> Result<(), Error<B>> {
    let known = series.moments.iter().any(|moment| moment.true_slip.is_some());
    let rows: [(&str, RGBColor, Says); 3] = [
        ("SR slips", DETECTOR, |moment| moment.slip),
        ("Coulomb", BASELINE, |moment| moment.coulomb_slip),
        (if known { "truth" } else { "truth: ?" }, SLIP, |moment| {
            moment.true_slip == Some(true)
        }),
    ];
    let mut chart = ChartBuilder::on(area)
        .margin_top(8)
        .margin_right(RIGHT)
        .x_label_area_size(34)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(time(series), 0.0..3.0)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .axis_style(FAINT)
        .y_labels(0)
        .x_labels(12)
        .x_label_formatter(&|t_s| format!("{t_s:.0}"))
        .x_desc("s")
        .axis_desc_style(label(13))
        .label_style(label(13))
        .draw()?;
    let start = time(series).start;
    for (row, (name, colour, says)) in rows.into_iter().enumerate() {
        let (low, high) = (2.12 - row as f64, 2.88 - row as f64);
        let spans = series.spans(says);
        chart.draw_series(
            spans
                .into_iter()
                .map(|(from, to)| Rectangle::new([(from, low), (to, high)], colour.filled())),
        )?;
        chart.draw_series([
            EmptyElement::at((start, high)) + Text::new(name, (-(LEFT as i32) + 6, 2), label(13))
        ])?;
    }
    Ok(())
}

fn draw_forces<B: DrawingBackend>(area: &DrawingArea<B, Shift>, series: &Series) -> Result<(), Error<B>> {
    let most = series
        .moments
        .iter()
        .map(|moment| moment.normal_n.max(moment.shear_n).max(moment.line_n))
        .fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .margin_top(30)
        .margin_right(RIGHT)
        .x_label_area_size(30)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(time(series), 0.0..1.05 * most)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(WHITE)
        .bold_line_style(FAINT)
        .axis_style(INK)
        .y_labels(6)
        .x_labels(12)
        .x_label_formatter(&|t_s| format!("{t_s:.0}"))
        .y_label_formatter(&|force| format!("{force:.0}"))
        .y_desc("N")
        .axis_desc_style(label(15))
        .label_style(label(13))
        .draw()?;
    trace(&mut chart, series, |moment| Some(moment.normal_n), DETECTOR, 2)?;
    trace(&mut chart, series, |moment| Some(moment.shear_n), BASELINE, 2)?;
    trace(&mut chart, series, |moment| Some(moment.line_n), LINE, 2)?;
    let entries = [
        ("normal force", DETECTOR),
        ("shear force", BASELINE),
        ("grip-force line", LINE),
    ];
    legend(area, &entries)
}

/// The maps side by side, with one scale.
fn draw_maps<B: DrawingBackend>(area: &DrawingArea<B, Shift>, series: &Series) -> Result<(), Error<B>> {
    let peak = |map: &[[f32; 3]; 400]| map.iter().map(|force| force[2]).fold(0.0, f32::max);
    let full_n = series
        .panels
        .iter()
        .map(|panel| peak(&panel.map))
        .fold(0.02, f32::max);
    if series.panels.is_empty() {
        return area.draw(&Text::new("nothing touched", (LEFT as i32, 20), label(14)));
    }
    let count = series.panels.len().max(4);
    for ((panel, name), area) in series.panels.iter().zip('a'..).zip(area.split_evenly((1, count))) {
        draw_map(&area, series, panel, name, full_n)?;
    }
    let (_, height) = area.dim_in_pixel();
    let text = format!(
        "blue: sticks, red: slips (f_T > {:.2} f_z); darkest: {full_n:.2} N a taxel; arrows: shear",
        series.friction
    );
    area.draw(&Text::new(text, (LEFT as i32, height as i32 - 20), label(13)))
}

fn draw_map<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    series: &Series,
    panel: &Panel,
    name: char,
    full_n: f32,
) -> Result<(), Error<B>> {
    let (width, height) = area.dim_in_pixel();
    let cell = ((width as i32 - 20).min(height as i32 - 60) / 20).max(1);
    let (left, above) = ((width as i32 - 20 * cell) / 2, 26);
    let moment = &series.moments[panel.moment];
    let ratio = moment
        .stick_ratio
        .map_or("–".to_owned(), |ratio| format!("{ratio:.2}"));
    area.draw(&Text::new(
        format!(
            "{name}  {:.2} s  SR {ratio}  {:.1} N",
            moment.t_s, moment.normal_n
        ),
        (left, 6),
        label(14),
    ))?;
    let corner = |taxel: usize| {
        // Row 0 is the lowest.
        let (column, row) = ((taxel % 20) as i32, 19 - (taxel / 20) as i32);
        (left + column * cell, above + row * cell)
    };
    let touches = |force: &[f32; 3]| f64::from(force[2]) > series.contact_min_n;
    for (taxel, force) in panel.map.iter().enumerate().filter(|(_, force)| touches(force)) {
        let sticks = f64::from(force[0].hypot(force[1])) <= series.friction * f64::from(force[2]);
        let full = if sticks { STICKS } else { SLIPS };
        let share = 0.15 + 0.85 * f64::from((force[2] / full_n).min(1.0));
        let (x, y) = corner(taxel);
        area.draw(&Rectangle::new(
            [(x, y), (x + cell, y + cell)],
            full.mix(share).filled(),
        ))?;
    }
    // Every second taxel, so that the arrows can be told apart; the longest is as long as two taxels.
    let longest = panel
        .map
        .iter()
        .map(|force| force[0].hypot(force[1]))
        .fold(1e-3, f32::max);
    let scale = 2.0 * cell as f32 / longest;
    for (taxel, force) in panel.map.iter().enumerate().filter(|(_, force)| touches(force)) {
        if (taxel % 20 + taxel / 20) % 2 == 0 {
            let (x, y) = corner(taxel);
            let (x, y) = (x + cell / 2, y + cell / 2);
            let tip = (x + (force[0] * scale) as i32, y - (force[1] * scale) as i32);
            area.draw(&PathElement::new(vec![(x, y), tip], INK.stroke_width(1)))?;
            area.draw(&Circle::new(tip, 1, INK.filled()))?;
        }
    }
    let frame = [(left, above), (left + 20 * cell, above + 20 * cell)];
    area.draw(&Rectangle::new(frame, FAINT.stroke_width(1)))
}
