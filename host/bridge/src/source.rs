//! Where pictures come from. First form: the simulated fingertip in a simulated gripper, which also knows the truth.
//! Pictures are 440×440 grey crops.

use std::fmt;
use std::str::FromStr;

use gripline_protocol::message::GripMode;
use gripline_simulation::{GripScene, SimulationError};

use crate::telemetry::Truth;

/// Which source: the value of `--source`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Source {
    /// The scripted scene of the simulated world.
    #[default]
    Simulated,
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "sim" => Ok(Self::Simulated),
            _ => Err(format!("found {text}, expected sim")),
        }
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Simulated => f.write_str("sim"),
        }
    }
}

/// A picture and what is known about it.
#[derive(Debug)]
pub struct Picture {
    /// 440×440 grey levels, row-major.
    pub crop: Vec<u8>,
    /// What the simulated world knows.
    pub truth: Truth,
    /// What the scene's script wants of the gripper.
    pub wish: GripMode,
}

/// The simulated fingertip and gripper.
#[derive(Debug)]
pub struct SimulatedSource {
    scene: GripScene,
    frame_s: f64,
}

impl SimulatedSource {
    /// A scene whose gel, particles and noise follow from `seed`, at so many frames a second.
    #[must_use]
    pub fn new(seed: u64, frames_per_second: f64) -> Self {
        Self {
            scene: GripScene::new(seed),
            frame_s: 1.0 / frames_per_second,
        }
    }

    /// Pictures at rest, each with noise of its own.
    pub fn rest(&mut self, count: usize) -> Vec<Vec<u8>> {
        (0..count).map(|_| self.scene.rest_image().pixels).collect()
    }

    /// The next picture, with the gripper at this grip-force line.
    ///
    /// # Errors
    /// [`SimulationError`] when the line is not a force.
    pub fn next(&mut self, line_n: f64) -> Result<Picture, SimulationError> {
        let frame = self.scene.step(self.frame_s, line_n)?;
        let [pull_x, pull_y] = frame.load.shear_n;
        Ok(Picture {
            crop: frame.image.pixels,
            truth: Truth {
                phase: frame.phase.into(),
                normal_n: if frame.touching { frame.load.normal_n } else { 0.0 },
                shear_n: pull_x.hypot(pull_y),
                stick_ratio: frame.true_stick_ratio,
                gross_slip: frame.gross_slip,
                slip_mm: frame.slip_mm,
            },
            wish: if frame.phase == "release" {
                GripMode::Released
            } else {
                GripMode::Hold
            },
        })
    }
}
