//! Recorded presses as samples: every picture of a recording goes through the markers again, and a force-torque sensor's log says
//! what truly pressed. Touches files.

use std::path::Path;

use gripline_evaluation::calibration::gel::{self, Moment, Press};
use gripline_firmware::sums::TaxelRule;
use gripline_network::marker_forces::{MOTION_INPUTS, MarkerNetwork, MarkerWeights, MotionGrid};
use gripline_network::scene::GateKind;
use gripline_pipeline::markers::{MarkerRest, MarkerStage};
use gripline_pipeline::pipeline::Pipeline;
use gripline_protocol::message::Configuration;
use gripline_protocol::{SensorId, TAXELS};
use gripline_recording::{Reader, force_log};
use gripline_sensor::Sensor;

use super::fit::PressedPicture;
use crate::error::{TrainingError, usage};

/// Pictures of a press that are used, evenly over it: more differ by noise alone.
const PICTURES: usize = 6;

/// The presses of all recordings.
#[derive(Debug, Default)]
pub(super) struct PressSamples {
    pub(super) presses: Vec<Press>,
    pub(super) pictures: Vec<PressedPicture>,
    /// Force of each press, N: x, y, normal.
    pub(super) truth_n: Vec<[f64; 3]>,
}

impl PressSamples {
    /// Adds a recording and its log, CSV or MCAP. `weights` tell when something presses, and how the log stands to the maps.
    ///
    /// # Errors
    /// [`TrainingError::Usage`] that names the file when either cannot be used, or they do not belong together.
    pub(super) fn add(
        &mut self,
        recording: &Path,
        (log, topic): (&Path, Option<&str>),
        (sensor, weights): (&Sensor, &MarkerWeights),
    ) -> Result<(), TrainingError> {
        let wrong = |problem: &dyn std::fmt::Display| usage(format!("{}: {problem}", recording.display()));
        let mut reader = Reader::open(recording).map_err(usage)?;
        let sensor = described(&reader, sensor).map_err(|problem| wrong(&problem))?;
        let rest = MarkerRest::recorded(&reader.metadata.rest, &reader.rest[0])
            .map_err(|problem| wrong(&problem))?;
        let network = MarkerNetwork::new(weights)?;
        let stage = MarkerStage::new(&sensor, network.into(), &rest, GateKind::Off)
            .map_err(|problem| wrong(&problem))?;
        let mut pipeline = Pipeline::of_markers(stage, TaxelRule::of(&Configuration::DEFAULT));
        let (mut moments, mut samples) = (Vec::new(), Vec::new());
        let (mut grid, mut start_ns) = (None, None);
        while let Some(frame) = reader.next_frame().map_err(usage)? {
            if frame.status.sensor != SensorId::FIRST {
                continue;
            }
            let picture = frame.picture.ok_or_else(|| {
                wrong(&"found a frame without its picture, expected all: record it with record.pictures at full")
            })?;
            pipeline
                .process(&picture.pixels)
                .map_err(|problem| wrong(&problem))?;
            let stage = pipeline.markers().expect("the pipeline is of markers");
            let grid = grid.get_or_insert_with(|| MotionGrid::new(weights.node_mm, &stage.places_mm()));
            let mut input = Box::new([0.0; MOTION_INPUTS]);
            let rms_mm = grid.fill(stage.motions(), &mut input);
            let newtons = pipeline.newtons().map(|force| force.map(f64::from));
            moments.push(Moment::of(frame.status.t_s, &newtons));
            samples.push((input, rms_mm, stage.touched().unwrap_or([true; TAXELS])));
            let since_ns = (frame.status.t_s.max(0.0) * 1e9) as u64;
            start_ns.get_or_insert(frame.at_ns.saturating_sub(since_ns));
        }
        let forces = force_log(log, topic, start_ns).map_err(usage)?;
        let in_log = |problem: String| usage(format!("{}: {problem}", log.display()));
        let day = self.presses.last().map_or(0, |press| press.day + 1);
        let presses = gel::presses(&moments, day);
        if presses.is_empty() {
            return Err(wrong(
                &"found no press, expected some that are held for a second each",
            ));
        }
        let alignment = gel::align(&moments, &forces, None).map_err(in_log)?;
        let (truth_n, _) = gel::logged(&presses, &forces, &alignment).map_err(in_log)?;
        for (number, press) in presses.iter().enumerate() {
            let [from, to] = press.span_s;
            let held: Vec<_> = moments
                .iter()
                .zip(&samples)
                .filter(|(moment, _)| (from..=to).contains(&moment.t_s))
                .collect();
            for (_, (input, rms_mm, touched)) in held.iter().step_by(held.len().div_ceil(PICTURES)) {
                self.pictures.push(PressedPicture {
                    input: input.clone(),
                    rms_mm: *rms_mm,
                    touched: *touched,
                    press: self.presses.len() + number,
                });
            }
        }
        self.presses.extend(presses);
        self.truth_n.extend(truth_n);
        Ok(())
    }
}

/// The description in a recording, with the field and the lens that its camera was calibrated to; it must be of `expected`.
fn described(reader: &Reader, expected: &Sensor) -> Result<Sensor, String> {
    let metadata = &reader.metadata;
    if metadata.sensor != expected.identity() {
        return Err(format!(
            "found a recording of sensor {}, expected one of {}: name its description with --sensor",
            metadata.sensor,
            expected.identity()
        ));
    }
    let mut sensor = Sensor::from_toml(Path::new(&metadata.sensor), &metadata.sensor_file)
        .map_err(|error| error.to_string())?;
    let [calibration, _] = metadata.calibrations().map_err(|error| error.to_string())?;
    if let Some(view) = calibration.view {
        sensor.see_as(view.field_mm, view.distortion_per_mm2);
    }
    Ok(sensor)
}
