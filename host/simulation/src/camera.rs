//! The camera under the skin: an equidistant fisheye, r = f·θ, looking up at the gel. Units: mm, pixels, rad.
//! Image axes follow the surface's x and y (the mirror of a view from below is taken as undone).
//! Limits: one centre of projection, no refraction at the gel's base.

use std::sync::LazyLock;

use crate::constants::{CAMERA_TO_BASE_MM, CROP_PX, GEL_THICKNESS_MM, HALF_SURFACE_MM, LENS_BLUR_PX};
use crate::error::{SimulationError, finite, positive};

/// Intrinsics of the crop, and where the camera sits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Pixels per radian from the axis.
    pub focal_px_per_rad: f64,
    /// Where the axis meets the crop, pixels (x, y) from its corner; pixel (0, 0) is centred on (0.5, 0.5).
    pub centre_px: [f64; 2],
    /// From the centre of projection to the gel's rigid base, mm.
    pub to_base_mm: f64,
}

impl Default for Camera {
    /// The crop's half width spans the half width of the sensing surface along the axes: f = 220 /
    /// atan(16/18).
    fn default() -> Self {
        let half_px = 0.5 * CROP_PX as f64;
        let angle = libm::atan(HALF_SURFACE_MM / (CAMERA_TO_BASE_MM + GEL_THICKNESS_MM));
        Self {
            focal_px_per_rad: half_px / angle,
            centre_px: [half_px; 2],
            to_base_mm: CAMERA_TO_BASE_MM,
        }
    }
}

impl Camera {
    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        positive("camera focal_px_per_rad", self.focal_px_per_rad)?;
        positive("camera to_base_mm", self.to_base_mm)?;
        finite("camera centre_px[0]", self.centre_px[0])?;
        finite("camera centre_px[1]", self.centre_px[1])?;
        Ok(())
    }

    /// Image of the point at (x, y) mm, `over_base_mm` above the gel's base: its pixel position and the
    /// pixels that one millimetre across the ray covers there.
    #[must_use]
    pub fn project(&self, at_mm: [f64; 2], over_base_mm: f64) -> ([f64; 2], f64) {
        let [u, v, scale] = self.lens().project(
            [at_mm[0] as f32, at_mm[1] as f32],
            (self.to_base_mm + over_base_mm) as f32,
        );
        ([f64::from(u), f64::from(v)], f64::from(scale))
    }

    pub(crate) fn lens(&self) -> Lens {
        Lens {
            focal: self.focal_px_per_rad as f32,
            centre: self.centre_px.map(|c| c as f32),
        }
    }
}

/// The camera in single precision, for the inner loop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens {
    focal: f32,
    centre: [f32; 2],
}

impl Lens {
    /// Pixel x, pixel y and pixels per millimetre of a point `height_mm` above the centre of projection.
    pub(crate) fn project(&self, at_mm: [f32; 2], height_mm: f32) -> [f32; 3] {
        let [x, y] = at_mm;
        let aside = (x * x + y * y).sqrt();
        let distance = (aside * aside + height_mm * height_mm).sqrt();
        // θ/ρ stays finite on the axis.
        let turn = if aside > 1e-3 {
            libm::atan2f(aside, height_mm) / aside
        } else {
            1.0 / height_mm
        };
        let scale = self.focal * turn;
        [
            self.centre[0] + x * scale,
            self.centre[1] + y * scale,
            self.focal / distance,
        ]
    }
}

/// Light that a coverage image lets through: 1 where no particle is, 0 behind a full one.
#[derive(Debug, Clone)]
pub(crate) struct Coverage {
    pub(crate) clear: Vec<f32>,
}

impl Coverage {
    pub(crate) fn new() -> Self {
        Self {
            clear: vec![1.0; CROP_PX * CROP_PX],
        }
    }

    pub(crate) fn wipe(&mut self) {
        self.clear.fill(1.0);
    }

    /// Lays a disc of `radius_px` over the image: anti-aliased by the lens's blur, area kept.
    pub(crate) fn draw_disc(&mut self, centre_px: [f32; 2], radius_px: f32, brightness: f32) {
        let table = &*DISCS;
        let row = ((radius_px - DISC_RADII_PX[0]) / DISC_STEP_PX)
            .round()
            .clamp(0.0, (DISC_ROWS - 1) as f32);
        let nearest = DISC_RADII_PX[0] + row * DISC_STEP_PX;
        let amount = brightness * (radius_px / nearest) * (radius_px / nearest);
        let disc = &table[row as usize];
        let reach = nearest + DISC_FADE_PX;
        let [u, v] = centre_px;
        let span = |c: f32| {
            let first = (c - reach).max(0.0) as usize;
            let last = (c + reach + 1.0).clamp(0.0, CROP_PX as f32) as usize;
            first.min(last)..last
        };
        let columns = span(u);
        for row in span(v) {
            let dy = row as f32 + 0.5 - v;
            let line = &mut self.clear[row * CROP_PX..][columns.clone()];
            let mut dx = columns.start as f32 + 0.5 - u;
            for pixel in line {
                let place = ((dx * dx + dy * dy) * DISC_PER_PX2) as usize;
                *pixel *= 1.0 - amount * disc[place.min(DISC_PLACES - 1)];
                dx += 1.0;
            }
        }
    }
}

/// Radii for which blurred discs are tabulated, pixels; others take the nearest and keep their own area.
const DISC_RADII_PX: [f32; 2] = [0.5, 3.0];
const DISC_STEP_PX: f32 = 1.0 / 16.0;
const DISC_ROWS: usize = 41;
/// Beyond its radius a disc has faded out: three sigma of blur.
const DISC_FADE_PX: f32 = 3.0 * LENS_BLUR_PX as f32;
/// Table places per square pixel of squared distance.
const DISC_PER_PX2: f32 = 64.0;
/// Places up to (3.0 + 1.8)² pixels², the last one empty.
const DISC_PLACES: usize = 24 * 64;

/// Coverage over squared distance of a disc convolved with a Gaussian: ∫ g(x−d) erf(√(R²−x²)/√2σ) dx.
static DISCS: LazyLock<Vec<[f32; DISC_PLACES]>> = LazyLock::new(|| {
    const STEPS: usize = 48;
    let sigma = LENS_BLUR_PX;
    (0..DISC_ROWS)
        .map(|row| {
            let radius = f64::from(DISC_RADII_PX[0] + row as f32 * DISC_STEP_PX);
            let nodes: [(f64, f64); STEPS] = std::array::from_fn(|i| {
                let angle = (i as f64 + 0.5) / STEPS as f64 * std::f64::consts::PI;
                let (sin, cos) = libm::sincos(angle);
                let chord = libm::erf(radius * sin / (sigma * std::f64::consts::SQRT_2));
                let width = radius * sin * std::f64::consts::PI / STEPS as f64;
                (
                    radius * cos,
                    chord * width / (sigma * (std::f64::consts::TAU).sqrt()),
                )
            });
            std::array::from_fn(|place| {
                let distance = ((place as f64 + 0.5) / f64::from(DISC_PER_PX2)).sqrt();
                if distance > radius + f64::from(DISC_FADE_PX) || place + 1 == DISC_PLACES {
                    return 0.0;
                }
                let sum: f64 = nodes
                    .iter()
                    .map(|(x, weight)| weight * libm::exp(-0.5 * ((x - distance) / sigma).powi(2)))
                    .sum();
                sum as f32
            })
        })
        .collect()
});

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn points_at_known_angles_land_where_an_equidistant_lens_puts_them() {
        let camera = Camera::default();
        // The middle, and the surface's edge at the crop's edge.
        let (at, scale) = camera.project([0.0, 0.0], 6.0);
        assert!(at.iter().all(|v| (v - 220.0).abs() < 1e-9));
        assert!((scale - camera.focal_px_per_rad / 18.0).abs() < 1e-4);
        let (at, _) = camera.project([16.0, 0.0], 6.0);
        assert!((at[0] - 440.0).abs() < 1e-3 && (at[1] - 220.0).abs() < 1e-3);
        // 45° along a diagonal, from any height.
        for height in [0.5, 6.0] {
            let aside = (camera.to_base_mm + height) / 2.0_f64.sqrt();
            let (at, _) = camera.project([aside, -aside], height);
            let along = camera.focal_px_per_rad * PI / 4.0 / 2.0_f64.sqrt();
            assert!((at[0] - 220.0 - along).abs() < 1e-3 && (at[1] - 220.0 + along).abs() < 1e-3);
        }
        // r = f θ: three times the angle, three times the way.
        let radius = |angle: f64| camera.project([18.0 * angle.tan(), 0.0], 6.0).0[0] - 220.0;
        assert!((radius(0.6) - 3.0 * radius(0.2)).abs() < 1e-3);
    }

    /// Sum and centroid of the light that one disc takes.
    fn moments(centre: [f32; 2], radius: f32, brightness: f32) -> (f64, [f64; 2]) {
        let mut coverage = Coverage::new();
        coverage.draw_disc(centre, radius, brightness);
        let (mut sum, mut first) = (0.0, [0.0; 2]);
        for (i, clear) in coverage.clear.iter().enumerate() {
            let light = f64::from(1.0 - clear);
            sum += light;
            first[0] += light * ((i % CROP_PX) as f64 + 0.5);
            first[1] += light * ((i / CROP_PX) as f64 + 0.5);
        }
        (sum, first.map(|f| f / sum))
    }

    #[test]
    fn a_disc_keeps_its_area_and_its_centroid_at_any_sub_pixel_place() {
        let mut worst = [0.0_f64; 2];
        for (i, radius) in [0.8_f32, 1.0, 1.27, 1.41, 1.9, 2.3].into_iter().enumerate() {
            for j in 0..60 {
                let part = j as f32 * 0.137 + i as f32 * 0.31;
                let centre = [100.0 + part % 1.0, 200.0 + (part * 3.7) % 1.0];
                let (sum, at) = moments(centre, radius, 0.8);
                let area = PI * f64::from(radius * radius);
                worst[0] = worst[0].max((sum / (0.8 * area) - 1.0).abs());
                for k in 0..2 {
                    worst[1] = worst[1].max((at[k] - f64::from(centre[k])).abs());
                }
            }
        }
        assert!(
            worst[0] < 0.01 && worst[1] < 0.01,
            "area {} centroid {} px",
            worst[0],
            worst[1]
        );
    }

    #[test]
    fn a_particles_centroid_follows_its_projection() {
        let camera = Camera::default();
        for start in [[3.0, -4.0], [-12.0, 9.0]] {
            for step in 0..40 {
                let shift = f64::from(step) * 0.007;
                let (at, scale) =
                    camera.project([start[0] + shift, start[1] - 0.5 * shift], 4.0 - 0.3 * shift);
                let (_, found) = moments(at.map(|v| v as f32), (0.08 * scale) as f32, 0.9);
                assert!((found[0] - at[0]).abs() < 0.01 && (found[1] - at[1]).abs() < 0.01);
            }
        }
    }

    #[test]
    fn discs_off_the_image_change_nothing_and_do_not_panic() {
        let mut coverage = Coverage::new();
        for at in [
            [-50.0, 10.0],
            [10.0, 1e6],
            [f32::MAX, 0.0],
            [-1e9, -1e9],
            [460.0, 460.0],
        ] {
            coverage.draw_disc(at, 1.4, 0.9);
        }
        assert!(coverage.clear.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()));
    }
}
