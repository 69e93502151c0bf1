//! The camera's crop and its halvings, each with a border, so that windows near the edge need no special case.

use std::ops::Range;

use super::changed::{Changed, TILE};
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

    /// Repeats the outermost pixels of these rows, beside them and, of the image's first and last row, beyond it.
    fn fill_border(&mut self, rows: Range<usize>) {
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

    /// The mean of each 2×2 of `finer`, rounded, for these rows and columns.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn halve<const FINER: usize>(
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

    /// Takes a 440×440 image, of which `changed` is other than in the one before. No allocation.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn take(&mut self, crop: &[u8], changed: &Changed) {
        for (row, tiles) in changed.rows() {
            // A tile is eight pixels of the crop along a side, so it is a pixel of the eighth, too.
            let pixels = |of_tile: usize| {
                (
                    row * of_tile..(row + 1) * of_tile,
                    tiles.start * of_tile..tiles.end * of_tile,
                )
            };
            let (rows, columns) = pixels(TILE);
            for row in rows.clone() {
                let from = &crop[row * CROP_SIDE..][columns.clone()];
                self.full.row_mut(row)[columns.clone()].copy_from_slice(from);
            }
            self.full.fill_border(rows);
            let (rows, columns) = pixels(TILE / 2);
            self.half.halve(&self.full, rows, &columns);
            let (rows, columns) = pixels(TILE / 4);
            self.quarter.halve(&self.half, rows, &columns);
            let (rows, columns) = pixels(TILE / 8);
            self.eighth.halve(&self.quarter, rows, &columns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pyramid_that_takes_what_changed_is_one_that_takes_everything() {
        let mut crop: Vec<u8> = (0..CROP_SIDE * CROP_SIDE).map(|i| (i * i % 251) as u8).collect();
        let mut kept = Pyramid::new();
        kept.take(&crop, &Changed::everything());
        // Two places at once, with rows between them that keep, at every edge and inside.
        for spot in 0..40_usize {
            for (left, top, side) in [(spot * 97, spot * 61, 9), (spot * 41 + 200, spot * 211, 1)] {
                let [left, top] = [left, top].map(|at| at % (CROP_SIDE - side + 1));
                for row in top..top + side {
                    for pixel in &mut crop[row * CROP_SIDE + left..][..side] {
                        *pixel = pixel.wrapping_add(101);
                    }
                }
            }
            if spot % 4 == 0 {
                let at = [
                    0,
                    CROP_SIDE - 1,
                    CROP_SIDE * (CROP_SIDE - 1),
                    CROP_SIDE * CROP_SIDE - 1,
                ];
                crop[at[spot / 4 % 4]] ^= 0xFF;
            }
            kept.take(&crop, &Changed::between(&kept.full, &crop));
            let mut anew = Pyramid::new();
            anew.take(&crop, &Changed::everything());
            assert!(kept.full.pixels == anew.full.pixels, "spot {spot}");
            assert!(kept.half.pixels == anew.half.pixels, "spot {spot}");
            assert!(kept.quarter.pixels == anew.quarter.pixels, "spot {spot}");
            assert!(kept.eighth.pixels == anew.eighth.pixels, "spot {spot}");
        }
    }
}
