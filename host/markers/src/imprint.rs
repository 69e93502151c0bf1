//! A picture with its markers filled in from around them, and the median of several. Pure; grey levels.

use crate::constants::{CHANNELS, EDGE, IMPRINT, WORKING};
use crate::plane::{Plane, Scratch, blur};

/// Working pixels a side of a pixel of the imprint.
const BLOCK: usize = IMPRINT / WORKING;
/// Weights of the Gaussian that fills gaps, sigma two pixels of the imprint: a marker's gap is six wide.
const FILL_TAPS: [f32; 7] = [1.0, 0.882_5, 0.606_5, 0.324_7, 0.135_3, 0.043_9, 0.011_1];
/// Weights of the mean over 3×3 pixels that quiets the noise.
const SMOOTH_TAPS: [f32; 2] = [1.0 / 3.0, 1.0 / 3.0];

/// A picture without its markers: three channels at a quarter of the resolution.
#[derive(Debug, Clone, PartialEq)]
pub struct Filled {
    pub(crate) channels: [Plane; CHANNELS],
}

impl Filled {
    /// Mean over pixels and channels, grey levels.
    #[must_use]
    pub fn mean_level(&self) -> f32 {
        let sum: f32 = self
            .channels
            .iter()
            .map(|plane| plane.values.iter().sum::<f32>())
            .sum();
        sum / (CHANNELS * self.channels[0].values.len()) as f32
    }

    /// Pixel by pixel the median of pictures of one size; `None` of none.
    #[must_use]
    pub fn median(pictures: &[Self]) -> Option<Self> {
        let mut median = pictures.first()?.clone();
        let mut values = Vec::with_capacity(pictures.len());
        for (channel, plane) in median.channels.iter_mut().enumerate() {
            for (pixel, out) in plane.values.iter_mut().enumerate() {
                values.clear();
                values.extend(
                    pictures
                        .iter()
                        .map(|picture| picture.channels[channel].values[pixel]),
                );
                values.sort_by(f32::total_cmp);
                let middle = values.len() / 2;
                *out = if values.len() % 2 == 0 {
                    0.5 * (values[middle - 1] + values[middle])
                } else {
                    values[middle]
                };
            }
        }
        Some(median)
    }
}

/// Fills markers in, and keeps what it needs from picture to picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct Filler {
    marked: Vec<bool>,
    kept: Plane,
    sums: [Plane; CHANNELS],
    around: [Plane; CHANNELS],
    around_kept: Plane,
    scratch: Scratch,
}

impl Filler {
    /// The picture whose working pixels are `channels`, without what is dark.
    pub(crate) fn fill(&mut self, channels: &[Plane; CHANNELS], darkness: &Plane, threshold: f32) -> Filled {
        let [width, height] = [darkness.width, darkness.height];
        let (columns, rows) = (width / BLOCK, height / BLOCK);
        self.mark(darkness, EDGE * threshold);
        for plane in self.sums.iter_mut().chain([&mut self.kept]) {
            plane.width = columns;
            plane.height = rows;
            plane.values.clear();
            plane.values.resize(columns * rows, 0.0);
        }
        for y in 0..height {
            let to = y / BLOCK * columns;
            let marked = &self.marked[y * width..][..width];
            for (x, marked) in marked.iter().enumerate() {
                let keep = f32::from(u8::from(!marked));
                let at = to + x / BLOCK;
                self.kept.values[at] += keep;
                for (sum, channel) in self.sums.iter_mut().zip(channels) {
                    sum.values[at] += keep * channel.values[y * width + x];
                }
            }
        }
        blur(&self.kept, &FILL_TAPS, &mut self.scratch, &mut self.around_kept);
        for (sum, around) in self.sums.iter().zip(&mut self.around) {
            blur(sum, &FILL_TAPS, &mut self.scratch, around);
        }
        let smooth = |scratch: &mut Scratch, sum: &Plane, around: &Plane| {
            let mut filled = Plane::new(columns, rows);
            let whole = (BLOCK * BLOCK) as f32;
            for (at, out) in filled.values.iter_mut().enumerate() {
                let kept = self.kept.values[at];
                let near = around.values[at] / self.around_kept.values[at].max(1e-3);
                *out = (sum.values[at] + (whole - kept) * near) / whole;
            }
            let mut smooth = Plane::new(columns, rows);
            blur(&filled, &SMOOTH_TAPS, scratch, &mut smooth);
            // At the border fewer pixels than nine are there.
            for y in 0..rows {
                for x in 0..columns {
                    let lacking = |at: usize, of: usize| if at == 0 || at + 1 == of { 1.5 } else { 1.0 };
                    smooth.values[y * columns + x] *= lacking(x, columns) * lacking(y, rows);
                }
            }
            smooth
        };
        let channels = [0, 1, 2]
            .map(|channel: usize| smooth(&mut self.scratch, &self.sums[channel], &self.around[channel]));
        Filled { channels }
    }

    /// Marks what is dark, and a pixel around it.
    fn mark(&mut self, darkness: &Plane, edge: f32) {
        let Plane { width, height, .. } = *darkness;
        self.marked.clear();
        self.marked.resize(width * height, false);
        for y in 0..height {
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            for (x, value) in darkness.row(y).iter().enumerate() {
                if *value > edge {
                    for row in rows.clone() {
                        let from = x.saturating_sub(1);
                        self.marked[row * width + from..row * width + (x + 2).min(width)].fill(true);
                    }
                }
            }
        }
    }
}
