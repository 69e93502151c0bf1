//! The inference engines that ours is measured against, each on one thread with the same weights.

use std::collections::BTreeMap;
use std::path::Path;

use gripline_network::image::Image88;
use gripline_network::weights::{Scaling, Weights};
use gripline_network::{ForceMap, OUTPUT};
use gripline_simulation::{SampleGenerator, SampleWorld, Split};
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;
use tract_onnx::prelude::*;

use crate::Failure;
use crate::onnx::{self, Precision, Ranges};

/// Shape of the models' input.
const INPUT: [usize; 4] = [1, 2, 88, 88];

/// The models' input: difference and rest image in the network's units.
pub(crate) fn input(rest: &Image88, now: &Image88, scaling: Scaling) -> Vec<f32> {
    let pairs = now.iter().zip(rest);
    let difference =
        pairs.map(|(&now, &rest)| (f32::from(now) - f32::from(rest)) * scaling.difference_per_level);
    let level = rest
        .iter()
        .map(|&rest| (f32::from(rest) - scaling.rest_level) * scaling.rest_per_level);
    difference.chain(level).collect()
}

/// The models' output, 3×400, as forces.
fn forces_n(output: &[f32], scaling: Scaling) -> ForceMap {
    std::array::from_fn(|taxel| {
        std::array::from_fn(|component| output[component * 400 + taxel] * scaling.newtons_per_output)
    })
}

/// The library that all sessions share; from the Python package.
pub(crate) fn environment(library: &Path) -> Result<Environment, Failure> {
    Ok(ort::init_from(library)?.build()?)
}

/// onnxruntime, f32.
pub(crate) struct OnnxRuntime(Session);

impl OnnxRuntime {
    pub(crate) fn new(environment: &Environment, model: &[u8]) -> Result<Self, Failure> {
        let session = Session::builder(environment)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_intra_threads(1)?
            .with_inter_threads(1)?
            .commit_from_memory(model)?;
        Ok(Self(session))
    }

    pub(crate) fn run(&mut self, input: &[f32], scaling: Scaling) -> Result<ForceMap, Failure> {
        let outputs = self
            .0
            .run(ort::inputs![onnx::INPUT => TensorRef::from_array_view((INPUT, input))?])?;
        let (_, values) = outputs[0].try_extract_tensor::<f32>()?;
        Ok(forces_n(values, scaling))
    }
}

/// onnxruntime with eight-bit values and weights.
pub(crate) struct Int8 {
    pub(crate) session: OnnxRuntime,
    scaling: Scaling,
}

/// Samples that the ranges of values are taken from, and the share of values beyond them at either end.
const RANGE_SAMPLES: usize = 48;
const BEYOND: f64 = 5e-5;

impl Int8 {
    /// The ranges come from samples of the world that are there to calibrate with.
    pub(crate) fn new(environment: &Environment, weights: &Weights) -> Result<Self, Failure> {
        let scaling = weights.scaling;
        let mut shown = OnnxRuntime::new(environment, &onnx::model(weights, Precision::FloatShown))?;
        let mut values: BTreeMap<String, Vec<f32>> = BTreeMap::new();
        let world = SampleWorld::new()?;
        // One of five: those that follow each other are alike.
        let samples = SampleGenerator::new(&world, Split::Calibration, 1).step_by(5);
        for sample in samples.take(RANGE_SAMPLES) {
            let input = input(&sample.rest, &sample.now, scaling);
            let mut keep = |name: &str, of_sample: &[f32]| {
                let of_name = values.entry(name.to_owned()).or_default();
                of_name.extend_from_slice(of_sample);
            };
            keep(onnx::INPUT, &input);
            let outputs = shown
                .0
                .run(ort::inputs![onnx::INPUT => TensorRef::from_array_view((INPUT, &*input))?])?;
            for (name, output) in outputs.iter().filter(|(name, _)| *name != OUTPUT) {
                keep(name, output.try_extract_tensor::<f32>()?.1);
            }
        }
        let ranges: Ranges = values
            .into_iter()
            .map(|(name, mut values)| (name, range(&mut values)))
            .collect();
        let session = OnnxRuntime::new(environment, &onnx::model(weights, Precision::Int8(&ranges)))?;
        Ok(Self { session, scaling })
    }

    pub(crate) fn run(&mut self, rest: &Image88, now: &Image88) -> Result<ForceMap, Failure> {
        self.session.run(&input(rest, now, self.scaling), self.scaling)
    }
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
pub(crate) struct Tract(Arc<TypedRunnableModel>);

impl Tract {
    pub(crate) fn new(model: &[u8]) -> Result<Self, Failure> {
        let model = tract_onnx::onnx().model_for_read(&mut std::io::Cursor::new(model))?;
        Ok(Self(model.into_optimized()?.into_runnable()?))
    }

    pub(crate) fn run(&self, input: &[f32], scaling: Scaling) -> Result<ForceMap, Failure> {
        let tensor = Tensor::from_shape(&INPUT, input)?;
        let outputs = self.0.run(tvec!(tensor.into()))?;
        let values = outputs[0].to_plain_array_view::<f32>()?;
        let values = values.as_slice().ok_or("tract's output is not contiguous")?;
        Ok(forces_n(values, scaling))
    }
}
