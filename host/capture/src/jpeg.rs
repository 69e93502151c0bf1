//! JPEG pictures to grey levels with the library zune-jpeg: pure, in memory that is used again.
//!
//! The library reads some damaged files without complaint, and some rare kinds of file wrongly. The markers are checked first,
//! so that both are refused. Limits: brightness and colours of a sequential JPEG stand in one scan, as every camera writes them.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::error::PictureError;
use crate::geometry::{Cropping, Size};

/// An APP0 segment that makes the library use the standard's Huffman tables.
const STANDARD_TABLES: &[u8] = b"\xff\xe0\x00\x07AVI1\0";

/// Decodes the crop of JPEG pictures; keeps its memory from picture to picture.
#[derive(Debug, Default)]
pub struct JpegCrop {
    luma: Vec<u8>,
    decoding: JpegDecoding,
}

impl JpegCrop {
    /// Writes the 440×440 crop of a JPEG of 640×480 or 440×440 pixels into `crop`.
    ///
    /// # Errors
    /// [`PictureError`]; `crop` is then undefined.
    pub fn decode(&mut self, file: &[u8], crop: &mut Vec<u8>) -> Result<(), PictureError> {
        let header = Header::read(file)?;
        let cropping = Cropping::of(header.size, false)?;
        self.decoding
            .decode(file, &header, ColorSpace::Luma, &mut self.luma)?;
        cropping.apply(&self.luma, crop);
        Ok(())
    }
}

/// Decodes whole JPEG pictures; keeps its memory from picture to picture.
#[derive(Debug, Default)]
pub(crate) struct JpegDecoding {
    /// The file with [`STANDARD_TABLES`], where it has no tables of its own.
    completed: Vec<u8>,
}

impl JpegDecoding {
    /// Writes red, green and blue of every pixel into `rgb`; returns the picture's size.
    ///
    /// # Errors
    /// [`PictureError`]; `rgb` is then undefined.
    pub(crate) fn rgb(&mut self, file: &[u8], rgb: &mut Vec<u8>) -> Result<Size, PictureError> {
        let header = Header::read(file)?;
        self.decode(file, &header, ColorSpace::RGB, rgb)?;
        Ok(header.size)
    }

    fn decode(
        &mut self,
        file: &[u8],
        header: &Header,
        space: ColorSpace,
        to: &mut Vec<u8>,
    ) -> Result<(), PictureError> {
        let file = if header.has_tables {
            file
        } else {
            // Cameras may leave out the tables that MJPEG prescribes.
            let (start, rest) = file.split_at(2);
            self.completed.clear();
            for part in [start, STANDARD_TABLES, rest] {
                self.completed.extend_from_slice(part);
            }
            &self.completed
        };
        to.resize(space.num_components() * header.size.pixels(), 0);
        let options = DecoderOptions::new_fast()
            .set_strict_mode(true)
            .jpeg_set_out_colorspace(space);
        JpegDecoder::new_with_options(ZCursor::new(file), options)
            .decode_into(to)
            .map_err(|error| damaged(&format!("{error:?}")))
    }
}

fn damaged(what: &str) -> PictureError {
    PictureError {
        found: format!("a damaged JPEG ({what})"),
        expected: "a whole one".to_owned(),
    }
}

/// What the markers of a file say.
struct Header {
    size: Size,
    components: u8,
    is_progressive: bool,
    /// The colours have fewer rows than the brightness, but not fewer columns.
    is_tall: bool,
    /// The file brings Huffman tables.
    has_tables: bool,
}

impl Header {
    /// Walks the markers of `file`.
    fn read(file: &[u8]) -> Result<Self, PictureError> {
        if !file.starts_with(&[0xff, 0xd8]) {
            return Err(PictureError {
                found: "no JPEG (it does not begin with SOI)".to_owned(),
                expected: "one".to_owned(),
            });
        }
        let (mut frame, mut has_tables, mut has_scan) = (None, false, false);
        let mut at = 2;
        // A file may end without EOI: the library notices when bits are missing.
        while let Some([0xff, marker, rest @ ..]) = file.get(at..) {
            match marker {
                // Fill bytes may stand before a marker.
                0xff => {
                    at += 1;
                    continue;
                }
                0xd9 => break,
                _ => {}
            }
            let content = segment(rest).ok_or_else(|| damaged("a segment is cut short"))?;
            at += 4 + content.len();
            match marker {
                0xc4 => has_tables = true,
                // SOF0 to SOF15; 0xc8 and 0xcc are other markers.
                0xc0..=0xcf if ![0xc8, 0xcc].contains(marker) => {
                    let header = Self::of_frame(*marker, content);
                    if frame
                        .replace(header.ok_or_else(|| damaged("a wrong frame header"))?)
                        .is_some()
                    {
                        return Err(damaged("two frame headers"));
                    }
                }
                0xda => {
                    let frame = frame.as_ref().ok_or_else(|| damaged("no frame header"))?;
                    frame.check_scan(content.first().copied().unwrap_or(0))?;
                    has_scan = true;
                    at = scan_end(file, at)?;
                }
                _ => {}
            }
        }
        let frame = frame.ok_or_else(|| damaged("no frame header"))?;
        if !has_scan {
            return Err(damaged("no scan"));
        }
        Ok(Self { has_tables, ..frame })
    }

    /// Reads a frame header.
    fn of_frame(marker: u8, content: &[u8]) -> Option<Self> {
        let [8, y1, y0, x1, x0, components, sampling @ ..] = content else {
            return None;
        };
        // Per component: number, sampling factors (columns in the high half, rows in the low one), table.
        let mut factors = sampling
            .chunks_exact(3)
            .map(|component| [component[1] >> 4, component[1] & 15]);
        let first = factors.next()?;
        (sampling.len() == 3 * usize::from(*components)).then(|| Self {
            size: Size::new(
                u16::from_be_bytes([*x1, *x0]).into(),
                u16::from_be_bytes([*y1, *y0]).into(),
            ),
            components: *components,
            is_progressive: marker == 0xc2,
            is_tall: factors.any(|[x, y]| first[1] * x > first[0] * y),
            has_tables: false,
        })
    }

    /// Refuses the kinds of file that the library reads wrongly or panics at, by the components of a scan.
    fn check_scan(&self, components: u8) -> Result<(), PictureError> {
        let kind = match self.is_progressive {
            true if self.is_tall => "a progressive JPEG with fewer rows than columns of colour",
            false if components != self.components => "a JPEG with its colours in scans of their own",
            _ => return Ok(()),
        };
        Err(PictureError {
            found: kind.to_owned(),
            expected: "another kind, which can be read: convert it, ffmpeg -i IN.jpg OUT.png".to_owned(),
        })
    }
}

/// The content of the segment at the start of `bytes`, which begin with its length.
fn segment(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.get(..usize::from(u16::from_be_bytes(*length)).checked_sub(2)?)
}

/// Finds the marker that ends the scan which begins at `at`. Restart markers count from 0 to 7 and start over; a gap means
/// that a part of the picture is missing.
fn scan_end(file: &[u8], mut at: usize) -> Result<usize, PictureError> {
    let mut restart = 0;
    while let Some(found) = file[at..].iter().position(|byte| *byte == 0xff) {
        at += found;
        match file.get(at + 1) {
            Some(0) => at += 2,
            Some(0xff) => at += 1,
            Some(marker @ 0xd0..=0xd7) if marker & 7 == restart => {
                restart = (restart + 1) % 8;
                at += 2;
            }
            Some(0xd0..=0xd7) => return Err(damaged("a restart is missing")),
            _ => return Ok(at),
        }
    }
    Ok(file.len())
}
