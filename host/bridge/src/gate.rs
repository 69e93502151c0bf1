//! The scene gate: does this frame need the network at all? First form: the plain difference.
//!
//! Both questions (does anything touch, has anything changed since the last *processed* frame) compare the energy of
//! the difference with that of the camera's noise at rest: block by block, because a light touch moves few pixels,
//! and over the whole picture, because a small pull moves many a little.
//! Units: grey levels squared, summed over blocks of 8×8 pixels or over all. Limits: a slow change of brightness
//! looks like a touch, which costs time but no decision; noise is taken to be as it was at rest.

use gripline_network::image::Image88;
use serde::Serialize;

/// Pixels along one side of a block.
const BLOCK: usize = 8;
/// Pixels along one side of the picture.
const SIDE: usize = 88;
const BLOCKS_PER_ROW: usize = SIDE / BLOCK;
const BLOCKS: usize = BLOCKS_PER_ROW * BLOCKS_PER_ROW;
/// Above how much of the mean noise energy a block has changed. The energy of 64 noisy pixels scatters by √(2/64) =
/// 18 % of its mean, so this is 5.7 such deviations: one block in about a hundred million.
const BLOCK_FACTOR: f32 = 2.0;
/// The same for the whole picture, which scatters by √(2/7744) = 1.6 %: 4.4 deviations, and some noise is not white.
const TOTAL_FACTOR: f32 = 1.07;
/// Energy that nothing but rounding can make, a pixel: for a camera without noise.
const LEAST_A_PIXEL: f32 = 0.06;

/// What the gate says about a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The picture is the one at rest: the map is empty.
    NoContact,
    /// Nothing changed since the last processed frame: its map holds.
    Unchanged,
    /// The network must look.
    Network,
}

impl Verdict {
    /// The name that people read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoContact => "no contact",
            Self::Unchanged => "unchanged",
            Self::Network => "network",
        }
    }
}

/// Energy of a difference: block by block, row-major.
type Energy = [u32; BLOCKS];

/// Up to which energies a difference is noise.
#[derive(Debug, Clone)]
struct NoiseLimit {
    blocks: Energy,
    total: u32,
}

impl NoiseLimit {
    /// From differences that are noise; `scale` is how much noisier the differences to be judged are.
    fn from_noise(differences: impl Iterator<Item = Energy>, scale: f32) -> Self {
        let (mut sums, mut count) = ([0.0_f32; BLOCKS], 0.0_f32);
        for difference in differences {
            count += 1.0;
            for (sum, energy) in sums.iter_mut().zip(difference) {
                *sum += energy as f32;
            }
        }
        let least = LEAST_A_PIXEL * (BLOCK * BLOCK) as f32;
        let means = sums.map(|sum| (sum * scale / count.max(1.0)).max(least));
        let total: f32 = means.iter().sum();
        Self {
            blocks: means.map(|mean| (mean * BLOCK_FACTOR) as u32),
            total: (total * TOTAL_FACTOR) as u32,
        }
    }

    fn holds(&self, difference: &Energy) -> bool {
        difference
            .iter()
            .zip(&self.blocks)
            .all(|(energy, limit)| energy <= limit)
            && difference.iter().sum::<u32>() <= self.total
    }
}

/// The plain-difference gate.
#[derive(Debug, Clone)]
pub struct Gate {
    rest: Image88,
    /// The last picture that the network looked at.
    processed: Option<Box<Image88>>,
    /// For the difference from the mean picture at rest.
    rest_limit: NoiseLimit,
    /// For the difference between two single pictures.
    pair_limit: NoiseLimit,
}

impl Gate {
    /// `rest` is the mean of `frames`, pictures at rest in the order in which they were taken.
    #[must_use]
    pub fn new(rest: &Image88, frames: &[Image88]) -> Self {
        // The mean contains each frame, so they differ less from it than later frames do: by (n − 1)/n against
        // (n + 1)/n of the noise.
        let count = frames.len() as f32;
        let scale = if count > 1.0 {
            (count + 1.0) / (count - 1.0)
        } else {
            1.0
        };
        let from_rest = frames.iter().map(|frame| energy(rest, frame));
        let between = frames.windows(2).map(|pair| energy(&pair[0], &pair[1]));
        Self {
            rest: *rest,
            processed: None,
            rest_limit: NoiseLimit::from_noise(from_rest, scale),
            pair_limit: NoiseLimit::from_noise(between, 1.0),
        }
    }

    /// Judges a picture. When the answer is [`Verdict::Network`], the caller runs the network on this very picture.
    pub fn judge(&mut self, now: &Image88) -> Verdict {
        if self.rest_limit.holds(&energy(&self.rest, now)) {
            self.processed = None;
            return Verdict::NoContact;
        }
        if let Some(processed) = &self.processed
            && self.pair_limit.holds(&energy(processed, now))
        {
            return Verdict::Unchanged;
        }
        match &mut self.processed {
            Some(processed) => **processed = *now,
            None => self.processed = Some(Box::new(*now)),
        }
        Verdict::Network
    }
}

/// Sums of squared differences of two pictures, block by block.
fn energy(one: &Image88, other: &Image88) -> Energy {
    let mut blocks = [0_u32; BLOCKS];
    for (row, (one, other)) in one.chunks_exact(SIDE).zip(other.chunks_exact(SIDE)).enumerate() {
        let blocks = &mut blocks[row / BLOCK * BLOCKS_PER_ROW..][..BLOCKS_PER_ROW];
        for ((one, other), block) in one.chunks_exact(BLOCK).zip(other.chunks_exact(BLOCK)).zip(blocks) {
            *block += one
                .iter()
                .zip(other)
                .map(|(one, other)| u32::from(one.abs_diff(*other)).pow(2))
                .sum::<u32>();
        }
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: usize = SIDE * SIDE;

    /// A picture of grey 100 with noise of about one grey level, different for every seed.
    fn noisy(seed: u64) -> Image88 {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        core::array::from_fn(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            // The sum of four small numbers is nearly normal; variance 2.67.
            100 + (0..4).map(|n| (state >> (16 * n) & 0xFF) as u8 % 3).sum::<u8>() - 4
        })
    }

    fn gate() -> Gate {
        let frames: Vec<_> = (1..=16).map(noisy).collect();
        let mean: Image88 = core::array::from_fn(|pixel| {
            ((frames.iter().map(|frame| u32::from(frame[pixel])).sum::<u32>() + 8) / 16) as u8
        });
        Gate::new(&mean, &frames)
    }

    /// The same picture with a pattern of ±`by` in `blocks` blocks.
    fn moved(mut picture: Image88, by: u8, blocks: usize) -> Image88 {
        for block in 0..blocks {
            let (top, left) = (block / BLOCKS_PER_ROW * BLOCK, block % BLOCKS_PER_ROW * BLOCK);
            for n in 0..64 {
                let pixel = &mut picture[(top + n / 8) * SIDE + left + n % 8];
                *pixel = if (n / 8 + n) % 2 == 0 {
                    *pixel + by
                } else {
                    *pixel - by
                };
            }
        }
        picture
    }

    #[test]
    fn a_thousand_noisy_pictures_at_rest_are_no_contact() {
        let mut gate = gate();
        let touched = (100..1_100)
            .filter(|&seed| gate.judge(&noisy(seed)) != Verdict::NoContact)
            .count();
        assert!(
            touched <= 2,
            "{touched} of 1,000 pictures at rest were taken for a touch"
        );
    }

    #[test]
    fn a_strong_change_in_one_block_and_a_weak_one_in_many_are_seen() {
        for (by, blocks) in [(4, 1), (1, 60)] {
            let mut gate = gate();
            assert_eq!(
                gate.judge(&moved(noisy(200), by, blocks)),
                Verdict::Network,
                "±{by} in {blocks} blocks"
            );
        }
    }

    #[test]
    fn an_unchanged_touch_is_skipped_and_a_slow_creep_is_not_missed() {
        let mut gate = gate();
        assert_eq!(gate.judge(&moved(noisy(300), 10, 4)), Verdict::Network);
        let skipped = (301..401)
            .filter(|&seed| gate.judge(&moved(noisy(seed), 10, 4)) == Verdict::Unchanged)
            .count();
        assert!(
            skipped >= 98,
            "only {skipped} of 100 unchanged pictures were skipped"
        );
        // From 10 to 30 in steps of one: every step alone is small against the noise of a pair.
        let looked = (11..=30_u8)
            .filter(|&by| gate.judge(&moved(noisy(by.into()), by, 4)) == Verdict::Network)
            .count();
        assert!(
            looked >= 4,
            "a creep of 20 grey levels was looked at {looked} times"
        );
    }

    #[test]
    fn the_touch_is_over_when_the_picture_is_at_rest_again() {
        let mut gate = gate();
        assert_eq!(gate.judge(&moved(noisy(500), 10, 4)), Verdict::Network);
        assert_eq!(gate.judge(&noisy(501)), Verdict::NoContact);
        assert_eq!(gate.judge(&moved(noisy(502), 10, 4)), Verdict::Network);
    }

    #[test]
    fn a_camera_without_noise_is_gated_too() {
        let rest = [100; PIXELS];
        let mut gate = Gate::new(&rest, &vec![rest; 4]);
        assert_eq!(gate.judge(&rest), Verdict::NoContact);
        assert_eq!(gate.judge(&moved(rest, 1, 1)), Verdict::Network);
    }

    #[test]
    fn energies_are_those_of_a_naive_sum() {
        let one: Image88 = core::array::from_fn(|n| (n * 7 % 251) as u8);
        let other: Image88 = core::array::from_fn(|n| (n * 13 % 241) as u8);
        let found = energy(&one, &other);
        for (block, found) in found.into_iter().enumerate() {
            let (top, left) = (block / 11 * 8, block % 11 * 8);
            let pixels = (0..64).map(|n| (top + n / 8) * SIDE + left + n % 8);
            let expected: u32 = pixels
                .map(|at| u32::from(one[at].abs_diff(other[at])).pow(2))
                .sum();
            assert_eq!(found, expected);
        }
    }
}
