//! Where a picture is darker (or brighter) than what surrounds it, and the blobs of that. Pure; working pixels.

use gripline_sensor::Polarity;

use crate::constants::{ASPECT_MAX, CENTRE_EDGE, THRESHOLD_MIN};
use crate::plane::{Plane, Scratch, close};

/// Levels of the histogram that the threshold is read from.
const BINS: usize = 128;
/// Light below which a share of it says nothing, grey levels.
const LIGHT_MIN: f32 = 8.0;

/// Turns the mean of the channels into the share of the surrounding light that is missing: 0 between markers, towards 1 in them,
/// the same under weak and strong light. For bright markers the picture is taken as its negative.
pub(crate) fn darkness(
    grey: &mut Plane,
    polarity: Polarity,
    side: usize,
    scratch: &mut Scratch,
    around: &mut Plane,
    to: &mut Plane,
) {
    if polarity == Polarity::Bright {
        for value in &mut grey.values {
            *value = 255.0 - *value;
        }
    }
    close(grey, side, scratch, around);
    to.width = grey.width;
    to.height = grey.height;
    to.values.resize(grey.values.len(), 0.0);
    for ((to, grey), around) in to.values.iter_mut().zip(&grey.values).zip(&around.values) {
        *to = (around - grey) / around.max(LIGHT_MIN);
    }
}

/// The darkness that best parts markers from the rest (Otsu 1979).
pub(crate) fn threshold(darkness: &Plane) -> f32 {
    let mut counts = [0.0f64; BINS];
    for value in &darkness.values {
        counts[((value.clamp(0.0, 1.0) * BINS as f32) as usize).min(BINS - 1)] += 1.0;
    }
    let all: f64 = counts.iter().sum();
    let total: f64 = counts
        .iter()
        .enumerate()
        .map(|(bin, count)| bin as f64 * count)
        .sum();
    let (mut below, mut sum, mut best) = (0.0, 0.0, (0.0, 0));
    for (bin, count) in counts.iter().enumerate() {
        below += count;
        sum += bin as f64 * count;
        if below == 0.0 || below >= all {
            continue;
        }
        let apart = sum / below - (total - sum) / (all - below);
        let variance = below * (all - below) * apart * apart;
        if variance > best.0 {
            best = (variance, bin + 1);
        }
    }
    (best.1 as f32 / BINS as f32).max(THRESHOLD_MIN)
}

/// A dark blob.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Blob {
    /// Its centre; pixel (0, 0) is centred on (0.5, 0.5).
    pub(crate) centre: [f32; 2],
    /// Whether it reaches the picture's border, so that the centre is that of a part.
    pub(crate) cut: bool,
}

/// Finds blobs, and keeps what it needs from picture to picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct BlobFinder {
    seen: Vec<bool>,
    open: Vec<usize>,
}

impl BlobFinder {
    /// The blobs above `threshold` whose area in pixels lies in `area`.
    pub(crate) fn find(&mut self, darkness: &Plane, threshold: f32, area: [f32; 2], blobs: &mut Vec<Blob>) {
        let Plane { width, height, .. } = *darkness;
        blobs.clear();
        self.seen.clear();
        self.seen.resize(width * height, false);
        for start in 0..width * height {
            if self.seen[start] || darkness.values[start] <= threshold {
                continue;
            }
            self.seen[start] = true;
            self.open.push(start);
            let (mut left, mut top, mut right, mut bottom) = (width, height, 0, 0);
            let mut count = 0;
            while let Some(pixel) = self.open.pop() {
                let (x, y) = (pixel % width, pixel / width);
                count += 1;
                (left, top, right, bottom) = (left.min(x), top.min(y), right.max(x), bottom.max(y));
                let mut visit = |neighbour: usize| {
                    if !self.seen[neighbour] && darkness.values[neighbour] > threshold {
                        self.seen[neighbour] = true;
                        self.open.push(neighbour);
                    }
                };
                if x > 0 {
                    visit(pixel - 1);
                }
                if x + 1 < width {
                    visit(pixel + 1);
                }
                if y > 0 {
                    visit(pixel - width);
                }
                if y + 1 < height {
                    visit(pixel + width);
                }
            }
            let sides = [(right - left + 1) as f32, (bottom - top + 1) as f32];
            let cut = left == 0 || top == 0 || right + 1 == width || bottom + 1 == height;
            let is_round = sides[0].max(sides[1]) <= ASPECT_MAX * sides[0].min(sides[1]);
            if (area[0]..=area[1]).contains(&(count as f32)) && (is_round || cut) {
                let box_px = [left, top, right, bottom];
                blobs.push(Blob {
                    centre: centre(darkness, threshold, box_px),
                    cut,
                });
            }
        }
    }
}

/// The centre of the darkness in a box and two pixels around it.
fn centre(darkness: &Plane, threshold: f32, [left, top, right, bottom]: [usize; 4]) -> [f32; 2] {
    let edge = CENTRE_EDGE * threshold;
    let (mut mass, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
    let columns = left.saturating_sub(2)..(right + 3).min(darkness.width);
    for y in top.saturating_sub(2)..(bottom + 3).min(darkness.height) {
        for (x, value) in columns.clone().zip(&darkness.row(y)[columns.clone()]) {
            let weight = (value - edge).max(0.0);
            mass += weight;
            x_sum += weight * (x as f32 + 0.5);
            y_sum += weight * (y as f32 + 0.5);
        }
    }
    [x_sum / mass, y_sum / mass]
}
