//! Random training samples: pairs of 88 x 88 images at rest and under a sphere, with the true force map.
//! Every sample follows from the seed alone. Units: mm, N, N·mm. Limits: spheres only; indentation up to 45
//! % of the layer, where the linear gel is already a stand-in.

use std::sync::Arc;

use crate::constants::{NETWORK_PX, TAXEL_COUNT};
use crate::contact::{ContactState, ForceMap, Load, SphereContact, SphereParams};
use crate::error::SimulationError;
use crate::field::FieldKernels;
use crate::fingertip::{Fingertip, FingertipParams};
use crate::gel::Gel;
use crate::image::{Image, block_mean_88};
use crate::random::Random;

/// Purpose of the generator's random stream.
const SAMPLES: u64 = 5;
/// Contacts on one particle pattern before the next is drawn.
const SAMPLES_PER_PATTERN: u32 = 8;
/// Share of samples in which nothing touches.
const NO_CONTACT: f64 = 0.04;
const SPHERE_RADIUS_MM: [f64; 2] = [4.0, 25.0];
const NORMAL_N: [f64; 2] = [0.1, 15.0];
const FRICTION: [f64; 2] = [0.4, 1.0];
/// Deepest indentation, share of the layer.
const INDENTATION: f64 = 0.45;
/// Contacts end this far inside the surface, mm; large ones may come closer to the edge.
const MARGIN_MM: f64 = 1.0;

/// One training sample.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The fingertip at rest, 88 x 88.
    pub rest: [u8; NETWORK_PX * NETWORK_PX],
    /// The same fingertip under load, 88 x 88.
    pub now: [u8; NETWORK_PX * NETWORK_PX],
    /// What presses on it, N per taxel.
    pub forces: ForceMap,
    /// The load that the contact holds.
    pub load: Load,
    /// True friction of the contact; none when nothing touches.
    pub friction: Option<f64>,
    /// True share of the contact area that sticks; none when nothing touches.
    pub true_stick_ratio: Option<f64>,
    /// Whether the contact slides as a whole.
    pub gross_slip: bool,
}

/// An endless stream of random samples. Particle patterns change every eight samples and differ between
/// seeds.
#[derive(Debug, Clone)]
pub struct SampleGenerator {
    random: Random,
    kernels: Arc<FieldKernels>,
    pattern: Option<Pattern>,
    crop: Image,
}

/// A fingertip in use, and its image at rest.
#[derive(Debug, Clone)]
struct Pattern {
    fingertip: Fingertip,
    brightness: f64,
    rest: [u8; NETWORK_PX * NETWORK_PX],
    left: u32,
}

impl SampleGenerator {
    /// The stream that follows from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            random: Random::new(seed, SAMPLES),
            kernels: Arc::new(FieldKernels::new(&Gel::default())),
            pattern: None,
            crop: Image::crop(),
        }
    }

    fn next_pattern(&mut self) -> Result<Pattern, SimulationError> {
        let random = &mut self.random;
        let params = FingertipParams::of_sensor(random.bits());
        let mut fingertip = Fingertip::with_kernels(random.bits(), params, Arc::clone(&self.kernels))?;
        fingertip.render(None, &mut self.crop);
        Ok(Pattern {
            fingertip,
            brightness: params.brightness,
            rest: block_mean_88(&self.crop.pixels),
            left: SAMPLES_PER_PATTERN,
        })
    }

    fn sample(&mut self) -> Result<Sample, SimulationError> {
        let mut pattern = match self.pattern.take() {
            Some(pattern) if pattern.left > 0 => pattern,
            _ => self.next_pattern()?,
        };
        pattern.left -= 1;
        let contact = if self.random.unit() < NO_CONTACT {
            None
        } else {
            Some(random_contact(&mut self.random)?)
        };
        pattern
            .fingertip
            .set_brightness(pattern.brightness * self.random.uniform(0.97, 1.03))?;
        let state = contact.as_ref().map(SphereContact::state);
        pattern.fingertip.render(state, &mut self.crop);
        let sample = Sample {
            rest: pattern.rest,
            now: block_mean_88(&self.crop.pixels),
            forces: state.map_or([[0.0; 3]; TAXEL_COUNT], ContactState::force_map),
            load: state.map_or_else(Load::default, ContactState::load),
            friction: state.map(ContactState::friction),
            true_stick_ratio: state.map(ContactState::true_stick_ratio),
            gross_slip: state.is_some_and(ContactState::gross_slip),
        };
        self.pattern = Some(pattern);
        Ok(sample)
    }
}

impl Iterator for SampleGenerator {
    type Item = Sample;

    /// The next sample; never none. A contact that does not converge is drawn again.
    fn next(&mut self) -> Option<Sample> {
        loop {
            if let Ok(sample) = self.sample() {
                return Some(sample);
            }
        }
    }
}

/// A sphere somewhere on the skin after a random load history.
fn random_contact(random: &mut Random) -> Result<SphereContact, SimulationError> {
    let gel = Gel::default();
    let radius_mm = random.uniform(SPHERE_RADIUS_MM[0], SPHERE_RADIUS_MM[1]);
    let friction = random.uniform(FRICTION[0], FRICTION[1]);
    let deepest = (INDENTATION * gel.thickness_mm * radius_mm).sqrt();
    let strongest = 4.0 * gel.contact_modulus_mpa() * deepest.powi(3) / (3.0 * radius_mm);
    let normal_n = random.log_uniform(NORMAL_N[0], NORMAL_N[1].min(strongest));
    let contact_mm = libm::cbrt(0.75 * normal_n * radius_mm / gel.contact_modulus_mpa());
    let room = (16.0 - MARGIN_MM - contact_mm).max(5.0);
    let centre_mm = [random.uniform(-room, room), random.uniform(-room, room)];
    let mut contact = SphereContact::new(SphereParams {
        radius_mm,
        friction,
        centre_mm,
        gel,
    })?;

    let limit = friction * normal_n;
    let spin_limit = 3.0 * std::f64::consts::PI / 16.0 * limit * contact_mm;
    let [pull_x, pull_y] = random.direction();
    let sign = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    // The way on the limit surface: pull alone, twist alone, both.
    let kind = random.unit();
    let turn = if kind < 0.45 {
        0.0
    } else if kind < 0.65 {
        std::f64::consts::FRAC_PI_2
    } else {
        random.uniform(0.0, std::f64::consts::FRAC_PI_2)
    };
    let (sin, cos) = libm::sincos(turn);
    let load = |normal_n: f64, share: f64| Load {
        normal_n,
        shear_n: [share * cos * limit * pull_x, share * cos * limit * pull_y],
        torsion_nmm: share * sin * sign * spin_limit,
    };
    // How far towards gross slip: hardly loaded, anywhere, near slip, in slip.
    let kind = random.unit();
    let share = if kind < 0.1 {
        random.uniform(0.0, 0.1)
    } else if kind < 0.7 {
        random.uniform(0.1, 1.0)
    } else if kind < 0.85 {
        random.uniform(0.9, 1.0)
    } else {
        random.uniform(1.02, 1.5)
    };
    // How it came there: at once, after a larger or opposite load, with another grip before.
    let kind = random.unit();
    if kind < 0.75 {
        contact.step(load(normal_n, 0.0))?;
        if kind > 0.5 {
            contact.step(load(normal_n, random.uniform(-1.0, 1.0)))?;
        }
    } else {
        let before = normal_n * random.uniform(0.5, 1.4);
        contact.step(load(before, 0.0))?;
        contact.step(load(before, random.uniform(-0.8, 0.8)))?;
    }
    contact.step(load(normal_n, share))?;
    Ok(contact)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_repeats_by_seed_and_differs_between_seeds() {
        let take = |seed: u64| SampleGenerator::new(seed).take(10).collect::<Vec<_>>();
        let (first, again, other) = (take(4), take(4), take(5));
        for (a, b) in first.iter().zip(&again) {
            assert!(a.rest == b.rest && a.now == b.now && a.forces == b.forces);
        }
        assert!(first[0].rest != other[0].rest);
        // One pattern serves eight samples.
        assert!(first[0].rest == first[7].rest && first[7].rest != first[8].rest);
    }

    #[test]
    fn samples_cover_what_the_network_has_to_learn() {
        let samples: Vec<Sample> = SampleGenerator::new(11).take(600).collect();
        let share = |f: &dyn Fn(&Sample) -> bool| samples.iter().filter(|s| f(s)).count() as f64 / 600.0;
        let empty = share(&|s| s.true_stick_ratio.is_none());
        assert!(empty > 0.015 && empty < 0.07, "{empty} without contact");
        let gross = share(&|s| s.gross_slip);
        assert!(gross > 0.08 && gross < 0.25, "{gross} in gross slip");
        let partial = share(&|s| s.true_stick_ratio.is_some_and(|r| r > 0.02 && r < 0.5));
        assert!(partial > 0.15, "{partial} with a stick ratio below one half");
        assert!(share(&|s| s.load.normal_n > 5.0) > 0.1 && share(&|s| s.load.normal_n < 0.5) > 0.2);
        assert!(share(&|s| s.load.torsion_nmm.abs() > 1.0) > 0.1);
    }

    #[test]
    fn every_map_balances_its_load_and_obeys_friction() {
        for sample in SampleGenerator::new(12).take(200) {
            let mut sum = [0.0; 3];
            for taxel in sample.forces {
                let [x, y, z] = taxel.map(f64::from);
                assert!(z >= 0.0 && x.hypot(y) <= sample.friction.unwrap_or(0.0) * z * (1.0 + 1e-5) + 1e-9);
                sum = [sum[0] + x, sum[1] + y, sum[2] + z];
            }
            let normal = sample.load.normal_n;
            // Contacts near the edge may reach beyond the map.
            assert!(
                sum[2] <= normal * 1.005 && sum[2] >= normal * 0.9,
                "{sum:?} of {normal}"
            );
        }
    }
}
