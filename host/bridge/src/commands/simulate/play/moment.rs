//! What every kind of scene gives, frame by frame.

use gripline_simulation::contact_world::CellState;
use gripline_simulation::scene_file::FrameSize;
use gripline_simulation::{ForceMap, Image};

use crate::error::Failure;

/// What is true of one finger at one frame.
#[derive(Debug, Clone)]
pub(in crate::commands::simulate) struct FingerMoment {
    /// Newtons per taxel.
    pub(in crate::commands::simulate) forces: ForceMap,
    /// Share of the contact that sticks.
    pub(in crate::commands::simulate) stick_ratio: Option<f64>,
    /// Whether the contact slides as a whole.
    pub(in crate::commands::simulate) gross_slip: bool,
    /// Way slid over the skin, mm.
    pub(in crate::commands::simulate) slip_mm: f64,
    /// Depth of the indenter over the thickness of the gel.
    pub(in crate::commands::simulate) indentation: f64,
    /// What the cells of the skin do.
    pub(in crate::commands::simulate) states: Vec<CellState>,
}

/// What is true at one frame.
#[derive(Debug, Clone)]
pub(in crate::commands::simulate) struct Moment {
    pub(in crate::commands::simulate) time_s: f64,
    pub(in crate::commands::simulate) phase: String,
    /// The label SLIP.
    pub(in crate::commands::simulate) slip: bool,
    pub(in crate::commands::simulate) fingers: Vec<FingerMoment>,
    /// Values of [`Play::extra_columns`].
    pub(in crate::commands::simulate) extra: Vec<f64>,
}

/// A frame without result.
#[derive(Debug)]
pub(in crate::commands::simulate) enum Trouble {
    /// The contact could not be solved: the frame is left out and the scene goes on.
    Unsolved { time_s: f64, phase: String, why: String },
    /// The scene asks for what cannot be.
    Impossible(Failure),
}

/// A scene under way.
pub(in crate::commands::simulate) trait Play {
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
    fn advance(&mut self) -> Result<Option<Moment>, Trouble>;
    /// A finger's picture now; the noise follows from the scene's seed and `number` alone.
    fn render(&mut self, finger: usize, number: usize, size: FrameSize) -> Image;
    /// A finger's picture before anything touches.
    fn rest(&mut self, finger: usize, size: FrameSize) -> Image;
}

/// Number of the rest picture, which no frame has.
pub(super) const REST: usize = u32::MAX as usize;
