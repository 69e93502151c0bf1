//! From light to gray levels: brightness, lens, sensor noise, rounding. The noise of a pixel follows from its place in
//! the frame and the picture's key alone, so that any window of the frame has the same. Limits: noise of one sigma for
//! all levels, global shutter.

use crate::constants::{CROP_CORNER_PX, CROP_PX, FRAME_PX};
use crate::drawing::{Backdrop, Window};

/// One exposure.
pub(crate) struct Exposure {
    /// Over nominal.
    pub(crate) brightness: f32,
    /// Standard deviation of the noise, gray levels.
    pub(crate) noise_levels: f64,
    /// The noise of a pixel follows from this and from its place in the frame.
    pub(crate) noise_key: u64,
}

impl Exposure {
    /// Gray levels of a window's `picture`, seen through the lens.
    pub(crate) fn expose(&self, backdrop: &Backdrop, picture: &[f32], out: &mut [u8]) {
        // The sum of four random bytes is close to normal: mean 510, sigma √(4·(256²−1)/12).
        const MEAN: i32 = 510;
        const SIGMA: f64 = 147.801;
        let noise_scale = (self.noise_levels / SIGMA) as f32;
        let window = backdrop.window;
        let rows = out.chunks_exact_mut(window.width).zip(
            backdrop
                .lens
                .chunks_exact(window.width)
                .zip(picture.chunks_exact(window.width)),
        );
        for (row, (out, (lens, picture))) in rows.enumerate() {
            let first = ((window.top + row) * FRAME_PX[0] + window.left) as u64 / 2;
            let mut noise = [0_i32; FRAME_PX[0]];
            for (count, pair) in (first..).zip(noise[..window.width].chunks_exact_mut(2)) {
                let bits = scramble(self.noise_key, count);
                let sums = (bits & 0x00ff_00ff_00ff_00ff) + ((bits >> 8) & 0x00ff_00ff_00ff_00ff);
                let sums = (sums & 0x0000_ffff_0000_ffff) + ((sums >> 16) & 0x0000_ffff_0000_ffff);
                pair[0] = (sums as u32) as i32 - MEAN;
                pair[1] = (sums >> 32) as i32 - MEAN;
            }
            for (((out, lens), light), noise) in out.iter_mut().zip(lens).zip(picture).zip(&noise) {
                let level = self.brightness * lens * light + *noise as f32 * noise_scale;
                *out = (level + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    }
}

/// The `count`-th number of the SplitMix64 sequence from `key`: any place of it at once.
fn scramble(key: u64, count: u64) -> u64 {
    let mut z = key.wrapping_add(count.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

// Noise comes in pairs of pixels that begin at even columns.
const _: () = assert!(
    CROP_CORNER_PX[0].is_multiple_of(2)
        && CROP_PX.is_multiple_of(2)
        && Window::CROP_BLOCKS.left.is_multiple_of(2)
);
