//! The camera's crop and its halvings, each with a border, so that windows near the edge need no special case.

use crate::constants::CROP_SIDE;

/// Pixels around every image: as far as a window or a search can reach over the edge.
pub(super) const BORDER: usize = 24;

/// A square 8-bit image with a border that repeats its outermost pixels.
#[derive(Debug, Clone)]
pub(super) struct Level<const SIDE: usize> {
    pixels: Vec<u8>,
}

/// Rows of sixteen pixels below each other in an image of known width, so that none needs a check of its own.
pub(super) struct Rows<'a, const SIDE: usize, const ROWS: usize>(&'a [u8]);

impl<'a, const SIDE: usize, const ROWS: usize> Rows<'a, SIDE, ROWS> {
    /// `N` pixels, of the row `down` below the first, from its column `right` on.
    #[inline]
    pub(super) fn at<const N: usize>(&self, down: usize, right: usize) -> &'a [u8; N] {
        self.0[down * Level::<SIDE>::STRIDE + right..]
            .first_chunk()
            .expect("inside the rows")
    }
}

impl<const SIDE: usize> Level<SIDE> {
    /// Pixels from one bordered row to the next.
    const STRIDE: usize = SIDE + 2 * BORDER;

    fn new() -> Self {
        Self {
            pixels: vec![0; Self::STRIDE * Self::STRIDE],
        }
    }

    /// `ROWS` rows from (column, row) on. The first eight pixels may reach [`BORDER`] pixels over the edge; the others are
    /// the next row's then.
    #[inline]
    pub(super) fn rows<const ROWS: usize>(&self, column: i32, row: i32) -> Rows<'_, SIDE, ROWS> {
        let border = BORDER as i32;
        let start = (row + border) as usize * Self::STRIDE + (column + border) as usize;
        Rows(&self.pixels[start..][..(ROWS - 1) * Self::STRIDE + 16])
    }

    /// The `N` pixels from (column, row) on; either may reach [`BORDER`] pixels over the edge.
    #[inline]
    pub(super) fn run<const N: usize>(&self, column: i32, row: i32) -> &[u8; N] {
        let border = BORDER as i32;
        let start = (row + border) as usize * Self::STRIDE + (column + border) as usize;
        self.pixels[start..].first_chunk().expect("inside the border")
    }

    fn row_mut(&mut self, row: usize) -> &mut [u8; SIDE] {
        let start = (row + BORDER) * Self::STRIDE + BORDER;
        self.pixels[start..].first_chunk_mut().expect("one of the rows")
    }

    pub(super) fn row(&self, row: usize) -> &[u8; SIDE] {
        let start = (row + BORDER) * Self::STRIDE + BORDER;
        self.pixels[start..].first_chunk().expect("one of the rows")
    }

    fn fill_border(&mut self) {
        let stride = Self::STRIDE;
        for row in BORDER..BORDER + SIDE {
            let line = &mut self.pixels[row * stride..(row + 1) * stride];
            let (first, last) = (line[BORDER], line[BORDER + SIDE - 1]);
            line[..BORDER].fill(first);
            line[BORDER + SIDE..].fill(last);
        }
        for row in 0..BORDER {
            self.pixels
                .copy_within(BORDER * stride..(BORDER + 1) * stride, row * stride);
            let last = (BORDER + SIDE - 1) * stride;
            self.pixels
                .copy_within(last..last + stride, (BORDER + SIDE + row) * stride);
        }
    }

    /// The mean of each 2×2 of `finer`, rounded.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn halve<const FINER: usize>(&mut self, finer: &Level<FINER>) {
        for row in 0..SIDE {
            let (upper, lower) = (finer.row(2 * row), finer.row(2 * row + 1));
            let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            for (out, (&[a, b], &[c, d])) in self.row_mut(row).iter_mut().zip(pairs) {
                *out = ((u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d) + 2) / 4) as u8;
            }
        }
        self.fill_border();
    }
}

/// An image at all its sizes.
#[derive(Debug, Clone)]
pub(super) struct Pyramid {
    pub(super) full: Level<CROP_SIDE>,
    half: Level<{ CROP_SIDE / 2 }>,
    pub(super) quarter: Level<{ CROP_SIDE / 4 }>,
    pub(super) eighth: Level<{ CROP_SIDE / 8 }>,
}

impl Pyramid {
    pub(super) fn new() -> Self {
        Self {
            full: Level::new(),
            half: Level::new(),
            quarter: Level::new(),
            eighth: Level::new(),
        }
    }

    /// Takes a 440×440 image. No allocation.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn take(&mut self, crop: &[u8]) {
        for (row, pixels) in crop.chunks_exact(CROP_SIDE).enumerate() {
            self.full.row_mut(row).copy_from_slice(pixels);
        }
        self.full.fill_border();
        self.half.halve(&self.full);
        self.quarter.halve(&self.half);
        self.eighth.halve(&self.quarter);
    }
}
