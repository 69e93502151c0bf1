//! Where the surroundings of each node of a coarse grid went: block matching from an eighth of the resolution to a
//! quarter, so that a motion of several particles' distances is followed without mistaking one for another. Finer
//! windows hold too few particles that move alike: the shallow ones outrun the deep ones.

use super::changed::{Changed, Tiles, same};
use super::compare::Compare;
use super::lanes::nearest;
use super::pyramid::{Level, Pyramid};
use super::window::{REACH_MOST, WINDOW, Window};
use crate::constants::CROP_SIDE;

/// Pixels between nodes.
const STEP: usize = 5;
/// Pixels searched around the prediction, at an eighth and at a quarter.
const REACH: [i32; 2] = [REACH_MOST as i32, 2];
/// Farthest motion of a node, pixels of its level: windows stay inside the border.
const FARTHEST: f32 = 15.0;
/// Numbers of the longest row of nodes with one more at each end.
const LINE: usize = 2 * (CROP_SIDE / 4 / STEP + 2);
/// From how many pixels on a node's motion and its neighbours' median are different motions.
const DIFFERENT: f32 = 0.75;

/// A rectangle of nodes at a quarter: the first column and row, and the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeRange([[usize; 2]; 2]);

/// A place among a level's nodes: the upper left one of the four around it, and how far from it towards the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct Between {
    first: usize,
    towards: [f32; 2],
}

/// The nodes of both levels.
#[derive(Debug, Clone)]
pub(super) struct Flow {
    eighth: Nodes<{ CROP_SIDE / 8 }>,
    quarter: Nodes<{ CROP_SIDE / 4 }>,
    /// Where each of the quarter's nodes lies among those of the eighth.
    coarser: Vec<Between>,
}

/// One level's nodes: motion in the level's pixels.
#[derive(Debug, Clone)]
struct Nodes<const SIDE: usize> {
    /// Motions at the coarser level around each node, and the tiles that its search looked at.
    asked: Vec<([[f32; 2]; 5], Tiles)>,
    /// As matched, and the rows in which another one was matched than the last time.
    raw: Vec<[f32; 2]>,
    other: Vec<bool>,
    /// The median of each node and its neighbours, component by component.
    median: Vec<[f32; 2]>,
    /// Without single mistakes.
    motion: Vec<[f32; 2]>,
    /// That of the last time, and the nodes that have another one now.
    before: Vec<[f32; 2]>,
    moved: Vec<bool>,
}

impl Flow {
    pub(super) fn new() -> Self {
        Self {
            eighth: Nodes::new(),
            quarter: Nodes::new(),
            coarser: Nodes::<{ CROP_SIDE / 4 }>::centres()
                .map(|centre| Nodes::<{ CROP_SIDE / 8 }>::between(centre.map(|c| 0.5 * (c as f32 + 0.5))))
                .collect(),
        }
    }

    /// Motion from `rest` to `now`, of which `changed` changed since the last time. No allocation.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn find<C: Compare>(&mut self, rest: &Pyramid, now: &Pyramid, changed: &Changed) {
        let nothing: Option<(&Nodes<{ CROP_SIDE / 8 }>, _)> = None;
        self.eighth
            .find::<C, _>(nothing, &rest.eighth, &now.eighth, REACH[0], changed);
        let coarser = Some((&self.eighth, &*self.coarser));
        self.quarter
            .find::<C, _>(coarser, &rest.quarter, &now.quarter, REACH[1], changed);
    }

    /// Where a place of the crop lies, pixels of the crop.
    pub(super) fn between(place_px: [f32; 2]) -> Between {
        Nodes::<{ CROP_SIDE / 4 }>::between(place_px.map(|p| p / 4.0))
    }

    /// Motion there, pixels of the crop.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn at(&self, place: Between) -> [f32; 2] {
        self.quarter.at(place).map(|v| v * 4.0)
    }

    /// The nodes that [`Self::at`] goes by at places between these two, pixels of the crop.
    pub(super) fn nodes(first_px: [f32; 2], last_px: [f32; 2]) -> NodeRange {
        // A particle's centre may lie beside its brightest pixel.
        let first = first_px.map(|p| (p - 4.0) / 4.0);
        let last = last_px.map(|p| (p + 4.0) / 4.0);
        NodeRange([
            Nodes::<{ CROP_SIDE / 4 }>::cell(first).0,
            Nodes::<{ CROP_SIDE / 4 }>::cell(last).0.map(|node| node + 1),
        ])
    }

    /// Whether one of these nodes moved otherwise than the last time.
    pub(super) fn moved(&self, NodeRange([[left, top], [right, bottom]]): NodeRange) -> bool {
        self.quarter
            .moved
            .chunks_exact(Nodes::<{ CROP_SIDE / 4 }>::PER_SIDE)
            .take(bottom + 1)
            .skip(top)
            .any(|row| row[left..=right].contains(&true))
    }
}

impl<const SIDE: usize> Nodes<SIDE> {
    const PER_SIDE: usize = SIDE / STEP;
    /// Pixels of the crop in one of the level's, along a side.
    const SCALE: usize = CROP_SIDE / SIDE;

    fn new() -> Self {
        let still = vec![[0.0; 2]; Self::PER_SIDE * Self::PER_SIDE];
        Self {
            other: vec![true; Self::PER_SIDE],
            median: still.clone(),
            asked: vec![([[0.0; 2]; 5], Tiles::ALL); Self::PER_SIDE * Self::PER_SIDE],
            moved: vec![true; still.len()],
            raw: still.clone(),
            before: still.clone(),
            motion: still,
        }
    }

    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn find<C: Compare, const COARSER: usize>(
        &mut self,
        coarser: Option<(&Nodes<COARSER>, &[Between])>,
        rest: &Level<SIDE>,
        now: &Level<SIDE>,
        reach: i32,
        changed: &Changed,
    ) {
        self.other.fill(false);
        for (node, centre) in Self::centres().enumerate() {
            let (asked, tiles) = &mut self.asked[node];
            let around = coarser.filter(|(nodes, between)| nodes.moved_around(between[node]));
            if around.is_none() && !changed.any(*tiles) {
                continue;
            }
            let motions = around.map_or(*asked, |(nodes, between)| nodes.around(between[node]));
            *asked = motions;
            let mut guesses = [[0; 2]; 5];
            for (guess, motion) in guesses.as_flattened_mut().iter_mut().zip(motions.as_flattened()) {
                *guess = whole(2.0 * motion);
            }
            *tiles = Self::tiles(centre, guesses, reach);
            let window = Window::new(rest, centre);
            let mut guess = [0; 2];
            if coarser.is_some() {
                let mut least = u32::MAX;
                for (k, motion) in guesses.into_iter().enumerate() {
                    if guesses[..k].contains(&motion) {
                        continue;
                    }
                    let cost = window.cost(now, motion);
                    if cost < least {
                        (least, guess) = (cost, motion);
                    }
                }
            }
            let best = window.best::<C, _>(now, guess, reach);
            self.other[node / Self::PER_SIDE] |= !same(best, self.raw[node]);
            self.raw[node] = best;
        }
        self.smooth(rest, now);
    }

    /// The tiles that a node's search looks at.
    #[inline]
    fn tiles(centre: [i32; 2], guesses: [[i32; 2]; 5], reach: i32) -> Tiles {
        // Half a window, and a step more for the part of a pixel.
        let beyond = reach + 1 + WINDOW as i32 / 2;
        let scale = Self::SCALE as i32;
        let first = std::array::from_fn(|k| {
            let least = guesses.iter().fold(0, |least, guess| least.min(guess[k]));
            (centre[k] + least - beyond) * scale
        });
        let last = std::array::from_fn(|k| {
            let most = guesses.iter().fold(0, |most, guess| most.max(guess[k]));
            (centre[k] + most + beyond) * scale - 1
        });
        Tiles::between(first, last)
    }

    /// Pixel of each node: the middle one of its cell.
    fn centres() -> impl Iterator<Item = [i32; 2]> {
        let middle = |index: usize| (index * STEP + STEP / 2) as i32;
        let rows = (0..Self::PER_SIDE).map(middle);
        rows.flat_map(move |y| (0..Self::PER_SIDE).map(move |x| [middle(x), y]))
    }

    /// First node of the four around a place in pixels of the level, and how far from it towards the others.
    fn cell(place: [f32; 2]) -> ([usize; 2], [f32; 2]) {
        let most = (Self::PER_SIDE - 1) as f32;
        let cell = place.map(|p| ((p - 0.5 - (STEP / 2) as f32) / STEP as f32).clamp(0.0, most - 1e-3));
        let first = cell.map(|c| c as usize);
        (first, [cell[0] - first[0] as f32, cell[1] - first[1] as f32])
    }

    fn between(place: [f32; 2]) -> Between {
        let ([column, row], towards) = Self::cell(place);
        Between {
            first: row * Self::PER_SIDE + column,
            towards,
        }
    }

    /// The four nodes around a place, the upper ones first.
    #[inline]
    fn four<T: Copy>(of: &[T], place: Between) -> [T; 4] {
        let rows: &[T] = &of[place.first..][..Self::PER_SIDE + 2];
        [rows[0], rows[1], rows[Self::PER_SIDE], rows[Self::PER_SIDE + 1]]
    }

    /// Between nodes bilinear; beyond the outermost, theirs.
    #[inline]
    fn at(&self, place: Between) -> [f32; 2] {
        let [a, b, c, d] = Self::four(&self.motion, place);
        let [tx, ty] = place.towards;
        [0, 1].map(|k| {
            let upper = a[k] + tx * (b[k] - a[k]);
            let lower = c[k] + tx * (d[k] - c[k]);
            upper + ty * (lower - upper)
        })
    }

    /// The motion at a place, and those of the four nodes around it.
    #[inline]
    fn around(&self, place: Between) -> [[f32; 2]; 5] {
        let [a, b, c, d] = Self::four(&self.motion, place);
        [self.at(place), a, b, c, d]
    }

    /// Whether one of the four nodes around a place moved otherwise than the last time.
    #[inline]
    fn moved_around(&self, place: Between) -> bool {
        Self::four(&self.moved, place).contains(&true)
    }

    /// The median of each node and its neighbours, component by component, unless the node's own motion fits far
    /// better: a single mistake does not spread, and a narrow peak stays.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn smooth(&mut self, rest: &Level<SIDE>, now: &Level<SIDE>) {
        std::mem::swap(&mut self.before, &mut self.motion);
        self.medians();
        let nodes = self.motion.iter_mut().zip(self.raw.iter().zip(&self.median));
        for ((motion, (&own, &median)), centre) in nodes.zip(Self::centres()) {
            *motion = median;
            if (0..2).any(|k| (own[k] - median[k]).abs() >= DIFFERENT) {
                let window = Window::new(rest, centre);
                let of_own = window.cost(now, own.map(whole));
                let of_median = window.cost(now, median.map(whole));
                if 4 * of_own < 3 * of_median {
                    *motion = own;
                }
            }
        }
        let motions = self.motion.iter().zip(&self.before);
        for (moved, (&now, &before)) in self.moved.iter_mut().zip(motions) {
            *moved = !same(now, before);
        }
    }

    /// The median of each node and its neighbours, of an even number the upper one, where one of them is matched
    /// otherwise than the last time.
    #[inline(always)]
    fn medians(&mut self) {
        const LOW: f32 = f32::NEG_INFINITY;
        const HIGH: f32 = f32::INFINITY;
        let n = Self::PER_SIDE;
        let raw = self.raw.as_flattened();
        let line = |row: usize| &raw[2 * n * row..2 * n * (row + 1)];
        for (row, out) in self.median.as_flattened_mut().chunks_exact_mut(2 * n).enumerate() {
            if !self.other[row.saturating_sub(1)..(row + 2).min(n)].contains(&true) {
                continue;
            }
            // Neighbours are two numbers apart. What lies outside is so low or so high that the median is that of the
            // nodes there are: one low and two high at an edge, two and three at a corner.
            let mut lines = [[HIGH; LINE], [LOW; LINE], [HIGH; LINE]];
            lines[1][2..][..2 * n].copy_from_slice(line(row));
            if row > 0 {
                lines[0][2..][..2 * n].copy_from_slice(line(row - 1));
            }
            if row + 1 < n {
                lines[2][2..][..2 * n].copy_from_slice(line(row + 1));
            }
            for first in (0..2 * n).step_by(8) {
                // The last eight may be some of those before, too.
                let first = first.min(2 * n - 8);
                let mut nine = [[0.0; 8]; 9];
                for (three, line) in nine.as_chunks_mut::<3>().0.iter_mut().zip(&lines) {
                    for (eight, first) in three.iter_mut().zip([first, first + 2, first + 4]) {
                        eight.copy_from_slice(&line[first..first + 8]);
                    }
                }
                if row == 0 {
                    nine[1] = [LOW; 8];
                }
                if row + 1 == n {
                    nine[7] = [LOW; 8];
                }
                out[first..first + 8].copy_from_slice(&medians_of_nine(nine));
            }
        }
    }
}

/// Eight medians by exchanges of pairs, the same for all values.
#[expect(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn medians_of_nine(mut of: [[f32; 8]; 9]) -> [f32; 8] {
    for (low, high) in [
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 1),
        (3, 4),
        (6, 7),
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 3),
        (5, 8),
        (4, 7),
        (3, 6),
        (1, 4),
        (2, 5),
        (4, 7),
        (4, 2),
        (6, 4),
        (4, 2),
    ] {
        let (a, b) = (of[low], of[high]);
        for k in 0..8 {
            // Not `f32::min`, which also looks for NaN; there is none.
            of[low][k] = if a[k] < b[k] { a[k] } else { b[k] };
            of[high][k] = if a[k] < b[k] { b[k] } else { a[k] };
        }
    }
    of[4]
}

/// The whole pixels of a motion, as far as windows may move.
#[inline]
fn whole(motion: f32) -> i32 {
    nearest(motion.clamp(-FARTHEST, FARTHEST))
}

#[cfg(test)]
mod tests {
    use super::super::compare::Plain;
    use super::*;

    /// A pattern without repetition, shifted by so many pixels.
    fn picture(shift: [usize; 2]) -> Vec<u8> {
        (0..CROP_SIDE * CROP_SIDE)
            .map(|i| {
                let [x, y] = [i % CROP_SIDE + shift[0], i / CROP_SIDE + shift[1]].map(|at| at as f64);
                let wave =
                    (x * 0.11 + (y * 0.043).sin() * 5.0).sin() + (y * 0.13 + (x * 0.029).cos() * 7.0).sin();
                (127.0 + 55.0 * wave) as u8
            })
            .collect()
    }

    fn pyramid(picture: &[u8]) -> Pyramid {
        let mut pyramid = Pyramid::new();
        pyramid.take(picture, &Changed::everything());
        pyramid
    }

    #[test]
    fn medians_are_those_of_the_neighbours_that_there_are_of_an_even_number_the_upper_one() {
        fn check<const SIDE: usize>() {
            let n = Nodes::<SIDE>::PER_SIDE;
            let mut nodes = Nodes::<SIDE>::new();
            for (node, raw) in nodes.raw.iter_mut().enumerate() {
                *raw = [node * 7919 % 101, node * 104_729 % 97].map(|at| at as f32 - 50.0);
            }
            nodes.medians();
            for (node, median) in nodes.median.iter().enumerate() {
                let (row, column) = (node / n, node % n);
                for (k, median) in median.iter().enumerate() {
                    let rows = row.saturating_sub(1)..(row + 2).min(n);
                    let columns = column.saturating_sub(1)..(column + 2).min(n);
                    let around = rows.flat_map(|y| columns.clone().map(move |x| (y, x)));
                    let mut values: Vec<f32> = around.map(|(y, x)| nodes.raw[y * n + x][k]).collect();
                    values.sort_by(f32::total_cmp);
                    assert_eq!(
                        median.to_bits(),
                        values[values.len() / 2].to_bits(),
                        "row {row} of {n}, column {column}"
                    );
                }
            }
        }
        check::<{ CROP_SIDE / 8 }>();
        check::<{ CROP_SIDE / 4 }>();
    }

    #[test]
    fn a_spot_that_changes_anywhere_moves_the_same_nodes_as_if_everything_were_looked_at() {
        let rest = pyramid(&picture([0; 2]));
        let mut shown = picture([9, 5]);
        let (mut skip, mut dense) = (Flow::new(), Flow::new());
        let mut now = pyramid(&shown);
        skip.find::<Plain>(&rest, &now, &Changed::everything());
        let mut moved = 0;
        for spot in 0..120_usize {
            let [left, top] = [spot * 97 % (CROP_SIDE - 8), spot * 61 % (CROP_SIDE - 8)];
            for row in top..top + 8 {
                for pixel in &mut shown[row * CROP_SIDE + left..row * CROP_SIDE + left + 8] {
                    *pixel ^= 0xE0;
                }
            }
            let changed = Changed::between(&now.full, &shown);
            now.take(&shown, &changed);
            skip.find::<Plain>(&rest, &now, &changed);
            dense.find::<Plain>(&rest, &now, &Changed::everything());
            assert_eq!(skip.eighth.raw, dense.eighth.raw, "spot {spot}");
            assert_eq!(skip.quarter.raw, dense.quarter.raw, "spot {spot}");
            assert_eq!(skip.quarter.motion, dense.quarter.motion, "spot {spot}");
            moved += skip.quarter.moved.iter().filter(|&&moved| moved).count();
        }
        assert!(moved > 200, "only {moved} nodes moved");
    }
}
