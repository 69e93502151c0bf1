//! The gel at large strain: second-order Ogden rubber, nearly incompressible, with the small-strain modulus and
//! Poisson's ratio of the linear layer. W = Σ μ/α (λ̄₁^α + λ̄₂^α + λ̄₃^α − 3) + K/2 (J−1)², λ̄ = J^(−1/3) λ,
//! Σ μα = 2G. Units: MPa (= N·mm per mm³). Limits: elastic, no Mullins softening, no rate.
// Tensor formulas are read in index notation.
#![allow(clippy::needless_range_loop)]

use gripline_simulation::Gel;

use super::error::{FiniteElementError, checked};

/// Exponents α of the gel's two Ogden terms at large strain: a fit to the tensile curve of a silicone of the
/// paper's hardness (Dragon Gel 10 Medium, shore 10A; Marechal et al., Soft Robotics Materials Database, 2020)
/// up to 150 %, 0.25 % of the largest stress off (`python3 checks/ogden_fit.py CURVE.csv`). The second is held
/// at Mooney's −2, because tension alone does not tell it.
const OGDEN_EXPONENTS: [f64; 2] = [3.28, -2.0];
/// Shares of the small-strain shear modulus that the two terms carry, Σ = 1; of the same fit. The modulus itself
/// stays the world's.
const OGDEN_SHARES: [f64; 2] = [0.87, 0.13];

pub(super) type Matrix = [[f64; 3]; 3];
/// Derivative of a 3×3 tensor by a 3×3 tensor, both flattened by rows.
pub(super) type Tangent = [[f64; 9]; 9];

/// The rubber's constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ogden {
    /// μ of the two terms, MPa.
    shear_mpa: [f64; 2],
    /// α of the two terms.
    exponents: [f64; 2],
    /// Bulk modulus K, MPa.
    bulk_mpa: f64,
}

impl Ogden {
    /// The paper's kind of silicone with the small-strain stiffness of `gel`.
    ///
    /// # Errors
    /// A gel constant outside its range, or Poisson's ratio ½.
    pub fn of_gel(gel: &Gel) -> Result<Self, FiniteElementError> {
        Self::new(gel, OGDEN_SHARES, OGDEN_EXPONENTS)
    }

    /// One term with α = 2: what is left when the material's own stiffening is taken away.
    ///
    /// # Errors
    /// Those of [`Self::of_gel`].
    pub fn neo_hooke(gel: &Gel) -> Result<Self, FiniteElementError> {
        Self::new(gel, [1.0, 0.0], [2.0, 2.0])
    }

    /// `shares` of the shear modulus carried by terms with `exponents`: μᵢαᵢ = 2G · share.
    fn new(gel: &Gel, shares: [f64; 2], exponents: [f64; 2]) -> Result<Self, FiniteElementError> {
        gel.check()?;
        checked(
            "finite-element gel poisson",
            gel.poisson,
            "below 0.5",
            gel.poisson < 0.5,
        )?;
        let shear = gel.shear_modulus_mpa();
        Ok(Self {
            shear_mpa: [0, 1].map(|i| 2.0 * shear * shares[i] / exponents[i]),
            exponents,
            bulk_mpa: gel.young_mpa / (3.0 * (1.0 - 2.0 * gel.poisson)),
        })
    }

    /// K, MPa.
    pub(super) fn bulk_mpa(&self) -> f64 {
        self.bulk_mpa
    }

    /// Energy of the change of shape, MPa.
    pub(super) fn shape_energy(&self, deformation: &Matrix) -> f64 {
        let stretches = Stretches::of(deformation);
        self.energy_of(&stretches.values)
    }

    fn energy_of(&self, stretches: &[f64; 3]) -> f64 {
        let volume = stretches[0] * stretches[1] * stretches[2];
        let mut energy = 0.0;
        for (mu, alpha) in self.shear_mpa.into_iter().zip(self.exponents) {
            let sum: f64 = stretches.iter().map(|l| libm::pow(*l, alpha)).sum();
            energy += mu / alpha * (libm::pow(volume, -alpha / 3.0) * sum - 3.0);
        }
        energy
    }

    /// Energy of the change of shape, its first derivative by the deformation gradient (row by row) and its
    /// second. Through the principal stretches; where two are equal the divided difference is its limit.
    pub(super) fn shape_response(&self, deformation: &Matrix) -> (f64, [f64; 9], Tangent) {
        let frame = Stretches::of(deformation);
        let l = frame.values;
        let volume = l[0] * l[1] * l[2];
        let mut first = [0.0; 3];
        let mut second = [[0.0; 3]; 3];
        // (ψᵢ − ψⱼ)/(λᵢ − λⱼ) of the pairs (1, 2), (2, 0), (0, 1).
        let mut difference = [0.0; 3];
        for (mu, alpha) in self.shear_mpa.into_iter().zip(self.exponents) {
            let scale = mu * libm::pow(volume, -alpha / 3.0);
            let power = l.map(|v| libm::pow(v, alpha));
            let sum: f64 = power.iter().sum();
            for i in 0..3 {
                first[i] += scale * (power[i] - sum / 3.0) / l[i];
                for j in 0..3 {
                    let mut value = alpha / 3.0 * (sum / 3.0 - power[i] - power[j]);
                    if i == j {
                        value += (alpha - 1.0) * power[i] + sum / 3.0;
                    }
                    second[i][j] += scale * value / (l[i] * l[j]);
                }
                let (a, b) = (l[(i + 1) % 3], l[(i + 2) % 3]);
                difference[i] += scale * (power_difference(a, b, alpha - 1.0) + sum / (3.0 * a * b));
            }
        }
        let dyads: [[[f64; 9]; 3]; 3] = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                std::array::from_fn(|place| frame.left[place / 3][a] * frame.right[place % 3][b])
            })
        });
        let mut stress = [0.0; 9];
        let mut tangent = [[0.0; 9]; 9];
        for i in 0..3 {
            for place in 0..9 {
                stress[place] += first[i] * dyads[i][i][place];
            }
            for j in 0..3 {
                add_outer(&mut tangent, second[i][j], &dyads[i][i], &dyads[j][j]);
            }
            let (a, b) = ((i + 1) % 3, (i + 2) % 3);
            let mean = (first[a] + first[b]) / (l[a] + l[b]);
            let (same, crossed) = (0.5 * (difference[i] + mean), 0.5 * (difference[i] - mean));
            let (ab, ba) = (&dyads[a][b], &dyads[b][a]);
            add_outer(&mut tangent, same, ab, ab);
            add_outer(&mut tangent, same, ba, ba);
            add_outer(&mut tangent, crossed, ab, ba);
            add_outer(&mut tangent, crossed, ba, ab);
        }
        (self.energy_of(&l), stress, tangent)
    }

    /// Cauchy stress along a bar stretched by `stretch` with free sides, MPa, and the sides' stretch: the closed
    /// form's one unknown by bisection.
    #[cfg(test)]
    pub(super) fn uniaxial(&self, stretch: f64) -> (f64, f64) {
        let along = |l: f64, side: f64| {
            let volume = l * side * side;
            let mut shape = 0.0;
            for (mu, alpha) in self.shear_mpa.into_iter().zip(self.exponents) {
                shape += mu * 2.0 / 3.0 * volume.powf(-alpha / 3.0) * (l.powf(alpha) - side.powf(alpha));
            }
            (shape / volume, self.bulk_mpa * (volume - 1.0))
        };
        let (mut low, mut high) = (0.2, 3.0);
        for _ in 0..200 {
            let side = 0.5 * (low + high);
            let (shape, pressure) = along(stretch, side);
            // The deviator's sides carry −½ of its axial part.
            if pressure - 0.5 * shape > 0.0 {
                high = side;
            } else {
                low = side;
            }
        }
        let side = 0.5 * (low + high);
        let (shape, pressure) = along(stretch, side);
        (shape + pressure, side)
    }
}

/// (a^β − b^β)/(a − b), exact where a = b: with t = ln(a/b) it is (ab)^((β−1)/2) sinh(βt/2)/sinh(t/2).
fn power_difference(a: f64, b: f64, beta: f64) -> f64 {
    let t = libm::log(a / b);
    let ratio = if t == 0.0 {
        beta
    } else {
        libm::sinh(0.5 * beta * t) / libm::sinh(0.5 * t)
    };
    libm::pow(a * b, 0.5 * (beta - 1.0)) * ratio
}

fn add_outer(sum: &mut Tangent, factor: f64, left: &[f64; 9], right: &[f64; 9]) {
    for (row, l) in sum.iter_mut().zip(left) {
        let l = factor * l;
        for (value, r) in row.iter_mut().zip(right) {
            *value += l * r;
        }
    }
}

/// F = left · diag(values) · rightᵀ.
struct Stretches {
    values: [f64; 3],
    left: Matrix,
    right: Matrix,
}

impl Stretches {
    /// Jacobi rotations from the right make the columns of F orthogonal (one-sided Jacobi: no squaring, so close
    /// stretches keep their digits).
    fn of(deformation: &Matrix) -> Self {
        let mut columns = *deformation;
        let mut right = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for _ in 0..30 {
            let mut turned = false;
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                let (mut pp, mut qq, mut pq) = (0.0, 0.0, 0.0);
                for row in &columns {
                    pp += row[p] * row[p];
                    qq += row[q] * row[q];
                    pq += row[p] * row[q];
                }
                if pq.abs() <= 1e-15 * (pp * qq).sqrt() {
                    continue;
                }
                turned = true;
                let zeta = (qq - pp) / (2.0 * pq);
                let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
                let cos = 1.0 / (1.0 + t * t).sqrt();
                let sin = cos * t;
                for row in columns.iter_mut().chain(&mut right) {
                    (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
                }
            }
            if !turned {
                break;
            }
        }
        let values: [f64; 3] =
            std::array::from_fn(|k| columns.iter().map(|row| row[k] * row[k]).sum::<f64>().sqrt());
        Self {
            values,
            left: columns.map(|row| std::array::from_fn(|k| row[k] / values[k])),
            right,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rubber() -> Ogden {
        Ogden::of_gel(&Gel::default()).unwrap()
    }

    fn flat(f: &Matrix) -> [f64; 9] {
        std::array::from_fn(|k| f[k / 3][k % 3])
    }

    fn square(f: &[f64; 9]) -> Matrix {
        std::array::from_fn(|i| std::array::from_fn(|j| f[3 * i + j]))
    }

    /// General, two equal stretches, three equal stretches, two stretches that differ in the ninth digit.
    fn gradients() -> [Matrix; 4] {
        let turn = [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
        let of = |d: [f64; 3]| turn.map(|row| std::array::from_fn(|k| row[k] * d[k]));
        [
            [[0.9, 0.2, -0.1], [0.15, 1.2, 0.3], [-0.2, 0.05, 0.7]],
            of([1.3, 0.8, 0.8]),
            of([0.9, 0.9, 0.9]),
            of([1.1, 1.1 + 1e-9, 0.8]),
        ]
    }

    #[test]
    fn stress_and_tangent_are_the_energys_derivatives_also_at_equal_stretches() {
        let rubber = rubber();
        for f in gradients() {
            let (_, stress, tangent) = rubber.shape_response(&f);
            for place in 0..9 {
                let step = 1e-5;
                let at = |sign: f64| {
                    let mut moved = flat(&f);
                    moved[place] += sign * step;
                    rubber.shape_response(&square(&moved))
                };
                let (up, down) = (at(1.0), at(-1.0));
                let slope = (up.0 - down.0) / (2.0 * step);
                assert!((slope - stress[place]).abs() < 1e-8, "{slope} {}", stress[place]);
                for other in 0..9 {
                    let slope = (up.1[other] - down.1[other]) / (2.0 * step);
                    let found = tangent[other][place];
                    assert!((slope - found).abs() < 1e-7, "{slope} {found} at {other} {place}");
                }
            }
        }
    }

    #[test]
    fn turning_the_body_changes_neither_energy_nor_adds_a_moment() {
        let rubber = rubber();
        let [f, ..] = gradients();
        let turn = [[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]];
        let turned: Matrix =
            std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| turn[i][k] * f[k][j]).sum()));
        assert!((rubber.shape_energy(&turned) - rubber.shape_energy(&f)).abs() < 1e-14);
        let stress = square(&rubber.shape_response(&f).1);
        // P Fᵀ is symmetric.
        let product = |i: usize, j: usize| (0..3).map(|k| stress[i][k] * f[j][k]).sum::<f64>();
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            assert!((product(i, j) - product(j, i)).abs() < 1e-14);
        }
    }

    #[test]
    fn at_small_strain_it_is_the_linear_gel() {
        let gel = Gel::default();
        for rubber in [rubber(), Ogden::neo_hooke(&gel).unwrap()] {
            let (stress, side) = rubber.uniaxial(1.0 + 1e-6);
            assert!((stress / 1e-6 / gel.young_mpa - 1.0).abs() < 1e-4, "{stress}");
            assert!(((1.0 - side) / 1e-6 / gel.poisson - 1.0).abs() < 1e-4, "{side}");
            let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let (energy, stress, tangent) = rubber.shape_response(&unit);
            assert!(energy.abs() < 1e-15 && stress.iter().all(|s| s.abs() < 1e-15));
            // Shear: A_xyxy + A_xyyx over 2 is G.
            let shear = 0.5 * (tangent[1][1] + tangent[1][3]);
            assert!((shear / gel.shear_modulus_mpa() - 1.0).abs() < 1e-12, "{shear}");
        }
    }
}
