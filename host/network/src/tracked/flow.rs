//! Where the surroundings of each node of a coarse grid went: block matching from an eighth of the resolution to a
//! quarter, so that a motion of several particles' distances is followed without mistaking one for another. Finer
//! windows hold too few particles that move alike: the shallow ones outrun the deep ones.

use super::pyramid::{Level, Pyramid};
use crate::constants::CROP_SIDE;

/// Side of the compared windows, pixels of their level.
const WINDOW: usize = 8;
/// Pixels between nodes.
const STEP: usize = 5;
/// The levels of the pyramid that are matched, coarsest first, and the pixels searched around the prediction.
const LEVELS: [(usize, i32); 2] = [(3, 4), (2, 2)];
/// Farthest motion of a node, pixels of its level: windows stay inside the border.
const FARTHEST: f32 = 15.0;
/// From how many pixels on a node's motion and its neighbours' median are different motions.
const DIFFERENT: f32 = 0.75;

/// The nodes of both levels.
#[derive(Debug, Clone)]
pub(super) struct Flow {
    levels: [Nodes; LEVELS.len()],
}

/// One level's nodes: motion in the level's pixels.
#[derive(Debug, Clone)]
struct Nodes {
    per_side: usize,
    /// As matched.
    raw: Vec<[f32; 2]>,
    /// Without single mistakes.
    motion: Vec<[f32; 2]>,
}

impl Flow {
    pub(super) fn new() -> Self {
        let nodes = |(level, _): (usize, i32)| {
            let per_side = (CROP_SIDE >> level) / STEP;
            let still = vec![[0.0; 2]; per_side * per_side];
            Nodes {
                per_side,
                raw: still.clone(),
                motion: still,
            }
        };
        Self {
            levels: LEVELS.map(nodes),
        }
    }

    /// Motion from `rest` to `now`. No allocation.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn find(&mut self, rest: &Pyramid, now: &Pyramid) {
        for (index, (level, reach)) in LEVELS.into_iter().enumerate() {
            let (coarser, finer) = self.levels.split_at_mut(index);
            finer[0].find(coarser.last(), &rest.0[level], &now.0[level], reach);
        }
    }

    /// Motion at a place of the crop, pixels of the crop.
    pub(super) fn at(&self, place_px: [f32; 2]) -> [f32; 2] {
        let [.., (level, _)] = LEVELS;
        let [.., nodes] = &self.levels;
        let scale = (1 << level) as f32;
        nodes.at(place_px.map(|p| p / scale)).map(|v| v * scale)
    }
}

impl Nodes {
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn find(&mut self, coarser: Option<&Self>, rest: &Level, now: &Level, reach: i32) {
        for node in 0..self.raw.len() {
            let centre = self.centre(node);
            let window = Window::new(rest, centre);
            let mut guess = [0; 2];
            if let Some(coarser) = coarser {
                let place = centre.map(|c| 0.5 * (c as f32 + 0.5));
                let mut least = u32::MAX;
                for motion in coarser.around(place) {
                    let motion = motion.map(|v| whole(2.0 * v));
                    let cost = window.cost(now, motion);
                    if cost < least {
                        (least, guess) = (cost, motion);
                    }
                }
            }
            self.raw[node] = window.best(now, guess, reach);
        }
        self.smooth(rest, now);
    }

    /// Pixel of a node: the middle one of its cell.
    fn centre(&self, node: usize) -> [i32; 2] {
        [node % self.per_side, node / self.per_side].map(|index| (index * STEP + STEP / 2) as i32)
    }

    /// First node of the four around a place in pixels of the level, and how far from it towards the others.
    fn cell(&self, place: [f32; 2]) -> ([usize; 2], [f32; 2]) {
        let most = (self.per_side - 1) as f32;
        let cell = place.map(|p| ((p - 0.5 - (STEP / 2) as f32) / STEP as f32).clamp(0.0, most - 1e-3));
        let first = cell.map(|c| c as usize);
        (first, [cell[0] - first[0] as f32, cell[1] - first[1] as f32])
    }

    fn node(&self, [column, row]: [usize; 2]) -> [f32; 2] {
        self.motion[row * self.per_side + column]
    }

    /// Between nodes bilinear; beyond the outermost, theirs.
    fn at(&self, place: [f32; 2]) -> [f32; 2] {
        let ([column, row], [tx, ty]) = self.cell(place);
        let [a, b] = [self.node([column, row]), self.node([column + 1, row])];
        let [c, d] = [self.node([column, row + 1]), self.node([column + 1, row + 1])];
        std::array::from_fn(|k| {
            let upper = a[k] + tx * (b[k] - a[k]);
            let lower = c[k] + tx * (d[k] - c[k]);
            upper + ty * (lower - upper)
        })
    }

    /// The motion at a place, and those of the four nodes around it.
    fn around(&self, place: [f32; 2]) -> [[f32; 2]; 5] {
        let ([column, row], _) = self.cell(place);
        [
            self.at(place),
            self.node([column, row]),
            self.node([column + 1, row]),
            self.node([column, row + 1]),
            self.node([column + 1, row + 1]),
        ]
    }

    /// The median of each node and its neighbours, component by component, unless the node's own motion fits far
    /// better: a single mistake does not spread, and a narrow peak stays.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn smooth(&mut self, rest: &Level, now: &Level) {
        let n = self.per_side;
        for row in 0..n {
            for column in 0..n {
                let node = row * n + column;
                let own = self.raw[node];
                let median: [f32; 2] = std::array::from_fn(|k| {
                    let mut values = [0.0; 9];
                    let mut count = 0;
                    for y in row.saturating_sub(1)..(row + 2).min(n) {
                        for x in column.saturating_sub(1)..(column + 2).min(n) {
                            values[count] = self.raw[y * n + x][k];
                            count += 1;
                        }
                    }
                    *values[..count]
                        .select_nth_unstable_by(count / 2, f32::total_cmp)
                        .1
                });
                let differs = (0..2).any(|k| (own[k] - median[k]).abs() >= DIFFERENT);
                let fits = || {
                    let window = Window::new(rest, self.centre(node));
                    let [of_own, of_median] = [own, median].map(|motion| window.cost(now, motion.map(whole)));
                    4 * of_own < 3 * of_median
                };
                self.motion[node] = if differs && fits() { own } else { median };
            }
        }
    }
}

/// The whole pixels of a motion, as far as windows may move.
fn whole(motion: f32) -> i32 {
    motion.clamp(-FARTHEST, FARTHEST).round() as i32
}

/// A window of the rest image, to be found in the image now.
struct Window {
    pixels: [[u8; WINDOW]; WINDOW],
    corner: [i32; 2],
}

impl Window {
    fn new(rest: &Level, centre: [i32; 2]) -> Self {
        let corner = centre.map(|c| c - WINDOW as i32 / 2);
        let row = |row: usize| *rest.run(corner[0], corner[1] + row as i32);
        Self {
            pixels: std::array::from_fn(row),
            corner,
        }
    }

    /// Sum of absolute differences at a motion.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn cost(&self, now: &Level, [dx, dy]: [i32; 2]) -> u32 {
        let (column, first) = (self.corner[0] + dx, self.corner[1] + dy);
        let other = (first..).map(|row| now.run(column, row));
        difference(self.pixels.iter().zip(other))
    }

    /// The best motion within `reach` of `guess`, to a part of a pixel.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn best(&self, now: &Level, guess: [i32; 2], reach: i32) -> [f32; 2] {
        let mut best = (u32::MAX, [0; 2]);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let motion = [guess[0] + dx, guess[1] + dy];
                // Of equal ones the nearest.
                let cost = self.cost(now, motion) + 2 * (dx * dx + dy * dy) as u32;
                if cost < best.0 {
                    best = (cost, motion);
                }
            }
        }
        let [x, y] = best.1;
        let here = self.cost(now, [x, y]);
        // The sum of absolute differences has a kink at its minimum: two lines rather than a parabola.
        let vertex = |low: u32, high: u32| {
            let [low, high] = [low, high].map(|cost| cost as f32 - here as f32);
            let steep = low.max(high);
            if steep > 0.0 {
                (0.5 * (low - high) / steep).clamp(-0.5, 0.5)
            } else {
                0.0
            }
        };
        [
            x as f32 + vertex(self.cost(now, [x - 1, y]), self.cost(now, [x + 1, y])),
            y as f32 + vertex(self.cost(now, [x, y - 1]), self.cost(now, [x, y + 1])),
        ]
    }
}

/// Sum of absolute differences of rows of eight pixels, at most 257 rows.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
pub(super) fn difference<'a>(rows: impl Iterator<Item = (&'a [u8; 8], &'a [u8; 8])>) -> u32 {
    let mut lanes = [0_u16; 8];
    for (a, b) in rows {
        for k in 0..8 {
            lanes[k] += u16::from(a[k].abs_diff(b[k]));
        }
    }
    lanes.iter().map(|&lane| u32::from(lane)).sum()
}
