//! The pixels around a particle: what is known of them at rest, and the image now read at places between pixels.

use super::lanes::Lanes;
use super::particles::Particle;
use super::pyramid::Level;
use crate::constants::CROP_SIDE;

/// Half of a particle's patch, pixels.
pub(super) const HALF: i32 = 3;
/// Side of the patch.
pub(super) const PATCH: usize = 7;
/// Sigma of the patch's weights, pixels: about a particle's radius with the lens's blur.
const PATCH_SIGMA: f32 = 1.6;
/// Least share of the smaller curvature in both, squared: less is an edge, not a spot.
const LEAST_CORNER: f32 = 0.02;

/// A particle's patch, ready for least squares. Rows have eight places for the sake of vectors; the last weighs nothing.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pub(super) pixels: [[u8; 8]; PATCH],
    /// Weighted slopes along x and y, without their mean: a change of the light around does not count.
    pub(super) slopes: [[[f32; 8]; PATCH]; 2],
    /// Inverse of the slopes' products: xx, xy, yy.
    pub(super) inverse: [f32; 3],
    /// Weighted square of the patch without its mean.
    pub(super) contrast: f32,
}

/// Weights of a patch's pixels, and their sum.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    of_pixel: [[f32; 8]; PATCH],
    sum: f32,
}

impl Weights {
    pub(super) fn new() -> Self {
        let of_pixel: [[f32; 8]; PATCH] = std::array::from_fn(|row| {
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
            sum: of_pixel.as_flattened().iter().sum(),
            of_pixel,
        }
    }
}

/// Slope in the middle of five pixels, from the outer four: exact for polynomials of the fourth degree.
fn slope(beside: [u8; 4]) -> f32 {
    let [far_below, below, above, far_above] = beside.map(f32::from);
    (8.0 * (above - below) - (far_above - far_below)) / 12.0
}

/// Weights of four pixels in a row for the place `t` from the second to the third: exact for polynomials of the third
/// degree. Fewer pixels, and splines through the same four, place a spot up to 0.03 pixels wrong between pixels.
#[inline]
fn between(t: f32) -> [f32; 4] {
    let [before, after, far] = [t + 1.0, t - 1.0, t - 2.0];
    [
        -t * after * far / 6.0,
        before * after * far / 2.0,
        -before * t * far / 2.0,
        before * t * after / 6.0,
    ]
}

impl Template {
    /// None when the spot cannot be placed in both directions.
    pub(super) fn new(image: &Level<CROP_SIDE>, particle: &Particle, weights: &Weights) -> Option<Self> {
        let [x0, y0] = particle.corner();
        let pixels: [[u8; 8]; PATCH] = std::array::from_fn(|row| *image.run(x0, y0 + row as i32));
        let mut slopes = [[[0.0_f32; 8]; PATCH]; 2];
        let (mut mean, mut means) = (0.0, [0.0_f32; 2]);
        for row in 0..PATCH {
            let y = y0 + row as i32;
            let beside: &[u8; 12] = image.run(x0 - 2, y);
            let rows: [&[u8; 8]; 4] = [-2, -1, 1, 2].map(|down| image.run(x0, y + down));
            for column in 0..PATCH {
                slopes[0][row][column] = slope([0, 1, 3, 4].map(|right| beside[column + right]));
                slopes[1][row][column] = slope(rows.map(|row| row[column]));
                let weight = weights.of_pixel[row][column] / weights.sum;
                mean += weight * f32::from(pixels[row][column]);
                for k in 0..2 {
                    means[k] += weight * slopes[k][row][column];
                }
            }
        }
        let (mut xx, mut xy, mut yy, mut contrast) = (0.0, 0.0, 0.0, 0.0);
        for row in 0..PATCH {
            for column in 0..PATCH {
                let weight = weights.of_pixel[row][column];
                let [x, y] = [0, 1].map(|k| slopes[k][row][column] - means[k]);
                let level = f32::from(pixels[row][column]) - mean;
                xx += weight * x * x;
                xy += weight * x * y;
                yy += weight * y * y;
                contrast += weight * level * level;
                [slopes[0][row][column], slopes[1][row][column]] = [weight * x, weight * y];
            }
        }
        let determinant = xx * yy - xy * xy;
        (determinant > LEAST_CORNER * (xx + yy) * (xx + yy)).then(|| Self {
            pixels,
            slopes,
            inverse: [yy / determinant, -xy / determinant, xx / determinant],
            contrast,
        })
    }
}

/// A template against the image at a place between pixels.
pub(super) struct Patch<'a, L> {
    now: &'a Level<CROP_SIDE>,
    corner: [i32; 2],
    template: &'a [[u8; 8]; PATCH],
    /// The whole pixel that the next was read at.
    whole: Option<[i32; 2]>,
    /// The image from one pixel left and above of the patch to two right and below.
    wide: [[f32; 16]; PATCH + 3],
    /// The image less the template.
    off: [L; PATCH],
}

#[expect(
    clippy::inline_always,
    clippy::needless_range_loop,
    reason = "compiled for the instruction set of its caller, into vectors; closures are compiled for another one"
)]
impl<'a, L: Lanes> Patch<'a, L> {
    #[inline(always)]
    pub(super) fn new(template: &'a Template, now: &'a Level<CROP_SIDE>, corner: [i32; 2]) -> Self {
        Self {
            now,
            corner,
            template: &template.pixels,
            whole: None,
            wide: [[0.0; 16]; PATCH + 3],
            off: [L::splat(0.0); PATCH],
        }
    }

    /// A motion of whole pixels: nothing to interpolate.
    #[inline(always)]
    pub(super) fn look_at_whole(&mut self, motion: [i32; 2]) {
        let rows = self
            .now
            .rows::<PATCH>(self.corner[0] + motion[0], self.corner[1] + motion[1]);
        for row in 0..PATCH {
            self.off[row] = L::grey(*rows.at(row, 0)).minus(L::grey(self.template[row]));
        }
    }

    /// A motion to a part of a pixel.
    #[inline(always)]
    pub(super) fn look_at(&mut self, motion_px: [f32; 2]) {
        let whole = [motion_px[0].floor(), motion_px[1].floor()];
        let across = between(motion_px[0] - whole[0]);
        let down = between(motion_px[1] - whole[1]);
        self.read([whole[0] as i32, whole[1] as i32]);
        let mut lines = [L::splat(0.0); PATCH + 3];
        for row in 0..PATCH + 3 {
            let wide = &self.wide[row];
            lines[row] = combined(
                across,
                [eight(wide, 0), eight(wide, 1), eight(wide, 2), eight(wide, 3)],
            );
        }
        for row in 0..PATCH {
            let image = combined(down, [lines[row], lines[row + 1], lines[row + 2], lines[row + 3]]);
            self.off[row] = image.minus(L::grey(self.template[row]));
        }
    }

    #[inline(always)]
    fn read(&mut self, whole: [i32; 2]) {
        if self.whole == Some(whole) {
            return;
        }
        self.whole = Some(whole);
        let rows = self
            .now
            .rows::<{ PATCH + 3 }>(self.corner[0] + whole[0] - 1, self.corner[1] + whole[1] - 1);
        for row in 0..PATCH + 3 {
            let halves = self.wide[row].as_chunks_mut::<8>().0;
            for half in 0..2 {
                L::grey(*rows.at(row, 8 * half)).store(&mut halves[half]);
            }
        }
    }

    /// Sum of the products with the difference of image and template.
    #[inline(always)]
    pub(super) fn product(&self, with: &[[f32; 8]; PATCH]) -> f32 {
        let mut sums = L::splat(0.0);
        for row in 0..PATCH {
            sums = sums.plus(L::load(&with[row]).times(self.off[row]));
        }
        sums.sum()
    }

    /// Weighted square of the differences, without their mean.
    #[inline(always)]
    pub(super) fn residual(&self, weights: &Weights) -> f32 {
        let [mut error, mut square] = [L::splat(0.0); 2];
        for row in 0..PATCH {
            let weighted = L::load(&weights.of_pixel[row]).times(self.off[row]);
            error = error.plus(weighted);
            square = square.plus(weighted.times(self.off[row]));
        }
        let (error, square) = (error.sum(), square.sum());
        square - error * error / weights.sum
    }
}

/// The sum of four, weighted, in pairs.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn combined<L: Lanes>(weights: [f32; 4], of: [L; 4]) -> L {
    let [a, b, c, d] = of;
    let first = L::splat(weights[0]).times(a).plus(L::splat(weights[1]).times(b));
    let last = L::splat(weights[2]).times(c).plus(L::splat(weights[3]).times(d));
    first.plus(last)
}

/// Eight of a row from a place on.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn eight<L: Lanes>(row: &[f32; 16], first: usize) -> L {
    L::load(row[first..].first_chunk().expect("within the row"))
}
