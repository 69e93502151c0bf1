//! AVX-512F, for int16 with VNNI: 16 f32 or 32 int16 at a time. What gains nothing from that is AVX2's.
//!
//! SAFETY of every block here: the types are private to `simd` and reach kernels through [`run`] and [`run_vnni`], which
//! are called only where the processor has the instructions. Blocks that read or write memory say their bounds.

use std::arch::x86_64::{
    __m512, __m512i, _mm_loadu_ps, _mm_loadu_si128, _mm512_add_epi32, _mm512_add_ps, _mm512_broadcast_f32x4,
    _mm512_broadcast_i32x4, _mm512_castpd_ps, _mm512_cvtepi32_ps, _mm512_dpwssd_epi32, _mm512_fmadd_ps,
    _mm512_loadu_ps, _mm512_loadu_si512, _mm512_mask_storeu_ps, _mm512_max_ps, _mm512_mul_ps,
    _mm512_permutex2var_epi32, _mm512_permutex2var_ps, _mm512_set1_epi32, _mm512_set1_epi64, _mm512_set1_pd,
    _mm512_set1_ps, _mm512_setr_epi32, _mm512_setzero_ps, _mm512_setzero_si512, _mm512_storeu_ps,
    _mm512_sub_epi32,
};

use super::avx2;
use super::traits::{Accumulator, Dispatch, Int16Pair, IntegerSums, Simd, Vector};

/// Runs a kernel.
#[target_feature(enable = "avx512f")]
#[inline(never)]
pub(super) fn run<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Avx512<avx2::Pairs>>()
}

/// Runs a kernel with VNNI.
#[target_feature(enable = "avx512f,avx512vnni")]
#[inline(never)]
pub(super) fn run_vnni<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Avx512<Pairs>>()
}

/// With AVX2's pairs of int16, or VNNI's.
struct Avx512<P>(std::marker::PhantomData<P>);

impl<P: IntegerSums> Simd for Avx512<P> {
    type F32 = F32;
    type Int16 = P;
    type F32x8 = avx2::F32;
    type Int16x16 = avx2::Words;

    #[inline(always)]
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8] {
        // SAFETY: see the module; AVX-512F implies AVX2.
        unsafe { avx2::sad_x8(template, pixels, stride) }
    }

    #[inline(always)]
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize) {
        // SAFETY: see the module; AVX-512F implies AVX2.
        unsafe { avx2::min_sum(a, b) }
    }

    #[inline(always)]
    fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8] {
        // SAFETY: see the module; AVX-512F implies AVX2.
        unsafe { avx2::sums_5x5_x8(rows) }
    }
}

/// Sixteen f32.
#[derive(Clone, Copy)]
struct F32(__m512);

impl Vector for F32 {
    const LANES: usize = 16;

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from: &[f32; 16] = from.first_chunk().expect("sixteen numbers");
        // SAFETY: sixteen numbers.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        let lanes = out.len();
        assert!(lanes <= 16, "a vector of 16 cannot fill {lanes} numbers");
        if lanes == 16 {
            // SAFETY: the slice has sixteen numbers.
            unsafe { _mm512_storeu_ps(out.as_mut_ptr(), self.0) }
        } else {
            // SAFETY: the mask has `lanes` bits, so only the slice's numbers are touched.
            unsafe { _mm512_mask_storeu_ps(out.as_mut_ptr(), (1u16 << lanes) - 1, self.0) }
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_add_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn relu(self) -> Self {
        // The instruction returns its second operand when one is NaN or both are zeros.
        // SAFETY: see the module.
        Self(unsafe { _mm512_max_ps(_mm512_setzero_ps(), self.0) })
    }
}

// SAFETY: sixteen lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for F32 {
    type Number = f32;
    type Out = Self;

    const VECTORS: usize = 2;
    const SPLITS: bool = true;
    // Thirty-two registers would hold more sums, but the loop has no registers for more pixels' addresses:
    // eleven with two vectors each take a quarter longer per pixel.
    const PIXELS_MAX: [usize; 2] = [12, 10];

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_set1_ps(0.0) })
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller promises S readable numbers.
        Self(unsafe {
            match S {
                1 => _mm512_set1_ps(*from),
                2 => _mm512_castpd_ps(_mm512_set1_pd(from.cast::<f64>().read_unaligned())),
                _ => _mm512_broadcast_f32x4(_mm_loadu_ps(from)),
            }
        })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const f32) -> Self {
        // SAFETY: the caller promises sixteen readable numbers.
        Self(unsafe { _mm512_loadu_ps(from) })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe {
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            _mm512_add_ps(
                _mm512_permutex2var_ps(self.0, even, other.0),
                _mm512_permutex2var_ps(self.0, odd, other.0),
            )
        })
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_fmadd_ps(self.0, weight.0, sum.0) })
    }

    #[inline(always)]
    fn scale(self, _factors: &[f32]) -> Self {
        self
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        // SAFETY: see the module.
        unsafe { run(kernel) }
    }
}

/// Sixteen pairs or sums.
#[derive(Clone, Copy)]
struct Pairs(__m512i);

// SAFETY: sixteen lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for Pairs {
    type Number = Int16Pair;
    type Out = F32;
    const VECTORS: usize = 2;
    // Sixteen lanes are more than the last channels need.
    const SPLITS: bool = true;
    const PIXELS_MAX: [usize; 2] = F32::PIXELS_MAX;

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_setzero_si512() })
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises S readable pairs.
        Self(unsafe {
            match S {
                1 => _mm512_set1_epi32(from.cast::<i32>().read_unaligned()),
                2 => _mm512_set1_epi64(from.cast::<i64>().read_unaligned()),
                _ => _mm512_broadcast_i32x4(_mm_loadu_si128(from.cast())),
            }
        })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises sixteen readable pairs.
        Self(unsafe { _mm512_loadu_si512(from.cast()) })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        // SAFETY: see the module.
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
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        // SAFETY: see the module; VNNI is there.
        Self(unsafe { _mm512_dpwssd_epi32(sum.0, self.0, weight.0) })
    }

    #[inline(always)]
    fn scale(self, factors: &[f32]) -> F32 {
        let factors = F32::load(factors);
        // SAFETY: see the module.
        F32(unsafe { _mm512_mul_ps(_mm512_cvtepi32_ps(self.0), factors.0) })
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        // SAFETY: see the module.
        unsafe { run_vnni(kernel) }
    }
}

impl IntegerSums for Pairs {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_add_epi32(self.0, other.0) })
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm512_sub_epi32(self.0, other.0) })
    }
}
