//! Pairs of 16-bit numbers, multiplied and added in one instruction to sums of 32 bits: twice as many products as in
//! f32 where the processor has AVX-512 VNNI, half as many again with AVX2. Sums are whole numbers, so all instruction
//! sets give the same bits.
#![expect(
    unsafe_code,
    reason = "vector instructions, and loads whose bounds the caller has checked"
)]
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{
    __m256, __m256i, __m512, __m512i, _mm_loadu_si128, _mm256_add_epi32, _mm256_broadcastsi128_si256,
    _mm256_cvtepi32_ps, _mm256_hadd_epi32, _mm256_loadu_ps, _mm256_loadu_si256, _mm256_madd_epi16,
    _mm256_mul_ps, _mm256_permute4x64_epi64, _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_setzero_si256,
    _mm512_add_epi32, _mm512_broadcast_i32x4, _mm512_cvtepi32_ps, _mm512_dpwssd_epi32, _mm512_loadu_ps,
    _mm512_loadu_si512, _mm512_mul_ps, _mm512_permutex2var_epi32, _mm512_set1_epi32, _mm512_set1_epi64,
    _mm512_setr_epi32, _mm512_setzero_si512,
};

use super::vector::{Eight, Sums};

/// Two neighbouring channels of a pixel, or their weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(transparent)]
pub(crate) struct Pair(pub(super) [i16; 2]);

impl Pair {
    /// Whether this processor has what [`InstructionSet::Avx512`](crate::InstructionSet::Avx512) stands for with pairs.
    pub(super) fn has_wide() -> bool {
        #[cfg(target_arch = "x86_64")]
        return is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vnni");
        #[cfg(not(target_arch = "x86_64"))]
        false
    }
}

/// Eight pairs or sums that the compiler puts into whatever vectors the target has.
#[derive(Clone, Copy)]
pub(super) struct EightPairs([i32; 8]);

fn both([low, high]: [i16; 2]) -> i32 {
    i32::from(high) << 16 | i32::from(low) & 0xFFFF
}

// SAFETY: plain Rust; needs no instruction set.
unsafe impl Sums for EightPairs {
    type Number = Pair;
    type Out = Eight;
    const PIXELS_MAX: [usize; 2] = [6, 3];

    #[inline(always)]
    fn zero() -> Self {
        Self([0; 8])
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const Pair) -> Self {
        // SAFETY: the caller says that S pairs can be read there.
        let pairs = unsafe { from.cast::<[Pair; S]>().read_unaligned() };
        Self(std::array::from_fn(|lane| both(pairs[lane % S].0)))
    }

    #[inline(always)]
    unsafe fn load(from: *const Pair) -> Self {
        // SAFETY: the caller says that eight pairs can be read there; the read asks for no alignment.
        let pairs = unsafe { from.cast::<[Pair; 8]>().read_unaligned() };
        Self(pairs.map(|pair| both(pair.0)))
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        let of = |lane: usize| if lane < 8 { self.0[lane] } else { other.0[lane - 8] };
        Self(std::array::from_fn(|lane| {
            of(2 * lane).wrapping_add(of(2 * lane + 1))
        }))
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            let (a, b) = (self.0[lane], weight.0[lane]);
            let low = i32::from(a as i16) * i32::from(b as i16);
            let high = (a >> 16) * (b >> 16);
            // The vector instructions wrap too; weights are such that nothing does.
            sum.0[lane].wrapping_add(low).wrapping_add(high)
        }))
    }

    #[inline(always)]
    unsafe fn out(self, factors: *const f32) -> Eight {
        // SAFETY: the caller says that eight numbers can be read there.
        let factors = unsafe { factors.cast::<[f32; 8]>().read_unaligned() };
        Eight(std::array::from_fn(|lane| self.0[lane] as f32 * factors[lane]))
    }
}

/// Eight pairs or sums.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(super) struct Pairs256(__m256i);

// SAFETY: `block` enters it only through a function that enables AVX2.
#[cfg(target_arch = "x86_64")]
unsafe impl Sums for Pairs256 {
    type Number = Pair;
    type Out = __m256;
    // A register for the products, which are added by an instruction of their own.
    const PIXELS_MAX: [usize; 2] = [10, 5];

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        Self(unsafe { _mm256_setzero_si256() })
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const Pair) -> Self {
        // SAFETY: the caller says that S pairs can be read there; AVX2 is enabled.
        Self(unsafe {
            match S {
                1 => _mm256_set1_epi32(from.cast::<i32>().read_unaligned()),
                2 => _mm256_set1_epi64x(from.cast::<i64>().read_unaligned()),
                _ => _mm256_broadcastsi128_si256(_mm_loadu_si128(from.cast())),
            }
        })
    }

    #[inline(always)]
    unsafe fn load(from: *const Pair) -> Self {
        // SAFETY: the caller says that eight pairs can be read there; AVX is enabled.
        Self(unsafe { _mm256_loadu_si256(from.cast()) })
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        // Within each half, the instruction puts sums of `self` before sums of `other`: quarters 0 2 1 3.
        // SAFETY: the trait's promise: AVX2 is enabled.
        Self(unsafe { _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_hadd_epi32(self.0, other.0)) })
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        // SAFETY: the trait's promise: AVX2 is enabled.
        Self(unsafe { _mm256_add_epi32(sum.0, _mm256_madd_epi16(self.0, weight.0)) })
    }

    #[inline(always)]
    unsafe fn out(self, factors: *const f32) -> __m256 {
        // SAFETY: the caller says that eight numbers can be read there; AVX is enabled.
        unsafe { _mm256_mul_ps(_mm256_cvtepi32_ps(self.0), _mm256_loadu_ps(factors)) }
    }
}

/// Sixteen pairs or sums.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(super) struct Pairs512(__m512i);

// SAFETY: `block` enters it only through a function that enables AVX-512F and VNNI.
#[cfg(target_arch = "x86_64")]
unsafe impl Sums for Pairs512 {
    type Number = Pair;
    type Out = __m512;
    const PIXELS_MAX: [usize; 2] = <__m512 as Sums>::PIXELS_MAX;

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        Self(unsafe { _mm512_setzero_si512() })
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const Pair) -> Self {
        // SAFETY: the caller says that S pairs can be read there; AVX-512F is enabled.
        Self(unsafe {
            match S {
                1 => _mm512_set1_epi32(from.cast::<i32>().read_unaligned()),
                2 => _mm512_set1_epi64(from.cast::<i64>().read_unaligned()),
                _ => _mm512_broadcast_i32x4(_mm_loadu_si128(from.cast())),
            }
        })
    }

    #[inline(always)]
    unsafe fn load(from: *const Pair) -> Self {
        // SAFETY: the caller says that sixteen pairs can be read there; AVX-512F is enabled.
        Self(unsafe { _mm512_loadu_si512(from.cast()) })
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        Self(unsafe {
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            _mm512_add_epi32(
                _mm512_permutex2var_epi32(self.0, even, other.0),
                _mm512_permutex2var_epi32(self.0, odd, other.0),
            )
        })
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        // SAFETY: the trait's promise: VNNI is enabled.
        Self(unsafe { _mm512_dpwssd_epi32(sum.0, self.0, weight.0) })
    }

    #[inline(always)]
    unsafe fn out(self, factors: *const f32) -> __m512 {
        // SAFETY: the caller says that sixteen numbers can be read there; AVX-512F is enabled.
        unsafe { _mm512_mul_ps(_mm512_cvtepi32_ps(self.0), _mm512_loadu_ps(factors)) }
    }
}
