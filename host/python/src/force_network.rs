//! `gripline.ForceNetwork`: pictures of a fingertip to force maps, as `gripline infer`.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use gripline_network::constants::GAINS;
use gripline_network::{Architecture, Evaluation, Inference, NO_FORCES, Network};
use gripline_sensor::Sensor;
use numpy::ndarray::Axis;
use numpy::{Ix2, Ix3, PyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{array_of, planes, room, shaped, texts, typed};
use crate::error::failed;
use crate::pictures::Cropper;
use crate::values::named;

/// Pictures between two looks at whether the user wants to stop: some 100 ms.
const STRIDE: usize = 64;
const GREY: &str = "uint8 grey levels: convert a colour picture to grey";

/// The force network of a fingertip: pictures in, maps of contact forces out.
///
/// rest: the untouched fingertip, (H, W) uint8, 640x480, 440x440 or, for 'unet', 88x88.
/// network: 'tracked' follows particles at full resolution, 'unet' looks at small images.
/// weights: a safetensors file instead of the built-in weights.
/// sensor: a shipped sensor's name or a TOML file; says where in a picture the fingertip is.
/// gain: factors on shear and normal force: gel.shear_gain and gel.normal_gain of a file that `gripline calibrate gel` wrote.
/// engine: 'skip' computes only what can differ from the picture before, 'dense' all; the maps are the same.
#[pyclass(frozen, module = "gripline")]
pub(crate) struct ForceNetwork {
    inference: Mutex<Inference>,
    cropper: Cropper,
}

#[pymethods]
impl ForceNetwork {
    #[new]
    #[pyo3(signature = (rest, *, network="tracked", weights=None, sensor=None, gain=None, engine="skip"))]
    fn new(
        py: Python<'_>,
        rest: &Bound<'_, PyAny>,
        network: &str,
        weights: Option<PathBuf>,
        sensor: Option<PathBuf>,
        gain: Option<(f64, f64)>,
        engine: &str,
    ) -> PyResult<Self> {
        let architectures = Architecture::ALL.map(|architecture| (architecture.name(), architecture));
        let architecture = named("network", network, &architectures)?;
        let evaluation = named(
            "engine",
            engine,
            &[("skip", Evaluation::Skip), ("dense", Evaluation::Dense)],
        )?;
        let gain = gain.map_or([1.0; 2], <[f64; 2]>::from);
        if let Some(found) = gain.iter().find(|gain| !GAINS.contains(gain)) {
            let (least, most) = (GAINS.start(), GAINS.end());
            return Err(failed(format!(
                "gain: found {found}, expected two numbers from {least} to {most}"
            )));
        }
        let sensor = sensor.unwrap_or_else(|| PathBuf::from("particle-fingertip"));
        let sensor = Sensor::named(Path::new(&sensor)).map_err(failed)?;
        let cropper = Cropper::of(&sensor, architecture == Architecture::Unet)?;
        let array = array_of("rest", rest, 2, "(H, W), one picture of the untouched fingertip")?;
        let rest = typed::<u8, Ix2>("rest", array, GREY)?;
        let &[rows, columns] = array.shape() else {
            return Err(failed("rest: expected two dimensions"));
        };
        cropper.check("rest", rows, columns)?;
        let mut crop = Vec::new();
        cropper.apply(&rest.as_array(), &mut crop);
        let inference = py.detach(move || {
            let network = match &weights {
                Some(path) => Network::from_file(path, Some(architecture)),
                None => Network::embedded(architecture),
            }
            .map_err(failed)?;
            let network = network
                .with_evaluation(evaluation)
                .with_gain(gain.map(|gain| gain as f32));
            Ok::<_, PyErr>(Inference::new(network, &crop))
        })?;
        Ok(Self {
            inference: Mutex::new(inference),
            cropper,
        })
    }

    /// Infers the forces of pictures of shape (T, H, W), uint8, of the sizes that rest may have.
    ///
    /// Returns maps, (T, 3, 20, 20) float32, newtons per taxel with channels x, y, z; good, (T,) bool; and health, (T,)
    /// text: 'good' or what is known against the picture, whose map is then of zeros.
    /// Raises TypeError or ValueError that names what was found and what was expected.
    fn infer<'py>(&self, py: Python<'py>, pictures: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let array = array_of("pictures", pictures, 3, "(T, H, W), grey pictures")?;
        let pictures = typed::<u8, Ix3>("pictures", array, GREY)?;
        let &[frames, rows, columns] = array.shape() else {
            return Err(failed("pictures: expected three dimensions"));
        };
        self.cropper.check("pictures", rows, columns)?;
        let mut maps: Vec<f32> = room(frames.saturating_mul(NO_FORCES.len() * 3))?;
        let mut health: Vec<String> = room(frames)?;
        let mut good: Vec<bool> = room(frames)?;
        for from in (0..frames).step_by(STRIDE) {
            let view = pictures.as_array();
            let until = frames.min(from + STRIDE);
            py.detach(|| {
                // A picture that failed half way leaves nothing that the next one does not replace.
                let mut inference = self.inference.lock().unwrap_or_else(PoisonError::into_inner);
                let mut crop = Vec::new();
                for frame in from..until {
                    let mut map = NO_FORCES;
                    self.cropper.apply(&view.index_axis(Axis(0), frame), &mut crop);
                    let of_picture = inference.infer(&crop, &mut map);
                    maps.extend(planes(&map));
                    good.push(of_picture.is_good());
                    health.push(of_picture.to_string());
                }
            });
            py.check_signals()?;
        }
        let result = PyDict::new(py);
        result.set_item("maps", shaped(py, maps, [frames, 3, 20, 20])?)?;
        result.set_item("good", PyArray1::from_vec(py, good))?;
        result.set_item("health", texts(py, &health)?)?;
        Ok(result)
    }
}
