//! What a picture needs: does the force network have to look at it at all (the gate), and can the sensor be believed
//! (its health)? Both come from one pass over the 88×88 image that compares it, in blocks of 8×8 pixels, with the
//! image at rest and with the last image that the network looked at.
//! Units: grey levels. No allocation per frame. Limits: noise is taken to be as it was at rest.

mod difference;
mod health;
mod learned;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

pub use health::{Figures, Health};
pub use learned::{Inputs, NO_MOTION, STEPS_PER_UNIT};

use crate::constants::{BLOCK_PIXELS, BLOCK_SIDE, BLOCKS, BLOCKS_PER_SIDE, IMAGE_PIXELS, IMAGE_SIDE};
use crate::image::Image88;
use crate::instruction_set::InstructionSet;
use crate::kernel::{BlockSums, Pattern, PerBlock};

/// Energy of a difference that nothing but rounding can make, grey levels squared a pixel: for a camera without noise.
const LEAST_NOISE: f32 = 0.06;
/// Smallest mean square of slopes that a motion is measured by, levels per two pixels squared.
const LEAST_SLOPE: f32 = 1.0;

/// What the gate says about a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// The picture is the one at rest: the map is empty.
    NoContact,
    /// Nothing changed since the last processed frame: its map holds.
    Unchanged,
    /// The network must look.
    Network,
    /// The picture cannot be believed: there is no map.
    Unhealthy,
}

impl Verdict {
    /// The name that people read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoContact => "no contact",
            Self::Unchanged => "unchanged",
            Self::Network => "network",
            Self::Unhealthy => "unhealthy",
        }
    }
}

/// Which gate decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum GateKind {
    /// A small int8 network on the coarse difference image.
    #[default]
    Network,
    /// Thresholds on the coarse difference image.
    Difference,
    /// The force network looks at every frame.
    Off,
}

impl GateKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Network, Self::Difference, Self::Off];

    /// The name by which it is chosen.
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
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == text)
            .ok_or_else(|| format!("found {text}, expected network, difference or off"))
    }
}

/// What a picture looks like against the two that it is compared with, block by block.
#[derive(Debug, Clone)]
struct Coarse {
    sums: BlockSums,
    rest: Box<Reference>,
    processed: Box<Reference>,
}

/// An image to compare with.
#[derive(Debug, Clone)]
struct Reference {
    pattern: Pattern,
    /// Sums of its levels and of their squares.
    levels: PerBlock<i32>,
    squares: PerBlock<i32>,
    /// How much of the image is in its slopes: Σ image·slope over Σ image².
    share: [PerBlock<f32>; 2],
    /// Inverse of the 2×2 matrix of the slopes' products, once the image is taken out of them: xx, xy, yy.
    inverse: [PerBlock<f32>; 3],
}

impl Reference {
    fn new(image: &Image88) -> Self {
        let mut reference = Self {
            pattern: Pattern::new(image),
            levels: [0; BLOCKS],
            squares: [0; BLOCKS],
            share: [[0.0; BLOCKS]; 2],
            inverse: [[0.0; BLOCKS]; 3],
        };
        reference.fill();
        reference
    }

    fn fill(&mut self) {
        let mut sums = BlockSums::ZERO;
        sums.take(
            InstructionSet::widest(),
            &self.pattern.image,
            [&self.pattern, &self.pattern],
        );
        self.levels = sums.levels;
        self.squares = sums.squares;
        for block in 0..BLOCKS {
            let square = sums.squares[block].max(1) as f32;
            let [x, y] = [1, 2].map(|k| sums.products[0][k][block] as f32);
            let [mut xx, mut xy, mut yy] = self.slope_products(block).map(|sum| sum as f32);
            (xx, xy, yy) = (xx - x * x / square, xy - x * y / square, yy - y * y / square);
            // A block without slopes in some direction says nothing about motion along it.
            let floor = LEAST_SLOPE * BLOCK_PIXELS as f32;
            (xx, yy) = (xx + floor, yy + floor);
            let determinant = xx * yy - xy * xy;
            (self.share[0][block], self.share[1][block]) = (x / square, y / square);
            for (inverse, entry) in self.inverse.iter_mut().zip([yy, -xy, xx]) {
                inverse[block] = entry / determinant;
            }
        }
    }

    fn slope_products(&self, block: usize) -> [i32; 3] {
        let corner = block / BLOCKS_PER_SIDE * BLOCK_SIDE * IMAGE_SIDE + block % BLOCKS_PER_SIDE * BLOCK_SIDE;
        let mut sums = [0; 3];
        for row in 0..BLOCK_SIDE {
            let line = corner + row * IMAGE_SIDE..corner + row * IMAGE_SIDE + BLOCK_SIDE;
            let slopes = self.pattern.across[line.clone()]
                .iter()
                .zip(&self.pattern.down[line]);
            for (&x, &y) in slopes {
                let (x, y) = (i32::from(x), i32::from(y));
                sums = [sums[0] + x * x, sums[1] + x * y, sums[2] + y * y];
            }
        }
        sums
    }
}

impl Coarse {
    fn new(rest: &Image88) -> Self {
        Self {
            sums: BlockSums::ZERO,
            rest: Box::new(Reference::new(rest)),
            processed: Box::new(Reference::new(rest)),
        }
    }

    fn compare(&mut self, instructions: InstructionSet, now: &Image88) {
        self.sums
            .take(instructions, now, [&self.rest.pattern, &self.processed.pattern]);
    }

    /// The picture compared last becomes the processed one.
    fn process(&mut self, now: &Image88) {
        self.processed.pattern = Pattern::new(now);
        self.processed.fill();
    }
}

/// The gate and the health of one sensor.
#[derive(Debug, Clone)]
pub struct Scene {
    kind: GateKind,
    instructions: InstructionSet,
    coarse: Coarse,
    /// Whether the network has looked since the touch began.
    processed: bool,
    difference: difference::Difference,
    learned: learned::Learned,
    health: health::Judge,
}

impl Scene {
    /// `rest` is the mean of `frames`, pictures at rest in the order in which they were taken, at least two of them if
    /// the camera has noise.
    #[must_use]
    pub fn new(kind: GateKind, rest: &Image88, frames: &[Image88]) -> Self {
        // The mean contains each frame, so they differ less from it than later frames do: by (n − 1)/n against
        // (n + 1)/n of the noise.
        let count = frames.len() as f32;
        let unseen = if count > 1.0 {
            (count + 1.0) / (count - 1.0)
        } else {
            1.0
        };
        let mut from_rest = Noise::default();
        let mut of_pairs = Noise::default();
        for frame in frames {
            from_rest.add(frame, rest, unseen);
        }
        for pair in frames.windows(2) {
            of_pairs.add(&pair[1], &pair[0], 1.0);
        }
        let coarse = Coarse::new(rest);
        Self {
            kind,
            instructions: InstructionSet::widest(),
            processed: false,
            difference: difference::Difference::new(&from_rest.plain(), &of_pairs.plain()),
            learned: learned::Learned::new(from_rest.motion(), of_pairs.motion()),
            health: health::Judge::new(&coarse.rest),
            coarse,
        }
    }

    /// The same on another instruction set than the widest that the processor has; verdicts are the same.
    ///
    /// # Panics
    /// At the first picture, when the processor does not have it.
    #[must_use]
    pub fn with_instructions(mut self, instructions: InstructionSet) -> Self {
        self.instructions = instructions;
        self
    }

    /// Judges a picture. When the answer is [`Verdict::Network`], the caller runs the force network on this very picture;
    /// when it is [`Verdict::Unhealthy`], whatever the network made of the picture would mean nothing, and the last
    /// processed picture stays what it was.
    pub fn look(&mut self, now: &Image88) -> (Verdict, Health) {
        self.coarse.compare(self.instructions, now);
        let health = self.health.judge(&self.coarse);
        if !health.is_good() {
            return (Verdict::Unhealthy, health);
        }
        if self.kind == GateKind::Off {
            return (Verdict::Network, health);
        }
        let [touched, changed] = match self.kind {
            GateKind::Network => self.learned.decide(&self.coarse),
            GateKind::Difference => self.difference.decide(&self.coarse),
            GateKind::Off => [true; 2],
        };
        if !touched {
            self.processed = false;
            return (Verdict::NoContact, health);
        }
        if self.processed && !changed {
            return (Verdict::Unchanged, health);
        }
        self.coarse.process(now);
        self.processed = true;
        (Verdict::Network, health)
    }

    /// Has the next picture that shows a touch processed, changed or not: what hangs on its map hangs on little.
    pub const fn look_again(&mut self) {
        self.processed = false;
    }

    /// What the gate's network sees of a picture against rest and the last processed picture: for its training.
    pub fn inputs(&mut self, now: &Image88) -> Inputs {
        self.coarse.compare(self.instructions, now);
        self.learned.inputs(&self.coarse)
    }

    /// Takes a picture for processed, whatever the gate would say: for training and tests.
    pub fn set_processed(&mut self, image: &Image88) {
        self.coarse.compare(self.instructions, image);
        self.coarse.process(image);
        self.processed = true;
    }

    /// Figures that the health is judged by, for its calibration.
    pub fn figures(&mut self, now: &Image88) -> Figures {
        self.coarse.compare(self.instructions, now);
        health::figures(&self.coarse)
    }
}

/// Mean energies of differences that are noise, block by block.
#[derive(Debug, Clone)]
struct Noise {
    plain: PerBlock<f32>,
    motion: PerBlock<f32>,
    count: f32,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            plain: [0.0; BLOCKS],
            motion: [0.0; BLOCKS],
            count: 0.0,
        }
    }
}

impl Noise {
    fn add(&mut self, frame: &Image88, reference: &Image88, weight: f32) {
        let reference = Reference::new(reference);
        let mut sums = BlockSums::ZERO;
        sums.take(
            InstructionSet::Portable,
            frame,
            [&reference.pattern, &reference.pattern],
        );
        self.count += 1.0;
        let plain = difference::energies(&sums.squares, &sums.products[0][0], &reference.squares);
        let motion = learned::motions(&sums.products[0], &reference);
        for block in 0..BLOCKS {
            self.plain[block] += weight * plain[block] as f32;
            self.motion[block] += weight * motion[block];
        }
    }

    fn plain(&self) -> PerBlock<f32> {
        let least = LEAST_NOISE * BLOCK_PIXELS as f32;
        self.plain.map(|sum| (sum / self.count.max(1.0)).max(least))
    }

    /// The motion's energy is the noise of a pixel times the two directions, in every block: their mean is known
    /// better than each.
    fn motion(&self) -> f32 {
        let mean = self.motion.iter().sum::<f32>() / (self.count.max(1.0) * BLOCKS as f32);
        mean.max(2.0 * LEAST_NOISE)
    }
}

/// The mean picture of some at rest, rounded to nearest.
///
/// # Panics
/// When there is none.
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
