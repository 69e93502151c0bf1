//! Tests of the capture's public side.

mod cameras;
mod clips;
mod events;
mod jpegs;
mod pixels;

use gripline_capture::geometry::{CROP_ORIGIN, CROP_SIDE, FRAME};

/// A smooth frame whose every region differs.
fn smooth_frame() -> Vec<u8> {
    (0..FRAME.pixels())
        .map(|i| {
            let (x, y) = ((i % FRAME.width) as f64, (i / FRAME.width) as f64);
            (110.0 + 60.0 * (x / 37.0).sin() + 50.0 * (y / 23.0).cos()) as u8
        })
        .collect()
}

/// The middle of a frame, pixel by pixel.
fn middle(frame: &[u8]) -> Vec<u8> {
    let [left, top] = CROP_ORIGIN;
    (0..CROP_SIDE * CROP_SIDE)
        .map(|i| frame[(i / CROP_SIDE + top) * FRAME.width + i % CROP_SIDE + left])
        .collect()
}

/// Greatest difference of two pictures, grey levels.
fn greatest_difference(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}
