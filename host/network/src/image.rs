//! Camera crop to network input: 440×440 8-bit grayscale to 88×88 by the mean of 5×5 blocks, rounded to
//! the nearest grey level. Row-major; column grows with +x, row with +y, as in the force map.

use crate::constants::{CROP_SIDE, DOWNSAMPLING, IMAGE_PIXELS, IMAGE_SIDE};

/// An input image of the network: 88×88, row-major, 8-bit grayscale.
pub type Image88 = [u8; IMAGE_PIXELS];

/// Pixels of a block.
const BLOCK_PIXELS: u16 = (DOWNSAMPLING * DOWNSAMPLING) as u16;

/// Means of 5×5 blocks of the crop, rounded to nearest.
///
/// # Panics
/// When `crop` is not 440×440 bytes.
pub fn downsample_440_to_88(crop: &[u8], out: &mut Image88) {
    assert_eq!(
        crop.len(),
        CROP_SIDE * CROP_SIDE,
        "the camera crop has {} bytes, expected 440 x 440",
        crop.len()
    );
    let mut columns = [0u16; CROP_SIDE];
    for (rows, line) in crop
        .chunks_exact(DOWNSAMPLING * CROP_SIDE)
        .zip(out.chunks_exact_mut(IMAGE_SIDE))
    {
        columns.fill(0);
        for row in rows.chunks_exact(CROP_SIDE) {
            for (sum, &pixel) in columns.iter_mut().zip(row) {
                *sum += u16::from(pixel);
            }
        }
        for (mean, block) in line.iter_mut().zip(columns.chunks_exact(DOWNSAMPLING)) {
            // At most 25 · 255 + 12, and 25 is odd, so no mean lies halfway between two levels.
            let sum: u16 = block.iter().sum();
            *mean = ((sum + BLOCK_PIXELS / 2) / BLOCK_PIXELS) as u8;
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
