//! Trains the force network on the simulated world and writes the weights file that `gripline-network`
//! carries. `gripline-training train` needs nothing but a CPU and minutes.
#![forbid(unsafe_code)]

mod ablation;
mod batch;
mod constants;
mod dataset;
mod error;
mod evaluate;
mod gate;
mod golden;
mod histories;
mod initial;
mod loss;
mod markers;
mod mirrored;
mod model;
mod rng;
mod shard;
mod store;
mod symmetry;
mod tracked_net;
mod train;
mod unet_net;
mod weights;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use gripline_network::Architecture;
use gripline_simulation::Split;

use crate::ablation::{Ablation, Part};
use crate::constants::LEARNING_RATE;
use crate::error::TrainingError;
use crate::store::{Store, world_fingerprint};
use crate::train::{Paths, Plan};

/// Trains and scores Gripline's force network.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// Folder that keeps generated samples between runs.
    #[arg(long, global = true, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/data"))]
    data: PathBuf,
    /// Decides samples, starting weights and augmentation.
    #[arg(long, global = true, default_value_t = 1)]
    seed: u32,
    /// Samples in each held-out set: validation, calibration, test.
    #[arg(long, global = true, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(100..=100_000))]
    held_out: u32,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make the samples of all four splits (train and evaluate make what is missing too). Resumable: an
    /// interrupted run loses the shards in the making, one a core, and the next one ends with the same bytes.
    Generate {
        /// Samples to train on; each stands for eight by symmetry.
        #[arg(long, default_value_t = 40_000, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
        samples: u32,
    },
    /// Train, calibrate, and write OUT/weights/NETWORK.safetensors and OUT/golden/NETWORK.safetensors.
    Train {
        /// `unet` or `tracked`.
        #[arg(long, default_value_t = Architecture::Tracked)]
        network: Architecture,
        /// Samples to train on; each stands for eight by symmetry.
        #[arg(long, default_value_t = 40_000, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
        samples: u32,
        /// Gradient steps of 32 samples; none to calibrate and measure the weights as they are.
        #[arg(long, default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
        steps: u32,
        /// Finish within this time, with fewer steps if need be.
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
        minutes: Option<u32>,
        /// Validations (40 in a run) without improvement before training stops.
        #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=1000))]
        patience: u32,
        /// Peak of the learning rate; less when training goes on from weights that are good already.
        #[arg(long, default_value_t = LEARNING_RATE)]
        rate: f64,
        /// Channels of the layers instead of the usual ones, multiples of 8: another point between run time and error.
        /// Three for `tracked` (at 20×20, 10×10, 5×5), six for `unet` (44×44, 22×22, 20×20, 10×10, 5×5, 20×20).
        #[arg(long, value_delimiter = ',', conflicts_with = "from")]
        widths: Vec<usize>,
        /// Leave out a part of the loss or of the augmentation, to measure what it is worth. Repeatable.
        #[arg(long, value_enum)]
        without: Vec<Part>,
        /// Start from these weights instead of random ones.
        #[arg(long)]
        from: Option<PathBuf>,
        /// Where to write; `host/network` replaces the built-in weights.
        #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/data/trained"))]
        out: PathBuf,
    },
    /// Train, quantise and write the scene gate's network; print how gate and health do on unseen sensors.
    Gate {
        /// Virtual sensors to train on, some 150 pictures each; a third as many to calibrate and to report on.
        #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(3..=10_000))]
        sensors: u32,
        /// Gradient steps of 64 examples.
        #[arg(long, default_value_t = 24_000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
        steps: u32,
        /// Where gate.tflite goes; `host/network/weights` replaces the built-in one.
        #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../network/weights"))]
        out: PathBuf,
    },
    /// The network that makes forces of printed markers.
    Markers {
        #[command(subcommand)]
        command: markers::Command,
    },
    /// Score weights on samples never trained on.
    Evaluate {
        /// `unet` or `tracked`.
        #[arg(long, default_value_t = Architecture::Tracked)]
        network: Architecture,
        /// The weights file; without it, the built-in weights.
        #[arg(long)]
        weights: Option<PathBuf>,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// What the errors of the built-in `tracked` network depend on along load histories never trained on: camera noise, fingertip,
    /// or state.
    Histories {
        /// Load histories, of five to six states each.
        #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..=100_000))]
        histories: u32,
    },
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("gripline-training: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), TrainingError> {
    let Arguments {
        data,
        seed,
        held_out,
        command,
    } = arguments;
    match command {
        Command::Generate { samples } => {
            let world = world_fingerprint()?;
            for split in Split::ALL {
                let count = if split == Split::Train { samples } else { held_out };
                Store::new(data, split, *seed, &world).generate(*count as usize)?;
            }
            println!(
                "{} holds world {world}, seed {seed}; see manifest.json in each folder",
                data.display()
            );
            Ok(())
        }
        Command::Train {
            network,
            samples,
            steps,
            minutes,
            patience,
            rate,
            widths,
            without,
            from,
            out,
        } => {
            let plan = Plan {
                architecture: *network,
                seed: *seed,
                samples: *samples as usize,
                held_out: *held_out as usize,
                steps: *steps as usize,
                budget: minutes.map(|minutes| Duration::from_secs(60 * u64::from(minutes))),
                patience: *patience as usize,
                rate: *rate,
                widths: widths.clone(),
                ablation: Ablation {
                    without: without.clone(),
                },
            };
            train::train(
                &plan,
                Paths {
                    data,
                    out,
                    from: from.as_deref(),
                },
            )
        }
        Command::Gate { sensors, steps, out } => gate::train(&gate::Plan {
            seed: *seed,
            sensors: *sensors,
            steps: *steps,
            out,
        }),
        Command::Histories { histories } => histories::measure(*seed, *histories as usize),
        Command::Markers { command } => markers::run(command, data, *seed, *held_out),
        Command::Evaluate {
            network,
            weights,
            json,
        } => evaluate::evaluate(
            *network,
            weights.as_deref(),
            data,
            *seed,
            *held_out as usize,
            *json,
        ),
    }
}
