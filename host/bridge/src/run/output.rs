//! The output of a run: JSON lines, the live view, or one plain line per second.

use std::fmt;
use std::io::{self, ErrorKind, IsTerminal, Write};

use super::summary::{Summary, summary_text};
use crate::error::Error;
use crate::view::{Key, Screen, View};
use crate::writer::{WhenFull, Writer};
use gripline_recording::telemetry::{FrameReport, Limits};

/// Input of the person at the terminal.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum UserInput {
    Nothing,
    /// Keys with requests.
    Keys(Vec<Key>),
    Stop,
}

/// Lines that wait for a slow reader: eight seconds of pictures at 60 a second.
const LINES_WAITING: usize = 512;
/// Frames that wait for a slow terminal.
const FRAMES_WAITING: usize = 8;

/// The output. A separate thread writes it.
pub(super) enum Output {
    Json(Writer<Vec<u8>>),
    Live(Writer<Shown>),
    Lines {
        out: Writer<Vec<u8>>,
        /// When the next line is due.
        next_s: f64,
    },
}

/// An update of the live view.
pub(super) enum Shown {
    Frame(Box<(FrameReport, [[f32; 3]; 400])>),
    Line(String),
    Limits(Limits),
}

impl Output {
    pub(super) fn open(json: bool, limits: Limits, when_full: WhenFull) -> Result<Self, Error> {
        let lines = || {
            Writer::start(LINES_WAITING, when_full, |line: Vec<u8>| {
                let mut out = io::stdout().lock();
                out.write_all(&line)?;
                out.flush()
            })
        };
        if json {
            return Ok(Self::Json(lines()));
        }
        if io::stdout().is_terminal() {
            let mut screen = Screen::open().map_err(|error| {
                Error::failed(format!("terminal: {error}, expected one to draw on; try --json"))
            })?;
            let mut view = View::new(limits);
            return Ok(Self::Live(Writer::start(
                FRAMES_WAITING,
                when_full,
                move |shown| match shown {
                    Shown::Frame(frame) => {
                        view.push(&frame.0, &frame.1);
                        // Every second frame: terminals gain nothing from more.
                        if frame.0.frame.is_multiple_of(2) {
                            screen.draw(&view)?;
                        }
                        Ok(())
                    }
                    Shown::Limits(limits) => {
                        view.limit(limits);
                        Ok(())
                    }
                    Shown::Line(line) => {
                        view.note(&line);
                        screen.draw(&view)
                    }
                },
            )));
        }
        Ok(Self::Lines {
            out: lines(),
            next_s: 0.0,
        })
    }

    pub(super) fn is_live(&self) -> bool {
        matches!(self, Self::Live(_))
    }

    pub(super) fn frame(&mut self, report: &FrameReport, map: &[[f32; 3]; 400]) -> Result<UserInput, Error> {
        match self {
            Self::Json(out) => {
                let mut line = serde_json::to_vec(report)?;
                line.push(b'\n');
                Ok(wanted(out.offer(line)))
            }
            Self::Live(out) => {
                if !out.offer(Shown::Frame(Box::new((report.clone(), *map)))) {
                    return Ok(UserInput::Stop);
                }
                pressed()
            }
            Self::Lines { out, next_s } if report.t_s >= *next_s => {
                *next_s = report.t_s.floor() + 1.0;
                Ok(wanted(
                    out.offer(format!("{}\n", progress_line(report)).into_bytes()),
                ))
            }
            Self::Lines { .. } => Ok(UserInput::Nothing),
        }
    }

    /// There is no picture now.
    pub(super) fn idle(&mut self) -> Result<UserInput, Error> {
        match self {
            Self::Live(_) => pressed(),
            Self::Json(_) | Self::Lines { .. } => Ok(UserInput::Nothing),
        }
    }

    /// Shows a log line in the view.
    pub(super) fn show_line(&mut self, line: &str) {
        if let Self::Live(out) = self {
            out.offer(Shown::Line(line.to_owned()));
        }
    }

    /// New settings.
    pub(super) fn limits(&mut self, limits: Limits) {
        if let Self::Live(out) = self {
            out.offer(Shown::Limits(limits));
        }
    }

    /// Lines or pictures of the view that were left out because their reader was too slow.
    pub(super) const fn dropped(&self) -> u64 {
        match self {
            Self::Json(out) | Self::Lines { out, .. } => out.dropped(),
            Self::Live(out) => out.dropped(),
        }
    }

    pub(super) fn close(self, summary: &Summary) -> Result<(), Error> {
        let text = || format!("{}\n", summary_text(summary)).into_bytes();
        match self {
            Self::Json(out) => {
                let mut line = serde_json::to_vec(summary)?;
                line.push(b'\n');
                // A reader that is late still gets the summary, if it reads on.
                out.wait_once(line);
                still_wanted(out.finish())
            }
            Self::Live(out) => match out.finish() {
                Ok(()) => still_wanted(io::stdout().write_all(&text())),
                Err(error) => {
                    Screen::abandon();
                    Err(terminal_failed(error))
                }
            },
            Self::Lines { out, .. } => {
                out.wait_once(text());
                still_wanted(out.finish())
            }
        }
    }
}

const fn wanted(is_wanted: bool) -> UserInput {
    if is_wanted {
        UserInput::Nothing
    } else {
        UserInput::Stop
    }
}

/// The pressed keys: read here, so that a terminal that accepts no output can still stop the run.
fn pressed() -> Result<UserInput, Error> {
    let keys = Screen::pressed().map_err(terminal_failed)?;
    Ok(if keys.contains(&Key::Quit) {
        UserInput::Stop
    } else if keys.is_empty() {
        UserInput::Nothing
    } else {
        UserInput::Keys(keys)
    })
}

/// A closed reader (`| head`) is not a failure.
fn still_wanted(written: io::Result<()>) -> Result<(), Error> {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Error::failed(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

fn terminal_failed(error: impl fmt::Display) -> Error {
    Error::failed(format!("terminal: {error}"))
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
