//! JPEG compression of a picture, as the camera's own (MJPEG) does it: encoded and decoded by libraries, so that the
//! artefacts are real ones. Blocks of 8 x 8 pixels do not depend on each other.

use jpeg_encoder::{ColorType, Encoder};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Side of JPEG's blocks, pixels.
pub(crate) const BLOCK_PX: usize = 8;

/// Puts `pixels`, `width` to a row, through JPEG at `quality`, 1 to 100. `file` is scratch space and then holds the
/// JPEG file.
///
/// # Panics
/// Never: a picture of a size that JPEG can hold is encoded, and what was encoded decoded.
pub(crate) fn compress(pixels: &mut [u8], width: usize, quality: u8, file: &mut Vec<u8>) {
    file.clear();
    let height = pixels.len() / width;
    Encoder::new(&mut *file, quality)
        .encode(pixels, width as u16, height as u16, ColorType::Luma)
        .expect("a frame fits into a JPEG file, and memory takes it");
    // No SIMD: which one a processor has must not change a picture.
    let options = DecoderOptions::default()
        .set_use_unsafe(false)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    JpegDecoder::new_with_options(ZCursor::new(&*file), options)
        .decode_into(pixels)
        .expect("what the encoder wrote is a JPEG file of this size");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth ramp with round spots.
    fn picture(width: usize, height: usize) -> Vec<u8> {
        (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                let spot = (-((x % 17.0 - 8.0).powi(2) + (y % 13.0 - 6.0).powi(2)) / 3.0).exp();
                (20.0 + 0.2 * x + 150.0 * spot) as u8
            })
            .collect()
    }

    #[test]
    fn the_error_falls_with_quality_and_the_best_hardly_errs() {
        let original = picture(96, 64);
        let mut file = Vec::new();
        let mut last = (f64::MAX, 0);
        for quality in [1, 10, 30, 50, 75, 90, 100] {
            let mut pixels = original.clone();
            compress(&mut pixels, 96, quality, &mut file);
            let square: f64 = pixels
                .iter()
                .zip(&original)
                .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
                .sum();
            let error = (square / original.len() as f64).sqrt();
            assert!(error < last.0 && file.len() > last.1, "{error} at {quality}");
            last = (error, file.len());
        }
        assert!(last.0 < 1.0, "{} levels at quality 100", last.0);
    }

    #[test]
    fn a_part_on_block_borders_compresses_as_the_whole_does() {
        let (width, height) = (96, 64);
        let original = picture(width, height);
        let mut file = Vec::new();
        let mut whole = original.clone();
        compress(&mut whole, width, 40, &mut file);
        let (left, top, size) = (24, 16, 40);
        let cut = |from: &[u8]| -> Vec<u8> {
            (0..size * size)
                .map(|i| from[(top + i / size) * width + left + i % size])
                .collect()
        };
        let mut part = cut(&original);
        compress(&mut part, size, 40, &mut file);
        assert_eq!(part, cut(&whole));
    }
}
