//! Where a particle went if the surface above it moved like this: the best whole pixel along that way for its depth, then
//! least squares between pixels. What of it follows from parts of the image that did not change is kept.

use super::changed::{Changed, Tiles, same};
use super::compare::Compare;
use super::lanes::{Lanes, TABLE, Table};
use super::particles::Particle;
use super::patch::{HALF, Patch, Template, Weights};
use super::pyramid::Level;
use super::way::{Motions, SQUARE, Way};
use crate::constants::CROP_SIDE;

/// Most Gauss–Newton steps, and the step that is small enough, pixels.
const STEPS: usize = 5;
const SMALL_STEP: f32 = 0.01;
/// Farthest that least squares may go from the whole pixel it started at.
const FARTHEST_STEP: f32 = 2.0;
/// Cost of a pixel off the expected place along the way and, squared, across it; sums of absolute grey levels.
const PRIOR: [f32; 2] = [10.0, 10.0];
/// Share of its contrast that a patch must explain: at rest or nearly, and on a long way, where others look alike.
const LEAST_CONFIDENCE: [f32; 2] = [0.6, 0.85];
/// From this motion of the surface on a way is long, pixels.
const LONG: f32 = 4.0;
/// Thickness of the skin's soft part, mm: the base does not move.
const THICKNESS_MM: f32 = 6.0;

/// Where a particle went.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Motion since rest, pixels.
    pub motion_px: [f32; 2],
    /// Share of the patch's contrast that the match explains; 0 for the lost and the doubtful.
    pub confidence: f32,
}

/// A search's result, the motion of the surface that it was made for, and the tiles that its two parts looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    surface_px: [f32; 2],
    tiles: Tiles,
    start: Option<Start>,
    refined_tiles: Tiles,
    pub(super) track: Track,
}

/// The best whole pixel, and whether the way there is [`LONG`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Start {
    motion: [i32; 2],
    long: bool,
}

impl Found {
    /// Nothing is known of this particle.
    pub(super) fn nothing() -> Self {
        Self {
            surface_px: [f32::NAN; 2],
            tiles: Tiles::ALL,
            start: None,
            refined_tiles: Tiles::ALL,
            track: Track::default(),
        }
    }

    /// Has the next search begin anew.
    pub(super) fn forget(&mut self) {
        self.surface_px = [f32::NAN; 2];
        self.refined_tiles = Tiles::ALL;
    }

    /// The tiles that it looked at.
    pub(super) fn seen(&self) -> Tiles {
        self.tiles.hull(self.refined_tiles)
    }
}

/// Pixels that least squares can read beyond the patch at the whole pixel where it starts: two steps, and two for the
/// parts of a pixel.
const REFINED_PX: i32 = 4;

/// Where a patch of the particle can be read when it moves by something between these two.
#[inline]
fn patch_tiles(particle: &Particle, least: [i32; 2], most: [i32; 2]) -> Tiles {
    let at = particle.pixel.map(i32::from);
    // The eighth place of a patch's rows is read too.
    Tiles::between(
        [0, 1].map(|k| at[k] + least[k] - HALF),
        [0, 1].map(|k| at[k] + most[k] + HALF + 1),
    )
}

/// Looks for patches in an image.
pub(super) struct Search<'a> {
    pub(super) weights: &'a Weights,
    pub(super) now: &'a Level<CROP_SIDE>,
}

impl Search<'_> {
    /// Brings a search up to date: where the particle went if the surface above it moved by `surface_px`, about. Each of
    /// its two parts is done again only if what it was made from changed.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn update<C: Compare>(
        &self,
        found: &mut Found,
        template: &Template,
        particle: &Particle,
        surface_px: [f32; 2],
        changed: &Changed,
    ) {
        let moved = !same(surface_px, found.surface_px);
        let mut start = found.start;
        if moved || changed.any(found.tiles) {
            let way = Way::new(surface_px);
            if moved {
                found.surface_px = surface_px;
                let Motions { first, last } = way.hull(way.ends);
                found.tiles = patch_tiles(particle, first, last);
            }
            let motion = self.whole_pixel::<C>(template, particle, &way);
            start = motion.map(|motion| Start {
                motion,
                long: way.length > LONG,
            });
        }
        if start == found.start && !changed.any(found.refined_tiles) {
            return;
        }
        found.start = start;
        let motion = start.map_or([0; 2], |start| start.motion);
        found.refined_tiles = patch_tiles(
            particle,
            motion.map(|v| v - REFINED_PX),
            motion.map(|v| v + REFINED_PX),
        );
        // A closure would be compiled for another instruction set.
        found.track = match start {
            Some(start) => self.refine::<C>(template, particle, start),
            None => Track::default(),
        };
    }

    /// The whole-pixel motion with the least difference: anywhere between none and the surface's motion, and a little
    /// to the sides, rather where the particle's depth suggests. Of equal ones the first along the way, then across.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn whole_pixel<C: Compare>(
        &self,
        template: &Template,
        particle: &Particle,
        way: &Way,
    ) -> Option<[i32; 2]> {
        let (x, y) = (C::Lanes::splat(way.along[0]), C::Lanes::splat(way.along[1]));
        let [from, to] = way.ends;
        let expected = C::Lanes::splat(share(particle.depth_mm) * way.length);
        let never = C::Lanes::splat(f32::INFINITY);
        let mut differences = [0; TABLE + 2];
        // Each lane has the best of every eighth step along the way.
        let (mut least, mut best_along, mut best_across) = (never, never, never);
        let mut step = from;
        while step <= to {
            let hull = way.hull([step, (step + 7.0).min(to)]);
            let within = hull.inside(particle);
            let along = C::Lanes::splat(step).plus(C::Lanes::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]));
            step += 8.0;
            if within.is_empty() {
                continue;
            }
            self.differences::<C>(template, particle, &within, &mut differences);
            let off_along = C::Lanes::splat(PRIOR[0]).times(along.minus(expected).abs());
            let off_along = C::Lanes::splat(to).where_less(along, never, off_along);
            let (left, top) = (
                C::Lanes::splat(within.first[0] as f32),
                C::Lanes::splat(within.first[1] as f32),
            );
            let (right, bottom) = (
                C::Lanes::splat(within.last[0] as f32),
                C::Lanes::splat(within.last[1] as f32),
            );
            let mut aside = -way.aside;
            while aside <= way.aside {
                let across = C::Lanes::splat(aside);
                let dx = along.times(x).minus(across.times(y)).nearest();
                let dy = along.times(y).plus(across.times(x)).nearest();
                let row = dy.minus(top).times(C::Lanes::splat(SQUARE as f32));
                let difference = row.plus(dx.minus(left)).look_up(&differences);
                let mut cost = difference
                    .plus(off_along)
                    .plus(C::Lanes::splat(PRIOR[1] * aside * aside));
                if within != hull {
                    cost = dx.where_less(left, never, cost);
                    cost = dy.where_less(top, never, cost);
                    cost = right.where_less(dx, never, cost);
                    cost = bottom.where_less(dy, never, cost);
                }
                best_along = cost.where_less(least, along, best_along);
                best_across = cost.where_less(least, across, best_across);
                least = cost.where_less(least, cost, least);
                aside += 1.0;
            }
        }
        let [mut cost, mut along, mut across] = [[0.0; 8]; 3];
        least.store(&mut cost);
        best_along.store(&mut along);
        best_across.store(&mut across);
        let mut best = 0;
        for k in 1..8 {
            if (cost[k], along[k]) < (cost[best], along[best]) {
                best = k;
            }
        }
        (cost[best] < f32::INFINITY).then(|| way.place(along[best], across[best]))
    }

    /// The differences at these motions, in rows of [`SQUARE`].
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn differences<C: Compare>(
        &self,
        template: &Template,
        particle: &Particle,
        at: &Motions,
        out: &mut Table,
    ) {
        let [x0, y0] = particle.corner();
        let rows = out.as_chunks_mut::<SQUARE>().0;
        for (row, dy) in rows.iter_mut().zip(at.first[1]..=at.last[1]) {
            let eights = row.as_chunks_mut::<8>().0;
            for (eight, dx) in eights.iter_mut().zip((at.first[0]..=at.last[0]).step_by(8)) {
                *eight = C::eight(&template.pixels, &self.now.rows(x0 + dx, y0 + dy));
            }
        }
    }

    /// Least squares from a whole pixel on: inverse compositional, the image interpolated by cubic polynomials.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    fn refine<C: Compare>(&self, template: &Template, particle: &Particle, start: Start) -> Track {
        let mut patch = Patch::<C::Lanes>::new(template, self.now, particle.corner());
        let start_px = [start.motion[0] as f32, start.motion[1] as f32];
        let mut at = start_px;
        let mut residual = f32::INFINITY;
        for round in 0..=STEPS {
            if round == 0 {
                patch.look_at_whole(start.motion);
            } else {
                patch.look_at(at);
            }
            let [xx, xy, yy] = template.inverse;
            let along_x = patch.product(&template.slopes[0]);
            let along_y = patch.product(&template.slopes[1]);
            let step = [xx * along_x + xy * along_y, xy * along_x + yy * along_y];
            let done = step[0].abs() < SMALL_STEP && step[1].abs() < SMALL_STEP;
            if done || round == STEPS {
                residual = patch.residual(self.weights);
            }
            if done {
                break;
            }
            at = [at[0] - step[0], at[1] - step[1]];
            // Written so that NaN ends here too.
            let near =
                (at[0] - start_px[0]).abs() < FARTHEST_STEP && (at[1] - start_px[1]).abs() < FARTHEST_STEP;
            if !near {
                return Track::default();
            }
        }
        let confidence = 1.0 - residual / template.contrast;
        let least = LEAST_CONFIDENCE[usize::from(start.long)];
        Track {
            motion_px: at,
            confidence: if confidence > least { confidence } else { 0.0 },
        }
    }
}

/// Share of the surface's motion that a particle at this depth takes part in: a line to the base.
pub(super) fn share(depth_mm: f32) -> f32 {
    1.0 - depth_mm / THICKNESS_MM
}

#[cfg(test)]
#[expect(
    unsafe_code,
    reason = "functions for an instruction set, called where there is one"
)]
mod tests {
    use super::super::compare::{Plain, difference};
    use super::super::particles;
    use super::super::pyramid::Pyramid;
    use super::*;

    /// One place after the other, as it is meant.
    fn one_by_one(search: &Search, template: &Template, particle: &Particle, way: &Way) -> Option<[i32; 2]> {
        let expected = share(particle.depth_mm) * way.length;
        let [x0, y0] = particle.corner();
        let mut best = (f32::INFINITY, None);
        let mut along = way.ends[0];
        while along <= way.ends[1] {
            let mut across = -way.aside;
            while across <= way.aside {
                let motion = way.place(along, across);
                let at = [0, 1].map(|k| i32::from(particle.pixel[k]) + motion[k]);
                if at.iter().all(|at| (2..CROP_SIDE as i32 - 2).contains(at)) {
                    let rows = search.now.rows(x0 + motion[0], y0 + motion[1]);
                    let cost = difference(&template.pixels, &rows) as f32
                        + PRIOR[0] * (along - expected).abs()
                        + PRIOR[1] * across * across;
                    if cost < best.0 {
                        best = (cost, Some(motion));
                    }
                }
                across += 1.0;
            }
            along += 1.0;
        }
        best.1
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn by_avx2(search: &Search, template: &Template, particle: &Particle, way: &Way) -> Option<[i32; 2]> {
        search.whole_pixel::<super::super::compare::Avx2>(template, particle, way)
    }

    /// Spots in a row and a column apart, each like many others: there are equal ones to choose from.
    fn spots(apart: usize) -> Pyramid {
        let picture: Vec<u8> = (0..CROP_SIDE * CROP_SIDE)
            .map(|at| {
                let [x, y] = [at % CROP_SIDE, at / CROP_SIDE].map(|at| at % apart);
                if x.abs_diff(4) + y.abs_diff(4) < 2 {
                    200
                } else {
                    40 + (x / 7) as u8
                }
            })
            .collect();
        let mut pyramid = Pyramid::new();
        pyramid.take(&picture, &Changed::everything());
        pyramid
    }

    #[test]
    fn many_places_at_once_find_what_one_after_the_other_do() {
        let weights = Weights::new();
        let rest = spots(11);
        let particles = particles::find(&rest.full);
        let (mut found, mut far) = (0, 0);
        for (apart, (length, turn)) in [0.0, 0.6, 3.0, 4.5, 9.0, 40.0, 130.0]
            .into_iter()
            .flat_map(|length| (0..12).map(move |turn| (length, turn)))
            .enumerate()
        {
            let now = spots(9 + apart % 5);
            let search = Search {
                weights: &weights,
                now: &now.full,
            };
            let angle = turn as f32 * std::f32::consts::PI / 6.0;
            let way = Way::new([length * angle.cos(), length * angle.sin()]);
            for particle in particles.iter().skip(apart).step_by(61) {
                let template = Template::new(&rest.full, particle, &weights).expect("a spot");
                let expected = one_by_one(&search, &template, particle, &way);
                assert_eq!(search.whole_pixel::<Plain>(&template, particle, &way), expected);
                #[cfg(target_arch = "x86_64")]
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has it.
                    assert_eq!(unsafe { by_avx2(&search, &template, particle, &way) }, expected);
                }
                found += usize::from(expected.is_some());
                far += usize::from(expected.is_some_and(|[x, y]| x.abs().max(y.abs()) > 20));
            }
        }
        assert!(found > 1_000 && far > 50, "{found} found, {far} of them far");
    }
}
