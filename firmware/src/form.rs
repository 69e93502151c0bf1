//! What form a contact has, told from how far its pressure reaches and how that grows with the force that presses: a round one
//! grows, a line or a flat end was as long before. By the form a twist becomes a force, and half of the contact slips at
//! another part of what friction holds.
//!
//! The shear that friction allows under a force P on a contact that slips to where the contact of a smaller force P* ends is
//! μ(P − P*) (Jäger 1998, Ciavarella 1998, for any form): so half of it slips at 1 − P*/P where P* has half of the area,
//! 0.646 between spheres and ellipsoids, 0.75 for a line, towards 1 for a flat end.
//!
//! Units: forces 1/4096 N, reach squared 1/16 of half a taxel pitch squared. Limits: three forms; a contact that nobody saw
//! begin counts as round.

use gripline_protocol::message::MapSums;

use crate::constants::{
    BLUR_REACH, FLAT_64THS, HALF_FLAT_64THS, HALF_LINE_64THS, HALF_ROUND_64THS, LINE_16THS, ROUND_64THS,
    SEEN_TWIST,
};
use crate::divide::divide;
use crate::load::narrowed;

/// What part of the largest normal force must be new for a look at the form.
const GROWTH_PART: u32 = 16;
/// Most that pressure on a map reaches, squared: every taxel is within 19 half pitches both ways.
const REACH_MOST: u64 = 16 * 2 * 19 * 19;

/// What kind of contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Kind {
    /// It grows every way as it is pressed.
    #[default]
    Round,
    /// Long and narrow.
    Line,
    /// As wide as long, and so from the first.
    Flat,
}

/// The form of a contact, as far as it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Form {
    /// The largest normal force so far.
    normal: u32,
    /// Reach times growth of the normal force up to there, in 64.
    grown: u32,
    /// Mean square of the pressure's distance from its centre; 0 before the first map.
    reach: u16,
    kind: Kind,
}

impl Form {
    /// Nothing was seen.
    pub(crate) const fn new() -> Self {
        Self {
            normal: 0,
            grown: 0,
            reach: 0,
            kind: Kind::Round,
        }
    }

    /// Takes a map in contact. Only what presses and sticks tells the kind: under a load near friction's bound the normal
    /// force in a map is not what it was, and what slid is at another place.
    pub(crate) fn observe(&mut self, sums: &MapSums, sticks: bool) {
        let normal = sums.force[2].max(1).cast_unsigned();
        // No pressure on so many taxels is nearer together than on a disc.
        let least = 8 * u64::from(sums.contact);
        let reach = reach(sums).max(least).min(REACH_MOST);
        self.reach = reach as u16;
        // Less is the unrest of what presses.
        if sticks && normal > self.normal + self.normal / GROWTH_PART {
            let whole = (reach * u64::from(normal)) >> 6;
            let seen = self.normal > 0;
            let more = (reach * u64::from(normal - self.normal)) >> 6;
            let grown = if seen {
                u64::from(self.grown) + more
            } else {
                more * ROUND_64THS / 64
            };
            self.normal = normal;
            // At most the most reach at the most force: 11,552 · 2²⁴ / 64.
            self.grown = grown as u32;
            self.kind = if grown * 64 <= whole * FLAT_64THS {
                Kind::Round
            } else if reach as u32 >= LINE_16THS * u32::from(sums.contact) {
                Kind::Line
            } else {
                Kind::Flat
            };
        }
    }

    /// Square of a twist as that of a force: all forms hold a twist of about 0.93 of their reach times the force that they
    /// hold (a disc pressed evenly 0.94, a sphere 0.93, a line 0.87).
    pub(crate) fn square_of_twist(&self, twist: i32) -> u64 {
        // At most 18 · (86/64 · 2²⁹)²: a load is at most a third of another further.
        divide(18 * u64::from(twist.unsigned_abs()).pow(2), self.reach)
    }

    /// The same of a twist as maps show it, for what the grip must hold: maps blur, which widens what is seen to reach by as
    /// much for every contact, and lose more of a twist than of a force, as they lose the contact's edge.
    pub(crate) fn square_of_seen_twist(&self, twist: i32) -> u64 {
        let twist = u64::from(twist.unsigned_abs().min(1 << 25));
        let reach = self.reach.saturating_sub(BLUR_REACH).max(self.reach / 4);
        divide(SEEN_TWIST * twist * twist, reach.max(1))
    }

    /// How far from its centre a load is when half of the contact slips, over what friction holds, in 64ths.
    pub(crate) const fn half_64ths(&self) -> u8 {
        match self.kind {
            Kind::Round => HALF_ROUND_64THS,
            Kind::Line => HALF_LINE_64THS,
            Kind::Flat => HALF_FLAT_64THS,
        }
    }
}

/// Mean square of the pressure's distance from its centre; 0 where pulls outweigh it.
fn reach(sums: &MapSums) -> u64 {
    let normal = i64::from(sums.force[2].max(1));
    let [across, along] = sums.pressure.map(|sum| i64::from(sum).pow(2));
    // N² times it, exactly: at most 2 · 2³¹ · 2²⁴, and 2 · 2⁵⁶.
    let about_centre = 2 * i64::from(sums.spread) * normal - across - along;
    let (divisor, shift) = narrowed(sums.force[2]);
    let once = divide(about_centre.max(0).cast_unsigned() >> shift, divisor);
    divide((once << 4) >> shift, divisor)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;
    use proptest::prelude::*;

    /// A contact in the middle: so many taxels, pressure of so many N, its mean square reach in half pitches squared.
    fn pressed(area: f64, normal_n: f64, reach: f64) -> MapSums {
        let normal = 4_096.0 * normal_n;
        MapSums {
            contact: area as u16,
            stick: area as u16,
            force: [0, 0, normal as i32],
            spread: (reach * normal / 2.0) as i32,
            ..MapSums::default()
        }
    }

    /// What is told of a form that is pressed in steps up to 3 N; `at` gives area in taxels of four square half pitches, and
    /// reach, from the force over the most.
    fn told(first: i32, at: impl Fn(f64) -> [f64; 2]) -> Form {
        let mut form = Form::new();
        for step in first..=40 {
            let share = f64::from(step) / 40.0;
            let [area, reach] = at(share);
            form.observe(&pressed(area, 3.0 * share, reach), true);
        }
        form
    }

    /// An ellipsoid (Hertz): axes 5 · `longer` and 5 half pitches at the most force.
    fn ellipsoid(longer: f64) -> impl Fn(f64) -> [f64; 2] {
        move |share| {
            let square = 25.0 * share.powf(2.0 / 3.0);
            [PI / 4.0 * square * longer, square * (1.0 + longer * longer) / 5.0]
        }
    }

    /// A cylinder 16 half pitches long, 3 wide to each side at the most force.
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
            assert_eq!(told(1, ellipsoid(longer)).kind, Kind::Round, "{name}");
        }
        assert_eq!(told(1, cylinder).kind, Kind::Line);
        assert_eq!(told(1, square_end).kind, Kind::Flat);
    }

    #[test]
    fn a_contact_whose_beginning_nobody_saw_counts_as_round() {
        assert_eq!(told(40, square_end).kind, Kind::Round);
        assert_eq!(told(36, cylinder).kind, Kind::Round);
    }

    #[test]
    fn what_was_told_stays_when_the_grip_lets_go_and_is_forgotten_by_none() {
        let mut form = told(1, square_end);
        for step in (1..40).rev() {
            let share = f64::from(step) / 40.0;
            let [area, reach] = ellipsoid(1.0)(share);
            form.observe(&pressed(area, 3.0 * share, reach), true);
        }
        assert_eq!(form.kind, Kind::Flat);
    }

    #[test]
    fn a_force_that_grows_while_it_slips_or_by_little_tells_nothing_of_the_kind() {
        let [area, reach] = ellipsoid(1.0)(1.0);
        let told = |sticks: bool, normal_n: f64| {
            let mut form = told(1, ellipsoid(1.0));
            form.observe(&pressed(area, normal_n, reach / 4.0), sticks);
            form.kind
        };
        assert_eq!(
            [told(false, 6.0), told(true, 3.1), told(true, 6.0)],
            [Kind::Round, Kind::Round, Kind::Flat]
        );
    }

    #[test]
    fn half_of_a_line_slips_later_than_half_of_a_round_contact_and_half_of_a_flat_one_later_still() {
        let [round, line, flat] =
            [told(1, ellipsoid(1.0)), told(1, cylinder), told(1, square_end)].map(|form| form.half_64ths());
        assert!(round < line && line < flat && flat < 64, "{round} {line} {flat}");
    }

    /// Friction holds ∫ r μp dA of a twist and ∫ μp dA of a force.
    #[test]
    fn a_twist_that_slides_is_the_force_that_slides() {
        let normal = 4_096.0 * 3.0;
        for (name, reach, lever, area) in [
            ("even disc, radius 6", 18.0, 4.0, 9.0 * PI),
            ("sphere, radius 6", 0.4 * 36.0, 3.0 * PI / 16.0 * 6.0, 9.0 * PI),
            ("line, 20 long", 400.0 / 12.0, 5.0, 20.0),
        ] {
            let mut form = Form::new();
            form.observe(&pressed(area, 3.0, reach), true);
            let force = (form.square_of_twist((lever * normal) as i32) as f64).sqrt();
            assert!((force / normal - 1.0).abs() < 0.09, "{name}: {}", force / normal);
        }
    }

    proptest! {
        #[test]
        fn reach_is_the_mean_square_about_the_centre_of_pressure(taxels in proptest::collection::vec((0..20_i32, 0..20_i32, 1..30_000_i32), 1..60)) {
            let mut sums = MapSums::default();
            for &(column, row, z) in &taxels {
                let (x, y) = (2 * column - 19, 2 * row - 19);
                sums.force[2] += z;
                sums.pressure[0] += x * z;
                sums.pressure[1] += y * z;
                sums.spread += z * (x * x + y * y) / 2;
            }
            let normal: f64 = taxels.iter().map(|taxel| f64::from(taxel.2)).sum();
            let mean = |of: &dyn Fn(f64, f64) -> f64| {
                taxels.iter().map(|&(x, y, z)| of(f64::from(2 * x - 19), f64::from(2 * y - 19)) * f64::from(z)).sum::<f64>() / normal
            };
            let centre = [mean(&|x, _| x), mean(&|_, y| y)];
            let right = 16.0 * mean(&|x, y| (x - centre[0]).powi(2) + (y - centre[1]).powi(2));
            let found = reach(&sums) as f64;
            prop_assert!((found - right).abs() <= 1.5 + 1e-4 * right, "{found} {right}");
        }
    }
}
