//! Pooling: the largest of 2×2 pixels.

use super::plane::Plane;
use super::region::Region;

/// 2×2 maximum with stride 2, for the output pixels of `region`. Reads as many input channels as the output has, from
/// `in_channel` on. NaN wins. A last odd row or column of the input is ignored.
pub fn max_pool(input: &Plane, in_channel: usize, output: &mut Plane, region: &Region) {
    let (wide, channels) = (input.channels(), output.channels());
    for y in region.rows.clone() {
        let (top, bottom) = (input.row(2 * y), input.row(2 * y + 1));
        let line = output.row_mut(y);
        for x in region.columns.clone() {
            let left = 2 * x * wide + in_channel;
            let right = left + wide;
            let corners = [
                &top[left..left + channels],
                &top[right..right + channels],
                &bottom[left..left + channels],
                &bottom[right..right + channels],
            ];
            let out = &mut line[x * channels..(x + 1) * channels];
            for (channel, out) in out.iter_mut().enumerate() {
                let corner = corners.map(|corner| corner[channel]);
                *out = larger(larger(corner[0], corner[1]), larger(corner[2], corner[3]));
            }
        }
    }
}

fn larger(a: f32, b: f32) -> f32 {
    if a > b || a.is_nan() { a } else { b }
}

/// The output pixels that see one of the input's `changed` pixels.
pub(crate) fn affected(changed: &Region, out_size: (usize, usize)) -> Region {
    changed.mapped(out_size, |first, last| (first / 2, last / 2))
}
