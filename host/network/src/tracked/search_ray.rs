//! The ray along which a particle is searched, given the motion of the sensor surface above it. Pixels of the crop.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::simd::round;

use super::particles::Particle;
use crate::constants::CROP_SIDE;

/// A ray is long above this surface motion, pixels.
pub(super) const LONG: f32 = 4.0;
/// How far from where its depth suggests a particle is searched along a long ray, as a share of the surface's motion: a depth from
/// brightness is good to 0.8 mm of the layer's 6, three times that is 0.4. With shares of 0.3 to 0.6 the forces have about the same
/// errors, with no limit greater ones, because more particles are mistaken for others.
const DEPTH_REACH: f32 = 0.4;
/// First and last pixel of an axis that a particle's centre may move to.
const INSIDE: [i32; 2] = [2, CROP_SIDE as i32 - 3];

/// The motions to search for a particle: from none to the whole motion of the surface, a little more, and a little to the
/// sides.
#[derive(Debug, Clone, Copy)]
pub(super) struct SearchRay {
    /// Direction of the surface's motion.
    pub(super) along: [f32; 2],
    pub(super) length: f32,
    /// First and last step along the direction, whole pixels.
    pub(super) ends: [f32; 2],
    /// Steps to either side, whole pixels.
    pub(super) half_width: f32,
    /// The bounding box of all motions.
    pub(super) motions: MotionRect,
}

impl SearchRay {
    #[inline(always)]
    pub(super) fn new(surface_px: [f32; 2]) -> Self {
        let length = length(surface_px);
        let ray = Self {
            along: if length > 0.0 {
                [surface_px[0] / length, surface_px[1] / length]
            } else {
                [1.0, 0.0]
            },
            length,
            ends: [(-0.15 * length - 1.5).floor(), (1.15 * length + 1.5).ceil()],
            half_width: (1.0 + 0.1 * length).min(3.0).floor(),
            motions: MotionRect {
                first: [0; 2],
                last: [0; 2],
            },
        };
        Self {
            motions: ray.bounds(ray.ends),
            ..ray
        }
    }

    /// A long ray without what is far from the motion along it that a particle's depth suggests, pixels.
    #[inline(always)]
    pub(super) fn around(self, expected: f32) -> Self {
        if self.length <= LONG {
            return self;
        }
        let reach = DEPTH_REACH * self.length + 1.5;
        let [from, to] = self.ends;
        let ends = [
            from.max((expected - reach).floor()),
            to.min((expected + reach).ceil()),
        ];
        Self {
            motions: self.bounds(ends),
            ends,
            ..self
        }
    }

    /// The whole-pixel motion of a step along and across.
    #[inline(always)]
    pub(super) fn motion(&self, along: f32, across: f32) -> [i32; 2] {
        let [x, y] = self.along;
        [round(along * x - across * y), round(along * y + across * x)]
    }

    /// The bounding box of the motions of eight steps along, from this one on.
    #[inline(always)]
    pub(super) fn eight_steps(&self, step: f32) -> MotionRect {
        let [from, to] = self.ends;
        if step <= from && to <= from + 7.0 {
            self.motions
        } else {
            self.bounds([step, (step + 7.0).min(to)])
        }
    }

    /// The bounding box of the motions between two steps along.
    #[inline(always)]
    fn bounds(&self, [from, to]: [f32; 2]) -> MotionRect {
        let [x, y] = self.along;
        let [mut first, mut last] = [[0; 2]; 2];
        for (k, (forward, sideways)) in [(x, y), (y, x)].into_iter().enumerate() {
            let (a, b) = (from * forward, to * forward);
            let half_width = self.half_width * sideways.abs();
            (first[k], last[k]) = (round(a.min(b) - half_width), round(a.max(b) + half_width));
        }
        MotionRect { first, last }
    }
}

/// Side of a square that holds eight steps along a ray and nine across, pixels: 7 and 8 steps are less than 11 pixels on
/// an axis, and rounding adds one.
pub(super) const TABLE_SIDE: usize = 16;

/// A rectangle of whole-pixel motions, [x, y], both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MotionRect {
    pub(super) first: [i32; 2],
    pub(super) last: [i32; 2],
}

impl MotionRect {
    /// Those that keep a particle inside the image.
    #[inline(always)]
    pub(super) fn clipped(self, particle: &Particle) -> Self {
        let [mut first, mut last] = [self.first, self.last];
        for k in 0..2 {
            let at = i32::from(particle.pixel[k]);
            first[k] = first[k].max(INSIDE[0] - at);
            last[k] = last[k].min(INSIDE[1] - at);
        }
        Self { first, last }
    }

    #[inline(always)]
    pub(super) fn is_empty(&self) -> bool {
        self.first[0] > self.last[0] || self.first[1] > self.last[1]
    }
}

/// Euclidean length, rounded once.
#[inline(always)]
pub(super) fn length([x, y]: [f32; 2]) -> f32 {
    let [x, y] = [f64::from(x), f64::from(y)];
    (x * x + y * y).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_ray_reaches_as_far_as_the_error_of_a_depth_and_no_farther_than_without_it() {
        for length in [0.0, 3.75, 4.25, 10.0, 40.0_f32] {
            let ray = SearchRay::new([0.6 * length, 0.8 * length]);
            for percent in 0..=100_u8 {
                let expected = f32::from(percent) / 100.0 * length;
                let [from, to] = ray.around(expected).ends;
                assert!(
                    ray.ends[0] <= from && from <= expected && expected <= to && to <= ray.ends[1],
                    "{from} to {to} around {expected} of {length}"
                );
                let reaches = |end: f32, of_ray: f32| {
                    (end - expected).abs() >= 0.4 * length || end.to_bits() == of_ray.to_bits()
                };
                assert!(reaches(from, ray.ends[0]) && reaches(to, ray.ends[1]));
                assert!(length <= LONG || to - from <= 0.8 * length + 5.0);
            }
        }
    }
}
