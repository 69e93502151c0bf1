//! The pixels around a particle: what is known of them at rest, and the image now read at places between pixels.

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

impl Weights {
    /// Weighted square of differences, without their mean.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn residual(&self, off: &[[f32; 8]; PATCH]) -> f32 {
        let [mut error, mut square] = [[0.0; 8]; 2];
        for (weights, off) in self.of_pixel.iter().zip(off) {
            let mut weighted = [0.0; 8];
            for k in 0..8 {
                weighted[k] = weights[k] * off[k];
            }
            add(&mut error, weights, off);
            add(&mut square, &weighted, off);
        }
        let [error, square] = [sum(&error), sum(&square)];
        square - error * error / self.sum
    }
}

/// Slope in the middle of five pixels, from the outer four: exact for polynomials of the fourth degree.
fn slope(beside: [u8; 4]) -> f32 {
    let [far_below, below, above, far_above] = beside.map(f32::from);
    (8.0 * (above - below) - (far_above - far_below)) / 12.0
}

/// Weights of four pixels in a row for the place `t` from the second to the third: exact for polynomials of the third
/// degree. Fewer pixels, and splines through the same four, place a spot up to 0.03 pixels wrong between pixels.
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
pub(super) struct Patch<'a> {
    now: &'a Level<CROP_SIDE>,
    corner: [i32; 2],
    template: [[f32; 8]; PATCH],
    /// The whole pixel that the next was read at.
    whole: Option<[i32; 2]>,
    /// The image from one pixel left and above of the patch to two right and below.
    wide: [[f32; 16]; PATCH + 3],
    /// The image less the template.
    pub(super) off: [[f32; 8]; PATCH],
}

// Plain loops over whole arrays, each of one operation, become vectors; closures are compiled for another instruction set.
#[expect(
    clippy::inline_always,
    clippy::needless_range_loop,
    reason = "compiled for the instruction set of its caller, into vectors"
)]
impl<'a> Patch<'a> {
    #[inline(always)]
    pub(super) fn new(template: &Template, now: &'a Level<CROP_SIDE>, corner: [i32; 2]) -> Self {
        let mut pixels = [[0.0; 8]; PATCH];
        for row in 0..PATCH {
            for k in 0..8 {
                pixels[row][k] = f32::from(template.pixels[row][k]);
            }
        }
        Self {
            now,
            corner,
            template: pixels,
            whole: None,
            wide: [[0.0; 16]; PATCH + 3],
            off: [[0.0; 8]; PATCH],
        }
    }

    /// A motion of whole pixels: nothing to interpolate.
    #[inline(always)]
    pub(super) fn look_at_whole(&mut self, motion: [i32; 2]) {
        let rows = self
            .now
            .rows::<PATCH>(self.corner[0] + motion[0], self.corner[1] + motion[1]);
        for row in 0..PATCH {
            let now: &[u8; 8] = rows.at(row, 0);
            for k in 0..8 {
                self.off[row][k] = f32::from(now[k]) - self.template[row][k];
            }
        }
    }

    #[inline(always)]
    pub(super) fn look_at(&mut self, motion_px: [f32; 2]) {
        let whole = [motion_px[0].floor(), motion_px[1].floor()];
        let [fx, fy] = [motion_px[0] - whole[0], motion_px[1] - whole[1]];
        self.read([whole[0] as i32, whole[1] as i32]);
        let [across, down] = [between(fx), between(fy)];
        let mut lines = [[0.0; 8]; PATCH + 3];
        for row in 0..PATCH + 3 {
            let wide = &self.wide[row];
            for k in 0..8 {
                lines[row][k] = (across[0] * wide[k] + across[1] * wide[k + 1])
                    + (across[2] * wide[k + 2] + across[3] * wide[k + 3]);
            }
        }
        for row in 0..PATCH {
            for k in 0..8 {
                self.off[row][k] = (down[0] * lines[row][k] + down[1] * lines[row + 1][k])
                    + (down[2] * lines[row + 2][k] + down[3] * lines[row + 3][k])
                    - self.template[row][k];
            }
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
            let now: &[u8; 16] = rows.at(row, 0);
            for k in 0..16 {
                self.wide[row][k] = f32::from(now[k]);
            }
        }
    }
}

/// Sum of the products.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
pub(super) fn product(a: &[[f32; 8]; PATCH], b: &[[f32; 8]; PATCH]) -> f32 {
    let mut lanes = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        add(&mut lanes, a, b);
    }
    sum(&lanes)
}

/// Adds products lane by lane.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn add(sums: &mut [f32; 8], a: &[f32; 8], b: &[f32; 8]) {
    for k in 0..8 {
        sums[k] += a[k] * b[k];
    }
}

/// The lanes' sum, in pairs.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn sum(lanes: &[f32; 8]) -> f32 {
    let mut four = [0.0; 4];
    for k in 0..4 {
        four[k] = lanes[k] + lanes[k + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}
