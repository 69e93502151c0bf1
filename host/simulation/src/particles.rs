//! The particles in the soft layer: where they rest, how large and bright they are. Units: mm. Uniform over
//! a square a little wider than the sensing surface and over the soft layer's depth; they may overlap.

use crate::camera::{Coverage, Lens};
use crate::constants::{
    PARTICLE_BRIGHTNESS, PARTICLE_DEPTH_MM, PARTICLE_DIAMETER_MM, PARTICLE_HALF_WIDTH_MM,
};
use crate::field::{Field, Place};
use crate::random::Random;

/// One particle at rest.
#[derive(Debug, Clone, Copy)]
struct Particle {
    at_mm: [f32; 2],
    /// Above the camera's centre of projection.
    height_mm: f32,
    radius_mm: f32,
    brightness: f32,
    place: Place,
}

/// A pattern of particles.
#[derive(Debug, Clone)]
pub(crate) struct Particles(Vec<Particle>);

impl Particles {
    /// `count` particles under a surface `surface_mm` above the camera.
    pub(crate) fn new(random: &mut Random, count: usize, surface_mm: f64) -> Self {
        let [top, bottom] = PARTICLE_DEPTH_MM;
        let half = PARTICLE_HALF_WIDTH_MM;
        let mut particles: Vec<Particle> = (0..count)
            .map(|_| {
                let at = [random.uniform(-half, half), random.uniform(-half, half)];
                let depth = random.uniform(top, bottom);
                Particle {
                    at_mm: at.map(|v| v as f32),
                    height_mm: (surface_mm - depth) as f32,
                    radius_mm: (0.5 * random.uniform(PARTICLE_DIAMETER_MM[0], PARTICLE_DIAMETER_MM[1]))
                        as f32,
                    brightness: random.uniform(PARTICLE_BRIGHTNESS[0], PARTICLE_BRIGHTNESS[1]) as f32,
                    place: Place::new(at, depth),
                }
            })
            .collect();
        // Neighbours in memory are neighbours in the field and in the image.
        particles.sort_by(|a, b| {
            let band = |p: &Particle| p.at_mm[1].floor();
            band(a)
                .total_cmp(&band(b))
                .then(a.at_mm[0].total_cmp(&b.at_mm[0]))
        });
        Self(particles)
    }

    /// Draws every particle where `field` has moved it, or at rest.
    pub(crate) fn draw(&self, field: Option<&Field>, lens: &Lens, coverage: &mut Coverage) {
        coverage.wipe();
        for particle in &self.0 {
            let [x, y] = particle.at_mm;
            let moved = field.map_or([0.0; 3], |field| field.at(&particle.place));
            // Into the skin is towards the camera; nothing passes through it.
            let height = (particle.height_mm - moved[2]).max(1.0);
            let [u, v, scale] = lens.project([x + moved[0], y + moved[1]], height);
            coverage.draw_disc([u, v], particle.radius_mm * scale, particle.brightness);
        }
    }
}
