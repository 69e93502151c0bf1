//! Sums over blocks of 8×8 pixels of an 88×88 image: of its grey levels, of their squares, and of their products with
//! two patterns (an image and its gradients). One pass in integers, so every instruction set gives the same bits.

use gripline_kernels::InstructionSet;
use gripline_kernels::simd::{Dispatch, Int16x16, Simd, dispatch_256};

use crate::constants::{BLOCK_SIDE, BLOCKS, BLOCKS_PER_SIDE, IMAGE_PIXELS, IMAGE_SIDE};
use crate::image::Image88;

/// A number for every block, row-major.
pub(crate) type PerBlock<T> = [T; BLOCKS];

/// An image to compare with and its gradients, grey levels per two pixels.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    pub(crate) image: Image88,
    pub(crate) gradient_x: [i8; IMAGE_PIXELS],
    pub(crate) gradient_y: [i8; IMAGE_PIXELS],
}

impl Pattern {
    pub(crate) fn new(image: &Image88) -> Self {
        let mut pattern = Self {
            image: *image,
            gradient_x: [0; IMAGE_PIXELS],
            gradient_y: [0; IMAGE_PIXELS],
        };
        // The gradient is zero at the border. Pictures of particles have no gradient above 127.
        let gradient = |low: u8, high: u8| (i16::from(high) - i16::from(low)).clamp(-127, 127) as i8;
        for row in 0..IMAGE_SIDE {
            let line = &image[row * IMAGE_SIDE..][..IMAGE_SIDE];
            let gradient_x = &mut pattern.gradient_x[row * IMAGE_SIDE..][..IMAGE_SIDE];
            for (slot, triple) in gradient_x[1..].iter_mut().zip(line.windows(3)) {
                *slot = gradient(triple[0], triple[2]);
            }
            if (1..IMAGE_SIDE - 1).contains(&row) {
                let above = &image[(row - 1) * IMAGE_SIDE..][..IMAGE_SIDE];
                let below = &image[(row + 1) * IMAGE_SIDE..][..IMAGE_SIDE];
                let gradient_y = &mut pattern.gradient_y[row * IMAGE_SIDE..][..IMAGE_SIDE];
                for ((slot, &above), &below) in gradient_y.iter_mut().zip(above).zip(below) {
                    *slot = gradient(above, below);
                }
            }
        }
        pattern
    }
}

/// The sums.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BlockSums {
    /// Of grey levels.
    pub(crate) levels: PerBlock<i32>,
    /// Of squared grey levels.
    pub(crate) squares: PerBlock<i32>,
    /// Of products with each pattern's image, x gradient and y gradient.
    pub(crate) products: [[PerBlock<i32>; 3]; 2],
}

impl BlockSums {
    pub(crate) const ZERO: Self = Self {
        levels: [0; BLOCKS],
        squares: [0; BLOCKS],
        products: [[[0; BLOCKS]; 3]; 2],
    };

    /// Sums of `image` and of its products with the patterns.
    ///
    /// # Panics
    /// When the processor lacks the instructions.
    pub(crate) fn compute(&mut self, instructions: InstructionSet, image: &Image88, patterns: [&Pattern; 2]) {
        // Two blocks fill a vector of 256 bits.
        let task = Task {
            sums: self,
            image,
            patterns,
        };
        dispatch_256(instructions, task);
    }
}

struct Task<'a> {
    sums: &'a mut BlockSums,
    image: &'a Image88,
    patterns: [&'a Pattern; 2],
}

impl Dispatch for Task<'_> {
    type Output = ();

    /// Two neighbouring blocks at a time.
    #[expect(
        clippy::inline_always,
        reason = "compiles for the instruction set of its caller"
    )]
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self {
            sums,
            image,
            patterns: [rest, processed],
        } = self;
        let ones = S::Int16x16::splat(1);
        for row in 0..BLOCKS_PER_SIDE {
            for column in (0..BLOCKS_PER_SIDE).step_by(2) {
                // The last pair overlaps the pair before.
                let column = column.min(BLOCKS_PER_SIDE - 2);
                let corner = row * BLOCK_SIDE * IMAGE_SIDE + column * BLOCK_SIDE;
                let mut totals = [S::Int16x16::zero_sums(); 8];
                for line in 0..BLOCK_SIDE {
                    let at = corner + line * IMAGE_SIDE;
                    let pixels = S::Int16x16::from_u8(chunk(image, at));
                    let factors = [
                        ones,
                        pixels,
                        S::Int16x16::from_u8(chunk(&rest.image, at)),
                        S::Int16x16::from_i8(chunk(&rest.gradient_x, at)),
                        S::Int16x16::from_i8(chunk(&rest.gradient_y, at)),
                        S::Int16x16::from_u8(chunk(&processed.image, at)),
                        S::Int16x16::from_i8(chunk(&processed.gradient_x, at)),
                        S::Int16x16::from_i8(chunk(&processed.gradient_y, at)),
                    ];
                    for (total, factor) in totals.iter_mut().zip(factors) {
                        *total = pixels.multiply_add(factor, *total);
                    }
                }
                for (right, totals) in S::Int16x16::totals(totals).into_iter().enumerate() {
                    let block = row * BLOCKS_PER_SIDE + column + right;
                    let [level, square, products @ ..] = totals;
                    sums.levels[block] = level;
                    sums.squares[block] = square;
                    for (k, product) in products.into_iter().enumerate() {
                        sums.products[k / 3][k % 3][block] = product;
                    }
                }
            }
        }
    }
}

/// Sixteen bytes of a row: two blocks.
#[inline]
fn chunk<T>(from: &[T; IMAGE_PIXELS], at: usize) -> &[T; 16] {
    from[at..].first_chunk().expect("two blocks lie in the image")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(seed: usize) -> Image88 {
        std::array::from_fn(|n| (n * (seed * 2 + 7) % 256) as u8)
    }

    #[test]
    fn every_instruction_set_gives_the_sums_of_a_naive_loop() {
        let white = [255; IMAGE_PIXELS];
        for images in [vec![image(1), image(20), image(33)], vec![white; 3]] {
            let a = &images[0];
            let patterns = [&Pattern::new(&images[1]), &Pattern::new(&images[2])];
            for instructions in InstructionSet::ALL.into_iter().filter(|set| set.is_available()) {
                let mut sums = BlockSums::ZERO;
                sums.compute(instructions, a, patterns);
                for block in 0..BLOCKS {
                    let (top, left) = (block / 11 * 8, block % 11 * 8);
                    let of = |f: &dyn Fn(usize) -> i32| -> i32 {
                        (0..64).map(|n| f((top + n / 8) * 88 + left + n % 8)).sum()
                    };
                    assert_eq!(sums.levels[block], of(&|at| i32::from(a[at])));
                    assert_eq!(sums.squares[block], of(&|at| i32::from(a[at]).pow(2)));
                    for (pattern, products) in patterns.into_iter().zip(&sums.products) {
                        let expected = [
                            of(&|at| i32::from(a[at]) * i32::from(pattern.image[at])),
                            of(&|at| i32::from(a[at]) * i32::from(pattern.gradient_x[at])),
                            of(&|at| i32::from(a[at]) * i32::from(pattern.gradient_y[at])),
                        ];
                        assert_eq!(products.map(|product| product[block]), expected);
                    }
                }
            }
        }
    }

    #[test]
    fn gradients_are_those_of_a_ramp_and_zero_at_the_border() {
        let pattern = Pattern::new(&std::array::from_fn(|n| (240 - 2 * (n % 88) + n / 88 / 8) as u8));
        for (n, (gradient_x, gradient_y)) in pattern.gradient_x.iter().zip(&pattern.gradient_y).enumerate() {
            let (row, inside) = (n / 88, |at: usize| (1..87).contains(&at));
            assert_eq!(*gradient_x, if inside(n % 88) { -4 } else { 0 }, "pixel {n}");
            // One level more every eight rows, seen from the row before and from the row itself.
            let step = inside(row) && (row % 8 == 0 || row % 8 == 7);
            assert_eq!(*gradient_y, i8::from(step), "pixel {n}");
        }
    }
}
