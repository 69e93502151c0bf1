//! What changes over time: shares given at knots, straight or smooth between them. Units: s, shares.
//! Means over a step are exact, so that a pulse shorter than a step keeps its momentum.

use crate::error::{SimulationError, checked, finite};

/// A quantity over time: constant before the first knot and after the last.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Course {
    knots: Vec<[f64; 2]>,
    smooth: bool,
}

impl Course {
    /// Straight lines between knots (time in s, value), in order of time. Two knots at one time are a jump.
    #[must_use]
    pub fn linear(knots: Vec<[f64; 2]>) -> Self {
        Self { knots, smooth: false }
    }

    /// As [`Self::linear`], but every stretch is a minimum-jerk one (Flash and Hogan 1985): at rest at its ends.
    #[must_use]
    pub fn smooth(knots: Vec<[f64; 2]>) -> Self {
        Self { knots, smooth: true }
    }

    /// The same value always.
    #[must_use]
    pub fn constant(value: f64) -> Self {
        Self::linear(vec![[0.0, value]])
    }

    /// The same until `from_s`, which is after its last knot; from there to `to_s` its value changes to `share` of itself, evenly if the course
    /// is linear.
    #[must_use]
    pub fn fading(mut self, [from_s, to_s]: [f64; 2], share: f64) -> Self {
        let before = self.at(from_s);
        self.knots.extend([[from_s, before], [to_s, share * before]]);
        self
    }

    /// A triangular pulse from `from_s` on whose integral over time is 1, so that a force times it is an impulse.
    #[must_use]
    pub fn impulse(from_s: f64, duration_s: f64) -> Self {
        let peak = 2.0 / duration_s;
        Self::linear(vec![
            [from_s, 0.0],
            [from_s + 0.5 * duration_s, peak],
            [from_s + duration_s, 0.0],
        ])
    }

    /// Value at `time_s`; 0 of a course without knots.
    #[must_use]
    pub fn at(&self, time_s: f64) -> f64 {
        let after = self.knots.partition_point(|knot| knot[0] <= time_s);
        let Some(&[from, a]) = after.checked_sub(1).and_then(|i| self.knots.get(i)) else {
            return self.knots.first().map_or(0.0, |knot| knot[1]);
        };
        let Some(&[to, b]) = self.knots.get(after) else {
            return a;
        };
        let share = (time_s - from) / (to - from);
        a + (b - a) * if self.smooth { minimum_jerk(share) } else { share }
    }

    /// Mean from `from_s` to `to_s`, exact.
    #[must_use]
    pub fn mean(&self, from_s: f64, to_s: f64) -> f64 {
        if to_s <= from_s {
            return self.at(to_s);
        }
        (self.integral(to_s) - self.integral(from_s)) / (to_s - from_s)
    }

    /// Integral from the first knot to `time_s`.
    fn integral(&self, time_s: f64) -> f64 {
        let Some(&[first, value]) = self.knots.first() else {
            return 0.0;
        };
        let mut sum = value * (time_s - first).min(0.0);
        for pair in self.knots.windows(2) {
            let ([from, a], [to, b]) = (pair[0], pair[1]);
            let long = to - from;
            if time_s <= from || long <= 0.0 {
                continue;
            }
            let share = ((time_s - from) / long).min(1.0);
            let under = if self.smooth {
                // ∫ 10τ³ − 15τ⁴ + 6τ⁵.
                share.powi(4) * (2.5 + share * (share - 3.0))
            } else {
                0.5 * share * share
            };
            sum += long * (a * share + (b - a) * under);
        }
        if let Some(&[last, value]) = self.knots.last() {
            sum += value * (time_s - last).max(0.0);
        }
        sum
    }

    /// The values at its knots.
    pub(crate) fn values(&self) -> impl Iterator<Item = f64> {
        self.knots.iter().map(|knot| knot[1])
    }

    pub(crate) fn check(&self, field: &'static str) -> Result<(), SimulationError> {
        for [time, value] in &self.knots {
            finite(field, *time)?;
            finite(field, *value)?;
        }
        for pair in self.knots.windows(2) {
            checked(
                field,
                pair[1][0] - pair[0][0],
                "times of knots that do not fall",
                |step| step >= 0.0,
            )?;
        }
        Ok(())
    }
}

/// 10τ³ − 15τ⁴ + 6τ⁵ for τ from 0 to 1: the point-to-point motion of least jerk.
pub(crate) fn minimum_jerk(share: f64) -> f64 {
    share.powi(3) * (10.0 + share * (6.0 * share - 15.0))
}

/// Its derivative.
pub(crate) fn minimum_jerk_speed(share: f64) -> f64 {
    30.0 * (share * (1.0 - share)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_those_of_many_samples_for_jumps_slopes_and_smooth_stretches() {
        let knots = vec![[0.5, 1.0], [1.0, 3.0], [1.0, -1.0], [2.5, 2.0]];
        for course in [Course::linear(knots.clone()), Course::smooth(knots)] {
            for [from, to] in [[-1.0, 0.4], [0.2, 0.7], [0.9, 1.2], [0.0, 4.0], [2.4, 2.6]] {
                let count = 200_000;
                let sampled: f64 = (0..count)
                    .map(|i| course.at(from + (to - from) * (f64::from(i) + 0.5) / f64::from(count)))
                    .sum::<f64>()
                    / f64::from(count);
                assert!((course.mean(from, to) - sampled).abs() < 1e-4, "{from} to {to}");
            }
        }
    }

    #[test]
    fn an_impulse_is_one_however_short_and_however_it_is_cut() {
        let pulse = Course::impulse(0.3, 0.004);
        assert!((pulse.mean(0.0, 1.0) - 1.0).abs() < 1e-12);
        let halves = 0.301 * pulse.mean(0.0, 0.301) + 0.699 * pulse.mean(0.301, 1.0);
        assert!((halves - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_fading_course_is_the_old_one_and_then_falls_evenly_to_its_share() {
        let fading = Course::linear(vec![[0.0, 1.0], [2.0, 1.0], [2.0, 0.5]]).fading([3.0, 13.0], 0.6);
        for (time_s, value) in [
            (1.0, 1.0),
            (2.5, 0.5),
            (3.0, 0.5),
            (8.0, 0.4),
            (13.0, 0.3),
            (20.0, 0.3),
        ] {
            assert!((fading.at(time_s) - value).abs() < 1e-12, "{time_s}");
        }
    }

    #[test]
    fn no_knots_are_zero_and_falling_times_are_refused() {
        assert!(
            Course::default().mean(0.0, 1.0) == 0.0 && (Course::constant(2.0).at(-3.0) - 2.0).abs() < 1e-12
        );
        let error = Course::linear(vec![[1.0, 0.0], [0.5, 0.0]]).check("pull course");
        assert!(error.unwrap_err().to_string().contains("pull course is -0.5"));
    }
}
