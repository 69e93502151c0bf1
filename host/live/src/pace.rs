//! Limits the rate of irregular events. Pure.

use std::time::{Duration, Instant};

/// Lets through at most one in each period, on average.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    per_second: f64,
    due: Option<Instant>,
}

impl Pace {
    pub(crate) const fn new(per_second: f64) -> Self {
        Self {
            per_second,
            due: None,
        }
    }

    /// Whether this one passes; `shares` streams share the rate.
    pub(crate) fn lets(&mut self, now: Instant, shares: usize) -> bool {
        let period = Duration::from_secs_f64(shares.max(1) as f64 / self.per_second);
        match self.due {
            Some(due) if now < due => false,
            // Keeps to the rhythm where it can, so that 60 a second become 30 and not 20.
            Some(due) if now < due + period => {
                self.due = Some(due + period);
                true
            }
            _ => {
                self.due = Some(now + period);
                true
            }
        }
    }

    /// The next one passes in any case.
    pub(crate) const fn reset(&mut self) {
        self.due = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of ten seconds at this rate are let through.
    fn let_through(of_per_second: f64, jitter_s: f64) -> usize {
        let start = Instant::now();
        let mut pace = Pace::new(30.0);
        let frames = (10.0 * of_per_second) as u32;
        (0..frames)
            .filter(|frame| {
                let wobble = if frame % 2 == 0 { jitter_s } else { 0.0 };
                let at_s = f64::from(*frame) / of_per_second + wobble;
                pace.lets(start + Duration::from_secs_f64(at_s), 1)
            })
            .count()
    }

    #[test]
    fn never_more_than_the_rate_and_hardly_less() {
        for (rate, jitter_s) in [(60.0, 0.0), (60.0, 0.002), (500.0, 0.0), (90.0, 0.003)] {
            let count = let_through(rate, jitter_s);
            assert!((290..=301).contains(&count), "{count} of {rate} a second");
        }
        assert_eq!(let_through(20.0, 0.0), 200);
    }
}
