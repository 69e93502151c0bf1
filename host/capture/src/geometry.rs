//! Sizes of pictures, and the crop that everything downstream works on: pure.
//! Pixels of 8-bit grey, row-major, the top row first.

use std::fmt;

use crate::error::PictureError;

/// Columns and rows of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// What a camera sends (the paper's camera).
pub const FRAME: Size = Size::new(640, 480);
/// Pixels a side of the crop.
pub const CROP_SIDE: usize = 440;
/// The crop.
pub const CROP: Size = Size::new(CROP_SIDE, CROP_SIDE);
/// Pixels a side of the picture that the network `unet` looks at: the crop's means over blocks of [`SMALL_STEP`] pixels.
pub const SMALL_SIDE: usize = 88;
/// Crop pixels a side of a pixel of the small picture.
pub const SMALL_STEP: usize = CROP_SIDE / SMALL_SIDE;
/// First column and row of the crop in a frame: it lies in the middle.
pub const CROP_ORIGIN: [usize; 2] = [(FRAME.width - CROP_SIDE) / 2, (FRAME.height - CROP_SIDE) / 2];

impl Size {
    /// So many columns and rows.
    #[must_use]
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Pixels in all.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}×{}", self.width, self.height)
    }
}

/// How a picture becomes the crop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cropping {
    /// The middle of a frame.
    Middle,
    /// The picture is the crop.
    Whole,
    /// Every pixel of a small picture becomes a block: the means over the blocks are the small picture again.
    Enlarge,
}

impl Cropping {
    /// How a picture of this size becomes the crop; 88×88 counts only where `small` pictures will do.
    ///
    /// # Errors
    /// [`PictureError`] that names the sizes which are accepted.
    pub fn of(size: Size, small: bool) -> Result<Self, PictureError> {
        match size {
            FRAME => Ok(Self::Middle),
            CROP => Ok(Self::Whole),
            Size {
                width: SMALL_SIDE,
                height: SMALL_SIDE,
            } if small => Ok(Self::Enlarge),
            _ => Err(PictureError {
                found: format!("{size} pixels"),
                expected: format!("{FRAME} or {CROP}{}", if small { " or 88×88" } else { "" }),
            }),
        }
    }

    /// Writes the crop of `grey` into `crop`.
    ///
    /// # Panics
    /// When `grey` is smaller than the picture that this is for.
    pub fn apply(self, grey: &[u8], crop: &mut Vec<u8>) {
        crop.clear();
        match self {
            Self::Middle => {
                let [left, top] = CROP_ORIGIN;
                for row in grey.chunks_exact(FRAME.width).skip(top).take(CROP_SIDE) {
                    crop.extend_from_slice(&row[left..left + CROP_SIDE]);
                }
            }
            Self::Whole => crop.extend_from_slice(&grey[..CROP.pixels()]),
            Self::Enlarge => crop.extend(
                (0..CROP.pixels())
                    .map(|i| [i % CROP_SIDE, i / CROP_SIDE].map(|place| place / SMALL_STEP))
                    .map(|[x, y]| grey[y * SMALL_SIDE + x]),
            ),
        }
    }
}
