//! No sum can overflow: every step of detector and controller computed on the ranges that its inputs' types and checks
//! allow, beside what its own type holds; then the maps that reach the ends, through the code itself.

use std::ops::{Add, Mul, Neg, Sub};

use gripline_firmware::constants::{
    GRIPPER_LAG_SHIFT, REST_LEAD_US, SEEK_MAX, SEEK_RATE, SEEN_MOMENT, STORM_LEVEL_MAX, STORM_PER_MAP,
    TREND_MAPS,
};
use gripline_firmware::sums::{sums_of, total_shear};
use gripline_protocol::configuration::FORCE_MAX;
use gripline_protocol::line::DAC_CODE_MAX;
use gripline_protocol::message::Configuration;
use gripline_protocol::{ForceMap, PER_UNIT, SIDE, TAXELS, TaxelForce};
use num_bigint::BigInt;
use serde_json::json;

use super::judge::{FRICTION, rule};
use crate::{Effort, Sweep, exact};

/// Whole numbers from the least to the most; wide enough that this arithmetic itself cannot overflow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Range {
    min: i128,
    max: i128,
}

const fn range(min: i128, max: i128) -> Range {
    Range { min, max }
}

impl Add for Range {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        range(self.min + other.min, self.max + other.max)
    }
}

impl Neg for Range {
    type Output = Self;
    fn neg(self) -> Self {
        range(-self.max, -self.min)
    }
}

impl Sub for Range {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Range {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let ends = [self.min, self.max].map(|a| [other.min, other.max].map(|b| a * b));
        let all = ends.as_flattened();
        let fold = |pick: fn(i128, i128) -> i128| all.iter().copied().reduce(pick).unwrap_or(0);
        range(fold(i128::min), fold(i128::max))
    }
}

impl Range {
    /// A square is never negative.
    fn squared(self) -> Self {
        let max = self.min.abs().max(self.max.abs());
        range(0, max * max)
    }

    /// Of a sum of any of this many terms, which may all be left out.
    fn any_of(self, count: i128) -> Self {
        range(count * self.min.min(0), count * self.max.max(0))
    }
}

const I16: Range = range(i16::MIN as i128, i16::MAX as i128);
const U16: Range = range(0, u16::MAX as i128);
const I32: Range = range(i32::MIN as i128, i32::MAX as i128);
const U32: Range = range(0, u32::MAX as i128);
const I64: Range = range(i64::MIN as i128, i64::MAX as i128);
const U64: Range = range(0, u64::MAX as i128);
const U128: Range = range(0, i128::MAX);

/// What is computed, where, its range, what holds it.
type Step = (&'static str, Range, (&'static str, Range));

/// Sums over any taxels of `part(column, row)`.
fn over_taxels(part: impl Fn(Range, Range) -> Range) -> Range {
    let exactly = |value: usize| range(value as i128, value as i128);
    (0..TAXELS)
        .map(|taxel| part(exactly(taxel % SIDE), exactly(taxel / SIDE)).any_of(1))
        .fold(range(0, 0), Add::add)
}

/// Σ (x² + y²)/2 fz about the centre.
fn second_moment() -> Range {
    let (two, last) = (range(2, 2), range(SIDE as i128 - 1, SIDE as i128 - 1));
    over_taxels(|column, row| {
        let [across, along] = [column, row].map(|place| two * place - last);
        let square = across * across + along * along;
        range(square.min / 2, square.max / 2) * I16
    })
}

/// Every step of the detector.
fn detector() -> Vec<Step> {
    let unit = range(PER_UNIT.into(), PER_UNIT.into());
    let shear = I16.squared() + I16.squared();
    let force = I16.any_of(TAXELS as i128);
    let moment = over_taxels(|column, row| column * I16 - row * I16);
    let pressure = over_taxels(|column, _| column * I16);
    let (two, last) = (range(2, 2), range(SIDE as i128 - 1, SIDE as i128 - 1));
    let counts = range(0, TAXELS as i128);
    let friction = range(0, 20_000);
    vec![
        ("taxel: fx² + fy²", shear, ("u32", U32)),
        ("taxel: 10⁸ (fx² + fy²)", shear * unit.squared(), ("u64", U64)),
        ("taxel: m², friction in 1/10000", friction.squared(), ("u32", U32)),
        ("taxel: m² fz²", friction.squared() * I16.squared(), ("u64", U64)),
        (
            "taxel: fz − 1 − contact_min",
            I16 + range(-1 - i128::from(i16::MAX), -1),
            ("i32", I32),
        ),
        ("map: Σ fx, Σ fy, Σ fz, any taxels", force, ("i32", I32)),
        ("map: Σ(column fy − row fx), any taxels", moment, ("i32", I32)),
        ("map: Σ column fz, any taxels", pressure, ("i32", I32)),
        (
            "map: 2 moment − 19 Σfy",
            two * moment - last * force,
            ("i32", I32),
        ),
        (
            "map: 2 moment − 19 Σfy + 19 Σfx",
            two * moment - last * force + last * force,
            ("i32", I32),
        ),
        (
            "map: 2 first moment − 19 Σfz",
            two * pressure - last * force,
            ("i32", I32),
        ),
        // Its sum about the corner wraps; this is what comes out.
        ("map: Σ (x² + y²)/2 fz, any taxels", second_moment(), ("i32", I32)),
        (
            "map: F_T², of which the root takes 52 bits",
            force.squared() + force.squared(),
            ("52 bits", range(0, (1 << 52) - 1)),
        ),
        ("map: stick · 10000", counts * unit, ("u32", U32)),
        ("map: threshold · contact", U16 * counts, ("u32", U32)),
        (
            "Coulomb: Fx² + Fy², any i32",
            I32.squared() + I32.squared(),
            ("u64", U64),
        ),
        (
            "Coulomb: 10⁸ (Fx² + Fy²)",
            (I32.squared() + I32.squared()) * unit.squared(),
            ("u128", U128),
        ),
        (
            "Coulomb: m² F_N²",
            friction.squared() * I32.squared(),
            ("u128", U128),
        ),
        (
            "trend: four ratios",
            range(0, 10_000).any_of(TREND_MAPS as i128 / 2),
            ("u16", U16),
        ),
        (
            "trend: left · span in µs",
            range(0, 10_000) * U32.any_of(TREND_MAPS as i128 / 2),
            ("u64", U64),
        ),
    ]
}

/// Every step of what the detector keeps of loads.
fn loads() -> Vec<Step> {
    let force = I16.any_of(TAXELS as i128);
    let (two, last) = (range(2, 2), range(SIDE as i128 - 1, SIDE as i128 - 1));
    let moment = two * over_taxels(|column, row| column * I16 - row * I16) - last * force;
    let pressure = two * over_taxels(|column, _| column * I16) - last * force;
    let [across, along] = [pressure * force; 2];
    // What the load keeps: a torsional moment of at most 2²⁹, and of one that slid at most 22/64 of it; its square by the pressure's
    // mean square radius, of which all take 51 bits.
    let torsional_moment = range(-(1 << 29), 1 << 29);
    let turned = torsional_moment + range(torsional_moment.min * 22 / 64, torsional_moment.max * 22 / 64);
    let mean_square = range(0, 16 * 2 * 19 * 19);
    let normal = range(1, force.max);
    let share = range(0, u16::MAX.into());
    vec![
        ("load: px Fy − py Fx", across - along, ("i64", I64)),
        (
            "load: moment less that of the centre of pressure",
            moment - (across - along),
            ("i64", I64),
        ),
        (
            "load: Fx² + Fy², changes of them",
            (two * force).squared() + (two * force).squared(),
            ("u64", U64),
        ),
        (
            "contact geometry: 18 · torsional moment², changes of it",
            range(18, 18) * turned.squared(),
            ("u64", U64),
        ),
        (
            "contact geometry: 2 second moment · F_N − Σ x fz² − Σ y fz²",
            two * second_moment() * normal - pressure.squared() - pressure.squared(),
            ("i64", I64),
        ),
        (
            "contact geometry: mean square radius · growth of F_N, all of it, in 64",
            range(0, mean_square.max * normal.max / 64),
            ("u32", U32),
        ),
        (
            "load: 2¹⁴ · load",
            range(0, 1 << 26) * range(0, 1 << 14),
            ("u64", U64),
        ),
        (
            "load: fraction of the peak · µs",
            share * range(0, 1 << 8) * range(0, 1 << 16),
            ("u64", U64),
        ),
        (
            "load: 22 · fall of the peak",
            share * range(0, 1 << 8) * range(0, 22),
            ("u32", U32),
        ),
        (
            "load: 58 · share · normal force",
            range(0, 58) * share * normal,
            ("u64", U64),
        ),
    ]
}

/// Every step of the grip that learns: what a contact carries, and what the controller makes of it.
fn learning() -> Vec<Step> {
    let force = I16.any_of(TAXELS as i128);
    let milli = range(1_000, 1_000);
    let unit = range(PER_UNIT.into(), PER_UNIT.into());
    // A torsional moment beyond 2²⁵ counts as that; of the square, 52 bits do, so the root has 26.
    let turning = range(0, 1 << 25).squared() * range(SEEN_MOMENT.into(), SEEN_MOMENT.into());
    // Over a reach of at least 1.
    let square = force.squared() + force.squared() + turning;
    let [now, before] = [range(0, (1 << 26) - 1); 2];
    // 2/5 of the growth before and 3/5 of a map's: never beyond a map's.
    let growth = range(-now.max, now.max);
    let news = range(3, 3) * (now - before - growth);
    // The longer of the two looks; what counts as no growth makes it less.
    let lead = range(0, growth.max) * range(REST_LEAD_US.into(), REST_LEAD_US.into());
    let rests = growth * range(16, 16);
    let sliding = range(0, now.max / 8) * range(0, 4);
    // Maps count as at least a millisecond apart; of what comes out half the load does.
    let more = range(0, lead.max / 1_000);
    let ahead = now + range(0, now.max / 2);
    let [felt, held] = [range(0, ahead.max + ahead.max / 2); 2];
    let [line, reached] = [range(0, FORCE_MAX.into()) * milli; 2];
    let sought = line + range(SEEK_RATE.into(), SEEK_RATE.into()) * U16;
    vec![
        (
            "friction estimator: 22 · torsional moment²",
            turning,
            ("u64", U64),
        ),
        (
            "friction estimator: Fx² + Fy² + torsional moment²",
            square,
            ("u64", U64),
        ),
        (
            "friction estimator: 3 · (growth of a map less that before)",
            news,
            ("i32", I32),
        ),
        (
            "friction estimator: growth after a map",
            growth + range(news.min / 5, news.max / 5),
            ("i32", I32),
        ),
        ("friction estimator: 16 · growth", rests, ("i32", I32)),
        (
            "friction estimator: growth less 3/128 of the load",
            growth - range(0, 3 * (now.max / 128)),
            ("i32", I32),
        ),
        (
            "friction estimator: growth · look-ahead in µs",
            lead,
            ("u64", U64),
        ),
        ("friction estimator: what sliding adds", sliding, ("i32", I32)),
        (
            "friction estimator: what the look-ahead adds, before half the load",
            more,
            ("u64", U64),
        ),
        ("friction estimator: load ahead", ahead, ("i32", I32)),
        (
            "friction estimator: load ahead · 10000",
            ahead * unit,
            ("u64", U64),
        ),
        (
            "friction estimator: 17 · share of the normal force",
            range(0, 17) * U16,
            ("u32", U32),
        ),
        (
            "friction estimator: 2 · normal force",
            range(2, 2) * force,
            ("i32", I32),
        ),
        (
            "friction estimator: load ahead · friction of the other",
            ahead * U16,
            ("i64", I64),
        ),
        (
            "grip: way of the gripper's force · µs",
            (line - reached) * range(0, 1 << GRIPPER_LAG_SHIFT),
            ("i64", I64),
        ),
        ("grip: 8 · force reached", line * range(8, 8), ("i64", I64)),
        (
            "grip: force reached · share",
            range(0, FORCE_MAX.into()) * U16,
            ("u64", U64),
        ),
        ("grip: load felt", felt, ("i32", I32)),
        ("grip: load felt less that before", felt - held, ("i32", I32)),
        ("grip: line that a touch is sought with", sought, ("i64", I64)),
        (
            "grip: floor and as much again, in 1/1000",
            line + range(0, SEEK_MAX.into()) * milli,
            ("i64", I64),
        ),
        (
            "grip: line and a sixteenth of it",
            range(0, i128::from(FORCE_MAX) + i128::from(FORCE_MAX) / 16),
            ("i32", I32),
        ),
    ]
}

/// Every step of the controller.
fn controller() -> Vec<Step> {
    let force = range(0, FORCE_MAX.into());
    let milli = range(1_000, 1_000);
    let second_us = range(0, 1_000_000);
    let shear = range(0, i128::from(i32::MAX));
    let product = shear * range(10_000, 50_000);
    let wanted = range(0, product.max / 500);
    let reflex = U16 * second_us * range(0, 10_000);
    let rise = U16 * second_us;
    let line = force * milli;
    vec![
        ("grip: shear · (1 + margin), any i32", product, ("u64", U64)),
        ("grip: feed-forward before the ceiling", wanted, ("i64", I64)),
        (
            "grip: line in 1/1000, restored ones too",
            line,
            ("u32 of line()", U32),
        ),
        ("grip: rate · µs · share", reflex, ("u64", U64)),
        (
            "grip: reflex after a step",
            line + range(0, rise.max),
            ("i64", I64),
        ),
        ("grip: line after a step of its rate", line + rise, ("i64", I64)),
        ("grip: relax rate · µs", rise, ("u64", U64)),
        (
            "grip: limits in µs (stale, dwell, relax after)",
            U16 * milli,
            ("u64", U64),
        ),
        (
            "grip: relax rate · µs of a step",
            U16 * range(0, 20_000),
            ("u32", U32),
        ),
        (
            "line: share · rise of the code",
            force * range(0, DAC_CODE_MAX.into()),
            ("u32", U32),
        ),
        (
            "safety: storm level",
            range(0, (STORM_LEVEL_MAX + STORM_PER_MAP).into()),
            ("u32", U32),
        ),
    ]
}

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "bounds of every sum",
        "Interval arithmetic from the types' ranges and the settings' checks: least and greatest value of every step, what it \
         is kept in, and how many bits are left. Sums hold for any subset of the taxels in any order, so for every moment \
         between two packets. Then maps that reach the ends through the code itself, overflow checks on.",
        &["step", "least", "most", "kept in", "bits left"],
    );
    let mut too_large = 0;
    for (name, found, (kept, holds)) in detector()
        .into_iter()
        .chain(loads())
        .chain(learning())
        .chain(controller())
    {
        too_large += u64::from(found.min < holds.min || found.max > holds.max);
        let room = |value: i128, limit: i128| {
            if value == 0 {
                f64::INFINITY
            } else {
                (limit.abs() as f64 / value.abs() as f64).log2()
            }
        };
        let bits = room(found.max, holds.max).min(room(found.min, holds.min));
        sweep.row(vec![
            json!(name),
            json!(found.min.to_string()),
            json!(found.max.to_string()),
            json!(kept),
            json!((bits * 10.0).floor() / 10.0),
        ]);
    }
    sweep.none("steps whose range does not fit what keeps them", too_large);
    let (maps, wrong, reached) = worst_maps(effort);
    sweep.none(
        "worst maps that the code sums otherwise than exact arithmetic",
        wrong,
    );
    sweep.check(
        "sums of the worst maps beyond the ranges above (1 would be their end)",
        reached,
        1.0,
    );
    sweep.notes.push(format!(
        "{maps} worst maps; they reach {:.1} % of the ranges.",
        100.0 * reached
    ));
    sweep
}

/// Maps that drive each sum to its ends, and random corners: (maps, wrong ones, largest sum over its range).
fn worst_maps(effort: Effort) -> (usize, u64, f64) {
    use rand::RngExt;
    let mut random = effort.random(800);
    let mut maps: Vec<ForceMap> = Vec::new();
    let end = |positive: bool| if positive { i16::MAX } else { i16::MIN };
    for sign in [false, true] {
        // x and y each at an end by the side of the map on which the taxel lies, z everywhere or by column.
        for kind in 0..6 {
            let mut map = ForceMap::EMPTY;
            for (taxel, force) in map.taxels.iter_mut().enumerate() {
                let [px, py] = exact::place(taxel);
                let (right, up) = (px > 0, py > 0);
                *force = match kind {
                    0 => TaxelForce {
                        x: end(sign),
                        y: end(sign),
                        z: end(sign),
                    },
                    1 => TaxelForce {
                        x: end(up == sign),
                        y: end(right != sign),
                        z: i16::MAX,
                    },
                    2 => TaxelForce {
                        x: end(sign),
                        y: end(!sign),
                        z: end(right == sign),
                    },
                    3 => TaxelForce {
                        x: end(!sign),
                        y: end(sign),
                        z: end(up == sign),
                    },
                    4 => TaxelForce {
                        x: end(right == sign),
                        y: end(up == sign),
                        z: end(sign),
                    },
                    _ => TaxelForce {
                        x: end(!sign),
                        y: end(sign),
                        z: i16::MIN,
                    },
                };
            }
            maps.push(map);
        }
    }
    for _ in 0..effort.of(2_000, 30) {
        let mut map = ForceMap::EMPTY;
        map.taxels.fill_with(|| TaxelForce {
            x: end(random.random()),
            y: end(random.random()),
            z: end(random.random()),
        });
        maps.push(map);
    }
    let force = I16.any_of(TAXELS as i128).min.abs();
    let moment = over_taxels(|column, row| column * I16 - row * I16);
    // As `finish` gives it: about the centre, in half pitches.
    let moment = (range(2, 2) * moment).max;
    let (mut wrong, mut reached) = (0, 0.0_f64);
    for map in &maps {
        let right = exact::map(&map.taxels, FRICTION, 0);
        let found = sums_of(map, rule(FRICTION, 0));
        let same = found.force.map(BigInt::from) == right.force
            && right.moment == found.moment.into()
            && found.first_moment.map(BigInt::from) == right.first_moment
            && right.second_moment == found.second_moment.into();
        wrong += u64::from(!same);
        let _ = total_shear(&found);
        for sum in found.force {
            reached = reached.max(f64::from(sum).abs() / force as f64);
        }
        reached = reached.max(f64::from(found.moment).abs() / moment as f64);
    }
    debug_assert!(Configuration::DEFAULT.check().is_ok());
    (maps.len(), wrong, reached)
}
