//! Eight numbers at a time, with each instruction set the same operations in the same order, so the same bits.
#![expect(
    unsafe_code,
    reason = "vector instructions, called where there are any, and loads of whole arrays"
)]
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m256, _CMP_LT_OQ, _MM_FROUND_NO_EXC, _MM_FROUND_TO_ZERO, _mm_add_ps, _mm_add_ss, _mm_cvtsi64_si128,
    _mm_cvtss_f32, _mm_movehdup_ps, _mm_movehl_ps, _mm256_add_ps, _mm256_and_ps, _mm256_and_si256,
    _mm256_andnot_ps, _mm256_blendv_ps, _mm256_castps256_ps128, _mm256_cmp_ps, _mm256_cvtepi32_ps,
    _mm256_cvtepu8_epi32, _mm256_cvttps_epi32, _mm256_extractf128_ps, _mm256_i32gather_epi32,
    _mm256_loadu_ps, _mm256_mul_ps, _mm256_or_ps, _mm256_round_ps, _mm256_set1_epi32, _mm256_set1_ps,
    _mm256_storeu_ps, _mm256_sub_ps,
};

/// The greatest number below a half: what is below a half does not become a whole by rounding.
const HALF: f32 = 0.499_999_97;

/// The nearest whole number, of two as near the one farther from 0.
#[inline(always)]
pub(super) fn nearest(value: f32) -> i32 {
    (value + HALF.copysign(value)) as i32
}

/// Numbers in a [`Lanes::look_up`]'s table, and two to read over.
pub(super) const TABLE: usize = 256;
pub(super) type Table = [u16; TABLE + 2];

/// Eight f32.
///
/// # Safety
/// One for an instruction set may only be used in functions that enable it.
pub(super) unsafe trait Lanes: Copy {
    /// All the same.
    fn splat(value: f32) -> Self;

    /// Eight numbers.
    fn load(from: &[f32; 8]) -> Self;

    /// Eight grey levels.
    fn grey(from: [u8; 8]) -> Self;

    /// Writes them.
    fn store(self, to: &mut [f32; 8]);

    /// Sums.
    fn plus(self, other: Self) -> Self;

    /// Differences.
    fn minus(self, other: Self) -> Self;

    /// Products, rounded each.
    fn times(self, other: Self) -> Self;

    /// Without signs.
    fn abs(self) -> Self;

    /// The nearest whole numbers, of two as near the one farther from 0; they are to be below 2²² or so.
    fn nearest(self) -> Self;

    /// Entries of a table, by whole numbers modulo [`TABLE`].
    fn look_up(self, table: &Table) -> Self;

    /// `yes` where these are less than others, elsewhere `no`.
    fn where_less(self, than: Self, yes: Self, no: Self) -> Self;

    /// The lanes' sum, in pairs: those four apart, then those two apart, then the rest.
    fn sum(self) -> f32;
}

// SAFETY: plain Rust; needs no instruction set.
unsafe impl Lanes for [f32; 8] {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; 8]
    }

    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        *from
    }

    #[inline(always)]
    fn grey(from: [u8; 8]) -> Self {
        from.map(f32::from)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        *to = self;
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] - other[k])
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] * other[k])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }

    #[inline(always)]
    fn nearest(self) -> Self {
        self.map(|value| nearest(value) as f32)
    }

    #[inline(always)]
    fn look_up(self, table: &Table) -> Self {
        self.map(|place| table[place as i32 as usize % TABLE].into())
    }

    #[inline(always)]
    fn where_less(self, than: Self, yes: Self, no: Self) -> Self {
        std::array::from_fn(|k| if self[k] < than[k] { yes[k] } else { no[k] })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        let four: [f32; 4] = std::array::from_fn(|k| self[k] + self[k + 4]);
        (four[0] + four[2]) + (four[1] + four[3])
    }
}

// SAFETY: used only in functions that enable AVX2.
#[cfg(target_arch = "x86_64")]
unsafe impl Lanes for __m256 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_set1_ps(value) }
    }

    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        // SAFETY: eight numbers; AVX is enabled.
        unsafe { _mm256_loadu_ps(from.as_ptr()) }
    }

    #[inline(always)]
    fn grey(from: [u8; 8]) -> Self {
        // SAFETY: the trait's promise: AVX2 is enabled.
        unsafe { _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(from)))) }
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        // SAFETY: room for eight numbers; AVX is enabled.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self) }
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_add_ps(self, other) }
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_sub_ps(self, other) }
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_mul_ps(self, other) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self) }
    }

    #[inline(always)]
    fn nearest(self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe {
            let sign = _mm256_and_ps(_mm256_set1_ps(-0.0), self);
            let away = _mm256_add_ps(self, _mm256_or_ps(_mm256_set1_ps(HALF), sign));
            _mm256_round_ps::<{ _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC }>(away)
        }
    }

    #[inline(always)]
    fn look_up(self, table: &Table) -> Self {
        // SAFETY: places modulo 256 in a table of 258, of which each reads two; AVX2 is enabled.
        unsafe {
            let place = _mm256_and_si256(_mm256_cvttps_epi32(self), _mm256_set1_epi32(TABLE as i32 - 1));
            let two = _mm256_i32gather_epi32::<2>(table.as_ptr().cast(), place);
            _mm256_cvtepi32_ps(_mm256_and_si256(two, _mm256_set1_epi32(0xffff)))
        }
    }

    #[inline(always)]
    fn where_less(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_LT_OQ>(self, than)) }
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe {
            let four = _mm_add_ps(_mm256_castps256_ps128(self), _mm256_extractf128_ps::<1>(self));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NUMBERS: [f32; 8] = [-2.5, 1.75, 0.5, -0.5, 3.0, 0.499_999_97, -1e3, 2.499_999_8];

    /// Everything that lanes do, in one list.
    fn all<L: Lanes>() -> Vec<f32> {
        let mut table = [0; TABLE + 2];
        for (k, entry) in table.iter_mut().enumerate() {
            *entry = (k * k + 30_000) as u16;
        }
        let a = L::load(&NUMBERS);
        let b = L::load(&[7.0, 0.1, 255.0, 256.0, 1.0, -1.0, 300.0, 99.0]);
        let grey = L::grey([0, 1, 127, 128, 200, 254, 255, 3]);
        let results = [
            a.plus(b),
            a.minus(b),
            a.times(b),
            a.abs(),
            a.nearest(),
            b.look_up(&table),
            a.where_less(b, grey, L::splat(-9.0)),
            grey,
        ];
        let mut numbers = vec![a.sum(), b.sum(), grey.times(a).sum()];
        for result in results {
            let mut eight = [0.0; 8];
            result.store(&mut eight);
            // One zero is as good as the other.
            numbers.extend(eight.map(|number| number + 0.0));
        }
        numbers
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn all_avx2() -> Vec<f32> {
        all::<__m256>()
    }

    #[test]
    fn eight_at_a_time_are_what_one_after_the_other_is() {
        let plain = all::<[f32; 8]>();
        let sum = (-2.5 + 3.0) + (0.5 - 1e3) + ((1.75 + 0.499_999_97) + (-0.5 + 2.499_999_8));
        assert_eq!(plain[..1], [sum]);
        assert_eq!(
            plain[35..43],
            [-3.0, 2.0, 1.0, -1.0, 3.0, 0.0, -1e3, 2.0],
            "nearest"
        );
        // 7 in the table, 0 for a tenth, 255, and 0 again for 256.
        assert_eq!(plain[43..47], [30_049.0, 30_000.0, 29_489.0, 30_000.0]);
        assert_eq!(plain[51..55], [0.0, -9.0, 127.0, 128.0], "where less");
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has it.
            assert_eq!(unsafe { all_avx2() }, plain);
        }
    }

    #[test]
    fn the_nearest_is_that_of_the_standard_library() {
        for sixteenth in -2_000_i16..=2_000 {
            let value = f32::from(sixteenth) / 16.0;
            for value in [value.next_down(), value, value.next_up()] {
                assert_eq!(nearest(value), value.round() as i32, "{value}");
            }
        }
    }
}
