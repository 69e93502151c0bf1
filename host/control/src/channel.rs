//! How requests reach the loop and answers come back: a queue that the loop reads between its frames, and a place for the newest status.
//! A client waits for its answer; the loop never waits.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::answer::{Answer, Outcome, Why};
use crate::request::Request;
use crate::status::StatusReport;

/// Requests that wait for the loop.
const WAITING: usize = 32;
/// How long an answer may take: the arbiter's maximum, and a second for a delayed loop.
const PATIENCE: Duration = Duration::from_secs(4);

/// A request that waits for its answer.
#[derive(Debug)]
pub struct Asked {
    /// What was asked.
    pub request: Request,
    /// When.
    pub at: Instant,
    reply: SyncSender<Answer>,
}

impl Asked {
    /// Delivers the answer. A client that no longer waits misses it.
    pub fn answer(&self, answer: Answer) {
        let _ = self.reply.try_send(answer);
    }
}

/// Both ends.
#[must_use]
pub fn channel() -> (Handle, Inbox) {
    let (sender, receiver) = sync_channel(WAITING);
    let status = Arc::default();
    let inbox = Inbox {
        receiver,
        status: Arc::clone(&status),
    };
    (Handle { sender, status }, inbox)
}

/// The clients' end; it can be cloned.
#[derive(Debug, Clone)]
pub struct Handle {
    sender: SyncSender<Asked>,
    status: Arc<Mutex<StatusReport>>,
}

impl Handle {
    /// Sends a request and waits for the answer, at most four seconds.
    #[must_use]
    pub fn ask(&self, request: &Request) -> Answer {
        let at = Instant::now();
        let (reply, answer) = sync_channel(1);
        let asked = Asked {
            request: request.clone(),
            at,
            reply,
        };
        let why = match self.sender.try_send(asked) {
            Ok(()) => match answer.recv_timeout(PATIENCE) {
                Ok(answer) => return answer,
                Err(RecvTimeoutError::Timeout) => {
                    Why::NotConfirmed("no answer of the control loop".to_owned())
                }
                Err(RecvTimeoutError::Disconnected) => Why::Ended,
            },
            Err(TrySendError::Full(_)) => Why::Busy,
            Err(TrySendError::Disconnected(_)) => Why::Ended,
        };
        let took_ms = at.elapsed().as_secs_f64() * 1e3;
        Answer::to(
            request,
            Outcome::Refused(why),
            self.status().owner.as_ref(),
            took_ms,
        )
    }

    /// Sends a request without waiting for the answer, which is logged.
    pub fn tell(&self, request: &Request) {
        let (reply, _) = sync_channel(1);
        let _ = self.sender.try_send(Asked {
            request: request.clone(),
            at: Instant::now(),
            reply,
        });
    }

    /// The newest status.
    #[must_use]
    pub fn status(&self) -> StatusReport {
        self.status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The loop's end.
#[derive(Debug)]
pub struct Inbox {
    receiver: Receiver<Asked>,
    status: Arc<Mutex<StatusReport>>,
}

impl Inbox {
    /// The next request, if one waits.
    #[must_use]
    pub fn next(&self) -> Option<Asked> {
        self.receiver.try_recv().ok()
    }

    /// The next request; waits until then at most.
    #[must_use]
    pub fn next_until(&self, until: Instant) -> Option<Asked> {
        let patience = until.saturating_duration_since(Instant::now());
        match self.receiver.recv_timeout(patience) {
            Ok(asked) => Some(asked),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(until.saturating_duration_since(Instant::now()));
                None
            }
        }
    }

    /// Publishes the newest status, unless a client is reading at this moment.
    pub fn publish(&self, fill: impl FnOnce(&mut StatusReport)) {
        if let Ok(mut status) = self.status.try_lock() {
            fill(&mut status);
        }
    }
}
