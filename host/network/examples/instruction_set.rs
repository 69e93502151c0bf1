//! The networks on made-up pictures with one instruction set: a line a frame, `CASE FRAME CHECKSUM`, the checksum over the
//! bits of all forces. `cargo xtask arm` compares them between processors and counts the instructions between the lines.
//! `cargo run --release --package gripline-network --example instruction_set -- neon`

use gripline_network::tracked::{TrackedNetwork, empty_grid};
use gripline_network::unet::UnetNetwork;
use gripline_network::{Evaluation, ForceMap, InstructionSet, NO_FORCES, Precision, downsample_440_to_88};

const SIDE: usize = 440;
/// The first finds its buffers untouched.
const FRAMES: usize = 2;

/// Pseudo-random numbers in [0, 1) (an LCG's upper bits).
struct Rng(u64);

impl Rng {
    fn unit(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
}

/// Dots on a dark ground, each moved by up to `push` pixels, most in the middle. No function that C libraries round
/// differently.
fn picture(push: [f32; 2]) -> Vec<u8> {
    let mut levels = vec![14_u8; SIDE * SIDE];
    let mut rng = Rng(5);
    for _ in 0..1_200 {
        let [x, y] = [0, 1].map(|_| rng.unit() * SIDE as f32);
        let (share, light) = (0.2 + 0.6 * rng.unit(), 70.0 + 80.0 * rng.unit());
        let far = ((x - 230.0) * (x - 230.0) + (y - 200.0) * (y - 200.0)) / (120.0 * 120.0);
        let [u, v] = push.map(|push| push * share / (1.0 + far));
        let (x, y) = (x + u, y + v);
        for row in (y - 5.0).max(0.0) as usize..((y + 5.0) as usize).min(SIDE) {
            for column in (x - 5.0).max(0.0) as usize..((x + 5.0) as usize).min(SIDE) {
                let [dx, dy] = [column as f32 + 0.5 - x, row as f32 + 0.5 - y];
                let cover = (1.0 - (dx * dx + dy * dy) / 9.0).max(0.0);
                let level = &mut levels[row * SIDE + column];
                *level = (*level).max((14.0 + cover * cover * light) as u8);
            }
        }
    }
    levels
}

/// Over the bits of all forces (FNV-1a, a force a round). Short, because it counts among the instructions of a frame.
fn checksum(forces_n: &ForceMap) -> u64 {
    let forces = forces_n.as_flattened().iter();
    forces.fold(0xcbf2_9ce4_8422_2325, |sum: u64, force| {
        (sum ^ u64::from(force.to_bits())).wrapping_mul(0x100_0000_01b3)
    })
}

/// Runs the frames of a case.
fn frames(case: &str, mut infer: impl FnMut(&mut ForceMap)) {
    println!("{case} 0 -");
    for frame in 1..=FRAMES {
        let mut forces_n = NO_FORCES;
        infer(&mut forces_n);
        println!("{case} {frame} {:016x}", checksum(&forces_n));
    }
}

fn tracked(set: InstructionSet, precision: Precision) -> TrackedNetwork {
    TrackedNetwork::embedded()
        .and_then(|network| network.with_instructions(set))
        .expect("weights and an instruction set that this processor has")
        .with_precision(precision)
        .with_evaluation(Evaluation::Dense)
}

fn main() {
    let set = std::env::args().nth(1).unwrap_or_default();
    let set: InstructionSet = set.parse().expect("an instruction set as the only argument");
    let [rest, now] = [[0.0; 2], [7.0, -4.0]].map(picture);

    let mut grid = empty_grid();
    let mut rng = Rng(7);
    grid.as_flattened_mut().fill_with(|| 0.5 * (rng.unit() - 0.5));
    for (case, precision) in [
        ("tracked-network-int16", Precision::Int16),
        ("tracked-network-f32", Precision::F32),
    ] {
        let mut network = tracked(set, precision);
        frames(case, |forces_n| network.infer_grid(&grid, forces_n));
    }

    let mut network = tracked(set, Precision::default());
    network.set_rest(&rest);
    frames("tracked-camera-to-forces", |forces_n| {
        network.infer(&now, forces_n);
    });
    let (particles, lost) = network.particles();
    assert!(
        particles > 500 && 5 * lost < particles,
        "the picture serves no tracker: {lost} of {particles} particles lost"
    );

    let mut network = UnetNetwork::embedded()
        .and_then(|network| network.with_instructions(set))
        .expect("weights and an instruction set that this processor has")
        .with_evaluation(Evaluation::Dense);
    let [mut small_rest, mut small_now] = [[0; 88 * 88]; 2];
    downsample_440_to_88(&rest, &mut small_rest);
    downsample_440_to_88(&now, &mut small_now);
    network.set_rest(&small_rest);
    frames("unet-network-f32", |forces_n| network.infer(&small_now, forces_n));
}
