//! The trend's time to slip at every rate of maps: against the same estimate without any rounding.

use gripline_firmware::constants::{TIME_TO_SLIP_MAX_MS, TREND_MAPS};
use gripline_firmware::slip::SlipDetector;
use gripline_firmware::sums::stick_ratio;
use gripline_firmware::{DeviceMicros, HostMicros};
use gripline_protocol::message::{Configuration, MapSums};
use num_bigint::BigInt;
use rand::RngExt;
use serde_json::json;

use crate::{Effort, Sweep};

const RATES_HZ: [u32; 5] = [30, 60, 200, 450, 1_000];

/// (stick ratio in 1/10000, capture time in µs).
type Seen = (u16, u32);

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "the trend",
        "Time to slip from the last eight stick ratios while they fall, with frames early or late by up to a tenth: the \
         detector's milliseconds against the exact quotient of its definition rounded down, and how often the difference \
         decides \"soon\" (below 100 ms) otherwise.",
        &[
            "maps a second",
            "estimates",
            "other than exact",
            "off by ms",
            "soon decided otherwise",
        ],
    );
    let settings = Configuration::DEFAULT;
    let (mut wrong, mut turned) = (0, 0);
    for (stream, rate_hz) in (1_300..).zip(RATES_HZ) {
        let mut random = effort.random(stream);
        let mut found = [0_u64; 4];
        for _ in 0..effort.of(20_000, 300) {
            let mut detector = SlipDetector::new();
            let mut seen: Vec<Seen> = Vec::new();
            let period_us = 1_000_000 / rate_hz;
            let fall = f64::from(random.random_range(1..4_000_u32)) / f64::from(rate_hz);
            let mut capture_us: u32 = random.random();
            for n in 0..TREND_MAPS as u32 + 4 {
                capture_us = capture_us
                    .wrapping_add(period_us - period_us / 10 + random.random_range(0..=period_us / 5));
                let stick =
                    (400.0 - fall * f64::from(n) - f64::from(random.random_range(0..3_u32))).max(0.0) as u16;
                let sums = MapSums {
                    contact: 400,
                    stick,
                    ..MapSums::default()
                };
                seen.push((stick_ratio(&sums).unwrap_or(0), capture_us));
                let fixed = detector
                    .update(&sums, HostMicros(capture_us), DeviceMicros(1_000_000), &settings)
                    .time_to_slip_ms;
                let exact = exactly(&seen, settings.slip_threshold);
                if fixed.is_none() && exact.is_none() {
                    continue;
                }
                let soon = |ms: Option<u16>| ms.is_some_and(|ms| ms < settings.incipient_horizon_ms);
                let off = fixed.zip(exact).map_or(1, |(one, other)| one.abs_diff(other));
                found[0] += 1;
                found[1] += u64::from(fixed != exact);
                found[2] = found[2].max(off.into());
                found[3] += u64::from(soon(fixed) != soon(exact));
            }
        }
        let mut row = vec![json!(rate_hz)];
        row.extend(found.iter().map(|count| json!(count)));
        sweep.row(row);
        wrong += found[1];
        turned += found[3];
    }
    sweep.none("estimates that are not the exact quotient, rounded down", wrong);
    sweep.none("\"soon\" decided otherwise", turned);
    sweep
}

/// The definition: what is left, over the fall from the mean of the older four to that of the newer four, by their times.
fn exactly(seen: &[Seen], threshold: u16) -> Option<u16> {
    let window = seen.get(seen.len().checked_sub(TREND_MAPS)?..)?;
    let (_, now_us) = window.last()?;
    let sum = |part: &[Seen], value: &dyn Fn(&Seen) -> u32| {
        part.iter().map(|map| BigInt::from(value(map))).sum::<BigInt>()
    };
    let (older, newer) = window.split_at(TREND_MAPS / 2);
    let ratio = |map: &Seen| u32::from(map.0);
    let age_us = |map: &Seen| now_us.wrapping_sub(map.1);
    let fall = sum(older, &ratio) - sum(newer, &ratio);
    let span_us = sum(older, &age_us) - sum(newer, &age_us);
    let left = BigInt::from(seen.last()?.0.saturating_sub(threshold));
    if fall <= BigInt::from(0) || span_us <= BigInt::from(0) {
        return None;
    }
    let ms = u32::try_from(left * span_us / (fall * 1_000)).ok()?;
    (ms <= TIME_TO_SLIP_MAX_MS).then_some(ms as u16)
}
