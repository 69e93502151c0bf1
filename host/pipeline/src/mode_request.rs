//! A request for a mode of the gripper: repeated until the device's status shows it; after a bounded time the reason is returned.
//! Pure. Times in µs of the session's clock. Limit: a status in transit when the request is sent counts as its answer.

use std::fmt;

use gripline_protocol::message::{GripMode, Refusal, Status};

/// An unconfirmed request is repeated after this time: every request also asks for a status, which a USB device sends within two
/// milliseconds.
pub(crate) const REPEAT_US: u64 = 5_000;
/// After this it is given up and reported.
pub(crate) const GIVE_UP_US: u64 = 2_000_000;

/// State of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Sent or withheld at this time, if the link accepts anything.
    Waiting { sent_us: Option<u64> },
    /// A status shows the mode.
    Confirmed,
    /// No longer waiting.
    GivenUp,
}

/// A requested mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ModeRequest {
    mode: GripMode,
    begun_us: u64,
    /// Restarts of the device at the request: after a restart it is not repeated, or something would move by itself.
    restarts: u32,
    state: State,
    is_reported: bool,
}

/// Why a request has no effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unconfirmed {
    /// The device refused it.
    Refused(GripMode, Refusal),
    /// The link accepts nothing; it is still tried.
    NotTaken(GripMode),
    /// No status came since.
    NoStatus(GripMode),
    /// Statuses come and show the other mode.
    NoEffect(GripMode),
    /// The device restarted before it confirmed.
    Restarted(GripMode),
}

impl fmt::Display for Unconfirmed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = GIVE_UP_US / 1_000_000;
        let name = |mode: &GripMode| match mode {
            GripMode::Hold => "hold",
            GripMode::Released => "release",
        };
        match self {
            Self::Refused(mode, refusal) => {
                write!(
                    f,
                    "{} was refused by the microcontroller: {refusal:?}",
                    name(mode)
                )
            }
            Self::NotTaken(mode) => write!(
                f,
                "{} could not be sent for {seconds} s, expected a link that takes it; it is sent when the link is back",
                name(mode)
            ),
            Self::NoStatus(mode) => write!(
                f,
                "{} was requested for {seconds} s and no status came, expected one: check cable and power",
                name(mode)
            ),
            Self::NoEffect(mode) => write!(
                f,
                "{} was sent for {seconds} s and the microcontroller's status does not show it, expected it to; see `gripline \
                 faults`",
                name(mode)
            ),
            Self::Restarted(mode) => write!(
                f,
                "{} was requested and the microcontroller restarted before it confirmed: not repeated, so that nothing moves by itself",
                name(mode)
            ),
        }
    }
}

impl ModeRequest {
    pub(crate) const fn new(mode: GripMode, now_us: u64, restarts: u32) -> Self {
        Self {
            mode,
            begun_us: now_us,
            restarts,
            state: State::Waiting { sent_us: None },
            is_reported: false,
        }
    }

    pub(crate) const fn mode(&self) -> GripMode {
        self.mode
    }

    /// Whether a status shows the mode.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.state == State::Confirmed
    }

    /// Whether it still waits for confirmation.
    pub(crate) const fn is_waiting(&self) -> bool {
        matches!(self.state, State::Waiting { .. })
    }

    /// Takes the newest status and its age; returns whether to send the request now, and a problem to report, once.
    pub(crate) fn step(
        &mut self,
        now_us: u64,
        (status, age_us): (Option<&Status>, u64),
        restarts: u32,
    ) -> (bool, Option<Unconfirmed>) {
        let State::Waiting { sent_us } = self.state else {
            return (false, None);
        };
        let is_over = now_us.saturating_sub(self.begun_us) >= GIVE_UP_US;
        let since =
            status.filter(|_| sent_us.is_some_and(|sent_us| now_us.saturating_sub(age_us) >= sent_us));
        if since.is_some_and(|status| status.mode == self.mode) {
            self.state = State::Confirmed;
            return (false, None);
        }
        if restarts != self.restarts {
            self.state = State::GivenUp;
            return (false, Some(Unconfirmed::Restarted(self.mode)));
        }
        let Some(sent_us) = sent_us else {
            let reports = is_over && !std::mem::replace(&mut self.is_reported, is_over);
            return (true, reports.then_some(Unconfirmed::NotTaken(self.mode)));
        };
        if is_over {
            self.state = State::GivenUp;
            let why = if since.is_some() {
                Unconfirmed::NoEffect(self.mode)
            } else {
                Unconfirmed::NoStatus(self.mode)
            };
            return (false, Some(why));
        }
        (now_us >= sent_us + REPEAT_US, None)
    }

    /// It is sent again, unless it was done or the device restarted since it was requested: nothing moves by itself.
    pub(crate) fn again(&mut self, now_us: u64, restarts: u32) {
        if restarts == self.restarts && !self.is_confirmed() {
            *self = Self::new(self.mode, now_us, restarts);
        }
    }

    /// It was sent at this time, and the link accepted it or not; one that is withheld counts as accepted.
    pub(crate) const fn sent(&mut self, now_us: u64, was_taken: bool) {
        if was_taken {
            self.state = State::Waiting {
                sent_us: Some(now_us),
            };
        }
    }

    /// The device refused something: this request, if it waits for an answer and the refusal fits.
    pub(crate) fn refused(&mut self, refusal: Refusal) -> Option<Unconfirmed> {
        let is_answer = matches!(refusal, Refusal::Latched | Refusal::Inhibited);
        if !is_answer || self.mode != GripMode::Released || !matches!(self.state, State::Waiting { .. }) {
            return None;
        }
        self.state = State::GivenUp;
        Some(Unconfirmed::Refused(self.mode, refusal))
    }
}
