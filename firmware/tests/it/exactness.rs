//! The detector against arbitrary-precision arithmetic on the decimal friction coefficient: more than ten million
//! taxels, random and chosen to sit on, just below and just above the decision boundary. Not one may differ.

use gripline_firmware::Friction;
use gripline_firmware::sums::{
    Accumulator, Kernel as _, Portable, TaxelRule, stick_ratio_below, sums_of, total_shear,
};
use gripline_protocol::message::MapSums;
use gripline_protocol::{ForceMap, Place, TAXELS, TaxelForce};
use num_bigint::BigInt;
use proptest::prelude::*;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// fx² + fy² ≤ (m/10000)² fz², without rounding anywhere.
fn sticks_exactly(force: TaxelForce, per_unit: u16) -> bool {
    let square = |value: i32| BigInt::from(value) * BigInt::from(value);
    let shear = square(force.x.into()) + square(force.y.into());
    shear * square(10_000) <= square(per_unit.into()) * square(force.z.into())
}

/// The detector's answer for one taxel, through the path that every map takes: (in contact, sticks).
fn detector_says(force: TaxelForce, rule: TaxelRule) -> (bool, bool) {
    let mut sums = Accumulator::new(rule);
    Portable::add(&mut sums, &[Place::new(0, 0)], &[force.to_le_bytes()]);
    let sums = sums.finish();
    let found = (sums.contact == 1, sums.stick == 1);
    assert_eq!(rule.decide(force), found, "one taxel and the sums");
    found
}

fn rule(per_unit: u16, contact_min: i16) -> TaxelRule {
    TaxelRule {
        friction: Friction::from_per_unit(per_unit).unwrap(),
        contact_min,
    }
}

fn check(force: TaxelForce, per_unit: u16, contact_min: i16) {
    let contact = force.z > contact_min;
    let expected = (contact, contact && sticks_exactly(force, per_unit));
    let found = detector_says(force, rule(per_unit, contact_min));
    assert_eq!(
        found, expected,
        "{force:?} with friction {per_unit}/10000 and contact_min {contact_min}"
    );
}

const FRICTIONS: [u16; 16] = [
    0, 1, 2, 99, 100, 3_333, 4_499, 4_500, 4_501, 7_071, 9_999, 10_000, 10_001, 14_142, 19_999, 20_000,
];

#[test]
fn four_million_random_taxels_are_decided_exactly() {
    let mut random = Pcg64Mcg::new(0x6772_6970);
    for _ in 0..4_000_000 {
        let force = TaxelForce {
            x: random.random(),
            y: random.random(),
            z: random.random(),
        };
        let per_unit = random.random_range(0..=20_000);
        check(force, per_unit, random.random_range(0..200));
    }
}

/// For every fz and μ the boundary is b = floor(μ² fz²); these shears have squares as near to b as two integers allow.
#[test]
fn six_million_taxels_beside_the_boundary_are_decided_exactly() {
    let mut random = Pcg64Mcg::new(0x6c69_6e65);
    for round in 0..1_000_000_u32 {
        let per_unit = match random.random_range(0..4) {
            0 => FRICTIONS[random.random_range(0..FRICTIONS.len())],
            _ => random.random_range(0..=20_000),
        };
        let z = if round % 4 == 0 {
            random.random_range(32_700..=i16::MAX)
        } else {
            random.random_range(1..=i16::MAX)
        };
        let bound =
            (u64::from(per_unit).pow(2) * u64::from(z.unsigned_abs()).pow(2) / 100_000_000).min(2 << 30);
        let x = random.random_range(0..=bound.isqrt().min(32_767));
        let y = (bound - x * x).isqrt().min(32_767);
        for (dx, dy) in [(0, 0), (0, 1), (1, 0), (1, 1), (0, -1), (-1, 0)] {
            let near = |value: u64, by: i64| (value as i64 + by).clamp(0, 32_767) as i16;
            let (x, y) = (near(x, dx), near(y, dy));
            let force = TaxelForce {
                x: if random.random() { x } else { -x },
                y: if random.random() { y } else { -y },
                z,
            };
            check(force, per_unit, 0);
        }
    }
}

#[test]
fn shear_of_exactly_mu_times_normal_sticks_and_one_step_more_slips() {
    let mut cases = 0_u32;
    for per_unit in 1..=20_000_u16 {
        let (p, q) = reduced(per_unit);
        // (3, 4, 5) makes the shear's length whole with both components in use.
        for (fx, fy, fz) in [(p, 0, q), (0, p, q), (3 * p, 4 * p, 5 * q)] {
            let max = 32_767 / fx.max(fy).max(fz);
            for k in [1, 2, max / 2, max - 1, max] {
                if k <= 0 || k > max {
                    continue;
                }
                let force = TaxelForce {
                    x: (fx * k) as i16,
                    y: (fy * k) as i16,
                    z: (fz * k) as i16,
                };
                assert_eq!(
                    detector_says(force, rule(per_unit, 0)),
                    (true, true),
                    "{force:?} at {per_unit}/10000"
                );
                if let Some(x) = force.x.checked_add(1) {
                    let more = TaxelForce { x, ..force };
                    assert_eq!(
                        detector_says(more, rule(per_unit, 0)),
                        (true, false),
                        "{more:?} at {per_unit}/10000"
                    );
                }
                cases += 1;
            }
        }
    }
    assert!(cases > 50_000, "only {cases} cases fitted the range");
}

fn reduced(per_unit: u16) -> (i32, i32) {
    let (mut a, mut b) = (i32::from(per_unit), 10_000);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (i32::from(per_unit) / a, 10_000 / a)
}

#[test]
fn extremes_of_i16_are_decided_exactly() {
    let ends = [i16::MIN, i16::MIN + 1, -1, 0, 1, i16::MAX - 1, i16::MAX];
    for (x, y, z) in ends
        .into_iter()
        .flat_map(|x| ends.map(|y| (x, y)))
        .flat_map(|(x, y)| ends.map(|z| (x, y, z)))
    {
        for per_unit in FRICTIONS {
            for contact_min in [0, 1, i16::MAX - 1, i16::MAX] {
                check(TaxelForce { x, y, z }, per_unit, contact_min);
            }
        }
    }
}

#[test]
fn what_just_holds_is_told_from_what_just_does_not() {
    let at = |per_unit, normal, largest: u32| {
        let friction = Friction::from_per_unit(per_unit).unwrap();
        friction.holds(largest, normal) && !friction.holds(largest + 1, normal)
    };
    // Within the squares of forces, the left side is 2³¹ at most.
    assert!(Friction::from_per_unit(20_000).unwrap().holds(1 << 31, i16::MAX));
    assert!(at(
        14_142,
        i16::MAX,
        (u64::from(32_767_u32.pow(2)) * 14_142_u64.pow(2) / 100_000_000) as u32
    ));
    assert!(at(4_500, 20, 81));
    assert!(at(0, i16::MAX, 0));
    assert!(Friction::from_per_unit(20_001).is_err());
}

fn any_map() -> impl Strategy<Value = ForceMap> {
    let component = prop_oneof![any::<i16>(), Just(i16::MIN), Just(i16::MAX), Just(0)];
    let taxels = proptest::collection::vec((component.clone(), component.clone(), component), TAXELS);
    // Rows without any force are passed over.
    (taxels, prop_oneof![Just(u32::MAX), any::<u32>()]).prop_map(|(taxels, rows)| {
        let mut map = ForceMap::EMPTY;
        for (n, (x, y, z)) in taxels.into_iter().enumerate() {
            if rows >> (n / 20) & 1 == 1 {
                map.taxels[n] = TaxelForce { x, y, z };
            }
        }
        map
    })
}

proptest! {
    /// Tests run with overflow checks on, so this also shows that no sum can overflow.
    #[test]
    fn sums_equal_those_of_wide_arithmetic(map in any_map(), per_unit in 0..=20_000_u16, contact_min in 0..=i16::MAX) {
        let sums = sums_of(&map, rule(per_unit, contact_min));
        let place = |n: usize| (2 * (n % 20) as i64 - 19, 2 * (n / 20) as i64 - 19);
        let mut wide = [0_i64; 7];
        for (n, force) in map.taxels.iter().enumerate() {
            let ((px, py), (x, y, z)) = (place(n), (i64::from(force.x), i64::from(force.y), i64::from(force.z)));
            for (sum, term) in wide.iter_mut().zip([x, y, z, px * y - py * x, px * z, py * z, z * (px * px + py * py) / 2]) {
                *sum += term;
            }
        }
        let found = [sums.force[0], sums.force[1], sums.force[2], sums.moment, sums.first_moment[0], sums.first_moment[1], sums.second_moment];
        prop_assert_eq!(found.map(i64::from), wide);
        let contact: Vec<_> = map.taxels.iter().filter(|force| force.z > contact_min).collect();
        prop_assert_eq!(usize::from(sums.contact), contact.len());
        prop_assert_eq!(usize::from(sums.stick), contact.iter().filter(|force| sticks_exactly(***force, per_unit)).count());
        let shear = BigInt::from(wide[0]).pow(2) + BigInt::from(wide[1]).pow(2);
        let root = BigInt::from(total_shear(&sums));
        prop_assert!(root.pow(2) <= shear && (root + BigInt::from(1)).pow(2) > shear);
    }

    #[test]
    fn a_whole_map_gives_the_sums_of_its_taxels_one_by_one(map in any_map(), per_unit in 0..=20_000_u16, contact_min in 0..=i16::MAX) {
        let mut one_by_one = Accumulator::new(rule(per_unit, contact_min));
        for (n, force) in (0_u16..).zip(map.taxels) {
            Portable::add(&mut one_by_one, &[Place::new(n % 20, n / 20)], &[force.to_le_bytes()]);
        }
        prop_assert_eq!(sums_of(&map, rule(per_unit, contact_min)), one_by_one.finish());
    }

    #[test]
    fn whole_forces_are_compared_exactly(x in any::<i32>(), y in any::<i32>(), normal in any::<i32>(), per_unit in 0..=20_000_u16) {
        let exceeded = rule(per_unit, 0).friction.exceeded_by([x, y], normal);
        let shear = BigInt::from(x).pow(2) + BigInt::from(y).pow(2);
        let right = BigInt::from(per_unit) * BigInt::from(normal);
        let left_square = shear * BigInt::from(100_000_000);
        // F_T > μ F_N with F_T ≥ 0: a negative right side is always exceeded.
        let expected = right < BigInt::from(0) || left_square > right.pow(2);
        prop_assert_eq!(exceeded, expected);
    }

    #[test]
    fn the_threshold_is_compared_exactly(contact in 0..=400_u16, share in 0.0..=1.0_f64, threshold in 0..=10_000_u16) {
        let stick = (f64::from(contact) * share) as u16;
        let sums = MapSums { contact, stick, ..MapSums::default() };
        // stick/contact < threshold/10000 as whole numbers.
        prop_assert_eq!(stick_ratio_below(&sums, threshold), contact > 0 && u64::from(stick) * 10_000 < u64::from(threshold) * u64::from(contact));
    }
}
