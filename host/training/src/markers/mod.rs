//! Trains and scores the network that makes forces of printed markers, in the simulated world of its sensor's file.
//!
//! The network is small and its input smaller, so three dense layers by hand take a minute where the framework of the other
//! networks takes an hour; [`dense`] is all there is to it.

mod dense;
mod descent;
mod samples;
mod tune;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Subcommand;
use gripline_network::marker_forces::{
    ElasticLayer, FORCE_OUTPUTS, LayerSettings, MarkerForces, MarkerNetwork, MarkerWeights,
};
use gripline_network::metrics::{Pair, Scores, calibrate};
use gripline_network::{Calibration, ForceMap, NO_FORCES};
use gripline_sensor::Sensor;
use gripline_simulation::Split;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use self::dense::{Layers, Step};
use self::descent::{BATCH, DECAY, RATE, input_in, map_in, schedule, slopes};
use self::samples::{Sample, Samples};
use self::tune::TuneArgs;
use crate::constants::DETECTOR_FRICTION;
use crate::error::{TrainingError, at, usage};
use crate::rng::Rng;

/// Mean absolute errors in newtons are of loads up to this, N.
const ABSOLUTE_UP_TO_N: f64 = 10.0;

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make samples (kept; an interrupted run goes on), train, calibrate, and write the weights.
    Train {
        /// The sensor: a shipped one's name, or its file.
        #[arg(long, default_value = "gelsight-mini")]
        sensor: PathBuf,
        /// Contacts to train on; each is seen by three units, and each of those in four mirrors.
        #[arg(long, default_value_t = 6000, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
        contacts: u32,
        /// Gradient steps of 32 samples.
        #[arg(long, default_value_t = 60_000, value_parser = clap::value_parser!(u32).range(10..=10_000_000))]
        steps: u32,
        /// Finish the steps within this time, with fewer if need be.
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
        minutes: Option<u32>,
        /// Numbers after the first and the second layer, multiples of 8.
        #[arg(long, value_delimiter = ',', num_args = 1, default_values_t = [96, 48])]
        widths: Vec<usize>,
        /// Where the weights go; the sensor's file names them.
        #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../network/weights/gelsight-mini.safetensors"))]
        out: PathBuf,
    },
    /// Only make the samples that are missing.
    Generate {
        /// The sensor: a shipped one's name, or its file.
        #[arg(long, default_value = "gelsight-mini")]
        sensor: PathBuf,
        /// Contacts to train on.
        #[arg(long, default_value_t = 6000, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
        contacts: u32,
    },
    /// Fine-tune weights on recorded presses of one's own gel with a force-torque sensor's log, and print the error in newtons of presses
    /// that were left out, beside that of gains alone. Writes nothing where gains are as good.
    Tune(TuneArgs),
    /// Score weights on shapes and units never trained on, beside the elastic layer's inverse.
    Evaluate {
        /// The sensor: a shipped one's name, or its file.
        #[arg(long, default_value = "gelsight-mini")]
        sensor: PathBuf,
        /// The weights file; without it, the one that the sensor's file names.
        #[arg(long)]
        weights: Option<PathBuf>,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
}

/// Runs a command; `held_out` contacts in each of the calibration and test sets.
pub(crate) fn run(command: &Command, data: &Path, seed: u32, held_out: u32) -> Result<(), TrainingError> {
    match command {
        Command::Generate { sensor, contacts } => {
            let sensor = Sensor::named(sensor).map_err(usage)?;
            for (split, count) in counts(*contacts, held_out) {
                Samples::load(data, &sensor, split, seed, count)?;
            }
            Ok(())
        }
        Command::Train {
            sensor,
            contacts,
            steps,
            minutes,
            widths,
            out,
        } => {
            let sensor = Sensor::named(sensor).map_err(usage)?;
            let [first, second] = widths[..] else {
                return Err(TrainingError::Usage(format!(
                    "--widths is {widths:?}, expected two such as 96,48"
                )));
            };
            let [train, calibration, test] = counts(*contacts, held_out)
                .map(|(split, count)| Samples::load(data, &sensor, split, seed, count));
            let plan = Plan {
                steps: *steps,
                budget: minutes.map(|minutes| Duration::from_secs(60 * u64::from(minutes))),
                widths: [first, second],
                seed,
            };
            let train = train?;
            let mut weights = fit(&sensor, &train, &plan);
            let mut engine = MarkerNetwork::new(&weights).map_err(TrainingError::Trained)?;
            weights.calibration = calibrate(&predict(&calibration?, |sample, map| {
                engine.set_rest(&sample.places_mm);
                engine.infer(&sample.motions, map);
            }));
            let scores = score(&test?, weights.calibration, |sample, map| {
                engine.set_rest(&sample.places_mm);
                engine.infer(&sample.motions, map);
            });
            weights.manifest = json!({
                "sensor": sensor.identity(), "seed": seed, "contacts": contacts, "samples": train.all.len(),
                "steps": steps, "minutes": minutes, "test": scores,
            })
            .to_string();
            if let Some(folder) = out.parent() {
                std::fs::create_dir_all(folder).map_err(at(folder))?;
            }
            std::fs::write(out, weights.to_bytes()).map_err(at(out))?;
            println!("{scores:#}\nwrote {}", out.display());
            Ok(())
        }
        Command::Tune(args) => tune::run(args, data, seed),
        Command::Evaluate {
            sensor,
            weights,
            json,
        } => {
            let folder = sensor.parent();
            let description = Sensor::named(sensor).map_err(usage)?;
            let mut trained = match weights {
                Some(file) => MarkerForces::from_file(file, &description),
                None => MarkerForces::for_sensor(&description, folder),
            }?;
            let test = Samples::load(data, &description, Split::Test, seed, held_out)?;
            let mut layer = MarkerForces::from(ElasticLayer::new(&LayerSettings::of(&description)));
            let of = |model: &mut MarkerForces| {
                let calibration = model.calibration();
                score(&test, calibration, |sample, map| {
                    model.set_rest(&sample.places_mm);
                    model.infer(&sample.motions, None, map);
                })
            };
            let report = json!({
                "sensor": description.identity(), "model": trained.name(),
                "trained": of(&mut trained), "elastic_layer": of(&mut layer),
            });
            if *json {
                println!("{report}");
            } else {
                println!("{report:#}");
            }
            Ok(())
        }
    }
}

fn counts(contacts: u32, held_out: u32) -> [(Split, u32); 3] {
    [
        (Split::Train, contacts),
        (Split::Calibration, held_out),
        (Split::Test, held_out),
    ]
}

/// What to train.
struct Plan {
    steps: u32,
    budget: Option<Duration>,
    widths: [usize; 2],
    seed: u32,
}

/// Gradient steps over mirrored samples.
fn fit(sensor: &Sensor, train: &Samples, plan: &Plan) -> MarkerWeights {
    let mut rng = Rng::new(u64::from(plan.seed));
    let mut layers = Layers::random(plan.widths, &mut rng);
    let mut slope = vec![0.0; FORCE_OUTPUTS];
    let bar = ProgressBar::new(plan.steps.into()).with_style(
        ProgressStyle::with_template("training {bar:30} {pos}/{len} steps, {eta} left, {msg}")
            .expect("the template is fixed"),
    );
    let start = Instant::now();
    let mut errors = [0.0; 2];
    for step in 1..=plan.steps {
        let by_time = plan
            .budget
            .map_or(0.0, |budget| start.elapsed().as_secs_f32() / budget.as_secs_f32());
        let progress = by_time.max(step as f32 / plan.steps as f32);
        if progress >= 1.0 {
            break;
        }
        for _ in 0..BATCH {
            let sample = &train.all[rng.below(train.all.len())];
            let mirror = [rng.below(2) == 1, rng.below(2) == 1];
            let input = input_in(&sample.input, mirror);
            let truth = map_in(&sample.forces, mirror);
            layers.forward(&input);
            let found = slopes(&mut layers.output, &truth, sample.rms_mm, &mut slope);
            errors = [0, 1].map(|k| 0.9995 * errors[k] + 0.0005 * found[k]);
            layers.backward(&input, &slope);
        }
        let update = Step {
            rate: RATE * schedule(progress),
            decay: DECAY,
            number: step as i32,
            batch: BATCH as f32,
        };
        layers.step(&update);
        if step % 500 == 0 {
            bar.set_position(step.into());
            bar.set_message(format!("sums {:.4}, map {:.3}", errors[0], errors[1]));
        }
    }
    bar.finish_and_clear();
    println!(
        "trained for {:.1} min: mean squared relative error of the sums {:.4}, of the map {:.3}",
        start.elapsed().as_secs_f32() / 60.0,
        errors[0],
        errors[1]
    );
    MarkerWeights {
        sensor: sensor.identity(),
        node_mm: MarkerWeights::node_mm(sensor.view.field_mm),
        widths: plan.widths,
        calibration: Calibration {
            contact_min_n: 0.01,
            friction: DETECTOR_FRICTION,
        },
        manifest: String::new(),
        held_out_share: None,
        tensors: layers.tensors(),
    }
}

fn predict(set: &Samples, mut infer: impl FnMut(&Sample, &mut ForceMap)) -> Vec<Pair> {
    let pair = |sample: &Sample| {
        let mut predicted = NO_FORCES;
        infer(sample, &mut predicted);
        Pair {
            predicted,
            truth: sample.forces,
        }
    };
    set.all.iter().map(pair).collect()
}

/// Scores of the whole field and of closer crops apart, by shape too.
fn score(set: &Samples, calibration: Calibration, infer: impl FnMut(&Sample, &mut ForceMap)) -> Value {
    let pairs = predict(set, infer);
    let of = |wanted: &dyn Fn(&Sample) -> bool| {
        let chosen: Vec<Pair> = set
            .all
            .iter()
            .zip(&pairs)
            .filter(|(sample, _)| wanted(sample))
            .map(|(_, pair)| pair.clone())
            .collect();
        chosen
    };
    let whole = of(&|sample| sample.zoom < 1.001);
    let shapes: std::collections::BTreeMap<&str, Value> = set
        .all
        .iter()
        .map(|sample| sample.shape.as_str())
        .map(|shape| {
            let pairs = of(&|sample| sample.shape == shape && sample.zoom < 1.001);
            (shape, short(&pairs, calibration))
        })
        .collect();
    json!({
        "whole_field": Scores::new(&whole, calibration), "absolute": absolute(&whole),
        "closer_crops": short(&of(&|sample| sample.zoom >= 1.001), calibration),
        "shapes": shapes, "contact_min_n": calibration.contact_min_n, "friction": calibration.friction,
    })
}

fn short(pairs: &[Pair], calibration: Calibration) -> Value {
    let scores = Scores::new(pairs, calibration);
    json!({
        "samples": scores.samples, "total_normal_error_median": scores.total_normal_error_median,
        "shear_error_median": scores.shear_error_median, "absolute": absolute(pairs),
    })
}

/// Mean absolute errors of the summed normal force and of the summed shear, N.
fn absolute(pairs: &[Pair]) -> Value {
    let total = |map: &ForceMap, axis: usize| map.iter().map(|force| f64::from(force[axis])).sum::<f64>();
    let mut sums = [0.0; 2];
    let mut count = 0.0_f64;
    for Pair { predicted, truth } in pairs {
        if total(truth, 2) <= ABSOLUTE_UP_TO_N {
            let error = |axis| total(predicted, axis) - total(truth, axis);
            sums[0] += error(2).abs();
            sums[1] += error(0).hypot(error(1));
            count += 1.0;
        }
    }
    json!({"normal_n": sums[0] / count.max(1.0), "shear_n": sums[1] / count.max(1.0)})
}

#[cfg(test)]
mod tests {
    use super::descent::MAP_WEIGHT;
    use super::*;

    #[test]
    fn mirrored_samples_keep_their_sums_but_for_the_sign() {
        let mut map = NO_FORCES;
        map[37] = [0.3, -0.2, 1.0];
        let there = map_in(&map, [true, false]);
        let sum = |axis: usize| there.iter().skip(axis).step_by(3).sum::<f32>();
        assert!((sum(0) + 0.3).abs() < 1e-6 && (sum(1) + 0.2).abs() < 1e-6 && (sum(2) - 1.0).abs() < 1e-6);
        assert!((there[3 * (20 + 2) + 2] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_slope_is_that_of_the_loss() {
        let truth: Vec<f32> = (0..FORCE_OUTPUTS)
            .map(|at| if at % 7 == 0 { 0.02 } else { 0.0 })
            .collect();
        let start: Vec<f32> = (0..FORCE_OUTPUTS)
            .map(|at| 0.2 * ((at * 31 % 17) as f32 / 17.0 - 0.185))
            .collect();
        let loss = |values: &[f32]| {
            let (mut values, mut slope) = (values.to_vec(), vec![0.0; FORCE_OUTPUTS]);
            let [sums, of_map] = slopes(&mut values, &truth, 0.05, &mut slope);
            (0.5 * (sums + MAP_WEIGHT * of_map), slope)
        };
        let (_, slope) = loss(&start);
        for at in [0, 5, 14, 601] {
            // None of them crosses nothing, where a pull begins to count otherwise.
            let step = 0.005;
            let moved = |by: f32| {
                let mut there = start.clone();
                there[at] += by;
                loss(&there).0
            };
            let found = (moved(step) - moved(-step)) / (2.0 * step);
            assert!(
                (found - slope[at]).abs() < 0.05 * slope[at].abs() + 2e-4,
                "{at}: {found} {}",
                slope[at]
            );
        }
    }
}
