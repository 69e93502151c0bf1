//! How much a tile of the picture differs from picture to picture when nothing moves: the camera's noise. From pairs of pictures at
//! rest or, where there is only one of them (folders, clips), from the pictures of the run.
//! Units: sums of absolute differences, grey levels, over tiles of 8×8 pixels.
//! Limits: noise is assumed to stay as it was in the quietest window; where it grows, more is computed, and nothing is missed.

use super::dirty_tiles::{PerTile, TILE, TILES};

/// Pairs of pictures that one estimate is made from.
const WINDOW: u32 = 16;
/// A tile has changed above this multiple of its noise. Of Gaussian noise, a sum over 64 pixels has a standard deviation of 9.4 % of
/// its mean, so this is 4.2 deviations: a tile in 25 pictures.
const TILE_FACTOR: f32 = 1.4;
/// The same for the sum over a group of tiles, which shows a small motion of all of them: 2 %, so 4.5 deviations.
const GROUP_FACTOR: f32 = 1.09;
/// A tile's noise is at most this multiple of the quiet quarter of the tiles: more is motion.
const UNEVEN_MAX: f32 = 1.25;
/// A window is quieter than the quietest from this share of its noise on.
const QUIETER: f32 = 0.98;
/// Smallest noise, grey levels per pixel: the rounding of a camera without noise.
const NOISE_MIN: f32 = 0.06;

/// Tiles along a side of a group, and groups along a side of the picture.
const GROUP: usize = 5;
const GROUPS: usize = TILES / GROUP;

/// The noise of each tile, as far as it is known.
#[derive(Debug, Clone)]
pub(super) struct TileNoise {
    /// Sums over the window.
    window: Box<PerTile<u32>>,
    pairs: u32,
    /// Of the quietest window: what a tile and a group of them may differ by, and the noise of all. None known yet: nothing.
    tile_max: Box<PerTile<u16>>,
    group_max: [[u32; GROUPS]; GROUPS],
    total: f32,
}

impl TileNoise {
    pub(super) fn unknown() -> Self {
        Self {
            window: Box::new([[0; TILES]; TILES]),
            pairs: 0,
            tile_max: Box::new([[0; TILES]; TILES]),
            group_max: [[0; GROUPS]; GROUPS],
            total: f32::INFINITY,
        }
    }

    pub(super) const fn is_known(&self) -> bool {
        self.total.is_finite()
    }

    /// Takes the differences of two pictures. The quietest window counts.
    pub(super) fn learn(&mut self, differences: &PerTile<u16>) {
        let sums = self.window.as_flattened_mut().iter_mut();
        for (sum, &difference) in sums.zip(differences.as_flattened()) {
            *sum += u32::from(difference);
        }
        self.pairs += 1;
        if self.pairs == WINDOW {
            self.close_window();
        }
    }

    /// Makes an estimate from the pairs since the last one.
    pub(super) fn close_window(&mut self) {
        if self.pairs > 0 {
            let mut sorted = *self.window;
            let (_, quarter, _) = sorted.as_flattened_mut().select_nth_unstable(TILES * TILES / 4);
            let limit = UNEVEN_MAX * *quarter as f32 / self.pairs as f32;
            let pairs = self.pairs as f32;
            let noise = |sum: u32| {
                (sum as f32 / pairs)
                    .min(limit)
                    .max(NOISE_MIN * (TILE * TILE) as f32)
            };
            let total = self.window.as_flattened().iter().map(|sum| noise(*sum)).sum();
            // The least of many estimates is too low.
            if total < QUIETER * self.total {
                self.total = total;
                for (row, sums) in self.window.iter().enumerate() {
                    for (column, sum) in sums.iter().enumerate() {
                        self.tile_max[row][column] = (TILE_FACTOR * noise(*sum)) as u16;
                    }
                }
                for (row, groups) in self.group_max.iter_mut().enumerate() {
                    for (column, max) in groups.iter_mut().enumerate() {
                        let tiles = self.window[row * GROUP..][..GROUP].iter();
                        let tiles = tiles.flat_map(|tiles| &tiles[column * GROUP..][..GROUP]);
                        *max = (GROUP_FACTOR * tiles.map(|sum| noise(*sum)).sum::<f32>()) as u32;
                    }
                }
            }
        }
        *self.window = [[0; TILES]; TILES];
        self.pairs = 0;
    }

    /// The tiles that differ by more than noise, alone or with their group.
    pub(super) fn changed(&self, differences: &PerTile<u16>) -> PerTile<bool> {
        let mut changed = [[false; TILES]; TILES];
        for (row, changed) in changed.iter_mut().enumerate() {
            for (column, changed) in changed.iter_mut().enumerate() {
                *changed = differences[row][column] > self.tile_max[row][column];
            }
        }
        for (row, groups) in self.group_max.iter().enumerate() {
            let rows = row * GROUP..(row + 1) * GROUP;
            for (column, max) in groups.iter().enumerate() {
                let columns = column * GROUP..(column + 1) * GROUP;
                let tiles = differences[rows.clone()].iter();
                let sum: u32 = tiles
                    .flat_map(|tiles| &tiles[columns.clone()])
                    .map(|&difference| u32::from(difference))
                    .sum();
                if sum > *max {
                    for changed in &mut changed[rows.clone()] {
                        changed[columns.clone()].fill(true);
                    }
                }
            }
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Differences of noise, 200 levels a tile give or take 9 %, from a generator without a pattern.
    fn noise(state: &mut u64) -> PerTile<u16> {
        let mut unit = || {
            *state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (*state >> 40) as f32 / (1 << 24) as f32
        };
        std::array::from_fn(|_| {
            std::array::from_fn(|_| {
                let normal = (0..12).map(|_| unit()).sum::<f32>() - 6.0;
                (200.0 + 18.8 * normal) as u16
            })
        })
    }

    fn count(changed: &PerTile<bool>) -> usize {
        changed.as_flattened().iter().filter(|changed| **changed).count()
    }

    #[test]
    fn until_noise_is_known_every_difference_is_a_change() {
        let mut known = TileNoise::unknown();
        let mut differences = [[0; TILES]; TILES];
        differences[7][31] = 1;
        assert!(!known.is_known());
        assert_eq!(count(&known.changed(&[[0; TILES]; TILES])), 0);
        assert!(known.changed(&differences)[7][31]);
        let mut state = 1;
        for _ in 0..WINDOW {
            known.learn(&noise(&mut state));
        }
        assert!(known.is_known());
        assert_eq!(count(&known.changed(&differences)), 0);
    }

    #[test]
    fn noise_is_no_change_and_what_moves_is_whatever_moved_while_it_was_learnt() {
        let mut state = 2;
        let mut known = TileNoise::unknown();
        for _ in 0..WINDOW {
            let mut differences = noise(&mut state);
            // A fifth of the picture moves.
            for tiles in &mut differences[..TILES / 5] {
                for difference in tiles {
                    *difference += 150;
                }
            }
            known.learn(&differences);
        }
        let of_noise: usize = (0..100).map(|_| count(&known.changed(&noise(&mut state)))).sum();
        assert!(of_noise < 100, "{of_noise} tiles in 100 pictures");
        for row in [3, 40] {
            let mut differences = noise(&mut state);
            differences[row][20] += 200;
            assert!(known.changed(&differences)[row][20], "row {row}");
        }
        // Half a window moves, and then all is quiet: the quiet window counts.
        for _ in 0..2 * WINDOW {
            known.learn(&noise(&mut state));
        }
        let mut differences = noise(&mut state);
        differences[3][20] = 300;
        assert!(known.changed(&differences)[3][20]);
    }

    #[test]
    fn a_small_change_of_a_whole_group_is_a_change_of_each_of_its_tiles() {
        let mut state = 3;
        let mut known = TileNoise::unknown();
        for _ in 0..WINDOW {
            known.learn(&noise(&mut state));
        }
        let mut differences = noise(&mut state);
        for tiles in &mut differences[10..15] {
            for difference in &mut tiles[20..25] {
                *difference += 30;
            }
        }
        let changed = known.changed(&differences);
        assert!(
            changed[10..15]
                .iter()
                .all(|tiles| tiles[20..25].iter().all(|changed| *changed))
        );
        assert!(count(&changed) <= 26, "{}", count(&changed));
    }
}
