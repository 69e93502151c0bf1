//! AVX2 with FMA, for int16 with AVX-VNNI where the processor has it: 8 f32 or 16 int16 at a time.
//!
//! SAFETY of every block here: the types are private to `simd` and reach kernels through [`run`] and [`run_vnni`] (or
//! AVX-512's), which are called only where the processor has the instructions. Blocks that read or write memory say their bounds.

use std::arch::x86_64::{
    __m128i, __m256, __m256i, _CMP_LT_OQ, _MM_FROUND_NO_EXC, _MM_FROUND_TO_ZERO, _mm_add_epi16, _mm_add_ps,
    _mm_add_ss, _mm_adds_epu16, _mm_cvtsi64_si128, _mm_cvtsi128_si32, _mm_cvtss_f32, _mm_loadu_ps,
    _mm_loadu_si128, _mm_min_ps, _mm_min_ss, _mm_minpos_epu16, _mm_movehdup_ps, _mm_movehl_ps,
    _mm_set1_epi64x, _mm_setr_epi8, _mm_storeu_si128, _mm256_add_epi16, _mm256_add_epi32, _mm256_add_epi64,
    _mm256_add_ps, _mm256_and_ps, _mm256_and_si256, _mm256_andnot_ps, _mm256_blendv_ps, _mm256_broadcast_ps,
    _mm256_broadcastsi128_si256, _mm256_castpd_ps, _mm256_castps_pd, _mm256_castps256_ps128,
    _mm256_castsi256_si128, _mm256_cmp_ps, _mm256_cmpgt_epi32, _mm256_cvtepi8_epi16, _mm256_cvtepi32_ps,
    _mm256_cvtepu8_epi16, _mm256_cvtepu8_epi32, _mm256_cvttps_epi32, _mm256_dpwssd_avx_epi32,
    _mm256_extractf128_ps, _mm256_extracti128_si256, _mm256_fmadd_ps, _mm256_hadd_epi32, _mm256_hadd_ps,
    _mm256_i32gather_epi32, _mm256_loadu_ps, _mm256_loadu_si256, _mm256_madd_epi16, _mm256_maskstore_ps,
    _mm256_max_ps, _mm256_mpsadbw_epu8, _mm256_mul_ps, _mm256_or_ps, _mm256_packus_epi32,
    _mm256_permute2x128_si256, _mm256_permute4x64_epi64, _mm256_permute4x64_pd, _mm256_round_ps,
    _mm256_sad_epu8, _mm256_set_m128i, _mm256_set1_epi16, _mm256_set1_epi32, _mm256_set1_epi64x,
    _mm256_set1_pd, _mm256_set1_ps, _mm256_setr_epi32, _mm256_setzero_ps, _mm256_setzero_si256,
    _mm256_shuffle_epi8, _mm256_storeu_ps, _mm256_storeu_si256, _mm256_sub_epi32, _mm256_sub_ps,
};

use super::traits::{
    Accumulator, BELOW_HALF, Dispatch, F32x8, Int16Pair, Int16x16, IntegerSums, Simd, TABLE, Table, Vector,
};

/// Runs a kernel.
#[target_feature(enable = "avx2,fma")]
#[inline(never)]
pub(super) fn run<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Avx2<Pairs>>()
}

/// Runs a kernel with AVX-VNNI.
#[target_feature(enable = "avx2,fma,avxvnni")]
#[inline(never)]
pub(super) fn run_vnni<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Avx2<VnniPairs>>()
}

/// With pairs of int16 that are multiplied and added by two instructions, or by one.
struct Avx2<P>(std::marker::PhantomData<P>);

impl<P: IntegerSums> Simd for Avx2<P> {
    type F32 = F32;
    type Int16 = P;
    type F32x8 = F32;
    type Int16x16 = Words;

    #[inline(always)]
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8] {
        // SAFETY: see the module.
        unsafe { sad_x8(template, pixels, stride) }
    }

    #[inline(always)]
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize) {
        // SAFETY: see the module; sixteen bytes each.
        unsafe { min_sum(a, b) }
    }

    #[inline(always)]
    fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8] {
        // SAFETY: see the module.
        unsafe { sums_5x5_x8(rows) }
    }
}

#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn sad_x8<const ROWS: usize>(
    template: &[[u8; 8]; ROWS],
    pixels: &[u8],
    stride: usize,
) -> [u16; 8] {
    /// The instruction compares four pixels at eight places: in the lower half of the vector the template's first four,
    /// in the upper half the last four.
    const HALVES: i32 = 0b101_000;
    let mut sums = _mm256_setzero_si256();
    for (row, template) in template.iter().enumerate() {
        let pixels: &[u8; 16] = pixels[row * stride..].first_chunk().expect("sixteen pixels");
        // SAFETY: sixteen bytes.
        let pixels = _mm256_broadcastsi128_si256(unsafe { _mm_loadu_si128(pixels.as_ptr().cast()) });
        let template = _mm256_broadcastsi128_si256(_mm_set1_epi64x(i64::from_le_bytes(*template)));
        sums = _mm256_add_epi16(sums, _mm256_mpsadbw_epu8::<HALVES>(pixels, template));
    }
    let sums: __m128i = _mm_add_epi16(_mm256_castsi256_si128(sums), _mm256_extracti128_si256::<1>(sums));
    let mut out = [0; 8];
    // SAFETY: sixteen bytes.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), sums) };
    out
}

#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize) {
    // SAFETY: sixteen bytes each.
    let [a, b] = unsafe {
        [
            _mm_loadu_si128(a.as_ptr().cast()),
            _mm_loadu_si128(b.as_ptr().cast()),
        ]
    };
    let min = _mm_cvtsi128_si32(_mm_minpos_epu16(_mm_adds_epu16(a, b)));
    (min as u16, (min >> 16) as usize)
}

#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8] {
    /// Where the sixteen bytes of two neighbouring blocks begin. The last two end where a row ends, and have six before them.
    const PAIRS: [usize; 4] = [0, 10, 20, 24];
    const ZERO: i8 = -1;
    // The instruction sums eight bytes: five of a block, and zeros.
    let two = _mm_setr_epi8(0, 1, 2, 3, 4, ZERO, ZERO, ZERO, 5, 6, 7, 8, 9, ZERO, ZERO, ZERO);
    let last_two = _mm_setr_epi8(
        6, 7, 8, 9, 10, ZERO, ZERO, ZERO, 11, 12, 13, 14, 15, ZERO, ZERO, ZERO,
    );
    let places = [_mm256_set_m128i(two, two), _mm256_set_m128i(last_two, two)];
    // Blocks 0, 1, 4, 5 and blocks 2, 3, 6, 7.
    let mut sums = [_mm256_setzero_si256(); 2];
    for row in rows {
        // SAFETY: sixteen bytes each.
        let pairs = PAIRS.map(|at| unsafe { _mm_loadu_si128(row[at..at + 16].as_ptr().cast()) });
        for (k, sums) in sums.iter_mut().enumerate() {
            let blocks = _mm256_shuffle_epi8(_mm256_set_m128i(pairs[k + 2], pairs[k]), places[k]);
            *sums = _mm256_add_epi64(*sums, _mm256_sad_epu8(blocks, _mm256_setzero_si256()));
        }
    }
    // Within each half, the instruction puts numbers of the first before numbers of the second.
    let sums = _mm256_packus_epi32(sums[0], sums[1]);
    let sums = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packus_epi32(sums, sums));
    let mut out = [0; 8];
    // SAFETY: sixteen bytes.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), _mm256_castsi256_si128(sums)) };
    out
}

/// Eight f32.
#[derive(Clone, Copy)]
pub(super) struct F32(__m256);

impl Vector for F32 {
    const LANES: usize = 8;

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        F32x8::load(from.first_chunk().expect("eight numbers"))
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        let lanes = out.len();
        assert!(lanes <= 8, "a vector of 8 cannot fill {lanes} numbers");
        if lanes == 8 {
            // SAFETY: the slice has eight numbers.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), self.0) }
        } else {
            // SAFETY: the mask has the first `lanes` lanes, so only the slice's numbers are touched.
            unsafe {
                let index = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                let mask = _mm256_cmpgt_epi32(_mm256_set1_epi32(lanes as i32), index);
                _mm256_maskstore_ps(out.as_mut_ptr(), mask, self.0);
            }
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        F32x8::add(self, other)
    }

    #[inline(always)]
    fn relu(self) -> Self {
        // The instruction returns its second operand when one is NaN or both are zeros.
        // SAFETY: see the module.
        Self(unsafe { _mm256_max_ps(_mm256_setzero_ps(), self.0) })
    }
}

// SAFETY: eight lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for F32 {
    type Number = f32;
    type Out = Self;

    const VECTORS: usize = 2;
    const SPLITS: bool = true;
    // Sixteen registers: sums, weights, one input.
    const PIXELS_MAX: [usize; 2] = [12, 6];

    #[inline(always)]
    fn zero() -> Self {
        F32x8::splat(0.0)
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller promises S readable numbers.
        Self(unsafe {
            match S {
                1 => _mm256_set1_ps(*from),
                2 => _mm256_castpd_ps(_mm256_set1_pd(from.cast::<f64>().read_unaligned())),
                _ => _mm256_broadcast_ps(&_mm_loadu_ps(from)),
            }
        })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const f32) -> Self {
        // SAFETY: the caller promises eight readable numbers.
        Self(unsafe { _mm256_loadu_ps(from) })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        // Within each half, the instruction puts sums of `self` before sums of `other`: quarters 0 2 1 3.
        // SAFETY: see the module.
        Self(unsafe {
            let sums = _mm256_castps_pd(_mm256_hadd_ps(self.0, other.0));
            _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(sums))
        })
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_fmadd_ps(self.0, weight.0, sum.0) })
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

/// Eight pairs or sums.
#[derive(Clone, Copy)]
pub(super) struct Pairs(__m256i);

// SAFETY: eight lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for Pairs {
    type Number = Int16Pair;
    type Out = F32;

    const VECTORS: usize = 2;
    const SPLITS: bool = false;
    // A register for the products, which are added by an instruction of their own.
    const PIXELS_MAX: [usize; 2] = [10, 5];

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_setzero_si256() })
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises S readable pairs.
        Self(unsafe {
            match S {
                1 => _mm256_set1_epi32(from.cast::<i32>().read_unaligned()),
                2 => _mm256_set1_epi64x(from.cast::<i64>().read_unaligned()),
                _ => _mm256_broadcastsi128_si256(_mm_loadu_si128(from.cast())),
            }
        })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises eight readable pairs.
        Self(unsafe { _mm256_loadu_si256(from.cast()) })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        // Within each half, the instruction puts sums of `self` before sums of `other`: quarters 0 2 1 3.
        // SAFETY: see the module.
        Self(unsafe { _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_hadd_epi32(self.0, other.0)) })
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_add_epi32(sum.0, _mm256_madd_epi16(self.0, weight.0)) })
    }

    #[inline(always)]
    fn scale(self, factors: &[f32]) -> F32 {
        let factors = <F32 as Vector>::load(factors);
        // SAFETY: see the module.
        F32(unsafe { _mm256_mul_ps(_mm256_cvtepi32_ps(self.0), factors.0) })
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        // SAFETY: see the module.
        unsafe { run(kernel) }
    }
}

impl IntegerSums for Pairs {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_add_epi32(self.0, other.0) })
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_sub_epi32(self.0, other.0) })
    }
}

/// The same where the processor has AVX-VNNI.
#[derive(Clone, Copy)]
struct VnniPairs(Pairs);

// SAFETY: eight lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for VnniPairs {
    type Number = Int16Pair;
    type Out = F32;
    const VECTORS: usize = 2;
    const SPLITS: bool = false;
    const PIXELS_MAX: [usize; 2] = F32::PIXELS_MAX;

    #[inline(always)]
    fn zero() -> Self {
        Self(Pairs::zero())
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const Int16Pair) -> Self {
        // SAFETY: the same promise.
        Self(unsafe { Pairs::broadcast::<S>(from) })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const Int16Pair) -> Self {
        // SAFETY: the same promise.
        Self(unsafe { Pairs::load_unchecked(from) })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        Self(self.0.pairwise_sums(other.0))
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        // SAFETY: see the module; AVX-VNNI is there.
        Self(Pairs(unsafe {
            _mm256_dpwssd_avx_epi32(sum.0.0, self.0.0, weight.0.0)
        }))
    }

    #[inline(always)]
    fn scale(self, factors: &[f32]) -> F32 {
        self.0.scale(factors)
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        // SAFETY: see the module.
        unsafe { run_vnni(kernel) }
    }
}

impl IntegerSums for VnniPairs {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(self.0.plus(other.0))
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self(self.0.minus(other.0))
    }
}

impl F32x8 for F32 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        // SAFETY: eight numbers.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn from_u8(from: [u8; 8]) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(from)))) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        // SAFETY: room for eight numbers.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_add_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn subtract(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_sub_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn multiply(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_mul_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }

    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe {
            let sign = _mm256_and_ps(_mm256_set1_ps(-0.0), self.0);
            let away = _mm256_add_ps(self.0, _mm256_or_ps(_mm256_set1_ps(BELOW_HALF), sign));
            _mm256_round_ps::<{ _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC }>(away)
        })
    }

    #[inline(always)]
    fn gather(self, table: &Table) -> Self {
        // SAFETY: indices modulo 256 in a table of 258, of which each reads two.
        Self(unsafe {
            let index = _mm256_and_si256(_mm256_cvttps_epi32(self.0), _mm256_set1_epi32(TABLE as i32 - 1));
            let two = _mm256_i32gather_epi32::<2>(table.as_ptr().cast(), index);
            _mm256_cvtepi32_ps(_mm256_and_si256(two, _mm256_set1_epi32(0xffff)))
        })
    }

    #[inline(always)]
    fn select_less(self, than: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, than.0)) })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: see the module.
        unsafe {
            let four = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
        }
    }

    #[inline(always)]
    fn min(self) -> f32 {
        // SAFETY: see the module.
        unsafe {
            let four = _mm_min_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
        }
    }
}

#[derive(Clone, Copy)]
pub(super) struct Words(__m256i);

impl Int16x16 for Words {
    type Sums = Pairs;

    #[inline(always)]
    fn splat(value: i16) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_set1_epi16(value) })
    }

    #[inline(always)]
    fn from_u8(from: &[u8; 16]) -> Self {
        // SAFETY: sixteen bytes.
        Self(unsafe { _mm256_cvtepu8_epi16(_mm_loadu_si128(from.as_ptr().cast())) })
    }

    #[inline(always)]
    fn from_i8(from: &[i8; 16]) -> Self {
        // SAFETY: sixteen bytes.
        Self(unsafe { _mm256_cvtepi8_epi16(_mm_loadu_si128(from.as_ptr().cast())) })
    }

    #[inline(always)]
    fn zero_sums() -> Pairs {
        Pairs::zero()
    }

    #[inline(always)]
    fn multiply_add(self, other: Self, sums: Pairs) -> Pairs {
        Pairs(self.0).multiply_add(Pairs(other.0), sums)
    }

    #[inline(always)]
    fn totals([a, b, c, d, e, f, g, h]: [Pairs; 8]) -> [[i32; 8]; 2] {
        let mut totals = [[0; 8]; 2];
        // SAFETY: see the module; room for eight numbers each.
        unsafe {
            let four = |a: Pairs, b: Pairs, c: Pairs, d: Pairs| {
                _mm256_hadd_epi32(_mm256_hadd_epi32(a.0, b.0), _mm256_hadd_epi32(c.0, d.0))
            };
            let (first, last) = (four(a, b, c, d), four(e, f, g, h));
            let [left, right] = &mut totals;
            _mm256_storeu_si256(
                left.as_mut_ptr().cast(),
                _mm256_permute2x128_si256::<0x20>(first, last),
            );
            _mm256_storeu_si256(
                right.as_mut_ptr().cast(),
                _mm256_permute2x128_si256::<0x31>(first, last),
            );
        }
        totals
    }
}
