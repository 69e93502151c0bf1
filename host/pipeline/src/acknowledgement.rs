//! Acknowledging latched faults: repeated until the device's status shows them gone; after a bounded time the reason is returned.
//! Pure. Times in µs of the session's clock.

use gripline_protocol::message::Status;

use crate::mode_request::{GIVE_UP_US, REPEAT_US};

/// Faults that were acknowledged and may still be latched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Acknowledgement {
    faults: u32,
    begun_us: u64,
    /// Restarts of the device at the request: what is latched after a restart was not looked at.
    restarts: u32,
    sent_us: Option<u64>,
    /// When it was sent the time before.
    sent_before_us: Option<u64>,
}

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acknowledging {
    /// Send it, again or for the first time.
    Send,
    /// Wait for a status.
    Wait,
    /// A status shows that none of them is latched.
    Done,
    /// Given up: the first set is still latched, because the second set is still active.
    StillLatched(u32, u32),
    /// Given up: no status came.
    NoStatus,
    /// Given up: the device restarted.
    Restarted,
}

impl Acknowledgement {
    /// Of these faults, bit n for fault number n.
    #[must_use]
    pub const fn new(faults: u32, now_us: u64, restarts: u32) -> Self {
        Self {
            faults,
            begun_us: now_us,
            restarts,
            sent_us: None,
            sent_before_us: None,
        }
    }

    /// The faults.
    #[must_use]
    pub const fn faults(&self) -> u32 {
        self.faults
    }

    /// Takes the newest status and its age, and how often the device has restarted.
    #[must_use]
    pub fn step(
        &self,
        now_us: u64,
        (status, age_us): (Option<&Status>, u64),
        restarts: u32,
    ) -> Acknowledging {
        if restarts != self.restarts {
            return Acknowledging::Restarted;
        }
        let is_over = now_us.saturating_sub(self.begun_us) >= GIVE_UP_US;
        let came_us = now_us.saturating_sub(age_us);
        // At the end the last one may have been sent just now: then an answer to the one before counts too.
        let sent_us = if is_over {
            self.sent_before_us.or(self.sent_us)
        } else {
            self.sent_us
        };
        match status.filter(|_| sent_us.is_some_and(|sent_us| came_us >= sent_us)) {
            Some(status) if status.latched & self.faults == 0 => Acknowledging::Done,
            Some(status) if is_over => {
                let latched = status.latched & self.faults;
                Acknowledging::StillLatched(latched, latched & status.faults)
            }
            None if is_over => Acknowledging::NoStatus,
            _ if self.sent_us.is_none_or(|sent_us| now_us >= sent_us + REPEAT_US) => Acknowledging::Send,
            _ => Acknowledging::Wait,
        }
    }

    /// It was sent; the link accepted it or not.
    pub const fn sent(&mut self, now_us: u64, was_taken: bool) {
        if was_taken {
            self.sent_before_us = self.sent_us;
            self.sent_us = Some(now_us);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(latched: u32, faults: u32) -> Status {
        Status {
            latched,
            faults,
            ..Status::default()
        }
    }

    #[test]
    fn one_that_is_lost_is_said_again_until_a_later_status_shows_the_faults_gone() {
        let mut asked = Acknowledgement::new(0b110, 1_000, 0);
        let before = status(0b110, 0);
        assert_eq!(asked.step(1_000, (Some(&before), 0), 0), Acknowledging::Send);
        asked.sent(1_000, false);
        assert_eq!(asked.step(2_000, (Some(&before), 0), 0), Acknowledging::Send);
        asked.sent(2_000, true);
        assert_eq!(asked.step(6_000, (Some(&before), 0), 0), Acknowledging::Wait);
        assert_eq!(asked.step(7_000, (Some(&before), 0), 0), Acknowledging::Send);
        asked.sent(7_000, true);
        let after = status(0b001, 0b001);
        // From before it was sent: it says nothing.
        assert_eq!(asked.step(9_000, (Some(&after), 5_000), 0), Acknowledging::Wait);
        assert_eq!(asked.step(10_000, (Some(&after), 0), 0), Acknowledging::Done);
    }

    #[test]
    fn what_is_given_up_says_why() {
        let mut asked = Acknowledgement::new(0b110, 0, 0);
        asked.sent(0, true);
        let still = status(0b110, 0b100);
        assert_eq!(
            asked.step(2_000_000, (Some(&still), 0), 0),
            Acknowledging::StillLatched(0b110, 0b100)
        );
        assert_eq!(asked.step(2_000_000, (None, 0), 0), Acknowledging::NoStatus);
    }

    #[test]
    fn what_is_given_up_just_after_it_was_said_again_says_why_too() {
        let mut asked = Acknowledgement::new(0b110, 0, 0);
        asked.sent(1_990_000, true);
        asked.sent(1_999_000, true);
        let still = status(0b110, 0b100);
        assert_eq!(
            asked.step(2_000_000, (Some(&still), 5_000), 0),
            Acknowledging::StillLatched(0b110, 0b100)
        );
        assert_eq!(
            asked.step(2_000_000, (Some(&status(0, 0)), 5_000), 0),
            Acknowledging::Done
        );
        // A status from before both is none.
        assert_eq!(
            asked.step(2_000_000, (Some(&still), 50_000), 0),
            Acknowledging::NoStatus
        );
    }

    #[test]
    fn a_restart_ends_it_even_if_the_same_faults_are_latched_again() {
        let mut asked = Acknowledgement::new(0b110, 0, 0);
        asked.sent(0, true);
        let again = status(0b110, 0);
        assert_eq!(
            asked.step(6_000, (Some(&again), 1_000), 1),
            Acknowledging::Restarted
        );
    }
}
