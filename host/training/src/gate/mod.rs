//! Trains, quantises and writes the scene gate's network, and prints how the gate and the health check do on unseen
//! sensors.

mod data;
mod health;
mod net;
mod quantise;
mod tflite;

use std::path::Path;

use gripline_network::scene::{GateDecision, GateInputs, GateKind, Scene, mean_of};
use indicatif::{ProgressBar, ProgressStyle};

use crate::error::{TrainingError, at};
use crate::rng::Rng;
use data::{Picture, Purpose, Sensor};
use net::{Net, OUTPUTS};

/// Samples a gradient step.
const BATCH: usize = 64;
/// Pairs drawn for each picture.
const PAIRS: usize = 6;
/// A touch is labelled as one from this total normal force on, N: a quarter of the 0.2 N that no gate may miss.
const TOUCH_N: f32 = 0.05;
/// A touch that may not be missed, N.
pub(crate) const MISSED_N: f32 = 0.2;
/// All calibration touches above this force must be detected with this margin in logits, whatever the false alarms, N.
const SURE_N: f32 = 0.17;
const MARGIN: f32 = 0.5;
/// Two maps count as changed from this difference on (sum over taxels of the difference's length): N plus a share of the
/// larger total normal force. No more than the force network's own error.
const CHANGE_N: f32 = 0.03;
const CHANGE_SHARE: f32 = 0.04;
/// Allowed rate of false alarms: pictures without touch or change that reach the force network.
const FALSE_ALARMS: f32 = 0.005;
/// Training weight of a missed touch or change relative to a false alarm.
const MISS_WEIGHT: f32 = 4.0;
/// Options of `gripline-training gate`.
pub(crate) struct Plan<'a> {
    pub(crate) seed: u32,
    /// Sensors to train on; a third as many each to calibrate and to report on.
    pub(crate) sensors: u32,
    pub(crate) steps: u32,
    /// Folder for gate.tflite.
    pub(crate) out: &'a Path,
}

/// A training example.
struct Example {
    inputs: GateInputs,
    /// What the difference gate decides.
    difference: GateDecision,
    /// Total normal force now, N.
    normal_n: f32,
    /// How far the map is from the processed one, N.
    change_n: f32,
    /// Share that counts as a change, N.
    limit_n: f32,
}

impl Example {
    /// The labels of both outputs; `None` where either answer is fine.
    fn labels(&self) -> [Option<bool>; OUTPUTS] {
        let judge = |value: f32, yes: f32| match value {
            value if value >= yes => Some(true),
            value if value <= 0.2 * yes => Some(false),
            _ => None,
        };
        [judge(self.normal_n, TOUCH_N), judge(self.change_n, self.limit_n)]
    }
}

/// Trains the gate and writes its file.
pub(crate) fn train(plan: &Plan<'_>) -> Result<(), TrainingError> {
    let mut rng = Rng::new(u64::from(plan.seed) ^ 0x6761_7465);
    let bar = ProgressBar::new(u64::from(plan.sensors) + 2 * u64::from(plan.sensors.div_ceil(3)));
    bar.set_style(
        ProgressStyle::with_template("sensors {pos}/{len} {bar:30} {eta}").expect("a literal template"),
    );
    let skin = data::skin()?;
    let sensors = |purpose: Purpose, count: u32| -> Result<Vec<Sensor>, TrainingError> {
        (0..count)
            .map(|number| {
                bar.inc(1);
                let number = u64::from(plan.seed) << 16 | u64::from(number);
                Ok(data::sensor(purpose, number, &skin)?)
            })
            .collect()
    };
    let held_out = plan.sensors.div_ceil(3);
    let training = sensors(Purpose::Train, plan.sensors)?;
    let calibration = sensors(Purpose::Calibrate, held_out)?;
    let report = sensors(Purpose::Report, held_out)?;
    bar.finish_and_clear();

    let examples = |sensors: &[Sensor], rng: &mut Rng| -> Vec<Example> {
        sensors
            .iter()
            .flat_map(|sensor| examples_of(sensor, rng))
            .collect()
    };
    let learning = examples(&training, &mut rng);
    let net = fit(&learning, plan.steps as usize, &mut rng);
    let inputs: Vec<Vec<f32>> = learning
        .iter()
        .step_by(5)
        .map(|example| quantise::energies(&example.inputs))
        .collect();
    let mut chain = quantise::quantise(&net, &inputs);
    let choosing = examples(&calibration, &mut rng);
    let by = [0, 1].map(|output| threshold(&chain, &choosing, output));
    quantise::shift(&mut chain, by);

    println!(
        "{} training examples, {} calibration examples; thresholds {:.2} and {:.2}",
        learning.len(),
        choosing.len(),
        by[0],
        by[1]
    );
    let missed = print_report(&chain, &examples(&report, &mut rng));
    health::print_report(&calibration, &report);
    if missed > 0 {
        return Err(TrainingError::Usage(format!(
            "{missed} touches of {MISSED_N} N or more were missed, expected none; train with more --sensors or another --seed"
        )));
    }
    std::fs::create_dir_all(plan.out).map_err(at(plan.out))?;
    let path = plan.out.join("gate.tflite");
    let description = format!(
        "Gripline scene gate: seed {}, {} sensors, {} steps",
        plan.seed, plan.sensors, plan.steps
    );
    let file = tflite::file(&description, net::SIDE, quantise::INPUT, &chain);
    std::fs::write(&path, file).map_err(at(&path))?;
    println!("wrote {}", path.display());
    Ok(())
}

/// Examples from a sensor's pictures: pairs of the same state, of close states, and of any.
fn examples_of(sensor: &Sensor, rng: &mut Rng) -> Vec<Example> {
    let mut scene = Scene::new(GateKind::Network, &mean_of(&sensor.rest), &sensor.rest);
    let mut difference_gate = Scene::new(GateKind::Difference, &mean_of(&sensor.rest), &sensor.rest);
    let mut examples = Vec::new();
    for (at, now) in sensor.pictures.iter().enumerate() {
        for _ in 0..PAIRS {
            let kind = rng.below(10);
            let other = if kind < 3 {
                // Another picture of the same state.
                let same: Vec<&Picture> = sensor
                    .pictures
                    .iter()
                    .enumerate()
                    .filter(|(place, other)| {
                        *place != at
                            && other.touch == now.touch
                            && (now.touch == 0 || other.state == now.state)
                    })
                    .map(|(_, other)| other)
                    .collect();
                same.get(rng.below(same.len().max(1))).copied()
            } else if kind < 8 {
                let near = at as isize + rng.below(13) as isize - 6;
                sensor.pictures.get(near.max(0) as usize)
            } else {
                sensor.pictures.get(rng.below(sensor.pictures.len()))
            };
            let Some(other) = other else { continue };
            scene.set_processed(&other.image);
            let inputs = scene.inputs(&now.image);
            difference_gate.set_processed(&other.image);
            let difference_decision = difference_gate.decide(&now.image).0;
            let change_n = now
                .forces
                .iter()
                .zip(&other.forces)
                .map(|(now, before)| {
                    let squares = (0..3).map(|k| (now[k] - before[k]).powi(2));
                    squares.sum::<f32>().sqrt()
                })
                .sum();
            examples.push(Example {
                inputs,
                difference: difference_decision,
                normal_n: now.normal_n(),
                change_n,
                limit_n: CHANGE_N + CHANGE_SHARE * now.normal_n().max(other.normal_n()),
            });
        }
    }
    examples
}

fn fit(examples: &[Example], steps: usize, rng: &mut Rng) -> Net {
    let samples: Vec<(Vec<f32>, [Option<bool>; OUTPUTS])> = examples
        .iter()
        .map(|example| (quantise::energies(&example.inputs), example.labels()))
        .collect();
    let mut net = Net::new(rng);
    for step in 0..steps {
        let mut loss = 0.0;
        for _ in 0..BATCH {
            let (input, wanted) = &samples[rng.below(samples.len())];
            let input = &transformed(input, rng.below(8));
            let weight = wanted.map(|answer| match answer {
                Some(true) => MISS_WEIGHT,
                Some(false) => 1.0,
                None => 0.0,
            });
            loss += net.learn(
                input,
                wanted.map(|answer| f32::from(answer == Some(true))),
                weight,
            );
        }
        // Up in a tenth of the steps, down in a line.
        let part = step as f32 / steps as f32;
        net.step(BATCH, (10.0 * part).min(1.0 - part).max(0.01));
        if (step + 1) % (steps / 5).max(1) == 0 {
            println!("step {}: loss {:.4}", step + 1, loss / BATCH as f32);
        }
    }
    net
}

/// Applies one of the eight symmetries of the square.
fn transformed(input: &[f32], symmetry: usize) -> Vec<f32> {
    let last = net::SIDE - 1;
    let mut out = Vec::with_capacity(input.len());
    for row in 0..net::SIDE {
        for column in 0..net::SIDE {
            let (mut y, mut x) = if symmetry & 4 == 0 {
                (row, column)
            } else {
                (column, row)
            };
            if symmetry & 1 != 0 {
                y = last - y;
            }
            if symmetry & 2 != 0 {
                x = last - x;
            }
            let at = (y * net::SIDE + x) * net::INPUTS;
            out.extend_from_slice(&input[at..at + net::INPUTS]);
        }
    }
    out
}

/// The threshold of an output: the value that all but [`FALSE_ALARMS`] of the pictures without touch (or change) stay
/// below, or less if a touch that may not be missed needs it.
fn threshold(chain: &[tflite::Convolution], examples: &[Example], output: usize) -> f32 {
    let answers = |of: &dyn Fn(&Example) -> bool| {
        let mut answers: Vec<f32> = examples
            .iter()
            .filter(|example| of(example))
            .map(|example| quantise::run(chain, &example.inputs)[output])
            .collect();
        answers.sort_by(f32::total_cmp);
        answers
    };
    let quiet = answers(&|example| [example.normal_n, example.change_n][output] <= 0.0);
    let quiet = quiet[((quiet.len() - 1) as f32 * (1.0 - FALSE_ALARMS)) as usize];
    let touches = answers(&|example| output == 0 && example.normal_n >= SURE_N);
    touches.first().map_or(quiet, |min| quiet.min(min - MARGIN))
}

/// Prints detection rates; returns the number of missed touches of at least [`MISSED_N`].
fn print_report(chain: &[tflite::Convolution], examples: &[Example]) -> usize {
    let answers: Vec<[bool; OUTPUTS]> = examples
        .iter()
        .map(|example| quantise::run(chain, &example.inputs).map(|output| output > 0.0))
        .collect();
    // Examples, detected by the network, detected by the difference gate.
    let count = |output: usize, of: &dyn Fn(&Example) -> bool| {
        let mut counts = [0; 3];
        for (example, answer) in examples.iter().zip(&answers).filter(|(example, _)| of(example)) {
            let plain = [
                example.difference != GateDecision::NoContact,
                example.difference == GateDecision::Infer,
            ];
            for (count, one) in counts.iter_mut().zip([true, answer[output], plain[output]]) {
                *count += usize::from(one);
            }
        }
        counts
    };
    println!("unseen sensors and shapes:                     examples  network  differ.");
    let line = |name: &str, output: usize, of: &dyn Fn(&Example) -> bool| {
        let [examples, network, difference] = count(output, of);
        println!("  {name:<44} {examples:>8} {network:>8} {difference:>8}");
    };
    line("touched, nothing touches", 0, &|q| q.normal_n <= 0.0);
    for [from, to] in [[0.03, 0.05], [0.05, 0.1], [0.1, 0.2], [0.2, f32::INFINITY]] {
        line(&format!("touched, {from} to {to} N"), 0, &|q| {
            (from..to).contains(&q.normal_n)
        });
    }
    line("changed, same state", 1, &|q| q.change_n <= 0.0);
    for [from, to] in [[0.25, 0.5], [0.5, 1.0], [1.0, 2.0], [2.0, f32::INFINITY]] {
        line(
            &format!("changed, {from} to {to} of the labelled change"),
            1,
            &|q| q.normal_n > 0.0 && (from..to).contains(&(q.change_n / q.limit_n)),
        );
    }
    let [touches, detected, _] = count(0, &|q| q.normal_n >= MISSED_N);
    touches - detected
}
