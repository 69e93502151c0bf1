//! A policy that knows the truth: the load and the sliding friction of the moment, from the next picture on. What it
//! loses, nobody could have held with its margin, delays and gripper. Units: N, s.

use super::follower::{Follower, rising};

/// Force above what sliding friction needs, share of it: 1.3 times the need.
const MARGIN: f64 = 0.3;

/// What is true when a picture is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Truth {
    /// Force of each finger that the load would need at a friction of 1, N.
    pub(super) load_n: f64,
    /// Sliding friction, mean of both fingers.
    pub(super) sliding: f64,
    /// Whether the object slid since the last picture.
    pub(super) slides: bool,
}

/// The oracle at work.
pub(super) struct Oracle {
    line: Follower,
    before_n: f64,
}

impl Oracle {
    pub(super) fn new(line: Follower) -> Self {
        Self { line, before_n: 0.0 }
    }

    /// The line for what is true now, `step_s` after the last picture.
    pub(super) fn line_n(&mut self, now: Truth, step_s: f64) -> f64 {
        let load_n = rising(now.load_n, self.before_n, step_s);
        self.before_n = now.load_n;
        let wanted_n = (1.0 + MARGIN) * load_n / now.sliding;
        let min_n = if now.slides { self.line.line_n() } else { 0.0 };
        self.line.follow(wanted_n.max(min_n), step_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oracle_holds_its_margin_over_a_steady_load_and_answers_a_drop_at_once() {
        let step_s = 1.0 / 60.0;
        let mut oracle = Oracle::new(Follower::new(1.0, 30.0));
        let mut line_n = 0.0;
        for _ in 0..120 {
            line_n = oracle.line_n(
                Truth {
                    load_n: 2.0,
                    sliding: 0.8,
                    slides: false,
                },
                step_s,
            );
        }
        assert!((line_n - 1.3 * 2.0 / 0.8).abs() < 1e-3, "{line_n}");
        let halved = Truth {
            load_n: 2.0,
            sliding: 0.4,
            slides: false,
        };
        let (first, second) = (oracle.line_n(halved, step_s), oracle.line_n(halved, step_s));
        assert!(
            first > line_n + 1.0 && second > first,
            "{line_n} {first} {second}"
        );
        for _ in 0..10 {
            line_n = oracle.line_n(halved, step_s);
        }
        assert!((line_n - 1.3 * 2.0 / 0.4).abs() < 1e-9);
        let lighter = Truth {
            load_n: 1.0,
            sliding: 0.4,
            slides: true,
        };
        assert!(
            (oracle.line_n(lighter, step_s) - line_n).abs() < 1e-9,
            "it does not fall while it slides"
        );
    }
}
