//! A window of the rest image, and where in the image now it fits best: block matching, to a part of a pixel.

use super::compare::{Compare, difference};
use super::pyramid::Level;

/// Side of the compared windows, pixels of their level.
pub(super) const WINDOW: usize = 8;
/// Farthest that a search reaches, pixels of its level.
pub(super) const REACH_MOST: usize = 4;

/// A window of the rest image, to be found in the image now.
pub(super) struct Window {
    pixels: [[u8; WINDOW]; WINDOW],
    corner: [i32; 2],
}

impl Window {
    #[inline]
    pub(super) fn new<const SIDE: usize>(rest: &Level<SIDE>, centre: [i32; 2]) -> Self {
        let corner = centre.map(|c| c - WINDOW as i32 / 2);
        let rows = rest.rows::<WINDOW>(corner[0], corner[1]);
        Self {
            pixels: std::array::from_fn(|row| *rows.at(row, 0)),
            corner,
        }
    }

    /// Sum of absolute differences at a motion.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn cost<const SIDE: usize>(&self, now: &Level<SIDE>, [dx, dy]: [i32; 2]) -> u32 {
        difference(&self.pixels, &now.rows(self.corner[0] + dx, self.corner[1] + dy))
    }

    /// The best motion within `reach` of `guess`, to a part of a pixel.
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    pub(super) fn best<C: Compare, const SIDE: usize>(
        &self,
        now: &Level<SIDE>,
        guess: [i32; 2],
        reach: i32,
    ) -> [f32; 2] {
        let mut costs = Costs {
            window: self,
            now,
            guess,
            reach,
            eights: [[0; 8]; 2 * REACH_MOST + 1],
        };
        let beside = beside(reach);
        let mut best = (u32::MAX, [0; 2]);
        for (row, dy) in (-reach..=reach).enumerate() {
            let rows = now.rows(self.corner[0] + guess[0] - reach, self.corner[1] + guess[1] + dy);
            let eight = C::eight(&self.pixels, &rows);
            costs.eights[row] = eight;
            // Of equal ones the nearest.
            let off = 2 * (dy * dy) as u32;
            let (cost, place) = C::least(&eight, &beside);
            let cost = u32::from(cost) + off;
            if cost < best.0 {
                best = (cost, [place as i32 - reach, dy]);
            }
            for dx in 8 - reach..=reach {
                let cost = self.cost(now, [guess[0] + dx, guess[1] + dy]) + 2 * (dx * dx) as u32 + off;
                if cost < best.0 {
                    best = (cost, [dx, dy]);
                }
            }
        }
        let [x, y] = best.1;
        let here = costs.at([x, y]);
        [
            (guess[0] + x) as f32 + vertex(costs.at([x - 1, y]), here, costs.at([x + 1, y])),
            (guess[1] + y) as f32 + vertex(costs.at([x, y - 1]), here, costs.at([x, y + 1])),
        ]
    }
}

/// What windows eight columns from the farthest one on cost for their place, squares of the distance; those beyond `reach` all.
fn beside(reach: i32) -> [u16; 8] {
    let mut of = [u16::MAX; 8];
    for (of, dx) in of.iter_mut().zip(-reach..=reach) {
        *of = 2 * (dx * dx) as u16;
    }
    of
}

/// The differences of a window at motions around a guess, eight columns of them from the farthest on.
struct Costs<'a, const SIDE: usize> {
    window: &'a Window,
    now: &'a Level<SIDE>,
    guess: [i32; 2],
    reach: i32,
    eights: [[u16; 8]; 2 * REACH_MOST + 1],
}

impl<const SIDE: usize> Costs<'_, SIDE> {
    #[expect(
        clippy::inline_always,
        reason = "compiled for the instruction set of its caller"
    )]
    #[inline(always)]
    fn at(&self, [dx, dy]: [i32; 2]) -> u32 {
        let [column, row] = [dx + self.reach, dy + self.reach];
        if (0..8).contains(&column) && (0..=2 * self.reach).contains(&row) {
            self.eights[row as usize][column as usize].into()
        } else {
            self.window
                .cost(self.now, [self.guess[0] + dx, self.guess[1] + dy])
        }
    }
}

/// How far from `here` to `low` or `high`, a pixel away, the least difference lies. The sum of absolute differences has a kink
/// at its minimum: two lines rather than a parabola.
#[inline]
fn vertex(low: u32, here: u32, high: u32) -> f32 {
    let [low, high] = [low, high].map(|cost| cost as f32 - here as f32);
    let steep = low.max(high);
    if steep > 0.0 {
        (0.5 * (low - high) / steep).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

#[cfg(test)]
#[expect(
    unsafe_code,
    reason = "functions for an instruction set, called where there is one"
)]
mod tests {
    use super::super::changed::Changed;
    #[cfg(target_arch = "x86_64")]
    use super::super::compare::Avx2;
    use super::super::compare::Plain;
    use super::super::pyramid::Pyramid;
    use super::*;

    /// One motion after the other, as it is meant.
    fn one_by_one<const SIDE: usize>(
        window: &Window,
        now: &Level<SIDE>,
        guess: [i32; 2],
        reach: i32,
    ) -> [f32; 2] {
        let cost = |dx: i32, dy: i32| window.cost(now, [guess[0] + dx, guess[1] + dy]);
        let (_, dy, dx) = (-reach..=reach)
            .flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx)))
            .map(|(dy, dx)| (cost(dx, dy) + 2 * (dx * dx + dy * dy) as u32, dy, dx))
            .min()
            .expect("motions");
        let here = cost(dx, dy);
        [
            (guess[0] + dx) as f32 + vertex(cost(dx - 1, dy), here, cost(dx + 1, dy)),
            (guess[1] + dy) as f32 + vertex(cost(dx, dy - 1), here, cost(dx, dy + 1)),
        ]
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn by_avx2<const SIDE: usize>(
        window: &Window,
        now: &Level<SIDE>,
        guess: [i32; 2],
        reach: i32,
    ) -> [f32; 2] {
        window.best::<Avx2, SIDE>(now, guess, reach)
    }

    #[test]
    fn eight_motions_at_once_find_what_one_after_the_other_do() {
        let picture = |shift: [usize; 2]| {
            let pixels: Vec<u8> = (0..440 * 440_usize)
                .map(|at| {
                    let [x, y] = [at % 440 + shift[0], at / 440 + shift[1]];
                    // Coarse, and in places all the same.
                    if y % 160 < 40 {
                        90
                    } else {
                        (x / 8 * 37 % 101 + y / 8 * 53 % 89) as u8
                    }
                })
                .collect();
            let mut pyramid = Pyramid::new();
            pyramid.take(&pixels, &Changed::everything());
            pyramid
        };
        let rest = picture([32, 24]);
        let mut columns = [0; 2 * REACH_MOST + 1];
        for (number, guess) in [[0, 0], [2, -1], [-3, 1]]
            .into_iter()
            .cycle()
            .take(60)
            .enumerate()
        {
            let now = picture([8 * (number % 9), 8 * (number % 7)]);
            for place in 0..9 {
                let centre = [6 + 5 * (place % 3), 8 + 12 * (place / 3)];
                let window = Window::new(&rest.eighth, centre);
                let expected = [4, 2]
                    .map(|reach| one_by_one(&window, &now.eighth, guess, reach))
                    .to_vec();
                let found = [4, 2].map(|reach| window.best::<Plain, _>(&now.eighth, guess, reach));
                assert_eq!(found[..], expected);
                #[cfg(target_arch = "x86_64")]
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has it.
                    let found = unsafe { [4, 2].map(|reach| by_avx2(&window, &now.eighth, guess, reach)) };
                    assert_eq!(found[..], expected);
                }
                let [x, _] = expected[0];
                columns[(x.round() as i32 - guess[0] + 4).clamp(0, 8) as usize] += 1;
            }
        }
        assert!(columns[2] > 3 && columns[8] > 3, "{columns:?}");
    }
}
