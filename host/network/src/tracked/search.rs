//! Template matching of one particle, given the motion of the sensor surface above it: the best whole-pixel motion along
//! the search ray, then Lucas–Kanade refinement between pixels. Results are kept while the pixels they depend on are clean.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::simd::{F32x8, Simd, TABLE, Table, round};

use super::dirty_tiles::{DirtyTiles, TileRect};
use super::level::Level;
use super::particles::Particle;
use super::patch::{HALF, PATCH, Patch, PatchWeights, Template};
use super::search_ray::{LONG, MotionRect, SearchRay, TABLE_SIDE};
use crate::constants::CROP_SIDE;

/// Largest surface motion with which no place is searched, pixels: a particle is then so near to where its depth suggests that the
/// refinement finds it from there.
const UNSEARCHED_MAX: f32 = 1.0;
/// Largest number of Gauss–Newton steps, and the step that is the last one, pixels: each leaves a small share of itself.
const STEPS_MAX: usize = 5;
const LAST_STEP: f32 = 0.1;
/// Steps a pixel of the surface motion that a search is given. A finer motion finds the same places, but differs with every change
/// of the flow, so that what did not change would be searched again.
const SURFACE_STEPS: f32 = 4.0;
/// Largest distance of the refined motion from its whole-pixel start, pixels.
const REFINEMENT_MAX: f32 = 2.0;
/// Cost per pixel off the expected motion along the ray, and per squared pixel across it, in SAD grey levels.
const PRIOR: [f32; 2] = [10.0, 10.0];
/// Smallest accepted confidence: for short rays, and for long ones, where other particles look alike.
const CONFIDENCE_MIN: [f32; 2] = [0.6, 0.85];
/// Thickness of the elastic layer, mm: its base does not move.
const THICKNESS_MM: f32 = 6.0;

/// The motion of a particle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Track {
    /// Motion since rest, pixels.
    pub motion_px: [f32; 2],
    /// Share of the patch's contrast that the match explains; 0 if the particle is lost or doubtful.
    pub confidence: f32,
}

/// The motion of the surface that a search is given, [`SURFACE_STEPS`] a pixel.
type Surface = [i32; 2];

/// The match of a particle, and what it depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    /// What the search was given; none before the first one.
    surface: Option<Surface>,
    /// Tiles that the whole-pixel search read.
    search_tiles: TileRect,
    start: Option<Start>,
    /// Tiles that the refinement read.
    refined_tiles: TileRect,
    pub(super) track: Track,
}

/// The best whole-pixel motion, and whether its ray is [`LONG`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Start {
    motion: [i32; 2],
    long: bool,
}

impl Match {
    /// Not searched yet.
    pub(super) fn none() -> Self {
        Self {
            surface: None,
            search_tiles: TileRect::ALL,
            start: None,
            refined_tiles: TileRect::ALL,
            track: Track::default(),
        }
    }

    /// Whether it was searched since it was made or made to start over.
    pub(super) fn is_searched(&self) -> bool {
        self.surface.is_some()
    }

    /// Makes the next search start over.
    pub(super) fn invalidate(&mut self) {
        self.surface = None;
        self.refined_tiles = TileRect::ALL;
    }

    /// All tiles that the match depends on.
    pub(super) fn tiles(&self) -> TileRect {
        self.search_tiles.union(self.refined_tiles)
    }
}

/// How far the refinement can read beyond the patch at its start, pixels: [`REFINEMENT_MAX`], and two for interpolation.
const REFINED_PX: i32 = 4;

/// The tiles that a patch can read for motions between `min` and `max`.
#[inline]
fn patch_tiles(particle: &Particle, min: [i32; 2], max: [i32; 2]) -> TileRect {
    let at = particle.pixel.map(i32::from);
    // Rows are padded to eight pixels.
    TileRect::of_pixels(
        [0, 1].map(|k| at[k] + min[k] - HALF),
        [0, 1].map(|k| at[k] + max[k] + HALF + 1),
    )
}

/// Matches templates in the image now.
pub(super) struct Search<'a> {
    weights: &'a PatchWeights,
    now: &'a Level<CROP_SIDE>,
    /// The last surface motion and its ray: neighbours often share them.
    surface: Surface,
    ray: SearchRay,
}

impl<'a> Search<'a> {
    #[inline]
    pub(super) fn new(weights: &'a PatchWeights, now: &'a Level<CROP_SIDE>) -> Self {
        Self {
            weights,
            now,
            surface: [0; 2],
            ray: SearchRay::new([0.0; 2]),
        }
    }

    /// Updates the match of a particle, given about how far the surface above it moved. Repeats each of the two parts only
    /// if its inputs changed. Returns whether the track or the tiles that it depends on can have changed.
    #[inline(always)]
    pub(super) fn update<S: Simd>(
        &mut self,
        matched: &mut Match,
        template: &Template,
        particle: &Particle,
        surface_px: [f32; 2],
        dirty: &DirtyTiles,
    ) -> bool {
        let search_tiles = matched.search_tiles;
        let surface = surface_px.map(|v| round(SURFACE_STEPS * v));
        let moved = matched.surface != Some(surface);
        let mut start = matched.start;
        if moved || dirty.any_in(matched.search_tiles) {
            if surface != self.surface {
                self.surface = surface;
                self.ray = SearchRay::new(surface.map(|steps| steps as f32 / SURFACE_STEPS));
            }
            let expected = motion_ratio(particle.depth_mm) * self.ray.length;
            matched.surface = Some(surface);
            let motion = if self.ray.length <= UNSEARCHED_MAX {
                let motion = self.ray.motion(expected, 0.0);
                matched.search_tiles = patch_tiles(particle, motion, motion);
                Some(motion)
            } else {
                let ray = &self.ray.around(expected);
                matched.search_tiles = patch_tiles(particle, ray.motions.first, ray.motions.last);
                self.whole_pixel::<S>(template, particle, ray)
            };
            start = motion.map(|motion| Start {
                motion,
                long: self.ray.length > LONG,
            });
        }
        if start == matched.start && !dirty.any_in(matched.refined_tiles) {
            return matched.search_tiles != search_tiles;
        }
        matched.start = start;
        let motion = start.map_or([0; 2], |start| start.motion);
        matched.refined_tiles = patch_tiles(
            particle,
            motion.map(|v| v - REFINED_PX),
            motion.map(|v| v + REFINED_PX),
        );
        // A closure would compile for another instruction set.
        matched.track = match start {
            Some(start) => self.refine::<S>(template, particle, start),
            None => Track::default(),
        };
        true
    }

    /// The whole-pixel motion with the smallest cost: its SAD plus its distance from the motion that the particle's depth
    /// suggests. Of equal ones, the first along the ray, then across.
    #[inline(always)]
    fn whole_pixel<S: Simd>(
        &self,
        template: &Template,
        particle: &Particle,
        ray: &SearchRay,
    ) -> Option<[i32; 2]> {
        let (x, y) = (S::F32x8::splat(ray.along[0]), S::F32x8::splat(ray.along[1]));
        let [from, to] = ray.ends;
        let expected = S::F32x8::splat(motion_ratio(particle.depth_mm) * ray.length);
        let never = S::F32x8::splat(f32::INFINITY);
        let mut sads = [0; TABLE + 2];
        // Each lane holds the best of every eighth step along the ray.
        let (mut min_cost, mut best_along, mut best_across) = (never, never, never);
        let mut step = from;
        while step <= to {
            let bounds = ray.eight_steps(step);
            let within = bounds.clipped(particle);
            let along = S::F32x8::splat(step).add(S::F32x8::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]));
            step += 8.0;
            if within.is_empty() {
                continue;
            }
            self.sad_table::<S>(template, particle, &within, &mut sads);
            let along_cost = S::F32x8::splat(PRIOR[0]).multiply(along.subtract(expected).abs());
            let along_cost = S::F32x8::splat(to).select_less(along, never, along_cost);
            let (left, top) = (
                S::F32x8::splat(within.first[0] as f32),
                S::F32x8::splat(within.first[1] as f32),
            );
            let (right, bottom) = (
                S::F32x8::splat(within.last[0] as f32),
                S::F32x8::splat(within.last[1] as f32),
            );
            let mut offset = -ray.half_width;
            while offset <= ray.half_width {
                let across = S::F32x8::splat(offset);
                let dx = along.multiply(x).subtract(across.multiply(y)).round();
                let dy = along.multiply(y).add(across.multiply(x)).round();
                let row = dy.subtract(top).multiply(S::F32x8::splat(TABLE_SIDE as f32));
                let sad = row.add(dx.subtract(left)).gather(&sads);
                let mut cost = sad
                    .add(along_cost)
                    .add(S::F32x8::splat(PRIOR[1] * offset * offset));
                if within != bounds {
                    cost = dx.select_less(left, never, cost);
                    cost = dy.select_less(top, never, cost);
                    cost = right.select_less(dx, never, cost);
                    cost = bottom.select_less(dy, never, cost);
                }
                best_along = cost.select_less(min_cost, along, best_along);
                best_across = cost.select_less(min_cost, across, best_across);
                min_cost = cost.select_less(min_cost, cost, min_cost);
                offset += 1.0;
            }
        }
        let least = min_cost.min();
        // Of the lanes with that cost, the first along the ray; no two are as far along it.
        let first_along = S::F32x8::splat(least).select_less(min_cost, never, best_along);
        let along = first_along.min();
        let across = S::F32x8::splat(along).select_less(first_along, never, best_across);
        (least < f32::INFINITY).then(|| ray.motion(along, across.min()))
    }

    /// The SADs at these motions, in rows of [`TABLE_SIDE`].
    #[inline(always)]
    fn sad_table<S: Simd>(&self, template: &Template, particle: &Particle, at: &MotionRect, out: &mut Table) {
        let [x0, y0] = particle.corner();
        let rows = out.as_chunks_mut::<TABLE_SIDE>().0;
        for (row, dy) in rows.iter_mut().zip(at.first[1]..=at.last[1]) {
            let eights = row.as_chunks_mut::<8>().0;
            for (eight, dx) in eights.iter_mut().zip((at.first[0]..=at.last[0]).step_by(8)) {
                let pixels = self.now.rows::<PATCH>(x0 + dx, y0 + dy).pixels();
                *eight = S::sad_x8(&template.pixels, pixels, Level::<CROP_SIDE>::STRIDE);
            }
        }
    }

    /// Refines a whole-pixel motion: inverse compositional Lucas–Kanade (Gauss–Newton), cubic interpolation.
    #[inline(always)]
    fn refine<S: Simd>(&self, template: &Template, particle: &Particle, start: Start) -> Track {
        let mut patch = Patch::<S::F32x8>::new(template, self.now, particle.corner());
        let start_px = [start.motion[0] as f32, start.motion[1] as f32];
        let mut at = start_px;
        let mut residual = f32::INFINITY;
        for step_count in 0..=STEPS_MAX {
            if step_count == 0 {
                patch.sample_whole(start.motion);
            } else {
                patch.sample(at);
            }
            let [xx, xy, yy] = template.inverse;
            let along_x = patch.dot(&template.gradients[0]);
            let along_y = patch.dot(&template.gradients[1]);
            let step = [xx * along_x + xy * along_y, xy * along_x + yy * along_y];
            let done = step[0].abs() < LAST_STEP && step[1].abs() < LAST_STEP;
            if done || step_count == STEPS_MAX {
                residual = patch.residual(self.weights);
            }
            at = [at[0] - step[0], at[1] - step[1]];
            if done {
                break;
            }
            // Written so that NaN ends here, too.
            let near =
                (at[0] - start_px[0]).abs() < REFINEMENT_MAX && (at[1] - start_px[1]).abs() < REFINEMENT_MAX;
            if !near {
                return Track::default();
            }
        }
        let confidence = 1.0 - residual / template.contrast;
        let min = CONFIDENCE_MIN[usize::from(start.long)];
        Track {
            motion_px: at,
            confidence: if confidence > min { confidence } else { 0.0 },
        }
    }
}

/// Motion of a particle at this depth relative to the surface's: falls linearly to 0 at the base.
pub(super) fn motion_ratio(depth_mm: f32) -> f32 {
    1.0 - depth_mm / THICKNESS_MM
}

#[cfg(test)]
mod tests {
    use super::super::block_matching::sad;
    use super::super::particles;
    use super::super::pyramid::Pyramid;
    use super::super::search_ray::length;
    use super::*;
    use gripline_kernels::InstructionSet;
    use gripline_kernels::simd::{Dispatch, dispatch_256};

    /// The definition: one motion after the other.
    fn one_by_one(
        search: &Search,
        template: &Template,
        particle: &Particle,
        ray: &SearchRay,
    ) -> Option<[i32; 2]> {
        let expected = motion_ratio(particle.depth_mm) * ray.length;
        let [x0, y0] = particle.corner();
        let mut best = (f32::INFINITY, None);
        let mut along = ray.ends[0];
        while along <= ray.ends[1] {
            let mut across = -ray.half_width;
            while across <= ray.half_width {
                let motion = ray.motion(along, across);
                let at = [0, 1].map(|k| i32::from(particle.pixel[k]) + motion[k]);
                if at.iter().all(|at| (2..CROP_SIDE as i32 - 2).contains(at)) {
                    let rows = search.now.rows(x0 + motion[0], y0 + motion[1]);
                    let cost = sad(template.pixels.each_ref(), &rows) as f32
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

    struct WholePixel<'a>(&'a Search<'a>, &'a Template, &'a Particle, &'a SearchRay);

    impl Dispatch for WholePixel<'_> {
        type Output = Option<[i32; 2]>;

        #[inline(always)]
        fn run<S: Simd>(self) -> Option<[i32; 2]> {
            let Self(search, template, particle, ray) = self;
            search.whole_pixel::<S>(template, particle, ray)
        }
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
        pyramid.update(&picture, &DirtyTiles::all());
        pyramid
    }

    /// Spots of a Gaussian shape, moved by this much, on a ground that gets brighter.
    fn moved_spots(by_px: [f32; 2]) -> Pyramid {
        let apart = 17;
        let picture: Vec<u8> = (0..CROP_SIDE * CROP_SIDE)
            .map(|at| {
                let place = [at % CROP_SIDE, at / CROP_SIDE];
                let [x, y] = [0, 1].map(|k| {
                    let from_first = place[k] as f32 - 8.3 - by_px[k];
                    from_first - (from_first / apart as f32).round() * apart as f32
                });
                let ground = 30.0 + 0.02 * place[0] as f32;
                (ground + 140.0 * (-(x * x + y * y) / (2.0 * 1.3 * 1.3)).exp()).round() as u8
            })
            .collect();
        let mut pyramid = Pyramid::new();
        pyramid.update(&picture, &DirtyTiles::all());
        pyramid
    }

    #[test]
    fn a_particle_below_a_surface_that_moved_little_is_found_without_a_search_and_to_a_fiftieth_of_a_pixel() {
        struct Update<'a>(&'a mut Search<'a>, &'a Template, &'a Particle, [f32; 2]);

        impl Dispatch for Update<'_> {
            type Output = Match;

            #[inline(always)]
            fn run<S: Simd>(self) -> Match {
                let Self(search, template, particle, surface_px) = self;
                let mut matched = Match::none();
                search.update::<S>(&mut matched, template, particle, surface_px, &DirtyTiles::all());
                matched
            }
        }

        let weights = PatchWeights::new();
        let rest = moved_spots([0.0; 2]);
        let particles = particles::detect(&rest.full);
        let mut found = 0;
        for turn in 0..16_u8 {
            // The farther from where its depth suggests the particle is, the farther the refinement has to go.
            for (surface, moved) in [(0.0, 0.3), (0.5, 0.0), (0.8, 0.8), (0.8, 1.4), (0.8, -0.4)] {
                let (y, x) = (f32::from(turn) * std::f32::consts::PI / 8.0).sin_cos();
                let now = moved_spots([moved * x, moved * y]);
                for particle in particles.iter().skip(usize::from(turn)).step_by(37) {
                    let template = Template::new(&rest.full, particle, &weights).expect("a spot");
                    let mut search = Search::new(&weights, &now.full);
                    let surface_px = [surface * x, surface * y];
                    let matched = dispatch_256(
                        InstructionSet::widest(),
                        Update(&mut search, &template, particle, surface_px),
                    );
                    let start = matched.start.expect("the particle is inside").motion;
                    assert!(start.into_iter().all(|part| part.abs() <= 1), "{start:?}");
                    let [u, v] = matched.track.motion_px;
                    assert!(matched.track.confidence > 0.9, "{surface}, {moved}: {matched:?}");
                    let off = length([u - moved * x, v - moved * y]);
                    assert!(off < 0.02, "{off} pixels: {surface}, {moved}, ({u}, {v})");
                    found += 1;
                }
            }
        }
        assert!(found > 1_000, "{found}");
    }

    #[test]
    fn many_places_at_once_find_what_one_after_the_other_do() {
        let weights = PatchWeights::new();
        let rest = spots(11);
        let particles = particles::detect(&rest.full);
        let (mut found, mut far) = (0, 0);
        for (apart, (length, turn)) in [0.0, 0.6, 3.0, 4.5, 9.0, 40.0, 130.0]
            .into_iter()
            .flat_map(|length| (0..12).map(move |turn| (length, turn)))
            .enumerate()
        {
            let now = spots(9 + apart % 5);
            let search = Search::new(&weights, &now.full);
            let angle = turn as f32 * std::f32::consts::PI / 6.0;
            let ray = SearchRay::new([length * angle.cos(), length * angle.sin()]);
            for particle in particles.iter().skip(apart).step_by(61) {
                let template = Template::new(&rest.full, particle, &weights).expect("a spot");
                let expected = one_by_one(&search, &template, particle, &ray);
                for set in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
                    let found = dispatch_256(set, WholePixel(&search, &template, particle, &ray));
                    assert_eq!(found, expected, "{set}");
                }
                found += usize::from(expected.is_some());
                far += usize::from(expected.is_some_and(|[x, y]| x.abs().max(y.abs()) > 20));
            }
        }
        assert!(found > 1_000 && far > 50, "{found} found, {far} of them far");
    }
}
