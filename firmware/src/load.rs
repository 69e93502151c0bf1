//! The tangential load on a contact from map to map: shear force and torsional moment together, over the normal force. It is more
//! informative than the ratios in one map.
//!
//! When the load on a slipping contact falls or turns back, every taxel sticks at once (Cattaneo 1938, Mindlin and
//! Deresiewicz 1953), while the ratios in the map stay near friction until the load is gone. From then on friction is known:
//! μ is the share that slid. On a fresh contact with normal force N half still sticks at a load Q = h μN, where h depends on
//! the contact geometry. After a slide under Q₀ = μN, half slips again when the load has turned back by 2 h μN, or when it
//! reaches Q₀ again. Both are one rule: half of the contact slips once the load is further than h μN from a centre. The centre
//! is 0 at first and (1 − h) Q₀ after the slide. Nearer than that, half or more sticks, whatever the ratios in the map say.
//!
//! Units: forces 1/4096 N, moments 1/4096 N times half taxel pitches, shares of the normal force 2⁻¹⁴, times as named.
//! Limits: friction that falls when sliding begins looks like a falling load until the peak is forgotten.

use gripline_protocol::message::MapSums;

use crate::arithmetic::{divide, narrowed, square_root};
use crate::clock::HostMicros;
use crate::constants::{CENTRE_AND_HALF_64THS, FALL_PART, PEAK_SHIFT};
use crate::contact_geometry::ContactGeometry;

/// A share of 1.
const SHARE_SHIFT: u32 = 14;
/// Fraction bits of the peak, so that it decays at a thousand maps a second too.
const PEAK_FRACTION: u32 = 8;
/// Upper limit of a map's moment: 400 taxels of 2¹⁵ at a distance of 27 half pitches.
const MOMENT_MAX: i64 = 1 << 29;
/// Squares of loads saturate here; no map has more force.
const SQUARE_MAX: u64 = 1 << 51;

/// The tangential load of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Load {
    /// Σ fx, Σ fy.
    force: [i32; 2],
    /// Moment about the centre of pressure.
    moment: i32,
    /// At least 1.
    normal: u32,
    /// Load over normal force.
    share: u16,
}

impl Load {
    /// The load of a map in contact. Moments count as 0 until the contact's RMS radius is known.
    pub(crate) fn of(sums: &MapSums, geometry: &ContactGeometry) -> Self {
        let [x, y, z] = sums.force;
        let normal = z.max(1).cast_unsigned();
        let (divisor, shift) = narrowed(z);
        let moment = torsional_moment(sums);
        let load = square_root(square([x, y], moment, geometry));
        // One division of 32 bits: below four times the normal force, what is divided is below 2³².
        let share = if load >> 2 >= normal {
            u32::from(u16::MAX)
        } else {
            ((u64::from(load) << SHARE_SHIFT) >> shift) as u32 / u32::from(divisor)
        };
        Self {
            force: [x, y],
            moment,
            normal,
            share: share.min(u16::MAX.into()) as u16,
        }
    }
}

/// Torsional moment: the moment of a map about its centre of pressure, 1/4096 N times half taxel pitches, at most ±2²⁹.
pub(crate) fn torsional_moment(sums: &MapSums) -> i32 {
    let [x, y, normal] = sums.force;
    let (divisor, shift) = narrowed(normal);
    // At most 2 · 2²⁸ · 2²⁴.
    let [across, along] = sums.first_moment.map(i64::from);
    let lever = across * i64::from(y) - along * i64::from(x);
    let of_centre = divide(lever.unsigned_abs() >> shift, divisor).cast_signed() * lever.signum();
    (i64::from(sums.moment) - of_centre).clamp(-MOMENT_MAX, MOMENT_MAX) as i32
}

/// Square of force and moment as one force. Not inlined, to save SRAM.
#[inline(never)]
fn square([x, y]: [i32; 2], moment: i32, geometry: &ContactGeometry) -> u64 {
    let [x, y] = [x, y].map(|part| u64::from(part.unsigned_abs()).pow(2));
    (x + y)
        .saturating_add(geometry.square_of_moment(moment))
        .min(SQUARE_MAX)
}

/// The loads of a contact so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct LoadHistory {
    /// Recent peak of the share, with fraction bits.
    peak: u32,
    /// Capture time of the last map.
    at: HostMicros,
    /// The load at which the contact is furthest from half slip.
    centre: [i32; 2],
    centre_moment: i32,
    /// Friction: share of the load that last slid, as it began to fall; 0 before the first slide.
    friction: u16,
}

impl LoadHistory {
    /// Before the first map.
    pub(crate) const fn new() -> Self {
        Self {
            peak: 0,
            at: HostMicros(0),
            centre: [0; 2],
            centre_moment: 0,
            friction: 0,
        }
    }

    /// Takes the load of a new map. Returns whether the load falls.
    pub(crate) fn push(&mut self, load: &Load, capture: HostMicros) -> bool {
        let share = u32::from(load.share) << PEAK_FRACTION;
        let passed_us = capture.since(self.at).min(1 << PEAK_SHIFT);
        self.at = capture;
        let above = self.peak.saturating_sub(share);
        let forgotten = (u64::from(above) * u64::from(passed_us)) >> PEAK_SHIFT;
        self.peak = (share + above) - forgotten as u32;
        (self.peak - share) * FALL_PART > self.peak
    }

    /// Notes that the contact slid and its load now falls.
    pub(crate) fn note_slid(&mut self, load: &Load, geometry: &ContactGeometry) {
        let share = CENTRE_AND_HALF_64THS - i32::from(geometry.half_64ths());
        // No component of a load exceeds 2²⁹.
        let centre = |part: i32| (part >> 6) * share;
        self.centre = load.force.map(centre);
        self.centre_moment = centre(load.moment);
        self.friction = load.share;
    }

    /// Whether the contact slid.
    pub(crate) const fn has_slid(&self) -> bool {
        self.friction > 0
    }

    /// Whether half of the contact slips under this load; `None` before the first slide.
    pub(crate) fn is_half_slipping(&self, load: &Load, geometry: &ContactGeometry) -> Option<bool> {
        if !self.has_slid() {
            return None;
        }
        let ([x, y], [x0, y0]) = (load.force, self.centre);
        let distance = square([x - x0, y - y0], load.moment - self.centre_moment, geometry);
        // At most 2²⁴ · 2¹⁶ · 58, so the limit is below 2²⁶.
        let limit = (u64::from(load.normal) * u64::from(self.friction) * u64::from(geometry.half_64ths()))
            >> (SHARE_SHIFT + 6);
        Some(distance > limit * limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sums(x: i32, y: i32, z: i32, moment: i32) -> MapSums {
        MapSums {
            contact: 20,
            stick: 20,
            force: [x, y, z],
            moment,
            ..MapSums::default()
        }
    }

    /// A round contact of 20 taxels: its mean square radius is 10 half pitches squared.
    fn round() -> ContactGeometry {
        let mut geometry = ContactGeometry::new();
        geometry.observe(&sums(0, 0, 10_000, 0), true);
        geometry
    }

    /// A contact of 20 taxels in the middle under these forces, 1/4096 N, and this moment.
    fn load(x: i32, y: i32, z: i32, moment: i32) -> Load {
        Load::of(&sums(x, y, z, moment), &round())
    }

    #[test]
    fn the_share_is_load_over_normal_force_and_a_moment_counts_at_its_lever() {
        assert_eq!(load(300, -400, 1_000, 0).share, 8_192);
        assert_eq!(load(3_000_000, 4_000_000, 10_000_000, 0).share, 8_192);
        // √(18/160) of 10,000 half pitches.
        assert_eq!(load(0, 0, 10_000, 10_000).share, 5_495);
        assert_eq!(load(1, 0, -5, 0).share, 16_384);
    }

    #[test]
    fn the_place_of_a_pull_on_the_map_makes_no_torsional_moment() {
        let at = |column: i32, row: i32| {
            Load::of(
                &MapSums {
                    contact: 20,
                    stick: 20,
                    force: [3_000, -1_000, 70_000],
                    moment: column * -1_000 - row * 3_000,
                    first_moment: [column * 70_000, row * 70_000],
                    ..MapSums::default()
                },
                &round(),
            )
        };
        for (column, row) in [(0, 0), (19, -19), (-7, 12)] {
            // The divisor of 16 bits costs 2⁻¹⁵ of the moment.
            assert!(at(column, row).moment.abs() <= 4, "{:?}", at(column, row));
        }
    }

    #[test]
    fn a_load_that_only_fluctuates_does_not_fall_and_one_that_is_let_go_does() {
        let mut history = LoadHistory::new();
        let mut capture = HostMicros(4_294_900_000);
        let mut push = |share: i32| {
            capture = capture.later_by(16_667);
            history.push(&load(share, 0, 10_000, 0), capture)
        };
        for share in [1_000, 3_000, 5_000, 6_000, 5_800, 6_000, 5_700, 5_900] {
            assert!(!push(share), "{share}");
        }
        for share in [5_200, 4_000, 2_500, 1_500, 900] {
            assert!(push(share), "{share}");
        }
    }

    #[test]
    fn a_drop_of_friction_looks_like_a_falling_load_for_a_tenth_of_a_second_at_every_rate() {
        for rate_hz in [60, 200, 1_000] {
            let mut history = LoadHistory::new();
            let mut falling = 0;
            for map in 0..rate_hz {
                let share = if map < rate_hz / 2 { 6_000 } else { 4_800 };
                let capture = HostMicros(map as u32 * (1_000_000 / rate_hz as u32));
                falling += i32::from(history.push(&load(share, 0, 10_000, 0), capture));
            }
            let falling_ms = falling * 1_000 / rate_hz;
            assert!((50..=110).contains(&falling_ms), "{rate_hz} Hz: {falling_ms} ms");
        }
    }

    #[test]
    fn after_a_slide_the_other_way_slips_early_and_the_same_way_late() {
        let mut history = LoadHistory::new();
        let half_slips = |history: &LoadHistory, load: Load| history.is_half_slipping(&load, &round());
        assert_eq!(half_slips(&history, load(-9_000, 0, 10_000, 0)), None);
        history.note_slid(&load(6_000, 0, 10_000, 0), &round());
        for (x, y, slips) in [
            (6_400, 0, true),
            (6_100, 0, false),
            (0, 0, false),
            (-1_800, 0, false),
            (-2_000, 0, true),
            (0, 3_300, false),
            (0, 3_500, true),
        ] {
            assert_eq!(
                half_slips(&history, load(x, y, 10_000, 0)),
                Some(slips),
                "{x} {y}"
            );
        }
        // Twice the grip holds twice the distance.
        assert_eq!(half_slips(&history, load(-5_500, 0, 20_000, 0)), Some(false));
    }

    #[test]
    fn a_moment_turns_back_as_a_force_does() {
        let mut history = LoadHistory::new();
        history.note_slid(&load(0, 0, 10_000, 20_000), &round());
        for (moment, slips) in [(-6_000, false), (-6_500, true)] {
            let back = load(0, 0, 10_000, moment);
            assert_eq!(history.is_half_slipping(&back, &round()), Some(slips), "{moment}");
        }
    }

    proptest! {
        #[test]
        fn no_map_is_too_much(contact in 1_u16..=400, x in -(400 << 15)..=400 << 15, y in -(400 << 15)..=400 << 15,
                              z in -(400 << 15)..=400 << 15, moment: i32, second_moment: i32, first_moment in [-(19 * 400) << 15..=(19 * 400) << 15, -(19 * 400) << 15..=(19 * 400) << 15]) {
            let sums = MapSums { contact, stick: 0, force: [x, y, z], moment, first_moment, second_moment };
            let mut geometry = ContactGeometry::new();
            geometry.observe(&sums, true);
            let load = Load::of(&sums, &geometry);
            let mut history = LoadHistory::new();
            history.note_slid(&load, &geometry);
            let back = Load::of(&MapSums { force: [-x, -y, z], moment: moment.saturating_neg(), ..sums }, &geometry);
            let exact = {
                let sides = [x, y].map(|side| f64::from(side).powi(2));
                let moment = geometry.square_of_moment(load.moment) as f64;
                (16_384.0 * (sides[0] + sides[1] + moment).sqrt() / f64::from(z.max(1))).min(65_535.0)
            };
            prop_assert!((f64::from(load.share) - exact).abs() <= 2.0 + exact * 1e-4 + 16_384.0 / f64::from(z.max(1)) || exact > 30_000.0, "{} {exact}", load.share);
            history.is_half_slipping(&back, &geometry);
            prop_assert!(!history.push(&load, HostMicros(7)));
        }
    }
}
