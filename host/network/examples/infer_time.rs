//! How long the embedded network takes for one frame on one core, by instruction set.
//!
//! `cargo run --release -p gripline-network --example infer_time`

use std::hint::black_box;
use std::time::{Duration, Instant};

use gripline_network::{Evaluation, ForceNetwork, InstructionSet, downsample_440_to_88};

const FRAMES: usize = 2000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let network = ForceNetwork::embedded()?.with_evaluation(Evaluation::Dense);
    let crop: Vec<u8> = (0..440 * 440).map(|i| ((i * 7919) >> 5) as u8).collect();
    let (mut rest, mut now, mut forces_n) = ([0; 7744], [0; 7744], [[0.0; 3]; 400]);
    downsample_440_to_88(&crop, &mut rest);
    downsample_440_to_88(&crop, &mut now);
    now.rotate_left(1);

    print_times("downsample", || downsample_440_to_88(black_box(&crop), &mut rest));
    for set in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
        let mut network = network.clone().with_instructions(set)?;
        network.set_rest(&rest);
        print_times(&format!("infer, {set}"), || {
            network.infer(black_box(&now), &mut forces_n);
        });
    }
    black_box(forces_n);
    Ok(())
}

fn print_times(name: &str, mut work: impl FnMut()) {
    let mut times: Vec<Duration> = (0..FRAMES)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed()
        })
        .collect();
    times.sort_unstable();
    let micros = |permille: usize| times[(FRAMES - 1) * permille / 1000].as_secs_f64() * 1e6;
    println!(
        "{name:16}  least {:7.1} us  median {:7.1} us  p99 {:7.1} us",
        micros(0),
        micros(500),
        micros(990)
    );
}
