//! Errors of the networks on shapes and sensors never trained on: samples of the test world made in memory, the first ones
//! of `gripline-training evaluate`; every camera image goes through the whole chain.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use gripline_network::metrics::{Pair, Scores};
use gripline_network::{Calibration, Evaluation, NO_FORCES, scale_forces};
use gripline_simulation::{Sample, SampleGenerator, SampleWorld, Split};

use crate::failure::Failure;
use crate::load_cell;
use crate::models::{Model, default_of, names};
use crate::peers::OnnxRuntime;
use crate::preprocessing::Preprocessor;

/// Samples of one stream of the world: a shard of the trainer's.
const STREAM: usize = 250;
/// The trainer's default seed.
const SEED: u64 = 1;

/// A network's scores and their standard error over the streams.
pub(crate) struct Accuracy {
    pub(crate) scores: Scores,
    pub(crate) spread: Spread,
}

/// Standard errors of the main scores.
#[derive(Clone, Copy)]
pub(crate) struct Spread {
    pub(crate) rmse_of_p99: [f64; 3],
    pub(crate) normal_error: f64,
    pub(crate) shear_error: f64,
    pub(crate) stick_ratio_mae: f64,
    pub(crate) slip_agreement: f64,
}

impl Accuracy {
    /// Of pairs, stream by stream.
    fn new(streams: &[Vec<Pair>], calibration: Calibration) -> Self {
        let of_stream: Vec<Scores> = streams
            .iter()
            .map(|pairs| Scores::new(pairs, calibration))
            .collect();
        let error = |score: &dyn Fn(&Scores) -> f64| {
            let count = of_stream.len() as f64;
            let mean = of_stream.iter().map(score).sum::<f64>() / count;
            let squares: f64 = of_stream
                .iter()
                .map(|scores| (score(scores) - mean).powi(2))
                .sum();
            (squares / (count - 1.0).max(1.0) / count).sqrt()
        };
        let spread = Spread {
            rmse_of_p99: [0, 1, 2].map(|k| error(&|scores| scores.rmse_of_p99[k])),
            normal_error: error(&|scores| scores.total_normal_error_median),
            shear_error: error(&|scores| scores.shear_error_median),
            stick_ratio_mae: error(&|scores| scores.stick_ratio_mae),
            slip_agreement: error(&|scores| scores.slip_agreement),
        };
        Self {
            scores: Scores::new(&streams.concat(), calibration),
            spread,
        }
    }
}

/// A model in int8, in an engine that only one thread may use at a time.
pub(crate) struct Quantised {
    /// Index of the model whose weights it has.
    pub(crate) model: usize,
    pub(crate) preprocessor: Preprocessor,
    pub(crate) engine: Arc<Mutex<OnnxRuntime>>,
}

/// Scores of all models over at least so many samples, then of those in eight bits, then of the default one with each
/// fingertip's gain from presses on a scale.
pub(crate) fn measure(
    models: &[Model],
    quantised: &[Quantised],
    samples: usize,
) -> Result<Vec<Accuracy>, Failure> {
    let world = SampleWorld::new()?;
    let count = samples.div_ceil(STREAM);
    let next = AtomicUsize::new(0);
    // Stream by stream, then model by model.
    let streams: Mutex<Vec<(usize, Vec<Vec<Pair>>)>> = Mutex::default();
    let failed: Mutex<Option<String>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let stream = next.fetch_add(1, Ordering::Relaxed);
                    if stream >= count {
                        return;
                    }
                    match of_stream(&world, stream as u64, models, quantised) {
                        Ok(pairs) => lock(&streams).push((stream, pairs)),
                        Err(error) => *lock(&failed) = Some(error.to_string()),
                    }
                }
            });
        }
    });
    if let Some(error) = lock(&failed).take() {
        return Err(error.into());
    }
    let mut streams = std::mem::take(&mut *lock(&streams));
    streams.sort_by_key(|(stream, _)| *stream);
    let calibrations = models.iter().map(|model| model.network.calibration());
    Ok(calibrations
        .chain(quantised.iter().map(|of| models[of.model].network.calibration()))
        .chain([models[default_of(names(models))].network.calibration()])
        .enumerate()
        .map(|(model, calibration)| {
            let of_model: Vec<Vec<Pair>> = streams
                .iter_mut()
                .map(|(_, of)| std::mem::take(&mut of[model]))
                .collect();
            Accuracy::new(&of_model, calibration)
        })
        .collect())
}

/// Pairs of one stream, model by model.
fn of_stream(
    world: &SampleWorld,
    stream: u64,
    models: &[Model],
    quantised: &[Quantised],
) -> Result<Vec<Vec<Pair>>, Failure> {
    let mut networks: Vec<_> = models
        .iter()
        .map(|model| model.network.clone().with_evaluation(Evaluation::Dense))
        .collect();
    let mut preprocessors: Vec<Preprocessor> = quantised.iter().map(|of| of.preprocessor.clone()).collect();
    let mut pairs: Vec<Vec<Pair>> = vec![Vec::with_capacity(STREAM); models.len() + quantised.len() + 1];
    let default = default_of(names(models));
    let mut gain = [1.0; 2];
    let samples = SampleGenerator::new(world, Split::Test, (SEED << 32) | stream).with_crops();
    let mut sensor = None;
    for sample in samples.take(STREAM) {
        let Sample { forces, crops, .. } = &sample;
        let crops = crops.as_ref().ok_or("a sample without its camera images")?;
        let fresh = sensor.replace(sample.sensor) != Some(sample.sensor);
        if fresh {
            gain = load_cell::gain(sample.sensor, &networks[default])?;
        }
        for (network, pairs) in networks.iter_mut().zip(&mut pairs) {
            if fresh {
                network.set_rest(&crops.rest.pixels);
            }
            let mut predicted = NO_FORCES;
            network.infer(&crops.now.pixels, &mut predicted);
            pairs.push(Pair {
                predicted,
                truth: *forces,
            });
        }
        for ((of, preprocessor), pairs) in quantised
            .iter()
            .zip(&mut preprocessors)
            .zip(&mut pairs[models.len()..])
        {
            if fresh {
                preprocessor.set_rest(&crops.rest.pixels);
            }
            let input = preprocessor.prepare(&crops.now.pixels);
            pairs.push(Pair {
                predicted: lock(&of.engine).run(&input)?,
                truth: *forces,
            });
        }
        if let Some(mut calibrated) = pairs[default].last().cloned() {
            scale_forces(&mut calibrated.predicted, gain);
            pairs[models.len() + quantised.len()].push(calibrated);
        }
    }
    Ok(pairs)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
