//! The particles in the soft layer: where they rest, how large and bright they are. Units: mm, gray levels. Uniform
//! over the gel's square and over the soft layer's depth, each whole inside the layer; they may overlap each other
//! (fewer than one in fifty does). A particle nearer to the camera hides what is behind it.

use crate::camera::Lens;
use crate::constants::{
    BACKGROUND_LEVELS, CROP_CORNER_PX, GEL_HALF_WIDTH_MM, PARTICLE_BRIGHTNESS, PARTICLE_DEPTH_MM,
    PARTICLE_DIAMETER_MM, PARTICLE_LEVELS,
};
use crate::drawing::{Window, draw_disc};
use crate::field::{DisplacementField, MaterialPoint};
use crate::lighting::Lamps;
use crate::random::Random;

/// One particle at rest.
#[derive(Debug, Clone, Copy)]
struct Particle {
    at_mm: [f32; 2],
    /// Above the camera's centre of projection.
    height_mm: f32,
    radius_mm: f32,
    /// Gray level at brightness 1, before the lens.
    level: f32,
    /// Change of `level` per millimetre along x, y and up.
    slope: [f32; 3],
    place: MaterialPoint,
}

/// What the camera's picture is to a particle: for those who measure how well it is found again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenParticle {
    /// Its centre at rest, column and row of the 440 x 440 crop; pixel (0, 0) is centred on (0.5, 0.5).
    pub rest_px: [f32; 2],
    /// Its centre now.
    pub now_px: [f32; 2],
    /// Its depth under the surface at rest, mm.
    pub depth_mm: f32,
}

/// A pattern of particles.
#[derive(Debug, Clone)]
pub(crate) struct Particles {
    /// From the farthest to the nearest.
    all: Vec<Particle>,
    base_mm: f32,
    surface_mm: f32,
}

impl Particles {
    /// `count` particles between a base and a surface, both over the camera, lit by `lamps`.
    pub(crate) fn new(
        random: &mut Random,
        count: usize,
        base_mm: f64,
        surface_mm: f64,
        lamps: &Lamps,
    ) -> Self {
        let [top, bottom] = PARTICLE_DEPTH_MM;
        let reference_mm = surface_mm - 0.5 * (top + bottom);
        let mut all: Vec<Particle> = (0..count)
            .map(|_| {
                let radius = 0.5 * random.uniform(PARTICLE_DIAMETER_MM[0], PARTICLE_DIAMETER_MM[1]);
                let half = GEL_HALF_WIDTH_MM - radius;
                let at = [random.uniform(-half, half), random.uniform(-half, half)];
                let depth = random.uniform(top + radius, bottom - radius);
                let height = surface_mm - depth;
                let shine = random.uniform(PARTICLE_BRIGHTNESS[0], PARTICLE_BRIGHTNESS[1]);
                let levels = BACKGROUND_LEVELS + shine * PARTICLE_LEVELS;
                let (light, slope) = lamps.sphere([at[0], at[1], height], reference_mm);
                Particle {
                    at_mm: at.map(|v| v as f32),
                    height_mm: height as f32,
                    radius_mm: radius as f32,
                    level: (levels * light) as f32,
                    slope: slope.map(|s| (levels * s) as f32),
                    place: MaterialPoint::new(at, depth),
                }
            })
            .collect();
        all.sort_by(|a, b| b.height_mm.total_cmp(&a.height_mm));
        Self {
            all,
            base_mm: base_mm as f32,
            surface_mm: surface_mm as f32,
        }
    }

    /// Where every particle is at rest and, moved by `field`, now.
    pub(crate) fn seen(
        &self,
        field: Option<&DisplacementField>,
        lens: &Lens,
    ) -> impl Iterator<Item = SeenParticle> {
        let top_mm = self.surface_mm;
        self.all.iter().map(move |particle| {
            let rest = particle.at_rest();
            let now = field.map_or(rest, |field| {
                particle.moved(field.at(&particle.place), self.base_mm).0
            });
            let at = |[x, y, height]: [f32; 3]| {
                let [u, v, _] = lens.project([x, y], height);
                [u - CROP_CORNER_PX[0] as f32, v - CROP_CORNER_PX[1] as f32]
            };
            SeenParticle {
                rest_px: at(rest),
                now_px: at(now),
                depth_mm: top_mm - particle.height_mm,
            }
        })
    }

    /// Draws every particle into a window's picture where `field` has moved it, or at rest. The order is that at
    /// rest: particles on one ray move together.
    pub(crate) fn draw(
        &self,
        field: Option<&DisplacementField>,
        lens: &Lens,
        window: &Window,
        picture: &mut [f32],
    ) {
        for particle in &self.all {
            let ([x, y, height], level) = match field {
                Some(field) => particle.moved(field.at(&particle.place), self.base_mm),
                None => (particle.at_rest(), particle.level),
            };
            let [u, v, scale] = lens.project([x, y], height);
            draw_disc(picture, window, [u, v], particle.radius_mm * scale, level);
        }
    }
}

impl Particle {
    fn at_rest(&self) -> [f32; 3] {
        [self.at_mm[0], self.at_mm[1], self.height_mm]
    }

    /// Where it is and how bright, moved by (x, y, into the gel) mm.
    fn moved(&self, [x, y, down]: [f32; 3], base_mm: f32) -> ([f32; 3], f32) {
        // Into the gel is towards the camera; nothing passes through the base.
        let height = (self.height_mm - down).max(base_mm + self.radius_mm);
        let [along_x, along_y, along_z] = self.slope;
        let level = self.level + x * along_x + y * along_y + (height - self.height_mm) * along_z;
        ([self.at_mm[0] + x, self.at_mm[1] + y, height], level.max(0.0))
    }
}

#[cfg(test)]
impl Particles {
    /// The nearest particle's place at rest, over the camera.
    pub(crate) fn nearest_at_rest(&self) -> [f64; 3] {
        self.all[self.all.len() - 1].at_rest().map(f64::from)
    }

    /// The same, moved by `field`.
    pub(crate) fn nearest_moved(&self, field: &DisplacementField) -> [f64; 3] {
        let nearest = &self.all[self.all.len() - 1];
        let (at, _) = nearest.moved(field.at(&nearest.place), self.base_mm);
        at.map(f64::from)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::closed_form::Hertz;
    use crate::field::LayerKernels;
    use crate::gel::Gel;
    use crate::lighting::Lighting;

    const BASE_MM: f64 = 12.0;
    const SURFACE_MM: f64 = 18.0;

    fn lamps() -> Lamps {
        Lamps::new(&Lighting::default(), &mut Random::new(1, 9))
    }

    fn particles() -> Particles {
        Particles::new(&mut Random::new(1, 8), 5_000, BASE_MM, SURFACE_MM, &lamps())
    }

    /// The field of a sphere pressed in and pulled.
    fn field(radius_mm: f64, normal_n: f64) -> DisplacementField {
        let hertz = Hertz::new(normal_n, radius_mm, &Gel::default()).unwrap();
        let mut field = DisplacementField::new(Arc::new(LayerKernels::new(&Gel::default())));
        field.load_traction(|[x, y]| {
            let p = hertz.pressure_mpa(f64::hypot(x, y));
            [0.3 * p, 0.0, p]
        });
        field
    }

    #[test]
    fn whole_particles_lie_between_cover_and_base_and_inside_the_gels_sides() {
        let particles = particles();
        let [top, bottom] = PARTICLE_DEPTH_MM.map(|depth| (SURFACE_MM - depth) as f32);
        let side = GEL_HALF_WIDTH_MM as f32;
        let mut depths = [f32::MAX, f32::MIN];
        for p in &particles.all {
            assert!(p.radius_mm >= 0.075 && p.radius_mm <= 0.09);
            assert!(p.height_mm + p.radius_mm <= top + 1e-5 && p.height_mm - p.radius_mm >= bottom - 1e-5);
            assert!(p.at_mm.iter().all(|x| x.abs() + p.radius_mm <= side + 1e-5));
            depths = [depths[0].min(p.height_mm), depths[1].max(p.height_mm)];
        }
        // And they fill the layer.
        assert!(depths[0] - bottom < 0.1 && top - depths[1] < 0.1);
        // The base is below it.
        assert!(bottom > BASE_MM as f32);
    }

    #[test]
    fn the_nearer_particle_is_drawn_over_the_farther_one() {
        let heights: Vec<f32> = particles().all.iter().map(|p| p.height_mm).collect();
        assert!(heights.windows(2).all(|pair| pair[0] >= pair[1]));
    }

    #[test]
    fn a_moved_particle_is_lit_as_one_at_that_place() {
        let (particles, lamps, field) = (particles(), lamps(), field(12.0, 10.0));
        let reference = SURFACE_MM - 0.5 * PARTICLE_DEPTH_MM.iter().sum::<f64>();
        let (mut worst, mut furthest, mut change) = (0.0_f64, 0.0_f64, 0.0_f64);
        for p in &particles.all {
            let (at, level) = p.moved(field.at(&p.place), particles.base_mm);
            let rest = p.at_rest();
            let there = f64::from(p.level) * lamps.sphere(at.map(f64::from), reference).0
                / lamps.sphere(rest.map(f64::from), reference).0;
            worst = worst.max((f64::from(level) / there - 1.0).abs());
            change = change.max((there / f64::from(p.level) - 1.0).abs());
            let way: f32 = at.iter().zip(rest).map(|(a, b)| (a - b) * (a - b)).sum();
            furthest = furthest.max(f64::from(way.sqrt()));
        }
        // The light is taken to first order in the displacement.
        assert!(furthest > 1.0 && change > 0.03, "{furthest} mm, {change}");
        assert!(worst < 0.01, "light off by {worst} at up to {furthest} mm");
    }

    #[test]
    fn no_load_drives_a_particle_into_the_base() {
        let particles = particles();
        for normal_n in [15.0, 1_000.0] {
            let field = field(4.0, normal_n);
            for p in &particles.all {
                let moved = field.at(&p.place);
                assert!(
                    p.height_mm - moved[2] > BASE_MM as f32 + p.radius_mm,
                    "{moved:?} at {normal_n} N"
                );
            }
        }
        // What no contact does, the base stops.
        let p = &particles.all[0];
        let ([x, _, height], level) = p.moved([1e3, 0.0, 1e3], particles.base_mm);
        assert!(x > 900.0 && height >= BASE_MM as f32 + p.radius_mm && level >= 0.0);
    }
}
