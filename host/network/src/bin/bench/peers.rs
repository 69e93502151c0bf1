//! The inference engines that ours is measured against, each on one thread with the same weights.

use std::path::Path;

use gripline_network::ForceMap;
use gripline_network::image::Image88;
use gripline_network::weights::Scaling;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::TensorRef;
use tract_onnx::prelude::*;

use crate::Failure;

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

/// onnxruntime, f32.
pub(crate) struct OnnxRuntime(Session);

impl OnnxRuntime {
    /// `library` is the shared library of the Python package.
    pub(crate) fn new(library: &Path, model: &[u8]) -> Result<Self, Failure> {
        let environment = ort::init_from(library)?.build()?;
        let session = Session::builder(&environment)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_intra_threads(1)?
            .with_inter_threads(1)?
            .commit_from_memory(model)?;
        Ok(Self(session))
    }

    pub(crate) fn run(&mut self, input: &[f32], scaling: Scaling) -> Result<ForceMap, Failure> {
        let outputs = self
            .0
            .run(ort::inputs!["input" => TensorRef::from_array_view((INPUT, input))?])?;
        let (_, values) = outputs[0].try_extract_tensor::<f32>()?;
        Ok(forces_n(values, scaling))
    }
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
