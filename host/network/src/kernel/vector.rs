//! Vectors of f32 as the kernels need them, one type per instruction set. Every operation is `inline(always)`,
//! so that it is compiled for the instruction set of the function it ends up in.
//!
//! NaN and −0 are the same in all of them: `negative_to_zero` keeps both.
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
    __m256, __m512, _mm_loadu_ps, _mm256_add_ps, _mm256_broadcast_ps, _mm256_castpd_ps, _mm256_castps_pd,
    _mm256_cmpgt_epi32, _mm256_fmadd_ps, _mm256_hadd_ps, _mm256_loadu_ps, _mm256_maskstore_ps, _mm256_max_ps,
    _mm256_permute4x64_pd, _mm256_set1_epi32, _mm256_set1_pd, _mm256_set1_ps, _mm256_setr_epi32,
    _mm256_setzero_ps, _mm256_storeu_ps, _mm512_add_ps, _mm512_broadcast_f32x4, _mm512_castpd_ps,
    _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_mask_storeu_ps, _mm512_max_ps, _mm512_permutex2var_ps,
    _mm512_set1_pd, _mm512_set1_ps, _mm512_setr_epi32, _mm512_setzero_ps, _mm512_storeu_ps,
};

/// Largest number of lanes of any vector.
pub(crate) const LANES_MAX: usize = 16;

/// A vector of f32 that comes out of a convolution.
///
/// # Safety
/// Implementations for an instruction set may only be used in functions that enable it.
pub(super) unsafe trait Vector: Copy {
    /// Numbers in a vector.
    const LANES: usize;

    /// The `LANES` numbers from `from` on.
    ///
    /// # Safety
    /// They must be readable; alignment does not matter.
    unsafe fn load(from: *const f32) -> Self;

    /// Writes the first `out.len()` lanes, at most all.
    fn store(self, out: &mut [f32]);

    /// `self + other`.
    fn plus(self, other: Self) -> Self;

    /// Lanes below zero become +0; NaN and −0 stay.
    fn negative_to_zero(self) -> Self;
}

/// A vector of what is multiplied, or of the sums of products.
///
/// # Safety
/// Implementations for an instruction set may only be used in functions that enable it.
pub(super) unsafe trait Sums: Copy {
    /// What is multiplied.
    type Number;

    /// What becomes of sums; it has as many lanes.
    type Out: Vector;

    /// Output pixels whose sums fit the registers with one vector of sums each, and with two.
    const PIXELS_MAX: [usize; 2];

    /// Sums of nothing.
    fn zero() -> Self;

    /// The `S` (1, 2 or 4) numbers from `from` on, over and over.
    ///
    /// # Safety
    /// They must be readable; alignment does not matter.
    unsafe fn repeat<const S: usize>(from: *const Self::Number) -> Self;

    /// As many numbers as there are lanes, from `from` on.
    ///
    /// # Safety
    /// They must be readable; alignment does not matter.
    unsafe fn load(from: *const Self::Number) -> Self;

    /// The sums of neighbouring lanes: half as many as there are of `self`, then those of `other`.
    fn pair_sums(self, other: Self) -> Self;

    /// `self · weight + sum`.
    fn times_plus(self, weight: Self, sum: Self) -> Self;

    /// The sums in f32, times what each of them is worth.
    ///
    /// # Safety
    /// As many factors must be readable as there are lanes.
    unsafe fn out(self, factors: *const f32) -> Self::Out;
}

/// Eight numbers that the compiler puts into whatever vectors the target has.
#[derive(Clone, Copy)]
pub(super) struct Eight(pub(super) [f32; 8]);

// SAFETY: plain Rust; needs no instruction set.
unsafe impl Vector for Eight {
    const LANES: usize = 8;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller says that eight numbers can be read there; the read asks for no alignment.
        Self(unsafe { from.cast::<[f32; 8]>().read_unaligned() })
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        match out.as_mut_array::<8>() {
            Some(out) => *out = self.0,
            None => out.copy_from_slice(&self.0[..out.len()]),
        }
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] + other.0[lane]))
    }

    #[inline(always)]
    fn negative_to_zero(self) -> Self {
        Self(self.0.map(|value| if value < 0.0 { 0.0 } else { value }))
    }
}

// SAFETY: plain Rust; needs no instruction set.
unsafe impl Sums for Eight {
    type Number = f32;
    type Out = Self;

    // Of SSE2's sixteen registers, two for each vector of sums, two for the weights, one for a product.
    const PIXELS_MAX: [usize; 2] = [6, 3];

    #[inline(always)]
    fn zero() -> Self {
        Self([0.0; 8])
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller says that S numbers can be read there.
        let numbers = unsafe { from.cast::<[f32; S]>().read_unaligned() };
        Self(std::array::from_fn(|lane| numbers[lane % S]))
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: as here.
        unsafe { <Self as Vector>::load(from) }
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        let of = |lane: usize| if lane < 8 { self.0[lane] } else { other.0[lane - 8] };
        Self(std::array::from_fn(|lane| of(2 * lane) + of(2 * lane + 1)))
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            self.0[lane] * weight.0[lane] + sum.0[lane]
        }))
    }

    #[inline(always)]
    unsafe fn out(self, _factors: *const f32) -> Self {
        self
    }
}

// SAFETY: `block` enters it only through a function that enables AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
unsafe impl Vector for __m256 {
    const LANES: usize = 8;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller says that eight numbers can be read there; AVX is enabled.
        unsafe { _mm256_loadu_ps(from) }
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        let lanes = out.len();
        assert!(lanes <= 8, "a vector of 8 cannot fill {lanes} numbers");
        if lanes == 8 {
            // SAFETY: the slice has eight numbers; AVX is enabled.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), self) }
        } else {
            // SAFETY: the mask has the first `lanes` lanes, so only the slice's numbers are touched; AVX2 is enabled.
            unsafe {
                let index = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                let mask = _mm256_cmpgt_epi32(_mm256_set1_epi32(lanes as i32), index);
                _mm256_maskstore_ps(out.as_mut_ptr(), mask, self);
            }
        }
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_add_ps(self, other) }
    }

    #[inline(always)]
    fn negative_to_zero(self) -> Self {
        // The instruction returns its second operand when one is NaN or both are zeros.
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_max_ps(_mm256_setzero_ps(), self) }
    }
}

// SAFETY: `block` enters it only through a function that enables AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
unsafe impl Sums for __m256 {
    type Number = f32;
    type Out = Self;

    // Sixteen registers: sums, weights, one input.
    const PIXELS_MAX: [usize; 2] = [12, 6];

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: the trait's promise: AVX is enabled.
        unsafe { _mm256_set1_ps(0.0) }
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller says that S numbers can be read there; AVX is enabled.
        unsafe {
            match S {
                1 => _mm256_set1_ps(*from),
                2 => _mm256_castpd_ps(_mm256_set1_pd(from.cast::<f64>().read_unaligned())),
                _ => _mm256_broadcast_ps(&_mm_loadu_ps(from)),
            }
        }
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: as here.
        unsafe { <Self as Vector>::load(from) }
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        // Within each half, the instruction puts sums of `self` before sums of `other`: quarters 0 2 1 3.
        // SAFETY: the trait's promise: AVX2 is enabled.
        unsafe {
            let sums = _mm256_castps_pd(_mm256_hadd_ps(self, other));
            _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(sums))
        }
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        // SAFETY: the trait's promise: FMA is enabled.
        unsafe { _mm256_fmadd_ps(self, weight, sum) }
    }

    #[inline(always)]
    unsafe fn out(self, _factors: *const f32) -> Self {
        self
    }
}

// SAFETY: `block` enters it only through a function that enables AVX-512F.
#[cfg(target_arch = "x86_64")]
unsafe impl Vector for __m512 {
    const LANES: usize = 16;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller says that sixteen numbers can be read there; AVX-512F is enabled.
        unsafe { _mm512_loadu_ps(from) }
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        let lanes = out.len();
        assert!(lanes <= 16, "a vector of 16 cannot fill {lanes} numbers");
        if lanes == 16 {
            // SAFETY: the slice has sixteen numbers; AVX-512F is enabled.
            unsafe { _mm512_storeu_ps(out.as_mut_ptr(), self) }
        } else {
            // SAFETY: the mask has `lanes` bits, so only the slice's numbers are touched; AVX-512F is enabled.
            unsafe { _mm512_mask_storeu_ps(out.as_mut_ptr(), (1u16 << lanes) - 1, self) }
        }
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    fn negative_to_zero(self) -> Self {
        // The instruction returns its second operand when one is NaN or both are zeros.
        // SAFETY: the trait's promise: AVX-512F is enabled.
        unsafe { _mm512_max_ps(_mm512_setzero_ps(), self) }
    }
}

// SAFETY: `block` enters it only through a function that enables AVX-512F.
#[cfg(target_arch = "x86_64")]
unsafe impl Sums for __m512 {
    type Number = f32;
    type Out = Self;

    // Thirty-two registers would hold more sums, but the loop has no registers for more pixels' addresses:
    // eleven with two vectors each take a quarter longer per pixel.
    const PIXELS_MAX: [usize; 2] = [12, 10];

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        unsafe { _mm512_set1_ps(0.0) }
    }

    #[inline(always)]
    unsafe fn repeat<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller says that S numbers can be read there; AVX-512F is enabled.
        unsafe {
            match S {
                1 => _mm512_set1_ps(*from),
                2 => _mm512_castpd_ps(_mm512_set1_pd(from.cast::<f64>().read_unaligned())),
                _ => _mm512_broadcast_f32x4(_mm_loadu_ps(from)),
            }
        }
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: as here.
        unsafe { <Self as Vector>::load(from) }
    }

    #[inline(always)]
    fn pair_sums(self, other: Self) -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        unsafe {
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            _mm512_add_ps(
                _mm512_permutex2var_ps(self, even, other),
                _mm512_permutex2var_ps(self, odd, other),
            )
        }
    }

    #[inline(always)]
    fn times_plus(self, weight: Self, sum: Self) -> Self {
        // SAFETY: the trait's promise: AVX-512F is enabled.
        unsafe { _mm512_fmadd_ps(self, weight, sum) }
    }

    #[inline(always)]
    unsafe fn out(self, _factors: *const f32) -> Self {
        self
    }
}
