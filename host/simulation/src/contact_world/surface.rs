//! The gel that contacts share: one gel on one grid of square cells over the sensing surface, with the
//! influence of the cells on each other and its spectra, made once per size of box. Units: mm, MPa.
//! Limits: cells divide the taxels and the field's cells, so that sums over those are exact.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::convolution::Spectra;
use super::influence::Influence;
use crate::constants::{HALF_SURFACE_MM, TAXELS};
use crate::error::SimulationError;
use crate::gel::Gel;

/// Sides of boxes, cells: those whose double transforms fast; 54, 90, 100 or 120 would take longer than the next.
const BOX_SIDES: [usize; 20] = [
    8, 12, 16, 20, 24, 32, 36, 40, 48, 60, 64, 72, 80, 96, 128, 144, 160, 192, 256, 320,
];
/// Two to a taxel: the cells of the field inside the gel, or parts of them.
const CELLS_STEP: usize = 2 * TAXELS;
/// Most cells along one side, for checks; the cost grows with the square.
const MAX_CELLS: usize = 320;

/// Peak forces below which the contact is too small, or its pressure too much at edges, for 80 and for 120 cells, N:
/// `cargo xtask physics` holds every shape's force map to 3 % on them.
const FINE_BELOW_N: [f64; 2] = [6.0, 0.5];

/// Cells along one side of the [`GelSurface`] for a load history that peaks at `peak_force_n`: the fewest that keep every
/// built-in shape's force map within 3 % (L2) of a grid twice as fine. A light touch needs the most: a block's or
/// ring's contact is then a line half a millimetre wide.
#[must_use]
pub fn production_cells(peak_force_n: f64) -> usize {
    let finer = FINE_BELOW_N.iter().filter(|force| peak_force_n < **force).count();
    (2 + finer) * CELLS_STEP
}

/// A soft layer under a grid of cells.
#[derive(Debug)]
pub struct GelSurface {
    gel: Gel,
    cells: usize,
    influence: Influence,
    spectra: Mutex<BTreeMap<[usize; 2], Arc<Spectra>>>,
}

impl GelSurface {
    /// `gel` under `cells` by `cells` squares over the 32 mm of the sensing surface; see [`production_cells`].
    ///
    /// # Errors
    /// A gel constant outside its range, or a number of cells that is not a multiple of 40 up to 320.
    pub fn new(gel: &Gel, cells: usize) -> Result<Self, SimulationError> {
        if cells == 0 || cells > MAX_CELLS || !cells.is_multiple_of(CELLS_STEP) {
            return Err(SimulationError::OutOfRange {
                field: "gel surface cells",
                found: cells as f64,
                expected: "a multiple of 40, at most 320",
            });
        }
        let pitch_mm = 2.0 * HALF_SURFACE_MM / cells as f64;
        Ok(Self {
            gel: *gel,
            cells,
            influence: Influence::new(gel, pitch_mm, 3.0 * HALF_SURFACE_MM)?,
            spectra: Mutex::new(BTreeMap::new()),
        })
    }

    /// The gel.
    #[must_use]
    pub fn gel(&self) -> &Gel {
        &self.gel
    }

    /// Cells along one side of the grid.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.cells
    }

    /// Side of a cell, mm.
    #[must_use]
    pub fn pitch_mm(&self) -> f64 {
        2.0 * HALF_SURFACE_MM / self.cells as f64
    }

    /// Middle of column (or row) `i`, mm.
    pub(crate) fn place_mm(&self, i: usize) -> f64 {
        (i as f64 + 0.5) * self.pitch_mm() - HALF_SURFACE_MM
    }

    /// Side of the smallest box, of those that transform fast, that holds `count` cells.
    pub(crate) fn box_side(&self, count: usize) -> usize {
        BOX_SIDES
            .into_iter()
            .find(|&side| side >= count)
            .unwrap_or(self.cells)
            .min(self.cells)
    }

    /// The influence's spectra for boxes of `rows` by `columns` cells.
    pub(crate) fn spectra(&self, rows: usize, columns: usize) -> Arc<Spectra> {
        // A panic while making spectra leaves the map whole.
        let mut known = self.spectra.lock().unwrap_or_else(PoisonError::into_inner);
        let made = known
            .entry([rows, columns])
            .or_insert_with(|| Arc::new(Spectra::new(&self.influence, rows, columns)));
        Arc::clone(made)
    }
}
