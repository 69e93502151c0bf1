//! From a camera's bytes to the crop of a described sensor, in colour: decoded, brought to the sensor's size by the mean over the area of
//! each pixel, cropped and turned. Pure.

use gripline_sensor::{Capture, Flip};

use crate::error::PictureError;
use crate::geometry::Size;
use crate::jpeg::JpegDecoding;
use crate::mode::PixelFormat;

/// Turns one camera's frames into colour crops.
#[derive(Debug)]
pub struct ColourConverter {
    format: PixelFormat,
    size: Size,
    /// Bytes from one row to the next, where the format has rows.
    stride: usize,
    capture: Capture,
    jpeg: JpegDecoding,
    /// The whole frame, red, green, blue.
    rgb: Vec<u8>,
}

impl ColourConverter {
    /// For frames of `size`. `stride` is the driver's bytes per row; 0 means rows without a gap.
    #[must_use]
    pub fn new(format: PixelFormat, size: Size, stride: usize, capture: &Capture) -> Self {
        let bytes = match format {
            PixelFormat::Grey => 1,
            PixelFormat::Yuyv => 2,
            PixelFormat::Mjpeg => 0,
        };
        Self {
            format,
            size,
            stride: stride.max(bytes * size.width),
            capture: *capture,
            jpeg: JpegDecoding::default(),
            rgb: Vec::new(),
        }
    }

    /// Writes the crop of `frame` into `crop`: red, green, blue of every pixel, rows from the top.
    ///
    /// # Errors
    /// [`PictureError`]; `crop` is then undefined.
    pub fn crop(&mut self, frame: &[u8], crop: &mut Vec<u8>) -> Result<(), PictureError> {
        match self.format {
            PixelFormat::Mjpeg => {
                let found = self.jpeg.rgb(frame, &mut self.rgb)?;
                if found != self.size {
                    return Err(PictureError {
                        found: format!("{found} pixels"),
                        expected: self.size.to_string(),
                    });
                }
            }
            PixelFormat::Grey | PixelFormat::Yuyv => self.unpack(frame)?,
        }
        scale(&self.rgb, self.size, &self.capture, crop);
        Ok(())
    }

    fn unpack(&mut self, frame: &[u8]) -> Result<(), PictureError> {
        let Size { width, height } = self.size;
        let row_bytes = if self.format == PixelFormat::Grey {
            width
        } else {
            2 * width
        };
        let needed = (height - 1) * self.stride + row_bytes;
        if frame.len() < needed {
            return Err(PictureError {
                found: format!("{} bytes", frame.len()),
                expected: format!("at least {needed}"),
            });
        }
        self.rgb.clear();
        self.rgb.reserve(3 * self.size.pixels());
        for row in frame.chunks(self.stride).take(height) {
            if self.format == PixelFormat::Grey {
                self.rgb.extend(row[..width].iter().flat_map(|level| [*level; 3]));
            } else {
                for [y0, u, y1, v] in row[..row_bytes].as_chunks::<4>().0 {
                    self.rgb.extend(rgb_of([*y0, *u, *v]));
                    self.rgb.extend(rgb_of([*y1, *u, *v]));
                }
            }
        }
        Ok(())
    }
}

/// ITU-R BT.601 with the levels 16 to 235, as cameras send them.
fn rgb_of([y, u, v]: [u8; 3]) -> [u8; 3] {
    let [y, u, v] = [
        1.164 * (f32::from(y) - 16.0),
        f32::from(u) - 128.0,
        f32::from(v) - 128.0,
    ];
    [
        1.596_f32.mul_add(v, y),
        (-0.813_f32).mul_add(v, (-0.392_f32).mul_add(u, y)),
        2.017_f32.mul_add(u, y),
    ]
    .map(|level| level.round().clamp(0.0, 255.0) as u8)
}

/// The pixels of a line that a pixel of the scaled line covers, with the share of each. The shares of one add up to `pixels`.
fn covered(at: usize, of: usize, pixels: usize) -> impl Iterator<Item = (usize, u64)> {
    let (start, end) = (at * pixels, (at + 1) * pixels);
    (start / of..end.div_ceil(of)).map(move |pixel| {
        let share = end.min((pixel + 1) * of) - start.max(pixel * of);
        (pixel, share as u64)
    })
}

/// Brings a picture (red, green, blue) to the sensor's size, and takes crop and turn.
pub(crate) fn scale(rgb: &[u8], from: Size, capture: &Capture, crop: &mut Vec<u8>) {
    let [columns, rows] = capture.size_px;
    let [left, top, width, height] = capture.crop_px;
    let [turn_x, turn_y] = match capture.flip {
        Flip::None => [false, false],
        Flip::Horizontal => [true, false],
        Flip::Vertical => [false, true],
        Flip::Both => [true, true],
    };
    let column = |x: usize| left + if turn_x { width - 1 - x } else { x };
    let area = from.pixels() as u64;
    let mut sums = vec![0_u64; 3 * from.width];
    crop.clear();
    crop.reserve(3 * width * height);
    for y in 0..height {
        let y = top + if turn_y { height - 1 - y } else { y };
        if from == Size::new(columns, rows) {
            let row = &rgb[3 * y * columns..3 * (y + 1) * columns];
            crop.extend((0..width).flat_map(|x| &row[3 * column(x)..3 * column(x) + 3]));
            continue;
        }
        sums.fill(0);
        for (line, share) in covered(y, rows, from.height) {
            let row = &rgb[3 * line * from.width..3 * (line + 1) * from.width];
            for (sum, level) in sums.iter_mut().zip(row) {
                *sum += share * u64::from(*level);
            }
        }
        for x in 0..width {
            let mut pixel = [area / 2; 3];
            for (at, share) in covered(column(x), columns, from.width) {
                for (level, sum) in pixel.iter_mut().zip(&sums[3 * at..]) {
                    *level += share * sum;
                }
            }
            crop.extend(pixel.map(|level| (level / area) as u8));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_sensor::Sensor;

    use super::*;

    fn capture() -> Capture {
        Capture {
            size_px: [32, 24],
            crop_px: [4, 2, 20, 16],
            ..Sensor::named(Path::new("gelsight-mini")).unwrap().capture
        }
    }

    /// A frame whose red grows with the column and green with the row.
    fn ramp(size: Size) -> Vec<u8> {
        (0..size.pixels())
            .flat_map(|pixel| {
                let (x, y) = (pixel % size.width, pixel / size.width);
                [(x * 240 / size.width) as u8, (y * 240 / size.height) as u8, 7]
            })
            .collect()
    }

    #[test]
    fn a_larger_frame_becomes_the_means_and_crop_and_turn_pick_the_same_places() {
        let size = Size::new(320, 240);
        let frame = ramp(size);
        let mut crop = Vec::new();
        scale(&frame, size, &capture(), &mut crop);
        assert_eq!(crop.len(), 20 * 16 * 3);
        // Column 4 of 32 is the mean of frame columns 40 to 49.
        assert!((i32::from(crop[0]) - 33).abs() <= 1, "{}", crop[0]);
        let mut turned = Vec::new();
        let both = Capture {
            flip: Flip::Both,
            ..capture()
        };
        scale(&frame, size, &both, &mut turned);
        let pixels: Vec<_> = crop.as_chunks::<3>().0.iter().rev().collect();
        let expected: Vec<_> = turned.as_chunks::<3>().0.iter().collect();
        assert_eq!(pixels, expected);
    }

    #[test]
    fn a_size_that_is_no_multiple_becomes_the_means_over_the_areas() {
        let capture = Capture {
            size_px: [2, 1],
            crop_px: [0, 0, 2, 1],
            ..capture()
        };
        let mut crop = Vec::new();
        let pixel = |red: u8| [red, 0, 255];
        scale(
            &[pixel(10), pixel(40), pixel(100)].concat(),
            Size::new(3, 1),
            &capture,
            &mut crop,
        );
        // One and a half pixels each: (10 + 40 / 2) / 1.5 and (40 / 2 + 100) / 1.5.
        assert_eq!(crop, [20, 0, 255, 80, 0, 255]);
        scale(&pixel(9), Size::new(1, 1), &capture, &mut crop);
        assert_eq!(crop, [9, 0, 255, 9, 0, 255]);
    }

    #[test]
    fn yuyv_has_its_colours_and_a_short_frame_is_refused() {
        let size = Size::new(32, 24);
        // Pure red in BT.601.
        let frame = [81, 90, 81, 240].repeat(16 * 24);
        let mut converter = ColourConverter::new(PixelFormat::Yuyv, size, 0, &capture());
        let mut crop = Vec::new();
        converter.crop(&frame, &mut crop).unwrap();
        let [red, green, blue] = crop.as_chunks::<3>().0[7];
        assert!(red > 250 && green < 5 && blue < 5, "{red} {green} {blue}");
        assert!(converter.crop(&frame[..100], &mut crop).is_err());
    }
}
