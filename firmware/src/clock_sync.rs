//! Clock sync: whether a map's capture time is plausible, and how late the map arrived.
//!
//! The host's clock and ours share no zero. The promptest map since the handshake defines their difference. Every other map is
//! later than that, and no map can be from the future. Units: µs; the host's clock wraps. Limits: a delay common to all maps stays
//! invisible; clocks may drift apart by 244 parts per million; a step of the host's clock requires a new handshake.

use crate::clock::{DeviceMicros, HostMicros};
use crate::constants::{CLOCK_DRIFT_MAX_US, CLOCK_DRIFT_SHIFT, FUTURE_MAX_US};

/// What a capture time means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CaptureTime {
    /// The delay from picture to arrival, beyond the promptest map's.
    Late {
        /// µs.
        us: u32,
    },
    /// The picture would have been taken after the map arrived.
    Future,
}

/// The difference between the host's clock and ours, for one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClockSync {
    /// Capture time minus arrival time of the promptest map, and when that was last updated; `None` before the first map.
    promptest: Option<(u32, u64)>,
}

impl ClockSync {
    /// Before the first map, which counts as prompt.
    #[must_use]
    pub const fn new() -> Self {
        Self { promptest: None }
    }

    /// Checks a map that arrived now. A map from the future changes nothing.
    pub fn check(&mut self, capture: HostMicros, now: DeviceMicros) -> CaptureTime {
        let (HostMicros(capture_us), DeviceMicros(now_us)) = (capture, now);
        let difference = capture_us.wrapping_sub(now_us as u32);
        let Some((promptest, since_us)) = self.promptest else {
            self.promptest = Some((difference, now_us));
            return CaptureTime::Late { us: 0 };
        };
        // If the host's clock is slower than ours, the promptest map would seem ever more prompt.
        let silence_us = now_us.saturating_sub(since_us);
        let drift = (silence_us >> CLOCK_DRIFT_SHIFT).min(CLOCK_DRIFT_MAX_US) as u32;
        let promptest = promptest.wrapping_sub(drift);
        let ahead = difference.wrapping_sub(promptest).cast_signed();
        // It may also be faster: after a long silence that is not the future.
        if ahead > FUTURE_MAX_US + 2 * drift.cast_signed() {
            return CaptureTime::Future;
        }
        if ahead >= 0 {
            self.promptest = Some((difference, now_us));
        } else if drift > 0 {
            self.promptest = Some((promptest, now_us));
        }
        CaptureTime::Late {
            us: ahead.min(0).unsigned_abs(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_US: u64 = 5_000_000_000;

    /// A host whose clock runs `parts_per_million` faster than ours and wraps soon.
    fn host(now_us: u64, parts_per_million: i64) -> HostMicros {
        let passed = (now_us - START_US) as i64;
        HostMicros(u32::MAX - 20_000_000).later_by((passed + passed * parts_per_million / 1_000_000) as u32)
    }

    #[test]
    fn a_map_is_late_by_what_the_promptest_one_was_not() {
        let mut clock = ClockSync::new();
        // The first map took 30 ms longer than it need: the next ones set that right.
        let mut now_us = START_US + 30_000;
        assert_eq!(
            clock.check(host(START_US, 0), DeviceMicros(now_us)),
            CaptureTime::Late { us: 0 }
        );
        for _ in 0..10_000 {
            now_us += 16_667;
            assert_eq!(
                clock.check(host(now_us, 0), DeviceMicros(now_us)),
                CaptureTime::Late { us: 0 }
            );
        }
        let CaptureTime::Late { us } = clock.check(host(now_us, 0), DeviceMicros(now_us + 150_000)) else {
            panic!("a late map is not from the future");
        };
        assert!((149_000..=150_000).contains(&us), "{us}");
    }

    #[test]
    fn a_picture_that_is_sent_again_and_again_grows_old() {
        let mut clock = ClockSync::new();
        let frozen = host(START_US, 0);
        let mut last = 0;
        for ms in 0..2_000 {
            let CaptureTime::Late { us } = clock.check(frozen, DeviceMicros(START_US + ms * 1_000)) else {
                panic!("a frozen picture is not from the future");
            };
            assert!(us >= last);
            last = us;
        }
        assert!((1_900_000..=1_999_000).contains(&last), "{last}");
    }

    #[test]
    fn clocks_that_drift_by_200_parts_per_million_neither_age_maps_nor_bring_them_from_the_future() {
        for parts_per_million in [-200, 200] {
            let mut clock = ClockSync::new();
            // Two hours of 60 maps a second, across several wraps of the host's clock.
            for frame in 0..432_000_u64 {
                let now_us = START_US + frame * 16_667;
                let CaptureTime::Late { us } =
                    clock.check(host(now_us, parts_per_million), DeviceMicros(now_us))
                else {
                    panic!("frame {frame} counted as from the future");
                };
                assert!(us < 1_000, "frame {frame} counted as {us} µs late");
            }
        }
    }

    #[test]
    fn the_first_map_after_any_silence_up_to_a_month_is_believed() {
        for parts_per_million in [-100, 0, 100] {
            for silence_us in (0..42)
                .map(|power| 1 << power)
                .filter(|us| *us < 30 * 86_400_000_000_u64)
            {
                let mut clock = ClockSync::new();
                clock.check(host(START_US, 0), DeviceMicros(START_US));
                let now_us = START_US + silence_us;
                let late = clock.check(host(now_us, parts_per_million), DeviceMicros(now_us));
                assert_eq!(
                    late,
                    CaptureTime::Late { us: 0 },
                    "{silence_us} µs at {parts_per_million} ppm"
                );
                // The next one is late by what it is late.
                let CaptureTime::Late { us } =
                    clock.check(host(now_us, parts_per_million), DeviceMicros(now_us + 150_000))
                else {
                    panic!("a late map is not from the future");
                };
                assert!((149_000..=150_000).contains(&us), "{us}");
            }
        }
    }

    #[test]
    fn a_map_from_the_future_is_reported_and_changes_nothing() {
        let mut clock = ClockSync::new();
        clock.check(host(START_US, 0), DeviceMicros(START_US));
        let before = clock;
        for ahead_us in [1_100_000, 60_000_000, 1_900_000_000] {
            let capture = host(START_US, 0).later_by(ahead_us);
            assert_eq!(
                clock.check(capture, DeviceMicros(START_US + 16_667)),
                CaptureTime::Future
            );
            assert_eq!(clock, before);
        }
    }
}
