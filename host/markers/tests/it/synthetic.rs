//! Markers on drawn pictures, whose centres are known: coloured light, noise, damage, contacts.

use std::path::Path;

use gripline_markers::{Finger, Hold, MarkerError, Node, Rest, RestKind, Tracker};
use gripline_sensor::Sensor;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng as _;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

fn sensor() -> Sensor {
    Sensor::named(Path::new("gelsight-mini")).unwrap()
}

fn seeded(seed: u128) -> Pcg64Mcg {
    Pcg64Mcg::new(seed)
}

/// A number from -1 to 1, all alike.
fn symmetric(random: &mut Pcg64Mcg) -> f32 {
    (random.next_u32() as f32 / u32::MAX as f32).mul_add(2.0, -1.0)
}

/// The centres of a grid that fills the picture, turned a little.
fn grid(pitch: f32) -> Vec<[f32; 2]> {
    let mut centres = Vec::new();
    for row in -1..12 {
        for column in -1..14 {
            let (column, row) = (column as f32, row as f32);
            centres.push([
                14.0 + pitch * (column - 0.03 * row),
                13.0 + pitch * (0.03 * column + row),
            ]);
        }
    }
    centres
}

/// Dots of `diameter` at `centres` under light that is red on one side and blue on the other; `bump` brightens a contact.
fn draw(
    centres: &[[f32; 2]],
    diameter: f32,
    bump: impl Fn(f32, f32) -> f32,
    random: &mut Pcg64Mcg,
) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
            // A marker's edge is a pixel and a half wide, as a lens blurs it.
            let ink = centres
                .iter()
                .filter(|[u, v]| (x - u).abs() < diameter && (y - v).abs() < diameter)
                .map(|[u, v]| {
                    let edge = diameter / 2.0 - ((x - u).powi(2) + (y - v).powi(2)).sqrt();
                    (0.5 + edge / 1.5).clamp(0.0, 1.0)
                })
                .fold(0.0, f32::max);
            let light = [
                60.0 + 90.0 * x / WIDTH as f32,
                120.0 - 30.0 * y / HEIGHT as f32,
                150.0 - 80.0 * x / WIDTH as f32,
            ];
            for (channel, light) in light.into_iter().enumerate() {
                let colour = [1.0, -0.6, 0.3][channel];
                let level = (light + colour * bump(x, y)) * (1.0 - 0.75 * ink);
                // The sum of three even numbers is nearly normal: sigma two grey levels.
                let noise: f32 = (0..3).map(|_| symmetric(random)).sum::<f32>() * 2.0;
                rgb.push((level + noise).round().clamp(0.0, 255.0) as u8);
            }
        }
    }
    rgb
}

fn none(_: f32, _: f32) -> f32 {
    0.0
}

fn nearest(centres: &[[f32; 2]], [x, y]: [f32; 2]) -> (usize, f32) {
    centres
        .iter()
        .enumerate()
        .map(|(index, [u, v])| (index, ((x - u).powi(2) + (y - v).powi(2)).sqrt()))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap()
}

fn middle(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

#[test]
fn centres_are_found_within_a_twentieth_of_a_pixel_for_narrow_and_zoomed_grids() {
    for (pitch, diameter, fewest) in [(31.7, 14.0, 56), (44.0, 20.0, 30)] {
        let centres = grid(pitch);
        let mut random = seeded(1);
        let mut tracker = Tracker::new(&sensor()).unwrap();
        let markers = tracker.see(&draw(&centres, diameter, none, &mut random)).unwrap();
        assert!(markers.len() >= fewest, "{}", markers.len());
        let mut errors: Vec<f32> = markers
            .iter()
            .map(|marker| nearest(&centres, marker.at_px).1)
            .collect();
        let median = middle(&mut errors);
        assert!(
            median <= 0.05 && errors[errors.len() - 1] <= 0.15,
            "pitch {pitch}: {median} {errors:?}"
        );
        let measured = tracker.pitch_px().unwrap();
        assert!((measured - pitch).abs() < 0.3, "{measured}");
    }
}

#[test]
fn still_markers_stay_within_a_twentieth_of_a_pixel_under_noise() {
    let centres = grid(31.7);
    let mut random = seeded(2);
    let mut tracker = Tracker::new(&sensor()).unwrap();
    let mut places: Vec<Vec<[f32; 2]>> = Vec::new();
    for _ in 0..8 {
        let markers = tracker.see(&draw(&centres, 14.0, none, &mut random)).unwrap();
        places.push(markers.iter().map(|marker| marker.at_px).collect());
    }
    for marker in 0..places[0].len() {
        for axis in 0..2 {
            let values: Vec<f32> = places.iter().map(|places| places[marker][axis]).collect();
            let mean = values.iter().sum::<f32>() / 8.0;
            let deviation = (values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / 7.0).sqrt();
            assert!(deviation <= 0.05, "marker {marker}: {deviation}");
        }
    }
}

#[test]
fn every_marker_keeps_its_node_while_gel_and_gaps_move_and_dots_are_hidden() {
    let mut rest = grid(31.7);
    // Damage: three dots are missing for good.
    for gone in [60, 61, 80] {
        rest.remove(gone);
    }
    let mut random = seeded(3);
    let mut tracker = Tracker::new(&sensor()).unwrap();
    let moved = |[x, y]: [f32; 2], step: i32| {
        let near = (-((x - 160.0).powi(2) + (y - 120.0).powi(2)) / 9_000.0).exp();
        let step = step as f32;
        [x + (0.5 + 4.0 * near) * step, y - 2.0 * near * step]
    };
    let mut owners: Vec<(Node, usize)> = Vec::new();
    for step in 0..6 {
        let centres: Vec<_> = rest.iter().map(|centre| moved(*centre, step)).collect();
        // From the fourth picture on a bright reflection hides two dots near the middle.
        let hidden = step >= 3;
        let mut drawn = centres.clone();
        if hidden {
            for _ in 0..2 {
                let (index, _) = nearest(&drawn, moved([170.0, 120.0], step));
                drawn.remove(index);
            }
        }
        let markers = tracker.see(&draw(&drawn, 14.0, none, &mut random)).unwrap();
        if owners.is_empty() {
            owners = markers
                .iter()
                .map(|marker| (marker.node, nearest(&centres, marker.at_px).0))
                .collect();
        }
        let mut lost = 0;
        for (marker, (node, owner)) in markers.iter().zip(&owners) {
            assert_eq!(marker.node, *node);
            let [u, v] = centres[*owner];
            let off = ((marker.at_px[0] - u).powi(2) + (marker.at_px[1] - v).powi(2)).sqrt();
            let inside = (10.0..310.0).contains(&u) && (10.0..230.0).contains(&v);
            lost += usize::from(!marker.seen && inside);
            if inside {
                let bound = if marker.seen { 0.2 } else { 4.0 };
                assert!(
                    off <= bound,
                    "step {step}, {node:?}, seen {}: off {off}",
                    marker.seen
                );
            }
        }
        assert_eq!(lost, if hidden { 2 } else { 0 }, "step {step}");
    }
}

#[test]
fn a_jerk_of_more_than_half_a_pitch_shifts_no_marker_by_a_whole_one_for_longer_than_it_lasts() {
    let rest = grid(44.0);
    let mut random = seeded(6);
    let mut tracker = Tracker::new(&sensor()).unwrap();
    let mut see = |by: f32| {
        let centres: Vec<_> = rest.iter().map(|[x, y]| [x + by, *y]).collect();
        tracker
            .see(&draw(&centres, 20.0, none, &mut random))
            .unwrap()
            .to_vec()
    };
    let before = see(0.0);
    // Further than half a pitch looks like a step to the other side.
    see(26.0);
    see(13.0);
    let after = see(0.0);
    for (before, after) in before.iter().zip(&after) {
        let off = (before.at_px[0] - after.at_px[0]).abs();
        assert!(!after.seen || off < 0.3, "{:?} is {off} px off", before.node);
    }
    assert!(after.iter().filter(|marker| marker.seen).count() * 4 > after.len() * 3);
}

#[test]
fn pictures_without_markers_of_another_size_and_sensors_of_another_kind_are_refused_with_what_to_do() {
    let mut random = seeded(4);
    let mut tracker = Tracker::new(&sensor()).unwrap();
    let bare = tracker.see(&draw(&[], 14.0, none, &mut random)).unwrap_err();
    assert!(
        matches!(bare, MarkerError::NoMarkers { expected: 24, .. })
            && bare.to_string().contains("expected at least 24"),
        "{bare}"
    );
    let small = tracker.see(&[0; 300]).unwrap_err().to_string();
    assert!(small.contains("found 300 bytes, expected 230400"), "{small}");
    let particles = Sensor::named(Path::new("particle-fingertip")).unwrap();
    let refused = Tracker::new(&particles).unwrap_err().to_string();
    assert!(
        refused.contains("particle-fingertip.1") && refused.contains("printed markers"),
        "{refused}"
    );
}

#[test]
fn pictures_of_a_rest_that_show_a_contact_are_told_from_the_untouched_ones() {
    let rest = grid(31.7);
    let mut random = seeded(8);
    let mut finger = Finger::new(&sensor()).unwrap();
    let edge = |x: f32, _: f32| if (120.0..150.0).contains(&x) { 30.0 } else { 0.0 };
    let pictures: Vec<_> = (0..8)
        .map(|number| {
            // Most of them are touched.
            let picture = if number < 3 {
                draw(&rest, 14.0, none, &mut random)
            } else {
                draw(&rest, 14.0, edge, &mut random)
            };
            finger.see(&picture).unwrap().filled
        })
        .collect();
    let expected: Vec<bool> = (0..8).map(|number| number < 3).collect();
    assert_eq!(finger.untouched(&pictures), expected);
    assert!(finger.unevenness(&pictures[5]) > 4.0 * finger.unevenness(&pictures[0]));
    assert!(finger.untouched(&[]).is_empty());
}

/// Evidence of a contact whose markers and texture move by these pixels a picture, after ten still ones.
fn evidence(markers_step: [f32; 2], texture_step: [f32; 2]) -> (f32, f32) {
    let rest = grid(31.7);
    let mut random = seeded(5);
    let mut finger = Finger::new(&sensor()).unwrap();
    let pictures: Vec<_> = (0..5)
        .map(|_| finger.see(&draw(&rest, 14.0, none, &mut random)).unwrap().filled)
        .collect();
    finger.set_rest(Rest::of(&pictures, RestKind::Own));
    let mut hold = Hold::default();
    let (mut still, mut max) = (0.0f32, 0.0f32);
    for picture in 0..16 {
        let step = (picture - 9).max(0) as f32;
        let centres: Vec<_> = rest
            .iter()
            .map(|[x, y]| [x + markers_step[0] * step, y + markers_step[1] * step])
            .collect();
        let texture = |x: f32, y: f32| {
            let (x, y) = (x - texture_step[0] * step, y - texture_step[1] * step);
            let round = (1.0 - ((x - 150.0).powi(2) + (y - 120.0).powi(2)) / 4_900.0).max(0.0);
            40.0 * round * ((x / 9.0).sin() * (y / 11.0).cos())
        };
        let seen = finger.see(&draw(&centres, 14.0, texture, &mut random)).unwrap();
        let Some(found) = seen.comparison.and_then(|comparison| hold.step(&[comparison])) else {
            continue;
        };
        assert!(found.quality > 0.5, "{found:?}");
        if picture < 10 {
            still = still.max(found.slip);
        } else {
            max = max.max(found.slip);
        }
    }
    (still, max)
}

#[test]
fn an_imprint_that_moves_with_the_gel_is_held_and_one_that_moves_over_it_slips() {
    let (still, sheared) = evidence([2.0, -1.0], [2.0, -1.0]);
    let (_, slid) = evidence([0.0, 0.0], [4.0, 2.0]);
    assert!(still < 0.15, "still {still}");
    assert!(sheared < 0.25, "sheared {sheared}");
    assert!(slid > 0.5, "slid {slid}");
}
