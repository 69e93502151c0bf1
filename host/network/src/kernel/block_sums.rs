//! Sums over blocks of 8×8 pixels of an 88×88 image: of its grey levels, of their squares, and of their products with
//! two patterns, each an image and its slopes. One pass, integers only, so every instruction set gives the same bits.
#![expect(
    unsafe_code,
    reason = "functions for an instruction set, called where there is one"
)]
#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m128i, _mm_add_epi64, _mm_cvtsi128_si32, _mm_cvtsi128_si64, _mm_extract_epi32, _mm_extract_epi64,
    _mm_loadu_si128, _mm_sad_epu8, _mm_setzero_si128, _mm256_add_epi32, _mm256_castsi256_si128,
    _mm256_cvtepi8_epi16, _mm256_cvtepu8_epi16, _mm256_extracti128_si256, _mm256_hadd_epi32,
    _mm256_madd_epi16, _mm256_setzero_si256,
};

use crate::constants::{BLOCK_SIDE, BLOCKS, BLOCKS_PER_SIDE, IMAGE_PIXELS, IMAGE_SIDE};
use crate::image::Image88;
use crate::instruction_set::InstructionSet;

/// A number for every block, row-major.
pub(crate) type PerBlock<T> = [T; BLOCKS];

/// An image to compare with, and how its grey levels rise along rows and columns, levels per two pixels.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    pub(crate) image: Image88,
    pub(crate) across: [i8; IMAGE_PIXELS],
    pub(crate) down: [i8; IMAGE_PIXELS],
}

impl Pattern {
    pub(crate) fn new(image: &Image88) -> Self {
        let mut pattern = Self {
            image: *image,
            across: [0; IMAGE_PIXELS],
            down: [0; IMAGE_PIXELS],
        };
        // Beyond the border nothing rises. No slope of a picture of particles needs more than seven bits and a sign.
        let slope = |low: u8, high: u8| (i16::from(high) - i16::from(low)).clamp(-127, 127) as i8;
        for row in 0..IMAGE_SIDE {
            let line = &image[row * IMAGE_SIDE..][..IMAGE_SIDE];
            let across = &mut pattern.across[row * IMAGE_SIDE..][..IMAGE_SIDE];
            for (slot, triple) in across[1..].iter_mut().zip(line.windows(3)) {
                *slot = slope(triple[0], triple[2]);
            }
            if (1..IMAGE_SIDE - 1).contains(&row) {
                let above = &image[(row - 1) * IMAGE_SIDE..][..IMAGE_SIDE];
                let below = &image[(row + 1) * IMAGE_SIDE..][..IMAGE_SIDE];
                let down = &mut pattern.down[row * IMAGE_SIDE..][..IMAGE_SIDE];
                for ((slot, &above), &below) in down.iter_mut().zip(above).zip(below) {
                    *slot = slope(above, below);
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
    /// Of products with each pattern's image, slopes across and slopes down.
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
    pub(crate) fn take(&mut self, instructions: InstructionSet, image: &Image88, patterns: [&Pattern; 2]) {
        assert!(
            instructions.is_available(),
            "this processor has no {instructions}"
        );
        match instructions {
            InstructionSet::Portable => run(self, image, patterns),
            // Two blocks fill a vector: wider ones gain little.
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has it, see above; AVX-512F implies AVX2.
            InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { run_avx2(self, image, patterns) },
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => run(self, image, patterns),
        }
    }
}

/// Two blocks beside each other at once: products of 16-bit numbers, summed in pairs by the instruction that there is for
/// just this.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2(sums: &mut BlockSums, image: &Image88, patterns: [&Pattern; 2]) {
    let [rest, processed] = patterns;
    for row in 0..BLOCKS_PER_SIDE {
        for column in (0..BLOCKS_PER_SIDE).step_by(2) {
            // The last pair is one block of the pair before, again, and the last block.
            let column = column.min(BLOCKS_PER_SIDE - 2);
            let corner = row * BLOCK_SIDE * IMAGE_SIDE + column * BLOCK_SIDE;
            let mut level = _mm_setzero_si128();
            let mut lanes = [_mm256_setzero_si256(); 8];
            for line in 0..BLOCK_SIDE {
                let at = corner + line * IMAGE_SIDE;
                let bytes = sixteen(image, at);
                let pixels = _mm256_cvtepu8_epi16(bytes);
                level = _mm_add_epi64(level, _mm_sad_epu8(bytes, _mm_setzero_si128()));
                let others = [
                    pixels,
                    _mm256_cvtepu8_epi16(sixteen(&rest.image, at)),
                    _mm256_cvtepi8_epi16(sixteen(&rest.across, at)),
                    _mm256_cvtepi8_epi16(sixteen(&rest.down, at)),
                    _mm256_cvtepu8_epi16(sixteen(&processed.image, at)),
                    _mm256_cvtepi8_epi16(sixteen(&processed.across, at)),
                    _mm256_cvtepi8_epi16(sixteen(&processed.down, at)),
                ];
                for (lanes, other) in lanes.iter_mut().zip(others) {
                    *lanes = _mm256_add_epi32(*lanes, _mm256_madd_epi16(pixels, other));
                }
            }
            // Of each block, whose four lanes are a half of a vector, the first four sums and the last three.
            let [a, b, c, d, e, f, g, nothing] = lanes;
            let first = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
            let last = _mm256_hadd_epi32(_mm256_hadd_epi32(e, f), _mm256_hadd_epi32(g, nothing));
            let levels = [_mm_cvtsi128_si64(level), _mm_extract_epi64::<1>(level)];
            let halves = [
                (_mm256_castsi256_si128(first), _mm256_castsi256_si128(last)),
                (
                    _mm256_extracti128_si256::<1>(first),
                    _mm256_extracti128_si256::<1>(last),
                ),
            ];
            for (right, ((first, last), level)) in halves.into_iter().zip(levels).enumerate() {
                let block = row * BLOCKS_PER_SIDE + column + right;
                sums.levels[block] = level as i32;
                sums.squares[block] = _mm_cvtsi128_si32(first);
                sums.products[0][0][block] = _mm_extract_epi32::<1>(first);
                sums.products[0][1][block] = _mm_extract_epi32::<2>(first);
                sums.products[0][2][block] = _mm_extract_epi32::<3>(first);
                sums.products[1][0][block] = _mm_cvtsi128_si32(last);
                sums.products[1][1][block] = _mm_extract_epi32::<1>(last);
                sums.products[1][2][block] = _mm_extract_epi32::<2>(last);
            }
        }
    }
}

/// Sixteen bytes of an image.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
fn sixteen<T: Byte>(from: &[T; IMAGE_PIXELS], at: usize) -> __m128i {
    let bytes: &[T; 16] = from[at..]
        .first_chunk()
        .expect("a pair of blocks lies in the image");
    // SAFETY: sixteen bytes can be read there; alignment does not matter.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}

/// A number of one byte.
#[cfg(target_arch = "x86_64")]
trait Byte {}
#[cfg(target_arch = "x86_64")]
impl Byte for u8 {}
#[cfg(target_arch = "x86_64")]
impl Byte for i8 {}

/// Eight pixels of a row.
#[inline]
fn eight<T: Copy + Into<i32>>(from: &[T; IMAGE_PIXELS], at: usize) -> [i32; 8] {
    let pixels: [T; 8] = std::array::from_fn(|n| from[at + n]);
    pixels.map(Into::into)
}

fn run(sums: &mut BlockSums, image: &Image88, patterns: [&Pattern; 2]) {
    for block in 0..BLOCKS {
        let corner = block / BLOCKS_PER_SIDE * BLOCK_SIDE * IMAGE_SIDE + block % BLOCKS_PER_SIDE * BLOCK_SIDE;
        let mut level = [0_i32; 8];
        let mut lanes = [[0_i32; 8]; 7];
        for row in 0..BLOCK_SIDE {
            let at = corner + row * IMAGE_SIDE;
            let pixels = eight(image, at);
            let others = [
                pixels,
                eight(&patterns[0].image, at),
                eight(&patterns[0].across, at),
                eight(&patterns[0].down, at),
                eight(&patterns[1].image, at),
                eight(&patterns[1].across, at),
                eight(&patterns[1].down, at),
            ];
            for n in 0..8 {
                level[n] += pixels[n];
            }
            for (lanes, other) in lanes.iter_mut().zip(&others) {
                for n in 0..8 {
                    lanes[n] += pixels[n] * other[n];
                }
            }
        }
        let of = |lane: usize| lanes[lane].iter().sum::<i32>();
        sums.levels[block] = level.iter().sum();
        sums.squares[block] = of(0);
        for k in 0..3 {
            sums.products[0][k][block] = of(1 + k);
            sums.products[1][k][block] = of(4 + k);
        }
    }
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
                sums.take(instructions, a, patterns);
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
                            of(&|at| i32::from(a[at]) * i32::from(pattern.across[at])),
                            of(&|at| i32::from(a[at]) * i32::from(pattern.down[at])),
                        ];
                        assert_eq!(products.map(|product| product[block]), expected);
                    }
                }
            }
        }
    }

    #[test]
    fn slopes_are_those_of_a_ramp_and_end_at_the_border() {
        let pattern = Pattern::new(&std::array::from_fn(|n| (240 - 2 * (n % 88) + n / 88 / 8) as u8));
        for (n, (across, down)) in pattern.across.iter().zip(&pattern.down).enumerate() {
            let (row, inside) = (n / 88, |at: usize| (1..87).contains(&at));
            assert_eq!(*across, if inside(n % 88) { -4 } else { 0 }, "pixel {n}");
            // One level more every eight rows, seen from the row before and from the row itself.
            let step = inside(row) && (row % 8 == 0 || row % 8 == 7);
            assert_eq!(*down, i8::from(step), "pixel {n}");
        }
    }
}
