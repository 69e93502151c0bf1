//! How far a long evaluation is, on standard error: a bar on a terminal, a line every tenth elsewhere.

use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicUsize, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

/// Counts what is done, from any thread.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    what: &'static str,
    total: usize,
    done: AtomicUsize,
}

impl Progress {
    /// Nothing done yet of `total`, counted in `what`.
    pub(super) fn new(what: &'static str, total: usize) -> Self {
        let bar = io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:40} {pos} of {len} {msg}, {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(total as u64)
                .with_style(style)
                .with_message(what)
        });
        Self {
            bar,
            what,
            total,
            done: AtomicUsize::new(0),
        }
    }

    /// One more is done.
    pub(super) fn step(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        match &self.bar {
            Some(bar) => bar.inc(1),
            None if (done - 1) * 10 / self.total != done * 10 / self.total => {
                tracing::info!("{done} of {} {}", self.total, self.what);
            }
            None => {}
        }
    }

    /// All is done.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
