//! The thread between the loop and the readers: encodes a frame once for all readers, and reports the gripper's state.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use gripline_control::StatusReport;
use gripline_recording::telemetry::FrameReport;

use crate::event::{self, Details};
use crate::site::Site;

/// Frames that wait for the hub.
const WAITING: usize = 64;
/// How often the status is checked.
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// Interval at which an unchanged status is repeated, so that a page knows that it is still valid.
const REPEAT_EVERY: Duration = Duration::from_millis(500);

/// A frame on its way to the readers.
pub(crate) struct Published {
    pub(crate) report: FrameReport,
    /// It goes to the readers of `/frames`.
    pub(crate) as_line: bool,
    /// It goes to the pages, with these.
    pub(crate) details: Option<Details>,
}

/// The loop's end of the hub; the streams end with it.
pub(crate) struct Hub(SyncSender<Published>);

impl Hub {
    pub(crate) fn start(site: Arc<Site>) -> Self {
        let (sender, frames) = sync_channel(WAITING);
        thread::spawn(move || work(&site, &frames));
        Self(sender)
    }

    /// Queues a frame if there is room; returns whether there was.
    pub(crate) fn offer(&self, published: Published) -> bool {
        !matches!(
            self.0.try_send(published),
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_))
        )
    }
}

fn work(site: &Site, frames: &Receiver<Published>) {
    let mut last_sent = LastSent::default();
    loop {
        match frames.recv_timeout(POLL_PERIOD) {
            Ok(Published {
                report,
                as_line,
                details,
            }) => {
                if as_line && let Ok(line) = serde_json::to_string(&report) {
                    site.lines.send(&(line + "\n").into());
                }
                if let Some(details) = details {
                    site.events.send(&event::frame(&report, &details).into());
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        let now = Instant::now();
        if site.events.is_wanted() && last_sent.is_time_to_poll(now) {
            let status = site.handle.status();
            if last_sent.is_due(&status, now) {
                site.events.send(&event::status(&status).into());
            }
        }
    }
    site.lines.close();
    site.events.close();
}

/// The last status sent to the pages.
#[derive(Default)]
struct LastSent {
    polled: Option<Instant>,
    status: Option<(StatusReport, Instant)>,
}

impl LastSent {
    fn is_time_to_poll(&mut self, now: Instant) -> bool {
        let is_time = self.polled.is_none_or(|polled| now - polled >= POLL_PERIOD);
        if is_time {
            self.polled = Some(now);
        }
        is_time
    }

    /// Whether a status says something new, or the last one was long ago.
    fn is_due(&mut self, status: &StatusReport, now: Instant) -> bool {
        let is_due = self.status.as_ref().is_none_or(|(last_sent, at)| {
            now - *at >= REPEAT_EVERY || without_counters(last_sent) != without_counters(status)
        });
        if is_due {
            self.status = Some((status.clone(), now));
        }
        is_due
    }
}

/// The status without the values that change with every frame.
fn without_counters(status: &StatusReport) -> StatusReport {
    StatusReport {
        frames: 0,
        status_age_ms: 0.0,
        line_n: 0.0,
        state: "",
        ..status.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn news_is_reported_at_once_and_the_rest_twice_a_second() {
        let (mut last_sent, start) = (LastSent::default(), Instant::now());
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut status = StatusReport::default();
        assert!(last_sent.is_due(&status, at(0)));
        status.frames = 9;
        status.status_age_ms = 3.0;
        assert!(!last_sent.is_due(&status, at(100)));
        status.is_connected = true;
        assert!(last_sent.is_due(&status, at(200)));
        assert!(!last_sent.is_due(&status, at(600)));
        assert!(last_sent.is_due(&status, at(700)));
        assert!(
            last_sent.is_time_to_poll(at(0))
                && !last_sent.is_time_to_poll(at(50))
                && last_sent.is_time_to_poll(at(100))
        );
    }
}
