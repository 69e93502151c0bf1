//! A quarter of the layer as a block of graded hexahedra, x and y from the symmetry planes outwards, z from the
//! surface to the base. Lines of the mesh lie on the taxels' borders, and a mesh of twice the fineness contains
//! the coarser one, so that two of them tell the error. Units: mm.

use std::ops::Range;

use gripline_simulation::constants::TAXEL_PITCH_MM;

use super::error::{FiniteElementError, checked};

/// Half width of the block, mm: four thicknesses, over which the layer's slowest field, exp(−0.75 r/h), falls to a
/// twentieth.
const HALF_WIDTH_MM: f64 = 24.0;
/// Taxels from the middle outwards that hold graded elements of equal size each.
const TAXEL_BANDS: usize = 5;
/// How strongly element sizes grow outside the bands, and with depth: the last is about e^this of the first.
const GROWTH_OUT: f64 = 1.2;
const GROWTH_DOWN: f64 = 1.0;

/// The block's nodes and elements.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    /// Lines along x, and along y.
    pub(super) across_mm: Vec<f64>,
    /// Lines along z, surface first.
    pub(super) down_mm: Vec<f64>,
    pub(super) nodes: Vec<[f64; 3]>,
    /// Corners in the order (0,0,0), (1,0,0), (0,1,0), (1,1,0), then the same deeper.
    pub(super) elements: Vec<[usize; 8]>,
}

impl Mesh {
    /// A quarter of a layer `thickness_mm` thick; `fineness` elements along the middle taxel, a multiple of 4.
    pub(super) fn layer(thickness_mm: f64, fineness: usize) -> Result<Self, FiniteElementError> {
        checked(
            "finite-element fineness",
            fineness as f64,
            "4, 8, 12 or 16",
            [4, 8, 12, 16].contains(&fineness),
        )?;
        let bands: [usize; TAXEL_BANDS] = [
            fineness,
            3 * fineness / 4,
            fineness / 2,
            fineness / 2,
            fineness / 4,
        ];
        let mut across = vec![0.0];
        for (taxel, count) in bands.into_iter().enumerate() {
            across.extend((1..=count).map(|i| TAXEL_PITCH_MM * (taxel as f64 + i as f64 / count as f64)));
        }
        let inner = TAXEL_PITCH_MM * TAXEL_BANDS as f64;
        let grown = graded(HALF_WIDTH_MM - inner, 3 * fineness / 4, GROWTH_OUT);
        across.extend(grown.into_iter().skip(1).map(|d| inner + d));
        let down = graded(thickness_mm, 3 * fineness / 2, GROWTH_DOWN);
        Ok(Self::block(across, down))
    }

    /// The block between these lines.
    pub(super) fn block(across_mm: Vec<f64>, down_mm: Vec<f64>) -> Self {
        let (n, m) = (across_mm.len(), down_mm.len());
        let mut nodes = Vec::with_capacity(n * n * m);
        for z in &down_mm {
            for y in &across_mm {
                nodes.extend(across_mm.iter().map(|x| [*x, *y, *z]));
            }
        }
        let mut elements = Vec::with_capacity((n - 1) * (n - 1) * (m - 1));
        for k in 0..m - 1 {
            for j in 0..n - 1 {
                for i in 0..n - 1 {
                    let corner = (k * n + j) * n + i;
                    elements.push(
                        [0, 1, n, n + 1, n * n, n * n + 1, n * n + n, n * n + n + 1].map(|d| corner + d),
                    );
                }
            }
        }
        Self {
            across_mm,
            down_mm,
            nodes,
            elements,
        }
    }

    /// Number of nodes on the surface; they come first.
    pub(super) fn surface_count(&self) -> usize {
        self.across_mm.len() * self.across_mm.len()
    }

    /// Rest area that surface node `node` stands for, mm².
    pub(super) fn node_area_mm2(&self, node: usize) -> f64 {
        let n = self.across_mm.len();
        self.reach(node % n).iter().sum::<f64>() * self.reach(node / n).iter().sum::<f64>()
    }

    /// How far line `line` reaches towards its neighbours: half the way, to the lower one and to the upper one.
    pub(super) fn reach(&self, line: usize) -> [f64; 2] {
        let at = |i: usize| self.across_mm[i];
        let below = if line > 0 {
            0.5 * (at(line) - at(line - 1))
        } else {
            0.0
        };
        let above = if line + 1 < self.across_mm.len() {
            0.5 * (at(line + 1) - at(line))
        } else {
            0.0
        };
        [below, above]
    }

    /// All nodes in the order of nested dissection: both halves of the block, then the plane between them, and so
    /// on within the halves.
    pub(super) fn dissection(&self) -> Vec<usize> {
        let n = self.across_mm.len();
        let mut order = Vec::with_capacity(self.nodes.len());
        dissect(&[0..n, 0..n, 0..self.down_mm.len()], n, &mut order);
        order
    }

    /// Value of the nodes' field `of` at a rest place inside the block (trilinear).
    pub(super) fn interpolate(&self, of: impl Fn(usize) -> [f64; 3], place_mm: [f64; 3]) -> [f64; 3] {
        let n = self.across_mm.len();
        let [(i, u), (j, v), (k, w)] = [
            locate(&self.across_mm, place_mm[0]),
            locate(&self.across_mm, place_mm[1]),
            locate(&self.down_mm, place_mm[2]),
        ];
        let mut sum = [0.0; 3];
        for corner in 0..8 {
            let [a, b, c] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let part = |t: f64, side: usize| if side == 1 { t } else { 1.0 - t };
            let weight = part(u, a) * part(v, b) * part(w, c);
            for (sum, value) in sum.iter_mut().zip(of(((k + c) * n + j + b) * n + i + a)) {
                *sum += weight * value;
            }
        }
        sum
    }
}

fn dissect(part: &[Range<usize>; 3], n: usize, order: &mut Vec<usize>) {
    let widest = (0..3).fold(0, |best, axis| {
        if part[axis].len() > part[best].len() {
            axis
        } else {
            best
        }
    });
    if part[widest].len() <= 2 {
        for k in part[2].clone() {
            for j in part[1].clone() {
                order.extend(part[0].clone().map(|i| (k * n + j) * n + i));
            }
        }
        return;
    }
    let Range { start, end } = part[widest];
    let middle = usize::midpoint(start, end);
    for piece in [start..middle, middle + 1..end, middle..middle + 1] {
        let mut part = part.clone();
        part[widest] = piece;
        dissect(&part, n, order);
    }
}

/// `count` intervals over 0 to `length`, growing.
fn graded(length: f64, count: usize, growth: f64) -> Vec<f64> {
    (0..=count)
        .map(|i| length * libm::expm1(growth * i as f64 / count as f64) / libm::expm1(growth))
        .collect()
}

/// The interval of `lines` that holds `place`, and where in it.
fn locate(lines: &[f64], place: f64) -> (usize, f64) {
    let interval = lines
        .partition_point(|line| *line <= place)
        .clamp(1, lines.len() - 1)
        - 1;
    let (low, high) = (lines[interval], lines[interval + 1]);
    (interval, (place - low) / (high - low))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_lie_on_taxel_borders_and_a_finer_mesh_holds_the_coarser() {
        let coarse = Mesh::layer(6.0, 4).unwrap();
        let fine = Mesh::layer(6.0, 8).unwrap();
        let holds = |lines: &[f64], x: f64| lines.iter().any(|l| (l - x).abs() < 1e-12);
        for taxel in 0..=TAXEL_BANDS {
            assert!(holds(&coarse.across_mm, taxel as f64 * TAXEL_PITCH_MM));
        }
        assert!(coarse.across_mm.iter().all(|x| holds(&fine.across_mm, *x)));
        assert!(coarse.down_mm.iter().all(|z| holds(&fine.down_mm, *z)));
        assert!((fine.across_mm.last().unwrap() - HALF_WIDTH_MM).abs() < 1e-12);
        assert!(Mesh::layer(6.0, 6).is_err());
    }

    #[test]
    fn dissection_visits_every_node_once() {
        let mesh = Mesh::layer(6.0, 4).unwrap();
        let mut order = mesh.dissection();
        order.sort_unstable();
        assert!(order.into_iter().eq(0..mesh.nodes.len()));
    }

    #[test]
    fn node_areas_fill_the_surface_and_interpolation_returns_a_linear_field() {
        let mesh = Mesh::layer(6.0, 4).unwrap();
        let area: f64 = (0..mesh.surface_count())
            .map(|node| mesh.node_area_mm2(node))
            .sum();
        assert!((area - HALF_WIDTH_MM * HALF_WIDTH_MM).abs() < 1e-9);
        let found = mesh.interpolate(|node| mesh.nodes[node], [3.3, 7.7, 4.1]);
        for (found, exact) in found.into_iter().zip([3.3, 7.7, 4.1]) {
            assert!((found - exact).abs() < 1e-12);
        }
    }
}
