//! How the arm moves the gripper in the plane of the fingers: strokes that add up. Units: mm, s, Hz.
//! Limits: the gripper does not turn with the arm; gravity may (see `world`).

use super::course::{minimum_jerk, minimum_jerk_speed};
use crate::error::{SimulationError, finite, not_negative, positive};

/// One motion of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stroke {
    /// From rest to rest with minimum jerk (Flash and Hogan 1985).
    Move {
        /// Start.
        from_s: f64,
        /// How long it takes.
        duration_s: f64,
        /// How far it goes.
        by_mm: [f64; 2],
    },
    /// Gathers speed smoothly and stops in `stop_s`.
    Dash {
        /// Start.
        from_s: f64,
        /// How long it takes, the stop included.
        duration_s: f64,
        /// How far it goes.
        by_mm: [f64; 2],
        /// How long the stop takes, at even deceleration.
        stop_s: f64,
    },
    /// To and fro as a sine that swells over its first period and fades over its last.
    Shake {
        /// Start.
        from_s: f64,
        /// How long it takes.
        duration_s: f64,
        /// Largest distance from the middle.
        amplitude_mm: [f64; 2],
        /// Periods per second.
        frequency_hz: f64,
    },
}

impl Stroke {
    /// Along what it goes, and place and speed at `time_s` as shares of that.
    fn along(&self, time_s: f64) -> ([f64; 2], f64, f64) {
        match *self {
            Self::Move {
                from_s,
                duration_s,
                by_mm,
            } => {
                let share = ((time_s - from_s) / duration_s).clamp(0.0, 1.0);
                (by_mm, minimum_jerk(share), minimum_jerk_speed(share) / duration_s)
            }
            Self::Dash {
                from_s,
                duration_s,
                by_mm,
                stop_s,
            } => {
                // Speed V(3τ² − 2τ³) over the first part, then straight down to 0.
                let gather_s = duration_s - stop_s;
                let top = 2.0 / duration_s;
                let now = time_s - from_s;
                let (place, speed) = if now <= gather_s {
                    let share = (now / gather_s).max(0.0);
                    (
                        top * gather_s * share.powi(3) * (1.0 - 0.5 * share),
                        top * share * share * (3.0 - 2.0 * share),
                    )
                } else {
                    let left = (duration_s - now).max(0.0);
                    (1.0 - 0.5 * top * left * left / stop_s, top * left / stop_s)
                };
                (by_mm, place, speed)
            }
            Self::Shake {
                from_s,
                duration_s,
                amplitude_mm,
                frequency_hz,
            } => {
                let now = (time_s - from_s).clamp(0.0, duration_s);
                let swell = (now * frequency_hz).min((duration_s - now) * frequency_hz);
                let rising = if 2.0 * now < duration_s { 1.0 } else { -1.0 };
                let (size, growth) = if swell < 1.0 {
                    (
                        minimum_jerk(swell),
                        rising * frequency_hz * minimum_jerk_speed(swell),
                    )
                } else {
                    (1.0, 0.0)
                };
                let rate = std::f64::consts::TAU * frequency_hz;
                let (sin, cos) = libm::sincos(rate * now);
                (amplitude_mm, size * sin, growth * sin + size * rate * cos)
            }
        }
    }

    fn check(&self) -> Result<(), SimulationError> {
        let (from_s, duration_s, by_mm) = match *self {
            Self::Move {
                from_s,
                duration_s,
                by_mm,
            }
            | Self::Dash {
                from_s,
                duration_s,
                by_mm,
                ..
            }
            | Self::Shake {
                from_s,
                duration_s,
                amplitude_mm: by_mm,
                ..
            } => (from_s, duration_s, by_mm),
        };
        not_negative("arm stroke from_s", from_s)?;
        positive("arm stroke duration_s", duration_s)?;
        finite("arm stroke, mm along x", by_mm[0])?;
        finite("arm stroke, mm along y", by_mm[1])?;
        match *self {
            Self::Move { .. } => {}
            Self::Dash { stop_s, .. } => {
                positive("arm dash stop_s", stop_s)?;
                positive("arm dash duration_s less stop_s", duration_s - stop_s)?;
            }
            Self::Shake { frequency_hz, .. } => {
                positive("arm shake frequency_hz", frequency_hz)?;
                // Below two periods it could not swell and fade.
                positive(
                    "arm shake duration_s less two periods",
                    duration_s - 2.0 / frequency_hz + 1e-9,
                )?;
            }
        }
        Ok(())
    }
}

/// The arm's strokes; none is an arm that stands still.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ArmMotion {
    /// They add up where they overlap.
    pub strokes: Vec<Stroke>,
}

impl ArmMotion {
    /// Place at `time_s` from where the arm started, mm.
    #[must_use]
    pub fn place_mm(&self, time_s: f64) -> [f64; 2] {
        self.sum(|stroke| {
            let (along, place, _) = stroke.along(time_s);
            along.map(|v| v * place)
        })
    }

    /// Velocity at `time_s`, mm/s.
    #[must_use]
    pub fn velocity_mm_per_s(&self, time_s: f64) -> [f64; 2] {
        self.sum(|stroke| {
            let (along, _, speed) = stroke.along(time_s);
            along.map(|v| v * speed)
        })
    }

    fn sum(&self, part: impl Fn(&Stroke) -> [f64; 2]) -> [f64; 2] {
        self.strokes.iter().map(part).fold([0.0; 2], |sum, more| {
            let [x, y] = more;
            [sum[0] + x, sum[1] + y]
        })
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        self.strokes.iter().try_for_each(Stroke::check)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_are_the_slopes_of_the_places_and_every_stroke_ends_where_it_says() {
        let by_mm = [30.0, -80.0];
        let strokes = [
            Stroke::Move {
                from_s: 0.2,
                duration_s: 0.8,
                by_mm,
            },
            Stroke::Dash {
                from_s: 0.2,
                duration_s: 0.8,
                by_mm,
                stop_s: 0.05,
            },
            Stroke::Shake {
                from_s: 0.2,
                duration_s: 0.8,
                amplitude_mm: by_mm,
                frequency_hz: 5.0,
            },
        ];
        for (stroke, end) in strokes.into_iter().zip([1.0, 1.0, 0.0]) {
            let arm = ArmMotion {
                strokes: vec![stroke],
            };
            arm.check().unwrap();
            for i in 0..1_200 {
                let (time, step) = (1e-3 * f64::from(i) + 0.5e-3, 1e-6);
                for k in 0..2 {
                    let slope = (arm.place_mm(time + step)[k] - arm.place_mm(time - step)[k]) / (2.0 * step);
                    let speed = arm.velocity_mm_per_s(time)[k];
                    assert!(
                        (slope - speed).abs() < 1e-2 * (1.0 + speed.abs()),
                        "{stroke:?} {time}"
                    );
                }
            }
            for (k, by) in by_mm.iter().enumerate() {
                assert!((arm.place_mm(2.0)[k] - end * by).abs() < 1e-9, "{stroke:?}");
                assert!(arm.velocity_mm_per_s(1.001)[k].abs() < 1e-9 && arm.place_mm(0.1)[k] == 0.0);
            }
        }
    }

    #[test]
    fn a_shake_too_short_to_swell_and_a_stop_longer_than_its_dash_are_refused() {
        let shake = Stroke::Shake {
            from_s: 0.0,
            duration_s: 0.3,
            amplitude_mm: [1.0, 0.0],
            frequency_hz: 5.0,
        };
        assert!(shake.check().is_err());
        let dash = Stroke::Dash {
            from_s: 0.0,
            duration_s: 0.3,
            by_mm: [1.0, 0.0],
            stop_s: 0.4,
        };
        assert!(dash.check().is_err());
    }
}
