//! Where log lines go: standard error, each as `gripline: …`; while a run collects them, its recording and its view too.
//! The level is that of `--verbose` and `--quiet`, else of the environment variable `GRIPLINE_LOG`.

use std::collections::VecDeque;
use std::fmt::{self, Write as _};
use std::io::{self, Write as _};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::{Context, SubscriberExt as _};

use crate::error::Error;
use crate::writer::{WhenFull, Writer};

/// The environment variable that sets the level.
const VARIABLE: &str = "GRIPLINE_LOG";
/// Lines that wait for a run; older ones are dropped.
const KEPT: usize = 1_000;

/// Sends log lines to standard error from now on. `level` overrides the environment variable.
///
/// # Errors
/// [`Error`] of kind usage when the variable names no level.
pub fn start(level: Option<LevelFilter>) -> Result<(), Error> {
    let level = match (level, std::env::var(VARIABLE)) {
        (Some(level), _) => level,
        (None, Err(_)) => LevelFilter::INFO,
        (None, Ok(text)) => text.parse().map_err(|_| {
            Error::usage(format!(
                "{VARIABLE}: found {text}, expected off, error, warn, info, debug or trace"
            ))
        })?,
    };
    let lines = tracing_subscriber::registry().with(Lines.with_filter(level));
    // A second call, as in tests, changes nothing.
    let _ = tracing::subscriber::set_global_default(lines);
    Ok(())
}

/// Lines that a run has not taken yet.
#[derive(Debug)]
struct Collected {
    lines: VecDeque<String>,
    /// Writes lines to standard error without blocking the logging thread; `None` while the terminal shows the view, which lines
    /// would destroy.
    out: Option<Writer<String>>,
}

static COLLECTED: Mutex<Option<Collected>> = Mutex::new(None);

fn collected() -> MutexGuard<'static, Option<Collected>> {
    // Whole lines are added: nothing in there can be half done.
    COLLECTED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Collects log lines until it is dropped. There is one at a time.
#[derive(Debug)]
pub struct Collector(());

impl Collector {
    /// Collects from now on; a silent one keeps the lines off standard error.
    #[must_use]
    pub fn start(is_silent: bool) -> Self {
        let out = (!is_silent).then(|| {
            Writer::start(KEPT, WhenFull::Drop, |line: String| {
                // Nobody can be told that standard error is gone.
                let _ = writeln!(io::stderr(), "{line}");
                Ok(())
            })
        });
        *collected() = Some(Collected {
            lines: VecDeque::new(),
            out,
        });
        Self(())
    }

    /// The lines since the last call.
    #[must_use]
    pub fn take(&self) -> Vec<String> {
        collected()
            .as_mut()
            .map_or_else(Vec::new, |all| all.lines.drain(..).collect())
    }
}

impl Drop for Collector {
    fn drop(&mut self) {
        let ended = collected().take();
        if let Some(out) = ended.and_then(|all| all.out) {
            let dropped = out.dropped();
            // A standard error that takes nothing cannot be told so.
            if out.finish().is_ok() && dropped > 0 {
                eprintln!("gripline: {dropped} log lines were dropped: standard error was too slow");
            }
        }
    }
}

/// Prints and collects every event.
struct Lines;

impl<S: Subscriber> Layer<S> for Lines {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        // Lines such as "Shutting down" that do not say who.
        let source = if metadata.target().starts_with("foxglove") {
            "Foxglove: "
        } else {
            ""
        };
        let mut line = Line(source.to_owned());
        event.record(&mut line);
        let text = if *metadata.level() > Level::INFO {
            format!(
                "gripline: [{} {}] {}",
                metadata.level(),
                metadata.target(),
                line.0
            )
        } else {
            format!("gripline: {}", line.0)
        };
        let mut collected = collected();
        match &mut *collected {
            // A standard error that is gone (a window that was closed) cannot be told so.
            None => drop(writeln!(io::stderr(), "{text}")),
            Some(all) => {
                if let Some(out) = &mut all.out {
                    out.offer(text);
                }
            }
        }
        if let Some(all) = &mut *collected {
            if all.lines.len() == KEPT {
                all.lines.pop_front();
            }
            all.lines.push_back(line.0);
        }
    }
}

/// The message of an event, followed by its fields.
struct Line(String);

impl Visit for Line {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing into a string cannot fail.
        let _ = match field.name() {
            "message" => write!(self.0, "{value:?}"),
            name => write!(self.0, " {name}={value:?}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_collects_lines_with_their_fields_and_only_the_newest() {
        let lines = tracing_subscriber::registry().with(Lines.with_filter(LevelFilter::INFO));
        tracing::subscriber::with_default(lines, || {
            tracing::info!("before");
            let collector = Collector::start(true);
            tracing::warn!(picture = 7, "damaged {}", "file");
            tracing::debug!("too fine");
            assert_eq!(collector.take(), ["damaged file picture=7"]);
            for number in 0..KEPT + 5 {
                tracing::info!("line {number}");
            }
            let lines = collector.take();
            assert_eq!((lines.len(), lines[0].as_str()), (KEPT, "line 5"));
            assert!(collector.take().is_empty());
        });
        assert!(collected().is_none());
    }
}
