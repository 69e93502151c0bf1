//! The scene gate: does this frame need the network at all? First form: the plain difference.
//!
//! Both questions (does anything touch, has anything changed since the last *processed* frame) are asked block by
//! block, because a light touch moves few pixels. The threshold comes from the noise of the frames at rest.
//! Units: sums of absolute grey-level differences over blocks of 8×8 pixels. Limits: a slow change of brightness
//! looks like a touch, which costs time but no decision.

use gripline_network::image::Image88;
use serde::Serialize;

/// Pixels along one side of a block.
const BLOCK: usize = 8;
/// Pixels along one side of the picture.
const SIDE: usize = 88;
const BLOCKS: usize = (SIDE / BLOCK) * (SIDE / BLOCK);
/// How far above the largest difference seen at rest a difference must lie. Two noisy pictures differ by √2 more than
/// one from the mean; the rest is for the frames that were not seen.
const NOISE_FACTOR: f32 = 1.8;

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

/// The plain-difference gate.
#[derive(Debug, Clone)]
pub struct Gate {
    rest: Image88,
    /// The last picture that the network looked at.
    processed: Option<Box<Image88>>,
    threshold: u32,
}

impl Gate {
    /// `rest` is the mean picture at rest, `frames` single pictures at rest, whose noise sets the threshold.
    #[must_use]
    pub fn new(rest: &Image88, frames: &[Image88]) -> Self {
        let noise = frames
            .iter()
            .map(|frame| largest_block_difference(rest, frame))
            .max()
            .unwrap_or(0);
        // One grey level in half the pixels of a block is what rounding alone can do.
        let threshold = (noise as f32 * NOISE_FACTOR) as u32 + (BLOCK * BLOCK / 2) as u32;
        Self {
            rest: *rest,
            processed: None,
            threshold,
        }
    }

    /// The block difference above which something happened.
    #[must_use]
    pub const fn threshold(&self) -> u32 {
        self.threshold
    }

    /// Judges a picture. When the answer is [`Verdict::Network`], the caller runs the network on this very picture.
    pub fn judge(&mut self, now: &Image88) -> Verdict {
        if largest_block_difference(&self.rest, now) <= self.threshold {
            self.processed = None;
            return Verdict::NoContact;
        }
        if let Some(processed) = &self.processed
            && largest_block_difference(processed, now) <= self.threshold
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

/// The largest sum of absolute differences of any 8×8 block.
#[must_use]
pub fn largest_block_difference(one: &Image88, other: &Image88) -> u32 {
    let mut sums = [0_u32; BLOCKS];
    let per_row = SIDE / BLOCK;
    for (row, (one, other)) in one.chunks_exact(SIDE).zip(other.chunks_exact(SIDE)).enumerate() {
        let sums = &mut sums[row / BLOCK * per_row..][..per_row];
        for ((one, other), sum) in one.chunks_exact(BLOCK).zip(other.chunks_exact(BLOCK)).zip(sums) {
            *sum += one
                .iter()
                .zip(other)
                .map(|(one, other)| u32::from(one.abs_diff(*other)))
                .sum::<u32>();
        }
    }
    sums.into_iter().max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate() -> Gate {
        Gate::new(&[100; SIDE * SIDE], &[])
    }

    /// A picture in which one block is brighter by `by`.
    fn touched(by: u8) -> Image88 {
        let mut picture = [100; SIDE * SIDE];
        for row in 80..88 {
            picture[row * SIDE + 80..row * SIDE + 88].fill(100 + by);
        }
        picture
    }

    #[test]
    fn the_picture_at_rest_is_no_contact_and_a_touched_block_is_not() {
        assert_eq!(gate().judge(&touched(0)), Verdict::NoContact);
        assert_eq!(gate().judge(&touched(1)), Verdict::Network);
    }

    #[test]
    fn an_unchanged_picture_is_skipped_and_a_slow_creep_is_not_missed() {
        let mut gate = gate();
        let mut looked = 0;
        for by in 10..40 {
            // Every step alone lies below the threshold.
            let mut picture = touched(10);
            picture[80 * SIDE + 80] += by;
            looked += u32::from(gate.judge(&picture) == Verdict::Network);
        }
        assert_eq!(
            looked, 1,
            "30 grey levels in one pixel are within 8×8/2 of the first"
        );
        assert_eq!(gate.judge(&touched(11)), Verdict::Network);
        assert_eq!(gate.judge(&touched(11)), Verdict::Unchanged);
    }

    #[test]
    fn the_threshold_lies_above_the_noise_at_rest() {
        let rest = [100; SIDE * SIDE];
        let mut noisy = rest;
        noisy.iter_mut().step_by(2).for_each(|pixel| *pixel += 3);
        let mut gate = Gate::new(&rest, &[noisy]);
        assert_eq!(gate.judge(&noisy), Verdict::NoContact);
    }

    #[test]
    fn differences_are_those_of_a_naive_sum() {
        let one: Image88 = core::array::from_fn(|n| (n * 7 % 251) as u8);
        let other: Image88 = core::array::from_fn(|n| (n * 13 % 241) as u8);
        let mut worst = 0;
        for block in 0..BLOCKS {
            let (top, left) = (block / 11 * 8, block % 11 * 8);
            let pixels = (0..64).map(|n| (top + n / 8) * SIDE + left + n % 8);
            worst = worst.max(pixels.map(|at| u32::from(one[at].abs_diff(other[at]))).sum());
        }
        assert_eq!(largest_block_difference(&one, &other), worst);
    }
}
