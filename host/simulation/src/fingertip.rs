//! A virtual fingertip: the skin's particles seen by its camera at rest and under a contact, with light,
//! vignette and sensor noise. Images are 440 x 440 crops in gray levels. Limits: gray, no motion blur, no
//! compression; the light does not depend on depth.

use std::sync::Arc;

use crate::camera::{Camera, Coverage};
use crate::constants::{
    BACKGROUND_LEVELS, CROP_PX, LIGHT_TILT, PARTICLE_COUNT, PARTICLE_DEPTH_MM, PARTICLE_LEVELS,
    SENSOR_NOISE_LEVELS, VIGNETTE,
};
use crate::contact::ContactState;
use crate::contact_world::Truth;
use crate::error::{SimulationError, checked, not_negative, positive};
use crate::field::{Field, FieldKernels};
use crate::gel::Gel;
use crate::image::Image;
use crate::particles::Particles;
use crate::random::Random;

/// More particles than this hide each other.
const MOST_PARTICLES: usize = 100_000;
/// Purposes of random streams.
const PATTERN: u64 = 1;
const NOISE: u64 = 2;
const LIGHT: u64 = 3;

/// What differs from one virtual fingertip to the next, the seed aside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FingertipParams {
    /// The skin.
    pub gel: Gel,
    /// The camera under it.
    pub camera: Camera,
    /// Particles in the soft layer, at most 100,000.
    pub particles: usize,
    /// Standard deviation of the sensor's noise, gray levels.
    pub noise_levels: f64,
    /// Brightness of the images relative to nominal.
    pub brightness: f64,
}

impl Default for FingertipParams {
    fn default() -> Self {
        Self {
            gel: Gel::default(),
            camera: Camera::default(),
            particles: PARTICLE_COUNT,
            noise_levels: SENSOR_NOISE_LEVELS,
            brightness: 1.0,
        }
    }
}

/// A virtual fingertip. The same seed, parameters and sequence of calls give the same images, bit for bit.
#[derive(Debug, Clone)]
pub struct Fingertip {
    params: FingertipParams,
    particles: Particles,
    field: Field,
    coverage: Coverage,
    /// The particles at rest, drawn once.
    rest: Coverage,
    /// Light that reaches each pixel, 1 in the middle.
    light: Vec<f32>,
    noise: Random,
}

impl Fingertip {
    /// The fingertip whose particles, light and noise follow from `seed`.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(seed: u64, params: FingertipParams) -> Result<Self, SimulationError> {
        params.gel.check()?;
        Self::with_kernels(seed, params, Arc::new(FieldKernels::new(&params.gel)))
    }

    /// As [`Self::new`], with kernels made before for the same gel: they take longer than everything else
    /// here.
    pub(crate) fn with_kernels(
        seed: u64,
        params: FingertipParams,
        kernels: Arc<FieldKernels>,
    ) -> Result<Self, SimulationError> {
        params.gel.check()?;
        params.camera.check()?;
        checked(
            "particles",
            params.particles as f64,
            "between 1 and 100000",
            |n| (1.0..=MOST_PARTICLES as f64).contains(&n),
        )?;
        checked(
            "gel thickness_mm",
            params.gel.thickness_mm,
            "at least 5.5 mm, the particles' depth",
            |h| h >= PARTICLE_DEPTH_MM[1],
        )?;
        not_negative("noise_levels", params.noise_levels)?;
        positive("brightness", params.brightness)?;
        let surface_mm = params.camera.to_base_mm + params.gel.thickness_mm;
        let particles = Particles::new(&mut Random::new(seed, PATTERN), params.particles, surface_mm);
        let mut rest = Coverage::new();
        particles.draw(None, &params.camera.lens(), &mut rest);
        Ok(Self {
            params,
            particles,
            field: Field::new(kernels),
            coverage: Coverage::new(),
            rest,
            light: light(&mut Random::new(seed, LIGHT)),
            noise: Random::new(seed, NOISE),
        })
    }

    /// Brightness of the images from now on, relative to nominal.
    ///
    /// # Errors
    /// A brightness that is not above 0.
    pub fn set_brightness(&mut self, brightness: f64) -> Result<(), SimulationError> {
        self.params.brightness = positive("brightness", brightness)?;
        Ok(())
    }

    /// The camera's crop when nothing touches, with fresh noise.
    pub fn rest_image(&mut self) -> Image {
        let mut out = Image::crop();
        self.render(None, &mut out);
        out
    }

    /// The camera's crop under `contact`, with fresh noise; `out` is made 440 x 440 if it is not. Where
    /// nothing touches, neither field nor particles are computed again.
    pub fn render(&mut self, contact: Option<&ContactState>, out: &mut Image) {
        let contact = contact.filter(|contact| contact.in_contact());
        if let Some(contact) = contact {
            self.field.load(contact);
        }
        self.take(contact.is_some(), out);
    }

    /// As [`Self::render`], under a contact of the contact world. The skin there should be this gel.
    pub fn render_truth(&mut self, truth: &Truth, out: &mut Image) {
        let touched = truth.in_contact();
        if touched {
            self.field.load_truth(truth);
        }
        self.take(touched, out);
    }

    /// Takes the picture: particles moved by the field if something touches.
    fn take(&mut self, touched: bool, out: &mut Image) {
        if (out.width, out.height, out.pixels.len()) != (CROP_PX, CROP_PX, CROP_PX * CROP_PX) {
            *out = Image::crop();
        }
        let coverage = if touched {
            self.particles
                .draw(Some(&self.field), &self.params.camera.lens(), &mut self.coverage);
            &self.coverage
        } else {
            &self.rest
        };
        expose(
            &mut self.noise,
            &self.params,
            &self.light,
            &coverage.clear,
            &mut out.pixels,
        );
    }
}

/// Light per pixel: a vignette about the middle and a tilt from unequal LEDs.
fn light(random: &mut Random) -> Vec<f32> {
    let half = 0.5 * CROP_PX as f64;
    let tilt = [
        random.uniform(-LIGHT_TILT, LIGHT_TILT),
        random.uniform(-LIGHT_TILT, LIGHT_TILT),
    ];
    let mut light = Vec::with_capacity(CROP_PX * CROP_PX);
    for row in 0..CROP_PX {
        for column in 0..CROP_PX {
            let x = (column as f64 + 0.5 - half) / half;
            let y = (row as f64 + 0.5 - half) / half;
            let falling = 1.0 - VIGNETTE * 0.5 * (x * x + y * y);
            light.push((falling * (1.0 + tilt[0] * x + tilt[1] * y)) as f32);
        }
    }
    light
}

/// Coverage and light to gray levels, with noise.
fn expose(random: &mut Random, params: &FingertipParams, light: &[f32], clear: &[f32], out: &mut [u8]) {
    // The sum of four random bytes is close to normal: mean 510, sigma √(4·(256²−1)/12).
    const MEAN: i32 = 510;
    const SIGMA: f64 = 147.801;
    const BAND: usize = 2 * CROP_PX;
    let noise_scale = (params.noise_levels / SIGMA) as f32;
    let full = (params.brightness * (BACKGROUND_LEVELS + PARTICLE_LEVELS)) as f32;
    let hidden = (params.brightness * PARTICLE_LEVELS) as f32;
    let mut noise = [0_i32; BAND];
    let bands = out
        .chunks_exact_mut(BAND)
        .zip(light.chunks_exact(BAND).zip(clear.chunks_exact(BAND)));
    for (out, (light, clear)) in bands {
        for pair in noise.chunks_exact_mut(2) {
            let bits = random.bits();
            let sums = (bits & 0x00ff_00ff_00ff_00ff) + ((bits >> 8) & 0x00ff_00ff_00ff_00ff);
            let sums = (sums & 0x0000_ffff_0000_ffff) + ((sums >> 16) & 0x0000_ffff_0000_ffff);
            pair[0] = (sums as u32) as i32 - MEAN;
            pair[1] = (sums >> 32) as i32 - MEAN;
        }
        for i in 0..BAND {
            // Never below zero before the half is added, so truncation rounds; the cast saturates above.
            let level = light[i] * (full - hidden * clear[i]) + noise[i] as f32 * noise_scale;
            out[i] = (level + 0.5).clamp(0.0, 255.0) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Load, SphereContact, SphereParams};

    fn pressed(load: Load) -> SphereContact {
        let mut contact = SphereContact::new(SphereParams::default()).unwrap();
        contact.step(load).unwrap();
        contact
    }

    fn sheared() -> SphereContact {
        pressed(Load {
            normal_n: 4.0,
            shear_n: [1.5, 0.5],
            torsion_nmm: 2.0,
        })
    }

    #[test]
    fn the_same_seed_gives_the_same_images_and_another_seed_others() {
        let contact = sheared();
        let run = |seed: u64| {
            let mut fingertip = Fingertip::new(seed, FingertipParams::default()).unwrap();
            let rest = fingertip.rest_image();
            let mut now = Image::crop();
            fingertip.render(Some(contact.state()), &mut now);
            (rest, now)
        };
        let (first, again, other) = (run(5), run(5), run(6));
        assert!(first == again);
        assert!(first.0 != other.0 && first.0 != first.1);
    }

    /// Mean gray level and the sigma of what differs between two images of the same scene.
    fn statistics(a: &Image, b: &Image) -> (f64, f64) {
        let n = a.pixels.len() as f64;
        let mean = a.pixels.iter().map(|&p| f64::from(p)).sum::<f64>() / n;
        let square: f64 = a
            .pixels
            .iter()
            .zip(&b.pixels)
            .map(|(&p, &q)| (f64::from(p) - f64::from(q)).powi(2))
            .sum();
        (mean, (square / n).sqrt())
    }

    #[test]
    fn noise_and_brightness_are_what_was_asked_for() {
        for noise_levels in [0.0, 2.0, 3.5] {
            let params = FingertipParams {
                noise_levels,
                ..FingertipParams::default()
            };
            let mut fingertip = Fingertip::new(1, params).unwrap();
            let (a, b) = (fingertip.rest_image(), fingertip.rest_image());
            let (mean, sigma) = statistics(&a, &b);
            // Rounding adds 1/12 to each variance.
            let expected = if noise_levels > 0.0 {
                (2.0 * (noise_levels.powi(2) + 1.0 / 12.0)).sqrt()
            } else {
                0.0
            };
            assert!((sigma - expected).abs() < 0.05, "{sigma} {expected}");
            fingertip.set_brightness(0.8).unwrap();
            let dim = fingertip.rest_image();
            let (dim_mean, _) = statistics(&dim, &a);
            assert!((dim_mean / mean - 0.8).abs() < 0.01);
        }
    }

    #[test]
    fn pressing_moves_particles_near_the_contact_and_hardly_any_far_from_it() {
        let mut contact = SphereContact::new(SphereParams {
            centre_mm: [-8.0, -8.0],
            ..SphereParams::default()
        })
        .unwrap();
        contact
            .step(Load {
                normal_n: 3.0,
                shear_n: [1.0, 0.0],
                torsion_nmm: 0.0,
            })
            .unwrap();
        let params = FingertipParams {
            noise_levels: 0.0,
            ..FingertipParams::default()
        };
        let mut fingertip = Fingertip::new(2, params).unwrap();
        let rest = fingertip.rest_image();
        let mut now = Image::crop();
        fingertip.render(Some(contact.state()), &mut now);
        let change = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            let mut sum = 0.0;
            for row in y.clone() {
                for column in x.clone() {
                    let i = row * CROP_PX + column;
                    sum += (f64::from(rest.pixels[i]) - f64::from(now.pixels[i])).abs();
                }
            }
            sum / (x.len() * y.len()) as f64
        };
        let (near, far) = (change(70..150, 70..150), change(350..430, 350..430));
        assert!(near > 8.0 && far < 0.2 * near, "{near} near, {far} far");
    }

    #[test]
    fn a_lifted_contact_gives_the_rest_image() {
        let contact = pressed(Load::default());
        let params = FingertipParams {
            noise_levels: 0.0,
            ..FingertipParams::default()
        };
        let mut fingertip = Fingertip::new(2, params).unwrap();
        let rest = fingertip.rest_image();
        let mut now = Image::new(3, 2);
        fingertip.render(Some(contact.state()), &mut now);
        assert!(now == rest);
    }

    #[test]
    fn a_solved_contact_is_pictured_as_the_closed_form_is() {
        use crate::contact_world::{Contact, Drive, Mount, Press, Shape, Skin};
        let params = FingertipParams {
            noise_levels: 0.0,
            ..FingertipParams::default()
        };
        let mut fingertip = Fingertip::new(3, params).unwrap();
        // Without coupling and base, as the closed form is; the inside is the fingertip's.
        let gel = Gel {
            poisson: 0.5,
            thickness_mm: 1e9,
            ..params.gel
        };
        let sphere = SphereParams {
            gel,
            ..SphereParams::default()
        };
        let mut closed = SphereContact::new(sphere).unwrap();
        let skin = Arc::new(Skin::new(&gel, 80).unwrap());
        let indenter = Arc::new(Shape::Sphere {
            radius_mm: sphere.radius_mm,
        });
        let mut solved = Contact::new(skin, indenter, sphere.friction, Mount::default()).unwrap();
        let rest = fingertip.rest_image();
        let [mut one, mut other] = [Image::crop(), Image::crop()];
        fingertip.render_truth(solved.truth(), &mut other);
        assert!(other == rest);
        for shear in [0.0, 0.4] {
            let load = Load {
                normal_n: 1.5,
                shear_n: [shear, 0.0],
                torsion_nmm: 0.0,
            };
            let state = closed.step(load).unwrap();
            let drive = Drive {
                press: Press::Force(1.5),
                at_mm: state.displacement_mm(),
                turn_rad: 0.0,
                tilt_rad: [0.0; 2],
            };
            solved.step(drive).unwrap();
        }
        fingertip.render(Some(closed.state()), &mut one);
        fingertip.render_truth(solved.truth(), &mut other);
        let ((_, between), (_, moved)) = (statistics(&one, &other), statistics(&one, &rest));
        assert!(between < 0.1 * moved, "{between} against {moved} levels");
    }

    #[test]
    fn bad_parameters_are_named() {
        let good = FingertipParams::default();
        let bad = |params: FingertipParams| Fingertip::new(1, params).unwrap_err().to_string();
        assert_eq!(
            bad(FingertipParams { particles: 0, ..good }),
            "particles is 0, expected between 1 and 100000"
        );
        assert!(
            bad(FingertipParams {
                noise_levels: -1.0,
                ..good
            })
            .contains("noise_levels is -1")
        );
        assert!(
            bad(FingertipParams {
                brightness: f64::NAN,
                ..good
            })
            .contains("brightness is NaN")
        );
        let camera = Camera {
            focal_px_per_rad: 0.0,
            ..good.camera
        };
        assert!(bad(FingertipParams { camera, ..good }).contains("focal_px_per_rad is 0"));
        let gel = Gel {
            thickness_mm: 3.0,
            ..good.gel
        };
        assert!(bad(FingertipParams { gel, ..good }).contains("thickness_mm is 3"));
        assert!(Fingertip::new(1, good).unwrap().set_brightness(0.0).is_err());
    }
}
