//! Vector instructions behind safe types: one module per instruction set, the same operations in each. A kernel is
//! written once, generic over [`Simd`], and [`dispatch`] compiles it for every set and runs the one asked for.
//!
//! This folder holds all `unsafe` code of the crate. Only it can name the types of an instruction set; kernels get them
//! from `dispatch`, which asks the processor first. Every operation is `inline(always)`, so that it compiles for the
//! set of the function it ends up in; code in closures and in functions that are not inlined does not.
#![expect(unsafe_code, reason = "vector instructions, each wrapped here once")]
#![expect(
    clippy::inline_always,
    reason = "an operation compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
#[cfg(test)]
mod tests;

use crate::instruction_set::InstructionSet;

/// Largest number of lanes of any vector.
pub(crate) const LANES_MAX: usize = 16;

/// Entries of the table of [`F32x8::gather`], and two more that it may read.
pub(crate) const TABLE: usize = 256;
pub(crate) type Table = [u16; TABLE + 2];

/// A computation, written once for all instruction sets. Implementations of `run` are `inline(always)`.
pub(crate) trait Dispatch {
    type Output;

    fn run<S: Simd>(self) -> Self::Output;
}

/// Runs a kernel on an instruction set.
///
/// # Panics
/// When the processor does not have it.
pub(crate) fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
    assert_available(instructions);
    match instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2 and FMA, see above.
        InstructionSet::Avx2 => unsafe { avx2::run(kernel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX-512F, see above; that implies AVX2 and FMA.
        InstructionSet::Avx512 => unsafe { avx512::run(kernel) },
        _ => kernel.run::<portable::Portable>(),
    }
}

/// The same for kernels that gain nothing from vectors of more than 256 bits: AVX-512 runs them as AVX2.
///
/// # Panics
/// When the processor does not have the instruction set.
pub(crate) fn dispatch_256<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
    assert_available(instructions);
    match instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2 and FMA, see above; AVX-512F implies them.
        InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { avx2::run(kernel) },
        _ => kernel.run::<portable::Portable>(),
    }
}

fn assert_available(instructions: InstructionSet) {
    assert!(
        instructions.is_available(),
        "this processor has no {instructions}"
    );
}

/// An instruction set.
pub(crate) trait Simd {
    /// f32 vectors, as wide as the set has them.
    type F32: Accumulator<Number = f32, Out = Self::F32> + Vector;
    /// Products of int16, summed in int32, as wide as the set has them.
    type Int16: Accumulator<Number = Int16Pair>;
    /// Eight f32.
    type F32x8: F32x8;
    /// Sixteen int16.
    type Int16x16: Int16x16;

    /// Sums of absolute differences of a template (8 pixels wide, at most 32 rows) and the eight places that begin at the
    /// first eight of `pixels`, whose rows are `stride` apart.
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8];

    /// The smallest sum `a[k] + b[k]` (saturating) and its `k`; the first of equal ones.
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize);
}

/// A vector of f32.
pub(crate) trait Vector: Copy {
    const LANES: usize;

    /// The first `LANES` numbers.
    fn load(from: &[f32]) -> Self;

    /// Writes the first `out.len()` lanes, at most all.
    fn store(self, out: &mut [f32]);

    fn add(self, other: Self) -> Self;

    /// Lanes below zero become +0; NaN and −0 stay.
    fn relu(self) -> Self;
}

/// A vector of factors, or of sums of products.
pub(crate) trait Accumulator: Copy {
    /// A factor.
    type Number;

    /// What sums are converted to, lane by lane.
    type Out: Vector;

    /// Output pixels whose sums fit the registers, with one vector of sums each and with two.
    const PIXELS_MAX: [usize; 2];

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
    fn pairwise_sums(self, other: Self) -> Self;

    /// `self · weight + sum`.
    fn multiply_add(self, weight: Self, sum: Self) -> Self;

    /// The sums as f32, times a factor for each lane; f32 sums ignore the factors.
    fn scale(self, factors: &[f32]) -> Self::Out;
}

/// A number that convolutions multiply.
pub(crate) trait Number: Copy + Default {
    /// Its vectors in an instruction set.
    type Accumulator<S: Simd>: Accumulator<Number = Self>;

    /// Runs a kernel on such numbers.
    fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output;
}

impl Number for f32 {
    type Accumulator<S: Simd> = S::F32;

    fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
        dispatch(instructions, kernel)
    }
}

/// Two neighbouring channels of a pixel, or their weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(transparent)]
pub(crate) struct Int16Pair(pub(crate) [i16; 2]);

impl Int16Pair {
    /// Whether this processor has what [`InstructionSet::Avx512`] takes for int16: VNNI.
    pub(crate) fn has_avx512() -> bool {
        #[cfg(target_arch = "x86_64")]
        return is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vnni");
        #[cfg(not(target_arch = "x86_64"))]
        false
    }
}

impl Number for Int16Pair {
    type Accumulator<S: Simd> = S::Int16;

    fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if instructions == InstructionSet::Avx512 {
            assert!(Self::has_avx512(), "this processor has no avx512vnni");
            // SAFETY: the processor has AVX-512F and VNNI, see above.
            return unsafe { avx512::run_vnni(kernel) };
        }
        dispatch_256(instructions, kernel)
    }
}

/// Eight f32. Every instruction set rounds alike, so all give the same bits.
pub(crate) trait F32x8: Copy {
    fn splat(value: f32) -> Self;

    fn load(from: &[f32; 8]) -> Self;

    fn from_u8(from: [u8; 8]) -> Self;

    fn store(self, to: &mut [f32; 8]);

    fn add(self, other: Self) -> Self;

    fn subtract(self, other: Self) -> Self;

    fn multiply(self, other: Self) -> Self;

    fn abs(self) -> Self;

    /// As [`round`]; for magnitudes below 2²².
    fn round(self) -> Self;

    /// Entries of a table, by whole numbers modulo [`TABLE`].
    fn gather(self, table: &Table) -> Self;

    /// `yes` where `self < than`, elsewhere `no`.
    fn select_less(self, than: Self, yes: Self, no: Self) -> Self;

    /// The sum of the lanes, in pairs: those four apart, then those two apart, then the rest.
    fn sum(self) -> f32;
}

/// Sixteen int16: eight pixels of one block, then eight of the block beside it.
pub(crate) trait Int16x16: Copy {
    /// Eight int32, four for each block.
    type Sums: Copy;

    fn splat(value: i16) -> Self;

    fn from_u8(from: &[u8; 16]) -> Self;

    fn from_i8(from: &[i8; 16]) -> Self;

    fn zero_sums() -> Self::Sums;

    /// Adds the products to the sums of their block.
    fn multiply_add(self, other: Self, sums: Self::Sums) -> Self::Sums;

    /// For each of the two blocks, the totals of eight sums.
    fn totals(sums: [Self::Sums; 8]) -> [[i32; 8]; 2];
}

/// The greatest number below a half: adding it rounds nothing below a half up to one.
const BELOW_HALF: f32 = 0.499_999_97;

/// Rounds to the nearest whole number, halves away from zero.
#[inline(always)]
pub(crate) fn round(value: f32) -> i32 {
    (value + BELOW_HALF.copysign(value)) as i32
}

/// Adds to the sums of `P` pixels the products of a run of `run` inputs each, `step` inputs apart, with the weights:
/// `N` vectors of them for every `S` inputs.
///
/// # Panics
/// When there are fewer inputs or weights.
#[inline(always)]
pub(crate) fn accumulate<A: Accumulator, const P: usize, const N: usize, const S: usize>(
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
    for i in 0..groups {
        // SAFETY: i < run / S, so by the assertions above the last pixel's inputs and the last weight exist.
        unsafe {
            let mut weight = [A::zero(); N];
            for (n, weight) in weight.iter_mut().enumerate() {
                *weight = A::load_unchecked(weights.add(i * lanes + n * A::Out::LANES));
            }
            for (p, sums) in sums.iter_mut().enumerate() {
                let values = A::broadcast::<S>(inputs.add(p * step + i * S));
                for (sum, weight) in sums.iter_mut().zip(weight) {
                    *sum = values.multiply_add(weight, *sum);
                }
            }
        }
    }
}
