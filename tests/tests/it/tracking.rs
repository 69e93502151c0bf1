//! The tracker against the simulated world, which knows where every particle went: how far off it is, how many it
//! loses, how many it mistakes for another, at light and heavy loads, with noise, JPEG and another light.

use std::sync::Arc;

use gripline_network::tracked::{Track, Tracker};
use gripline_simulation::contact_world::{Contact, Drive, GelSurface, Mount, Press, Shape};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image, SeenParticle};

/// A spot farther than this from every particle is none (noise, or what JPEG makes of the ground), pixels.
const SAME_PX: f32 = 2.0;
/// Sensors that are looked at.
const SENSORS: u64 = 3;

/// What became of the spots that are particles.
#[derive(Debug)]
struct Tracked {
    /// Share of the particles within the picture that have a spot.
    seen: f64,
    /// Share of the spots that were lost or doubted.
    lost: f64,
    /// Share of the spots that were followed to a place more than a pixel off.
    wrong: f64,
    /// Median and 90th percentile of the error of those followed, pixels.
    error_px: [f32; 2],
    /// Largest motion in the picture, pixels.
    motion_px: f32,
}

/// A sphere pressed with `load_n` and pulled by `pull_mm`.
fn follow(load_n: f64, pull_mm: [f64; 2], jpeg_quality: Option<u8>) -> Tracked {
    let skin = Arc::new(GelSurface::new(&Gel::default(), 40).unwrap());
    let sphere = Arc::new(Shape::Sphere { radius_mm: 10.0 });
    let mut contact = Contact::new(skin, sphere, 0.8, Mount::default()).unwrap();
    let mut drive = Drive {
        press: Press::Force(load_n),
        at_mm: [3.0, -2.0],
        turn_rad: 0.0,
        tilt_rad: [0.0; 2],
    };
    contact.go_to(drive, 6).unwrap();
    drive.at_mm = [3.0 + pull_mm[0], -2.0 + pull_mm[1]];
    contact.go_to(drive, 6).unwrap();

    let (mut particles, mut spots, mut lost, mut wrong) = (0, 0, 0, 0);
    let (mut errors, mut motion_px) = (Vec::new(), 0.0_f32);
    for unit in 0..SENSORS {
        let params = FingertipParams {
            jpeg_quality,
            ..FingertipParams::of_sensor(unit)
        };
        let mut fingertip = Fingertip::new(unit, params).unwrap();
        let rest = fingertip.mean_rest_image(16);
        let mut now = Image::crop();
        fingertip.set_brightness(1.02 * params.brightness).unwrap();
        fingertip.render(contact.truth(), &mut now);
        let truth = fingertip.particles_under(contact.truth());
        let mut tracker = Tracker::new();
        tracker.set_rest(&rest.pixels);
        tracker.track(&now.pixels);

        let inside = |p: &&SeenParticle| p.rest_px.iter().all(|v| (6.0..434.0).contains(v));
        particles += truth.iter().filter(inside).count();
        for (spot, track) in tracker.particles().iter().zip(tracker.tracks()) {
            // Of particles that hide each other any may be the one that is followed.
            let near: Vec<&SeenParticle> = truth
                .iter()
                .filter(|p| apart(p.rest_px, spot.at_px) < SAME_PX)
                .collect();
            if near.is_empty() {
                continue;
            }
            spots += 1;
            let error = near.iter().map(|p| off(p, track)).fold(f32::MAX, f32::min);
            motion_px = near
                .iter()
                .map(|p| apart(p.now_px, p.rest_px))
                .fold(motion_px, f32::max);
            if track.confidence == 0.0 {
                lost += 1;
            } else {
                wrong += usize::from(error > 1.0);
                errors.push(error);
            }
        }
    }
    errors.sort_by(f32::total_cmp);
    let share = |count: usize, of: usize| count as f64 / of as f64;
    let found = Tracked {
        seen: share(spots, particles),
        lost: share(lost, spots),
        wrong: share(wrong, spots),
        error_px: [errors[errors.len() / 2], errors[errors.len() * 9 / 10]],
        motion_px,
    };
    println!("{load_n} N, pulled {pull_mm:?} mm, JPEG {jpeg_quality:?}: {found:?}");
    found
}

fn apart(a: [f32; 2], b: [f32; 2]) -> f32 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

fn off(particle: &SeenParticle, track: &Track) -> f32 {
    let motion = [0, 1].map(|k| particle.now_px[k] - particle.rest_px[k]);
    apart(motion, track.motion_px)
}

#[test]
fn under_a_light_load_every_particle_is_followed_to_a_fortieth_of_a_pixel() {
    let found = follow(0.5, [0.1, 0.0], None);
    assert!(found.seen > 0.65, "{found:?}");
    assert!(found.lost < 0.005 && found.wrong < 0.0005, "{found:?}");
    assert!(found.error_px[0] < 0.025 && found.error_px[1] < 0.05, "{found:?}");
}

#[test]
fn under_a_heavy_load_few_are_lost_and_fewer_mistaken() {
    let found = follow(3.0, [0.5, 0.3], None);
    assert!(found.motion_px > 6.0, "{found:?}");
    assert!(found.lost < 0.03 && found.wrong < 0.005, "{found:?}");
    assert!(found.error_px[0] < 0.03 && found.error_px[1] < 0.08, "{found:?}");
}

#[test]
fn a_large_drag_loses_particles_rather_than_mistaking_them() {
    let found = follow(8.0, [1.0, 0.6], None);
    assert!(found.motion_px > 15.0, "{found:?}");
    assert!(found.lost < 0.1 && found.wrong < 0.02, "{found:?}");
    assert!(found.error_px[0] < 0.035, "{found:?}");
}

#[test]
fn jpeg_costs_precision_and_particles_but_makes_no_mistakes() {
    let found = follow(2.0, [0.3, 0.2], Some(50));
    assert!(found.lost < 0.1 && found.wrong < 0.005, "{found:?}");
    assert!(found.error_px[0] < 0.07 && found.error_px[1] < 0.15, "{found:?}");
}
