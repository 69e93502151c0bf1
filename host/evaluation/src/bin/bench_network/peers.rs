//! The inference engines that ours is measured against, each on one thread with the same weights.

use std::collections::BTreeMap;
use std::path::Path;

use gripline_network::{ForceMap, OUTPUT};
use gripline_simulation::{SampleGenerator, SampleWorld, Split};
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;
use rten::{Model, RunOptions, ThreadPool, ValueView};
use tract_onnx::prelude::*;

use crate::failure::Failure;
use crate::onnx::{self, Precision, Ranges};
use crate::preprocessing::{NetworkInput, Preprocessor};

/// The library that all sessions share; from the Python package.
pub(crate) fn environment(library: &Path) -> Result<Environment, Failure> {
    Ok(ort::init_from(library)?.build()?)
}

/// onnxruntime, f32.
pub(crate) struct OnnxRuntime {
    session: Session,
    shape: [usize; 4],
}

impl OnnxRuntime {
    /// `shape` is the input's.
    pub(crate) fn new(environment: &Environment, model: &[u8], shape: [usize; 4]) -> Result<Self, Failure> {
        let session = Session::builder(environment)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_intra_threads(1)?
            .with_inter_threads(1)?
            .commit_from_memory(model)?;
        Ok(Self { session, shape })
    }

    pub(crate) fn run(&mut self, input: &NetworkInput) -> Result<ForceMap, Failure> {
        let tensor = TensorRef::from_array_view((self.shape, &*input.values))?;
        let outputs = self.session.run(ort::inputs![onnx::INPUT => tensor])?;
        let (_, values) = outputs[0].try_extract_tensor::<f32>()?;
        Ok(input.forces_n(values))
    }
}

/// Samples that the ranges of values are taken from, and the share of values beyond them at either end.
const RANGE_SAMPLES: usize = 48;
const BEYOND: f64 = 5e-5;

/// onnxruntime with eight-bit values and weights. The ranges come from samples of the world that are there to calibrate
/// with, as `preprocessor` sees them.
pub(crate) fn int8(
    environment: &Environment,
    mut preprocessor: Preprocessor,
    model: impl Fn(Precision) -> Vec<u8>,
) -> Result<OnnxRuntime, Failure> {
    let shape = preprocessor.shape();
    let mut shown = OnnxRuntime::new(environment, &model(Precision::FloatShown), shape)?;
    let mut values: BTreeMap<String, Vec<f32>> = BTreeMap::new();
    let world = SampleWorld::new()?;
    // One of five: those that follow each other are alike.
    let samples = SampleGenerator::new(&world, Split::Calibration, 1)
        .with_crops()
        .step_by(5);
    for sample in samples.take(RANGE_SAMPLES) {
        let crops = sample.crops.ok_or("a sample without its camera images")?;
        preprocessor.set_rest(&crops.rest.pixels);
        let input = preprocessor.prepare(&crops.now.pixels).values;
        let mut keep = |name: &str, of_sample: &[f32]| {
            let of_name = values.entry(name.to_owned()).or_default();
            of_name.extend_from_slice(of_sample);
        };
        keep(onnx::INPUT, &input);
        let outputs = shown
            .session
            .run(ort::inputs![onnx::INPUT => TensorRef::from_array_view((shape, &*input))?])?;
        for (name, output) in outputs.iter().filter(|(name, _)| *name != OUTPUT) {
            keep(name, output.try_extract_tensor::<f32>()?.1);
        }
    }
    let ranges: Ranges = values
        .into_iter()
        .map(|(name, mut values)| (name, range(&mut values)))
        .collect();
    OnnxRuntime::new(environment, &model(Precision::Int8(&ranges)), shape)
}

/// Where nearly all values lie, 0 included.
fn range(values: &mut [f32]) -> [f32; 2] {
    let beyond = (values.len() as f64 * BEYOND) as usize;
    let last = values.len() - 1;
    let low = *values.select_nth_unstable_by(beyond, f32::total_cmp).1;
    let high = *values.select_nth_unstable_by(last - beyond, f32::total_cmp).1;
    [low.min(0.0), high.max(1e-6)]
}

/// tract, f32.
pub(crate) struct Tract {
    model: Arc<TypedRunnableModel>,
    shape: [usize; 4],
}

impl Tract {
    /// `shape` is the input's.
    pub(crate) fn new(model: &[u8], shape: [usize; 4]) -> Result<Self, Failure> {
        let model = tract_onnx::onnx().model_for_read(&mut std::io::Cursor::new(model))?;
        let model = model.into_optimized()?.into_runnable()?;
        Ok(Self { model, shape })
    }

    pub(crate) fn run(&self, input: &NetworkInput) -> Result<ForceMap, Failure> {
        let tensor = Tensor::from_shape(&self.shape, &input.values)?;
        let outputs = self.model.run(tvec!(tensor.into()))?;
        let values = outputs[0].to_plain_array_view::<f32>()?;
        let values = values.as_slice().ok_or("tract's output is not contiguous")?;
        Ok(input.forces_n(values))
    }
}

/// rten, f32: the pure Rust engine with vector instructions of its own.
pub(crate) struct Rten {
    model: Model,
    options: RunOptions,
    shape: [usize; 4],
}

impl Rten {
    /// `shape` is the input's.
    pub(crate) fn new(model: Vec<u8>, shape: [usize; 4]) -> Result<Self, Failure> {
        Ok(Self {
            model: Model::load(model)?,
            options: RunOptions::default().with_thread_pool(Some(Arc::new(ThreadPool::with_num_threads(1)))),
            shape,
        })
    }

    pub(crate) fn run(&self, input: &NetworkInput) -> Result<ForceMap, Failure> {
        let tensor = ValueView::from_shape(&self.shape, &input.values)?;
        let output = self.model.run_one(tensor.into(), Some(self.options.clone()))?;
        let values = output.as_tensor_view::<f32>().ok_or("rten's output is not f32")?;
        let values = values.data().ok_or("rten's output is not contiguous")?;
        Ok(input.forces_n(values))
    }
}
