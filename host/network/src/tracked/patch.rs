//! The pixels around a particle: the template from the rest image, and the image now sampled between pixels.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::simd::F32x8;

use super::level::Level;
use super::particles::Particle;
use crate::constants::CROP_SIDE;

/// Half of a particle's patch, pixels.
pub(super) const HALF: i32 = 3;
/// Side of the patch.
pub(super) const PATCH: usize = 7;
/// Sigma of the patch's weights, pixels: about a particle's radius with the lens's blur.
const PATCH_SIGMA: f32 = 1.6;
/// Smallest determinant of the structure tensor over its squared trace: less is an edge, not a spot.
const CORNERNESS_MIN: f32 = 0.02;

/// A particle's patch, ready for least squares. Rows are padded to eight pixels; the last has weight 0.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pub(super) pixels: [[u8; 8]; PATCH],
    /// Weighted x and y gradients without their mean, so that a change of brightness has no effect.
    pub(super) gradients: [[[f32; 8]; PATCH]; 2],
    /// Inverse structure tensor (the Gauss–Newton Hessian): xx, xy, yy.
    pub(super) inverse: [f32; 3],
    /// Weighted sum of squares of the patch without its mean.
    pub(super) contrast: f32,
}

/// Gaussian weights of a patch's pixels, and their sum.
#[derive(Debug, Clone)]
pub(super) struct PatchWeights {
    per_pixel: [[f32; 8]; PATCH],
    sum: f32,
}

impl PatchWeights {
    pub(super) fn new() -> Self {
        let per_pixel: [[f32; 8]; PATCH] = std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let [x, y] = [column as f32 - HALF as f32, row as f32 - HALF as f32];
                if column < PATCH {
                    (-(x * x + y * y) / (2.0 * PATCH_SIGMA * PATCH_SIGMA)).exp()
                } else {
                    0.0
                }
            })
        });
        Self {
            sum: per_pixel.as_flattened().iter().sum(),
            per_pixel,
        }
    }
}

/// Gradient in the middle of five pixels, from the outer four: exact for polynomials of the fourth degree.
fn gradient(beside: [u8; 4]) -> f32 {
    let [far_below, below, above, far_above] = beside.map(f32::from);
    (8.0 * (above - below) - (far_above - far_below)) / 12.0
}

/// Cubic (Lagrange) interpolation weights of four pixels for a place `t` between the second and the third. Bilinear
/// weights and splines through the same four pixels would shift a spot by up to 0.03 pixels.
#[inline]
fn cubic_weights(t: f32) -> [f32; 4] {
    let [before, after, far] = [t + 1.0, t - 1.0, t - 2.0];
    [
        -t * after * far / 6.0,
        before * after * far / 2.0,
        -before * t * far / 2.0,
        before * t * after / 6.0,
    ]
}

impl Template {
    /// `None` when the spot cannot be located in both directions.
    pub(super) fn new(image: &Level<CROP_SIDE>, particle: &Particle, weights: &PatchWeights) -> Option<Self> {
        let [x0, y0] = particle.corner();
        let pixels: [[u8; 8]; PATCH] = std::array::from_fn(|row| *image.run(x0, y0 + row as i32));
        let mut gradients = [[[0.0_f32; 8]; PATCH]; 2];
        let (mut mean, mut means) = (0.0, [0.0_f32; 2]);
        for row in 0..PATCH {
            let y = y0 + row as i32;
            let beside: &[u8; 12] = image.run(x0 - 2, y);
            let rows: [&[u8; 8]; 4] = [-2, -1, 1, 2].map(|down| image.run(x0, y + down));
            for column in 0..PATCH {
                gradients[0][row][column] = gradient([0, 1, 3, 4].map(|right| beside[column + right]));
                gradients[1][row][column] = gradient(rows.map(|row| row[column]));
                let weight = weights.per_pixel[row][column] / weights.sum;
                mean += weight * f32::from(pixels[row][column]);
                for k in 0..2 {
                    means[k] += weight * gradients[k][row][column];
                }
            }
        }
        let (mut xx, mut xy, mut yy, mut contrast) = (0.0, 0.0, 0.0, 0.0);
        for row in 0..PATCH {
            for column in 0..PATCH {
                let weight = weights.per_pixel[row][column];
                let [x, y] = [0, 1].map(|k| gradients[k][row][column] - means[k]);
                let level = f32::from(pixels[row][column]) - mean;
                xx += weight * x * x;
                xy += weight * x * y;
                yy += weight * y * y;
                contrast += weight * level * level;
                [gradients[0][row][column], gradients[1][row][column]] = [weight * x, weight * y];
            }
        }
        let determinant = xx * yy - xy * xy;
        (determinant > CORNERNESS_MIN * (xx + yy) * (xx + yy)).then(|| Self {
            pixels,
            gradients,
            inverse: [yy / determinant, -xy / determinant, xx / determinant],
            contrast,
        })
    }
}

/// The difference of a template and the image at a moved place.
pub(super) struct Patch<'a, L> {
    now: &'a Level<CROP_SIDE>,
    corner: [i32; 2],
    template: &'a [[u8; 8]; PATCH],
    /// Image minus template.
    difference: [L; PATCH],
}

#[expect(
    clippy::needless_range_loop,
    reason = "closures would compile for another instruction set"
)]
impl<'a, L: F32x8> Patch<'a, L> {
    #[inline(always)]
    pub(super) fn new(template: &'a Template, now: &'a Level<CROP_SIDE>, corner: [i32; 2]) -> Self {
        Self {
            now,
            corner,
            template: &template.pixels,
            difference: [L::splat(0.0); PATCH],
        }
    }

    /// Computes the difference at a whole-pixel motion.
    #[inline(always)]
    pub(super) fn sample_whole(&mut self, motion: [i32; 2]) {
        let rows = self
            .now
            .rows::<PATCH>(self.corner[0] + motion[0], self.corner[1] + motion[1]);
        for row in 0..PATCH {
            self.difference[row] = L::from_u8(*rows.at(row, 0)).subtract(L::from_u8(self.template[row]));
        }
    }

    /// Computes the difference at a motion, with cubic interpolation.
    #[inline(always)]
    pub(super) fn sample(&mut self, motion_px: [f32; 2]) {
        let whole = [motion_px[0].floor(), motion_px[1].floor()];
        let across = cubic_weights(motion_px[0] - whole[0]);
        let down = cubic_weights(motion_px[1] - whole[1]);
        // From one pixel left of the patch and above it to two right and below.
        let rows = self.now.rows::<{ PATCH + 3 }>(
            self.corner[0] + whole[0] as i32 - 1,
            self.corner[1] + whole[1] as i32 - 1,
        );
        let mut lines = [L::splat(0.0); PATCH + 3];
        for row in 0..PATCH + 3 {
            lines[row] = weighted_sum(
                across,
                [
                    L::from_u8(*rows.at(row, 0)),
                    L::from_u8(*rows.at(row, 1)),
                    L::from_u8(*rows.at(row, 2)),
                    L::from_u8(*rows.at(row, 3)),
                ],
            );
        }
        for row in 0..PATCH {
            let image = weighted_sum(down, [lines[row], lines[row + 1], lines[row + 2], lines[row + 3]]);
            self.difference[row] = image.subtract(L::from_u8(self.template[row]));
        }
    }

    /// Dot product with the difference.
    #[inline(always)]
    pub(super) fn dot(&self, with: &[[f32; 8]; PATCH]) -> f32 {
        let mut sums = L::splat(0.0);
        for row in 0..PATCH {
            sums = sums.add(L::load(&with[row]).multiply(self.difference[row]));
        }
        sums.sum()
    }

    /// Weighted sum of squares of the difference without its mean.
    #[inline(always)]
    pub(super) fn residual(&self, weights: &PatchWeights) -> f32 {
        let [mut error, mut square] = [L::splat(0.0); 2];
        for row in 0..PATCH {
            let weighted = L::load(&weights.per_pixel[row]).multiply(self.difference[row]);
            error = error.add(weighted);
            square = square.add(weighted.multiply(self.difference[row]));
        }
        let (error, square) = (error.sum(), square.sum());
        square - error * error / weights.sum
    }
}

/// Weighted sum of four, added in pairs.
#[inline(always)]
fn weighted_sum<L: F32x8>(weights: [f32; 4], of: [L; 4]) -> L {
    let [a, b, c, d] = of;
    let first = L::splat(weights[0])
        .multiply(a)
        .add(L::splat(weights[1]).multiply(b));
    let last = L::splat(weights[2])
        .multiply(c)
        .add(L::splat(weights[3]).multiply(d));
    first.add(last)
}
