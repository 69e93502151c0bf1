//! Where the reports of a run go: JSON lines, the live view, or a plain line a second.

use std::fmt;
use std::io::{self, ErrorKind, IsTerminal, Write};

use super::summary::{Summary, summary_text};
use crate::error::Failure;
use crate::view::{Pressed, Screen, View};
use gripline_recording::telemetry::{FrameReport, Limits};

/// What the person at the terminal wants.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Wish {
    GoOn,
    /// The latched faults are seen.
    Acknowledge,
    Stop,
}

/// Where the reports go.
pub(super) enum Output {
    Json(io::BufWriter<io::Stdout>),
    Live {
        screen: Box<Screen>,
        view: Box<View>,
    },
    Lines {
        /// When the next line is due.
        next_s: f64,
    },
}

impl Output {
    pub(super) fn open(json: bool, limits: Limits) -> Result<Self, Failure> {
        if json {
            return Ok(Self::Json(io::BufWriter::new(io::stdout())));
        }
        if io::stdout().is_terminal() {
            let screen = Screen::open().map_err(|error| {
                Failure::failed(format!("terminal: {error}, expected one to draw on; try --json"))
            })?;
            return Ok(Self::Live {
                screen: Box::new(screen),
                view: Box::new(View::new(limits)),
            });
        }
        Ok(Self::Lines { next_s: 0.0 })
    }

    pub(super) fn is_live(&self) -> bool {
        matches!(self, Self::Live { .. })
    }

    pub(super) fn frame(&mut self, report: &FrameReport, map: &[[f32; 3]; 400]) -> Result<Wish, Failure> {
        match self {
            Self::Json(out) => {
                let written = serde_json::to_writer(&mut *out, report)
                    .map_err(io::Error::from)
                    .and_then(|()| writeln!(out))
                    .and_then(|()| out.flush());
                still_wanted(written)
            }
            Self::Live { screen, view } => {
                view.push(report, map);
                // Every second frame: terminals gain nothing from more.
                if report.frame.is_multiple_of(2) {
                    screen.draw(view).map_err(terminal_failed)?;
                }
                wish_of(screen)
            }
            Self::Lines { next_s } if report.t_s >= *next_s => {
                *next_s = report.t_s.floor() + 1.0;
                still_wanted(writeln!(io::stdout(), "{}", progress_line(report)))
            }
            Self::Lines { .. } => Ok(Wish::GoOn),
        }
    }

    /// There is no picture now.
    pub(super) fn idle(&mut self) -> Result<Wish, Failure> {
        match self {
            Self::Live { screen, .. } => wish_of(screen),
            Self::Json(_) | Self::Lines { .. } => Ok(Wish::GoOn),
        }
    }

    /// Shows a log line where standard error cannot.
    pub(super) fn show_line(&mut self, line: &str) -> Result<(), Failure> {
        match self {
            Self::Live { screen, view } => {
                view.note(line);
                screen.draw(view).map_err(terminal_failed)
            }
            Self::Json(_) | Self::Lines { .. } => Ok(()),
        }
    }

    pub(super) fn close(self, summary: &Summary) -> Result<(), Failure> {
        let written = match self {
            Self::Json(mut out) => serde_json::to_writer(&mut out, summary)
                .map_err(io::Error::from)
                .and_then(|()| writeln!(out))
                .and_then(|()| out.flush()),
            Self::Live { screen, .. } => {
                drop(screen);
                writeln!(io::stdout(), "{}", summary_text(summary))
            }
            Self::Lines { .. } => writeln!(io::stdout(), "{}", summary_text(summary)),
        };
        still_wanted(written).map(|_| ())
    }
}

fn wish_of(screen: &mut Screen) -> Result<Wish, Failure> {
    Ok(match screen.pressed().map_err(terminal_failed)? {
        Pressed::Nothing => Wish::GoOn,
        Pressed::Acknowledge => Wish::Acknowledge,
        Pressed::Quit => Wish::Stop,
    })
}

/// A reader that went away (`| head`) is no failure.
fn still_wanted(written: io::Result<()>) -> Result<Wish, Failure> {
    match written {
        Ok(()) => Ok(Wish::GoOn),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(Wish::Stop),
        Err(error) => Err(Failure::failed(format!("standard output: {error}"))),
    }
}

fn terminal_failed(error: impl fmt::Display) -> Failure {
    Failure::failed(format!("terminal: {error}"))
}

fn progress_line(report: &FrameReport) -> String {
    let ratio = report
        .stick_ratio
        .map_or_else(|| "  - ".to_owned(), |ratio| format!("{ratio:4.2}"));
    let truth = report.truth.as_ref().map_or_else(String::new, |truth| {
        format!("  [{}, slid {:.2} mm]", truth.phase, truth.slip_mm)
    });
    format!(
        "{:6.1} s  {:10}  stick ratio {ratio}  F_N {:5.2} N  F_T {:5.2} N  M_z {:6.1} Nmm  line {:5.2} N  {:4.0} µs{truth}",
        report.t_s,
        report.state,
        report.normal_n,
        report.shear_n,
        report.moment_nmm,
        report.line_n,
        report.latency_us
    )
}
