//! What every descent of the marker network shares: its settings, the slope of its loss, its schedule, and mirrored worlds.

use gripline_network::ForceMap;
use gripline_network::marker_forces::{MOTION_INPUTS, MOTION_NODES, PULL, mirrored};

/// Samples per gradient step.
pub(super) const BATCH: usize = 32;
/// Peak of the learning rate, and the share of the steps in which it rises.
pub(super) const RATE: f32 = 2e-3;
const WARM_UP: f32 = 0.1;
/// Decoupled weight decay.
pub(super) const DECAY: f32 = 3e-3;
/// Weight of the map's error, relative to its square, against that of the summed forces.
pub(super) const MAP_WEIGHT: f32 = 0.3;
/// Largest relative error of a sum that counts in full; a heavier one pulls no harder.
pub(super) const ERROR_MAX: f32 = 0.5;
/// Added to the normal force and to a map's square, N and N²: light touches weigh finitely.
pub(super) const FLOOR_N: f32 = 0.05;
pub(super) const FLOOR_N2: f32 = 1e-4;

/// The loss's slope on every output (N, x, y, normal of each taxel); multiplies `output` by `rms_mm`, mm, so that it is newtons. Returns the
/// squared relative errors of the sums and of the map.
pub(super) fn slopes(output: &mut [f32], truth: &[f32], rms_mm: f32, slope: &mut [f32]) -> [f32; 2] {
    let mut sums = [[0.0_f32; 3]; 2];
    let mut square = FLOOR_N2;
    for (at, (out, truth)) in output.iter_mut().zip(truth).enumerate() {
        let newtons = *out * rms_mm;
        *out = if at % 3 == 2 && newtons < 0.0 {
            PULL * newtons
        } else {
            newtons
        };
        sums[0][at % 3] += *out;
        sums[1][at % 3] += truth;
        square += truth * truth;
    }
    let load = sums[1][2] + FLOOR_N;
    let relative = [0, 1, 2].map(|axis| (sums[0][axis] - sums[1][axis]) / load);
    let mut of_map = 0.0;
    for (at, ((out, truth), slope)) in output.iter().zip(truth).zip(slope).enumerate() {
        let error = out - truth;
        of_map += error * error;
        let by_newton = MAP_WEIGHT * error / square + relative[at % 3].clamp(-ERROR_MAX, ERROR_MAX) / load;
        let pulls = at % 3 == 2 && *out < 0.0;
        *slope = by_newton * rms_mm * if pulls { PULL } else { 1.0 };
    }
    [relative.iter().map(|error| error * error).sum(), of_map / square]
}

/// The learning rate's factor at this share of the steps: straight up from nothing, and a cosine down to a thousandth.
pub(super) fn schedule(progress: f32) -> f32 {
    if progress < WARM_UP {
        progress / WARM_UP
    } else {
        let part = (progress - WARM_UP) / (1.0 - WARM_UP);
        0.5 * (1.0 + (std::f32::consts::PI * part).cos()) + 1e-3
    }
}

/// The input of the mirrored world.
pub(super) fn input_in(input: &[f32; MOTION_INPUTS], mirror: [bool; 2]) -> [f32; MOTION_INPUTS] {
    let mut out = *input;
    let signs = mirror.map(|mirror| if mirror { -1.0 } else { 1.0 });
    for (node, out) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let from = 3 * mirrored(node, MOTION_NODES, mirror);
        *out = [
            signs[0] * input[from],
            signs[1] * input[from + 1],
            input[from + 2],
        ];
    }
    out
}

/// The map of the mirrored world.
pub(super) fn map_in(map: &ForceMap, mirror: [bool; 2]) -> Vec<f32> {
    let signs = mirror.map(|mirror| if mirror { -1.0 } else { 1.0 });
    (0..map.len())
        .flat_map(|taxel| {
            let [x, y, z] = map[mirrored(taxel, [20, 20], mirror)];
            [signs[0] * x, signs[1] * y, z]
        })
        .collect()
}
