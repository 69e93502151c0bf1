//! Decides from one pass over the 88×88 image whether the force network has to process a frame (the gate) and whether
//! the picture can be trusted (its health).
//! Units: grey levels. No allocation per frame. Limit: the noise is assumed to stay as it was at rest.

use std::fmt;
use std::str::FromStr;

use gripline_kernels::InstructionSet;

use super::difference::DifferenceGate;
use super::health::{self, Health, HealthMetrics, HealthMonitor};
use super::learned::{GateInputs, LearnedGate};
use super::noise::{Noise, NoiseSearch};
use super::reference::Comparison;
use crate::constants::IMAGE_PIXELS;
use crate::error::NetworkError;
use crate::image::Image88;

/// What the gate decides about a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GateDecision {
    /// The picture looks as at rest: the map is empty.
    NoContact,
    /// Nothing changed since the last processed frame: its map still holds.
    Unchanged,
    /// Run the force network on this frame.
    Infer,
    /// The picture cannot be trusted: no forces can be had from it.
    Unhealthy,
}

impl GateDecision {
    /// The name in reports and recordings.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoContact => "no contact",
            Self::Unchanged => "unchanged",
            Self::Infer => "network",
            Self::Unhealthy => "unhealthy",
        }
    }
}

/// Which gate decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum GateKind {
    /// A small int8 network on the motion energy of each block.
    #[default]
    Network,
    /// Thresholds on the difference energy of each block.
    Difference,
    /// None: the force network processes every healthy frame.
    Off,
}

impl GateKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Network, Self::Difference, Self::Off];

    /// The name in settings and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Network => "network",
            Self::Difference => "difference",
            Self::Off => "off",
        }
    }
}

impl fmt::Display for GateKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for GateKind {
    type Err = NetworkError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == text)
            .ok_or_else(|| NetworkError::UnknownGate {
                found: text.to_owned(),
            })
    }
}

/// The gate and the health of one sensor.
#[derive(Debug, Clone)]
pub struct Scene {
    kind: GateKind,
    instructions: InstructionSet,
    comparison: Comparison,
    /// Whether the network has processed a frame since the touch began.
    processed: bool,
    /// Looks for the camera's noise in the pictures of the run, where one picture at rest says nothing of it.
    search: Option<NoiseSearch>,
    difference: DifferenceGate,
    learned: LearnedGate,
    health: HealthMonitor,
}

impl Scene {
    /// `frames` are pictures at rest in the order of capture; `rest` is their mean. With one of them the noise is found in the
    /// pictures of the run: the network processes every picture until sixteen have differed from the one before.
    #[must_use]
    pub fn new(kind: GateKind, rest: &Image88, frames: &[Image88]) -> Self {
        // The mean contains these frames, so they differ from it by (n − 1)/n of the noise; later ones by (n + 1)/n.
        let count = frames.len() as f32;
        let correction = if count > 1.0 {
            (count + 1.0) / (count - 1.0)
        } else {
            1.0
        };
        let mut from_rest = Noise::default();
        let mut of_pairs = Noise::default();
        for frame in frames {
            from_rest.add(frame, rest, correction);
        }
        for pair in frames.windows(2) {
            of_pairs.add(&pair[1], &pair[0], 1.0);
        }
        let comparison = Comparison::new(rest);
        let (from_rest, of_pairs) = (from_rest.levels(), of_pairs.levels());
        Self {
            kind,
            instructions: InstructionSet::widest(),
            processed: false,
            search: (frames.len() < 2).then(|| NoiseSearch::new(&comparison.rest)),
            difference: DifferenceGate::new(&from_rest.plain, &of_pairs.plain),
            learned: LearnedGate::new(from_rest.motion, of_pairs.motion),
            health: HealthMonitor::new(&comparison.rest),
            comparison,
        }
    }

    /// Uses another instruction set than the widest available; decisions are the same.
    ///
    /// # Panics
    /// At the first picture, when the processor does not have it.
    #[must_use]
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Self {
        self.instructions = instructions;
        self
    }

    /// Decides about a picture. On [`GateDecision::Infer`] run the force network on this very picture. On
    /// [`GateDecision::Unhealthy`] ignore the picture; the last processed one stays the reference.
    pub fn decide(&mut self, now: &Image88) -> (GateDecision, Health) {
        self.comparison.compare(self.instructions, now);
        let health = self.health.check(&self.comparison);
        if !health.is_good() {
            return (GateDecision::Unhealthy, health);
        }
        if self.kind == GateKind::Off {
            return (GateDecision::Infer, health);
        }
        if let Some(search) = &mut self.search {
            if let Some([from_rest, of_pairs]) = search.add(&self.comparison) {
                self.difference = DifferenceGate::new(&from_rest.plain, &of_pairs.plain);
                self.learned = LearnedGate::new(from_rest.motion, of_pairs.motion);
            }
            if search.is_open() {
                self.comparison.set_processed(now);
                return (GateDecision::Infer, health);
            }
        }
        let [touched, changed] = match self.kind {
            GateKind::Network => self.learned.decide(&self.comparison),
            GateKind::Difference => self.difference.decide(&self.comparison),
            GateKind::Off => [true; 2],
        };
        if !touched {
            self.processed = false;
            return (GateDecision::NoContact, health);
        }
        if self.processed && !changed {
            return (GateDecision::Unchanged, health);
        }
        self.set_processed(now);
        (GateDecision::Infer, health)
    }

    /// Forces inference on the next contact frame, as if it were the first: what came of the processed one is not used.
    pub const fn force_inference(&mut self) {
        self.processed = false;
    }

    /// The input of the gate's network for a picture; for training.
    pub fn inputs(&mut self, now: &Image88) -> GateInputs {
        self.comparison.compare(self.instructions, now);
        self.learned.inputs(&self.comparison)
    }

    /// Makes a picture the processed one, whatever the gate decides: call it when the force network runs on a picture that
    /// [`Self::decide`] took for unchanged.
    pub fn set_processed(&mut self, image: &Image88) {
        self.comparison.set_processed(image);
        self.processed = true;
    }

    /// The metrics that decide a picture's health; for calibration.
    pub fn health_metrics(&mut self, now: &Image88) -> HealthMetrics {
        self.comparison.compare(self.instructions, now);
        health::metrics(&self.comparison)
    }
}

/// The mean of pictures at rest, rounded to nearest.
///
/// # Panics
/// When `frames` is empty.
#[must_use]
pub fn mean_of(frames: &[Image88]) -> Image88 {
    assert!(!frames.is_empty(), "the mean needs a picture");
    let count = frames.len() as u32;
    let mut mean = [0; IMAGE_PIXELS];
    for (pixel, mean) in mean.iter_mut().enumerate() {
        let sum: u32 = frames.iter().map(|frame| u32::from(frame[pixel])).sum();
        *mean = ((sum + count / 2) / count) as u8;
    }
    mean
}
