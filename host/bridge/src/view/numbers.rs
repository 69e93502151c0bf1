//! The numbers of the newest frame, the latencies of the last seconds, and what the keys do.

use std::fmt::Write;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};

use super::colour::{DIM, EVIDENCE, SLIP, TEXT};
use super::history::{History, Quantiles};
use gripline_recording::telemetry::{FrameReport, STAGES};

/// Lines of the numbers.
pub(super) const LINES: u16 = 5;
/// Lines of the latencies.
pub(super) const LATENCY_LINES: u16 = 3;
/// Columns of the latency table's row names.
const ROW_NAME_COLUMNS: usize = 9;
/// Least columns of a latency: 99,999 µs.
const LATENCY_COLUMNS: usize = 5;

/// Forces, counts, gate, evidence of slip with its witnesses, and the scene or what happened last.
pub(super) fn draw(report: &FrameReport, note: &str, area: Rect, buffer: &mut Buffer) {
    let ratio = report
        .stick_ratio
        .map_or_else(|| "–".into(), |ratio| format!("{ratio:.3}"));
    let (contact, stick) = (report.contact, report.stick);
    let wire = format!("{} B", report.wire_bytes);
    let mut put = |column: u16, row: u16, name: &str, value: &str| {
        write_value(buffer, area, (column, row), (name, value));
    };
    put(0, 0, "F_N", &format!("{:>5.2} N", report.normal_n));
    put(12, 0, "F_T", &format!("{:>5.2} N", report.shear_n));
    put(24, 0, "M_z", &format!("{:>5.1} Nmm", report.moment_nmm));
    put(0, 1, "contact", &format!("{contact:>3}"));
    put(12, 1, "stick", &format!("{stick:>3}"));
    put(24, 1, "ratio", &ratio);
    put(0, 2, "gate", &report.gate.replace('_', " "));
    put(24, 2, "wire", &wire);
    draw_evidence(report, area, buffer);
    let mut put = |column: u16, row: u16, name: &str, value: &str| {
        write_value(buffer, area, (column, row), (name, value));
    };
    let Some(truth) = &report.truth else {
        buffer.set_stringn(area.x, area.y + 4, note, area.width.into(), TEXT);
        return;
    };
    put(0, 4, "scene", &truth.phase);
    put(16, 4, "slid", &format!("{:.2} mm", truth.slip_mm));
    if truth.gross_slip {
        let style = Style::new().fg(SLIP).add_modifier(Modifier::BOLD);
        buffer.set_stringn(area.right().saturating_sub(7), area.y + 4, "SLIDING", 7, style);
    }
}

/// All witnesses together, and what each says by itself, percent.
fn draw_evidence(report: &FrameReport, area: Rect, buffer: &mut Buffer) {
    let witnesses = &report.witnesses;
    let values = [
        ("slip %", report.slip_evidence, EVIDENCE),
        ("SR", witnesses.stick_ratio, TEXT),
        ("unrest", witnesses.unrest, TEXT),
        ("grip", witnesses.shear_follows, TEXT),
        ("seen", witnesses.motion, TEXT),
    ];
    let spans = values.into_iter().flat_map(|(name, share, colour)| {
        [
            Span::styled(format!("{name} "), DIM),
            Span::styled(format!("{:.0} ", 100.0 * share), colour),
        ]
    });
    buffer.set_line(area.x, area.y + 3, &spans.collect(), area.width);
}

/// A name and its value at a column and a row.
fn write_value(buffer: &mut Buffer, area: Rect, (column, row): (u16, u16), (name, value): (&str, &str)) {
    let line = Line::from(vec![
        Span::styled(format!("{name} "), DIM),
        Span::styled(value.to_owned(), TEXT),
    ]);
    let x = area.x + column;
    buffer.set_line(x, area.y + row, &line, area.right().saturating_sub(x));
}

/// Median and p99 of every stage and of the whole way, at the left; frame, rate and keys at the right.
pub(super) fn draw_footer(report: &FrameReport, history: &History, area: Rect, buffer: &mut Buffer) {
    let mut rows = ["latency", "median µs", "p99 µs"].map(|name| format!("{name:<ROW_NAME_COLUMNS$}"));
    for (column, latency) in history.latencies().into_iter().enumerate() {
        let name = STAGES.get(column).copied().unwrap_or("total");
        let width = name.len().max(LATENCY_COLUMNS);
        let us = |pick: fn(Quantiles) -> f64| {
            latency.map_or_else(|| "–".into(), |quantiles| format!("{:.0}", pick(quantiles)))
        };
        let cells = [name.into(), us(|both| both.median_us), us(|both| both.p99_us)];
        for (row, cell) in rows.iter_mut().zip(cells) {
            // Writing to a string cannot fail.
            let _ = write!(row, "{cell:>width$}  ");
        }
    }
    let rate = history
        .frames_per_s()
        .map_or_else(|| "–".into(), |rate| format!("{rate:.1}"));
    let keys = if report.faults.is_empty() {
        "q or Esc quits"
    } else {
        "a ack, q quits"
    };
    let status = [
        (format!("frame {}", report.frame), DIM),
        (format!("{rate} frames/s"), TEXT),
        (keys.into(), DIM),
    ];
    let colours = [DIM, TEXT, TEXT];
    for (y, ((row, colour), (right, right_colour))) in
        (area.y..area.bottom()).zip(rows.iter().zip(colours).zip(status))
    {
        buffer.set_stringn(area.x, y, row, area.width.into(), colour);
        let width = (right.chars().count() as u16).min(area.width);
        buffer.set_stringn(area.right() - width, y, right, width.into(), right_colour);
    }
}
