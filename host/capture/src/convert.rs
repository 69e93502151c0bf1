//! From a camera's bytes to the 440×440 crop, in one pass over the pixels that are needed: pure.
//!
//! Grey and YUYV are read straight out of the driver's buffer: 440 rows of 440 pixels, nothing else is touched. JPEG pictures
//! have a decoder of their own ([`super::jpeg`]).

use crate::constants::CROP_SIDE;

use super::constants::{CROP_LEFT, CROP_TOP, FRAME_WIDTH};
use super::format::PixelFormat;
use super::jpeg::JpegCrop;

const WIDTH: usize = FRAME_WIDTH as usize;
/// Rows of the frame down to the crop's last.
const ROWS: usize = CROP_TOP + CROP_SIDE;
const CROP_PIXELS: usize = CROP_SIDE * CROP_SIDE;

/// Turns frames of one camera into crops.
#[derive(Debug)]
pub(crate) struct Converter {
    format: PixelFormat,
    /// Bytes from one row to the next, where the format has rows.
    stride: usize,
    jpeg: JpegCrop,
}

impl Converter {
    /// For frames of 640×480 pixels. `stride` is the driver's bytes per line; 0 stands for rows without a gap.
    pub(crate) fn new(format: PixelFormat, stride: usize) -> Self {
        Self {
            format,
            stride: stride.max(row_bytes(format)),
            jpeg: JpegCrop::default(),
        }
    }

    /// The crop of `frame`.
    ///
    /// # Errors
    /// What is wrong with the frame; the crop is then not to be used.
    pub(crate) fn crop(&mut self, frame: &[u8], crop: &mut Vec<u8>) -> Result<(), String> {
        if self.format == PixelFormat::Mjpeg {
            return self.jpeg.decode(frame, crop);
        }
        let needed = (ROWS - 1) * self.stride + row_bytes(self.format);
        if frame.len() < needed {
            return Err(format!("found {} bytes, expected at least {needed}", frame.len()));
        }
        crop.clear();
        crop.reserve(CROP_PIXELS);
        let bytes = row_bytes(self.format) / WIDTH;
        for row in frame.chunks(self.stride).skip(CROP_TOP).take(CROP_SIDE) {
            let pixels = &row[CROP_LEFT * bytes..(CROP_LEFT + CROP_SIDE) * bytes];
            match bytes {
                1 => crop.extend_from_slice(pixels),
                _ => crop.extend(pixels.chunks_exact(2).map(|pixel| pixel[0])),
            }
        }
        Ok(())
    }
}

/// Bytes of a row of 640 pixels; 0 where the format has none.
const fn row_bytes(format: PixelFormat) -> usize {
    match format {
        PixelFormat::Grey => WIDTH,
        PixelFormat::Yuyv => 2 * WIDTH,
        PixelFormat::Mjpeg => 0,
    }
}
