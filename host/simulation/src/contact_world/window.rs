//! Rectangles of cells around a contact: what a step solves in. Units: cells; a place is row × cells + column of
//! the gel's whole grid.

use super::surface::GelSurface;

/// A rectangle of cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    row: usize,
    column: usize,
    pub(crate) rows: usize,
    pub(crate) columns: usize,
}

impl Window {
    /// The cells of the box, as places in the whole grid.
    pub(crate) fn places(self, cells: usize) -> impl Iterator<Item = usize> {
        (0..self.rows).flat_map(move |row| {
            let start = (self.row + row) * cells + self.column;
            start..start + self.columns
        })
    }

    /// Whether all of `bounds` lies inside.
    pub(crate) fn holds(self, bounds: Bounds) -> bool {
        bounds.rows[0] >= self.row
            && bounds.columns[0] >= self.column
            && bounds.rows[1] < self.row + self.rows
            && bounds.columns[1] < self.column + self.columns
    }
}

/// First and last row and column of some cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    rows: [usize; 2],
    columns: [usize; 2],
}

impl Bounds {
    /// Around one cell.
    pub(crate) fn at(place: usize, cells: usize) -> Self {
        Self {
            rows: [place / cells; 2],
            columns: [place % cells; 2],
        }
    }

    /// Around both.
    pub(crate) fn union(self, other: Self) -> Self {
        let both = |a: [usize; 2], b: [usize; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self {
            rows: both(self.rows, other.rows),
            columns: both(self.columns, other.columns),
        }
    }

    /// These and all `places`.
    pub(crate) fn with(self, places: impl Iterator<Item = usize>, cells: usize) -> Self {
        places.fold(self, |bounds, place| bounds.union(Self::at(place, cells)))
    }

    /// With `by` more cells on every side, as far as the grid goes.
    pub(crate) fn widened(self, by: usize, cells: usize) -> Self {
        let wide = |[first, last]: [usize; 2]| [first.saturating_sub(by), (last + by).min(cells - 1)];
        Self {
            rows: wide(self.rows),
            columns: wide(self.columns),
        }
    }

    /// Whether a cell at the edge of the grid is among them.
    pub(crate) fn at_edge(self, cells: usize) -> bool {
        [self.rows, self.columns]
            .iter()
            .any(|[first, last]| *first == 0 || *last == cells - 1)
    }

    /// The smallest box around the bounds, as much in the middle as the grid allows.
    pub(crate) fn window(self, surface: &GelSurface) -> Window {
        let fit = |[first, last]: [usize; 2]| {
            let side = surface.box_side(last - first + 1);
            let spare = side - (last - first + 1);
            (first.saturating_sub(spare / 2).min(surface.cells() - side), side)
        };
        let ((row, rows), (column, columns)) = (fit(self.rows), fit(self.columns));
        Window {
            row,
            column,
            rows,
            columns,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gel::Gel;

    #[test]
    fn a_window_holds_its_bounds_wherever_they_lie_and_stays_on_the_grid() {
        let surface = GelSurface::new(&Gel::default(), 40).unwrap();
        for first in [0, 3, 20, 37, 39] {
            for last in [first, (first + 7).min(39), 39] {
                let bounds = Bounds::at(first * 40 + 11, 40).with([last * 40 + 30].into_iter(), 40);
                let window = bounds.window(&surface);
                assert!(window.holds(bounds), "{bounds:?} in {window:?}");
                let places: Vec<usize> = window.places(40).collect();
                assert_eq!(places.len(), window.rows * window.columns);
                assert!(places.contains(&(first * 40 + 11)) && places.contains(&(last * 40 + 30)));
                assert!(places.iter().all(|&place| place < 1600));
                assert_eq!(bounds.at_edge(40), first == 0 || last == 39);
            }
        }
    }

    #[test]
    fn widening_stops_at_the_edge_and_a_window_does_not_hold_what_sticks_out() {
        let surface = GelSurface::new(&Gel::default(), 40).unwrap();
        let corner = Bounds::at(0, 40);
        assert_eq!(corner.widened(2, 40), corner.with([2 * 40 + 2].into_iter(), 40));
        assert!(!corner.window(&surface).holds(Bounds::at(39 * 40, 40)));
        assert!(!corner.window(&surface).holds(Bounds::at(39, 40)));
    }
}
