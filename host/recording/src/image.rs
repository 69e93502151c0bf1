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

/// A square grey picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns and rows.
    pub side: usize,
    /// Grey levels, row-major.
    pub pixels: Vec<u8>,
}

impl Image {
    /// The crop that the pipeline takes. A small picture is enlarged so that its block means are the same picture.
    #[must_use]
    pub fn into_crop(self) -> Vec<u8> {
        if self.side == CROP_SIDE {
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
    encoded(&RawImage {
        timestamp: Some(timestamp(ns)),
        frame_id: FRAME_ID.to_owned(),
        width: image.side as u32,
        height: image.side as u32,
        encoding: "mono8".to_owned(),
        step: image.side as u32,
        data: Bytes::copy_from_slice(&image.pixels),
    })
}

/// The picture of a message, when it is one of ours.
pub(crate) fn image_of(bytes: &[u8]) -> Option<Image> {
    let image = RawImage::decode(bytes).ok()?;
    let side = image.width as usize;
    let is_ours = [CROP_SIDE, IMAGE_SIDE].contains(&side) && image.height == image.width;
    (is_ours && image.data.len() == side * side).then(|| Image {
        side,
        pixels: image.data.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_reads_back_and_another_size_is_none_of_ours() {
        let image = Image {
            side: IMAGE_SIDE,
            pixels: (0..IMAGE_SIDE * IMAGE_SIDE).map(|i| i as u8).collect(),
        };
        assert_eq!(image_of(&image_bytes(&image, 7)), Some(image.clone()));
        let odd = Image {
            side: 100,
            pixels: vec![0; 10_000],
        };
        assert_eq!(image_of(&image_bytes(&odd, 7)), None);
        let crop = image.clone().into_crop();
        // Every pixel has become a block of 5×5.
        for (place, pixel) in crop.iter().enumerate() {
            let (row, column) = (place / CROP_SIDE / 5, place % CROP_SIDE / 5);
            assert_eq!(*pixel, image.pixels[row * IMAGE_SIDE + column]);
        }
    }
}
