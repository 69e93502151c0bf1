//! The world of a scene, frame by frame, the same way for every kind of scene. Touches nothing.

mod grasp;
mod press;

use gripline_simulation::contact_world::CellState;
use gripline_simulation::scene_file::{FrameSize, Scene, SceneFile};
use gripline_simulation::{ForceMap, Image};

use crate::error::Failure;

/// What is true of one finger at one frame.
#[derive(Debug, Clone)]
pub(super) struct FingerMoment {
    /// Newtons per taxel.
    pub(super) forces: ForceMap,
    /// Share of the contact that sticks.
    pub(super) stick_ratio: Option<f64>,
    /// Whether the contact slides as a whole.
    pub(super) gross_slip: bool,
    /// Way slid over the skin, mm.
    pub(super) slip_mm: f64,
    /// Depth of the indenter over the thickness of the gel.
    pub(super) indentation: f64,
    /// What the cells of the skin do.
    pub(super) states: Vec<CellState>,
}

/// What is true at one frame.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    pub(super) time_s: f64,
    pub(super) phase: String,
    /// The label SLIP.
    pub(super) slip: bool,
    pub(super) fingers: Vec<FingerMoment>,
    /// Values of [`Play::extra_columns`].
    pub(super) extra: Vec<f64>,
}

/// A frame without result.
#[derive(Debug)]
pub(super) enum Trouble {
    /// The contact could not be solved: the frame is left out and the scene goes on.
    Unsolved { time_s: f64, phase: String, why: String },
    /// The scene asks for what cannot be.
    Impossible(Failure),
}

/// A scene under way.
pub(super) trait Play {
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
const REST: usize = u32::MAX as usize;

/// The scene at its start.
pub(super) fn open(file: &SceneFile, seed: u64) -> Result<Box<dyn Play + '_>, Failure> {
    match &file.scene {
        Scene::Press(scene) => Ok(Box::new(press::PressPlay::new(file, scene, seed)?)),
        Scene::Grasp(scene) => Ok(Box::new(grasp::GraspPlay::new(file, scene, seed)?)),
    }
}

/// At most so many of a scene's highlights, the last one among them.
pub(super) fn highlights(play: &dyn Play, most: usize) -> Vec<usize> {
    let ends = play.highlights();
    let take = ends.len().min(most);
    let mut chosen: Vec<usize> = (0..take)
        .map(|k| ends[((k + 1) * ends.len()).div_ceil(take) - 1])
        .collect();
    chosen.dedup();
    chosen
}
