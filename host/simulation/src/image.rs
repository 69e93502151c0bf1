//! Grayscale images: 640 x 480 frames, their 440 x 440 crops, and the network's input, 88 x 88 block means.
//! Rows grow with +y, columns with +x, as in the force map.

use crate::constants::{CROP_CORNER_PX, CROP_PX, FRAME_PX, NETWORK_PX};

/// An 8-bit grayscale image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` gray levels; index = row * width + column.
    pub pixels: Vec<u8>,
}

impl Image {
    /// A black image.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![0; width * height],
        }
    }

    /// A black 640 x 480 frame.
    #[must_use]
    pub fn frame() -> Self {
        Self::new(FRAME_PX[0], FRAME_PX[1])
    }

    /// A black 440 x 440 crop.
    #[must_use]
    pub fn crop() -> Self {
        Self::new(CROP_PX, CROP_PX)
    }
}

/// The 440 x 440 middle of a 640 x 480 frame: columns 100 to 539, rows 20 to 459.
///
/// # Panics
/// When `frame` does not hold 640 * 480 pixels.
#[must_use]
pub fn crop_of_frame(frame: &Image) -> Image {
    let [width, height] = FRAME_PX;
    assert_eq!(frame.pixels.len(), width * height, "a frame has 640 x 480 pixels");
    let [left, top] = CROP_CORNER_PX;
    let mut crop = Image::crop();
    let rows = frame.pixels.chunks_exact(width).skip(top);
    for (to, from) in crop.pixels.chunks_exact_mut(CROP_PX).zip(rows) {
        to.copy_from_slice(&from[left..left + CROP_PX]);
    }
    crop
}

/// The 88 x 88 image that the force network sees: the 5 x 5 block means of a 440 x 440 crop, rounded to
/// nearest.
///
/// # Panics
/// When `crop` does not hold 440 * 440 pixels.
#[must_use]
pub fn block_mean_88(crop: &[u8]) -> [u8; NETWORK_PX * NETWORK_PX] {
    const BLOCK: usize = CROP_PX / NETWORK_PX;
    assert_eq!(crop.len(), CROP_PX * CROP_PX, "a crop has 440 x 440 pixels");
    let mut out = [0; NETWORK_PX * NETWORK_PX];
    let mut columns = [0_u16; CROP_PX];
    for (band, row_out) in crop
        .chunks_exact(BLOCK * CROP_PX)
        .zip(out.chunks_exact_mut(NETWORK_PX))
    {
        columns.fill(0);
        for row in band.chunks_exact(CROP_PX) {
            for (sum, &pixel) in columns.iter_mut().zip(row) {
                *sum += u16::from(pixel);
            }
        }
        for (pixel, block) in row_out.iter_mut().zip(columns.chunks_exact(BLOCK)) {
            let sum: u16 = block.iter().sum();
            *pixel = ((sum + (BLOCK * BLOCK / 2) as u16) / (BLOCK * BLOCK) as u16) as u8;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_mean_rounds_the_exact_mean_of_every_block() {
        let crop: Vec<u8> = (0..CROP_PX * CROP_PX)
            .map(|i| ((i * 2_654_435_761) >> 13) as u8)
            .collect();
        let small = block_mean_88(&crop);
        for row in 0..NETWORK_PX {
            for column in 0..NETWORK_PX {
                let mut sum = 0.0;
                for y in 0..5 {
                    for x in 0..5 {
                        sum += f64::from(crop[(row * 5 + y) * CROP_PX + column * 5 + x]);
                    }
                }
                assert_eq!(small[row * NETWORK_PX + column], (sum / 25.0_f64).round() as u8);
            }
        }
    }

    #[test]
    fn block_mean_of_a_white_image_is_white() {
        assert!(
            block_mean_88(&vec![255; CROP_PX * CROP_PX])
                .iter()
                .all(|&p| p == 255)
        );
    }
}
