//! The tracking network's contestants: whole frames from the camera's crop to forces, and what skipping saves when a
//! tenth and a third of the picture move. Pictures are dots drawn here: this crate knows no simulation.

use std::hint::black_box;

use gripline_network::tracked::TrackedNetwork;
use gripline_network::{Evaluation, ForceMap};

use crate::timing::Contestant;
use crate::{CHANGED, Failure, NOTHING};

const SIDE: usize = 440;
/// Particles in the middle of what sensors have.
const DOTS: usize = 5_000;
/// Share of the dots' square, 36 of 32 mm, that the picture shows, along a side.
const SHOWN: f32 = 36.0 / 32.0;

/// Whole numbers below 2²⁰ as shares, without a pattern (an LCG's upper bits).
fn unit(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 44) as f32 / (1 << 20) as f32
}

/// Dots on a dark ground, pushed most in the middle by so many pixels.
fn picture(push_px: f32) -> Vec<u8> {
    let mut levels = vec![14.0_f32; SIDE * SIDE];
    let mut state = 5;
    for _ in 0..DOTS {
        let [x, y] = [0, 1].map(|_| ((unit(&mut state) - 0.5) * SHOWN + 0.5) * SIDE as f32);
        let (share, level) = (0.2 + 0.6 * unit(&mut state), 70.0 + 80.0 * unit(&mut state));
        let far = ((x - 220.0).powi(2) + (y - 220.0).powi(2)) / (2.0 * 60.0 * 60.0);
        let x = x + push_px * share * (-far).exp();
        let span = |at: f32| (at - 4.0).max(0.0) as usize..((at + 5.0).max(0.0) as usize).min(SIDE);
        for row in span(y) {
            for column in span(x) {
                let [dx, dy] = [column as f32 + 0.5 - x, row as f32 + 0.5 - y];
                let cover = (-(dx * dx + dy * dy) / (2.0 * 1.1 * 1.1)).exp();
                let pixel = &mut levels[row * SIDE + column];
                *pixel += cover * (level - *pixel).max(0.0);
            }
        }
    }
    levels.into_iter().map(|level| level as u8).collect()
}

fn network(evaluation: Evaluation) -> Result<TrackedNetwork, Failure> {
    let mut network = TrackedNetwork::embedded()?.with_evaluation(evaluation);
    network.set_rest(&picture(0.0));
    Ok(network)
}

/// The names end in what they are in the report.
pub(crate) fn contestants(positions: usize) -> Result<Vec<Contestant>, Failure> {
    let now = picture(6.0);
    let mut dense = network(Evaluation::Dense)?;
    let mut unchanged = network(Evaluation::Skip)?;
    let mut contestants = Vec::new();
    let shown = now.clone();
    contestants.push(Contestant::new("tracked", move || {
        dense.infer(black_box(&shown), black_box(&mut NOTHING.clone()));
    }));
    let shown = now.clone();
    contestants.push(Contestant::new("tracked, same", move || {
        unchanged.infer(black_box(&shown), black_box(&mut NOTHING.clone()));
    }));
    let other = picture(7.0);
    for (share, _) in CHANGED {
        let mut network = network(Evaluation::Skip)?;
        let side = (share.sqrt() * SIDE as f64).round() as usize;
        let (mut shown, now, other) = (now.clone(), now.clone(), other.clone());
        let (mut frame, mut is_other) = (0, vec![false; positions]);
        let name = format!("tracked, {:.0} %", 100.0 * share);
        contestants.push(Contestant::new(&name, move || {
            let position = frame % positions;
            frame += 1;
            is_other[position] = !is_other[position];
            let from = if is_other[position] { &other } else { &now };
            let offset = |index: usize| index * (SIDE - side) / 2;
            let (top, left) = (offset(position / 3), offset(position % 3));
            for row in top..top + side {
                let pixels = row * SIDE + left..row * SIDE + left + side;
                shown[pixels.clone()].copy_from_slice(&from[pixels]);
            }
            network.infer(black_box(&shown), black_box(&mut NOTHING.clone()));
        }));
    }
    Ok(contestants)
}

/// Heap allocations of a frame, the worse of a full and a skipped one.
pub(crate) fn allocations() -> Result<u64, Failure> {
    let now = picture(6.0);
    let mut network = network(Evaluation::Skip)?;
    let mut forces_n: ForceMap = NOTHING;
    let mut count = || {
        let counted = allocation_counter::measure(|| network.infer(&now, &mut forces_n));
        counted.count_total
    };
    Ok(count().max(count()))
}
