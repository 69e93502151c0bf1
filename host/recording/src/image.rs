//! Pictures as foxglove.RawImage messages and back. Pure.

use std::fmt;
use std::str::FromStr;

use foxglove::Decode;
use foxglove::bytes::Bytes;
use foxglove::messages::RawImage;

use crate::topics::{FRAME_ID, encoded, timestamp};
/// Pixels a side of a whole crop.
pub const CROP_SIDE: usize = 440;
/// Pixels a side of the picture that `unet` looks at.
pub const IMAGE_SIDE: usize = 88;

/// Which pictures are recorded: the value of `record.pictures`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pictures {
    /// The 440×440 crop: 190 kB a picture.
    #[default]
    Full,
    /// The 88×88 image, all that `unet` looks at: 8 kB a picture.
    Small,
    /// None: `replay` then starts from the maps.
    Off,
}

impl Pictures {
    const ALL: [(&'static str, Self); 3] = [("full", Self::Full), ("small", Self::Small), ("off", Self::Off)];
}

impl FromStr for Pictures {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let known = Self::ALL.iter().find(|(name, _)| *name == text);
        known
            .map(|(_, pictures)| *pictures)
            .ok_or_else(|| format!("found {text}, expected full, small or off"))
    }
}

impl fmt::Display for Pictures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::ALL.iter().find(|(_, pictures)| pictures == self);
        f.write_str(name.map_or("", |(name, _)| name))
    }
}

/// A picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Levels, row-major: one of grey or three of red, green, blue a pixel.
    pub pixels: Vec<u8>,
}

impl Image {
    /// A square grey one.
    ///
    /// # Panics
    /// When there are not that many pixels.
    #[must_use]
    pub fn grey(side: usize, pixels: Vec<u8>) -> Self {
        assert_eq!(pixels.len(), side * side, "a square of pixels");
        Self {
            width: side,
            height: side,
            pixels,
        }
    }

    /// Whether a pixel has three levels.
    #[must_use]
    pub const fn is_colour(&self) -> bool {
        self.pixels.len() > self.width * self.height
    }

    /// Rows and columns, and the levels of a pixel where it has colours: the shape of an array of it.
    #[must_use]
    pub fn shape(&self) -> Vec<usize> {
        let mut shape = vec![self.height, self.width];
        shape.extend(self.is_colour().then_some(3));
        shape
    }

    /// The crop that the pipeline takes. A small picture is enlarged so that its block means are the same picture.
    #[must_use]
    pub fn into_crop(self) -> Vec<u8> {
        if self.is_colour() || self.width != IMAGE_SIDE {
            return self.pixels;
        }
        let block = CROP_SIDE / IMAGE_SIDE;
        (0..CROP_SIDE * CROP_SIDE)
            .map(|i| self.pixels[i / CROP_SIDE / block * IMAGE_SIDE + i % CROP_SIDE / block])
            .collect()
    }
}

/// The body of a picture's message.
pub(crate) fn image_bytes(image: &Image, ns: u64) -> Vec<u8> {
    let (encoding, channels) = if image.is_colour() {
        ("rgb8", 3)
    } else {
        ("mono8", 1)
    };
    encoded(&RawImage {
        timestamp: Some(timestamp(ns)),
        frame_id: FRAME_ID.to_owned(),
        width: image.width as u32,
        height: image.height as u32,
        encoding: encoding.to_owned(),
        step: (image.width * channels) as u32,
        data: Bytes::copy_from_slice(&image.pixels),
    })
}

/// The picture of a message, when it is one of ours: a square grey one, or a colour picture of a sensor with printed markers.
pub(crate) fn image_of(bytes: &[u8]) -> Option<Image> {
    let image = RawImage::decode(bytes).ok()?;
    let (width, height) = (image.width as usize, image.height as usize);
    let channels = match image.encoding.as_str() {
        "mono8" if [CROP_SIDE, IMAGE_SIDE].contains(&width) && height == width => 1,
        "rgb8" => 3,
        _ => return None,
    };
    let is_whole = image.data.len() == width.checked_mul(height)?.checked_mul(channels)?;
    (is_whole && width > 0 && height > 0).then(|| Image {
        width,
        height,
        pixels: image.data.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_reads_back_and_another_size_is_none_of_ours() {
        let image = Image::grey(
            IMAGE_SIDE,
            (0..IMAGE_SIDE * IMAGE_SIDE).map(|i| i as u8).collect(),
        );
        assert_eq!(image_of(&image_bytes(&image, 7)), Some(image.clone()));
        let odd = Image::grey(100, vec![0; 10_000]);
        assert_eq!(image_of(&image_bytes(&odd, 7)), None);
        let crop = image.clone().into_crop();
        // Every pixel has become a block of 5×5.
        for (place, pixel) in crop.iter().enumerate() {
            let (row, column) = (place / CROP_SIDE / 5, place % CROP_SIDE / 5);
            assert_eq!(*pixel, image.pixels[row * IMAGE_SIDE + column]);
        }
    }

    #[test]
    fn a_colour_picture_of_any_size_reads_back_as_the_crop_that_it_is() {
        let image = Image {
            width: 32,
            height: 24,
            pixels: (0..32 * 24 * 3).map(|i| i as u8).collect(),
        };
        let read = image_of(&image_bytes(&image, 7)).unwrap();
        assert_eq!(read, image);
        assert_eq!(read.into_crop(), image.pixels);
    }
}
