//! How much a window of the rest image differs from places in the image now: sums of absolute differences of rows of
//! eight pixels. Integers, so every way gives the same sums.
#![expect(
    unsafe_code,
    reason = "functions for an instruction set, called where there is one"
)]
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m128i, __m256, _mm_add_epi16, _mm_adds_epu16, _mm_cvtsi128_si32, _mm_loadu_si128, _mm_minpos_epu16,
    _mm_set1_epi64x, _mm_storeu_si128, _mm256_add_epi16, _mm256_broadcastsi128_si256, _mm256_castsi256_si128,
    _mm256_extracti128_si256, _mm256_mpsadbw_epu8, _mm256_setzero_si256,
};

use super::lanes::Lanes;
use super::pyramid::Rows;

/// The difference at the rows' first place.
#[inline(always)]
pub(super) fn difference<const SIDE: usize, const ROWS: usize>(
    window: &[[u8; 8]; ROWS],
    rows: &Rows<'_, SIDE, ROWS>,
) -> u32 {
    difference_beside(window, rows, 0)
}

/// The same so far to the right.
#[inline(always)]
fn difference_beside<const SIDE: usize, const ROWS: usize>(
    window: &[[u8; 8]; ROWS],
    rows: &Rows<'_, SIDE, ROWS>,
    right: usize,
) -> u32 {
    let mut sum = 0;
    for (down, a) in window.iter().enumerate() {
        // So simple that the compiler sees the one instruction there is for it.
        let b: &[u8; 8] = rows.at(down, right);
        for k in 0..8 {
            sum += u32::from(a[k].abs_diff(b[k]));
        }
    }
    sum
}

/// A way to compare windows of at most 32 rows.
///
/// # Safety
/// One for an instruction set may only be used in functions that enable it.
pub(super) unsafe trait Compare: Copy {
    /// Eight numbers by the same instruction set.
    type Lanes: Lanes;

    /// The differences at the rows' first place and at the seven to the right of it.
    fn eight<const SIDE: usize, const ROWS: usize>(
        window: &[[u8; 8]; ROWS],
        rows: &Rows<'_, SIDE, ROWS>,
    ) -> [u16; 8];

    /// The least of eight numbers that were added to others, and its place: of equal ones the first. Sums end at the
    /// greatest there is.
    fn least(of: &[u16; 8], plus: &[u16; 8]) -> (u16, usize);
}

/// One place after the other.
#[derive(Clone, Copy)]
pub(super) struct Plain;

// SAFETY: plain Rust; needs no instruction set.
unsafe impl Compare for Plain {
    type Lanes = [f32; 8];

    #[inline(always)]
    fn eight<const SIDE: usize, const ROWS: usize>(
        window: &[[u8; 8]; ROWS],
        rows: &Rows<'_, SIDE, ROWS>,
    ) -> [u16; 8] {
        let mut sums = [0; 8];
        for (right, sum) in sums.iter_mut().enumerate() {
            *sum = difference_beside(window, rows, right) as u16;
        }
        sums
    }

    #[inline(always)]
    fn least(of: &[u16; 8], plus: &[u16; 8]) -> (u16, usize) {
        let mut least = (u16::MAX, 0);
        for (place, (a, b)) in of.iter().zip(plus).enumerate() {
            let sum = a.saturating_add(*b);
            if sum < least.0 {
                least = (sum, place);
            }
        }
        least
    }
}

/// By AVX2's instruction for just this, which takes four pixels at eight places, twice.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(super) struct Avx2;

// SAFETY: used only in functions that enable AVX2.
#[cfg(target_arch = "x86_64")]
unsafe impl Compare for Avx2 {
    type Lanes = __m256;

    #[inline(always)]
    fn eight<const SIDE: usize, const ROWS: usize>(
        window: &[[u8; 8]; ROWS],
        rows: &Rows<'_, SIDE, ROWS>,
    ) -> [u16; 8] {
        // SAFETY: the caller's function enables AVX2.
        unsafe { eight_avx2(window, rows) }
    }

    #[inline(always)]
    fn least(of: &[u16; 8], plus: &[u16; 8]) -> (u16, usize) {
        // SAFETY: sixteen bytes each; the caller's function enables AVX2, and so SSE4.1.
        let least = unsafe {
            let of = _mm_loadu_si128(of.as_ptr().cast());
            let plus = _mm_loadu_si128(plus.as_ptr().cast());
            _mm_cvtsi128_si32(_mm_minpos_epu16(_mm_adds_epu16(of, plus)))
        };
        (least as u16, (least >> 16) as usize)
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
fn eight_avx2<const SIDE: usize, const ROWS: usize>(
    window: &[[u8; 8]; ROWS],
    rows: &Rows<'_, SIDE, ROWS>,
) -> [u16; 8] {
    /// Of the lower half of a vector the first four pixels of the window; of the upper one the last four.
    const HALVES: i32 = 0b101_000;
    let mut sums = _mm256_setzero_si256();
    for (down, a) in window.iter().enumerate() {
        let now: &[u8; 16] = rows.at(down, 0);
        // SAFETY: sixteen bytes.
        let now = _mm256_broadcastsi128_si256(unsafe { _mm_loadu_si128(now.as_ptr().cast()) });
        let window = _mm256_broadcastsi128_si256(_mm_set1_epi64x(i64::from_le_bytes(*a)));
        sums = _mm256_add_epi16(sums, _mm256_mpsadbw_epu8::<HALVES>(now, window));
    }
    let sums: __m128i = _mm_add_epi16(_mm256_castsi256_si128(sums), _mm256_extracti128_si256::<1>(sums));
    let mut out = [0; 8];
    // SAFETY: sixteen bytes.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), sums) };
    out
}

#[cfg(test)]
mod tests {
    use super::super::changed::Changed;
    use super::super::pyramid::Pyramid;
    use super::*;

    fn compared<C: Compare>(window: &[[u8; 8]; 7], image: &Pyramid, place: [i32; 2]) -> [u16; 8] {
        C::eight(window, &image.full.rows(place[0], place[1]))
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn compared_avx2(window: &[[u8; 8]; 7], image: &Pyramid, place: [i32; 2]) -> [u16; 8] {
        compared::<Avx2>(window, image, place)
    }

    #[test]
    fn every_way_gives_the_sums_of_single_places_up_to_the_largest_there_are() {
        let mut image = Pyramid::new();
        let mut crop: Vec<u8> = (0..440 * 440_usize)
            .map(|i| (i * i % 251 + i / 7 % 5) as u8)
            .collect();
        crop[..100 * 440].fill(255);
        image.take(&crop, &Changed::everything());
        let places = [[-20, -20], [3, 5], [200, 110], [433, 97], [440, 450]];
        for place in places {
            for window in [
                [[0; 8]; 7],
                std::array::from_fn(|row| std::array::from_fn(|k| (row * 37 + k * k * 5) as u8)),
            ] {
                let expected: [u16; 8] = std::array::from_fn(|right| {
                    difference(&window, &image.full.rows(place[0] + right as i32, place[1])) as u16
                });
                assert_eq!(compared::<Plain>(&window, &image, place), expected);
                #[cfg(target_arch = "x86_64")]
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has it.
                    assert_eq!(unsafe { compared_avx2(&window, &image, place) }, expected);
                }
            }
        }
        assert_eq!(compared::<Plain>(&[[0; 8]; 7], &image, [10, 10]), [255 * 56; 8]);
    }
}
