//! The live view of a run: skin, slip state, stick ratio, grip-force line, latencies.
//!
//! [`View`] takes reports and draws them, without a clock, without IO and on any screen size; [`Screen`] is the
//! terminal. Forces in newtons, times in the pictures' seconds. The smallest screen with a picture is 80 x 24.

mod banner;
mod colour;
mod heat_map;
mod history;
mod numbers;
mod screen;
#[cfg(test)]
pub(crate) mod tests;
mod traces;

use gripline_protocol::SENSORS;
use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::widgets::{Paragraph, Widget, Wrap};

pub use screen::{Key, Screen};

use self::heat_map::HeatMap;
use self::history::History;
use gripline_recording::telemetry::{FrameReport, Limits};

/// Least size of the screen.
const COLUMNS: u16 = 80;
/// Least size of the screen.
const LINES: u16 = 24;
/// The heat map's colours reach at least this far, so that noise on an empty skin stays dark; N per taxel.
const FULL_SCALE_MIN_N: f64 = 0.05;
/// A fingertip whose newest frame is older than this beside the other's is silent.
const SILENT_S: f64 = 0.25;

/// The last seconds of a run, ready to be drawn.
#[derive(Debug)]
pub struct View {
    limits: Limits,
    history: History,
    /// Of each fingertip.
    newest: [Option<Seen>; SENSORS],
    note: String,
}

/// A frame: its report and its map.
type Seen = (FrameReport, Box<[[f32; 3]; 400]>);

impl View {
    /// A view that has seen nothing yet.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            history: History::default(),
            newest: [None, None],
            note: String::new(),
        }
    }

    /// The settings are others from now on.
    pub const fn limit(&mut self, limits: Limits) {
        self.limits = limits;
    }

    /// Takes one frame: its report and the map that was sent, newtons, 400 taxels row-major, `[fx, fy, fz]`.
    pub fn push(&mut self, report: &FrameReport, map: &[[f32; 3]; 400]) {
        let sensor = report.sensor.index();
        self.newest[sensor] = Some((report.clone(), Box::new(*map)));
        if let Some((shown, map)) = self.shown() {
            let peak_n = map.iter().map(|&[.., fz]| fz).fold(0.0, f32::max);
            // The traces are those of the worse fingertip, the times those of every frame.
            let sample = FrameReport {
                t_s: report.t_s,
                latency_us: report.latency_us,
                stages_us: report.stages_us,
                ..shown.clone()
            };
            self.history.push(&sample, peak_n);
        }
    }

    /// The frame that is drawn: of two fingertips that of the one which sticks less, as the microcontroller goes by it.
    fn shown(&self) -> Option<&Seen> {
        let now_s = self.newest.iter().flatten().map(|(report, _)| report.t_s);
        let now_s = now_s.fold(f64::NEG_INFINITY, f64::max);
        let ratio = |seen: &Seen| seen.0.stick_ratio.unwrap_or(f64::INFINITY);
        self.newest
            .iter()
            .flatten()
            .filter(|(report, _)| now_s - report.t_s <= SILENT_S)
            .min_by(|one, other| ratio(one).total_cmp(&ratio(other)))
    }

    /// Which of two fingertips is drawn; nothing to say of one.
    fn mark(&self, shown: &FrameReport) -> String {
        let [Some(first), Some(second)] = &self.newest else {
            return String::new();
        };
        let apart_s = (first.0.t_s - second.0.t_s).abs();
        let silent = if apart_s > SILENT_S { ", other silent" } else { "" };
        format!("fingertip {} of 2{silent}", shown.sensor.number() + 1)
    }

    /// Takes a line of what happened beside the frames; it stays until the next one.
    pub fn note(&mut self, news: &str) {
        news.clone_into(&mut self.note);
    }

    /// Draws the newest frame and the traces that lead to it.
    pub fn draw(&self, frame: &mut Frame<'_>) {
        let area = frame.area();
        self.draw_into(area, frame.buffer_mut());
    }

    /// The same as cells, without a terminal.
    pub(crate) fn cells(&self, columns: u16, lines: u16) -> Buffer {
        let area = Rect::new(0, 0, columns, lines);
        let mut buffer = Buffer::empty(area);
        self.draw_into(area, &mut buffer);
        buffer
    }

    fn draw_into(&self, area: Rect, buffer: &mut Buffer) {
        buffer.set_style(area, Style::new().fg(colour::TEXT).bg(colour::GROUND));
        if area.width < COLUMNS || area.height < LINES {
            let text = format!("terminal too small, need {COLUMNS}x{LINES}");
            Paragraph::new(text)
                .wrap(Wrap { trim: true })
                .render(area, buffer);
            return;
        }
        let Some((report, map)) = self.shown() else {
            buffer.set_string(area.x, area.y, "waiting for the first frame", colour::DIM);
            return;
        };
        let [upper, footer] =
            Layout::vertical([Constraint::Fill(1), Constraint::Length(numbers::LATENCY_LINES)]).areas(area);
        // The skin takes what the least width of the right side leaves, in whole taxels.
        let right_columns = COLUMNS - heat_map::COLUMNS;
        let scale = heat_map::scale(upper.width - right_columns, upper.height);
        let skin_columns = heat_map::COLUMNS * scale;
        let [skin, _gap, right] = Layout::horizontal([
            Constraint::Length(skin_columns),
            Constraint::Length(1),
            Constraint::Fill(1),
        ])
        .areas(upper);
        let [banner, stick_ratio, grip, numbers] = Layout::vertical([
            Constraint::Length(banner::LINES),
            Constraint::Fill(7),
            Constraint::Fill(5),
            Constraint::Length(numbers::LINES),
        ])
        .areas(right);

        let heat_map = HeatMap {
            map,
            limits: &self.limits,
            full_scale_n: history::round_up(self.history.greatest(|sample| sample.peak_n), FULL_SCALE_MIN_N),
        };
        heat_map.draw(skin, buffer);
        banner::draw(report, &self.mark(report), banner, buffer);
        traces::draw_stick_ratio(&self.history, &self.limits, stick_ratio, buffer);
        traces::draw_grip(report, &self.history, &self.limits, grip, buffer);
        numbers::draw(report, &self.note, numbers, buffer);
        numbers::draw_footer(report, &self.history, footer, buffer);
    }
}
