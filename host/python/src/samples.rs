//! `gripline.TrainingSamples`: random pairs of pictures and force maps from the simulated world, in batches.

use std::sync::{Mutex, PoisonError};

use gripline_simulation::constants::{CROP_PX, NETWORK_PX};
use gripline_simulation::{Sample, SampleGenerator, SampleWorld, Split};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{or_nan, planes, require_numpy, room, shaped, texts};
use crate::error::failed;
use crate::values::named;

/// Samples between two looks at whether the user wants to stop: some 100 ms.
const STRIDE: usize = 8;

/// An endless stream of random samples of the simulated world, for training: the same seed and split give the same samples.
///
/// seed: streams of other seeds differ in everything.
/// split: 'train', 'validation', 'calibration' or 'test'; no two share a virtual sensor or a random surface.
/// size: 'small' for pictures of 88x88, 'crop' for 440x440.
#[pyclass(frozen, module = "gripline")]
pub(crate) struct TrainingSamples {
    generator: Mutex<SampleGenerator>,
    crops: bool,
}

#[pymethods]
impl TrainingSamples {
    #[new]
    #[pyo3(signature = (seed, *, split="train", size="small"))]
    fn new(py: Python<'_>, seed: u64, split: &str, size: &str) -> PyResult<Self> {
        require_numpy(py)?;
        let split = named("split", split, &Split::ALL.map(|split| (split.name(), split)))?;
        let crops = named("size", size, &[("small", false), ("crop", true)])?;
        let generator = py.detach(|| {
            let world = SampleWorld::new().map_err(failed)?;
            let generator = SampleGenerator::new(&world, split, seed);
            Ok::<_, PyErr>(if crops { generator.with_crops() } else { generator })
        })?;
        Ok(Self {
            generator: Mutex::new(generator),
            crops,
        })
    }

    /// The next count samples as arrays of length N = count.
    ///
    /// rest, now: the fingertip untouched and under load, (N, S, S) uint8; maps: (N, 3, 20, 20) float32, newtons per taxel;
    /// stick_ratio, friction: (N,) float64, NaN where nothing touches; gross_slip: (N,) bool; shape: (N,) text, the
    /// indenter; sensor: (N,) uint64, the virtual sensor.
    fn batch<'py>(&self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyDict>> {
        if count == 0 {
            return Err(PyValueError::new_err("count: found 0, expected at least 1"));
        }
        let side = if self.crops { CROP_PX } else { NETWORK_PX };
        let pixels = count.saturating_mul(side * side);
        let (mut rest, mut now) = (room(pixels)?, room(pixels)?);
        let mut maps = room(count.saturating_mul(1_200))?;
        let mut samples: Vec<Sample> = room(count)?;
        while samples.len() < count {
            let more = STRIDE.min(count - samples.len());
            py.detach(|| {
                let mut generator = self.generator.lock().unwrap_or_else(PoisonError::into_inner);
                for mut sample in generator.by_ref().take(more) {
                    if let Some(crops) = sample.crops.take() {
                        rest.extend_from_slice(&crops.rest.pixels);
                        now.extend_from_slice(&crops.now.pixels);
                    } else {
                        rest.extend_from_slice(&sample.rest);
                        now.extend_from_slice(&sample.now);
                    }
                    maps.extend(planes(&sample.forces));
                    samples.push(sample);
                }
            });
            py.check_signals()?;
        }
        let batch = PyDict::new(py);
        batch.set_item("rest", shaped(py, rest, [count, side, side])?)?;
        batch.set_item("now", shaped(py, now, [count, side, side])?)?;
        batch.set_item("maps", shaped(py, maps, [count, 3, 20, 20])?)?;
        let ratio = samples.iter().map(|sample| or_nan(sample.true_stick_ratio));
        batch.set_item("stick_ratio", PyArray1::from_iter(py, ratio))?;
        let friction = samples.iter().map(|sample| or_nan(sample.friction));
        batch.set_item("friction", PyArray1::from_iter(py, friction))?;
        let slip = samples.iter().map(|sample| sample.gross_slip);
        batch.set_item("gross_slip", PyArray1::from_iter(py, slip))?;
        batch.set_item("shape", texts(py, samples.iter().map(|sample| sample.shape))?)?;
        let sensor = samples.iter().map(|sample| sample.sensor);
        batch.set_item("sensor", PyArray1::from_iter(py, sensor))?;
        Ok(batch)
    }
}
