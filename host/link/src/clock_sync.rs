//! Whether this host's clock has jumped against the microcontroller's: after a suspended machine, a moved virtual one, a debugger.
//! The microcontroller then considers every map late or from the future, until a new handshake. Pure; times in µs.
//!
//! A status that is read late makes the host's clock look ahead for that status, never behind. So one status is enough to detect a
//! host that stood still, and a second of statuses to detect a jump ahead.

use std::collections::VecDeque;

/// A jump ahead must last this long, ms of the microcontroller's clock, and for this many statuses: ten a second come while maps
/// are refused.
const WINDOW_MS: i64 = 1_000;
const WINDOW_MIN: usize = 8;
/// Allowed jitter and drift over that time; the microcontroller allows more before a map is stale.
const JUMP_US: i64 = 50_000;
/// If maps are refused as from the future for this long, ms, with none accepted meanwhile, all later ones will be refused too: the
/// first one was later than the microcontroller tolerates, but counts as prompt.
const LOCKED_OUT_MS: u32 = 500;

/// The difference between the clocks, and its history.
#[derive(Debug, Default)]
pub(crate) struct ClockSync {
    /// Host less microcontroller, the least of the last full window.
    reference: Option<i64>,
    /// The newest uptime of the microcontroller, ms, extended beyond 32 bits, which wrap after seven weeks.
    uptime_ms: Option<i64>,
    /// When the microcontroller said it, ms, and the difference.
    recent: VecDeque<(i64, i64)>,
    /// Since when it refuses maps as from the future, ms, and how many maps it had accepted by then.
    refusing: Option<(u32, u32)>,
}

impl ClockSync {
    /// One of the clocks starts again from zero.
    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }

    /// A status was read at `now_us`, sent when the microcontroller had run for `uptime_ms`. Returns whether this host's clock has
    /// jumped; if so, the comparison starts again.
    pub(crate) fn jumped(&mut self, now_us: u64, uptime_ms: u32) -> bool {
        let uptime_ms = match self.uptime_ms {
            None => i64::from(uptime_ms),
            Some(before_ms) => before_ms + i64::from(uptime_ms.wrapping_sub(before_ms as u32).cast_signed()),
        };
        self.uptime_ms = Some(uptime_ms);
        let difference = now_us as i64 - uptime_ms * 1_000;
        self.recent.push_back((uptime_ms, difference));
        let is_old =
            |at: Option<&(i64, i64)>| at.is_some_and(|(then_ms, _)| uptime_ms - then_ms >= WINDOW_MS);
        while is_old(self.recent.get(1)) {
            self.recent.pop_front();
        }
        let is_full = is_old(self.recent.front()) && self.recent.len() >= WINDOW_MIN;
        let differences = self.recent.iter().map(|(_, difference)| *difference);
        let min = differences.min().unwrap_or(difference);
        let Some(reference) = self.reference else {
            self.reference = is_full.then_some(min);
            return false;
        };
        if difference < reference - JUMP_US || (is_full && min > reference + JUMP_US) {
            self.forget();
            return true;
        }
        if is_full {
            // Clocks drift.
            self.reference = Some(min);
        }
        false
    }

    /// The same status about maps: whether some are refused as from the future, and how many were accepted so far. Returns whether
    /// this will not end by itself; if so, the comparison starts again.
    pub(crate) fn is_locked_out(&mut self, uptime_ms: u32, is_refusing: bool, maps: u32) -> bool {
        if !is_refusing {
            self.refusing = None;
            return false;
        }
        match self.refusing {
            Some((since_ms, before)) if before == maps => {
                let is_locked_out = uptime_ms.wrapping_sub(since_ms) >= LOCKED_OUT_MS;
                if is_locked_out {
                    self.forget();
                }
                is_locked_out
            }
            _ => {
                self.refusing = Some((uptime_ms, maps));
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 statuses a second, each read up to `jitter_us` late; the host's clock is `ahead(frame)` of the other.
    fn jumps(frames: u64, jitter_us: u64, ahead: impl Fn(u64) -> i64) -> Vec<u64> {
        let mut watch = ClockSync::default();
        (0..frames)
            .filter(|frame| {
                let at_us = 3_600_000_000 + frame * 16_667;
                let late_us = ((frame * 2_654_435_761) >> 7) % (jitter_us + 1);
                let now_us = (at_us + late_us).wrapping_add_signed(ahead(*frame));
                watch.jumped(now_us, (at_us / 1_000) as u32)
            })
            .collect()
    }

    #[test]
    fn jitter_and_drift_are_no_jumps() {
        // 200 parts per million, and statuses that are read up to 400 ms late.
        let drift = |frame: u64| (frame * 16_667 / 5_000) as i64;
        assert!(jumps(200_000, 400_000, drift).is_empty());
        assert!(jumps(200_000, 16_000, |frame| -drift(frame)).is_empty());
    }

    #[test]
    fn a_microcontroller_that_runs_for_seven_weeks_is_no_jump() {
        let mut watch = ClockSync::default();
        let start_ms = u64::from(u32::MAX) - 5_000;
        for frame in 0..600 {
            let ms = start_ms + frame * 17;
            assert!(!watch.jumped(ms * 1_000, ms as u32), "{ms}");
        }
    }

    #[test]
    fn a_host_that_stood_still_is_seen_by_the_first_status_and_one_that_jumped_ahead_within_a_second_or_so() {
        let from = |at: u64, by_us: i64| move |frame: u64| if frame < at { 0 } else { by_us };
        assert_eq!(jumps(1_000, 16_000, from(500, -600_000_000)), vec![500_u64]);
        let ahead = jumps(1_000, 16_000, from(500, 70_000));
        assert!(ahead.len() == 1 && (500..=564).contains(&ahead[0]), "{ahead:?}");
        // One that comes back at once was a status that had to wait.
        let for_a_while = |frame: u64| i64::from((500..520).contains(&frame)) * 300_000;
        assert!(jumps(1_000, 16_000, for_a_while).is_empty());
    }

    #[test]
    fn refusals_that_last_are_a_lock_out_and_those_between_maps_are_none() {
        let mut watch = ClockSync::default();
        for frame in 0..100 {
            assert!(!watch.is_locked_out(frame * 100, frame % 6 != 5, 7));
            assert!(!watch.is_locked_out(frame * 100 + 50, true, 8 + frame));
        }
        let mut watch = ClockSync::default();
        let start_ms = u32::MAX - 200;
        let locked_out: Vec<u32> = (0..13)
            .filter(|status| watch.is_locked_out(start_ms.wrapping_add(status * 100), true, 0))
            .collect();
        assert_eq!(locked_out, [5, 11]);
    }
}
