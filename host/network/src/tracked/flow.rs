//! Coarse optical flow on a grid of nodes: block matching at an eighth of the resolution, then at a quarter. So a motion of
//! several particle distances is tracked without confusing particles. Finer blocks would hold too few particles that
//! move alike, because shallow ones outrun deep ones.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{Dispatch, Simd, dispatch_256, round};

use super::block_matching::{BLOCK, Block, RANGE_MAX};
use super::dirty_tiles::{DirtyTiles, TileRect, same_bits};
use super::level::Level;
use super::pyramid::Pyramid;
use super::share::share;
use crate::constants::CROP_SIDE;

/// Distance of neighbouring nodes, pixels of their level.
const STEP: usize = 5;
/// Search range around the prediction at an eighth and at a quarter, pixels of the level.
const RANGE: [i32; 2] = [RANGE_MAX as i32, 2];
/// Largest motion of a node, pixels of its level: blocks stay inside the border.
const MOTION_MAX: f32 = 15.0;
/// Length of the longest row of nodes, in numbers, with one more node at each end.
const LINE: usize = 2 * (CROP_SIDE / 4 / STEP + 2);
/// A node's motion differs from its neighbours' median from this distance on, pixels.
const DIFFERENT: f32 = 0.75;
/// Rows of nodes that a thread takes at a time: some 10 µs of work.
const ROWS_AT_ONCE: usize = 3;

/// A rectangle of nodes at a quarter: first and last [column, row].
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeRect([[usize; 2]; 2]);

/// A position among a level's nodes: the upper left of the four around it, and the bilinear weights of the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodePosition {
    first: usize,
    fraction: [f32; 2],
}

/// The flow at both levels.
#[derive(Debug, Clone)]
pub(super) struct Flow {
    eighth: Nodes<{ CROP_SIDE / 8 }>,
    quarter: Nodes<{ CROP_SIDE / 4 }>,
    /// Position of each of the quarter's nodes among those of the eighth.
    coarser: Vec<NodePosition>,
}

/// The nodes of one level. Motions in pixels of the level.
#[derive(Debug, Clone)]
struct Nodes<const SIDE: usize> {
    /// Matched, from the top.
    rows: Vec<Row>,
    /// The median of each node and its neighbours, component by component.
    median: Vec<[f32; 2]>,
    /// Without outliers.
    motion: Vec<[f32; 2]>,
    /// The motion in the last frame.
    before: Vec<[f32; 2]>,
    /// The nodes whose motion changed.
    changed: Vec<bool>,
}

/// A row of nodes.
#[derive(Debug, Clone)]
struct Row {
    /// Its number.
    index: usize,
    /// Per node: the guesses of its search, and the tiles that it read.
    inputs: Vec<([[i32; 2]; 5], TileRect)>,
    /// As matched.
    matched: Vec<[f32; 2]>,
    /// Whether a match changed.
    changed: bool,
}

impl Flow {
    pub(super) fn new() -> Self {
        Self {
            eighth: Nodes::new(RANGE[0]),
            quarter: Nodes::new(RANGE[1]),
            coarser: Nodes::<{ CROP_SIDE / 4 }>::centres()
                .map(|centre| Nodes::<{ CROP_SIDE / 8 }>::position(centre.map(|c| 0.5 * (c as f32 + 0.5))))
                .collect(),
        }
    }

    /// Updates the flow from `rest` to `now`, of which the `dirty` tiles changed since the last frame. The threads of the caller's pool
    /// help, with the same instruction set. No allocation.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        rest: &Pyramid,
        now: &Pyramid,
        dirty: &DirtyTiles,
        instructions: InstructionSet,
    ) {
        let nothing: Option<(&Nodes<{ CROP_SIDE / 8 }>, _)> = None;
        self.eighth.update(NodeSearch {
            coarser: nothing,
            range: RANGE[0],
            rest: &rest.eighth,
            now: &now.eighth,
            dirty,
            instructions,
        });
        self.quarter.update(NodeSearch {
            coarser: Some((&self.eighth, &*self.coarser)),
            range: RANGE[1],
            rest: &rest.quarter,
            now: &now.quarter,
            dirty,
            instructions,
        });
    }

    /// The position of a place of the crop, pixels.
    pub(super) fn position(place_px: [f32; 2]) -> NodePosition {
        Nodes::<{ CROP_SIDE / 4 }>::position(place_px.map(|p| p / 4.0))
    }

    /// The motion at a position, pixels of the crop.
    #[inline(always)]
    pub(super) fn at(&self, position: NodePosition) -> [f32; 2] {
        self.quarter.at(position).map(|v| v * 4.0)
    }

    /// The nodes that [`Self::at`] reads for places between these two, pixels of the crop.
    pub(super) fn nodes_between(first_px: [f32; 2], last_px: [f32; 2]) -> NodeRect {
        // A particle's centre may lie beside its brightest pixel.
        let first = first_px.map(|p| (p - 4.0) / 4.0);
        let last = last_px.map(|p| (p + 4.0) / 4.0);
        NodeRect([
            Nodes::<{ CROP_SIDE / 4 }>::cell(first).0,
            Nodes::<{ CROP_SIDE / 4 }>::cell(last).0.map(|node| node + 1),
        ])
    }

    /// Whether the motion of one of these nodes changed.
    pub(super) fn changed_in(&self, NodeRect([[left, top], [right, bottom]]): NodeRect) -> bool {
        self.quarter
            .changed
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

    fn new(range: i32) -> Self {
        let still = vec![[0.0; 2]; Self::PER_SIDE * Self::PER_SIDE];
        let guesses = [[0; 2]; 5];
        let row = |index| Row {
            index,
            inputs: (0..Self::PER_SIDE)
                .map(|column| Self::search_tiles(Self::centre(column, index), guesses, range))
                .map(|tiles| (guesses, tiles))
                .collect(),
            matched: vec![[0.0; 2]; Self::PER_SIDE],
            changed: true,
        };
        Self {
            rows: (0..Self::PER_SIDE).map(row).collect(),
            median: still.clone(),
            changed: vec![true; still.len()],
            before: still.clone(),
            motion: still,
        }
    }

    /// Searches what changed, and smooths all.
    #[inline(always)]
    fn update<const COARSER: usize>(&mut self, search: NodeSearch<'_, SIDE, COARSER>) {
        share(&mut self.rows, ROWS_AT_ONCE, search.dirty, &|rows| {
            let task = UpdateRows { search, rows };
            dispatch_256(search.instructions, task);
        });
        self.smooth(search.rest, search.now);
    }

    /// The tiles that a node's search reads.
    #[inline]
    fn search_tiles(centre: [i32; 2], guesses: [[i32; 2]; 5], range: i32) -> TileRect {
        // Half a block, and one more pixel for the subpixel offset.
        let margin = range + 1 + BLOCK as i32 / 2;
        let scale = Self::SCALE as i32;
        let first = std::array::from_fn(|k| {
            let min = guesses.iter().fold(0, |min, guess| min.min(guess[k]));
            (centre[k] + min - margin) * scale
        });
        let last = std::array::from_fn(|k| {
            let max = guesses.iter().fold(0, |max, guess| max.max(guess[k]));
            (centre[k] + max + margin) * scale - 1
        });
        TileRect::of_pixels(first, last)
    }

    /// The pixel of a node: the middle of its cell.
    #[inline]
    fn centre(column: usize, row: usize) -> [i32; 2] {
        [column, row].map(|index| (index * STEP + STEP / 2) as i32)
    }

    /// Those of all nodes.
    fn centres() -> impl Iterator<Item = [i32; 2]> {
        let rows = 0..Self::PER_SIDE;
        rows.flat_map(|row| (0..Self::PER_SIDE).map(move |column| Self::centre(column, row)))
    }

    /// The first of the four nodes around a place (pixels of the level), and the fraction of the way to the others.
    fn cell(place: [f32; 2]) -> ([usize; 2], [f32; 2]) {
        let max = (Self::PER_SIDE - 1) as f32;
        let cell = place.map(|p| ((p - 0.5 - (STEP / 2) as f32) / STEP as f32).clamp(0.0, max - 1e-3));
        let first = cell.map(|c| c as usize);
        (first, [cell[0] - first[0] as f32, cell[1] - first[1] as f32])
    }

    fn position(place: [f32; 2]) -> NodePosition {
        let ([column, row], fraction) = Self::cell(place);
        NodePosition {
            first: row * Self::PER_SIDE + column,
            fraction,
        }
    }

    /// The four nodes around a position, the upper ones first.
    #[inline]
    fn four<T: Copy>(of: &[T], position: NodePosition) -> [T; 4] {
        let rows: &[T] = &of[position.first..][..Self::PER_SIDE + 2];
        [rows[0], rows[1], rows[Self::PER_SIDE], rows[Self::PER_SIDE + 1]]
    }

    /// NodePosition nodes bilinear; beyond the outermost, theirs.
    #[inline]
    fn at(&self, position: NodePosition) -> [f32; 2] {
        let [a, b, c, d] = Self::four(&self.motion, position);
        let [tx, ty] = position.fraction;
        [0, 1].map(|k| {
            let upper = a[k] + tx * (b[k] - a[k]);
            let lower = c[k] + tx * (d[k] - c[k]);
            upper + ty * (lower - upper)
        })
    }

    /// The motion at a position, and those of the four nodes around it.
    #[inline]
    fn around(&self, position: NodePosition) -> [[f32; 2]; 5] {
        let [a, b, c, d] = Self::four(&self.motion, position);
        [self.at(position), a, b, c, d]
    }

    /// Whether the motion of one of the four nodes around a position changed.
    #[inline]
    fn changed_around(&self, position: NodePosition) -> bool {
        Self::four(&self.changed, position).contains(&true)
    }

    /// Replaces each node's motion by the median of it and its neighbours, unless its own motion fits far better: removes
    /// outliers but keeps narrow peaks.
    #[inline(always)]
    fn smooth(&mut self, rest: &Level<SIDE>, now: &Level<SIDE>) {
        std::mem::swap(&mut self.before, &mut self.motion);
        self.medians();
        let matched = self.rows.iter().flat_map(|row| &row.matched);
        let nodes = self.motion.iter_mut().zip(matched.zip(&self.median));
        for ((motion, (&own, &median)), centre) in nodes.zip(Self::centres()) {
            *motion = median;
            if (0..2).any(|k| (own[k] - median[k]).abs() >= DIFFERENT) {
                let block = Block::new(rest, centre);
                let own_sad = block.sad(now, own.map(whole_pixels));
                let median_sad = block.sad(now, median.map(whole_pixels));
                if 4 * own_sad < 3 * median_sad {
                    *motion = own;
                }
            }
        }
        let motions = self.motion.iter().zip(&self.before);
        for (changed, (&now, &before)) in self.changed.iter_mut().zip(motions) {
            *changed = !same_bits(now, before);
        }
    }

    /// The (upper) median of each node and its neighbours, for rows with changed matches around them.
    #[inline(always)]
    fn medians(&mut self) {
        const LOW: f32 = f32::NEG_INFINITY;
        const HIGH: f32 = f32::INFINITY;
        let n = Self::PER_SIDE;
        let line = |row: usize| self.rows[row].matched.as_flattened();
        for (row, out) in self.median.as_flattened_mut().chunks_exact_mut(2 * n).enumerate() {
            let around = &self.rows[row.saturating_sub(1)..(row + 2).min(n)];
            if !around.iter().any(|row| row.changed) {
                continue;
            }
            // Neighbours are two numbers apart. Outside lie infinities, so that the median is that of the existing nodes:
            // one low and two high at an edge, two and three at a corner.
            let mut lines = [[HIGH; LINE], [LOW; LINE], [HIGH; LINE]];
            lines[1][2..][..2 * n].copy_from_slice(line(row));
            if row > 0 {
                lines[0][2..][..2 * n].copy_from_slice(line(row - 1));
            }
            if row + 1 < n {
                lines[2][2..][..2 * n].copy_from_slice(line(row + 1));
            }
            for first in (0..2 * n).step_by(8) {
                // The last eight may overlap those before.
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

/// What the search of all nodes of a level shares.
#[derive(Clone, Copy)]
struct NodeSearch<'a, const SIDE: usize, const COARSER: usize> {
    /// The level below in resolution, and where the nodes lie in it.
    coarser: Option<(&'a Nodes<COARSER>, &'a [NodePosition])>,
    /// Search range around a guess, pixels of the level.
    range: i32,
    rest: &'a Level<SIDE>,
    now: &'a Level<SIDE>,
    dirty: &'a DirtyTiles,
    instructions: InstructionSet,
}

impl<const SIDE: usize, const COARSER: usize> NodeSearch<'_, SIDE, COARSER> {
    /// Searches what changed in a row of nodes.
    #[inline(always)]
    fn update_row<S: Simd>(&self, row: &mut Row) {
        let Self {
            coarser,
            range,
            rest,
            now,
            dirty,
            ..
        } = *self;
        let per_side = Nodes::<SIDE>::PER_SIDE;
        row.changed = false;
        for column in 0..per_side {
            let centre = Nodes::<SIDE>::centre(column, row.index);
            let (known, tiles) = &mut row.inputs[column];
            let mut guesses = *known;
            if let Some((nodes, positions)) = coarser {
                let position = positions[row.index * per_side + column];
                if nodes.changed_around(position) {
                    let motions = nodes.around(position);
                    for (guess, motion) in guesses.as_flattened_mut().iter_mut().zip(motions.as_flattened()) {
                        *guess = whole_pixels(2.0 * motion);
                    }
                }
            }
            if guesses != *known {
                *known = guesses;
                *tiles = Nodes::<SIDE>::search_tiles(centre, guesses, range);
            } else if !dirty.any_in(*tiles) {
                continue;
            }
            let block = Block::new(rest, centre);
            let mut guess = [0; 2];
            if coarser.is_some() {
                let mut min = u32::MAX;
                for (k, motion) in guesses.into_iter().enumerate() {
                    if guesses[..k].contains(&motion) {
                        continue;
                    }
                    let sad = block.sad(now, motion);
                    if sad < min {
                        (min, guess) = (sad, motion);
                    }
                }
            }
            let best = block.best_match::<S, _>(now, guess, range);
            row.changed |= !same_bits(best, row.matched[column]);
            row.matched[column] = best;
        }
    }
}

/// Runs [`NodeSearch::update_row`] for some rows.
struct UpdateRows<'a, const SIDE: usize, const COARSER: usize> {
    search: NodeSearch<'a, SIDE, COARSER>,
    rows: &'a mut [Row],
}

impl<const SIDE: usize, const COARSER: usize> Dispatch for UpdateRows<'_, SIDE, COARSER> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        for row in self.rows {
            self.search.update_row::<S>(row);
        }
    }
}

/// Eight medians at once, by a sorting network.
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
            // Not `f32::min`, which also checks for NaN; there is none.
            of[low][k] = if a[k] < b[k] { a[k] } else { b[k] };
            of[high][k] = if a[k] < b[k] { b[k] } else { a[k] };
        }
    }
    of[4]
}

/// A motion in whole pixels, within the allowed range.
#[inline]
fn whole_pixels(motion: f32) -> i32 {
    round(motion.clamp(-MOTION_MAX, MOTION_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Update<'a>(&'a mut Flow, &'a Pyramid, &'a Pyramid, &'a DirtyTiles);

    impl Dispatch for Update<'_> {
        type Output = ();

        #[inline(always)]
        fn run<S: Simd>(self) {
            let Self(flow, rest, now, dirty) = self;
            flow.update(rest, now, dirty, InstructionSet::Portable);
        }
    }

    fn update(flow: &mut Flow, rest: &Pyramid, now: &Pyramid, dirty: &DirtyTiles) {
        dispatch_256(InstructionSet::Portable, Update(flow, rest, now, dirty));
    }

    fn matched<const SIDE: usize>(nodes: &Nodes<SIDE>) -> Vec<[f32; 2]> {
        nodes.rows.iter().flat_map(|row| row.matched.clone()).collect()
    }

    /// A pattern without repetition, shifted by this many pixels.
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
        pyramid.update(picture, &DirtyTiles::all());
        pyramid
    }

    #[test]
    fn medians_are_the_upper_ones_of_the_existing_neighbours() {
        fn check<const SIDE: usize>() {
            let n = Nodes::<SIDE>::PER_SIDE;
            let mut nodes = Nodes::<SIDE>::new(RANGE[0]);
            let matched = nodes.rows.iter_mut().flat_map(|row| &mut row.matched);
            for (node, matched) in matched.enumerate() {
                *matched = [node * 7919 % 101, node * 104_729 % 97].map(|at| at as f32 - 50.0);
            }
            nodes.medians();
            for (node, median) in nodes.median.iter().enumerate() {
                let (row, column) = (node / n, node % n);
                for (k, median) in median.iter().enumerate() {
                    let rows = row.saturating_sub(1)..(row + 2).min(n);
                    let columns = column.saturating_sub(1)..(column + 2).min(n);
                    let around = rows.flat_map(|y| columns.clone().map(move |x| (y, x)));
                    let mut values: Vec<f32> = around.map(|(y, x)| nodes.rows[y].matched[x][k]).collect();
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
    fn a_spot_that_changes_anywhere_gives_the_same_flow_as_computing_everything() {
        let rest = pyramid(&picture([0; 2]));
        let mut shown = picture([9, 5]);
        let (mut skip, mut dense) = (Flow::new(), Flow::new());
        let mut now = pyramid(&shown);
        update(&mut skip, &rest, &now, &DirtyTiles::all());
        let mut moved = 0;
        for spot in 0..120_usize {
            let [left, top] = [spot * 97 % (CROP_SIDE - 8), spot * 61 % (CROP_SIDE - 8)];
            for row in top..top + 8 {
                for pixel in &mut shown[row * CROP_SIDE + left..row * CROP_SIDE + left + 8] {
                    *pixel ^= 0xE0;
                }
            }
            let dirty = DirtyTiles::between(&now.full, &shown);
            now.update(&shown, &dirty);
            update(&mut skip, &rest, &now, &dirty);
            update(&mut dense, &rest, &now, &DirtyTiles::all());
            assert_eq!(matched(&skip.eighth), matched(&dense.eighth), "spot {spot}");
            assert_eq!(matched(&skip.quarter), matched(&dense.quarter), "spot {spot}");
            assert_eq!(skip.quarter.motion, dense.quarter.motion, "spot {spot}");
            moved += skip.quarter.changed.iter().filter(|&&changed| changed).count();
        }
        assert!(moved > 200, "only {moved} nodes moved");
    }
}
