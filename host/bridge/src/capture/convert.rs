//! From a camera's bytes to the 440×440 crop, in one pass over the pixels that are needed: pure.
//!
//! Grey and YUYV are read straight out of the driver's buffer: 440 rows of 440 pixels, nothing else is touched. Of a JPEG
//! every bit up to the crop's last row has to be read, since each block hangs on the one before; what can be left out is
//! left out: colour is parsed but not transformed, and the rows below the crop are not parsed at all.

use gripline_network::constants::CROP_SIDE;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::constants::{CROP_LEFT, CROP_TOP, FRAME_HEIGHT, FRAME_WIDTH};
use super::format::PixelFormat;

const WIDTH: usize = FRAME_WIDTH as usize;
const HEIGHT: usize = FRAME_HEIGHT as usize;
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

/// Decodes the crop out of JPEG files, in memory that is used again.
#[derive(Debug, Default)]
pub(crate) struct JpegCrop {
    file: Vec<u8>,
    grey: Vec<u8>,
}

impl JpegCrop {
    /// The crop of a JPEG of 640×480 or 440×440 pixels.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub(crate) fn decode(&mut self, file: &[u8], crop: &mut Vec<u8>) -> Result<(), String> {
        let size = size_at(file)?;
        let (width, rows, [left, top]) = match size.pixels {
            [WIDTH, HEIGHT] => (WIDTH, ROWS, [CROP_LEFT, CROP_TOP]),
            [CROP_SIDE, CROP_SIDE] => (CROP_SIDE, CROP_SIDE, [0, 0]),
            [width, height] => {
                return Err(format!(
                    "found {width}×{height} pixels, expected 640×480 or 440×440"
                ));
            }
        };
        // The decoder knows no window, but it stops after the last row that the header speaks of.
        self.file.clear();
        self.file.extend_from_slice(file);
        self.file[size.height_at..size.height_at + 2].copy_from_slice(&(rows as u16).to_be_bytes());
        self.grey.resize(width * rows, 0);
        let options = DecoderOptions::new_fast()
            .set_strict_mode(true)
            .jpeg_set_out_colorspace(ColorSpace::Luma);
        JpegDecoder::new_with_options(ZCursor::new(&self.file), options)
            .decode_into(&mut self.grey)
            .map_err(|error| format!("found a damaged JPEG ({error:?})"))?;
        crop.clear();
        crop.reserve(CROP_PIXELS);
        for row in self.grey.chunks_exact(width).skip(top) {
            crop.extend_from_slice(&row[left..left + CROP_SIDE]);
        }
        Ok(())
    }
}

/// What a JPEG's header says of its size, and where.
struct Size {
    /// Columns and rows.
    pixels: [usize; 2],
    /// Where the two bytes of the rows stand.
    height_at: usize,
}

/// Finds the frame header (ITU-T T.81, B.2.2).
fn size_at(file: &[u8]) -> Result<Size, String> {
    let wrong = || "found a damaged JPEG (no frame header)".to_owned();
    if !file.starts_with(&[0xff, 0xd8]) {
        return Err("found no JPEG (it does not begin with SOI)".to_owned());
    }
    let mut at = 2;
    loop {
        let [0xff, marker, ..] = file.get(at..).ok_or_else(wrong)? else {
            return Err(wrong());
        };
        let length = file.get(at + 2..at + 4).ok_or_else(wrong)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        match marker {
            // Fill bytes may stand before a marker.
            0xff => at += 1,
            // SOF0 to SOF15 without the tables that share the range.
            0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(marker) => {
                let header = file.get(at + 5..at + 9).ok_or_else(wrong)?;
                let number =
                    |place: usize| usize::from(u16::from_be_bytes([header[place], header[place + 1]]));
                return Ok(Size {
                    pixels: [number(2), number(0)],
                    height_at: at + 5,
                });
            }
            // The picture itself, without a header before it.
            0xda | 0xd9 => return Err(wrong()),
            _ => at += 2 + length,
        }
    }
}
