//! Whether a map changes although its load does not: a witness of slip that needs no friction.
//!
//! A sliding contact sticks and slips in places, which rearranges its pressure from map to map. A moving arm shakes the load: that
//! changes forces, moments and the centre of pressure, but hardly the RMS radius of the pressure about that centre. So the witness
//! uses second differences of the RMS radius; then steady growth under a rising grip does not count. Every sensor has its own
//! noise, so the unrest is compared with the usual one of this contact.
//!
//! On three trials of two uSkin fingers (`gripline evaluate real`) it detects slip better than the change of the whole map, and
//! needs no work per taxel.
//!
//! Units: shares of the RMS radius 2⁻²⁴, logarithms to base 2 in 2⁻¹⁶, time µs. Limits: a slide without stick-slip shows nothing; at
//! more than 100 maps a second only some of the maps count.

use gripline_protocol::message::MapSums;

use crate::clock::HostMicros;
use crate::constants::{NEW_UNREST_SHIFT, UNREST_SAMPLE_US, UNREST_SHIFT, USUAL_UNREST, USUAL_UNREST_SHIFT};
use crate::contact_geometry::mean_square_radius;

/// Fraction bits of the mean square radius.
const MEAN_SQUARE_FRACTION: u32 = 16;
/// Maps of a new contact.
const NEW_MAPS: u8 = 60;
/// Longest time between two maps of one series, µs.
const GAP_US: u32 = 1 << 17;
/// Maps before there is a second difference, and two more until a first touch is over.
const FILLED: u8 = 4;

/// The witness of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Unrest {
    /// Square of the RMS radius in the last two maps that counted, newest first, and the newest's sums that it was computed from.
    mean_square: [u32; 2],
    normal: i32,
    filled: u8,
    /// Capture time of the newest of them.
    at: HostMicros,
    /// Mean second difference over the mean square radius.
    now: u32,
    /// Logarithm of the usual unrest.
    usual: i32,
}

impl Default for Unrest {
    fn default() -> Self {
        Self::new()
    }
}

impl Unrest {
    /// Before the first map.
    pub(crate) const fn new() -> Self {
        Self {
            mean_square: [0; 2],
            normal: 0,
            filled: 0,
            at: HostMicros(0),
            now: 0,
            usual: USUAL_UNREST,
        }
    }

    /// Takes a map in contact.
    pub(crate) fn observe(&mut self, sums: &MapSums, capture: HostMicros) {
        let passed_us = capture.since(self.at);
        let is_first = self.filled == 0;
        if !is_first && passed_us < UNREST_SAMPLE_US {
            return;
        }
        let mean_square =
            mean_square_radius(sums, MEAN_SQUARE_FRACTION).clamp(1, u64::from(u32::MAX >> 2)) as u32;
        let [last, before] = self.mean_square;
        let is_same = mean_square == last && sums.force[2] == self.normal;
        self.at = capture;
        if is_same && !is_first {
            // The picture before, sent again: it says nothing of noise or motion.
            return;
        }
        self.mean_square = [mean_square, last];
        self.normal = sums.force[2];
        self.filled = self.filled.saturating_add(1);
        if passed_us > GAP_US {
            self.filled = 1;
        }
        if self.filled < FILLED {
            return;
        }
        let (mean_square, last, before) = (i64::from(mean_square), i64::from(last), i64::from(before));
        let difference = (mean_square - 2 * last + before).unsigned_abs() as u32;
        let share = share(difference, mean_square as u32);
        let passed_us = i64::from(passed_us);
        let step = ((i64::from(share) - i64::from(self.now)) * passed_us) >> UNREST_SHIFT;
        self.now = (i64::from(self.now) + step) as u32;
        let more = i64::from(logarithm(self.now) - self.usual) * passed_us;
        // At first quickly: what was assumed knows nothing of this sensor.
        let shift = if self.filled < NEW_MAPS {
            NEW_UNREST_SHIFT
        } else {
            USUAL_UNREST_SHIFT
        };
        self.usual += (more >> shift) as i32;
    }

    /// Logarithm to base 2 of the unrest over the usual one, 2⁻¹⁶; `None` before there is any.
    pub(crate) fn above_usual(&self) -> Option<i32> {
        (self.filled >= FILLED).then(|| logarithm(self.now) - self.usual)
    }
}

/// `difference` over `mean_square` in 2⁻²⁴, at most 1, to 8 places.
fn share(difference: u32, mean_square: u32) -> u32 {
    // The quotient of 32 bits keeps what the shorter of both has room for.
    let room = difference.max(1).leading_zeros().min(24);
    let lost = 24 - room;
    ((difference << room) / (mean_square >> lost).max(1)).min(1 << 24)
}

/// Logarithm to base 2 in 2⁻¹⁶, the places after the point by a straight line (0.09 too little at most); −1 for 0.
fn logarithm(number: u32) -> i32 {
    if number == 0 {
        return -(1 << 16);
    }
    let zeros = number.leading_zeros();
    let whole = 31 - zeros;
    let below = (number << zeros << 1) >> 16;
    (whole << 16 | below).cast_signed()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A contact of 1 N whose pressure has this mean square radius, half taxel pitches squared.
    fn sums(normal: i32, mean_square: f64) -> MapSums {
        MapSums {
            contact: 20,
            stick: 20,
            force: [0, 0, normal],
            second_moment: (mean_square * f64::from(normal) / 2.0).round() as i32,
            ..MapSums::default()
        }
    }

    /// Unrest above the usual after ten seconds of `before` and half a second of `then`, in octaves.
    fn after(before: impl Fn(u32) -> (i32, f64), then: impl Fn(u32) -> (i32, f64)) -> f64 {
        let mut unrest = Unrest::new();
        for map in 0..630 {
            let (normal, mean_square) = if map < 600 { before(map) } else { then(map) };
            unrest.observe(
                &sums(normal, mean_square),
                HostMicros((map * 16_667).wrapping_sub(1_000_000)),
            );
        }
        f64::from(unrest.above_usual().unwrap()) / 65_536.0
    }

    /// Noise of this size around 10 half pitches squared.
    fn noise(share: f64) -> impl Fn(u32) -> (i32, f64) {
        move |map| {
            let hash = map.wrapping_mul(2_654_435_761) >> 8;
            (
                400_000,
                10.0 * (1.0 + share * (f64::from(hash % 1_000) / 500.0 - 1.0)),
            )
        }
    }

    #[test]
    fn noise_that_stays_as_it_was_is_usual_and_three_times_as_much_is_not() {
        for share in [0.002, 0.02, 0.05] {
            let same = after(noise(share), noise(share));
            assert!(same.abs() < 0.8, "{share}: {same}");
            let more = after(noise(share), noise(3.0 * share));
            assert!(more > 0.9 && more > same + 0.8, "{share}: {more}");
        }
    }

    #[test]
    fn a_reach_that_grows_evenly_and_a_load_that_swings_are_no_unrest() {
        let grows = |map: u32| {
            let (normal, mean_square) = noise(0.01)(map);
            (normal, mean_square * (1.0 + f64::from(map - 600) / 30.0))
        };
        assert!(after(noise(0.01), grows) < 0.8);
        let swings = |map: u32| {
            let (normal, mean_square) = noise(0.01)(map);
            (normal + 100_000 * (i32::from(map.is_multiple_of(2))), mean_square)
        };
        assert!(after(noise(0.01), swings) < 0.8);
    }

    #[test]
    fn a_picture_that_is_sent_again_says_nothing() {
        let again = |map: u32| noise(0.02)(599.min(map));
        let (same, moved) = (after(noise(0.02), noise(0.02)), after(noise(0.02), again));
        assert!((moved - same).abs() < 0.8, "{moved} {same}");
    }

    proptest! {
        #[test]
        fn the_share_is_the_quotient(difference in 0_u32..1 << 31, mean_square in 1_u32..1 << 30) {
            let exact = (f64::from(difference) / f64::from(mean_square) * 16_777_216.0).min(16_777_216.0);
            let found = f64::from(share(difference, mean_square));
            // What is shifted out of a small mean square radius only counts where the share is above 1 in any case.
            prop_assert!((found - exact).abs() <= 2.0 + exact / 64.0, "{found} {exact}");
        }

        #[test]
        fn the_logarithm_is_off_by_a_tenth(number in 1_u32..) {
            let off = f64::from(logarithm(number)) / 65_536.0 - f64::from(number).log2();
            prop_assert!((-0.09..=1e-3).contains(&off), "{off}");
        }

        #[test]
        fn no_map_is_too_much(maps in proptest::collection::vec((any::<i32>(), any::<[i32; 2]>(), any::<i32>(), any::<u32>()), 8)) {
            let mut unrest = Unrest::new();
            for (second_moment, first_moment, normal, capture_us) in maps {
                let force = [0, 0, normal >> 7];
                unrest.observe(&MapSums { contact: 1, second_moment, first_moment: first_moment.map(|part| part >> 3), force, ..MapSums::default() }, HostMicros(capture_us));
                unrest.above_usual();
            }
        }
    }
}
