//! The pending requests to a run, and the mode of the gripper that follows from them.

use gripline_control::{Arbiter, Asked, Inbox};
use gripline_pipeline::Acknowledgement;
use gripline_protocol::message::{Configuration, GripMode};

use super::rezero::Rezero;

/// Pending requests.
pub(super) struct Requests {
    pub(super) inbox: Inbox,
    pub(super) arbiter: Arbiter,
    /// The mode that was requested, from then on.
    pub(super) asked: Option<GripMode>,
    /// The mode in the pictures' script, if the script may move the gripper.
    pub(super) script: Option<GripMode>,
    /// What the script said when the microcontroller restarted: it does not count until it changes.
    withdrawn: Option<GripMode>,
    /// Used while neither of both gives a mode.
    pub(super) otherwise: Option<GripMode>,
    pub(super) follows_script: bool,
    pub(super) floor: Option<FloorRequest>,
    pub(super) acknowledging: Option<Acknowledgement>,
    pub(super) rezero: Option<Rezero>,
    /// Fingertips that can take new rest pictures.
    pub(super) fingertips_to_rezero: usize,
    pub(super) has_other_settings: bool,
}

/// Settings with another floor, sent until they are in force.
pub(super) struct FloorRequest {
    pub settings: Configuration,
    pub begun_us: u64,
    pub sent_us: Option<u64>,
}

/// What may move the gripper without a request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unasked {
    /// Hold from the start (`--hold`).
    pub hold: bool,
    /// The pictures' script: that of the simulated scene, or the requests in a recording.
    pub script: bool,
}

impl Unasked {
    /// The script of the pictures, as with files and the simulated world.
    pub(super) const SCRIPT: Self = Self {
        hold: false,
        script: true,
    };
}

impl Requests {
    pub(super) fn new(inbox: Inbox, unasked: Unasked, fingertips_to_rezero: usize) -> Self {
        Self {
            inbox,
            arbiter: Arbiter::new(),
            asked: None,
            script: None,
            withdrawn: None,
            otherwise: unasked.hold.then_some(GripMode::Hold),
            follows_script: unasked.script,
            floor: None,
            acknowledging: None,
            rezero: None,
            fingertips_to_rezero,
            has_other_settings: false,
        }
    }

    /// The pictures' script says this.
    pub(super) fn scripted(&mut self, script: Option<GripMode>) {
        if script != self.withdrawn {
            self.withdrawn = None;
        }
        self.script = script.filter(|_| self.follows_script && self.withdrawn.is_none());
    }

    /// Whatever gives a mode counts no longer.
    pub(super) fn withdraw(&mut self) {
        self.withdrawn = self.script.or(self.withdrawn);
        (self.asked, self.script, self.otherwise) = (None, None, None);
    }

    /// The mode to request now; `None`: the gripper stays as it is.
    pub(super) fn mode(&self) -> Option<GripMode> {
        self.asked.or(self.script).or(self.otherwise)
    }

    /// Whether a request other than a mode is unconfirmed.
    pub(super) const fn is_under_way(&self) -> bool {
        self.floor.is_some() || self.acknowledging.is_some()
    }

    /// Waits for a request until then.
    pub(super) fn next_until(&self, until: std::time::Instant) -> Option<Asked> {
        self.inbox.next_until(until)
    }
}
