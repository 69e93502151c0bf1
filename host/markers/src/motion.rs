//! The gel's motion between two pictures, from its markers', and an imprint carried along with it. Pure; pixels.

use crate::constants::{CHANNELS, IMPRINT, MOTION_SIGMA};
use crate::imprint::Filled;
use crate::plane::Plane;

/// Pixels of the imprint from node to node of the coarse field.
const STEP: usize = 4;

/// The motion of the whole gel: what takes a place of now back to where it was, pixels of the imprint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Motion {
    x: Plane,
    y: Plane,
}

impl Motion {
    /// From markers that were at the first place and are now at the second, pixels of the crop; they are spread over the gel
    /// with weights that fall with the distance from where they are now.
    pub(crate) fn between(
        moves: &[([f32; 2], [f32; 2])],
        pitch_px: f32,
        columns: usize,
        rows: usize,
    ) -> Self {
        let (width, height) = (columns.div_ceil(STEP) + 1, rows.div_ceil(STEP) + 1);
        let (mut x, mut y) = (Plane::new(width, height), Plane::new(width, height));
        let narrow = -0.5 / (MOTION_SIGMA * pitch_px).powi(2);
        for v in 0..height {
            for u in 0..width {
                let at = [(u * STEP * IMPRINT) as f32, (v * STEP * IMPRINT) as f32];
                let (mut weights, mut sums) = (1e-9, [0.0; 2]);
                for (from, to) in moves {
                    let squared = (to[0] - at[0]).powi(2) + (to[1] - at[1]).powi(2);
                    let weight = (narrow * squared).exp();
                    weights += weight;
                    sums[0] += weight * (to[0] - from[0]);
                    sums[1] += weight * (to[1] - from[1]);
                }
                x.values[v * width + u] = sums[0] / weights / IMPRINT as f32;
                y.values[v * width + u] = sums[1] / weights / IMPRINT as f32;
            }
        }
        Self { x, y }
    }

    /// The imprint as it would be now.
    pub(crate) fn carry(&self, imprint: &Filled) -> Filled {
        let [columns, rows] = [imprint.channels[0].width, imprint.channels[0].height];
        let mut carried = Filled {
            channels: [0; CHANNELS].map(|_| Plane::new(columns, rows)),
        };
        for y in 0..rows {
            for x in 0..columns {
                let (u, v) = ((x as f32 + 0.5) / STEP as f32, (y as f32 + 0.5) / STEP as f32);
                let from = [x as f32 - self.x.between(u, v), y as f32 - self.y.between(u, v)];
                for (to, channel) in carried.channels.iter_mut().zip(&imprint.channels) {
                    to.values[y * columns + x] = channel.between(from[0], from[1]);
                }
            }
        }
        carried
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imprint(at: [f32; 2]) -> Filled {
        let mut plane = Plane::new(80, 60);
        for y in 0..60 {
            for x in 0..80 {
                let squared = (x as f32 + 0.5 - at[0]).powi(2) + (y as f32 + 0.5 - at[1]).powi(2);
                plane.values[y * 80 + x] = 30.0 * (-squared / 18.0).exp();
            }
        }
        Filled {
            channels: [plane.clone(), plane.clone(), plane],
        }
    }

    #[test]
    fn an_imprint_is_carried_as_far_as_the_markers_moved() {
        let markers: Vec<_> = (0..70)
            .map(|index| {
                let from = [
                    16.0 + 32.0 * (index % 10) as f32,
                    16.0 + 32.0 * (index / 10) as f32,
                ];
                (from, [from[0] + 6.0, from[1] - 4.0])
            })
            .collect();
        let motion = Motion::between(&markers, 32.0, 80, 60);
        let carried = motion.carry(&imprint([40.0, 30.0]));
        let expected = imprint([41.5, 29.0]);
        let off = carried.channels[1]
            .values
            .iter()
            .zip(&expected.channels[1].values)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(off < 1.0, "{off}");
    }
}
