//! Markers of real gels: GelSight Mini clips of grasps, a few of every kind. Needs the recordings and ffmpeg.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use gripline_capture::clip::ColourClip;
use gripline_markers::{Finger, Marker, Rest, RestKind, Tracker};
use gripline_sensor::Sensor;

/// Frames in which the hand is open before the grasp.
const REST: std::ops::Range<usize> = 12..20;
/// Energy of an imprint that was certainly there and of one that is gone, squared grey levels per pixel.
const HELD_ENERGY: f32 = 16.0;
const GONE_ENERGY: f32 = 8.0;
/// Every so many trials one is looked at.
const STRIDE: usize = 3;

/// The folder, and the trials of the list with this many frames at most.
fn trials(frames_max: usize) -> Option<(PathBuf, Vec<String>)> {
    let Some(base) = std::env::var_os("GRIPLINE_RECORDINGS") else {
        println!("skipped: recordings not found, set GRIPLINE_RECORDINGS");
        return None;
    };
    let folder = Path::new(&base).join("gelsight-mini");
    let list = std::fs::read_to_string(folder.join("trials.csv")).unwrap();
    let names = list.lines().skip(1).filter_map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let frames: usize = cells[3].parse().unwrap();
        (frames <= frames_max && cells[2] == "0").then(|| cells[0].to_owned())
    });
    let names: Vec<_> = names.step_by(STRIDE).collect();
    assert!(!names.is_empty());
    Some((folder, names))
}

/// The markers of the clip's frames from `first` on.
fn follow(path: &Path, first: usize) -> Vec<Vec<Marker>> {
    let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
    let mut clip = ColourClip::open(path, &sensor.capture).unwrap();
    let mut tracker = Tracker::new(&sensor).unwrap();
    let mut frames = Vec::new();
    for picture in std::iter::from_fn(|| clip.next_picture()).skip(first) {
        frames.push(tracker.see(&picture).unwrap().to_vec());
    }
    clip.finish().unwrap();
    frames
}

/// Whether something was held, and nothing is at the end: by the imprint, which knows nothing of where markers are at rest.
fn released(path: &Path) -> bool {
    let sensor = Sensor::named(Path::new("gelsight-mini")).unwrap();
    let mut clip = ColourClip::open(path, &sensor.capture).unwrap();
    let mut finger = Finger::new(&sensor).unwrap();
    let (mut pictures, mut energies) = (Vec::new(), Vec::new());
    for picture in std::iter::from_fn(|| clip.next_picture()).skip(REST.start) {
        let seen = finger.see(&picture).unwrap();
        pictures.push(seen.filled);
        if pictures.len() == REST.len() {
            finger.set_rest(Rest::of(&pictures, RestKind::Own));
        }
        energies.extend(seen.comparison.map(|comparison| comparison.energy));
    }
    let held = energies.iter().copied().fold(0.0, f32::max) > HELD_ENERGY;
    held && energies[energies.len() - 5..]
        .iter()
        .all(|energy| *energy < GONE_ENERGY)
}

fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

fn mean(places: &[[f32; 2]]) -> [f32; 2] {
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f32>() / places.len() as f32)
}

#[test]
fn still_markers_stay_and_come_back_after_release() {
    let Some((folder, trials)) = trials(300) else {
        return;
    };
    let (mut still, mut back) = (Vec::new(), Vec::new());
    for trial in trials {
        for camera in ["camera_0.avi", "camera_2.avi"] {
            let path = folder.join(&trial).join(camera);
            let frames = follow(&path, REST.start);
            let rest = &frames[..REST.len()];
            let (mut deviations, mut distances) = (Vec::new(), Vec::new());
            for marker in 0..frames[0].len() {
                let places: Vec<_> = rest.iter().map(|frame| frame[marker].at_px).collect();
                let at_rest = mean(&places);
                for axis in 0..2 {
                    let squares = places.iter().map(|place| (place[axis] - at_rest[axis]).powi(2));
                    deviations.push((squares.sum::<f32>() / (places.len() - 1) as f32).sqrt());
                }
                let end: Vec<_> = frames[frames.len() - 5..]
                    .iter()
                    .map(|frame| frame[marker])
                    .collect();
                if end.iter().all(|marker| marker.seen) {
                    let end: Vec<_> = end.iter().map(|marker| marker.at_px).collect();
                    let [x, y] = mean(&end);
                    distances.push(((x - at_rest[0]).powi(2) + (y - at_rest[1]).powi(2)).sqrt());
                }
            }
            still.push(median(&mut deviations));
            if released(&path) {
                back.push(median(&mut distances));
            }
        }
    }
    println!("still {still:.3?} px, back {back:.2?} px");
    assert!(median(&mut still) <= 0.05, "{still:?}");
    assert!(median(&mut back) <= 0.3, "{back:?}");
}

#[test]
fn every_marker_is_one_and_the_same_through_a_clip() {
    let Some((folder, trials)) = trials(450) else {
        return;
    };
    for trial in trials.iter().step_by(4) {
        let frames = follow(&folder.join(trial).join("camera_0.avi"), REST.start);
        let nodes = |frame: &[Marker]| frame.iter().map(|marker| marker.node).collect::<Vec<_>>();
        let first = nodes(&frames[0]);
        assert!((24..=84).contains(&first.len()), "{trial}: {}", first.len());
        assert_eq!(
            first.iter().collect::<BTreeSet<_>>().len(),
            first.len(),
            "{trial}"
        );
        for frame in &frames {
            assert_eq!(nodes(frame), first, "{trial}");
            let seen: Vec<_> = frame.iter().filter(|marker| marker.seen).collect();
            assert!(seen.len() * 10 >= frame.len() * 5, "{trial}: {} seen", seen.len());
            // Neighbours keep their sides: columns grow along x, rows along y.
            for marker in &seen {
                for other in &seen {
                    if other.node.row == marker.node.row && other.node.column == marker.node.column + 1 {
                        assert!(other.at_px[0] > marker.at_px[0] + 5.0, "{trial}");
                    }
                    if other.node.column == marker.node.column && other.node.row == marker.node.row + 1 {
                        assert!(other.at_px[1] > marker.at_px[1] + 5.0, "{trial}");
                    }
                }
            }
        }
    }
}
