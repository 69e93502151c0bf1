//! From a JPEG to the grey levels of the crop: pure, in memory that is used again.
//!
//! A camera's pictures (MJPEG: sequential Huffman codes) are read by [`scan`]: every bit down to the crop's last row, since each
//! block hangs on the one before, but numbers and pixels only of the brightness within the crop. Tables of codes are made once, and
//! are the standard's where the file leaves them out. Files of other kinds, progressive ones above all, are decoded whole by the
//! library zune-jpeg, which is also the judge of the tests.

mod header;
mod huffman;
mod scan;
#[cfg(test)]
mod tests;
mod transform;

use crate::constants::CROP_SIDE;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use self::header::{Header, damaged};
use self::scan::{Tables, Window};
use super::constants::{CROP_LEFT, CROP_TOP, FRAME_HEIGHT, FRAME_WIDTH};

const WIDTH: usize = FRAME_WIDTH as usize;
const HEIGHT: usize = FRAME_HEIGHT as usize;

/// Decodes the crop out of JPEG files, in memory that is used again.
#[derive(Debug, Default)]
pub struct JpegCrop {
    tables: Tables,
    whole: Whole,
}

impl JpegCrop {
    /// The crop of a JPEG of 640×480 or 440×440 pixels.
    ///
    /// # Errors
    /// What is wrong with the file; the crop is then not to be used.
    pub fn decode(&mut self, file: &[u8], crop: &mut Vec<u8>) -> Result<(), String> {
        let header = Header::read(file)?;
        let window = window(header.pixels)?;
        if header.is_plain {
            return self.tables.read(file, &header, window, crop);
        }
        if header.is_tall() {
            // Of these it makes another picture.
            return Err(
                "found a progressive JPEG with less colour down than across, which cannot be read: save it as a sequential one"
                    .to_owned(),
            );
        }
        self.whole.read(file, header.pixels, window, crop)
    }
}

/// Where the crop lies in a picture of so many columns and rows.
fn window(pixels: [usize; 2]) -> Result<Window, String> {
    let from = match pixels {
        [WIDTH, HEIGHT] => [CROP_LEFT, CROP_TOP],
        [CROP_SIDE, CROP_SIDE] => [0, 0],
        [width, height] => {
            return Err(format!(
                "found {width}×{height} pixels, expected 640×480 or 440×440"
            ));
        }
    };
    Ok(Window {
        from,
        side: CROP_SIDE,
    })
}

/// Decodes any JPEG with the library.
#[derive(Debug, Default)]
struct Whole {
    grey: Vec<u8>,
}

impl Whole {
    /// The window's brightness into `crop`, of a picture of so many columns and rows.
    fn read(
        &mut self,
        file: &[u8],
        [width, height]: [usize; 2],
        window: Window,
        crop: &mut Vec<u8>,
    ) -> Result<(), String> {
        self.grey.resize(width * height, 0);
        let options = DecoderOptions::new_fast()
            .set_strict_mode(true)
            .jpeg_set_out_colorspace(ColorSpace::Luma);
        JpegDecoder::new_with_options(ZCursor::new(file), options)
            .decode_into(&mut self.grey)
            .map_err(|error| damaged(&format!("{error:?}")))?;
        let [left, top] = window.from;
        crop.clear();
        for row in self.grey.chunks_exact(width).skip(top).take(window.side) {
            crop.extend_from_slice(&row[left..left + window.side]);
        }
        Ok(())
    }
}
