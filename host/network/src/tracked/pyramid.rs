//! The camera's crop and its halvings, each with a border, so that windows near the edge need no special case.

use crate::constants::CROP_SIDE;

/// Pixels around every image: as far as a window or a search can reach over the edge.
pub(super) const BORDER: usize = 24;

/// Halvings of the crop: 440, 220, 110 and 55 pixels.
pub(super) const LEVELS: usize = 4;

/// A square 8-bit image with a border that repeats its outermost pixels.
#[derive(Debug, Clone)]
pub(super) struct Level {
    side: usize,
    pixels: Vec<u8>,
}

impl Level {
    fn new(side: usize) -> Self {
        Self {
            side,
            pixels: vec![0; (side + 2 * BORDER) * (side + 2 * BORDER)],
        }
    }

    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Pixels from one bordered row to the next.
    fn stride(&self) -> usize {
        self.side + 2 * BORDER
    }

    /// The `N` pixels from (column, row) on; either may reach [`BORDER`] pixels over the edge.
    #[inline]
    pub(super) fn run<const N: usize>(&self, column: i32, row: i32) -> &[u8; N] {
        let border = BORDER as i32;
        let start = (row + border) as usize * self.stride() + (column + border) as usize;
        self.pixels[start..].first_chunk().expect("inside the border")
    }

    fn row_mut(&mut self, row: usize) -> &mut [u8] {
        let start = (row + BORDER) * self.stride() + BORDER;
        &mut self.pixels[start..start + self.side]
    }

    pub(super) fn row(&self, row: usize) -> &[u8] {
        let start = (row + BORDER) * self.stride() + BORDER;
        &self.pixels[start..start + self.side]
    }

    fn fill_border(&mut self) {
        let (side, stride) = (self.side, self.stride());
        for row in BORDER..BORDER + side {
            let line = &mut self.pixels[row * stride..(row + 1) * stride];
            let (first, last) = (line[BORDER], line[BORDER + side - 1]);
            line[..BORDER].fill(first);
            line[BORDER + side..].fill(last);
        }
        for row in 0..BORDER {
            self.pixels
                .copy_within(BORDER * stride..(BORDER + 1) * stride, row * stride);
            let last = (BORDER + side - 1) * stride;
            self.pixels
                .copy_within(last..last + stride, (BORDER + side + row) * stride);
        }
    }

    /// The mean of each 2×2 of `finer`, rounded.
    fn halve(&mut self, finer: &Self) {
        for row in 0..self.side {
            let (upper, lower) = (finer.row(2 * row), finer.row(2 * row + 1));
            let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            for (out, (&[a, b], &[c, d])) in self.row_mut(row).iter_mut().zip(pairs) {
                *out = ((u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d) + 2) / 4) as u8;
            }
        }
        self.fill_border();
    }
}

/// An image at all its sizes, finest first.
#[derive(Debug, Clone)]
pub(super) struct Pyramid(pub(super) [Level; LEVELS]);

impl Pyramid {
    pub(super) fn new() -> Self {
        Self(std::array::from_fn(|level| Level::new(CROP_SIDE >> level)))
    }

    /// Takes a 440×440 image. No allocation.
    pub(super) fn take(&mut self, crop: &[u8]) {
        for (row, pixels) in crop.chunks_exact(CROP_SIDE).enumerate() {
            self.0[0].row_mut(row).copy_from_slice(pixels);
        }
        self.0[0].fill_border();
        for level in 1..LEVELS {
            let (finer, coarser) = self.0.split_at_mut(level);
            coarser[0].halve(&finer[level - 1]);
        }
    }
}
