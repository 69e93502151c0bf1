//! Traces over the last seconds: stick ratio with its threshold and the evidence of slip, grip-force line with the object's normal force.
//!
//! Time runs to the right, now is the right edge. A trace has a gap where its quantity does not exist.

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{self, Canvas, Context};

use super::colour::{DETECTOR, DIM, EVIDENCE, GRIP_LIMIT, GRIP_LINE, GROUND, OBJECT, TEXT, THRESHOLD, WORLD};
use super::history::{History, SPAN_S, Sample, round_up};
use gripline_recording::telemetry::{FrameReport, Limits};

/// Columns for the scale at the left of a plot.
const SCALE_COLUMNS: u16 = 4;
/// The force axis reaches at least this far.
const FORCE_AXIS_MIN_N: f64 = 5.0;

/// Stick ratio by the detector, by the simulated world where it is known, and the threshold; all witnesses' evidence of slip.
pub(super) fn draw_stick_ratio(history: &History, limits: &Limits, area: Rect, buffer: &mut Buffer) {
    let [title, plot] = Layout::vertical([Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    let mut spans = vec![heading("stick ratio"), key("MCU", DETECTOR)];
    if history.samples().any(|sample| sample.true_stick_ratio.is_some()) {
        spans.push(key("world", WORLD));
    }
    spans.push(key("evidence", EVIDENCE));
    spans.push(key("slip", THRESHOLD));
    buffer.set_line(title.x, title.y, &Line::from(spans), title.width);
    let traces: [Trace<'_>; 3] = [
        (WORLD, &|sample| sample.true_stick_ratio),
        (EVIDENCE, &|sample| sample.slip_evidence),
        (DETECTOR, &|sample| sample.stick_ratio),
    ];
    draw_plot(
        history,
        1.0,
        &[(limits.slip_threshold, THRESHOLD)],
        &traces,
        plot,
        buffer,
    );
}

/// The grip-force line between its limits, with the normal force that the skin feels.
pub(super) fn draw_grip(
    report: &FrameReport,
    history: &History,
    limits: &Limits,
    area: Rect,
    buffer: &mut Buffer,
) {
    let [title, gauge, plot] =
        Layout::vertical([Constraint::Length(1), Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    let spans = vec![
        heading("grip"),
        key(&format!("line {:.2} N", report.line_n), GRIP_LINE),
        key(&format!("object {:.2} N", report.normal_n), OBJECT),
    ];
    buffer.set_line(title.x, title.y, &Line::from(spans), title.width);
    draw_gauge(report, limits, gauge, buffer);
    let top_n = round_up(
        history.greatest(|sample| sample.line_n.max(sample.normal_n)),
        limits.floor_n.max(FORCE_AXIS_MIN_N),
    );
    let traces: [Trace<'_>; 2] = [
        (OBJECT, &|sample| Some(sample.normal_n)),
        (GRIP_LINE, &|sample| Some(sample.line_n)),
    ];
    let marks = [(limits.floor_n, GRIP_LIMIT), (limits.ceiling_n, GRIP_LIMIT)];
    draw_plot(history, top_n, &marks, &traces, plot, buffer);
}

/// Where the line (●) and the object's normal force (◆) stand between floor and ceiling.
fn draw_gauge(report: &FrameReport, limits: &Limits, area: Rect, buffer: &mut Buffer) {
    let tenths = |force_n: f64| (force_n * 10.0).round() / 10.0;
    let floor = format!("{} ", tenths(limits.floor_n));
    let ceiling = format!(" {} N", tenths(limits.ceiling_n));
    let width = usize::from(area.width)
        .saturating_sub(floor.len() + ceiling.len())
        .max(1);
    let place = |force_n: f64| {
        let share = (force_n - limits.floor_n) / (limits.ceiling_n - limits.floor_n);
        (share.clamp(0.0, 1.0) * (width - 1) as f64).round() as usize
    };
    let (line, object) = (place(report.line_n), place(report.normal_n));
    let mut spans = vec![Span::styled(floor, DIM)];
    spans.extend((0..width).map(|column| {
        if column == line {
            Span::styled("●", GRIP_LINE)
        } else if column == object {
            Span::styled("◆", OBJECT)
        } else if column < line {
            Span::styled("━", GRIP_LINE)
        } else {
            Span::styled("─", GRIP_LIMIT)
        }
    }));
    spans.push(Span::styled(ceiling, DIM));
    buffer.set_line(area.x, area.y, &Line::from(spans), area.width);
}

type Trace<'a> = (Color, &'a dyn Fn(&Sample) -> Option<f64>);

/// Traces over [0, top] and the history's span; later traces lie above earlier ones, all above the marks.
fn draw_plot(
    history: &History,
    top: f64,
    marks: &[(f64, Color)],
    traces: &[Trace<'_>],
    area: Rect,
    buffer: &mut Buffer,
) {
    let [scale, plot] =
        Layout::horizontal([Constraint::Length(SCALE_COLUMNS), Constraint::Fill(1)]).areas(area);
    let digits = usize::from(top < 10.0);
    buffer.set_string(scale.x, scale.y, format!("{top:>3.digits$}"), DIM);
    buffer.set_string(
        scale.x,
        scale.bottom().saturating_sub(1),
        format!("{:>3}", 0),
        DIM,
    );
    let (from_s, to_s) = (history.now_s() - SPAN_S, history.now_s());
    let paint = |context: &mut Context<'_>| {
        for &(value, colour) in marks.iter().filter(|(value, _)| *value <= top) {
            context.draw(&canvas::Line::new(from_s, value, to_s, value, colour));
        }
        for (colour, value) in traces {
            let mut before: Option<(f64, f64)> = None;
            for sample in history.samples() {
                let now = value(sample)
                    .filter(|value| value.is_finite())
                    .map(|value| (sample.t_s, value.clamp(0.0, top)));
                if let Some((t_s, value)) = now {
                    let (t_before_s, value_before) = before.unwrap_or((t_s, value));
                    context.draw(&canvas::Line::new(t_before_s, value_before, t_s, value, *colour));
                }
                before = now;
            }
        }
    };
    Canvas::default()
        .marker(Marker::Braille)
        .background_color(GROUND)
        .x_bounds([from_s, to_s])
        .y_bounds([0.0, top])
        .paint(paint)
        .render(plot, buffer);
}

fn heading(text: &'static str) -> Span<'static> {
    Span::styled(text, Style::new().fg(TEXT).add_modifier(Modifier::BOLD))
}

/// A trace's name in its colour.
fn key(text: &str, colour: Color) -> Span<'static> {
    Span::styled(format!("  {text}"), colour)
}
