//! Which tiles of the image changed since the last frame, so that only what sees a change is computed again.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use std::ops::Range;

use super::block_matching::sad;
use super::level::Level;
use crate::constants::CROP_SIDE;

/// Side of a tile, pixels, and tiles per side of the image.
pub(super) const TILE: usize = 8;
pub(super) const TILES: usize = CROP_SIDE / TILE;

/// A number for every tile.
pub(super) type PerTile<T> = [[T; TILES]; TILES];

/// A rectangle of tiles: its first column and row, and one past its last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TileRect {
    first: [u8; 2],
    end: [u8; 2],
}

impl TileRect {
    pub(super) const ALL: Self = Self {
        first: [0; 2],
        end: [TILES as u8; 2],
    };
    /// Neutral in [`Self::union`]; do not ask [`DirtyTiles::any_in`] for it alone.
    pub(super) const NONE: Self = Self {
        first: [TILES as u8; 2],
        end: [0; 2],
    };

    /// The smallest rectangle around both.
    #[inline]
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            first: [0, 1].map(|k| self.first[k].min(other.first[k])),
            end: [0, 1].map(|k| self.end[k].max(other.end[k])),
        }
    }

    /// The tiles from one pixel of the crop to another, [column, row] each. Pixels in the border count as the nearest pixel
    /// of the crop.
    #[inline]
    pub(super) fn of_pixels(first: [i32; 2], last: [i32; 2]) -> Self {
        let tile = |at: i32| (at.clamp(0, CROP_SIDE as i32 - 1) as usize / TILE) as u8;
        Self {
            first: first.map(tile),
            end: last.map(|at| tile(at) + 1),
        }
    }
}

/// The changed tiles as a summed-area table, so that a rectangle takes four look-ups.
#[derive(Debug)]
pub(super) struct DirtyTiles {
    above_left: [[u16; TILES + 1]; TILES + 1],
    tiles: PerTile<bool>,
}

/// Sums of absolute differences of a picture and the one that is known, grey levels, tile by tile: at most 64 times 255.
#[inline(always)]
pub(super) fn differences(known: &Level<CROP_SIDE>, now: &[u8]) -> PerTile<u16> {
    let mut tiles = [[0; TILES]; TILES];
    for (row, (tiles, lines)) in tiles
        .iter_mut()
        .zip(now.chunks_exact(TILE * CROP_SIDE))
        .enumerate()
    {
        for (column, tile) in tiles.iter_mut().enumerate() {
            let [x, y] = [TILE * column, TILE * row];
            let block: [&[u8; TILE]; TILE] = std::array::from_fn(|line| {
                lines[line * CROP_SIDE + x..]
                    .first_chunk()
                    .expect("inside the picture")
            });
            *tile = sad(block, &known.rows(x as i32, y as i32)) as u16;
        }
    }
    tiles
}

impl DirtyTiles {
    pub(super) fn all() -> Self {
        Self::of(&[[true; TILES]; TILES])
    }

    /// Whatever differs from the picture that is known.
    #[inline(always)]
    pub(super) fn between(known: &Level<CROP_SIDE>, now: &[u8]) -> Self {
        let mut tiles = [[false; TILES]; TILES];
        for (row, (tiles, lines)) in tiles
            .iter_mut()
            .zip(now.chunks_exact(TILE * CROP_SIDE))
            .enumerate()
        {
            let mut differ = [0; CROP_SIDE];
            for (row, line) in (TILE * row..).zip(lines.as_chunks::<CROP_SIDE>().0) {
                let known = known.row(row);
                for k in 0..CROP_SIDE {
                    differ[k] |= known[k] ^ line[k];
                }
            }
            for (tile, differ) in tiles.iter_mut().zip(differ.as_chunks::<TILE>().0) {
                *tile = u64::from_ne_bytes(*differ) != 0;
            }
        }
        Self::of(&tiles)
    }

    pub(super) fn of(tiles: &PerTile<bool>) -> Self {
        let mut above_left = [[0; TILES + 1]; TILES + 1];
        for (row, tiles) in tiles.iter().enumerate() {
            let mut left = 0;
            for (column, tile) in tiles.iter().enumerate() {
                left += u16::from(*tile);
                above_left[row + 1][column + 1] = above_left[row][column + 1] + left;
            }
        }
        Self {
            above_left,
            tiles: *tiles,
        }
    }

    /// Runs of changed tiles: the row, and the range of columns.
    pub(super) fn runs(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        self.tiles.iter().enumerate().flat_map(|(row, tiles)| {
            let mut next = 0;
            std::iter::from_fn(move || {
                let start = next + tiles[next..].iter().position(|tile| *tile)?;
                let length = tiles[start..].iter().position(|tile| !*tile);
                next = length.map_or(TILES, |length| start + length);
                Some((row, start..next))
            })
        })
    }

    /// How many changed.
    pub(super) fn count(&self) -> u16 {
        self.above_left[TILES][TILES]
    }

    /// Whether so few changed that other threads are woken too late to help.
    pub(super) fn are_few(&self) -> bool {
        usize::from(self.count()) < TILES * TILES / 8
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count() == 0
    }

    /// Whether one of these tiles changed.
    #[inline]
    pub(super) fn any_in(&self, tiles: TileRect) -> bool {
        let [left, top] = tiles.first.map(usize::from);
        let [right, bottom] = tiles.end.map(usize::from);
        let at = |row: usize, column: usize| u32::from(self.above_left[row][column]);
        at(bottom, right) + at(top, left) > at(top, right) + at(bottom, left)
    }
}

/// Bit equality, so that NaN equals itself.
#[inline]
pub(super) fn same_bits(a: [f32; 2], b: [f32; 2]) -> bool {
    a[0].to_bits() == b[0].to_bits() && a[1].to_bits() == b[1].to_bits()
}
