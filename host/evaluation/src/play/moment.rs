//! What every kind of scene gives, frame by frame.

use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_simulation::contact_world::CellState;
use gripline_simulation::scene_file::FrameSize;
use gripline_simulation::{ForceMap, Image};

use crate::error::EvaluationError;

/// What is true of one finger at one frame.
#[derive(Debug, Clone)]
pub struct FingerMoment {
    /// Newtons per taxel.
    pub forces: ForceMap,
    /// Share of the contact that sticks.
    pub stick_ratio: Option<f64>,
    /// Whether the contact slides as a whole.
    pub gross_slip: bool,
    /// Distance slid over the skin, mm.
    pub slip_mm: f64,
    /// Depth of the indenter over the thickness of the gel.
    pub indentation: f64,
    /// What the cells of the skin do.
    pub states: Vec<CellState>,
}

impl FingerMoment {
    /// Sum of the forces, N: x, y, z.
    #[must_use]
    pub fn force_n(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for force in &self.forces {
            for (sum, more) in sum.iter_mut().zip(force) {
                *sum += f64::from(*more);
            }
        }
        sum
    }

    /// Moment about z at the middle of the map, N·mm, as `gripline detect` computes it.
    #[must_use]
    pub fn moment_nmm(&self) -> f64 {
        let at = |i: usize| (i as f64 - 9.5) * TAXEL_PITCH_MM;
        self.forces
            .iter()
            .enumerate()
            .map(|(taxel, [fx, fy, _])| at(taxel % 20) * f64::from(*fy) - at(taxel / 20) * f64::from(*fx))
            .sum()
    }
}

/// What is true at one frame.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Time since the scene began.
    pub time_s: f64,
    /// Part of the scene, as it calls it.
    pub phase: String,
    /// The label SLIP.
    pub slip: bool,
    /// One a finger.
    pub fingers: Vec<FingerMoment>,
    /// Values of [`Play::extra_columns`].
    pub extra: Vec<f64>,
}

/// A frame without result.
#[derive(Debug)]
pub enum PlayError {
    /// The contact could not be solved: the frame is left out and the scene goes on.
    Unsolved {
        /// Time since the scene began.
        time_s: f64,
        /// Part of the scene.
        phase: String,
        /// The residual, and what would help.
        why: String,
    },
    /// The scene asks for what cannot be.
    Impossible(Box<EvaluationError>),
}

impl From<EvaluationError> for PlayError {
    fn from(error: EvaluationError) -> Self {
        Self::Impossible(Box::new(error))
    }
}

/// A scene under way.
pub trait Play {
    /// The kind of scene, as in its file.
    fn kind(&self) -> &'static str;
    /// Frames of the whole scene.
    fn frames(&self) -> usize;
    /// Fingers that look.
    fn fingers(&self) -> usize;
    /// Names of the columns that only this kind of scene has.
    fn extra_columns(&self) -> &'static [&'static str];
    /// Frames that show what happens, in order: the preview takes some of them.
    fn highlights(&self) -> Vec<usize>;
    /// Goes to the next frame; none after the last.
    ///
    /// # Errors
    /// [`PlayError`]: a frame without result, or the end of a scene that cannot be.
    fn advance(&mut self) -> Result<Option<Moment>, PlayError>;
    /// A finger's picture now; the noise follows from the scene's seed and `number` alone.
    fn render(&mut self, finger: usize, number: usize, size: FrameSize) -> Image;
    /// A finger's picture before anything touches.
    fn rest(&mut self, finger: usize, size: FrameSize) -> Image;
}

/// Number of the rest picture, which no frame has.
pub(super) const REST: usize = u32::MAX as usize;
