//! The best linear estimate of the forces that moved the markers: the elastic layer's influence, and what is known beforehand of
//! forces (a map is smooth over a few taxels, pressure larger than shear) and of errors (noise, and a share of the motion itself).
//!
//! With u = A B g + e: B spreads independent numbers g over neighbouring taxels, so f = B g is smooth; then
//! f = B Bᵀ Aᵀ (A B Bᵀ Aᵀ + Σ)⁻¹ u. Σ is the noise over the load's own scale, which the motions tell. What comes closer to the
//! camera moves away from the middle of its picture; A has it. Pure. Limits: those of [`super::kernel`]; nothing beyond the taxels.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::kernel::LayerKernel;
use super::{LayerSettings, MarkerMotion};
use crate::constants::{MAP_SIDE, TAXELS};
use crate::force_map::ForceMap;

/// What a sensor's world has taught, beside its description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearSettings {
    /// How far a map's shear and its pressure hang together, sigma, mm.
    pub smooth_mm: [f64; 2],
    /// Usual shear over usual pressure.
    pub shear: f64,
    /// Sigma of a marker's error, share of the root mean square of all motions.
    pub wrong_share: f64,
    /// The same at rest, mm.
    pub noise_mm: f64,
    /// Depth of the markers under the surface, mm.
    pub depth_mm: f64,
    /// Distance of the lens's centre from the surface as it appears, mm.
    pub distance_mm: f64,
    /// Factors on shear and pressure.
    pub gain: [f64; 2],
}

/// A marker that is not seen is wrong by so many of its own errors: its neighbours stand for it.
const UNSEEN: f64 = 30.0;
/// Errors are taken in steps of this factor, so that a factorisation serves many pictures.
const STEP: f64 = 1.25;

/// The estimate for one set of markers.
#[derive(Debug, Clone)]
pub struct LinearInverse {
    layer: LayerSettings,
    settings: LinearSettings,
    kernel: LayerKernel,
    markers: usize,
    /// A B Bᵀ Aᵀ for a usual pressure of one: x of all markers, then y of all.
    spread: DMatrix<f32>,
    /// B Bᵀ Aᵀ: for each taxel and component what it takes of every marker.
    taken: Vec<f32>,
    /// The newest factorisation, and the errors that it holds for.
    solved: Option<(i32, Vec<bool>, Cholesky<f32, Dyn>)>,
}

impl LinearInverse {
    /// Without markers yet.
    #[must_use]
    pub fn new(layer: &LayerSettings, settings: &LinearSettings) -> Self {
        Self {
            layer: *layer,
            settings: *settings,
            kernel: LayerKernel::new(
                layer.thickness_mm,
                layer.young_mpa,
                layer.poisson,
                layer.pitch_mm,
                settings.depth_mm,
            ),
            markers: 0,
            spread: DMatrix::zeros(0, 0),
            taken: Vec::new(),
            solved: None,
        }
    }

    /// Where the markers are at rest, mm from the middle of the taxels.
    pub fn set_rest(&mut self, places_mm: &[[f32; 2]]) {
        self.markers = places_mm.len();
        self.solved = None;
        let size = 2 * self.markers;
        // Rows: what a unit of every taxel and component does to the markers.
        let mut influence = vec![0.0_f32; TAXELS * 3 * size];
        for taxel in 0..TAXELS {
            let Some([x, y]) = self.layer.place_mm(taxel) else {
                continue;
            };
            for (marker, place) in places_mm.iter().enumerate() {
                let place = place.map(f64::from);
                let [along_x, along_y, down] = self.kernel.at([place[0] - x, place[1] - y]);
                for (axis, along) in [along_x, along_y].into_iter().enumerate() {
                    let closer = place[axis] / self.settings.distance_mm;
                    for component in 0..3 {
                        influence[(3 * taxel + component) * size + axis * self.markers + marker] =
                            (along[component] + closer * down[component]) as f32;
                    }
                }
            }
        }
        let smooth = self.smoothed(&influence, size);
        self.spread = DMatrix::zeros(size, size);
        for row in smooth.chunks_exact(size.max(1)) {
            for (to, value) in row.iter().enumerate() {
                let into = &mut self.spread.as_mut_slice()[to * size + to..(to + 1) * size];
                for (into, other) in into.iter_mut().zip(&row[to..]) {
                    *into += value * other;
                }
            }
        }
        self.taken = self.smoothed(&smooth, size);
    }

    /// Spreads rows (taxel and component) over the neighbouring taxels, and weighs them by how large they usually are.
    fn smoothed(&self, rows: &[f32], size: usize) -> Vec<f32> {
        let usual = [self.settings.shear, self.settings.shear, 1.0];
        let mut out = rows.to_vec();
        let mut line = vec![0.0_f32; MAP_SIDE * size];
        for component in 0..3 {
            let sigma = self.settings.smooth_mm[component / 2] / self.layer.pitch_mm;
            let taps: Vec<f32> = (0..MAP_SIDE)
                .map(|far| (-0.5 * (far as f64 / sigma).powi(2)).exp() as f32)
                .collect();
            // Energy stays: independent numbers keep their size.
            let energy: f32 = taps[0] * taps[0] + 2.0 * taps[1..].iter().map(|tap| tap * tap).sum::<f32>();
            let scale = energy.sqrt().recip();
            for vertical in [false, true] {
                for at in 0..MAP_SIDE {
                    let row = |along: usize| {
                        let taxel = if vertical { along * MAP_SIDE + at } else { at * MAP_SIDE + along };
                        (3 * taxel + component) * size
                    };
                    line.fill(0.0);
                    for to in 0..MAP_SIDE {
                        for from in 0..MAP_SIDE {
                            let tap = taps[to.abs_diff(from)] * scale;
                            if tap > 1e-4 {
                                let sum = &mut line[to * size..(to + 1) * size];
                                for (sum, value) in sum.iter_mut().zip(&out[row(from)..][..size]) {
                                    *sum += tap * value;
                                }
                            }
                        }
                    }
                    for to in 0..MAP_SIDE {
                        out[row(to)..][..size].copy_from_slice(&line[to * size..(to + 1) * size]);
                    }
                }
            }
            let usual = usual[component] as f32;
            for taxel in 0..TAXELS {
                for value in &mut out[(3 * taxel + component) * size..][..size] {
                    *value *= usual;
                }
            }
        }
        out
    }

    /// The forces that moved the markers.
    ///
    /// # Panics
    /// When there are not as many motions as places at rest.
    pub fn infer(&mut self, motions: &[MarkerMotion], newtons: &mut ForceMap) {
        assert_eq!(motions.len(), self.markers, "as many motions as markers at rest");
        *newtons = [[0.0; 3]; TAXELS];
        let size = 2 * self.markers;
        let seen: Vec<bool> = motions.iter().map(|motion| motion.is_seen).collect();
        let count = seen.iter().filter(|seen| **seen).count();
        if count == 0 {
            return;
        }
        let moved = DVector::from_fn(size, |at, _| motions[at % self.markers].moved_mm[at / self.markers]);
        let squares: f64 = motions
            .iter()
            .filter(|motion| motion.is_seen)
            .map(|motion| motion.moved_mm.iter().map(|mm| f64::from(mm * mm)).sum::<f64>())
            .sum();
        let mean_square = squares / (2 * count) as f64;
        let usual_square = f64::from(self.spread.trace()) / size as f64;
        // Errors in the scale of a usual load.
        let share = self.settings.wrong_share.powi(2)
            + self.settings.noise_mm.powi(2) / mean_square.max(self.settings.noise_mm.powi(2));
        let bucket = (share.ln() / (2.0 * STEP.ln())).round() as i32;
        let wrong = usual_square * STEP.powi(2 * bucket);
        let known = |solved: &(i32, Vec<bool>, Cholesky<f32, Dyn>)| solved.0 == bucket && solved.1 == seen;
        if !self.solved.as_ref().is_some_and(known) {
            let mut system = self.spread.clone();
            for at in 0..size {
                let unseen = if seen[at % self.markers] { 1.0 } else { UNSEEN * UNSEEN };
                system[(at, at)] += (wrong * unseen) as f32;
            }
            self.solved = system.cholesky().map(|solved| (bucket, seen, solved));
        }
        let Some((_, _, solved)) = &self.solved else { return };
        let weights = solved.solve(&moved);
        for (taxel, force) in newtons.iter_mut().enumerate() {
            for (component, force) in force.iter_mut().enumerate() {
                let row = &self.taken[(3 * taxel + component) * size..][..size];
                let sum: f32 = super::elastic_layer::dot(row, weights.as_slice());
                *force = sum * self.settings.gain[component / 2] as f32;
            }
        }
    }
}
