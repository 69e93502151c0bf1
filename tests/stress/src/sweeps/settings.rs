//! Friction, thresholds and every other setting at the ends of their ranges.

use gripline_protocol::configuration::FORCE_MAX;
use gripline_protocol::message::Configuration;
use gripline_protocol::{ForceMap, TaxelForce};
use num_bigint::BigInt;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::judge::Wrong;
use crate::board::{Board, Origin};
use crate::{Effort, Sweep, exact};

const FRICTIONS: [u16; 14] = [
    0, 1, 2, 99, 100, 3_333, 4_500, 7_071, 9_999, 10_000, 10_001, 14_142, 19_999, 20_000,
];
const CONTACTS: [i16; 4] = [0, 1, i16::MAX - 1, i16::MAX];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "settings at their ends",
        "Random taxels and taxels as near to the cone as whole steps allow, at friction from 0 to 2 and contact thresholds from \
         0 to 8 N; then whole programs with settings drawn from the ends of every range, shown maps of extreme forces at \
         random times, with overflow checks on.",
        &[
            "friction",
            "taxels",
            "beside the cone",
            "wrong",
            "f32 root",
            "f32 squares",
            "f64 root",
            "f64 squares",
        ],
    );
    let mut random = effort.random(600);
    let mut all = Wrong::default();
    for friction in FRICTIONS {
        let mut wrong = Wrong::default();
        let count = effort.of(40_000, 1_000);
        for round in 0..count {
            let force = if round % 2 == 0 {
                anywhere(&mut random)
            } else {
                beside(friction, &mut random)
            };
            let contact_min = CONTACTS[random.random_range(0..CONTACTS.len())];
            wrong.ask(force, friction, if round % 4 < 2 { contact_min } else { 0 });
        }
        let Wrong { fixed, floats, .. } = wrong;
        sweep.row(vec![
            json!(format!("{:.4}", f64::from(friction) / 1e4)),
            json!(count),
            json!(count / 2),
            json!(fixed),
            json!(floats[0]),
            json!(floats[1]),
            json!(floats[2]),
            json!(floats[3]),
        ]);
        all.add(&wrong);
    }
    let ties = ties(effort.of(1, 37));
    sweep.row(vec![
        json!("0.0001 to 2"),
        json!(ties.1),
        json!(ties.1),
        json!(ties.0.fixed),
        json!(ties.0.floats[0]),
        json!(ties.0.floats[1]),
        json!(ties.0.floats[2]),
        json!(ties.0.floats[3]),
    ]);
    all.add(&ties.0);
    sweep.notes.push(format!(
        "The last row: every friction there is, with f_T exactly μ f_z, and with one step more. {} of the floats' wrong \
         decisions are about taxels exactly on the cone.",
        all.ties
    ));
    sweep.none("taxels that exact arithmetic decides otherwise", all.fixed);
    let (programs, maps, worst) = whole_programs(effort);
    sweep.none(
        "maps whose sums, Coulomb baseline or stick ratio the whole program got wrong",
        worst[0],
    );
    sweep.none(
        "lines outside 0 to 125 N, or above ceiling and fail-safe force",
        worst[1],
    );
    sweep.none("lines that fell while a fault asked to hold", worst[2]);
    sweep.notes.push(format!(
        "{programs} whole programs with {maps} maps, none of which stopped one."
    ));
    sweep
}

fn anywhere(random: &mut Pcg64Mcg) -> TaxelForce {
    let mut component = || match random.random_range(0..4) {
        0 => [i16::MIN, -1, 0, 1, i16::MAX][random.random_range(0..5)],
        _ => random.random(),
    };
    TaxelForce {
        x: component(),
        y: component(),
        z: component(),
    }
}

/// A shear whose square is as near to μ² fz² as two whole numbers allow.
fn beside(friction: u16, random: &mut Pcg64Mcg) -> TaxelForce {
    let z = random.random_range(1..=i16::MAX);
    let bound = (u64::from(friction).pow(2) * u64::from(z.unsigned_abs()).pow(2) / 100_000_000).min(2 << 30);
    let x = random.random_range(0..=bound.isqrt().min(32_767));
    let y = (bound - x * x).isqrt().min(32_767);
    let near = |value: u64, by: i64| (value as i64 + by).clamp(0, 32_767) as i16;
    let by = random.random_range(-1..=1);
    TaxelForce {
        x: near(x, 0),
        y: near(y, by),
        z,
    }
}

/// Shear of exactly μ times the normal force, along an axis and as (3, 4, 5), and one step more: (wrong, taxels).
fn ties(stride: usize) -> (Wrong, u64) {
    let (mut wrong, mut count) = (Wrong::default(), 0);
    for friction in (1..=20_000_u16).step_by(stride) {
        let (mut a, mut b) = (i32::from(friction), 10_000);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let (p, q) = (i32::from(friction) / a, 10_000 / a);
        for (x, y, z) in [(p, 0, q), (3 * p, 4 * p, 5 * q)] {
            let max = 32_766 / x.max(y).max(z);
            for k in [1, 3, max / 2, max - 1, max] {
                if k <= 0 || k > max {
                    continue;
                }
                let [x, y, z] = [x * k, y * k, z * k].map(|steps| steps as i16);
                for more in 0..2 {
                    wrong.ask(TaxelForce { x: x + more, y, z }, friction, 0);
                    count += 1;
                }
            }
        }
    }
    (wrong, count)
}

/// Settings of which each value lies at an end of its range, or anywhere in it.
pub(super) fn extreme(random: &mut Pcg64Mcg) -> Configuration {
    loop {
        let mut values = Configuration::DEFAULT.values();
        for value in values.iter_mut().take(20) {
            *value = match random.random_range(0..6) {
                0 => 0,
                1 => 1,
                2 => i32::from(i16::MAX),
                3 => FORCE_MAX,
                4 => random.random_range(0..=10_000),
                _ => *value,
            };
        }
        values[0] = random.random_range(1..=2);
        for value in [1, 3, 4, 5, 6, 7, 8, 12, 13, 14, 15, 16, 17, 18, 19] {
            values[value] = values[value].min(i32::from(u16::MAX));
        }
        values[2] = values[2].min(i32::from(i16::MAX));
        // The check says what would be right for the first setting that is wrong.
        for _ in 0..60 {
            let Some(settings) = Configuration::from_values(&values) else {
                break;
            };
            let Err(wrong) = settings.check_on(&Configuration::DEFAULT.line) else {
                return settings;
            };
            values[usize::from(wrong.field)] = if random.random_bool(0.5) {
                wrong.min
            } else {
                wrong.max
            };
        }
    }
}

/// Whether stale maps (1) or a lost link (2) ask the line to hold.
fn holds(board: &Board) -> bool {
    board.device.program.status().faults & 0b110 != 0
}

/// (programs, maps, [wrong sums, lines out of range, lines fallen under a fault]).
fn whole_programs(effort: Effort) -> (usize, usize, [u64; 3]) {
    let mut random = effort.random(601);
    let (programs, each) = (effort.of(400, 25), 40);
    let mut worst = [0_u64; 3];
    for _ in 0..programs {
        let settings = extreme(&mut random);
        let mut board = Board::holding(settings, Origin::default());
        let mut before = 0;
        for _ in 0..each {
            let mut map = ForceMap::EMPTY;
            let touched = [0, 1, 3, 40, 400][random.random_range(0..5)];
            let extreme = random.random_bool(0.5);
            for taxel in map.taxels.iter_mut().take(touched) {
                *taxel = if extreme {
                    anywhere(&mut random)
                } else {
                    TaxelForce {
                        x: 300,
                        y: -200,
                        z: random.random_range(0..1_000),
                    }
                };
            }
            let status = board.map(&map);
            let right = exact::map(&map.taxels, settings.friction, settings.contact_min);
            let same = status.sums.contact == right.contact
                && status.sums.stick == right.stick
                && status.sums.force.map(BigInt::from) == right.force
                && right.moment == status.sums.moment.into()
                && status.sums.first_moment.map(BigInt::from) == right.first_moment
                && right.second_moment == status.sums.second_moment.into()
                && status.coulomb_slip == exact::coulomb(&right.force, settings.friction);
            worst[0] += u64::from(!same);
            for _ in 0..random.random_range(1..4) {
                // Millisecond by millisecond: what fell before a fault came fell by plan.
                let mut left_us = random.random_range(1..30_000);
                while left_us > 0 {
                    let passed_us = left_us.min(1_000);
                    board.pass_us(passed_us);
                    left_us -= passed_us;
                    let line = board.device.program.line().lsb();
                    let line_max = settings.ceiling.max(settings.fail_safe);
                    worst[1] += u64::from(!(0..=FORCE_MAX).contains(&line) || line > line_max);
                    worst[2] += u64::from(holds(&board) && line < before);
                    before = line;
                }
            }
        }
    }
    (programs, programs * each, worst)
}
