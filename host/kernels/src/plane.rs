//! An activation image: rows × columns × channels, channels last, with a border of one pixel of
//! zeros on all sides so that padded convolutions need no special case. Nothing ever writes the border.

use super::region::Region;

/// One activation image with its border.
#[derive(Debug, Clone, Default)]
pub struct Plane<T = f32> {
    values: Vec<T>,
    height: usize,
    width: usize,
    channels: usize,
}

impl<T: Copy + Default> Plane<T> {
    /// Zeros.
    #[must_use]
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        Self {
            values: vec![T::default(); (height + 2) * (width + 2) * channels],
            height,
            width,
            channels,
        }
    }

    /// Rows, without the border.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns, without the border.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height and width.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// Channels of a pixel.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// All values, border included; row `r` of [`Self::stride`] values starts at `r * stride`.
    #[must_use]
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// Values from one bordered row to the next.
    #[must_use]
    pub fn stride(&self) -> usize {
        (self.width + 2) * self.channels
    }

    /// The pixels of one row, without the border.
    #[must_use]
    pub fn row(&self, row: usize) -> &[T] {
        let start = (row + 1) * self.stride() + self.channels;
        &self.values[start..start + self.width * self.channels]
    }

    /// The pixels of one row, without the border.
    pub fn row_mut(&mut self, row: usize) -> &mut [T] {
        let start = (row + 1) * self.stride() + self.channels;
        &mut self.values[start..start + self.width * self.channels]
    }

    /// Copies the pixels of `region` from an image of the same size to the channels from `channel` on.
    pub fn copy(&mut self, from: &Self, channel: usize, region: &Region) {
        let (wide, narrow) = (self.channels, from.channels);
        for row in region.rows.clone() {
            let pixels = from.row(row).chunks_exact(narrow);
            let to = self.row_mut(row).chunks_exact_mut(wide).zip(pixels);
            for (to, from) in to.skip(region.columns.start).take(region.columns.len()) {
                to[channel..channel + narrow].copy_from_slice(from);
            }
        }
    }
}
