//! `gripline.Controller`: the microcontroller's whole program in this process, shown one map after the other, as `gripline detect
//! --state --line`. It remembers: a call goes on where the last one stopped.

use gripline_evaluation::detect::judge::{Quantised, Settings, Verdict};
use gripline_evaluation::detect::replay::{Answer, RATE_HZ, Replay};
use gripline_recording::units::{newtons, ratio};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Maps, room, texts};
use crate::error::failed;
use crate::values::within;
use crate::verdicts::{Verdicts, judge_frame, pitch_of, settings_of};
use crate::worker::Worker;

/// Frames that are shown at once; in between the user may stop.
const STRIDE: usize = 256;

/// The microcontroller's slip detector, slip state machine and grip controller, shown one map after the other.
///
/// It holds from before the first map, and a call goes on where the last one stopped.
///
/// mu, threshold, contact_min, scale, pitch_mm: as those of Detector.
/// rate_hz: maps per second, 10 to 1000; its clock is that of the maps.
#[pyclass(frozen, module = "gripline")]
pub(crate) struct Controller {
    settings: Settings,
    pitch_mm: f64,
    shown: Worker<Shown>,
}

/// A controller and how many maps it has seen.
struct Shown {
    replay: Replay,
    frames: u64,
}

impl Shown {
    fn show(&mut self, judged: &[(Quantised, Verdict)]) -> PyResult<Vec<Answer>> {
        let mut answers = Vec::with_capacity(judged.len());
        for (quantised, verdict) in judged {
            let is_saturated = quantised.saturated > 0;
            let answer = self
                .replay
                .show(self.frames, &quantised.map, is_saturated, verdict);
            answers.push(answer.map_err(failed)?);
            self.frames += 1;
        }
        Ok(answers)
    }
}

#[pymethods]
impl Controller {
    #[new]
    #[pyo3(signature = (mu=0.45, threshold=0.5, contact_min=0.0, scale=1.0, rate_hz=60.0, pitch_mm=1.6))]
    fn new(
        py: Python<'_>,
        mu: f64,
        threshold: f64,
        contact_min: f64,
        scale: f64,
        rate_hz: f64,
        pitch_mm: f64,
    ) -> PyResult<Self> {
        let settings = settings_of(mu, threshold, contact_min, scale)?;
        let rate_hz = within("rate_hz", rate_hz, &RATE_HZ)?;
        let pitch_mm = pitch_of(pitch_mm)?;
        let make = move || {
            let replay = Replay::new(&settings, rate_hz).map_err(failed)?;
            Ok(Shown { replay, frames: 0 })
        };
        let shown = py.detach(|| Worker::start(make))?;
        Ok(Self {
            settings,
            pitch_mm,
            shown,
        })
    }

    /// Shows maps of shape (T, 3, R, C), float32 or float64, newtons; R and C up to 20, channels x, y, z.
    ///
    /// Returns the arrays of Detector and three more of length T: state ('NO_CONTACT', 'STICK', 'INCIPIENT', 'SLIP'),
    /// slip_evidence (0 to 1) and line_n (the grip-force line, newtons). frame counts from the first map ever shown.
    /// Raises TypeError or ValueError that names what was found and what was expected; frames before that were shown.
    fn __call__<'py>(&self, py: Python<'py>, maps: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let maps = Maps::of(maps)?;
        let frames = maps.frames();
        let mut verdicts = Verdicts::with_room(frames, self.pitch_mm)?;
        let mut answers: Vec<Answer> = room(frames)?;
        let mut first = None;
        if let Some(view) = maps.view() {
            for from in (0..frames).step_by(STRIDE) {
                let until = frames.min(from + STRIDE);
                let (before, judged, shown) = py.detach(|| {
                    let judged: Vec<_> = (from..until)
                        .map(|frame| judge_frame(&view, frame, &self.settings))
                        .collect::<PyResult<_>>()?;
                    self.shown.call(move |shown| {
                        let before = shown.frames;
                        shown.show(&judged).map(|answers| (before, judged, answers))
                    })?
                })?;
                first.get_or_insert(before);
                answers.extend(shown);
                for (quantised, verdict) in &judged {
                    verdicts.push(verdict, quantised.saturated);
                }
                py.check_signals()?;
            }
        }
        let columns = verdicts.into_dict(py, first.unwrap_or(0))?;
        columns.set_item(
            "state",
            texts(py, answers.iter().map(|answer| answer.state.name()))?,
        )?;
        let evidence = answers.iter().map(|answer| ratio(answer.slip_evidence));
        columns.set_item("slip_evidence", PyArray1::from_iter(py, evidence))?;
        let line = answers.iter().map(|answer| newtons(answer.line));
        columns.set_item("line_n", PyArray1::from_iter(py, line))?;
        Ok(columns)
    }
}
