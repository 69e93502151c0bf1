//! The geometry of a contact: round, line or flat. A round contact grows with the normal force; a line or a flat end has its
//! full length from the start. The geometry converts a torsional moment to an equivalent force, and says at which load half
//! of the contact slips.
//!
//! A contact under the force P that sticks only where the contact of a smaller force P* would be carries the shear μ(P − P*)
//! (Jäger 1998, Ciavarella 1998, for any geometry). So half of it slips at 1 − P*/P, where P* has half of the area: 0.646
//! between spheres and ellipsoids, 0.75 for a line, towards 1 for a flat end.
//!
//! Units: forces 1/4096 N, RMS radius squared 1/16 of half a taxel pitch squared. Limits: three geometries; a contact whose
//! beginning was not seen counts as round.

use gripline_protocol::message::MapSums;

use crate::arithmetic::{divide, narrowed};
use crate::constants::{
    BLUR_MEAN_SQUARE, FLAT_64THS, HALF_FLAT_64THS, HALF_LINE_64THS, HALF_ROUND_64THS, LINE_16THS,
    ROUND_64THS, SEEN_MOMENT,
};

/// Share of the largest normal force by which the force must grow before the kind is decided again.
const GROWTH_PART: u32 = 16;
/// Fraction bits of the mean square radius.
const MEAN_SQUARE_FRACTION: u32 = 4;
/// Upper limit of the mean square radius: every taxel is within 19 half pitches both ways.
const MEAN_SQUARE_MAX: u64 = 16 * 2 * 19 * 19;

/// The kind of a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Kind {
    /// It grows in all directions with the force.
    #[default]
    Round,
    /// Long and narrow.
    Line,
    /// As wide as long, at full size from the start.
    Flat,
}

/// The geometry of a contact, as observed so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct ContactGeometry {
    /// The largest normal force so far.
    normal: u32,
    /// Σ RMS radius times growth of the normal force up to there, over 64.
    grown: u32,
    /// Square of the RMS radius: mean square distance of the pressure from its centre; 0 before the first map.
    mean_square: u16,
    kind: Kind,
}

impl ContactGeometry {
    /// Before the first map.
    pub(crate) const fn new() -> Self {
        Self {
            normal: 0,
            grown: 0,
            mean_square: 0,
            kind: Kind::Round,
        }
    }

    /// Takes a map in contact. Only a sticking contact tells its kind: near the friction limit the normal force in the map
    /// changes, and a contact that slid is at another place.
    pub(crate) fn observe(&mut self, sums: &MapSums, sticks: bool) {
        let normal = sums.force[2].max(1).cast_unsigned();
        // On this many taxels a disc has the smallest RMS radius.
        let min = 8 * u64::from(sums.contact);
        let mean_square = mean_square_radius(sums, MEAN_SQUARE_FRACTION)
            .max(min)
            .min(MEAN_SQUARE_MAX);
        self.mean_square = mean_square as u16;
        // Less is fluctuation.
        if sticks && normal > self.normal + self.normal / GROWTH_PART {
            let whole = (mean_square * u64::from(normal)) >> 6;
            let seen = self.normal > 0;
            let more = (mean_square * u64::from(normal - self.normal)) >> 6;
            let grown = if seen {
                u64::from(self.grown) + more
            } else {
                more * ROUND_64THS / 64
            };
            self.normal = normal;
            // At most the largest RMS radius at the largest force: 11,552 · 2²⁴ / 64.
            self.grown = grown as u32;
            self.kind = if grown * 64 <= whole * FLAT_64THS {
                Kind::Round
            } else if mean_square as u32 >= LINE_16THS * u32::from(sums.contact) {
                Kind::Line
            } else {
                Kind::Flat
            };
        }
    }

    /// Square of the force that is equivalent to a torsional moment. Every geometry holds a moment of about 0.93 of its RMS radius
    /// times the force that it holds (a disc with even pressure 0.94, a sphere 0.93, a line 0.87).
    pub(crate) fn square_of_moment(&self, moment: i32) -> u64 {
        // At most 18 · (86/64 · 2²⁹)²: the difference of two loads, each up to 2²⁹.
        divide(18 * u64::from(moment.unsigned_abs()).pow(2), self.mean_square)
    }

    /// The same for a moment as maps show it, for the force that the grip must hold. Maps blur: that widens the RMS radius of every
    /// contact by the same amount. They also lose the contact's edge, and with it more of a moment than of a force.
    pub(crate) fn square_of_seen_moment(&self, moment: i32) -> u64 {
        let moment = u64::from(moment.unsigned_abs().min(1 << 25));
        let mean_square = self
            .mean_square
            .saturating_sub(BLUR_MEAN_SQUARE)
            .max(self.mean_square / 4);
        divide(SEEN_MOMENT * moment * moment, mean_square.max(1))
    }

    /// Distance of a load from its centre at which half of the contact slips, over the friction limit, in 64ths.
    pub(crate) const fn half_64ths(&self) -> u8 {
        match self.kind {
            Kind::Round => HALF_ROUND_64THS,
            Kind::Line => HALF_LINE_64THS,
            Kind::Flat => HALF_FLAT_64THS,
        }
    }
}

/// Mean square distance of the pressure from its centre, half taxel pitches squared with this many fraction bits, at most 28; 0 if
/// tension exceeds it. Normal forces of 2¹⁶ and more are reduced to 16 bits.
pub(crate) fn mean_square_radius(sums: &MapSums, fraction: u32) -> u64 {
    let normal = i64::from(sums.force[2].max(1));
    let [across, along] = sums.first_moment.map(|sum| i64::from(sum).pow(2));
    // N² times it, exactly: at most 2 · 2³¹ · 2²⁴, and 2 · 2⁵⁶.
    let about_centre = 2 * i64::from(sums.second_moment) * normal - across - along;
    let (divisor, shift) = narrowed(sums.force[2]);
    let once = divide(about_centre.max(0).cast_unsigned() >> shift, divisor);
    divide((once << fraction) >> shift, divisor)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;
    use proptest::prelude::*;

    /// A contact in the middle: so many taxels, pressure of this many N, its mean square radius in half pitches squared.
    fn pressed(area: f64, normal_n: f64, mean_square: f64) -> MapSums {
        let normal = 4_096.0 * normal_n;
        MapSums {
            contact: area as u16,
            stick: area as u16,
            force: [0, 0, normal as i32],
            second_moment: (mean_square * normal / 2.0) as i32,
            ..MapSums::default()
        }
    }

    /// The geometry after normal forces in steps up to 3 N. `at` gives area (taxels of four square half pitches) and RMS radius
    /// from the share of the largest force.
    fn observed(first: i32, at: impl Fn(f64) -> [f64; 2]) -> ContactGeometry {
        let mut geometry = ContactGeometry::new();
        for step in first..=40 {
            let share = f64::from(step) / 40.0;
            let [area, mean_square] = at(share);
            geometry.observe(&pressed(area, 3.0 * share, mean_square), true);
        }
        geometry
    }

    /// An ellipsoid (Hertz): axes 5 · `longer` and 5 half pitches at the largest force.
    fn ellipsoid(longer: f64) -> impl Fn(f64) -> [f64; 2] {
        move |share| {
            let square = 25.0 * share.powf(2.0 / 3.0);
            [PI / 4.0 * square * longer, square * (1.0 + longer * longer) / 5.0]
        }
    }

    /// A cylinder 16 half pitches long, 3 wide to each side at the largest force.
    fn cylinder(share: f64) -> [f64; 2] {
        let half_width = 3.0 * share.sqrt();
        [
            16.0 * half_width / 2.0,
            16.0_f64.powi(2) / 12.0 + half_width.powi(2) / 4.0,
        ]
    }

    /// A square end of 8 half pitches whose rounded edges press less than its middle.
    fn square_end(share: f64) -> [f64; 2] {
        let side = 8.0 + 1.5 * share.sqrt();
        [side * side / 4.0, side * side / 7.0]
    }

    #[test]
    fn a_contact_that_grows_is_round_and_one_that_was_wide_before_is_a_line_or_flat() {
        for (longer, name) in [(1.0, "sphere"), (1.3, "egg"), (2.0, "long ellipsoid")] {
            assert_eq!(observed(1, ellipsoid(longer)).kind, Kind::Round, "{name}");
        }
        assert_eq!(observed(1, cylinder).kind, Kind::Line);
        assert_eq!(observed(1, square_end).kind, Kind::Flat);
    }

    #[test]
    fn a_contact_whose_beginning_nobody_saw_counts_as_round() {
        assert_eq!(observed(40, square_end).kind, Kind::Round);
        assert_eq!(observed(36, cylinder).kind, Kind::Round);
    }

    #[test]
    fn the_kind_stays_when_the_normal_force_falls() {
        let mut geometry = observed(1, square_end);
        for step in (1..40).rev() {
            let share = f64::from(step) / 40.0;
            let [area, mean_square] = ellipsoid(1.0)(share);
            geometry.observe(&pressed(area, 3.0 * share, mean_square), true);
        }
        assert_eq!(geometry.kind, Kind::Flat);
    }

    #[test]
    fn a_force_that_grows_while_it_slips_or_by_little_does_not_change_the_kind() {
        let [area, mean_square] = ellipsoid(1.0)(1.0);
        let kind = |sticks: bool, normal_n: f64| {
            let mut geometry = observed(1, ellipsoid(1.0));
            geometry.observe(&pressed(area, normal_n, mean_square / 4.0), sticks);
            geometry.kind
        };
        assert_eq!(
            [kind(false, 6.0), kind(true, 3.1), kind(true, 6.0)],
            [Kind::Round, Kind::Round, Kind::Flat]
        );
    }

    #[test]
    fn half_of_a_line_slips_later_than_half_of_a_round_contact_and_half_of_a_flat_one_later_still() {
        let [round, line, flat] = [
            observed(1, ellipsoid(1.0)),
            observed(1, cylinder),
            observed(1, square_end),
        ]
        .map(|geometry| geometry.half_64ths());
        assert!(round < line && line < flat && flat < 64, "{round} {line} {flat}");
    }

    /// Friction holds a moment of ∫ r μp dA and a force of ∫ μp dA.
    #[test]
    fn a_moment_that_slides_is_the_force_that_slides() {
        let normal = 4_096.0 * 3.0;
        for (name, mean_square, lever, area) in [
            ("even disc, radius 6", 18.0, 4.0, 9.0 * PI),
            ("sphere, radius 6", 0.4 * 36.0, 3.0 * PI / 16.0 * 6.0, 9.0 * PI),
            ("line, 20 long", 400.0 / 12.0, 5.0, 20.0),
        ] {
            let mut geometry = ContactGeometry::new();
            geometry.observe(&pressed(area, 3.0, mean_square), true);
            let force = (geometry.square_of_moment((lever * normal) as i32) as f64).sqrt();
            assert!((force / normal - 1.0).abs() < 0.09, "{name}: {}", force / normal);
        }
    }

    proptest! {
        #[test]
        fn the_mean_square_radius_is_about_the_centre_of_pressure(taxels in proptest::collection::vec((0..20_i32, 0..20_i32, 1..30_000_i32), 1..60)) {
            let mut sums = MapSums::default();
            for &(column, row, z) in &taxels {
                let (x, y) = (2 * column - 19, 2 * row - 19);
                sums.force[2] += z;
                sums.first_moment[0] += x * z;
                sums.first_moment[1] += y * z;
                sums.second_moment += z * (x * x + y * y) / 2;
            }
            let normal: f64 = taxels.iter().map(|taxel| f64::from(taxel.2)).sum();
            let mean = |of: &dyn Fn(f64, f64) -> f64| {
                taxels.iter().map(|&(x, y, z)| of(f64::from(2 * x - 19), f64::from(2 * y - 19)) * f64::from(z)).sum::<f64>() / normal
            };
            let centre = [mean(&|x, _| x), mean(&|_, y| y)];
            let right = 16.0 * mean(&|x, y| (x - centre[0]).powi(2) + (y - centre[1]).powi(2));
            let found = mean_square_radius(&sums, MEAN_SQUARE_FRACTION) as f64;
            prop_assert!((found - right).abs() <= 1.5 + 1e-4 * right, "{found} {right}");
        }
    }
}
