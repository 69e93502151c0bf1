//! The tracking network with its weights, tracker and buffers.

use std::path::Path;
use std::sync::Arc;

use gripline_kernels::InstructionSet;

use super::grid::{Grid, GridInterpolator};
use super::grid_net::GridNet;
use super::tracker::Tracker;
use super::weights::TrackedWeights;
use crate::constants::LOST_MAX;
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap, NO_FORCES};
use crate::image::check_crop;
use crate::options::{Evaluation, Precision};
use crate::scene::Health;

/// The built-in weights.
static EMBEDDED: &[u8] = include_bytes!("../../weights/tracked.safetensors");

/// The tracking network: weights, particles of the rest image, and buffers.
#[derive(Debug, Clone)]
pub struct TrackedNetwork {
    weights: Arc<TrackedWeights>,
    tracker: Tracker,
    interpolator: GridInterpolator,
    net: GridNet,
    instructions: InstructionSet,
    precision: Precision,
    evaluation: Evaluation,
    forces_n: Box<ForceMap>,
}

impl TrackedNetwork {
    /// The network with the built-in weights.
    ///
    /// # Errors
    /// Never with the committed weights (a test loads them); the trainer may replace that file.
    pub fn embedded() -> Result<Self, NetworkError> {
        TrackedWeights::parse(EMBEDDED)
            .map(Self::new)
            .map_err(|problem| problem.in_weights(&"built in"))
    }

    /// The network with weights from a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a complete, undamaged weights file of this architecture.
    pub fn from_file(path: &Path) -> Result<Self, NetworkError> {
        TrackedWeights::from_file(path).map(Self::new)
    }

    /// The network with these weights.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or is not finite.
    pub fn from_weights(weights: &TrackedWeights) -> Result<Self, NetworkError> {
        weights.check()?;
        Ok(Self::new(weights.clone()))
    }

    pub(crate) fn new(weights: TrackedWeights) -> Self {
        let (instructions, precision) = (InstructionSet::widest(), Precision::default());
        Self {
            net: GridNet::new(&weights, instructions, precision),
            instructions,
            precision,
            weights: Arc::new(weights),
            tracker: Tracker::new(),
            interpolator: GridInterpolator::default(),
            evaluation: Evaluation::default(),
            forces_n: Box::new(NO_FORCES),
        }
    }

    /// Uses another instruction set than the widest available.
    ///
    /// # Errors
    /// When the processor does not have it.
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Result<Self, NetworkError> {
        self.instructions = instructions.checked()?;
        self.net = GridNet::new(&self.weights, instructions, self.precision);
        self.tracker = self.tracker.with_instructions(instructions)?;
        self.tracker.invalidate();
        Ok(self)
    }

    /// Chooses the numbers to compute with.
    #[must_use]
    pub fn with_precision(mut self, precision: Precision) -> Self {
        self.precision = precision;
        self.net = GridNet::new(&self.weights, self.instructions, precision);
        self.tracker.invalidate();
        self
    }

    /// Chooses how much of a frame is computed.
    #[must_use]
    pub fn with_evaluation(mut self, evaluation: Evaluation) -> Self {
        self.evaluation = evaluation;
        self
    }

    /// Sets the 440×440 image of the untouched sensor and finds its particles. Forces mean nothing before the first call.
    ///
    /// # Panics
    /// When `rest` is not 440×440 bytes.
    pub fn set_rest(&mut self, rest: &[u8]) {
        check_crop(rest);
        self.tracker.set_rest(rest);
        self.interpolator = GridInterpolator::new(&self.weights.lens, self.tracker.particles());
    }

    /// Learns the camera's noise from 440×440 pictures at rest, in the order of capture; call it after [`Self::set_rest`]. With fewer
    /// than two it is learnt from the frames.
    ///
    /// # Panics
    /// When one is not 440×440 bytes.
    pub fn learn_noise(&mut self, rest: &[Vec<u8>]) {
        self.tracker.learn_noise(rest);
    }

    /// Takes nothing for noise in the next picture, whatever the [`Evaluation`].
    pub fn refresh_next(&mut self) {
        self.tracker.refresh_next();
    }

    /// Forces for the 440×440 image `now`, newtons per taxel. Writes every taxel of `out`; no allocation.
    ///
    /// # Panics
    /// When `now` is not 440×440 bytes.
    pub fn infer(&mut self, now: &[u8], out: &mut ForceMap) {
        check_crop(now);
        if self.evaluation == Evaluation::Dense {
            self.tracker.invalidate();
        }
        let changed = if self.evaluation == Evaluation::SkipNoise {
            self.tracker.track_beyond_noise(now)
        } else {
            self.tracker.track(now)
        };
        if changed {
            let grid = self
                .interpolator
                .update(self.tracker.particles(), self.tracker.tracks());
            self.net.infer(grid, &mut self.forces_n);
        }
        *out = *self.forces_n;
    }

    /// Forces for a grid of motions, newtons per taxel: the network without the tracker.
    pub fn infer_grid(&mut self, grid: &Grid, out: &mut ForceMap) {
        self.net.infer(grid, out);
    }

    /// Number of particles in the rest image, and how many of them were lost or doubtful in the last image.
    #[must_use]
    pub fn particles(&self) -> (usize, usize) {
        let tracks = self.tracker.tracks();
        let lost = tracks.iter().filter(|track| track.confidence == 0.0).count();
        (tracks.len(), lost)
    }

    /// Whether enough particles were found in the last image to trust its map; flags lost particles before the first image.
    #[must_use]
    pub fn health(&self) -> Health {
        let (particles, lost) = self.particles();
        let too_many = particles == 0 || lost as f32 > LOST_MAX * particles as f32;
        Health::GOOD.with(Health::PARTICLES_LOST, too_many)
    }

    /// Multiply-adds of the network per frame, without those of the tracker.
    #[must_use]
    pub fn multiply_adds(&self) -> usize {
        self.net.multiply_adds()
    }

    /// How the slip detector should read the maps.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.weights.calibration
    }

    /// How the weights were trained, one line.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.weights.manifest
    }

    pub(crate) fn weights(&self) -> &TrackedWeights {
        &self.weights
    }
}
