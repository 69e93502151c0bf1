//! A square image with a border, so that blocks near the edge need no special case.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use std::ops::Range;

/// Width of the border, pixels: as far as a block or a search can reach over the edge.
const BORDER: usize = 24;

/// A square 8-bit image with a border that repeats its outermost pixels.
#[derive(Debug, Clone)]
pub(super) struct Level<const SIDE: usize> {
    pub(super) pixels: Vec<u8>,
}

/// Rows of sixteen pixels below each other, checked once for all rows.
pub(super) struct Rows<'a, const SIDE: usize, const ROWS: usize>(&'a [u8]);

impl<'a, const SIDE: usize, const ROWS: usize> Rows<'a, SIDE, ROWS> {
    /// `N` pixels of row `down`, from column `right` on.
    #[inline]
    pub(super) fn at<const N: usize>(&self, down: usize, right: usize) -> &'a [u8; N] {
        self.0[down * Level::<SIDE>::STRIDE + right..]
            .first_chunk()
            .expect("inside the rows")
    }

    /// All pixels; rows are `STRIDE` apart.
    #[inline]
    pub(super) fn pixels(&self) -> &'a [u8] {
        self.0
    }
}

impl<const SIDE: usize> Level<SIDE> {
    /// Pixels from one bordered row to the next.
    pub(super) const STRIDE: usize = SIDE + 2 * BORDER;

    pub(super) fn new() -> Self {
        Self {
            pixels: vec![0; Self::STRIDE * Self::STRIDE],
        }
    }

    /// `ROWS` rows from (column, row) on. The first eight pixels may reach [`BORDER`] pixels over the edge; the other eight
    /// may then belong to the next row.
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

    pub(super) fn row_mut(&mut self, row: usize) -> &mut [u8; SIDE] {
        let start = (row + BORDER) * Self::STRIDE + BORDER;
        self.pixels[start..].first_chunk_mut().expect("one of the rows")
    }

    pub(super) fn row(&self, row: usize) -> &[u8; SIDE] {
        let start = (row + BORDER) * Self::STRIDE + BORDER;
        self.pixels[start..].first_chunk().expect("one of the rows")
    }

    /// Fills the border beside these rows, and above the first and below the last row of the image.
    pub(super) fn fill_border(&mut self, rows: Range<usize>) {
        let stride = Self::STRIDE;
        for row in rows.clone() {
            let line = &mut self.pixels[(row + BORDER) * stride..(row + BORDER + 1) * stride];
            let (first, last) = (line[BORDER], line[BORDER + SIDE - 1]);
            line[..BORDER].fill(first);
            line[BORDER + SIDE..].fill(last);
        }
        let mut repeat = |row: usize, to: usize| {
            let from = (row + BORDER) * stride;
            for row in to..to + BORDER {
                self.pixels.copy_within(from..from + stride, row * stride);
            }
        };
        if rows.contains(&0) {
            repeat(0, 0);
        }
        if rows.contains(&(SIDE - 1)) {
            repeat(SIDE - 1, SIDE + BORDER);
        }
    }

    /// Sets these rows and columns to the rounded means of 2×2 pixels of `finer`.
    #[inline(always)]
    pub(super) fn downsample<const FINER: usize>(
        &mut self,
        finer: &Level<FINER>,
        rows: Range<usize>,
        columns: &Range<usize>,
    ) {
        for row in rows.clone() {
            let pairs = [2 * row, 2 * row + 1].map(|row| {
                finer.row(row)[2 * columns.start..2 * columns.end]
                    .as_chunks::<2>()
                    .0
            });
            let pairs = pairs[0].iter().zip(pairs[1]);
            for (out, (&[a, b], &[c, d])) in self.row_mut(row)[columns.clone()].iter_mut().zip(pairs) {
                *out = ((u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d) + 2) / 4) as u8;
            }
        }
        self.fill_border(rows);
    }
}
