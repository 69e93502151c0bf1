//! Quality of pictures of the untouched sensor surface: light, focus, particles, noise, motion, and the change since an earlier
//! picture. Pure; for `gripline calibrate rest` and `gripline doctor`. 440×440 grey crops, grey levels, pixels.
//! Limits: an object that lies still on the surface shows only against an earlier picture.

use gripline_network::constants::CROP_SIDE;
use gripline_network::tracked::Tracker;

/// From this level a pixel is saturated.
const SATURATED: u8 = 253;
/// Distances of the fine and the coarse detail that sharpness compares, pixels: within a particle, and across one.
const DETAIL: [usize; 2] = [1, 4];
/// Side of the parts of the surface that are tracked as one, pixels, and parts per side.
const PART: usize = 44;
const PARTS: usize = CROP_SIDE / PART;
/// Minimum number of tracked particles to judge a part by.
const VOTES: usize = 6;
/// Groups of consecutive pictures that are compared to detect motion.
const GROUPS: usize = 4;

/// Limits that good pictures keep.
pub mod limit {
    /// Minimum and maximum mean level; those of the network's health.
    pub const LEVEL: [f64; 2] = [15.0, 120.0];
    /// Maximum share of saturated pixels: a few bright particles saturate.
    pub const SATURATED: f64 = 0.01;
    /// Minimum number of particles: half of the sparsest simulated sensor.
    pub const PARTICLES: usize = 900;
    /// Minimum sharpness: simulated sensors have 0.22 to 0.23, defocused ones 0.07.
    pub const SHARPNESS: f64 = 0.15;
    /// Maximum motion of a part of an untouched surface, pixels: the lightest touch that counts moves it more.
    pub const STILL_PX: f64 = 0.1;
    /// Maximum common motion since calibration, pixels: more means that camera and gel moved against each other.
    pub const DRIFT_PX: f64 = 0.3;
    /// Maximum share of lost particles: as the network allows.
    pub const LOST: f64 = 0.3;
    /// Maximum change of the mean level since calibration that is good, and that the network still accepts, shares.
    pub const LIGHT: [f64; 2] = [0.1, 0.25];
}

/// Measured quality of pictures of one surface at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Their mean, rounded to nearest.
    pub mean: Vec<u8>,
    /// Grey levels.
    pub mean_level: f64,
    /// Mean level of the darkest and of the brightest picture.
    pub level_range: [f64; 2],
    /// Share of saturated pixels.
    pub saturated_share: f64,
    /// Particles found.
    pub particles: usize,
    /// Mean square of fine over that of coarse differences, noise taken out.
    pub sharpness: f64,
    /// Standard deviation of a pixel from picture to picture, grey levels.
    pub noise_levels: f64,
    /// Maximum motion of a part of the surface during the pictures, pixels; 0 for fewer than two pictures.
    pub moved_px: f64,
}

/// How a picture differs from an earlier one of the same surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Motion that all parts have in common, pixels.
    pub drift_px: f64,
    /// Maximum motion of a part relative to it, pixels.
    pub dent_px: f64,
    /// Share of the particles that were not found again.
    pub lost: f64,
    /// Mean level over the earlier one.
    pub light: f64,
}

impl Figures {
    /// From pictures in order of time.
    ///
    /// # Panics
    /// When there is no picture, or one is not 440×440: sources guarantee both.
    #[must_use]
    pub fn of(pictures: &[Vec<u8>]) -> Self {
        let mean = mean(pictures);
        let mean_level = level(&mean);
        let levels = || pictures.iter().map(|picture| level(picture));
        let saturated = mean.iter().filter(|&&pixel| pixel >= SATURATED).count();
        let mut tracker = Tracker::new();
        tracker.set_rest(&mean);
        let noise_levels = noise(pictures);
        Self {
            mean_level,
            level_range: [
                levels().fold(f64::INFINITY, f64::min),
                levels().fold(0.0, f64::max),
            ],
            saturated_share: saturated as f64 / mean.len() as f64,
            particles: tracker.particles().len(),
            sharpness: sharpness(&mean, noise_levels * noise_levels / pictures.len() as f64),
            noise_levels,
            moved_px: moved(pictures),
            mean,
        }
    }
}

impl Change {
    /// From `before` to `now`.
    pub fn between(before: &[u8], now: &[u8]) -> Self {
        let mut tracker = Tracker::new();
        tracker.set_rest(before);
        tracker.track(now);
        let mut parts: Vec<[Vec<f32>; 2]> = vec![Default::default(); PARTS * PARTS];
        // Where nothing can be followed, nothing is found again.
        let mut lost = u32::from(tracker.particles().is_empty());
        for (particle, track) in tracker.particles().iter().zip(tracker.tracks()) {
            if track.confidence == 0.0 {
                lost += 1;
                continue;
            }
            let [column, row] = particle.at_px.map(|at| (at as usize / PART).min(PARTS - 1));
            for (all, motion) in parts[row * PARTS + column].iter_mut().zip(track.motion_px) {
                all.push(motion);
            }
        }
        let motions: Vec<[f64; 2]> = parts
            .iter_mut()
            .filter(|[x, _]| x.len() >= VOTES)
            .map(|part| part.each_mut().map(|all| median(all)))
            .collect();
        let common =
            [0, 1].map(|axis| median(&mut motions.iter().map(|m| m[axis] as f32).collect::<Vec<_>>()));
        let beside = motions
            .iter()
            .map(|[x, y]| (x - common[0]).hypot(y - common[1]))
            .fold(0.0, f64::max);
        Self {
            drift_px: common[0].hypot(common[1]),
            dent_px: beside,
            lost: f64::from(lost) / tracker.particles().len().max(1) as f64,
            light: level(now) / level(before).max(1e-9),
        }
    }
}

/// Pixel by pixel, rounded to nearest.
#[must_use]
pub fn mean(pictures: &[Vec<u8>]) -> Vec<u8> {
    let count = pictures.len() as u32;
    (0..CROP_SIDE * CROP_SIDE)
        .map(|pixel| {
            let sum: u32 = pictures.iter().map(|picture| u32::from(picture[pixel])).sum();
            ((sum + count / 2) / count) as u8
        })
        .collect()
}

fn level(picture: &[u8]) -> f64 {
    picture.iter().map(|&pixel| f64::from(pixel)).sum::<f64>() / picture.len() as f64
}

/// From pairs of consecutive pictures, so that slow changes of the light do not count.
fn noise(pictures: &[Vec<u8>]) -> f64 {
    let pairs = pictures.windows(2);
    let count = pairs.len() * CROP_SIDE * CROP_SIDE;
    let squares: f64 = pairs
        .flat_map(|pair| pair[0].iter().zip(&pair[1]))
        .map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))
        .sum();
    (0.5 * squares / count.max(1) as f64).sqrt()
}

/// `noise_square`: variance of the noise left in the picture, levels squared.
fn sharpness(picture: &[u8], noise_square: f64) -> f64 {
    let squares = DETAIL.map(|apart| {
        let mut sum = 0.0;
        for row in picture.chunks_exact(CROP_SIDE) {
            let pairs = row.iter().zip(&row[apart..]);
            sum += pairs
                .map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))
                .sum::<f64>()
                / (CROP_SIDE - apart) as f64;
        }
        (sum / CROP_SIDE as f64 - 2.0 * noise_square).max(0.0)
    });
    if squares[1] > 0.0 {
        squares[0] / squares[1]
    } else {
        0.0
    }
}

/// Maximum motion of a part between the first pictures and later ones, common motion included.
fn moved(pictures: &[Vec<u8>]) -> f64 {
    let groups: Vec<Vec<u8>> = pictures
        .chunks(pictures.len().div_ceil(GROUPS).max(1))
        .map(mean)
        .collect();
    let later = groups.iter().skip(1);
    later
        .map(|group| {
            let change = Change::between(&groups[0], group);
            // What cannot be tracked has moved far.
            let lost = if change.lost > limit::LOST {
                f64::INFINITY
            } else {
                0.0
            };
            (change.drift_px + change.dent_px).max(lost)
        })
        .fold(0.0, f64::max)
}

fn median(values: &mut [f32]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f32::total_cmp);
    f64::from(values[values.len() / 2])
}

#[cfg(test)]
mod tests {
    use gripline_simulation::{CameraFault, Fingertip, FingertipParams, GripScene, Image};

    use super::*;

    fn rest(sensor: u64, count: usize) -> Vec<Vec<u8>> {
        let mut fingertip = Fingertip::new(sensor, FingertipParams::of_sensor(sensor)).unwrap();
        (0..count).map(|_| fingertip.rest_image().pixels).collect()
    }

    #[test]
    fn good_pictures_of_many_sensors_keep_every_limit() {
        for sensor in 100..108 {
            let pictures = rest(sensor, 8);
            let figures = Figures::of(&pictures);
            let change = Change::between(&figures.mean, &mean(&rest(sensor, 12)[8..]));
            println!(
                "sensor {sensor}: level {:.1}, saturated {:.4}, particles {}, sharpness {:.3}, noise {:.2}, moved {:.3}; \
                 {change:?}",
                figures.mean_level,
                figures.saturated_share,
                figures.particles,
                figures.sharpness,
                figures.noise_levels,
                figures.moved_px
            );
            assert!(figures.mean_level > limit::LEVEL[0] && figures.mean_level < limit::LEVEL[1]);
            assert!(figures.saturated_share < limit::SATURATED);
            assert!(figures.particles > limit::PARTICLES);
            assert!(figures.sharpness > limit::SHARPNESS);
            assert!(figures.moved_px < limit::STILL_PX);
            assert!(
                change.drift_px < limit::DRIFT_PX && change.dent_px < limit::STILL_PX && change.lost < 0.05
            );
        }
    }

    #[test]
    fn noise_is_the_sensors_own() {
        let params = FingertipParams {
            noise_levels: 3.0,
            ..FingertipParams::default()
        };
        let mut fingertip = Fingertip::new(1, params).unwrap();
        let pictures: Vec<_> = (0..4).map(|_| fingertip.rest_image().pixels).collect();
        let found = Figures::of(&pictures).noise_levels;
        // Rounding adds 1/12; clipping at black removes a little.
        assert!((found - 3.0).abs() < 0.1, "{found}");
    }

    #[test]
    fn a_lens_out_of_focus_loses_its_sharpness_and_light_does_not() {
        let sharp = rest(3, 2);
        let other = |fault: CameraFault| -> Vec<Vec<u8>> {
            let of = |pixels: &Vec<u8>| {
                let mut image = Image::crop();
                image.pixels.clone_from(pixels);
                fault.of(&image, 1).pixels
            };
            sharp.iter().map(of).collect()
        };
        let figures = Figures::of(&sharp);
        let blurred = Figures::of(&other(CameraFault::Defocused));
        let led = Figures::of(&other(CameraFault::LedOut));
        println!("{} {} {}", figures.sharpness, blurred.sharpness, led.sharpness);
        assert!(
            blurred.sharpness < 0.5 * limit::SHARPNESS,
            "{}",
            blurred.sharpness
        );
        assert!(
            (led.sharpness / figures.sharpness - 1.0).abs() < 0.1,
            "{}",
            led.sharpness
        );
        assert!(Figures::of(&other(CameraFault::White)).saturated_share > 0.99);
        assert!(Figures::of(&other(CameraFault::Black)).mean_level < limit::LEVEL[0]);
    }

    #[test]
    fn a_light_touch_moves_a_part_of_the_skin_and_a_shifted_camera_all_of_it() {
        let mut scene = GripScene::new(5);
        let before: Vec<_> = (0..8).map(|_| scene.rest_image().pixels).collect();
        let before = mean(&before);
        let touched = loop {
            let frame = scene.step(0.02, 0.3).unwrap();
            if frame.touching && frame.load.normal_n >= 0.299 {
                break frame.image.pixels;
            }
        };
        let touch = Change::between(&before, &touched);
        assert!(touch.dent_px > 2.0 * limit::STILL_PX, "{touch:?}");
        assert!(touch.drift_px < limit::DRIFT_PX, "{touch:?}");
        // One pixel to the right.
        let shifted: Vec<u8> = (0..before.len()).map(|at| before[at.saturating_sub(1)]).collect();
        let shift = Change::between(&before, &shifted);
        assert!(
            (shift.drift_px - 1.0).abs() < 0.05 && shift.dent_px < limit::STILL_PX,
            "{shift:?}"
        );
    }

    #[test]
    fn where_nothing_can_be_followed_everything_is_lost_and_may_have_moved() {
        let good = rest(7, 12);
        let flat = vec![60; good[0].len()];
        assert!(Change::between(&flat, &good[0]).lost > limit::LOST);
        let flat_first = [vec![flat; 4], good].concat();
        assert!(Figures::of(&flat_first).moved_px > limit::STILL_PX);
    }

    #[test]
    fn a_touch_while_pictures_are_taken_is_seen() {
        let mut scene = GripScene::new(6);
        let mut pictures: Vec<_> = (0..12).map(|_| scene.rest_image().pixels).collect();
        assert!(Figures::of(&pictures).moved_px < limit::STILL_PX);
        while !scene.step(0.02, 0.5).unwrap().touching {}
        for _ in 0..4 {
            pictures.push(scene.step(0.02, 0.5).unwrap().image.pixels);
        }
        let moved = Figures::of(&pictures).moved_px;
        assert!(moved > limit::STILL_PX, "{moved}");
    }
}
