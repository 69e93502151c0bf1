//! The border between the host's floats and the wire: every f32 there is through the quantiser, and the f64 beside its ties.

use gripline_protocol::force_map::quantise_component;
use gripline_protocol::{ForceMap, TAXELS};
use rand::RngExt;
use serde_json::json;

use crate::{Effort, Sweep, exact};

/// Kinds of f32, by their bits.
const KINDS: [&str; 7] = [
    "zero",
    "denormal",
    "below half a step",
    "within ±8 N",
    "clipped",
    "infinity",
    "NaN",
];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "the host's border",
        "Newtons to steps of 1/4096 N, nearest, ties away from zero: f32 by their bit patterns (all 4,294,967,296 in the full \
         run) against integer arithmetic on the bits, a part of them against integers of any length; f64 at and beside \
         every tie; NaN and infinities in whole maps.",
        &["f32", "patterns", "wrong", "refused"],
    );
    let mut found = [[0_u64; 3]; KINDS.len()];
    let stride = if effort.is_quick { 4_099 } else { 1 };
    for bits in (0..=u32::MAX).step_by(stride) {
        one(bits, bits.is_multiple_of(65_537), &mut found);
    }
    for exponent in 0..=255_u32 {
        for near in [0, 1, 0x3F_FFFF, 0x40_0000, 0x7F_FFFF] {
            for sign in [0, 1 << 31] {
                one(sign | exponent << 23 | near, true, &mut found);
            }
        }
    }
    for (kind, [patterns, wrong, refused]) in KINDS.iter().zip(found) {
        sweep.row(vec![json!(kind), json!(patterns), json!(wrong), json!(refused)]);
    }
    let (doubles, wrong, worst) = doubles(effort);
    sweep.row(vec![
        json!("f64 at and beside ties, and anywhere"),
        json!(doubles),
        json!(wrong),
        json!(0),
    ]);
    sweep.none(
        "f32 that become another step than the nearest, or are clipped untold",
        found[..5].iter().map(|row| row[1]).sum(),
    );
    sweep.none("f64 that become another step than the nearest", wrong);
    sweep.check(
        "error of a step, in steps (half a step is rounding itself)",
        worst,
        0.5,
    );
    let numbers: u64 = found[..5].iter().map(|row| row[2]).sum();
    sweep.none("finite forces refused", numbers);
    sweep.none(
        "NaN and infinities not refused",
        found[5..].iter().map(|row| row[0] - row[2]).sum(),
    );
    sweep.none(
        "places of a NaN or an infinity that are named wrongly",
        misnamed(),
    );
    sweep
}

/// One bit pattern.
fn one(bits: u32, ask_judge: bool, found: &mut [[u64; 3]; KINDS.len()]) {
    let newton = f32::from_bits(bits);
    let exponent = bits >> 23 & 0xFF;
    if exponent == 0xFF {
        let kind = if newton.is_infinite() { 5 } else { 6 };
        let mut map = [[0.0; 3]; TAXELS];
        map[0][0] = newton;
        found[kind][0] += 1;
        found[kind][2] += u64::from(ForceMap::quantise(&map).is_err());
        return;
    }
    let got = quantise_component(f64::from(newton));
    let right = nearest(bits);
    let kind = match (exponent, right) {
        (0, _) if bits << 1 == 0 => 0,
        (0, _) => 1,
        (_, (0, false)) => 2,
        (_, (_, false)) => 3,
        (_, (_, true)) => 4,
    };
    found[kind][0] += 1;
    let judge = !ask_judge || exact::quantised(f64::from(newton)) == right;
    found[kind][1] += u64::from(got != right || !judge);
}

/// The nearest step, from the bits: (mantissa · 2^(exponent − 150 + 12) + 1/2), rounded down.
fn nearest(bits: u32) -> (i16, bool) {
    let exponent = (bits >> 23 & 0xFF) as i32;
    let fraction = u64::from(bits & 0x7F_FFFF);
    let mantissa = if exponent == 0 {
        fraction
    } else {
        fraction | 1 << 23
    };
    // Twice the steps.
    let shift = exponent.max(1) - 150 + 13;
    let doubled = match shift {
        0..=30 => mantissa << shift,
        31.. => u64::MAX >> 2,
        -63..0 => mantissa >> -shift,
        _ => 0,
    };
    let steps = doubled.div_ceil(2);
    if bits >> 31 == 0 {
        (steps.min(32_767) as i16, steps > 32_767)
    } else {
        ((-(steps.min(32_768) as i64)) as i16, steps > 32_768)
    }
}

/// (numbers, wrong ones, largest error in steps of those that fit).
fn doubles(effort: Effort) -> (u64, u64, f64) {
    let mut random = effort.random(1_000);
    let (mut count, mut wrong, mut worst) = (0, 0, 0.0_f64);
    let mut ask = |newton: f64| {
        let right = exact::quantised(newton);
        let got = quantise_component(newton);
        count += 1;
        wrong += u64::from(got != right);
        if !got.1 {
            worst = worst.max((newton * 4_096.0 - f64::from(got.0)).abs());
        }
    };
    for half in -65_540..=65_540_i32 {
        let tie = f64::from(half) / 2.0 / 4_096.0;
        for newton in [tie, tie.next_down(), tie.next_up()] {
            ask(newton);
        }
    }
    for _ in 0..effort.of(300_000, 5_000) {
        let newton = f64::from_bits(random.random());
        if newton.is_finite() {
            ask(newton);
        }
        ask(random.random_range(-9.0..9.0));
    }
    for newton in [f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324, -5e-324, -0.0] {
        ask(newton);
    }
    (count, wrong, worst)
}

/// Places at which a NaN or an infinity is not reported as the first one.
fn misnamed() -> u64 {
    let mut wrong = 0;
    for place in 0..3 * TAXELS {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut map = [[0.1; 3]; TAXELS];
            map[place / 3][place % 3] = bad;
            let found_at = ForceMap::quantise(&map)
                .err()
                .map(|error| (usize::from(error.taxel), usize::from(error.axis)));
            wrong += u64::from(found_at != Some((place / 3, place % 3)));
        }
    }
    wrong
}
