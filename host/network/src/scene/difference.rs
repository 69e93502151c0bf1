//! The difference gate: a picture has changed when the energy of its difference exceeds the camera's noise in one block
//! (a light touch moves few pixels) or over the whole picture (a small pull moves many pixels a little).
//! Units: grey levels squared, summed over blocks of 8×8 pixels or over all. Limit: a slow change of brightness looks
//! like a touch; that costs time but no decision.

use super::block_sums::PerBlock;
use super::reference::Comparison;
use crate::constants::BLOCKS;

/// A block has changed above this multiple of the mean noise energy. The energy of 64 noisy pixels has a standard
/// deviation of √(2/64) = 18 % of its mean, so this is 5.7 deviations: one block in about a hundred million.
const BLOCK_FACTOR: f32 = 2.0;
/// The same for the whole picture, with √(2/7744) = 1.6 %: 4.4 deviations, because some noise is not white.
const TOTAL_FACTOR: f32 = 1.07;

/// The limits for a difference from the mean picture at rest and for one between two single pictures.
#[derive(Debug, Clone)]
pub(super) struct DifferenceGate {
    rest: Limit,
    processed: Limit,
}

impl DifferenceGate {
    /// From mean energies of differences that are noise.
    pub(super) fn new(from_rest: &PerBlock<f32>, of_pairs: &PerBlock<f32>) -> Self {
        Self {
            rest: Limit::new(from_rest),
            processed: Limit::new(of_pairs),
        }
    }

    /// Whether something touches, and whether anything changed since the processed picture.
    pub(super) fn decide(&self, comparison: &Comparison) -> [bool; 2] {
        let sums = &comparison.sums;
        [
            !self.rest.holds(&energies(
                &sums.squares,
                &sums.products[0][0],
                &comparison.rest.squares,
            )),
            !self.processed.holds(&energies(
                &sums.squares,
                &sums.products[1][0],
                &comparison.processed.squares,
            )),
        ]
    }
}

/// Largest energies of a difference that is noise.
#[derive(Debug, Clone)]
struct Limit {
    blocks: PerBlock<i32>,
    total: i32,
}

impl Limit {
    fn new(noise: &PerBlock<f32>) -> Self {
        Self {
            blocks: noise.map(|mean| (mean * BLOCK_FACTOR) as i32),
            total: (noise.iter().sum::<f32>() * TOTAL_FACTOR) as i32,
        }
    }

    fn holds(&self, energies: &PerBlock<i32>) -> bool {
        let over = energies
            .iter()
            .zip(&self.blocks)
            .fold(0_i32, |over, (energy, limit)| over + i32::from(energy > limit));
        over == 0 && energies.iter().sum::<i32>() <= self.total
    }
}

/// Sums of squared differences of two pictures: Σ(a − b)² = Σa² − 2Σab + Σb², exact.
pub(super) fn energies(
    squares: &PerBlock<i32>,
    products: &PerBlock<i32>,
    others: &PerBlock<i32>,
) -> PerBlock<i32> {
    let mut energies = [0; BLOCKS];
    for block in 0..BLOCKS {
        // Each at most 64·255² = 4.2 million.
        energies[block] = squares[block] + others[block] - 2 * products[block];
    }
    energies
}
