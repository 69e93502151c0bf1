//! What a force on one taxel of an elastic layer does to the surface around it, mm per N. The layer is bonded to a rigid base and
//! has no end. Closed wave kernels (REFERENCES, Contact mechanics), brought to places by one-dimensional Hankel integrals. A
//! taxel's square is a Gaussian of the same second moment, which ends the integrals. Limits: small strain; markers on the surface.

use std::f64::consts::PI;

/// Distances in the table per thickness, and its end in thicknesses: what lies beyond moves by less than 1 % of the neighbour.
const STEPS_PER_THICKNESS: f64 = 16.0;
const REACH: f64 = 8.0;
/// Wave numbers, in 1/thickness, per step of the integrals: the Bessel functions turn at most once in three steps.
const WAVE_STEP: f64 = 0.1;
/// Where the Gaussian has fallen to e⁻¹⁸.
const WAVE_END_SIGMAS: f64 = 6.0;

/// The layer's surface around one loaded taxel.
#[derive(Debug, Clone)]
pub(super) struct LayerKernel {
    step_mm: f64,
    table: Vec<Radial>,
}

/// Of a unit force, at one distance, mm per N.
#[derive(Debug, Clone, Copy, Default)]
struct Radial {
    /// Half the sum of what a shear does along and across itself.
    mean: f64,
    /// Half of the difference.
    turn: f64,
    /// What pressure does outwards.
    outwards: f64,
}

impl LayerKernel {
    /// Of a layer under square taxels of side `pitch_mm`.
    pub(super) fn new(thickness_mm: f64, young_mpa: f64, poisson: f64, pitch_mm: f64) -> Self {
        let h = thickness_mm;
        let shear_mpa = young_mpa / (2.0 * (1.0 + poisson));
        let sigma = pitch_mm / 12.0_f64.sqrt() / h;
        let scale = 1.0 / (2.0 * PI * shear_mpa * h);
        let waves: Vec<(f64, [f64; 3])> = (0..(WAVE_END_SIGMAS / sigma / WAVE_STEP) as usize)
            .map(|step| {
                let x = (step as f64 + 0.5) * WAVE_STEP;
                let weight = scale * WAVE_STEP * libm::exp(-0.5 * (x * sigma).powi(2));
                let [across, along, coupling] = closed(x, poisson);
                let (mean, turn) = (0.5 * (along + across), 0.5 * (along - across));
                (x, [mean * weight, turn * weight, coupling * weight])
            })
            .collect();
        let table = (0..=(REACH * STEPS_PER_THICKNESS) as usize)
            .map(|step| {
                let distance = step as f64 / STEPS_PER_THICKNESS;
                let mut sum = Radial::default();
                for (x, [mean, turn, coupling]) in &waves {
                    let at = x * distance;
                    let (j0, j1) = (libm::j0(at), libm::j1(at));
                    let j2 = if at < 1e-4 {
                        at * at / 8.0
                    } else {
                        2.0 * j1 / at - j0
                    };
                    sum.mean += mean * j0;
                    sum.turn += turn * j2;
                    sum.outwards -= coupling * j1;
                }
                sum
            })
            .collect();
        Self {
            step_mm: h / STEPS_PER_THICKNESS,
            table,
        }
    }

    /// Displacement of a place that lies `away` of the taxel's centre, mm: rows x and y; columns for 1 N along x, along y, and
    /// pressing.
    pub(super) fn at(&self, away: [f64; 2]) -> [[f64; 3]; 2] {
        let [x, y] = away;
        let r = x.hypot(y);
        let place = r / self.step_mm;
        let node = place as usize;
        let Some([near, far]) = self.table.get(node..node + 2) else {
            return [[0.0; 3]; 2];
        };
        let t = place - node as f64;
        let between = |of: fn(&Radial) -> f64| (1.0 - t) * of(near) + t * of(far);
        let (mean, turn, outwards) = (
            between(|radial| radial.mean),
            between(|radial| radial.turn),
            between(|radial| radial.outwards),
        );
        let (cos, sin) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
        let (double_cos, double_sin) = (cos * cos - sin * sin, 2.0 * cos * sin);
        [
            [mean - turn * double_cos, -turn * double_sin, outwards * cos],
            [-turn * double_sin, mean + turn * double_cos, outwards * sin],
        ]
    }
}

/// Gk times the layer's surface kernels at x = kh: across, along, along under pressure (REFERENCES).
fn closed(x: f64, poisson: f64) -> [f64; 3] {
    let kolosov = 3.0 - 4.0 * poisson;
    // Everything over cosh 2x, so that large wave numbers do not overflow.
    let fall = libm::exp(-2.0 * x);
    let cosh = 0.5 * (1.0 + fall * fall);
    let sinh = 0.5 * (1.0 - fall * fall);
    let divisor = 2.0 * kolosov * cosh + (4.0 * x * x + 1.0 + kolosov * kolosov) * fall;
    [
        libm::tanh(x),
        (1.0 - poisson) * (2.0 * kolosov * sinh + 4.0 * x * fall) / divisor,
        (kolosov * (1.0 - 2.0 * poisson) * (cosh - fall) - 2.0 * x * x * fall) / divisor,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thick_layer_moves_as_a_half_space_under_a_point_force() {
        // Johnson, Contact Mechanics, 3.2.2 and 3.6, far from the taxel and near for the layer.
        let (young, poisson) = (0.4, 0.3);
        let shear = young / (2.0 * (1.0 + poisson));
        let kernel = LayerKernel::new(60.0, young, poisson, 0.5);
        let (x, y) = (3.0, -4.0);
        let r: f64 = 5.0;
        let unit = 1.0 / (2.0 * PI * shear);
        let found = kernel.at([x, y]);
        let expected = [
            [
                unit * ((1.0 - poisson) / r + poisson * x * x / r.powi(3)),
                unit * poisson * x * y / r.powi(3),
                -unit * (0.5 - poisson) * x / (r * r),
            ],
            [
                unit * poisson * x * y / r.powi(3),
                unit * ((1.0 - poisson) / r + poisson * y * y / r.powi(3)),
                -unit * (0.5 - poisson) * y / (r * r),
            ],
        ];
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            // The base, 60 mm below, takes up to 0.03 of the greatest.
            assert!(
                (found - expected).abs() < 0.1 * expected.abs() + 0.02 * unit / r,
                "{found} {expected}"
            );
        }
    }

    #[test]
    fn a_hardly_compressible_layer_is_pushed_outwards_and_what_is_far_away_rests() {
        let kernel = LayerKernel::new(4.25, 0.43, 0.49, 0.93);
        let [[shear, _, outwards], _] = kernel.at([3.0, 0.0]);
        assert!(shear > 0.0 && outwards > 0.0);
        assert_eq!(kernel.at([40.0, 0.0]), [[0.0; 3]; 2]);
        let [[far, _, _], _] = kernel.at([20.0, 0.0]);
        assert!(far.abs() < 0.05 * shear, "{far} {shear}");
    }
}
