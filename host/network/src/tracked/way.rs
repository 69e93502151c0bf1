//! The way along which a particle is looked for, given where the surface above it went. Pixels of the crop.
#![expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of the caller"
)]

use super::lanes::nearest;
use super::particles::Particle;
use crate::constants::CROP_SIDE;

/// The first and the last pixel on an axis that a particle's centre may go to.
const INSIDE: [i32; 2] = [2, CROP_SIDE as i32 - 3];

/// The places at which a particle is looked for when the surface above it moved: between none and the whole motion, a
/// little more, and a little to the sides.
pub(super) struct Way {
    /// Direction of the surface's motion.
    pub(super) along: [f32; 2],
    pub(super) length: f32,
    /// From here to there along it, whole pixels.
    pub(super) ends: [f32; 2],
    /// So far to both sides.
    pub(super) aside: f32,
}

impl Way {
    #[inline(always)]
    pub(super) fn new(surface_px: [f32; 2]) -> Self {
        let length = length(surface_px);
        Self {
            along: if length > 0.0 {
                [surface_px[0] / length, surface_px[1] / length]
            } else {
                [1.0, 0.0]
            },
            length,
            ends: [(-0.15 * length - 1.5).floor(), (1.15 * length + 1.5).ceil()],
            aside: (1.0 + 0.2 * length).min(4.0).floor(),
        }
    }

    /// The motion so far along and so far to the side.
    #[inline(always)]
    pub(super) fn place(&self, along: f32, across: f32) -> [i32; 2] {
        let [x, y] = self.along;
        [nearest(along * x - across * y), nearest(along * y + across * x)]
    }

    /// The smallest rectangle around the motions between two steps along it.
    #[inline(always)]
    pub(super) fn hull(&self, [from, to]: [f32; 2]) -> Motions {
        let [x, y] = self.along;
        let [mut first, mut last] = [[0; 2]; 2];
        for (k, (forth, sideways)) in [(x, y), (y, x)].into_iter().enumerate() {
            let (a, b) = (from * forth, to * forth);
            let aside = self.aside * sideways.abs();
            (first[k], last[k]) = (nearest(a.min(b) - aside), nearest(a.max(b) + aside));
        }
        Motions { first, last }
    }
}

/// Side of a square that holds eight steps along a way and nine to the sides, pixels: 7 and 8 whole steps are less than 11 on
/// an axis, and rounding adds one.
pub(super) const SQUARE: usize = 16;

/// A rectangle of whole-pixel motions, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Motions {
    pub(super) first: [i32; 2],
    pub(super) last: [i32; 2],
}

impl Motions {
    /// Those that leave a particle within the image.
    #[inline(always)]
    pub(super) fn inside(self, particle: &Particle) -> Self {
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

/// Root of the sum of squares, rounded once.
#[inline(always)]
pub(super) fn length([x, y]: [f32; 2]) -> f32 {
    let [x, y] = [f64::from(x), f64::from(y)];
    (x * x + y * y).sqrt() as f32
}
