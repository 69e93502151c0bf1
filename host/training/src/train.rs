//! The training loop: AdamW, one cycle of the learning rate, a checkpoint of the best weights on validation data, early
//! stopping. Then calibration, the golden file, and the report.

use std::path::Path;
use std::time::{Duration, Instant};

use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use gripline_network::metrics::{Scores, calibrate};
use gripline_network::{Architecture, Calibration};
use gripline_simulation::Split;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::ablation::Ablation;
use crate::batch::{self, Batch};
use crate::constants::{BATCH, WARM_UP, WEIGHT_DECAY};
use crate::dataset::Dataset;
use crate::error::{TrainingError, at};
use crate::evaluate::predict;
use crate::golden;
use crate::initial::fresh_weights;
use crate::loss::loss;
use crate::model::Model;
use crate::rng::Rng;
use crate::store::{Store, world_fingerprint};
use crate::weights::{AnyWeights, Tensors};

/// The options of `train`.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) architecture: Architecture,
    pub(crate) seed: u32,
    pub(crate) samples: usize,
    pub(crate) held_out: usize,
    pub(crate) steps: usize,
    pub(crate) budget: Option<Duration>,
    pub(crate) patience: usize,
    /// Peak of the learning rate.
    pub(crate) rate: f64,
    /// Channels of the layers; none for the usual ones.
    pub(crate) widths: Vec<usize>,
    /// Parts of loss and augmentation that are left out.
    pub(crate) ablation: Ablation,
}

/// Folders and files.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Paths<'a> {
    pub(crate) data: &'a Path,
    pub(crate) out: &'a Path,
    pub(crate) from: Option<&'a Path>,
}

/// Validations in a whole run.
const VALIDATIONS: usize = 40;

/// Trains, calibrates, and writes `unet.safetensors` or `tracked.safetensors` into `out/weights` and `out/golden`.
pub(crate) fn train(plan: &Plan, paths: Paths<'_>) -> Result<(), TrainingError> {
    let world = world_fingerprint()?;
    let get = |split, samples| Store::new(paths.data, split, plan.seed, &world).load(samples);
    let sets = Sets {
        train: get(Split::Train, plan.samples)?,
        validation: get(Split::Validation, plan.held_out)?,
    };
    let device = Device::flex().autodiff();
    device.seed(u64::from(plan.seed));
    let mut weights = starting_weights(plan, paths, &sets.train, &device)?;
    let file = format!("{}.safetensors", plan.architecture.name());
    let weights_path = paths.out.join("weights").join(&file);

    let outcome = fit(plan, &sets, &mut weights, &device, |weights| {
        save(&weights_path, &weights.to_bytes())
    })?;

    let calibration_set = get(Split::Calibration, plan.held_out)?;
    let test_set = get(Split::Test, plan.held_out)?;
    let mut engine = weights.engine().map_err(TrainingError::Trained)?;
    let calibration = calibrate(&predict(&mut engine, &calibration_set));
    weights.set_calibration(calibration);
    let scores = Scores::new(&predict(&mut engine, &test_set), calibration);
    // Continued training adds to the earlier counts.
    let earlier: serde_json::Value = serde_json::from_str(weights.manifest()).unwrap_or_default();
    let before = |key: &str| earlier[key].as_f64().unwrap_or(0.0);
    let framework = match outcome.steps {
        0 => earlier["framework"].clone(),
        _ => "burn 0.22.1 flex".into(),
    };
    let manifest = json!({
        "world": sets.train.world(),
        "seed": plan.seed,
        "samples": sets.train.len(),
        "sample_steps": before("sample_steps") + (outcome.steps * BATCH) as f64,
        "minutes": before("minutes") + (outcome.took.as_secs_f64() / 60.0).round(),
        "validation_loss": outcome.validation_loss,
        "without": plan.ablation.left_out(),
        "framework": framework,
        "test": scores,
    });
    weights.set_manifest(manifest.to_string());
    save(&weights_path, &weights.to_bytes())?;
    let golden_path = paths.out.join("golden").join(&file);
    save(&golden_path, &golden::to_bytes(&weights, &test_set))?;

    let Calibration {
        contact_min_n,
        friction,
    } = calibration;
    println!("calibration: contact above {contact_min_n} N per taxel, friction {friction:.4}");
    println!(
        "test, shapes and sensors never trained on:\n{}",
        scores.to_table()
    );
    println!("wrote {} and {}", weights_path.display(), golden_path.display());
    Ok(())
}

struct Sets {
    train: Dataset,
    validation: Dataset,
}

struct Outcome {
    steps: usize,
    took: Duration,
    validation_loss: f32,
}

/// Random weights, or those of a file.
fn starting_weights(
    plan: &Plan,
    paths: Paths<'_>,
    train: &Dataset,
    device: &Device,
) -> Result<AnyWeights, TrainingError> {
    if let Some(path) = paths.from {
        let weights = AnyWeights::from_file(plan.architecture, path)?;
        check_mirrors(&weights, path)?;
        return Ok(weights);
    }
    if plan.samples < BATCH {
        return Err(TrainingError::Usage(format!(
            "--samples is {}, expected at least {BATCH}",
            plan.samples
        )));
    }
    fresh_weights(plan.architecture, &plan.widths, train, device)
}

/// Checks that the network takes these weights as they are.
fn check_mirrors(weights: &AnyWeights, path: &Path) -> Result<(), TrainingError> {
    let taken = Model::loaded(weights, &Device::flex()).tensors();
    for (name, tensor) in weights.tensors() {
        let pairs = tensor.values.iter().zip(&taken[name].values);
        let (off, largest) = pairs.fold((0.0_f32, 0.0_f32), |(off, largest), (value, taken)| {
            (off.max((value - taken).abs()), largest.max(value.abs()))
        });
        if off > 1e-3 * largest {
            return Err(TrainingError::Usage(format!(
                "`{name}` of {} differs in the mirrors of the square, by {off} of {largest} at most; expected weights that \
                 this program has trained",
                path.display()
            )));
        }
    }
    Ok(())
}

/// Gradient steps until the plan is done; leaves the best weights in `weights` and hands each new best to
/// `checkpoint`.
fn fit(
    plan: &Plan,
    sets: &Sets,
    weights: &mut AnyWeights,
    device: &Device,
    checkpoint: impl Fn(&AnyWeights) -> Result<(), TrainingError>,
) -> Result<Outcome, TrainingError> {
    let mut trainer = Trainer::new(weights, plan.ablation.clone(), device);
    let mut rng = Rng::new(u64::from(plan.seed));
    let mut order = Vec::new();
    let mut best = (f32::INFINITY, 0);
    let mut validated = 0;
    let mut running_loss = None;
    let start = Instant::now();
    let bar = ProgressBar::new(plan.steps as u64).with_style(
        ProgressStyle::with_template("training {bar:30} {pos}/{len} steps, {eta} left, {msg}")
            .expect("the template is fixed"),
    );
    let mut step = 0;
    loop {
        let by_time = plan
            .budget
            .map_or(0.0, |budget| start.elapsed().as_secs_f64() / budget.as_secs_f64());
        let by_steps = if step < plan.steps {
            step as f64 / plan.steps as f64
        } else {
            1.0
        };
        let progress = by_time.max(by_steps);
        let done = progress >= 1.0;
        if done || (progress * VALIDATIONS as f64) as usize > validated {
            validated += 1;
            let (validation_loss, tensors) = trainer.validate(&sets.validation, weights);
            let minutes = start.elapsed().as_secs_f64() / 60.0;
            let train_loss = running_loss.unwrap_or(f32::NAN);
            bar.suspend(|| {
                println!(
                    "{minutes:6.1} min  {:8} sample-steps  loss: training {train_loss:.4}, validation {validation_loss:.4}",
                    step * BATCH
                );
            });
            if validation_loss < best.0 {
                best = (validation_loss, validated);
                weights.set_tensors(tensors);
                checkpoint(weights)?;
            }
            if done || validated - best.1 >= plan.patience {
                break;
            }
        }

        if order.len() < BATCH {
            order = (0..sets.train.len()).collect();
            rng.shuffle(&mut order);
        }
        let samples = order.split_off(order.len() - BATCH);
        let batch = batch::augmented(&sets.train, &samples, weights, device, (&plan.ablation, &mut rng));
        let batch_loss = trainer.step(batch, plan.rate * schedule(progress));
        running_loss = Some(running_loss.map_or(batch_loss, |loss: f32| 0.98 * loss + 0.02 * batch_loss));
        step += 1;
        bar.set_position(step as u64);
        bar.set_message(format!("loss {batch_loss:.4}"));
    }
    bar.finish_and_clear();
    Ok(Outcome {
        steps: step,
        took: start.elapsed(),
        validation_loss: best.0,
    })
}

/// One cycle, in shares of the peak rate: a cosine up from a twenty-fifth, a cosine down to a hundredth.
fn schedule(progress: f64) -> f64 {
    let ease = |from: f64, to: f64, t: f64| to + (from - to) * (1.0 + (std::f64::consts::PI * t).cos()) / 2.0;
    if progress < WARM_UP {
        ease(1.0 / 25.0, 1.0, progress / WARM_UP)
    } else {
        ease(1.0, 1.0 / 100.0, (progress - WARM_UP) / (1.0 - WARM_UP))
    }
}

/// The network with its optimiser.
struct Trainer {
    network: Model,
    optimizer: ModuleOptimizer,
    ablation: Ablation,
}

impl Trainer {
    fn new(weights: &AnyWeights, ablation: Ablation, device: &Device) -> Self {
        let network = Model::loaded(weights, device);
        let optimizer = AdamWConfig::new()
            .with_epsilon(1e-8)
            .with_weight_decay(WEIGHT_DECAY)
            .init();
        Self {
            network,
            optimizer,
            ablation,
        }
    }

    /// One gradient step; the batch's loss before it.
    fn step(&mut self, batch: Batch, rate: f64) -> f32 {
        let loss = loss(
            self.network.forward(batch.input) * batch.scale,
            batch.truth,
            &self.ablation,
        );
        let value = loss.clone().into_scalar::<f32>();
        let gradients = GradientsParams::from_grads(loss.backward(), &self.network);
        self.network = self.optimizer.step(rate, self.network.clone(), gradients);
        value
    }

    /// Loss over a whole set with running statistics and no augmentation, and the tensors it belongs to.
    fn validate(&self, set: &Dataset, weights: &AnyWeights) -> (f32, Tensors) {
        let network = self.network.valid();
        let device = Device::flex();
        let samples: Vec<usize> = (0..set.len()).collect();
        let total: f32 = samples
            .chunks(BATCH)
            .map(|samples| {
                let batch = batch::plain(set, samples, weights, &device);
                loss(
                    network.forward(batch.input) * batch.scale,
                    batch.truth,
                    &self.ablation,
                )
                .into_scalar::<f32>()
                    * samples.len() as f32
            })
            .sum();
        (total / set.len() as f32, network.tensors())
    }
}

fn save(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
    let directory = path.parent().expect("the path was joined");
    std::fs::create_dir_all(directory).map_err(at(directory))?;
    std::fs::write(path, bytes).map_err(at(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Tensor, TensorData};

    /// A load that differs between samples and components but is smooth over the map.
    fn loads(device: &Device) -> Tensor<4> {
        let values: Vec<f32> = (0..4800).map(|i| (i / 400) as f32 * 0.3).collect();
        Tensor::from_data(TensorData::new(values, [4, 3, 20, 20]), device)
    }

    #[test]
    fn twenty_steps_on_one_batch_halve_its_loss() {
        for architecture in [Architecture::Unet, Architecture::Tracked] {
            let device = Device::flex().autodiff();
            device.seed(1);
            let set = Dataset::noise(4);
            let weights = fresh_weights(architecture, &[], &set, &device).unwrap();
            let mut trainer = Trainer::new(&weights, Ablation::default(), &device);
            let mut step = || {
                let batch = batch::plain(&set, &[0, 1, 2, 3], &weights, &device);
                let truth = loads(&device);
                trainer.step(Batch { truth, ..batch }, 3e-3)
            };
            let first = step();
            for _ in 0..20 {
                step();
            }
            let last = step();
            assert!(last < 0.5 * first, "{architecture:?}: {first} to {last}");
        }
    }

    #[test]
    fn weights_that_differ_in_a_mirror_are_refused_by_name() {
        let device = Device::flex();
        device.seed(1);
        let mut weights = fresh_weights(Architecture::Tracked, &[], &Dataset::noise(2), &device).unwrap();
        let path = Path::new("some.safetensors");
        check_mirrors(&weights, path).unwrap();
        let mut tensors = weights.tensors().clone();
        tensors.get_mut("decode10.weight").unwrap().values[7] += 0.01;
        weights.set_tensors(tensors);
        let error = check_mirrors(&weights, path).unwrap_err().to_string();
        assert!(error.contains("`decode10.weight` of some.safetensors"), "{error}");
    }

    #[test]
    fn the_learning_rate_rises_to_its_peak_and_falls_to_a_hundredth_of_it() {
        for (progress, share) in [(0.0, 1.0 / 25.0), (WARM_UP, 1.0), (1.0, 0.01)] {
            assert!((schedule(progress) - share).abs() < 1e-12);
        }
    }
}
