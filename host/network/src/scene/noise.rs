//! The camera's noise: mean energies of differences between pictures in which nothing moves, block by block. From pictures at
//! rest, or, where there is only one of them (folders, clips), from the pictures of the run.
//! Units: grey levels squared, summed over blocks of 8×8 pixels.
//! Limit: noise that is uneven over the picture is underestimated in the run; the gate then skips less.

use gripline_kernels::InstructionSet;

use super::block_sums::{BlockSums, PerBlock};
use super::difference;
use super::learned;
use super::reference::{Comparison, Reference};
use crate::constants::{BLOCK_PIXELS, BLOCKS};
use crate::image::Image88;

/// Smallest noise energy, grey levels squared per pixel: the rounding of a camera without noise.
const NOISE_MIN: f32 = 0.06;
/// Pictures of the run that one estimate is made from.
const WINDOW: usize = 16;
/// A block's noise is at most this multiple of the quiet quarter of the blocks: more is motion.
const UNEVEN_MAX: f32 = 1.5;
/// Lower quartile over mean of motion energy that is noise, which has two degrees of freedom: −ln(3/4).
const QUARTILE_OF_MEAN: f32 = 0.287_682;

/// Mean energies of noise.
#[derive(Debug, Clone)]
pub(super) struct Noise {
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
    pub(super) fn add(&mut self, frame: &Image88, reference: &Image88, weight: f32) {
        let reference = Reference::new(reference);
        let mut sums = BlockSums::ZERO;
        sums.compute(
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

    pub(super) fn levels(&self) -> NoiseLevels {
        let count = self.count.max(1.0);
        NoiseLevels {
            plain: self.plain.map(|sum| sum / count),
            // Noise puts the same motion energy into every block (two pixels' worth), so the mean over blocks is the best
            // estimate.
            motion: self.motion.iter().sum::<f32>() / (count * BLOCKS as f32),
        }
        .at_least_rounding()
    }
}

/// Mean energies of a difference that is noise.
#[derive(Debug, Clone)]
pub(super) struct NoiseLevels {
    /// Of the difference, block by block.
    pub(super) plain: PerBlock<f32>,
    /// Of its motion, in any block.
    pub(super) motion: f32,
}

impl NoiseLevels {
    fn at_least_rounding(self) -> Self {
        Self {
            plain: self.plain.map(|mean| mean.max(NOISE_MIN * BLOCK_PIXELS as f32)),
            motion: self.motion.max(2.0 * NOISE_MIN),
        }
    }

    fn total(&self) -> f32 {
        self.plain.iter().sum()
    }

    fn min(&self, other: &Self) -> Self {
        Self {
            plain: std::array::from_fn(|block| self.plain[block].min(other.plain[block])),
            motion: self.motion.min(other.motion),
        }
    }
}

/// Finds the noise in the pictures of the run: of all windows the quietest counts.
#[derive(Debug, Clone)]
pub(super) struct NoiseSearch {
    from_rest: Quietest,
    of_pairs: Quietest,
    /// Of the last picture, its squared grey levels: those of another picture differ in some block.
    squares: PerBlock<i32>,
}

impl NoiseSearch {
    pub(super) fn new(rest: &Reference) -> Self {
        Self {
            from_rest: Quietest::new(),
            of_pairs: Quietest::new(),
            squares: rest.squares,
        }
    }

    /// Takes a picture, compared with both references. Returns the noise of differences from rest and of pairs, when there is a
    /// new estimate. A picture that is shown again says nothing.
    pub(super) fn add(&mut self, comparison: &Comparison) -> Option<[NoiseLevels; 2]> {
        let sums = &comparison.sums;
        if sums.squares == self.squares {
            return None;
        }
        self.squares = sums.squares;
        let references = [&comparison.rest, &comparison.processed];
        let searches = [&mut self.from_rest, &mut self.of_pairs];
        let mut is_new = false;
        for (number, (search, reference)) in searches.into_iter().zip(references).enumerate() {
            let products = &sums.products[number];
            let plain = difference::energies(&sums.squares, &products[0], &reference.squares);
            let motion = learned::motions(products, reference);
            is_new |= search.add(&plain, &motion);
        }
        let (from_rest, of_pairs) = (self.from_rest.best.as_ref()?, self.of_pairs.best.as_ref()?);
        // A touch that never ends looks like noise since rest, but not from picture to picture.
        is_new.then(|| [from_rest.min(of_pairs), of_pairs.clone()])
    }

    /// Whether there is no estimate yet.
    pub(super) const fn is_open(&self) -> bool {
        self.of_pairs.best.is_none()
    }
}

/// The quietest window of differences from one kind of reference.
#[derive(Debug, Clone)]
struct Quietest {
    /// Energies of the window's pictures: of each block, and of all blocks in turn.
    plain: Box<PerBlock<[f32; WINDOW]>>,
    motion: Box<[PerBlock<f32>; WINDOW]>,
    /// Pictures in the window.
    pictures: usize,
    best: Option<NoiseLevels>,
}

impl Quietest {
    fn new() -> Self {
        Self {
            plain: Box::new([[0.0; WINDOW]; BLOCKS]),
            motion: Box::new([[0.0; BLOCKS]; WINDOW]),
            pictures: 0,
            best: None,
        }
    }

    /// Returns whether there is a new best.
    fn add(&mut self, plain: &PerBlock<i32>, motion: &PerBlock<f32>) -> bool {
        for (energies, energy) in self.plain.iter_mut().zip(plain) {
            energies[self.pictures] = *energy as f32;
        }
        self.motion[self.pictures] = *motion;
        self.pictures += 1;
        if self.pictures < WINDOW {
            return false;
        }
        self.pictures = 0;
        let found = self.levels().at_least_rounding();
        let is_better = self.best.as_ref().is_none_or(|best| found.total() < best.total());
        if is_better {
            self.best = Some(found);
        }
        is_better
    }

    /// Medians over the window, and no block far above the quiet ones. Reorders the window.
    fn levels(&mut self) -> NoiseLevels {
        let mut plain = [0.0; BLOCKS];
        for (median, energies) in plain.iter_mut().zip(&mut *self.plain) {
            let (lower, upper, _) = energies.select_nth_unstable_by(WINDOW / 2, f32::total_cmp);
            *median = f32::midpoint(lower.iter().copied().fold(0.0, f32::max), *upper);
        }
        let mut sorted = plain;
        let max = UNEVEN_MAX * quartile(&mut sorted);
        for energy in &mut plain {
            *energy = energy.min(max);
        }
        NoiseLevels {
            plain,
            motion: quartile(self.motion.as_flattened_mut()) / QUARTILE_OF_MEAN,
        }
    }
}

/// The lower quartile. Reorders the values.
fn quartile(values: &mut [f32]) -> f32 {
    *values.select_nth_unstable_by(values.len() / 4, f32::total_cmp).1
}
