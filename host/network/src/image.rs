//! From the camera's crop, 440×440 pixels of 8-bit grayscale, to the 88×88 image: means of 5×5 blocks, rounded to the
//! nearest grey level. Row-major; columns grow with +x, rows with +y, as in the force map.

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{Dispatch, Simd, dispatch_256};

use crate::constants::{CROP_SIDE, DOWNSAMPLING, IMAGE_PIXELS, IMAGE_SIDE};

/// An image of 88×88 pixels, row-major, 8-bit grayscale.
pub type Image88 = [u8; IMAGE_PIXELS];

/// A camera frame at both resolutions, so that gate, health and network share one downsampling.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    crop: &'a [u8],
    small: &'a Image88,
}

impl<'a> Frame<'a> {
    /// Downsamples `crop`, 440×440 pixels, into `small`.
    ///
    /// # Panics
    /// When `crop` is not 440×440 bytes.
    pub fn new(crop: &'a [u8], small: &'a mut Image88) -> Self {
        downsample_440_to_88(crop, small);
        Self { crop, small }
    }

    /// The 440×440 crop.
    #[must_use]
    pub fn crop(&self) -> &'a [u8] {
        self.crop
    }

    /// The 88×88 image.
    #[must_use]
    pub fn small(&self) -> &'a Image88 {
        self.small
    }
}

/// Pixels of a block.
const BLOCK_PIXELS: u16 = (DOWNSAMPLING * DOWNSAMPLING) as u16;

/// Means of 5×5 blocks of the crop, rounded to nearest.
///
/// # Panics
/// When `crop` is not 440×440 bytes.
pub fn downsample_440_to_88(crop: &[u8], out: &mut Image88) {
    check_crop(crop);
    dispatch_256(InstructionSet::widest(), Downsample { crop, out });
}

/// Panics when a crop is not 440×440 bytes.
pub(crate) fn check_crop(crop: &[u8]) {
    assert_eq!(
        crop.len(),
        CROP_SIDE * CROP_SIDE,
        "the camera crop has {} bytes, expected 440 x 440",
        crop.len()
    );
}

struct Downsample<'a> {
    crop: &'a [u8],
    out: &'a mut Image88,
}

impl Dispatch for Downsample<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "compiles for the instruction set of its caller"
    )]
    #[inline(always)]
    fn run<S: Simd>(self) {
        downsample::<S>(self.crop, self.out);
    }
}

/// Row by row: sums of eight blocks at a time, then means in a loop that the compiler vectorises.
#[inline(always)]
fn downsample<S: Simd>(crop: &[u8], out: &mut Image88) {
    /// 2¹⁷ / 25, rounded up: exact for all sums of 25 bytes.
    const INVERSE: u16 = 5243;
    /// Columns of eight blocks.
    const GROUP: usize = 8 * DOWNSAMPLING;
    let (crop_rows, _) = crop.as_chunks::<CROP_SIDE>();
    for (rows, line) in crop_rows
        .as_chunks::<DOWNSAMPLING>()
        .0
        .iter()
        .zip(out.as_chunks_mut::<IMAGE_SIDE>().0)
    {
        let groups = rows.each_ref().map(|row| row.as_chunks::<GROUP>().0);
        let mut sums = [0u16; IMAGE_SIDE];
        for (group, sums) in sums.as_chunks_mut().0.iter_mut().enumerate() {
            *sums = S::sums_5x5_x8(groups.map(|groups| &groups[group]));
        }
        for (mean, &sum) in line.iter_mut().zip(&sums) {
            // At most 25 · 255 + 12, and 25 is odd, so no mean lies halfway between two levels.
            let product = u32::from(sum + BLOCK_PIXELS / 2) * u32::from(INVERSE);
            // In two steps: the first is one instruction.
            *mean = ((product >> 16) as u16 >> 1) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crop(pixel: impl Fn(usize, usize) -> u8) -> Vec<u8> {
        (0..CROP_SIDE * CROP_SIDE)
            .map(|i| pixel(i / CROP_SIDE, i % CROP_SIDE))
            .collect()
    }

    #[test]
    fn every_pixel_is_its_blocks_mean_rounded_to_nearest() {
        let crop = crop(|row, column| ((row * 7919 + column * 104_729) >> 3) as u8);
        let mut out = [0; IMAGE_PIXELS];
        downsample_440_to_88(&crop, &mut out);
        for (i, &got) in out.iter().enumerate() {
            let (row, column) = (i / IMAGE_SIDE, i % IMAGE_SIDE);
            let mean = (0..25)
                .map(|k| f64::from(crop[(row * 5 + k / 5) * CROP_SIDE + column * 5 + k % 5]))
                .sum::<f64>()
                / 25.0;
            assert_eq!(got, mean.round() as u8, "pixel ({row}, {column})");
        }
    }

    #[test]
    fn black_and_white_stay_black_and_white() {
        for level in [0, 255] {
            let mut out = [7; IMAGE_PIXELS];
            downsample_440_to_88(&crop(|_, _| level), &mut out);
            assert!(out.iter().all(|&pixel| pixel == level));
        }
    }

    #[test]
    fn rows_stay_rows_and_columns_stay_columns() {
        let mut out = [0; IMAGE_PIXELS];
        downsample_440_to_88(
            &crop(|row, column| if row < 5 && column >= 435 { 200 } else { 0 }),
            &mut out,
        );
        assert_eq!(out[IMAGE_SIDE - 1], 200);
        assert_eq!(out.iter().filter(|&&pixel| pixel != 0).count(), 1);
    }

    #[test]
    #[should_panic(expected = "the camera crop has 100 bytes, expected 440 x 440")]
    fn a_crop_of_another_size_is_refused() {
        downsample_440_to_88(&[0; 100], &mut [0; IMAGE_PIXELS]);
    }
}
