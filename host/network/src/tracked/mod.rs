//! The second way from images to forces: the particles of the skin are found at full resolution and followed to a
//! part of a pixel, their motions gathered on a grid in millimetres, and a small network turns those into forces.
//! 440×440 grey crops in, newtons per taxel out; one thread, no allocation per frame.
//!
//! A particle's track follows from the rest image and the image now alone. With [`Evaluation::Skip`] only those whose
//! surroundings changed are followed again, with the same result, bit by bit.

mod changed;
mod compare;
mod flow;
mod grid;
mod lanes;
mod net;
mod particles;
mod patch;
mod pyramid;
mod search;
mod tracker;
mod way;
pub mod weights;
mod window;

use std::path::Path;
use std::sync::Arc;

pub use grid::{GRID_CHANNELS, GRID_NODES, GRID_PITCH_MM, GRID_SIDE, Gather, Grid, empty_grid};
use net::Net;
pub use net::{INPUT_CHANNELS, Precision, folded, input, layers, tensors};
pub use particles::Particle;
pub use search::Track;
pub use tracker::Tracker;
pub use weights::{Lens, TrackedScaling, TrackedWeights};

use crate::constants::{CROP_SIDE, LOST_MAX, TAXELS};
use crate::scene::Health;
use crate::weights::{Calibration, WeightsError, WeightsProblem};
use crate::{Evaluation, ForceMap, InstructionSet, InstructionSetError};

/// The weights that the crate carries.
static EMBEDDED: &[u8] = include_bytes!("../../weights/tracked.safetensors");

/// The tracking network: weights, particles of the rest image, and buffers.
#[derive(Debug, Clone)]
pub struct TrackedNetwork {
    weights: Arc<TrackedWeights>,
    tracker: Tracker,
    gather: Gather,
    net: Net,
    instructions: InstructionSet,
    precision: Precision,
    evaluation: Evaluation,
    forces_n: Box<ForceMap>,
}

impl TrackedNetwork {
    /// The network with the weights that the crate carries.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer replaces that file.
    pub fn embedded() -> Result<Self, WeightsError> {
        let weights = TrackedWeights::parse(EMBEDDED).map_err(|problem| WeightsError {
            origin: "built in".to_owned(),
            problem,
        })?;
        Ok(Self::new(weights))
    }

    /// The network with weights from a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of this architecture.
    pub fn from_file(path: &Path) -> Result<Self, WeightsError> {
        TrackedWeights::from_file(path).map(Self::new)
    }

    /// The network with weights fresh from the trainer.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or holds a number one cannot compute with.
    pub fn from_weights(weights: &TrackedWeights) -> Result<Self, WeightsProblem> {
        weights.check()?;
        Ok(Self::new(weights.clone()))
    }

    fn new(weights: TrackedWeights) -> Self {
        let (instructions, precision) = (InstructionSet::widest(), Precision::default());
        Self {
            net: Net::new(&weights, instructions, precision),
            instructions,
            precision,
            weights: Arc::new(weights),
            tracker: Tracker::new(),
            gather: Gather::default(),
            evaluation: Evaluation::default(),
            forces_n: Box::new([[0.0; 3]; TAXELS]),
        }
    }

    /// The same network on another instruction set than the widest that the processor has.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, InstructionSetError> {
        self.instructions = instructions.checked()?;
        self.net = Net::new(&self.weights, instructions, self.precision);
        self.tracker = self.tracker.with_instructions(instructions)?;
        self.tracker.forget();
        Ok(self)
    }

    /// The same network computing with other numbers.
    #[must_use]
    pub fn with_precision(mut self, precision: Precision) -> Self {
        self.precision = precision;
        self.net = Net::new(&self.weights, self.instructions, precision);
        self.tracker.forget();
        self
    }

    /// The same network with another rule for what is computed. Forces stay the same, bit by bit.
    #[must_use]
    pub fn with_evaluation(mut self, evaluation: Evaluation) -> Self {
        self.evaluation = evaluation;
        self
    }

    /// Takes the 440×440 image of the untouched sensor and finds its particles. Before the first call there are none,
    /// and forces mean nothing.
    ///
    /// # Panics
    /// When `rest` is not 440×440 bytes.
    pub fn set_rest(&mut self, rest: &[u8]) {
        check_size(rest);
        self.tracker.set_rest(rest);
        self.gather = Gather::new(&self.weights.lens, self.tracker.particles());
    }

    /// Forces for the 440×440 image now, newtons per taxel. Every taxel of `out` is written; no allocation.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn infer(&mut self, now: &[u8], out: &mut ForceMap) {
        check_size(now);
        if self.evaluation == Evaluation::Dense {
            self.tracker.forget();
        }
        if self.tracker.track(now) {
            let grid = self.gather.fill(self.tracker.particles(), self.tracker.tracks());
            self.net.infer(grid, &mut self.forces_n);
        }
        *out = *self.forces_n;
    }

    /// Forces for a grid of motions, newtons per taxel: the network without the tracker.
    pub fn infer_grid(&mut self, grid: &Grid, out: &mut ForceMap) {
        self.net.infer(grid, out);
    }

    /// Particles of the rest image, and how many of them were lost or doubtful in the last image.
    #[must_use]
    pub fn particles(&self) -> (usize, usize) {
        let tracks = self.tracker.tracks();
        let lost = tracks.iter().filter(|track| track.confidence == 0.0).count();
        (tracks.len(), lost)
    }

    /// Whether enough of the particles could be followed into the last image for its map to be believed; never so
    /// before there is one.
    #[must_use]
    pub fn health(&self) -> Health {
        let (particles, lost) = self.particles();
        let too_many = particles == 0 || lost as f32 > LOST_MAX * particles as f32;
        Health::GOOD.with(Health::PARTICLES_LOST, too_many)
    }

    /// Multiply-adds of the network in a frame; the tracker's are not among them.
    #[must_use]
    pub fn multiply_adds(&self) -> usize {
        self.net.multiply_adds()
    }

    /// How the slip detector should read these maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.weights.calibration
    }

    /// How the weights came to be, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.weights.manifest
    }
}

fn check_size(crop: &[u8]) {
    assert_eq!(
        crop.len(),
        CROP_SIDE * CROP_SIDE,
        "the camera crop has {} bytes, expected 440 x 440",
        crop.len()
    );
}
