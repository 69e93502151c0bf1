//! How the friction of a finger differs from one number: less while it slides, changing over time, unlike from place to
//! place. Units: mm, mm/s, s, shares of [`Object::friction`](super::Object). Limits: the speed is that of the whole contact
//! in the step before, so micro-slip at a contact's rim keeps the sticking friction.

use super::course::Course;
use crate::contact_world::Texture;
use crate::error::{SimulationError, checked, positive};

/// Friction as a share of the object's sticking friction on that finger:
/// `course(t) · (s + (1 − s)·exp(−v/v₀)) · texture(place)` at sliding speed v, with s the `sliding_share`
/// (Stribeck's falling branch; Olsson et al. 1998, "Friction models and friction compensation").
#[derive(Debug, Clone, PartialEq)]
pub struct FrictionLaw {
    /// Friction at high speed over that at rest, above 0, at most 1.
    pub sliding_share: f64,
    /// Sliding speed v₀ at which 63 % of the difference are gone, mm/s.
    pub speed_mm_per_s: f64,
    /// Share over time: a drop is a jump downwards.
    pub course: Course,
    /// Share from place to place of the object's surface; none is even.
    pub texture: Option<Texture>,
}

impl Default for FrictionLaw {
    /// The same friction always.
    fn default() -> Self {
        Self {
            sliding_share: 1.0,
            speed_mm_per_s: 1.0,
            course: Course::constant(1.0),
            texture: None,
        }
    }
}

impl FrictionLaw {
    /// Share of the sticking friction that acts at `time_s` when the contact slides at `speed_mm_per_s`, the place aside.
    #[must_use]
    pub fn share(&self, time_s: f64, speed_mm_per_s: f64) -> f64 {
        self.course.at(time_s) * self.share_of_speed(speed_mm_per_s)
    }

    /// Mean of that over a step, so that a drop inside a step counts from its moment on.
    pub(crate) fn mean_share(&self, [from_s, to_s]: [f64; 2], speed_mm_per_s: f64) -> f64 {
        let [from, to] = [from_s, to_s].map(|time| self.course.at(time));
        let constant = from.to_bits() == to.to_bits();
        let mean = if constant {
            from
        } else {
            self.course.mean(from_s, to_s)
        };
        mean * self.share_of_speed(speed_mm_per_s)
    }

    fn share_of_speed(&self, speed_mm_per_s: f64) -> f64 {
        let left = (1.0 - self.sliding_share) * libm::exp(-speed_mm_per_s / self.speed_mm_per_s);
        self.sliding_share + left
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        checked(
            "friction sliding_share",
            self.sliding_share,
            "above 0, at most 1",
            |share| share > 0.0 && share <= 1.0,
        )?;
        positive("friction speed_mm_per_s", self.speed_mm_per_s)?;
        self.course.check("friction course")?;
        self.course
            .values()
            .try_for_each(|share| positive("friction course", share).map(drop))?;
        self.texture.as_ref().map_or(Ok(()), Texture::check)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_law_is_exactly_one_at_every_time_and_speed() {
        let law = FrictionLaw::default();
        law.check().unwrap();
        for (time, speed) in [(0.0, 0.0), (3.0, 0.2), (-1.0, 1e6)] {
            assert_eq!(law.share(time, speed).to_bits(), 1.0_f64.to_bits());
        }
    }

    #[test]
    fn friction_falls_with_speed_to_its_sliding_share_and_with_time_as_its_course_says() {
        let law = FrictionLaw {
            sliding_share: 0.6,
            speed_mm_per_s: 2.0,
            course: Course::linear(vec![[0.0, 1.0], [4.0, 1.0], [4.0, 0.5]]),
            texture: None,
        };
        law.check().unwrap();
        assert!((law.share(0.0, 0.0) - 1.0).abs() < 1e-12);
        let at_two = 0.6 + 0.4 / std::f64::consts::E;
        assert!((law.share(1.0, 2.0) - at_two).abs() < 1e-12);
        assert!((law.share(3.999, 1e3) - 0.6).abs() < 1e-12);
        assert!((law.share(4.0, 1e3) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn a_share_outside_its_range_is_refused_by_name() {
        let refused = |law: FrictionLaw| law.check().unwrap_err().to_string();
        let law = FrictionLaw::default();
        let more = FrictionLaw {
            sliding_share: 1.2,
            ..law.clone()
        };
        assert!(refused(more).contains("friction sliding_share is 1.2"));
        let none = FrictionLaw {
            course: Course::constant(0.0),
            ..law
        };
        assert!(refused(none).contains("friction course is 0"));
    }
}
