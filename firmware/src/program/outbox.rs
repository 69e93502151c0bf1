//! Messages to send: only the newest of each kind, because the host always wants the present state.

use gripline_protocol::message::Refusal;

/// A message that is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Due {
    Hello,
    Refused(Refusal),
    Configuration,
    Stored { writes: u32 },
    Status,
}

/// The messages that are due.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    pub(super) hello: bool,
    pub(super) refusal: Option<Refusal>,
    pub(super) configuration: bool,
    pub(super) stored: Option<u32>,
    pub(super) status: bool,
}

impl Outbox {
    pub(super) const fn is_empty(&self) -> bool {
        !(self.hello || self.status || self.configuration) && self.stored.is_none() && self.refusal.is_none()
    }

    /// Removes the most urgent one.
    pub(super) fn next(&mut self) -> Option<Due> {
        use core::mem::take;
        if take(&mut self.hello) {
            Some(Due::Hello)
        } else if let Some(refusal) = self.refusal.take() {
            Some(Due::Refused(refusal))
        } else if take(&mut self.configuration) {
            Some(Due::Configuration)
        } else if let Some(writes) = self.stored.take() {
            Some(Due::Stored { writes })
        } else if take(&mut self.status) {
            Some(Due::Status)
        } else {
            None
        }
    }
}
