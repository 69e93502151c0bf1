//! Block matching: where in the image now a block of the rest image fits best, by the sum of absolute differences (SAD),
//! to a fraction of a pixel.
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

use gripline_kernels::simd::Simd;

use super::level::{Level, Rows};

/// Side of a block, pixels of its level.
pub(super) const BLOCK: usize = 8;
/// Largest search range, pixels of its level.
pub(super) const RANGE_MAX: usize = 4;

/// A block of the rest image.
pub(super) struct Block {
    pixels: [[u8; BLOCK]; BLOCK],
    corner: [i32; 2],
}

impl Block {
    #[inline]
    pub(super) fn new<const SIDE: usize>(rest: &Level<SIDE>, centre: [i32; 2]) -> Self {
        let corner = centre.map(|c| c - BLOCK as i32 / 2);
        let rows = rest.rows::<BLOCK>(corner[0], corner[1]);
        Self {
            pixels: std::array::from_fn(|row| *rows.at(row, 0)),
            corner,
        }
    }

    /// Sum of absolute differences at a motion.
    #[inline(always)]
    pub(super) fn sad<const SIDE: usize>(&self, now: &Level<SIDE>, [dx, dy]: [i32; 2]) -> u32 {
        sad(
            self.pixels.each_ref(),
            &now.rows(self.corner[0] + dx, self.corner[1] + dy),
        )
    }

    /// The best motion within `range` of `guess`, to a fraction of a pixel. Of equal matches, the one nearest to `guess`.
    #[inline(always)]
    pub(super) fn best_match<S: Simd, const SIDE: usize>(
        &self,
        now: &Level<SIDE>,
        guess: [i32; 2],
        range: i32,
    ) -> [f32; 2] {
        let mut sads = Sads {
            block: self,
            now,
            guess,
            range,
            rows: [[0; 8]; 2 * RANGE_MAX + 1],
        };
        let penalties = distance_penalties(range);
        let mut best = (u32::MAX, [0; 2]);
        for (row, dy) in (-range..=range).enumerate() {
            let rows = now.rows::<BLOCK>(self.corner[0] + guess[0] - range, self.corner[1] + guess[1] + dy);
            let eight = S::sad_x8(&self.pixels, rows.pixels(), Level::<SIDE>::STRIDE);
            sads.rows[row] = eight;
            let penalty = 2 * (dy * dy) as u32;
            let (cost, place) = S::min_sum(&eight, &penalties);
            let cost = u32::from(cost) + penalty;
            if cost < best.0 {
                best = (cost, [place as i32 - range, dy]);
            }
            for dx in 8 - range..=range {
                let cost = self.sad(now, [guess[0] + dx, guess[1] + dy]) + 2 * (dx * dx) as u32 + penalty;
                if cost < best.0 {
                    best = (cost, [dx, dy]);
                }
            }
        }
        let [x, y] = best.1;
        let here = sads.at([x, y]);
        [
            (guess[0] + x) as f32 + subpixel_offset(sads.at([x - 1, y]), here, sads.at([x + 1, y])),
            (guess[1] + y) as f32 + subpixel_offset(sads.at([x, y - 1]), here, sads.at([x, y + 1])),
        ]
    }
}

/// Added to the SADs of eight columns from `-range` on: twice the squared distance; columns beyond `range` cannot win.
fn distance_penalties(range: i32) -> [u16; 8] {
    let mut penalties = [u16::MAX; 8];
    for (penalty, dx) in penalties.iter_mut().zip(-range..=range) {
        *penalty = 2 * (dx * dx) as u16;
    }
    penalties
}

/// The SADs of a block around a guess: the rows and the first eight columns of the search range; others on demand.
struct Sads<'a, const SIDE: usize> {
    block: &'a Block,
    now: &'a Level<SIDE>,
    guess: [i32; 2],
    range: i32,
    rows: [[u16; 8]; 2 * RANGE_MAX + 1],
}

impl<const SIDE: usize> Sads<'_, SIDE> {
    #[inline(always)]
    fn at(&self, [dx, dy]: [i32; 2]) -> u32 {
        let [column, row] = [dx + self.range, dy + self.range];
        if (0..8).contains(&column) && (0..=2 * self.range).contains(&row) {
            self.rows[row as usize][column as usize].into()
        } else {
            self.block.sad(self.now, [self.guess[0] + dx, self.guess[1] + dy])
        }
    }
}

/// Offset of the minimum, pixels, from the SADs at -1, 0 and 1 pixel. The SAD has a kink at its minimum: this fits two
/// lines, not a parabola.
#[inline]
fn subpixel_offset(low: u32, here: u32, high: u32) -> f32 {
    let [low, high] = [low, high].map(|cost| cost as f32 - here as f32);
    let steep = low.max(high);
    if steep > 0.0 {
        (0.5 * (low - high) / steep).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// The sum of absolute differences of a block and the first place of these rows.
#[inline(always)]
pub(super) fn sad<const SIDE: usize, const ROWS: usize>(
    block: [&[u8; 8]; ROWS],
    rows: &Rows<'_, SIDE, ROWS>,
) -> u32 {
    let mut sum = 0;
    for (down, a) in block.into_iter().enumerate() {
        // So simple that the compiler finds the one instruction for it.
        let b: &[u8; 8] = rows.at(down, 0);
        for k in 0..8 {
            sum += u32::from(a[k].abs_diff(b[k]));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::dirty_tiles::DirtyTiles;
    use super::super::pyramid::Pyramid;
    use super::*;
    use gripline_kernels::InstructionSet;
    use gripline_kernels::simd::{Dispatch, dispatch_256};

    /// The definition: one motion after the other.
    fn one_by_one<const SIDE: usize>(
        block: &Block,
        now: &Level<SIDE>,
        guess: [i32; 2],
        range: i32,
    ) -> [f32; 2] {
        let cost = |dx: i32, dy: i32| block.sad(now, [guess[0] + dx, guess[1] + dy]);
        let (_, dy, dx) = (-range..=range)
            .flat_map(|dy| (-range..=range).map(move |dx| (dy, dx)))
            .map(|(dy, dx)| (cost(dx, dy) + 2 * (dx * dx + dy * dy) as u32, dy, dx))
            .min()
            .expect("motions");
        let here = cost(dx, dy);
        [
            (guess[0] + dx) as f32 + subpixel_offset(cost(dx - 1, dy), here, cost(dx + 1, dy)),
            (guess[1] + dy) as f32 + subpixel_offset(cost(dx, dy - 1), here, cost(dx, dy + 1)),
        ]
    }

    struct BestMatch<'a, const SIDE: usize>(&'a Block, &'a Level<SIDE>, [i32; 2], i32);

    impl<const SIDE: usize> Dispatch for BestMatch<'_, SIDE> {
        type Output = [f32; 2];

        #[inline(always)]
        fn run<S: Simd>(self) -> [f32; 2] {
            let Self(block, now, guess, range) = self;
            block.best_match::<S, SIDE>(now, guess, range)
        }
    }

    #[test]
    fn eight_motions_at_once_find_what_one_after_the_other_do() {
        let picture = |shift: [usize; 2]| {
            let pixels: Vec<u8> = (0..440 * 440_usize)
                .map(|at| {
                    let [x, y] = [at % 440 + shift[0], at / 440 + shift[1]];
                    // Coarse, and uniform in places.
                    if y % 160 < 40 {
                        90
                    } else {
                        (x / 8 * 37 % 101 + y / 8 * 53 % 89) as u8
                    }
                })
                .collect();
            let mut pyramid = Pyramid::new();
            pyramid.update(&pixels, &DirtyTiles::all());
            pyramid
        };
        let rest = picture([32, 24]);
        let mut columns = [0; 2 * RANGE_MAX + 1];
        for (number, guess) in [[0, 0], [2, -1], [-3, 1]]
            .into_iter()
            .cycle()
            .take(60)
            .enumerate()
        {
            let now = picture([8 * (number % 9), 8 * (number % 7)]);
            for place in 0..9 {
                let centre = [6 + 5 * (place % 3), 8 + 12 * (place / 3)];
                let block = Block::new(&rest.eighth, centre);
                let expected = [4, 2]
                    .map(|range| one_by_one(&block, &now.eighth, guess, range))
                    .to_vec();
                for set in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
                    let found =
                        [4, 2].map(|range| dispatch_256(set, BestMatch(&block, &now.eighth, guess, range)));
                    assert_eq!(found[..], expected, "{set}");
                }
                let [x, _] = expected[0];
                columns[(x.round() as i32 - guess[0] + 4).clamp(0, 8) as usize] += 1;
            }
        }
        assert!(columns[2] > 3 && columns[8] > 3, "{columns:?}");
    }
}
