//! A scene of kind `press` frame by frame.

use gripline_simulation::scene_file::{FrameSize, PressScene, SceneFile};
use gripline_simulation::{Fingertip, FingertipParams, Image, PressWorld, SimulationError};

use super::moment::{FingerMoment, Moment, Play, PlayError, REST};
use crate::error::EvaluationError;

/// Names of the columns that only a press has.
const PRESS_COLUMNS: [&str; 7] = [
    "x_mm",
    "y_mm",
    "depth_mm",
    "turn_deg",
    "tilt_x_deg",
    "tilt_y_deg",
    "area_mm2",
];

/// A press under way.
#[derive(Debug)]
pub(super) struct PressPlay {
    file: SceneFile,
    scene: PressScene,
    seed: u64,
    fingertip: Fingertip,
    world: PressWorld,
    time_s: f64,
}

impl PressPlay {
    pub(super) fn new(file: &SceneFile, scene: &PressScene, seed: u64) -> Result<Self, SimulationError> {
        let sensor = &file.sensor;
        let params: FingertipParams = sensor.params;
        let world = PressWorld::new(scene, &params.gel, file.frames_per_second)?;
        Ok(Self {
            file: file.clone(),
            scene: scene.clone(),
            seed,
            fingertip: Fingertip::new(sensor.unit.unwrap_or(seed), params)?,
            world,
            time_s: 0.0,
        })
    }
}

impl Play for PressPlay {
    fn kind(&self) -> &'static str {
        "press"
    }

    fn frames(&self) -> usize {
        self.world.frames()
    }

    fn fingers(&self) -> usize {
        1
    }

    fn extra_columns(&self) -> &'static [&'static str] {
        &PRESS_COLUMNS
    }

    /// The last frame of every step of the path.
    fn highlights(&self) -> Vec<usize> {
        let mut seconds = 0.0;
        let ends = self.scene.path.iter().map(|step| {
            seconds += step.seconds;
            (seconds * self.file.frames_per_second + 1e-6) as usize
        });
        let mut ends: Vec<usize> = ends
            .filter_map(|frames| frames.checked_sub(1))
            .map(|frame| frame.min(self.world.frames() - 1))
            .collect();
        ends.dedup();
        ends
    }

    fn advance(&mut self) -> Result<Option<Moment>, PlayError> {
        let frame = match self.world.advance() {
            Ok(Some(frame)) => frame,
            Ok(None) => return Ok(None),
            Err(problem) => {
                return Err(match problem.error {
                    SimulationError::ContactUnsolved { .. } => PlayError::Unsolved {
                        time_s: problem.time_s,
                        why: problem.error.to_string(),
                        phase: problem.phase,
                    },
                    SimulationError::OffSurface { x_mm, y_mm } => {
                        PlayError::from(EvaluationError::Scene(self.file.problem(
                            problem.line,
                            &format!(
                                "an indenter whose contact reaches the edge of the sensor, at ({x_mm:.1}, \
                                 {y_mm:.1}) mm after {:.3} s",
                                problem.time_s
                            ),
                            "contact inside ±16 mm",
                            "move the indenter inwards or press less in this step",
                        )))
                    }
                    _ => EvaluationError::from(problem).into(),
                });
            }
        };
        self.time_s = frame.time_s;
        let truth = frame.truth;
        let pose = truth.pose();
        Ok(Some(Moment {
            time_s: frame.time_s,
            phase: frame.step.name.clone(),
            slip: truth.gross_slip(),
            extra: vec![
                pose.at_mm[0],
                pose.at_mm[1],
                pose.depth_mm,
                pose.turn_rad.to_degrees(),
                pose.tilt_rad[0].to_degrees(),
                pose.tilt_rad[1].to_degrees(),
                truth.area_mm2(),
            ],
            fingers: vec![FingerMoment {
                forces: truth.force_map(),
                stick_ratio: truth.stick_ratio(),
                gross_slip: truth.gross_slip(),
                slip_mm: truth.slip_distance_mm(),
                indentation: truth.indentation_share(&self.file.sensor.params.gel),
                states: truth.states().to_vec(),
            }],
        }))
    }

    fn render(&mut self, _: usize, number: usize, size: FrameSize) -> Image {
        self.fingertip.restart_noise(self.seed, number as u64);
        self.fingertip.set_time(self.time_s);
        let mut image = Image::new(0, 0);
        match size {
            FrameSize::Crop => self.fingertip.render(self.world.truth(), &mut image),
            FrameSize::Full => self.fingertip.render_frame(self.world.truth(), &mut image),
        }
        image
    }

    fn rest(&mut self, _: usize, size: FrameSize) -> Image {
        self.fingertip.restart_noise(self.seed, REST as u64);
        match size {
            FrameSize::Crop => self.fingertip.rest_image(),
            FrameSize::Full => self.fingertip.rest_frame(),
        }
    }
}
