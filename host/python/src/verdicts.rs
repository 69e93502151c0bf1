//! What the detector says of maps, column by column, named as the columns of `gripline detect`. Newtons and N·mm.

use gripline_evaluation::detect::judge::{Quantised, Settings, Verdict, judge, quantise};
use gripline_recording::units::{force_n, moment_nmm, shear_n, stick_ratio};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{MapsView, or_nan, room};
use crate::values::{positive, within};

/// The detector's settings out of Python's numbers.
pub(crate) fn settings_of(mu: f64, threshold: f64, contact_min: f64, scale: f64) -> PyResult<Settings> {
    Ok(Settings::of(
        within("mu", mu, &(0.0..=2.0))?,
        within("threshold", threshold, &(0.0..=1.0))?,
        within("contact_min", contact_min, &(0.0..=8.0))?,
        positive("scale", scale)?,
    ))
}

/// Distance of neighbouring taxels, mm, out of Python's number.
pub(crate) fn pitch_of(pitch_mm: f64) -> PyResult<f64> {
    within("pitch_mm", pitch_mm, &(0.1..=10.0))
}

/// One frame through the detector.
pub(crate) fn judge_frame(
    maps: &MapsView<'_>,
    frame: usize,
    settings: &Settings,
) -> PyResult<(Quantised, Verdict)> {
    let quantised = quantise(&maps.frame(frame)?, settings.scale);
    let verdict = judge(&quantised.map, settings);
    Ok((quantised, verdict))
}

/// One list a column.
pub(crate) struct Verdicts {
    /// Distance of neighbouring taxels, mm.
    pitch_mm: f64,
    normal: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    shear: Vec<f64>,
    moment: Vec<f64>,
    contact: Vec<u16>,
    stick: Vec<u16>,
    stick_ratio: Vec<f64>,
    coulomb_slip: Vec<bool>,
    slip: Vec<bool>,
    saturated: Vec<u16>,
}

impl Verdicts {
    /// Room for this many frames, whose taxels are `pitch_mm` apart.
    pub(crate) fn with_room(frames: usize, pitch_mm: f64) -> PyResult<Self> {
        Ok(Self {
            pitch_mm,
            normal: room(frames)?,
            x: room(frames)?,
            y: room(frames)?,
            shear: room(frames)?,
            moment: room(frames)?,
            contact: room(frames)?,
            stick: room(frames)?,
            stick_ratio: room(frames)?,
            coulomb_slip: room(frames)?,
            slip: room(frames)?,
            saturated: room(frames)?,
        })
    }

    /// Adds a frame.
    pub(crate) fn push(&mut self, verdict: &Verdict, saturated: u16) {
        let sums = &verdict.sums;
        let [x, y, normal] = force_n(sums);
        self.normal.push(normal);
        self.x.push(x);
        self.y.push(y);
        self.shear.push(shear_n(sums));
        self.moment.push(moment_nmm(sums, self.pitch_mm));
        self.contact.push(sums.contact);
        self.stick.push(sums.stick);
        self.stick_ratio.push(or_nan(stick_ratio(sums)));
        self.coulomb_slip.push(verdict.coulomb_slip);
        self.slip.push(verdict.slip);
        self.saturated.push(saturated);
    }

    /// As arrays by name; frames are numbered from `first` on.
    pub(crate) fn into_dict(self, py: Python<'_>, first: u64) -> PyResult<Bound<'_, PyDict>> {
        let columns = PyDict::new(py);
        let last = first + self.normal.len() as u64;
        let numbers: Vec<i64> = (first..last).map(|frame| frame as i64).collect();
        columns.set_item("frame", PyArray1::from_vec(py, numbers))?;
        for (name, column) in [
            ("fn", self.normal),
            ("fx", self.x),
            ("fy", self.y),
            ("ft", self.shear),
            ("mz", self.moment),
        ] {
            columns.set_item(name, PyArray1::from_vec(py, column))?;
        }
        columns.set_item("contact", PyArray1::from_vec(py, self.contact))?;
        columns.set_item("stick", PyArray1::from_vec(py, self.stick))?;
        columns.set_item("stick_ratio", PyArray1::from_vec(py, self.stick_ratio))?;
        columns.set_item("coulomb_slip", PyArray1::from_vec(py, self.coulomb_slip))?;
        columns.set_item("slip", PyArray1::from_vec(py, self.slip))?;
        columns.set_item("saturated", PyArray1::from_vec(py, self.saturated))?;
        Ok(columns)
    }
}
