//! Trains, quantises and writes the scene gate's network, and prints what the gate and the health make of sensors that
//! were used for nothing else.

mod data;
mod health;
mod net;
mod quantise;
mod tflite;

use std::path::Path;

use gripline_network::scene::{GateKind, Inputs, Scene, Verdict, mean_of};
use indicatif::{ProgressBar, ProgressStyle};

use crate::dice::Dice;
use crate::error::{TrainingError, at};
use data::{Picture, Purpose, Sensor};
use net::{Net, OUTPUTS};

/// Samples a gradient step.
const BATCH: usize = 64;
/// Pairs that are drawn of each picture as the present one.
const PAIRS: usize = 6;
/// From this total normal force on a touch must be seen, N: a quarter of the 0.2 N that no gate may miss. Lighter ones
/// are neither asked for nor held against the network.
const TOUCH_N: f32 = 0.05;
/// A touch that may not be missed, N.
pub(crate) const MISSED_N: f32 = 0.2;
/// From this force on the calibration's touches are all seen, with so many logits to spare, whatever that costs in looks
/// in vain, N.
const SURE_N: f32 = 0.17;
const MARGIN: f32 = 0.5;
/// From this difference of two maps (sum over taxels of the difference's length) on a change must be seen: N, and share
/// of the larger total normal force. No more than the force network's own error.
const CHANGE_N: f32 = 0.03;
const CHANGE_SHARE: f32 = 0.04;
/// Share of the pictures in which nothing touches or changes that may be handed to the force network in vain.
const IN_VAIN: f32 = 0.005;
/// What missing a touch or a change costs in training, in looks in vain.
const MISSING: f32 = 4.0;
/// What `gripline-training gate` is asked for.
pub(crate) struct Plan<'a> {
    pub(crate) seed: u32,
    /// Sensors to train on; a third as many each to calibrate and to report on.
    pub(crate) sensors: u32,
    pub(crate) steps: u32,
    /// Where gate.tflite goes.
    pub(crate) out: &'a Path,
}

/// One question to the network.
struct Question {
    inputs: Inputs,
    /// What the plain gate says.
    plain: Verdict,
    /// Total normal force now, N.
    normal_n: f32,
    /// How far the map is from the processed one, N.
    change_n: f32,
    /// Share that counts as a change, N.
    limit_n: f32,
}

impl Question {
    /// What should be answered: yes, no, or none when either will do.
    fn wanted(&self) -> [Option<bool>; OUTPUTS] {
        let judge = |value: f32, yes: f32| match value {
            value if value >= yes => Some(true),
            value if value <= 0.2 * yes => Some(false),
            _ => None,
        };
        [judge(self.normal_n, TOUCH_N), judge(self.change_n, self.limit_n)]
    }
}

/// Trains and writes.
pub(crate) fn train(plan: &Plan<'_>) -> Result<(), TrainingError> {
    let mut dice = Dice::new(u64::from(plan.seed) ^ 0x6761_7465);
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

    let questions = |sensors: &[Sensor], dice: &mut Dice| -> Vec<Question> {
        sensors.iter().flat_map(|sensor| ask(sensor, dice)).collect()
    };
    let learning = questions(&training, &mut dice);
    let net = fit(&learning, plan.steps as usize, &mut dice);
    let examples: Vec<Vec<f32>> = learning
        .iter()
        .step_by(5)
        .map(|question| quantise::energies(&question.inputs))
        .collect();
    let mut chain = quantise::quantise(&net, &examples);
    let choosing = questions(&calibration, &mut dice);
    let by = [0, 1].map(|output| decides_at(&chain, &choosing, output));
    quantise::shift(&mut chain, by);

    println!(
        "{} questions to learn from, {} to choose from; outputs decide at {:.2} and {:.2}",
        learning.len(),
        choosing.len(),
        by[0],
        by[1]
    );
    let missed = print_report(&chain, &questions(&report, &mut dice));
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

/// Questions about a sensor's pictures: against rest alone, the same state, states close by, any.
fn ask(sensor: &Sensor, dice: &mut Dice) -> Vec<Question> {
    let mut scene = Scene::new(GateKind::Network, &mean_of(&sensor.rest), &sensor.rest);
    let mut plain = Scene::new(GateKind::Difference, &mean_of(&sensor.rest), &sensor.rest);
    let mut questions = Vec::new();
    for (at, now) in sensor.pictures.iter().enumerate() {
        for _ in 0..PAIRS {
            let kind = dice.below(10);
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
                same.get(dice.below(same.len().max(1))).copied()
            } else if kind < 8 {
                let near = at as isize + dice.below(13) as isize - 6;
                sensor.pictures.get(near.max(0) as usize)
            } else {
                sensor.pictures.get(dice.below(sensor.pictures.len()))
            };
            let Some(other) = other else { continue };
            scene.set_processed(&other.image);
            let inputs = scene.inputs(&now.image);
            plain.set_processed(&other.image);
            let plain_verdict = plain.look(&now.image).0;
            let change_n = now
                .forces
                .iter()
                .zip(&other.forces)
                .map(|(now, before)| {
                    let squares = (0..3).map(|k| (now[k] - before[k]).powi(2));
                    squares.sum::<f32>().sqrt()
                })
                .sum();
            questions.push(Question {
                inputs,
                plain: plain_verdict,
                normal_n: now.normal_n(),
                change_n,
                limit_n: CHANGE_N + CHANGE_SHARE * now.normal_n().max(other.normal_n()),
            });
        }
    }
    questions
}

fn fit(questions: &[Question], steps: usize, dice: &mut Dice) -> Net {
    let samples: Vec<(Vec<f32>, [Option<bool>; OUTPUTS])> = questions
        .iter()
        .map(|question| (quantise::energies(&question.inputs), question.wanted()))
        .collect();
    let mut net = Net::new(dice);
    for step in 0..steps {
        let mut loss = 0.0;
        for _ in 0..BATCH {
            let (input, wanted) = &samples[dice.below(samples.len())];
            let input = &turned(input, dice.below(8));
            let weight = wanted.map(|answer| match answer {
                Some(true) => MISSING,
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

/// One of the eight ways to turn and mirror the square: a touch may come anywhere.
fn turned(input: &[f32], way: usize) -> Vec<f32> {
    let last = net::SIDE - 1;
    let mut out = Vec::with_capacity(input.len());
    for row in 0..net::SIDE {
        for column in 0..net::SIDE {
            let (mut y, mut x) = if way & 4 == 0 {
                (row, column)
            } else {
                (column, row)
            };
            if way & 1 != 0 {
                y = last - y;
            }
            if way & 2 != 0 {
                x = last - x;
            }
            let at = (y * net::SIDE + x) * net::INPUTS;
            out.extend_from_slice(&input[at..at + net::INPUTS]);
        }
    }
    out
}

/// The output above which a question is answered by yes: where all but [`IN_VAIN`] of the pictures in which nothing
/// touches, or nothing has changed, stay below, or lower if a touch close to one that may not be missed wants it.
fn decides_at(chain: &[tflite::Convolution], questions: &[Question], output: usize) -> f32 {
    let answers = |of: &dyn Fn(&Question) -> bool| {
        let mut answers: Vec<f32> = questions
            .iter()
            .filter(|question| of(question))
            .map(|question| quantise::run(chain, &question.inputs)[output])
            .collect();
        answers.sort_by(f32::total_cmp);
        answers
    };
    let quiet = answers(&|question| [question.normal_n, question.change_n][output] <= 0.0);
    let quiet = quiet[((quiet.len() - 1) as f32 * (1.0 - IN_VAIN)) as usize];
    let touches = answers(&|question| output == 0 && question.normal_n >= SURE_N);
    touches.first().map_or(quiet, |least| quiet.min(least - MARGIN))
}

/// Prints what is seen and what is not; returns the missed touches that may not be missed.
fn print_report(chain: &[tflite::Convolution], questions: &[Question]) -> usize {
    let answers: Vec<[bool; OUTPUTS]> = questions
        .iter()
        .map(|question| quantise::run(chain, &question.inputs).map(|output| output > 0.0))
        .collect();
    // Asked, yes by the network, yes by the plain gate.
    let count = |output: usize, of: &dyn Fn(&Question) -> bool| {
        let mut counts = [0; 3];
        for (question, answer) in questions
            .iter()
            .zip(&answers)
            .filter(|(question, _)| of(question))
        {
            let plain = [
                question.plain != Verdict::NoContact,
                question.plain == Verdict::Network,
            ];
            for (count, one) in counts.iter_mut().zip([true, answer[output], plain[output]]) {
                *count += usize::from(one);
            }
        }
        counts
    };
    println!("unseen sensors and shapes:                        asked  network    plain");
    let line = |name: &str, output: usize, of: &dyn Fn(&Question) -> bool| {
        let [asked, network, plain] = count(output, of);
        println!("  {name:<44} {asked:>8} {network:>8} {plain:>8}");
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
            &format!("changed, {from} to {to} of what must be seen"),
            1,
            &|q| q.normal_n > 0.0 && (from..to).contains(&(q.change_n / q.limit_n)),
        );
    }
    let [asked, seen, _] = count(0, &|q| q.normal_n >= MISSED_N);
    asked - seen
}
