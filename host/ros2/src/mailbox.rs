//! A place for the newest frame of each fingertip. The writer never waits; the reader waits for the next frame.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use gripline_protocol::SENSORS;
use gripline_recording::ros2::Sample;

/// What waits for the publisher.
#[derive(Default)]
struct Waiting {
    newest: [Option<Sample>; SENSORS],
    is_over: bool,
}

/// A place of one for each fingertip.
#[derive(Default)]
pub(crate) struct Mailbox {
    waiting: Mutex<Waiting>,
    news: Condvar,
}

impl Mailbox {
    /// Leaves a frame, in place of an older one of the same fingertip. Where the publisher is looking just now it is lost: the
    /// next one comes in a moment.
    pub(crate) fn leave(&self, sample: Sample) {
        let Ok(mut waiting) = self.waiting.try_lock() else {
            return;
        };
        let place = sample.report.sensor.index();
        let older = waiting.newest[place].replace(sample);
        drop(waiting);
        self.news.notify_one();
        drop(older);
    }

    /// Waits for news, but not longer than this: the newest frame of each fingertip of which there is a new one; `None` when there
    /// will be no more.
    pub(crate) fn take(&self, patience: Duration) -> Option<[Option<Sample>; SENSORS]> {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let nothing = |waiting: &mut Waiting| !waiting.is_over && waiting.newest.iter().all(Option::is_none);
        let (mut waiting, _) = self
            .news
            .wait_timeout_while(waiting, patience, nothing)
            .unwrap_or_else(PoisonError::into_inner);
        (!waiting.is_over).then(|| std::mem::take(&mut waiting.newest))
    }

    /// There will be no more.
    pub(crate) fn close(&self) {
        self.waiting
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_over = true;
        self.news.notify_one();
    }
}
