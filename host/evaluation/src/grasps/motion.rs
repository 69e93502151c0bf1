//! What a camera that sees the object's imprint in the gel says of its motion: a model, because the simulated fingertip is opaque to the
//! object. It follows what `host/markers` does on pictures of a GelSight Mini: the imprint is compared with that of four pictures ago in
//! the gel's frame. Units: mm.
//!
//! Assumed: the way over the skin since four pictures ago is measured to 0.015 mm (a quarter of a pixel of 0.063 mm); 0.06 mm are even
//! odds, and evidence goes from a fifth to four fifths within 0.04 mm. One picture in ten is poor. A picture that repeats says nothing,
//! because a camera's noise never does.

use std::collections::VecDeque;

use gripline_protocol::Motion;
use gripline_simulation::Random;

use super::sensor::normal;

/// Purpose of the model's random numbers.
const EYE: u64 = 75;
/// Pictures between the two that are compared.
const PICTURES: usize = 4;
const ERROR_MM: f64 = 0.015;
const EVEN_MM: f64 = 0.06;
const SLOPE_MM: f64 = 0.015;
const POOR: f64 = 0.1;

/// What watches one finger.
pub(super) struct MotionCamera {
    random: Random,
    /// Distance slid in the last pictures, oldest first.
    slid_mm: VecDeque<f64>,
}

impl MotionCamera {
    /// Of the sensor number `unit`.
    pub(super) fn new(unit: u64) -> Self {
        Self {
            random: Random::new(unit, EYE),
            slid_mm: VecDeque::new(),
        }
    }

    /// What a picture shows when the object has slid so far over the skin; `touches` tells whether there is an imprint.
    pub(super) fn look(&mut self, slid_mm: f64, touches: bool) -> Motion {
        let error_mm = ERROR_MM * normal(&mut self.random);
        let quality = if self.random.unit() < POOR { 1 } else { 3 };
        if !touches {
            self.slid_mm.clear();
            return Motion::UNKNOWN;
        }
        if self.slid_mm.back().is_some_and(|last| slid_mm < *last) {
            // The world counts again from the lift on.
            self.slid_mm.clear();
        }
        self.slid_mm.push_back(slid_mm);
        if self.slid_mm.len() <= PICTURES {
            return Motion::UNKNOWN;
        }
        let before_mm = self.slid_mm.pop_front().unwrap_or(slid_mm);
        let way_mm = (slid_mm - before_mm + error_mm).abs();
        let evidence = 1.0 / (1.0 + (-(way_mm - EVEN_MM) / SLOPE_MM).exp());
        Motion::new(
            (evidence * f64::from(Motion::EVIDENCE_MAX)).round() as u8,
            quality,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_is_seldom_taken_for_motion_and_a_fast_slide_always_seen() {
        let seen = |mm_per_picture: f64| {
            let mut camera = MotionCamera::new(1);
            let looks: Vec<Motion> = (0..2_000)
                .map(|picture| camera.look(f64::from(picture) * mm_per_picture, true))
                .collect();
            let share = |is: fn(Motion) -> bool| {
                looks[PICTURES..].iter().filter(|look| is(**look)).count() as f64 / 1_996.0
            };
            [share(Motion::shows_motion), share(Motion::shows_rest)]
        };
        let [moves, rests] = seen(0.0);
        assert!(moves < 0.001 && rests > 0.85, "{moves} {rests}");
        let [moves, rests] = seen(0.05);
        assert!(moves > 0.85 && rests < 0.001, "{moves} {rests}");
    }

    #[test]
    fn without_an_imprint_nothing_is_known() {
        let mut camera = MotionCamera::new(1);
        for picture in 0..10 {
            assert_eq!(camera.look(f64::from(picture), false), Motion::UNKNOWN);
        }
        assert_eq!(camera.look(0.0, true), Motion::UNKNOWN);
    }
}
