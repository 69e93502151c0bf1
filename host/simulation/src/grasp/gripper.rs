//! A gripper whose force follows its grip-force line: dead time, first-order lag, limits of rate and force.
//! Units: N, s. Limits: both fingers press alike, the jaws hold flat and do not give way.

use std::collections::VecDeque;

use crate::constants::{
    SCENE_GRIPPER_LAG_S, SCENE_GRIPPER_MAX_N, SCENE_GRIPPER_OPEN_N, SCENE_GRIPPER_RATE_N_PER_S,
};
use crate::error::{SimulationError, checked, not_negative, positive};

/// How a gripper follows its line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gripper {
    /// Time until it hears its line, s.
    pub dead_time_s: f64,
    /// Time constant of its force behind the line, s.
    pub lag_s: f64,
    /// Fastest change of its force, N/s.
    pub rate_n_per_s: f64,
    /// Least force that it can press with, N; below it the jaws are open.
    pub min_n: f64,
    /// Largest force, N.
    pub max_n: f64,
    /// How far its force stays behind the line when it comes to rest, N: it sticks.
    pub stick_n: f64,
}

impl Default for Gripper {
    fn default() -> Self {
        Self {
            dead_time_s: 0.0,
            lag_s: SCENE_GRIPPER_LAG_S,
            rate_n_per_s: SCENE_GRIPPER_RATE_N_PER_S,
            min_n: SCENE_GRIPPER_OPEN_N,
            max_n: SCENE_GRIPPER_MAX_N,
            stick_n: 0.0,
        }
    }
}

impl Gripper {
    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        not_negative("gripper dead_time_s", self.dead_time_s)?;
        not_negative("gripper lag_s", self.lag_s)?;
        positive("gripper rate_n_per_s", self.rate_n_per_s)?;
        not_negative("gripper min_n", self.min_n)?;
        not_negative("gripper stick_n", self.stick_n)?;
        checked("gripper max_n", self.max_n, "above min_n", |max| max > self.min_n)?;
        Ok(())
    }
}

/// A gripper at work.
#[derive(Debug, Clone)]
pub(crate) struct GripperState {
    gripper: Gripper,
    /// Lines that were set, with the time from which they count, oldest first.
    lines: VecDeque<[f64; 2]>,
    line_n: f64,
    force_n: f64,
}

impl GripperState {
    pub(crate) fn new(gripper: Gripper) -> Self {
        Self {
            gripper,
            lines: VecDeque::new(),
            line_n: 0.0,
            force_n: 0.0,
        }
    }

    /// The line is `line_n` from `time_s` on.
    pub(crate) fn set_line(&mut self, time_s: f64, line_n: f64) {
        self.lines.push_back([time_s + self.gripper.dead_time_s, line_n]);
    }

    /// Its force after `dt_s` more, from `time_s` on.
    pub(crate) fn advance(&mut self, time_s: f64, dt_s: f64) {
        let (mut now_s, end_s) = (time_s, time_s + dt_s);
        while let Some(&[from_s, line_n]) = self.lines.front()
            && from_s < end_s - 1e-9
        {
            if from_s > now_s + 1e-9 {
                self.follow(from_s - now_s);
                now_s = from_s;
            }
            self.line_n = line_n;
            self.lines.pop_front();
        }
        self.follow(end_s - now_s);
    }

    /// Follows the line as it is for `dt_s`.
    fn follow(&mut self, dt_s: f64) {
        let share = if self.gripper.lag_s > 0.0 {
            1.0 - libm::exp(-dt_s / self.gripper.lag_s)
        } else {
            1.0
        };
        let max_step_n = self.gripper.rate_n_per_s * dt_s;
        let wanted = self.line_n.min(self.gripper.max_n);
        // Friction of its drive: it stops where it still lacks so much.
        let lacking = wanted - self.force_n;
        let lacking = lacking - lacking.clamp(-self.gripper.stick_n, self.gripper.stick_n);
        self.force_n += (lacking * share).clamp(-max_step_n, max_step_n);
    }

    /// What it presses with, N; 0 when the jaws are open.
    pub(crate) fn force_n(&self) -> f64 {
        if self.force_n < self.gripper.min_n {
            0.0
        } else {
            self.force_n
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(gripper: Gripper, line_n: f64, time_s: f64) -> f64 {
        let mut state = GripperState::new(gripper);
        state.set_line(0.0, line_n);
        let steps = (time_s / 1e-3).round() as u32;
        for i in 0..steps {
            state.advance(1e-3 * f64::from(i), 1e-3);
        }
        state.force_n()
    }

    #[test]
    fn a_small_step_is_an_exponential_after_the_dead_time() {
        let gripper = Gripper {
            dead_time_s: 0.02,
            ..Gripper::default()
        };
        assert!(after(gripper, 2.0, 0.02) == 0.0);
        let expected = 2.0 * (1.0 - libm::exp(-0.05 / gripper.lag_s));
        assert!((after(gripper, 2.0, 0.07) - expected).abs() < 1e-9);
    }

    #[test]
    fn a_line_counts_from_its_dead_time_on_however_long_a_step_is() {
        let gripper = Gripper {
            dead_time_s: 0.025,
            lag_s: 0.04,
            ..Gripper::default()
        };
        let frame_s = 1.0 / 60.0;
        let mut state = GripperState::new(gripper);
        state.set_line(0.0, 1.0);
        state.advance(0.0, frame_s);
        state.advance(frame_s, frame_s);
        let expected = 1.0 - libm::exp(-(2.0 * frame_s - 0.025) / 0.04);
        assert!(
            (state.force_n() - expected).abs() < 1e-9,
            "{} {expected}",
            state.force_n()
        );
    }

    #[test]
    fn a_gripper_that_sticks_stops_short_of_its_line_from_both_sides() {
        let gripper = Gripper {
            stick_n: 0.5,
            ..Gripper::default()
        };
        let mut state = GripperState::new(gripper);
        let mut at = 0.0;
        for (line, rest) in [(4.0, 3.5), (4.4, 3.9), (3.6, 3.9), (2.0, 2.5), (2.3, 2.5)] {
            state.set_line(at, line);
            for _ in 0..1_000 {
                state.advance(at, 1e-3);
                at += 1e-3;
            }
            let found = state.force_n();
            assert!((found - rest).abs() < 1e-6, "line {line}: {found}");
        }
    }

    #[test]
    fn a_large_step_meets_the_rate_and_then_the_largest_force() {
        let gripper = Gripper::default();
        assert!((after(gripper, 1e3, 0.1) - 6.0).abs() < 1e-9);
        assert!((after(gripper, 1e3, 3.0) - gripper.max_n).abs() < 1e-6);
        let weak = Gripper {
            min_n: 3.0,
            ..gripper
        };
        assert!(after(weak, 2.9, 3.0) == 0.0);
    }
}
