//! `gripline.Detector`: the microcontroller's detector over force maps, each for itself alone, as `gripline detect`.

use gripline_evaluation::detect::judge::Settings;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Maps;
use crate::verdicts::{Verdicts, judge_frame, pitch_of, settings_of};

/// Frames between two looks at whether the user wants to stop: a few milliseconds.
pub(crate) const STRIDE: usize = 4_096;

/// The microcontroller's slip detector over force maps, each map for itself alone.
///
/// mu: friction coefficient, 0 to 2 in steps of 0.0001.
/// threshold: a frame slips when its stick ratio is below this, 0 to 1 in steps of 0.0001.
/// contact_min: a taxel is in contact when its normal force exceeds this, newtons, 0 to 8.
/// scale: newtons per unit of the maps.
/// pitch_mm: distance of neighbouring taxels, 0.1 to 10, for mz.
#[pyclass(frozen, module = "gripline")]
pub(crate) struct Detector {
    settings: Settings,
    pitch_mm: f64,
}

#[pymethods]
impl Detector {
    #[new]
    #[pyo3(signature = (mu=0.45, threshold=0.5, contact_min=0.0, scale=1.0, pitch_mm=1.6))]
    fn new(mu: f64, threshold: f64, contact_min: f64, scale: f64, pitch_mm: f64) -> PyResult<Self> {
        Ok(Self {
            settings: settings_of(mu, threshold, contact_min, scale)?,
            pitch_mm: pitch_of(pitch_mm)?,
        })
    }

    /// Judges maps of shape (T, 3, R, C), float32 or float64, newtons; R and C up to 20, channels x, y, z.
    ///
    /// A smaller grid sits in the corner (row 0, column 0) of an empty 20 x 20 map. The array is read where it lies.
    /// Returns arrays of length T by name: frame, fn, fx, fy, ft (N), mz (N mm), contact, stick (taxels), stick_ratio
    /// (NaN where nothing touches), coulomb_slip, slip, and saturated (components beyond 8 N that were clipped).
    /// Raises TypeError or ValueError that names what was found and what was expected.
    fn __call__<'py>(&self, py: Python<'py>, maps: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let maps = Maps::of(maps)?;
        let frames = maps.frames();
        let mut verdicts = Verdicts::with_room(frames, self.pitch_mm)?;
        if let Some(view) = maps.view() {
            for from in (0..frames).step_by(STRIDE) {
                let until = frames.min(from + STRIDE);
                py.detach(|| {
                    (from..until).try_for_each(|frame| {
                        let (quantised, verdict) = judge_frame(&view, frame, &self.settings)?;
                        verdicts.push(&verdict, quantised.saturated);
                        Ok::<_, PyErr>(())
                    })
                })?;
                py.check_signals()?;
            }
        }
        verdicts.into_dict(py, 0)
    }
}
