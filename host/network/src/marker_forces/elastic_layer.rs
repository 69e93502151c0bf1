//! The inverse of the gel's elasticity: the forces on the taxels that moved the markers as they moved, the least that do
//! (Tikhonov), where the imprint shows contact and nowhere else, and none that pull. Pure.
//!
//! With u = A f for all markers and taxels, f = S Aᵀ (A S Aᵀ + σ²)⁻¹ u: S holds how large a force may be, σ how wrong a marker.
//! Limits: a linear layer without end; markers on its surface. Shear is read well, since it moves markers by itself; normal force only
//! by how it pushes a gel that hardly can be compressed aside, so an even pressure over the whole field is not seen. Taxels that pull are left out
//! and the rest solved again, at most [`ROUNDS`] times.

use gripline_sensor::Sensor;

use super::kernel::LayerKernel;
use super::motion::MarkerMotion;
use crate::constants::{MAP_SIDE, TAXELS};
use crate::force_map::{Calibration, ForceMap};

/// Force of a taxel that is nothing special: shear, normal, N.
const USUAL_N: [f32; 3] = [0.05, 0.05, 0.15];
/// How wrong a marker is that is seen and one that is not, mm.
const WRONG_MM: [f32; 2] = [0.01, 0.1];
/// Rounds of leaving out what pulls.
const ROUNDS: usize = 3;
/// Below this the taxel is empty, N.
const CONTACT_MIN_N: f32 = 0.01;

/// What the model needs to know of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayerSettings {
    /// Thickness of the gel, mm.
    pub thickness_mm: f64,
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Side of a taxel, mm.
    pub pitch_mm: f64,
    /// Columns and rows of taxels, at most 20 each; they lie in the corner of the map.
    pub grid: [usize; 2],
}

impl LayerSettings {
    /// Those of a description.
    #[must_use]
    pub const fn of(sensor: &Sensor) -> Self {
        Self {
            thickness_mm: sensor.gel.thickness_mm,
            young_mpa: sensor.gel.young_mpa,
            poisson: sensor.gel.poisson,
            pitch_mm: sensor.taxels.pitch_mm,
            grid: sensor.taxels.grid,
        }
    }

    /// Centre of a taxel of the 20×20 map, mm from the middle of the taxels; `None` outside the sensor's grid.
    #[must_use]
    pub fn place_mm(&self, taxel: usize) -> Option<[f64; 2]> {
        let [columns, rows] = self.grid;
        let (column, row) = (taxel % MAP_SIDE, taxel / MAP_SIDE);
        let from_middle = |at: usize, of: usize| (at as f64 + 0.5 - 0.5 * of as f64) * self.pitch_mm;
        (column < columns && row < rows).then(|| [from_middle(column, columns), from_middle(row, rows)])
    }
}

/// The model.
#[derive(Debug, Clone)]
pub struct ElasticLayer {
    settings: LayerSettings,
    kernel: LayerKernel,
    markers: usize,
    /// For each taxel and component what 1 N does to every marker, mm: x of all, then y of all, then the next component.
    influence: Vec<f32>,
}

impl ElasticLayer {
    /// Its name in a description.
    pub const NAME: &'static str = "elastic-layer";
    /// A smooth map is cut where a taxel carries next to nothing; friction as of the particle fingertip's maps.
    pub const CALIBRATION: Calibration = Calibration {
        contact_min_n: CONTACT_MIN_N,
        friction: 0.45,
    };

    /// Without markers yet.
    #[must_use]
    pub fn new(settings: &LayerSettings) -> Self {
        let LayerSettings {
            thickness_mm,
            young_mpa,
            poisson,
            pitch_mm,
            ..
        } = *settings;
        Self {
            settings: *settings,
            kernel: LayerKernel::new(thickness_mm, young_mpa, poisson, pitch_mm),
            markers: 0,
            influence: Vec::new(),
        }
    }

    pub(super) fn manifest(&self) -> String {
        let LayerSettings {
            thickness_mm,
            young_mpa,
            poisson,
            ..
        } = self.settings;
        format!(
            "inverse of an elastic layer of {thickness_mm} mm, {young_mpa} MPa, Poisson's ratio {poisson}; nothing trained"
        )
    }

    pub(super) fn set_rest(&mut self, places_mm: &[[f32; 2]]) {
        self.markers = places_mm.len();
        self.influence = vec![0.0; TAXELS * 3 * 2 * self.markers];
        for taxel in 0..TAXELS {
            let Some([x, y]) = self.settings.place_mm(taxel) else {
                continue;
            };
            for (marker, place) in places_mm.iter().enumerate() {
                let away = [f64::from(place[0]) - x, f64::from(place[1]) - y];
                for (axis, row) in self.kernel.at(away).into_iter().enumerate() {
                    for (component, value) in row.into_iter().enumerate() {
                        let column = 2 * self.markers * (3 * taxel + component);
                        self.influence[column + axis * self.markers + marker] = value as f32;
                    }
                }
            }
        }
    }

    fn column(&self, taxel: usize, component: usize) -> &[f32] {
        let length = 2 * self.markers;
        &self.influence[length * (3 * taxel + component)..][..length]
    }

    pub(super) fn infer(
        &self,
        motions: &[MarkerMotion],
        touched: Option<&[bool; TAXELS]>,
        newtons: &mut ForceMap,
    ) {
        assert_eq!(motions.len(), self.markers, "as many motions as markers at rest");
        *newtons = [[0.0; 3]; TAXELS];
        let mut loaded: Vec<usize> = (0..TAXELS)
            .filter(|taxel| self.settings.place_mm(*taxel).is_some())
            .filter(|taxel| touched.is_none_or(|touched| touched[*taxel]))
            .collect();
        for round in 0..ROUNDS {
            if loaded.is_empty() || self.markers == 0 {
                return;
            }
            let Some(weights) = self.weights(motions, &loaded) else {
                return;
            };
            *newtons = [[0.0; 3]; TAXELS];
            for taxel in &loaded {
                for (component, usual) in USUAL_N.iter().enumerate() {
                    newtons[*taxel][component] =
                        usual * usual * dot(self.column(*taxel, component), &weights);
                }
            }
            let before = loaded.len();
            loaded.retain(|taxel| newtons[*taxel][2] > 0.0);
            if loaded.len() == before || round + 1 == ROUNDS {
                break;
            }
        }
        for force in newtons.iter_mut().filter(|force| force[2] <= 0.0) {
            *force = [0.0; 3];
        }
    }

    /// (A S Aᵀ + σ²)⁻¹ u over these taxels; `None` where rounding makes it no number.
    fn weights(&self, motions: &[MarkerMotion], loaded: &[usize]) -> Option<Vec<f32>> {
        let size = 2 * self.markers;
        // Rows of the lower triangle, each at its full length.
        let mut system = vec![0.0; size * size];
        for taxel in loaded {
            for (component, usual) in USUAL_N.iter().enumerate() {
                let column = self.column(*taxel, component);
                let usual_squared = usual * usual;
                for (row, value) in system
                    .chunks_exact_mut(size)
                    .zip(column)
                    .enumerate()
                    .map(|(at, (row, value))| (&mut row[..=at], value))
                {
                    let scaled = usual_squared * value;
                    for (into, value) in row.iter_mut().zip(column) {
                        *into += scaled * value;
                    }
                }
            }
        }
        let mut moved = vec![0.0; size];
        for (marker, motion) in motions.iter().enumerate() {
            let wrong = WRONG_MM[usize::from(!motion.is_seen)];
            for axis in 0..2 {
                let at = axis * self.markers + marker;
                moved[at] = motion.moved_mm[axis];
                system[at * size + at] += wrong * wrong;
            }
        }
        solve(&mut system, &mut moved)?;
        Some(moved)
    }
}

/// Solves a symmetric positive definite system, of which the lower triangle is given, in place (Cholesky); `None` when it is not.
fn solve(system: &mut [f32], right: &mut [f32]) -> Option<()> {
    let size = right.len();
    for at in 0..size {
        let (above, rest) = system.split_at_mut(at * size);
        let row = &mut rest[..=at];
        for before in 0..at {
            let other = &above[before * size..][..=before];
            let sum = row[before] - dot(&row[..before], &other[..before]);
            row[before] = sum / other[before];
        }
        let square = row[at] - dot(&row[..at], &row[..at]);
        if square.is_nan() || square <= 0.0 {
            return None;
        }
        row[at] = square.sqrt();
        right[at] = (right[at] - dot(&row[..at], &right[..at])) / row[at];
    }
    for at in (0..size).rev() {
        right[at] /= system[at * size + at];
        let value = right[at];
        for (below, entry) in right[..at].iter_mut().zip(&system[at * size..][..at]) {
            *below -= value * entry;
        }
    }
    Some(())
}

pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    // Eight sums side by side: one would wait for each addition.
    let mut sums = [0.0f32; 8];
    let (a, b) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.0.iter().zip(b.0) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a.1.iter().zip(b.1).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn settings() -> LayerSettings {
        LayerSettings::of(&Sensor::named(Path::new("gelsight-mini")).unwrap())
    }

    /// A grid of markers 1.9 mm apart over the field.
    fn markers() -> Vec<[f32; 2]> {
        (0..70)
            .map(|index| {
                let (column, row) = ((index % 10) as f32, (index / 10) as f32);
                [1.9 * (column - 4.5), 1.9 * (row - 3.0)]
            })
            .collect()
    }

    /// Displacements under a known map, by the model's own kernel.
    fn motions(layer: &ElasticLayer, truth: &ForceMap) -> Vec<MarkerMotion> {
        (0..layer.markers)
            .map(|marker| {
                let mut moved_mm = [0.0; 2];
                for (taxel, force) in truth.iter().enumerate() {
                    for (component, force) in force.iter().enumerate() {
                        let column = layer.column(taxel, component);
                        moved_mm[0] += force * column[marker];
                        moved_mm[1] += force * column[layer.markers + marker];
                    }
                }
                MarkerMotion {
                    moved_mm,
                    is_seen: true,
                }
            })
            .collect()
    }

    fn disc(radius_mm: f64, force: [f32; 3]) -> ForceMap {
        let mut map = [[0.0; 3]; TAXELS];
        for (taxel, to) in map.iter_mut().enumerate() {
            let [x, y] = settings().place_mm(taxel).unwrap();
            if (x - 1.0).hypot(y + 0.7) < radius_mm {
                *to = force;
            }
        }
        map
    }

    fn total(map: &ForceMap) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for force in map {
            for (sum, force) in sum.iter_mut().zip(force) {
                *sum += force;
            }
        }
        sum
    }

    #[test]
    fn a_known_load_is_found_again_where_the_imprint_says_it_is() {
        let mut layer = ElasticLayer::new(&settings());
        layer.set_rest(&markers());
        let truth = disc(3.0, [0.03, -0.02, 0.1]);
        let touched: [bool; TAXELS] = std::array::from_fn(|taxel| truth[taxel][2] > 0.0);
        let mut found = [[0.0; 3]; TAXELS];
        layer.infer(&motions(&layer, &truth), Some(&touched), &mut found);
        let (sum, expected) = (total(&found), total(&truth));
        for axis in 0..3 {
            assert!(
                (sum[axis] / expected[axis] - 1.0).abs() < 0.1,
                "{sum:?} {expected:?}"
            );
        }
        assert!(
            found
                .iter()
                .zip(touched)
                .all(|(force, touched)| touched || force.iter().all(|newtons| newtons.abs() < 1e-9))
        );
        assert!(found.iter().all(|force| force[2] >= 0.0));
    }

    #[test]
    fn markers_that_did_not_move_feel_nothing() {
        let mut layer = ElasticLayer::new(&settings());
        layer.set_rest(&markers());
        let mut found = [[1.0; 3]; TAXELS];
        layer.infer(&vec![MarkerMotion::default(); 70], None, &mut found);
        assert_eq!(found, [[0.0; 3]; TAXELS]);
    }
}
