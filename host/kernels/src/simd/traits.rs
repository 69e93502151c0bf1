//! What every instruction set offers to a kernel.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{_mm_cvttss_si32, _mm_set_ss};

/// Largest number of lanes of any vector.
pub const LANES_MAX: usize = 16;

/// Entries of the table of [`F32x8::gather`], and two more that it may read.
pub const TABLE: usize = 256;
/// What [`F32x8::gather`] looks up.
pub type Table = [u16; TABLE + 2];

/// A computation, written once for all instruction sets. Implementations of `run` are `inline(always)`.
pub trait Dispatch {
    /// What it gives.
    type Output;

    /// Computes it with an instruction set.
    fn run<S: Simd>(self) -> Self::Output;
}

/// An instruction set.
pub trait Simd {
    /// f32 vectors, as wide as the set has them.
    type F32: Accumulator<Number = f32, Out = Self::F32> + Vector;
    /// Products of int16, summed in int32, as wide as the set has them.
    type Int16: IntegerSums;
    /// Eight f32.
    type F32x8: F32x8;
    /// Sixteen int16.
    type Int16x16: Int16x16;

    /// Sums of absolute differences of a template (8 pixels wide, at most 32 rows) and the eight places that begin at the
    /// first eight of `pixels`, whose rows are `stride` apart.
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8];

    /// The smallest sum `a[k] + b[k]` (saturating) and its `k`; the first of equal ones.
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize);

    /// Sums of eight blocks of 5×5 pixels, side by side.
    fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8];
}

/// A vector of f32.
pub trait Vector: Copy {
    /// Numbers that it holds.
    const LANES: usize;

    /// The first `LANES` numbers.
    fn load(from: &[f32]) -> Self;

    /// Writes the first `out.len()` lanes, at most all.
    fn store(self, out: &mut [f32]);

    /// The sums, lane by lane.
    #[must_use]
    fn add(self, other: Self) -> Self;

    /// Lanes below zero become +0; NaN and −0 stay.
    #[must_use]
    fn relu(self) -> Self;
}

/// A vector of factors, or of sums of products.
///
/// # Safety
/// [`accumulate`] reads as far as these say: a vector has as many lanes as [`Self::Out`], `broadcast::<S>` reads `S` numbers,
/// and `multiply_add_inputs` no more than [`Self::INPUTS`] inputs of each pixel and their weights.
pub unsafe trait Accumulator: Copy {
    /// A factor.
    type Number;

    /// What sums are converted to, lane by lane.
    type Out: Vector;

    /// Vectors of sums that a pixel of a full panel has.
    const VECTORS: usize;

    /// Whether convolutions with few output channels spread the input channels over the lanes: each input that is read then
    /// serves two multiply-adds. For f32 all but the portable set do, so that they compute the same bits; sums of int16 are exact in
    /// any order, so only speed decides.
    const SPLITS: bool;

    /// Output pixels whose sums fit the registers, with one vector of sums each and with two.
    const PIXELS_MAX: [usize; 2];

    /// Inputs that [`Self::multiply_add_inputs`] takes at once.
    const INPUTS: usize = 1;

    /// No sums yet.
    fn zero() -> Self;

    /// The `S` (1, 2 or 4) numbers at `from`, repeated.
    ///
    /// # Safety
    /// They must be readable; alignment does not matter.
    unsafe fn broadcast<const S: usize>(from: *const Self::Number) -> Self;

    /// One number per lane from `from` on.
    ///
    /// # Safety
    /// They must be readable; alignment does not matter.
    unsafe fn load_unchecked(from: *const Self::Number) -> Self;

    /// The sums of neighbouring lanes: first those of `self`, then those of `other`.
    #[must_use]
    fn pairwise_sums(self, other: Self) -> Self;

    /// `self · weight + sum`.
    #[must_use]
    fn multiply_add(self, weight: Self, sum: Self) -> Self;

    /// Adds to the sums of `P` pixels the products of [`Self::INPUTS`] inputs each, `step` apart between pixels, with the
    /// weights: `N` vectors of them for every input.
    ///
    /// # Safety
    /// All of them must be readable; alignment does not matter.
    #[inline(always)]
    unsafe fn multiply_add_inputs<const P: usize, const N: usize>(
        sums: &mut [[Self; N]; P],
        weights: *const Self::Number,
        inputs: *const Self::Number,
        step: usize,
    ) {
        // SAFETY: the same promise.
        unsafe { multiply_add_group::<Self, P, N, 1>(sums, weights, inputs, step) }
    }

    /// The sums as f32, times a factor for each lane; f32 sums ignore the factors.
    fn scale(self, factors: &[f32]) -> Self::Out;

    /// Runs a kernel, as a function of its own where the set has many kernels: what they end with is then compiled once.
    fn apart<K: Dispatch>(kernel: K) -> K::Output;
}

/// Sums in int32. They wrap.
pub trait IntegerSums: Accumulator<Number = Int16Pair> {
    /// The sums, lane by lane.
    #[must_use]
    fn plus(self, other: Self) -> Self;

    /// The differences, lane by lane.
    #[must_use]
    fn minus(self, other: Self) -> Self;
}

/// Two neighbouring channels of a pixel, or their weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(transparent)]
pub struct Int16Pair(pub [i16; 2]);

impl Int16Pair {
    /// Whether this processor has what [`Avx512`](crate::InstructionSet::Avx512) takes for int16: VNNI.
    #[must_use]
    pub fn has_avx512() -> bool {
        #[cfg(target_arch = "x86_64")]
        return is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vnni");
        #[cfg(not(target_arch = "x86_64"))]
        false
    }

    /// The sums of both; they wrap.
    #[must_use]
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a.wrapping_add(c), b.wrapping_add(d)])
    }

    /// The differences of both; they wrap.
    #[must_use]
    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a.wrapping_sub(c), b.wrapping_sub(d)])
    }

    /// Whether this processor multiplies and adds int16 by one instruction of 256 bits.
    #[cfg(target_arch = "x86_64")]
    #[must_use]
    pub fn has_avx_vnni() -> bool {
        is_x86_feature_detected!("avxvnni")
    }
}

/// Eight f32. Every instruction set rounds alike, so all give the same bits.
pub trait F32x8: Copy {
    /// One number in all lanes.
    fn splat(value: f32) -> Self;

    /// Eight numbers.
    fn load(from: &[f32; 8]) -> Self;

    /// Eight bytes as numbers.
    fn from_u8(from: [u8; 8]) -> Self;

    /// Writes the lanes.
    fn store(self, to: &mut [f32; 8]);

    /// The sums, lane by lane.
    #[must_use]
    fn add(self, other: Self) -> Self;

    /// The differences, lane by lane.
    #[must_use]
    fn subtract(self, other: Self) -> Self;

    /// The products, lane by lane.
    #[must_use]
    fn multiply(self, other: Self) -> Self;

    /// The magnitudes.
    #[must_use]
    fn abs(self) -> Self;

    /// As [`round`]; for magnitudes below 2²².
    #[must_use]
    fn round(self) -> Self;

    /// Entries of a table, by whole numbers modulo [`TABLE`].
    #[must_use]
    fn gather(self, table: &Table) -> Self;

    /// `yes` where `self < than`, elsewhere `no`.
    #[must_use]
    fn select_less(self, than: Self, yes: Self, no: Self) -> Self;

    /// The sum of the lanes, in pairs: those four apart, then those two apart, then the rest.
    fn sum(self) -> f32;

    /// The smallest lane, of which none is NaN.
    fn min(self) -> f32;
}

/// Sixteen int16: eight pixels of one block, then eight of the block beside it.
pub trait Int16x16: Copy {
    /// Eight int32, four for each block.
    type Sums: Copy;

    /// One number in all lanes.
    fn splat(value: i16) -> Self;

    /// Sixteen bytes as numbers.
    fn from_u8(from: &[u8; 16]) -> Self;

    /// Sixteen signed bytes as numbers.
    fn from_i8(from: &[i8; 16]) -> Self;

    /// No sums yet.
    fn zero_sums() -> Self::Sums;

    /// Adds the products to the sums of their block.
    fn multiply_add(self, other: Self, sums: Self::Sums) -> Self::Sums;

    /// For each of the two blocks, the totals of eight sums.
    fn totals(sums: [Self::Sums; 8]) -> [[i32; 8]; 2];
}

/// The greatest number below a half: adding it rounds nothing below a half up to one.
pub(super) const BELOW_HALF: f32 = 0.499_999_97;

/// Rounds to the nearest whole number, halves away from zero; for what i32 holds.
#[inline(always)]
#[must_use]
pub fn round(value: f32) -> i32 {
    let away = value + BELOW_HALF.copysign(value);
    // SAFETY: every x86-64 has SSE. One instruction; `as` needs six, for what lies beyond i32.
    #[cfg(target_arch = "x86_64")]
    return unsafe { _mm_cvttss_si32(_mm_set_ss(away)) };
    #[cfg(not(target_arch = "x86_64"))]
    return away as i32;
}

/// Adds to the sums of `P` pixels the products of a run of `run` inputs each, `step` inputs apart, with the weights:
/// `N` vectors of them for every `S` inputs.
///
/// # Panics
/// When there are fewer inputs or weights.
#[inline(always)]
pub fn accumulate<A: Accumulator, const P: usize, const N: usize, const S: usize>(
    sums: &mut [[A; N]; P],
    weights: &[A::Number],
    inputs: &[A::Number],
    step: usize,
    run: usize,
) {
    let lanes = N * A::Out::LANES;
    let groups = run / S;
    assert!(weights.len() >= groups * lanes, "weights");
    assert!(inputs.len() >= (P - 1) * step + run, "inputs");
    let (weights, inputs) = (weights.as_ptr(), inputs.as_ptr());
    let mut i = 0;
    if S == 1 && A::INPUTS > 1 {
        while i + A::INPUTS <= groups {
            // SAFETY: as below, for the last of these inputs.
            unsafe { A::multiply_add_inputs(sums, weights.add(i * lanes), inputs.add(i), step) }
            i += A::INPUTS;
        }
    }
    while i < groups {
        // SAFETY: i < run / S, so by the assertions above the last pixel's inputs and the last weight exist.
        unsafe { multiply_add_group::<A, P, N, S>(sums, weights.add(i * lanes), inputs.add(i * S), step) }
        i += 1;
    }
}

/// Adds to the sums of `P` pixels the products of `S` inputs each, `step` inputs apart, with `N` vectors of weights.
///
/// # Safety
/// All of them must be readable; alignment does not matter.
#[inline(always)]
unsafe fn multiply_add_group<A: Accumulator, const P: usize, const N: usize, const S: usize>(
    sums: &mut [[A; N]; P],
    weights: *const A::Number,
    inputs: *const A::Number,
    step: usize,
) {
    // SAFETY: the caller's promise.
    unsafe {
        let mut weight = [A::zero(); N];
        for (n, weight) in weight.iter_mut().enumerate() {
            *weight = A::load_unchecked(weights.add(n * A::Out::LANES));
        }
        for (p, sums) in sums.iter_mut().enumerate() {
            let values = A::broadcast::<S>(inputs.add(p * step));
            for (sum, weight) in sums.iter_mut().zip(weight) {
                *sum = values.multiply_add(weight, *sum);
            }
        }
    }
}
