//! The native half of the Python package `gripline`: the firmware library's detector and grip controller, the force network, the
//! simulated world and recordings, over NumPy arrays that are read where they lie.
//!
//! Each file is one class or function of the package; `arrays` is what all of them ask of an array, `worker` the thread of
//! what may not change threads. Names, shapes and units are the package's own documentation: `python/gripline/_gripline.pyi`.
//! Limits: whoever writes into an array while it is being read gets a mix of both; nothing here guards against that.
#![deny(unsafe_code)]

mod arrays;
mod controller;
mod detector;
mod error;
mod force_network;
mod pictures;
mod recording;
mod samples;
mod scene;
mod shipped_scenes;
mod values;
mod verdicts;
mod worker;

use pyo3::prelude::*;

#[pymodule]
fn _gripline(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("GriplineError", module.py().get_type::<error::GriplineError>())?;
    module.add_class::<detector::Detector>()?;
    module.add_class::<controller::Controller>()?;
    module.add_class::<force_network::ForceNetwork>()?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<samples::TrainingSamples>()?;
    module.add_function(wrap_pyfunction!(scene::scenes, module)?)?;
    module.add_function(wrap_pyfunction!(recording::read_recording, module)?)
}
