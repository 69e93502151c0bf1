//! One eight-node hexahedron with constant pressure and mean dilatation (Q1P0; Simo, Taylor, Pister 1985), which
//! does not lock at ν → ½: the change of shape is taken at eight Gauss points, the change of volume as the
//! element's mean. Everything follows from one energy, so the tangent is symmetric. Units: mm, N, MPa.
// Tensor formulas are read in index notation.
#![allow(clippy::needless_range_loop)]

use super::ogden::{Matrix, Ogden};

/// Degrees of freedom of an element: x, y, z of corner 0, then of corner 1, …
pub(super) const FREEDOMS: usize = 24;
/// Gauss point of the two-point rule on −1 to 1; weights are 1.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// Energy, forces (its gradient) and stiffness (its second derivative).
pub(super) struct Response {
    pub(super) energy: f64,
    pub(super) force: [f64; FREEDOMS],
    pub(super) stiffness: Box<[[f64; FREEDOMS]; FREEDOMS]>,
}

/// A Gauss point: rest volume, gradients of the corners' functions by rest place, deformation gradient.
struct Point {
    volume: f64,
    gradients: [[f64; 3]; 8],
    deformation: Matrix,
    dilatation: f64,
}

/// The element's energy with corners at rest and now; none if it is turned inside out anywhere.
pub(super) fn energy(material: &Ogden, rest: &[[f64; 3]; 8], now: &[[f64; 3]; 8]) -> Option<f64> {
    let points = points(rest, now)?;
    let (volume, dilatation) = means(&points);
    let shape: f64 = points
        .iter()
        .map(|p| p.volume * material.shape_energy(&p.deformation))
        .sum();
    Some(shape + 0.5 * volume * material.bulk_mpa() * (dilatation - 1.0).powi(2))
}

/// The element's energy and its derivatives; none if it is turned inside out anywhere.
pub(super) fn response(material: &Ogden, rest: &[[f64; 3]; 8], now: &[[f64; 3]; 8]) -> Option<Response> {
    let points = points(rest, now)?;
    let (volume, dilatation) = means(&points);
    let pressure = material.bulk_mpa() * (dilatation - 1.0);
    let mut result = Response {
        energy: 0.5 * volume * material.bulk_mpa() * (dilatation - 1.0).powi(2),
        force: [0.0; FREEDOMS],
        stiffness: Box::new([[0.0; FREEDOMS]; FREEDOMS]),
    };
    // Change of the element's volume with its corners.
    let mut swelling = [0.0; FREEDOMS];
    for point in &points {
        let (energy, stress, mut tangent) = material.shape_response(&point.deformation);
        result.energy += point.volume * energy;
        let cofactor = cofactor(&point.deformation);
        add_cofactor_slope(&mut tangent, pressure, &point.deformation);
        for a in 0..8 {
            for i in 0..3 {
                let (mut force, mut swell) = (0.0, 0.0);
                for j in 0..3 {
                    force += stress[3 * i + j] * point.gradients[a][j];
                    swell += cofactor[i][j] * point.gradients[a][j];
                }
                result.force[3 * a + i] += point.volume * (force + pressure * swell);
                swelling[3 * a + i] += point.volume * swell;
            }
        }
        for b in 0..8 {
            // tangent · ∇N_b, by rows (i, j) and columns k.
            let mut half = [[0.0; 3]; 9];
            for ij in 0..9 {
                for k in 0..3 {
                    let row = &tangent[ij][3 * k..3 * k + 3];
                    half[ij][k] = point.volume
                        * row
                            .iter()
                            .zip(&point.gradients[b])
                            .map(|(t, g)| t * g)
                            .sum::<f64>();
                }
            }
            for a in 0..8 {
                for i in 0..3 {
                    for k in 0..3 {
                        let mut sum = 0.0;
                        for j in 0..3 {
                            sum += point.gradients[a][j] * half[3 * i + j][k];
                        }
                        result.stiffness[3 * a + i][3 * b + k] += sum;
                    }
                }
            }
        }
    }
    for (row, left) in result.stiffness.iter_mut().zip(&swelling) {
        for (value, right) in row.iter_mut().zip(&swelling) {
            *value += material.bulk_mpa() / volume * left * right;
        }
    }
    Some(result)
}

/// Rest volume and mean dilatation.
fn means(points: &[Point; 8]) -> (f64, f64) {
    let volume: f64 = points.iter().map(|p| p.volume).sum();
    let now: f64 = points.iter().map(|p| p.volume * p.dilatation).sum();
    (volume, now / volume)
}

fn points(rest: &[[f64; 3]; 8], now: &[[f64; 3]; 8]) -> Option<[Point; 8]> {
    let points: [Point; 8] = std::array::from_fn(|place| {
        let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
        let at: [f64; 3] = std::array::from_fn(|axis| sign(place, axis) * GAUSS);
        let natural: [[f64; 3]; 8] = std::array::from_fn(|corner| {
            std::array::from_fn(|axis| {
                (0..3)
                    .map(|k| {
                        let s = sign(corner, k);
                        0.5 * if k == axis { s } else { 1.0 + s * at[k] }
                    })
                    .product()
            })
        });
        let of = |corners: &[[f64; 3]; 8], gradients: &[[f64; 3]; 8]| -> Matrix {
            std::array::from_fn(|i| {
                std::array::from_fn(|j| (0..8).map(|c| corners[c][i] * gradients[c][j]).sum())
            })
        };
        let jacobian = of(rest, &natural);
        let volume = determinant(&jacobian);
        let cofactor = cofactor(&jacobian);
        let gradients = natural
            .map(|g| std::array::from_fn(|i| (0..3).map(|j| cofactor[i][j] * g[j]).sum::<f64>() / volume));
        let deformation = of(now, &gradients);
        Point {
            volume,
            gradients,
            deformation,
            dilatation: determinant(&deformation),
        }
    });
    points
        .iter()
        .all(|p| p.volume > 0.0 && p.dilatation > 0.0)
        .then_some(points)
}

fn determinant(m: &Matrix) -> f64 {
    let c = cofactor(m);
    (0..3).map(|j| m[0][j] * c[0][j]).sum()
}

/// ∂det/∂m.
fn cofactor(m: &Matrix) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let (i1, i2, j1, j2) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
            m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1]
        })
    })
}

/// Adds `factor` ∂²det/∂m².
fn add_cofactor_slope(tangent: &mut [[f64; 9]; 9], factor: f64, m: &Matrix) {
    for i in 0..3 {
        for j in 0..3 {
            let (i1, i2, j1, j2) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
            let row = &mut tangent[3 * i + j];
            row[3 * i1 + j1] += factor * m[i2][j2];
            row[3 * i2 + j2] += factor * m[i1][j1];
            row[3 * i1 + j2] -= factor * m[i2][j1];
            row[3 * i2 + j1] -= factor * m[i1][j2];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_simulation::Gel;
    use gripline_simulation::Random;

    fn distorted(random: &mut Random, size: f64) -> [[f64; 3]; 8] {
        std::array::from_fn(|c| {
            std::array::from_fn(|axis| (c >> axis & 1) as f64 + size * (random.unit() - 0.5))
        })
    }

    #[test]
    fn force_and_stiffness_are_the_energys_derivatives_on_a_distorted_element() {
        let material = Ogden::of_gel(&Gel::default()).unwrap();
        let mut random = Random::new(3, 0);
        let rest = distorted(&mut random, 0.3);
        let now = distorted(&mut random, 0.4);
        let found = response(&material, &rest, &now).unwrap();
        assert!((found.energy - energy(&material, &rest, &now).unwrap()).abs() < 1e-14);
        for freedom in 0..FREEDOMS {
            let step = 1e-6;
            let at = |sign: f64| {
                let mut moved = now;
                moved[freedom / 3][freedom % 3] += sign * step;
                response(&material, &rest, &moved).unwrap()
            };
            let (up, down) = (at(1.0), at(-1.0));
            let slope = (up.energy - down.energy) / (2.0 * step);
            assert!((slope - found.force[freedom]).abs() < 1e-8);
            for other in 0..FREEDOMS {
                let slope = (up.force[other] - down.force[other]) / (2.0 * step);
                let stiffness = found.stiffness[other][freedom];
                assert!((slope - stiffness).abs() < 1e-7, "{slope} {stiffness}");
            }
        }
    }

    #[test]
    fn rigid_motion_costs_nothing_and_an_element_turned_inside_out_is_refused() {
        let material = Ogden::of_gel(&Gel::default()).unwrap();
        let rest = distorted(&mut Random::new(5, 0), 0.3);
        let turned = rest.map(|[x, y, z]| [0.6 * x - 0.8 * y + 3.0, 0.8 * x + 0.6 * y, z - 1.0]);
        let found = response(&material, &rest, &turned).unwrap();
        assert!(found.energy.abs() < 1e-14 && found.force.iter().all(|f| f.abs() < 1e-13));
        let mirrored = rest.map(|[x, y, z]| [x, y, -z]);
        assert!(response(&material, &rest, &mirrored).is_none());
    }
}
