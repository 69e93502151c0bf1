//! `gripline.read_recording`: a recording of `gripline run --record` as NumPy arrays, as `gripline export` names them.

use std::path::{Path, PathBuf};

use gripline_protocol::SensorId;
use gripline_recording::{Completeness, Metadata, Reader, RecordedStatus, units};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{or_nan, planes, require_numpy, shaped, texts};
use crate::error::failed;

/// What is read of a recording.
#[derive(Default)]
struct Contents {
    maps: Vec<f32>,
    frames: Vec<RecordedStatus>,
    pixels: Vec<u8>,
    pictures: usize,
    /// Shape of every picture; none while there was none.
    shape: Option<Vec<usize>>,
    rest: Vec<Vec<u8>>,
    metadata: Metadata,
    truncated: Option<String>,
}

impl Contents {
    /// Goes through the file once; stops where the user wants it.
    fn read(path: &Path, sensor: SensorId, pictures: bool) -> PyResult<Self> {
        let mut contents = Self::default();
        let mut reader = Reader::open(path).map_err(failed)?;
        let mut read = 0_u32;
        while let Some(frame) = reader.next_frame().map_err(failed)? {
            read += 1;
            if read.is_multiple_of(256) {
                stop_if_asked()?;
            }
            if frame.status.sensor != sensor {
                continue;
            }
            contents.maps.extend(planes(&frame.map.dequantise()));
            contents.frames.push(frame.status);
            // Only where all frames have one of the same size do they make an array.
            if let Some(picture) = frame.picture.filter(|_| pictures)
                && *contents.shape.get_or_insert_with(|| picture.shape()) == picture.shape()
            {
                contents.pixels.extend(picture.pixels);
                contents.pictures += 1;
            }
        }
        if contents.frames.is_empty() {
            return Err(failed(format!(
                "{}: found no frame of fingertip {sensor}, expected some: ask for the other one",
                path.display()
            )));
        }
        if let Completeness::Truncated(why) = reader.completeness() {
            contents.truncated = Some(why);
        }
        contents.rest = std::mem::take(&mut reader.rest[sensor.index()]);
        contents.metadata = std::mem::take(&mut reader.metadata);
        Ok(contents)
    }

    /// The columns of `frames.csv`.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let columns = PyDict::new(py);
        let numbers = |name: &str, of: &dyn Fn(&RecordedStatus) -> f64| {
            columns.set_item(name, PyArray1::from_iter(py, self.frames.iter().map(of)))
        };
        let flags = |name: &str, of: &dyn Fn(&RecordedStatus) -> bool| {
            columns.set_item(name, PyArray1::from_iter(py, self.frames.iter().map(of)))
        };
        let words = |name: &str, of: &dyn Fn(&RecordedStatus) -> String| {
            columns.set_item(name, texts(py, self.frames.iter().map(of))?)
        };
        let whole = |name: &str, of: &dyn Fn(&RecordedStatus) -> i64| {
            columns.set_item(name, PyArray1::from_iter(py, self.frames.iter().map(of)))
        };
        whole("frame", &|status| status.frame as i64)?;
        numbers("t_s", &|status| status.t_s)?;
        words("gate", &|status| status.gate.clone())?;
        words("health", &|status| status.health.join(" "))?;
        numbers("fn", &|status| status.normal_n)?;
        numbers("fx", &|status| status.shear_x_n)?;
        numbers("fy", &|status| status.shear_y_n)?;
        numbers("ft", &|status| status.shear_n)?;
        numbers("mz", &|status| status.moment_nmm)?;
        whole("contact", &|status| status.contact.into())?;
        whole("stick", &|status| status.stick.into())?;
        numbers("stick_ratio", &|status| or_nan(status.stick_ratio))?;
        flags("coulomb_slip", &|status| status.coulomb_slip)?;
        words("state", &|status| status.state.clone())?;
        numbers("line_n", &|status| status.line_n)?;
        numbers("latency_us", &|status| status.latency_us)?;
        words("faults", &|status| status.faults.join(" "))?;
        if self.frames.iter().any(|status| status.truth.is_some()) {
            let truth = |status: &RecordedStatus| status.truth.clone();
            words("truth_phase", &|status| {
                truth(status).map_or_else(String::new, |truth| truth.phase)
            })?;
            numbers("truth_fn", &|status| {
                or_nan(truth(status).map(|truth| truth.normal_n))
            })?;
            numbers("truth_ft", &|status| {
                or_nan(truth(status).map(|truth| truth.shear_n))
            })?;
            numbers("truth_stick_ratio", &|status| {
                or_nan(truth(status).and_then(|truth| truth.stick_ratio))
            })?;
            flags("truth_gross_slip", &|status| {
                truth(status).is_some_and(|truth| truth.gross_slip)
            })?;
            numbers("truth_slip_mm", &|status| {
                or_nan(truth(status).map(|truth| truth.slip_mm))
            })?;
        }
        numbers("slip_evidence", &|status| units::ratio(status.wire.slip_evidence))?;
        Ok(columns)
    }
}

#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "the method itself is not general enough in its lifetime"
)]
fn stop_if_asked() -> PyResult<()> {
    Python::attach(|py| py.check_signals())
}

/// Reads a recording of `gripline run --record` (MCAP) into memory.
///
/// sensor: the fingertip, 0 or 1. pictures: False leaves the pictures out.
///
/// Returns maps, (T, 3, 20, 20) float32 newtons; pictures, (T, S, S) uint8, or None unless every frame has one; rest,
/// (N, 440, 440) uint8; columns, arrays of length T named as in frames.csv (NaN where nothing touches; the truth's columns
/// only where a simulated world was recorded); metadata, text by name; and truncated, None or why the file was cut short.
/// Raises GriplineError that names the file, what was found and what was expected.
#[pyfunction]
#[pyo3(signature = (path, *, sensor=0, pictures=true))]
pub(crate) fn read_recording(
    py: Python<'_>,
    path: PathBuf,
    sensor: u8,
    pictures: bool,
) -> PyResult<Bound<'_, PyDict>> {
    require_numpy(py)?;
    let sensor = SensorId::try_from(sensor)
        .map_err(|_| PyValueError::new_err(format!("sensor: found {sensor}, expected 0 or 1")))?;
    let contents = py.detach(move || Contents::read(&path, sensor, pictures))?;
    let count = contents.frames.len();
    let recording = PyDict::new(py);
    recording.set_item("columns", contents.columns(py)?)?;
    recording.set_item("maps", shaped(py, contents.maps, [count, 3, 20, 20])?)?;
    let shape = contents.shape.filter(|_| contents.pictures == count);
    let pixels = contents.pixels;
    match shape.as_deref() {
        Some([rows, columns]) => {
            recording.set_item("pictures", shaped(py, pixels, [count, *rows, *columns])?)?;
        }
        Some([rows, columns, levels]) => {
            recording.set_item("pictures", shaped(py, pixels, [count, *rows, *columns, *levels])?)?;
        }
        _ => recording.set_item("pictures", py.None())?,
    }
    let rests = contents.rest.len();
    let rest: Vec<u8> = contents.rest.into_iter().flatten().collect();
    // Those of printed markers are in colour; their shape is that of the pictures.
    match shape.as_deref() {
        Some([rows, columns, levels]) if rest.len() == rests * rows * columns * levels => {
            recording.set_item("rest", shaped(py, rest, [rests, *rows, *columns, *levels])?)?;
        }
        _ if rest.len() == rests * 440 * 440 => {
            recording.set_item("rest", shaped(py, rest, [rests, 440, 440])?)?;
        }
        _ => recording.set_item("rest", py.None())?,
    }
    recording.set_item("metadata", contents.metadata.to_map())?;
    recording.set_item("truncated", contents.truncated)?;
    Ok(recording)
}
