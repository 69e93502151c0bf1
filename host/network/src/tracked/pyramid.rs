//! The camera's crop and its halvings down to an eighth.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use super::dirty_tiles::{DirtyTiles, TILE};
use super::level::Level;
use crate::constants::CROP_SIDE;

/// An image at four resolutions.
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

    /// Updates the `dirty` tiles from a 440×440 image. No allocation.
    #[inline(always)]
    pub(super) fn update(&mut self, crop: &[u8], dirty: &DirtyTiles) {
        for (row, tiles) in dirty.runs() {
            // A tile of eight pixels of the crop is one pixel of the eighth.
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
            self.half.downsample(&self.full, rows, &columns);
            let (rows, columns) = pixels(TILE / 4);
            self.quarter.downsample(&self.half, rows, &columns);
            let (rows, columns) = pixels(TILE / 8);
            self.eighth.downsample(&self.quarter, rows, &columns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updating_the_dirty_tiles_gives_the_same_pyramid_as_updating_everything() {
        let mut crop: Vec<u8> = (0..CROP_SIDE * CROP_SIDE).map(|i| (i * i % 251) as u8).collect();
        let mut kept = Pyramid::new();
        kept.update(&crop, &DirtyTiles::all());
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
            kept.update(&crop, &DirtyTiles::between(&kept.full, &crop));
            let mut anew = Pyramid::new();
            anew.update(&crop, &DirtyTiles::all());
            assert!(kept.full.pixels == anew.full.pixels, "spot {spot}");
            assert!(kept.half.pixels == anew.half.pixels, "spot {spot}");
            assert!(kept.quarter.pixels == anew.quarter.pixels, "spot {spot}");
            assert!(kept.eighth.pixels == anew.eighth.pixels, "spot {spot}");
        }
    }
}
