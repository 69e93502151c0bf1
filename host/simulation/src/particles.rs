//! The particles in the soft layer: where they rest, how large and bright they are. Units: mm, gray levels. Uniform
//! over the gel's square and over the soft layer's depth, each whole inside the layer; they may overlap each other
//! (fewer than one in fifty does). A particle nearer to the camera hides what is behind it.

use crate::camera::Lens;
use crate::constants::{
    BACKGROUND_LEVELS, GEL_HALF_WIDTH_MM, PARTICLE_BRIGHTNESS, PARTICLE_DEPTH_MM, PARTICLE_DIAMETER_MM,
    PARTICLE_LEVELS,
};
use crate::drawing::{Window, draw_disc};
use crate::field::{Field, Place};
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
    place: Place,
}

/// A pattern of particles.
#[derive(Debug, Clone)]
pub(crate) struct Particles {
    /// From the farthest to the nearest.
    all: Vec<Particle>,
    base_mm: f32,
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
                    place: Place::new(at, depth),
                }
            })
            .collect();
        all.sort_by(|a, b| b.height_mm.total_cmp(&a.height_mm));
        Self {
            all,
            base_mm: base_mm as f32,
        }
    }

    /// Draws every particle into a window's picture where `field` has moved it, or at rest. The order is that at
    /// rest: particles on one ray move together.
    pub(crate) fn draw(&self, field: Option<&Field>, lens: &Lens, window: &Window, picture: &mut [f32]) {
        for particle in &self.all {
            let [x, y] = particle.at_mm;
            let [right, up, down] = field.map_or([0.0; 3], |field| field.at(&particle.place));
            // Into the skin is towards the camera; nothing passes through the base.
            let height = (particle.height_mm - down).max(self.base_mm + particle.radius_mm);
            let [u, v, scale] = lens.project([x + right, y + up], height);
            let [along_x, along_y, along_z] = particle.slope;
            let level = particle.level + right * along_x + up * along_y - down * along_z;
            draw_disc(
                picture,
                window,
                [u, v],
                particle.radius_mm * scale,
                level.max(0.0),
            );
        }
    }
}
