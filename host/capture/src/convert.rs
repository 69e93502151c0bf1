//! From a camera's bytes to the crop, in one pass over the pixels that are needed: pure.
//! Grey and YUYV are read straight out of the driver's buffer; JPEG pictures are decoded whole.

use crate::error::PictureError;
use crate::geometry::{CROP, CROP_ORIGIN, CROP_SIDE, FRAME};
use crate::jpeg::JpegCrop;
use crate::mode::PixelFormat;

/// Turns the frames of one camera into crops.
#[derive(Debug)]
pub struct Converter {
    format: PixelFormat,
    /// Bytes from one row to the next, where the format has rows.
    stride: usize,
    jpeg: JpegCrop,
}

impl Converter {
    /// For frames of 640×480 pixels. `stride` is the driver's bytes per row; 0 means rows without a gap.
    #[must_use]
    pub fn new(format: PixelFormat, stride: usize) -> Self {
        Self {
            format,
            stride: stride.max(bytes_per_pixel(format) * FRAME.width),
            jpeg: JpegCrop::default(),
        }
    }

    /// Writes the crop of `frame` into `crop`.
    ///
    /// # Errors
    /// [`PictureError`]; `crop` is then undefined.
    pub fn crop(&mut self, frame: &[u8], crop: &mut Vec<u8>) -> Result<(), PictureError> {
        let bytes = bytes_per_pixel(self.format);
        if bytes == 0 {
            return self.jpeg.decode(frame, crop);
        }
        let [left, top] = CROP_ORIGIN;
        // What lies below the crop may be missing.
        let needed = (top + CROP_SIDE - 1) * self.stride + bytes * FRAME.width;
        if frame.len() < needed {
            return Err(PictureError {
                found: format!("{} bytes", frame.len()),
                expected: format!("at least {needed}"),
            });
        }
        crop.clear();
        crop.reserve(CROP.pixels());
        for row in frame.chunks(self.stride).skip(top).take(CROP_SIDE) {
            let pixels = &row[left * bytes..(left + CROP_SIDE) * bytes];
            match bytes {
                1 => crop.extend_from_slice(pixels),
                _ => crop.extend(pixels.iter().step_by(bytes)),
            }
        }
        Ok(())
    }
}

/// Bytes of a pixel; 0 where the format is compressed.
const fn bytes_per_pixel(format: PixelFormat) -> usize {
    match format {
        PixelFormat::Grey => 1,
        PixelFormat::Yuyv => 2,
        PixelFormat::Mjpeg => 0,
    }
}
