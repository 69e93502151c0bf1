//! The eight symmetries of the square, applied to a sample: images and map move together, and the shear's
//! components change sign or place with the axes. The world is the same in the mirror, so each sample
//! stands for eight.

use gripline_network::ForceMap;
use gripline_network::constants::{IMAGE_SIDE, MAP_SIDE};
#[cfg(test)]
use gripline_network::tracked::{GRID_CHANNELS, GRID_NODES, GRID_SIDE, Grid, empty_grid};

/// One of the eight: first mirror x, then mirror y, then exchange x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Symmetry {
    /// Columns run backwards; x forces change sign.
    pub(crate) mirror_x: bool,
    /// Rows run backwards; y forces change sign.
    pub(crate) mirror_y: bool,
    /// Rows become columns; x and y forces change places.
    pub(crate) exchange: bool,
}

impl Symmetry {
    pub(crate) const ALL: [Self; 8] = {
        let mut all = [Self {
            mirror_x: false,
            mirror_y: false,
            exchange: false,
        }; 8];
        let mut i = 0;
        while i < 8 {
            all[i] = Self {
                mirror_x: i & 1 != 0,
                mirror_y: i & 2 != 0,
                exchange: i & 4 != 0,
            };
            i += 1;
        }
        all
    };

    /// Where the value at (row, column) of the moved square of `side` comes from, as an index.
    fn source(self, side: usize, row: usize, column: usize) -> usize {
        let (row, column) = if self.exchange {
            (column, row)
        } else {
            (row, column)
        };
        let row = if self.mirror_y { side - 1 - row } else { row };
        let column = if self.mirror_x { side - 1 - column } else { column };
        row * side + column
    }

    /// The moved image's pixels in order.
    pub(crate) fn image<T: Copy>(self, image: &[T]) -> impl Iterator<Item = T> {
        (0..IMAGE_SIDE * IMAGE_SIDE)
            .map(move |i| image[self.source(IMAGE_SIDE, i / IMAGE_SIDE, i % IMAGE_SIDE)])
    }

    /// The symmetry, by its index in [`Self::ALL`], that does what the one at `index` does and then this one.
    pub(crate) fn after(self, index: usize) -> usize {
        // Where two points go tells the eight apart.
        let both = |first: Self, then: Self| {
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|point| then.force(first.force(point)))
        };
        let wanted = both(Self::ALL[index], self);
        let same = |symmetry: &Self| both(*symmetry, Self::ALL[0]) == wanted;
        Self::ALL
            .iter()
            .position(same)
            .expect("two symmetries of the square make a third")
    }

    /// The force that the same contact exerts in the moved world.
    pub(crate) fn force(self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let x = if self.mirror_x { -x } else { x };
        let y = if self.mirror_y { -y } else { y };
        if self.exchange { [y, x, z] } else { [x, y, z] }
    }

    /// The moved grid: motions turn as shear does.
    #[cfg(test)]
    pub(crate) fn grid(self, grid: &Grid) -> Box<Grid> {
        let mut moved = empty_grid();
        for node in 0..GRID_NODES {
            let from = self.source(GRID_SIDE, node / GRID_SIDE, node % GRID_SIDE);
            for class in 0..GRID_CHANNELS / 3 {
                let values = self.force([0, 1, 2].map(|part| grid[3 * class + part][from]));
                for (part, value) in values.into_iter().enumerate() {
                    moved[3 * class + part][node] = value;
                }
            }
        }
        moved
    }

    /// The moved map.
    pub(crate) fn map(self, map: &ForceMap) -> ForceMap {
        std::array::from_fn(|i| self.force(map[self.source(MAP_SIDE, i / MAP_SIDE, i % MAP_SIDE)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> ForceMap {
        std::array::from_fn(|i| {
            let i = i as f32;
            [
                (i * 0.37).sin(),
                (i * 0.11 + 1.0).sin(),
                (i * 0.05).cos().max(0.0),
            ]
        })
    }

    /// Total force and the moment about z, with taxel coordinates in pitches from the centre.
    fn totals(map: &ForceMap) -> [f64; 4] {
        let mut totals = [0.0; 4];
        for (i, force) in map.iter().enumerate() {
            let [fx, fy, fz] = force.map(f64::from);
            let (x, y) = ((i % MAP_SIDE) as f64 - 9.5, (i / MAP_SIDE) as f64 - 9.5);
            for (total, part) in totals.iter_mut().zip([fx, fy, fz, x * fy - y * fx]) {
                *total += part;
            }
        }
        totals
    }

    #[test]
    fn total_force_moves_as_a_vector_and_the_moment_as_a_pseudoscalar() {
        let [x, y, z, m] = totals(&map());
        for symmetry in Symmetry::ALL {
            let Symmetry {
                mirror_x,
                mirror_y,
                exchange,
            } = symmetry;
            let mx = if mirror_x { -x } else { x };
            let my = if mirror_y { -y } else { y };
            let expected_xy = if exchange { [my, mx] } else { [mx, my] };
            let reflections = [mirror_x, mirror_y, exchange].iter().filter(|&&on| on).count();
            let sign = if reflections % 2 == 0 { 1.0 } else { -1.0 };
            let got = totals(&symmetry.map(&map()));
            for (got, expected) in got.iter().zip([expected_xy[0], expected_xy[1], z, sign * m]) {
                assert!(
                    (got - expected).abs() < 1e-4,
                    "{symmetry:?}: {got} for {expected}"
                );
            }
        }
    }

    #[test]
    fn a_bright_spot_and_the_force_under_it_move_together() {
        // Image pixel (row, column) lies over taxel (row, column) · 20 / 88.
        let (row, column) = (3, 15);
        let mut image = [0u8; IMAGE_SIDE * IMAGE_SIDE];
        image[(row * 22 / 5 + 2) * IMAGE_SIDE + column * 22 / 5 + 2] = 255;
        let mut map = [[0.0; 3]; MAP_SIDE * MAP_SIDE];
        map[row * MAP_SIDE + column] = [0.0, 0.0, 1.0];
        for symmetry in Symmetry::ALL {
            let spot = symmetry.image(&image).position(|pixel| pixel == 255).unwrap();
            let taxel = symmetry
                .map(&map)
                .iter()
                .position(|force| force[2] > 0.0)
                .unwrap();
            let over = (spot / IMAGE_SIDE * 5 / 22, spot % IMAGE_SIDE * 5 / 22);
            assert_eq!(over, (taxel / MAP_SIDE, taxel % MAP_SIDE), "{symmetry:?}");
        }
    }

    #[test]
    fn one_symmetry_after_another_is_the_one_that_does_both() {
        for symmetry in Symmetry::ALL {
            for (index, first) in Symmetry::ALL.into_iter().enumerate() {
                let both = Symmetry::ALL[symmetry.after(index)];
                assert_eq!(
                    both.map(&map()),
                    symmetry.map(&first.map(&map())),
                    "{symmetry:?} after {first:?}"
                );
            }
        }
    }

    #[test]
    fn the_eight_symmetries_differ() {
        for (i, a) in Symmetry::ALL.iter().enumerate() {
            for b in &Symmetry::ALL[..i] {
                assert_ne!(a.map(&map()), b.map(&map()), "{a:?} and {b:?}");
            }
        }
    }
}
