//! NEON, which every aarch64 processor has: 8 f32 or 16 int16 at a time, in two registers of 128 bits.
//!
//! The same bits as AVX2: lanes are summed in the same order, multiply-adds of f32 are fused, and int16 products are exact.
//! They are `vmlal_s16`; four at a time are as many as f32 multiply-adds, so int16 gains bandwidth and no arithmetic.
//!
//! SAFETY of every block here: the target has NEON. Blocks that read or write memory say their bounds.

use std::arch::aarch64::{
    float32x4_t, int16x8_t, int32x4_t, uint16x8_t, vabal_high_u8, vabal_u8, vabsq_f32, vadd_f32, vaddq_f32,
    vaddq_s32, vaddq_u8, vbicq_u32, vbslq_f32, vcltq_f32, vcltzq_f32, vcombine_u8, vcreate_u8, vcvtq_f32_s32,
    vcvtq_f32_u32, vcvtq_s32_f32, vdupq_n_f32, vdupq_n_s16, vdupq_n_s32, vdupq_n_u8, vdupq_n_u16,
    vdupq_n_u32, vdupq_n_u64, vfmaq_f32, vfmaq_laneq_f32, vget_high_f32, vget_low_f32, vget_low_s8,
    vget_low_s16, vget_low_u8, vget_low_u16, vld1q_f32, vld1q_s8, vld1q_s16, vld1q_u8, vld1q_u16, vld2q_s16,
    vminq_f32, vminq_u32, vminvq_f32, vminvq_u32, vmlal_high_laneq_s16, vmlal_high_s16, vmlal_laneq_s16,
    vmlal_s16, vmovl_high_s8, vmovl_high_u8, vmovl_high_u16, vmovl_s8, vmovl_u8, vmovl_u16, vmulq_f32,
    vpadalq_u8, vpaddq_f32, vpaddq_s32, vpaddq_u16, vpadds_f32, vqaddq_u16, vqtbl1q_u8,
    vreinterpretq_f32_u32, vreinterpretq_f32_u64, vreinterpretq_s16_s32, vreinterpretq_s16_u16,
    vreinterpretq_s16_u32, vreinterpretq_s16_u64, vreinterpretq_s32_s16, vreinterpretq_u32_f32,
    vreinterpretq_u32_u16, vrndq_f32, vst1q_f32, vst1q_s32, vst1q_u16, vsubq_f32, vsubq_s32, vuzp1q_s16,
    vuzp2q_s16, vzip1q_u16, vzip2q_u16,
};

use super::traits::{
    Accumulator, BELOW_HALF, Dispatch, F32x8, Int16Pair, Int16x16, IntegerSums, Simd, TABLE, Table, Vector,
};

/// Runs a kernel.
#[inline(never)]
pub(super) fn run<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Neon>()
}

struct Neon;

impl Simd for Neon {
    type F32 = F32;
    type Int16 = Pairs;
    type F32x8 = F32;
    type Int16x16 = Words;

    #[inline(always)]
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8] {
        // SAFETY: sixteen bytes each.
        let places = PLACES.map(|place| unsafe { vld1q_u8(place.as_ptr()) });
        // For each place, the sums of the template's columns.
        // SAFETY: see the module.
        let mut sums = [unsafe { vdupq_n_u16(0) }; 8];
        for (row, template) in template.iter().enumerate() {
            let pixels: &[u8; 16] = pixels[row * stride..].first_chunk().expect("sixteen pixels");
            // SAFETY: sixteen bytes.
            unsafe {
                let pixels = vld1q_u8(pixels.as_ptr());
                let template = vcreate_u8(u64::from_le_bytes(*template));
                let template = vcombine_u8(template, template);
                for (k, place) in places.into_iter().enumerate() {
                    let two = vqtbl1q_u8(pixels, place);
                    sums[k] = vabal_u8(sums[k], vget_low_u8(template), vget_low_u8(two));
                    sums[k + 4] = vabal_high_u8(sums[k + 4], template, two);
                }
            }
        }
        let [a, b, c, d, e, f, g, h] = sums;
        let mut out = [0; 8];
        // SAFETY: room for eight numbers.
        unsafe {
            let left = vpaddq_u16(vpaddq_u16(a, b), vpaddq_u16(c, d));
            let right = vpaddq_u16(vpaddq_u16(e, f), vpaddq_u16(g, h));
            vst1q_u16(out.as_mut_ptr(), vpaddq_u16(left, right));
        }
        out
    }

    #[inline(always)]
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize) {
        const INDEX: [u16; 8] = [0, 1, 2, 3, 4, 5, 6, 7];
        // SAFETY: eight numbers each.
        let min = unsafe {
            let index = vld1q_u16(INDEX.as_ptr());
            let sums = vqaddq_u16(vld1q_u16(a.as_ptr()), vld1q_u16(b.as_ptr()));
            // A sum in the upper half, its index in the lower: of equal sums, the first is the smallest number.
            let left = vreinterpretq_u32_u16(vzip1q_u16(index, sums));
            let right = vreinterpretq_u32_u16(vzip2q_u16(index, sums));
            vminvq_u32(vminq_u32(left, right))
        };
        ((min >> 16) as u16, min as usize & 7)
    }

    #[inline(always)]
    fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8] {
        /// Where the sixteen bytes of two neighbouring blocks begin. The last two end where a row ends.
        const PAIRS: [usize; 4] = [0, 10, 20, 24];
        // SAFETY: sixteen bytes.
        let two = unsafe { vld1q_u8(BLOCKS.as_ptr()) };
        // The last two have six bytes before them; what is out of bounds stays so.
        // SAFETY: see the module.
        let places = unsafe { [two, two, two, vaddq_u8(two, vdupq_n_u8(6))] };
        // Four sums of each block.
        // SAFETY: see the module.
        let mut sums = [unsafe { vdupq_n_u16(0) }; 4];
        for row in rows {
            for (k, at) in PAIRS.into_iter().enumerate() {
                // SAFETY: sixteen bytes.
                unsafe {
                    let pixels = vld1q_u8(row[at..at + 16].as_ptr());
                    sums[k] = vpadalq_u8(sums[k], vqtbl1q_u8(pixels, places[k]));
                }
            }
        }
        let [a, b, c, d] = sums;
        let mut out = [0; 8];
        // SAFETY: room for eight numbers.
        unsafe { vst1q_u16(out.as_mut_ptr(), vpaddq_u16(vpaddq_u16(a, b), vpaddq_u16(c, d))) };
        out
    }
}

/// Two blocks of five bytes, each followed by three places out of bounds, which are zeros.
const BLOCKS: [u8; 16] = {
    const ZERO: u8 = 0x80;
    [0, 1, 2, 3, 4, ZERO, ZERO, ZERO, 5, 6, 7, 8, 9, ZERO, ZERO, ZERO]
};

/// Which of sixteen pixels lie at a place: eight from there on and, in the upper half, eight from four places on.
const PLACES: [[u8; 16]; 4] = {
    let mut places = [[0; 16]; 4];
    let mut k = 0;
    while k < 64 {
        let (place, byte) = (k / 16, k % 16);
        places[place][byte] = (place + byte / 8 * 4 + byte % 8) as u8;
        k += 1;
    }
    places
};

/// Eight f32.
#[derive(Clone, Copy)]
pub(super) struct F32([float32x4_t; 2]);

/// An instruction on both registers.
macro_rules! both {
    ($instruction:ident($($of:expr),+)) => {
        // SAFETY: see the module.
        unsafe { [$instruction($($of[0]),+), $instruction($($of[1]),+)] }
    };
}

impl F32 {
    #[inline(always)]
    fn from_u16(from: uint16x8_t) -> Self {
        // SAFETY: see the module.
        let wide = unsafe { [vmovl_u16(vget_low_u16(from)), vmovl_high_u16(from)] };
        Self(both!(vcvtq_f32_u32(wide)))
    }
}

impl Vector for F32 {
    const LANES: usize = 8;

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        F32x8::load(from.first_chunk().expect("eight numbers"))
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        if let Some(out) = out.as_mut_array::<8>() {
            F32x8::store(self, out);
        } else {
            let mut eight = [0.0; 8];
            F32x8::store(self, &mut eight);
            out.copy_from_slice(&eight[..out.len()]);
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        F32x8::add(self, other)
    }

    #[inline(always)]
    fn relu(self) -> Self {
        // The instruction for the larger of two would make −0 to 0.
        let below = both!(vcltzq_f32(self.0));
        let bits = both!(vreinterpretq_u32_f32(self.0));
        let bits = both!(vbicq_u32(bits, below));
        Self(both!(vreinterpretq_f32_u32(bits)))
    }
}

// SAFETY: eight lanes, as `Out` has; it reads what its methods say, four inputs at once.
unsafe impl Accumulator for F32 {
    type Number = f32;
    type Out = Self;

    const VECTORS: usize = 2;
    const SPLITS: bool = true;
    // Of 32 registers: two for each vector of sums, one for a pixel's four inputs, two for each vector of weights.
    const PIXELS_MAX: [usize; 2] = [9, 5];
    const INPUTS: usize = 4;

    #[inline(always)]
    unsafe fn multiply_add_inputs<const P: usize, const N: usize>(
        sums: &mut [[Self; N]; P],
        weights: *const f32,
        inputs: *const f32,
        step: usize,
    ) {
        // SAFETY: the caller promises that four inputs a pixel and their weights are readable.
        unsafe {
            let inputs: [float32x4_t; P] = std::array::from_fn(|p| vld1q_f32(inputs.add(p * step)));
            macro_rules! input {
                ($($lane:literal)*) => {$(
                    for n in 0..N {
                        let weight = Self::load_unchecked(weights.add(8 * (N * $lane + n))).0;
                        for p in 0..P {
                            let sum = &mut sums[p][n].0;
                            sum[0] = vfmaq_laneq_f32::<$lane>(sum[0], weight[0], inputs[p]);
                            sum[1] = vfmaq_laneq_f32::<$lane>(sum[1], weight[1], inputs[p]);
                        }
                    }
                )*};
            }
            input!(0 1 2 3);
        }
    }

    #[inline(always)]
    fn zero() -> Self {
        F32x8::splat(0.0)
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller promises S readable numbers.
        let four = unsafe {
            match S {
                1 => vdupq_n_f32(*from),
                2 => vreinterpretq_f32_u64(vdupq_n_u64(from.cast::<u64>().read_unaligned())),
                _ => vld1q_f32(from),
            }
        };
        Self([four; 2])
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const f32) -> Self {
        // SAFETY: the caller promises eight readable numbers.
        Self(unsafe { [vld1q_f32(from), vld1q_f32(from.add(4))] })
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self(both!(vpaddq_f32([a, c], [b, d])))
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        Self(both!(vfmaq_f32(sum.0, self.0, weight.0)))
    }

    #[inline(always)]
    fn scale(self, _factors: &[f32]) -> Self {
        self
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        run(kernel)
    }
}

/// Eight pairs, the first int16 of each in one register and the second in the other; or eight sums.
#[derive(Clone, Copy)]
pub(super) struct Pairs([int32x4_t; 2]);

impl Pairs {
    #[inline(always)]
    fn of(firsts_and_seconds: [int16x8_t; 2]) -> Self {
        Self(both!(vreinterpretq_s32_s16(firsts_and_seconds)))
    }
}

// SAFETY: eight lanes, as `Out` has; it reads what its methods say, four inputs at once.
unsafe impl Accumulator for Pairs {
    type Number = Int16Pair;
    type Out = F32;
    const VECTORS: usize = 2;
    // NEON takes an input from any lane.
    const SPLITS: bool = false;
    const PIXELS_MAX: [usize; 2] = F32::PIXELS_MAX;
    const INPUTS: usize = 4;

    #[inline(always)]
    unsafe fn multiply_add_inputs<const P: usize, const N: usize>(
        sums: &mut [[Self; N]; P],
        weights: *const Int16Pair,
        inputs: *const Int16Pair,
        step: usize,
    ) {
        // SAFETY: the caller promises that four pairs a pixel and their weights are readable.
        unsafe {
            let inputs: [int16x8_t; P] = std::array::from_fn(|p| vld1q_s16(inputs.add(p * step).cast()));
            macro_rules! pair {
                ($($pair:literal: $first:literal $second:literal,)*) => {$(
                    for n in 0..N {
                        let weights = vld2q_s16(weights.add(8 * (N * $pair + n)).cast());
                        for p in 0..P {
                            let [left, right] = sums[p][n].0;
                            let left = vmlal_laneq_s16::<$first>(left, vget_low_s16(weights.0), inputs[p]);
                            let right = vmlal_high_laneq_s16::<$first>(right, weights.0, inputs[p]);
                            sums[p][n].0 = [
                                vmlal_laneq_s16::<$second>(left, vget_low_s16(weights.1), inputs[p]),
                                vmlal_high_laneq_s16::<$second>(right, weights.1, inputs[p]),
                            ];
                        }
                    }
                )*};
            }
            pair!(0: 0 1, 1: 2 3, 2: 4 5, 3: 6 7,);
        }
    }

    #[inline(always)]
    fn zero() -> Self {
        // SAFETY: see the module.
        Self([unsafe { vdupq_n_s32(0) }; 2])
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises S readable pairs.
        Self::of(unsafe {
            let pairs = match S {
                1 => vreinterpretq_s16_u32(vdupq_n_u32(from.cast::<u32>().read_unaligned())),
                2 => vreinterpretq_s16_u64(vdupq_n_u64(from.cast::<u64>().read_unaligned())),
                _ => vld1q_s16(from.cast()),
            };
            [vuzp1q_s16(pairs, pairs), vuzp2q_s16(pairs, pairs)]
        })
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises eight readable pairs.
        let pairs = unsafe { vld2q_s16(from.cast()) };
        Self::of([pairs.0, pairs.1])
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self(both!(vpaddq_s32([a, c], [b, d])))
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        let a = both!(vreinterpretq_s16_s32(self.0));
        let b = both!(vreinterpretq_s16_s32(weight.0));
        let [left, right] = sum.0;
        // SAFETY: see the module.
        Self(unsafe {
            let left = vmlal_s16(left, vget_low_s16(a[0]), vget_low_s16(b[0]));
            let right = vmlal_high_s16(right, a[0], b[0]);
            [
                vmlal_s16(left, vget_low_s16(a[1]), vget_low_s16(b[1])),
                vmlal_high_s16(right, a[1], b[1]),
            ]
        })
    }

    #[inline(always)]
    fn scale(self, factors: &[f32]) -> F32 {
        F32(both!(vcvtq_f32_s32(self.0))).multiply(<F32 as Vector>::load(factors))
    }

    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        run(kernel)
    }
}

impl IntegerSums for Pairs {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(both!(vaddq_s32(self.0, other.0)))
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self(both!(vsubq_s32(self.0, other.0)))
    }
}

impl F32x8 for F32 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see the module.
        Self([unsafe { vdupq_n_f32(value) }; 2])
    }

    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        // SAFETY: eight numbers.
        unsafe { Self::load_unchecked(from.as_ptr()) }
    }

    #[inline(always)]
    fn from_u8(from: [u8; 8]) -> Self {
        // SAFETY: see the module.
        Self::from_u16(unsafe { vmovl_u8(vcreate_u8(u64::from_le_bytes(from))) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        // SAFETY: room for eight numbers.
        unsafe {
            vst1q_f32(to.as_mut_ptr(), self.0[0]);
            vst1q_f32(to.as_mut_ptr().add(4), self.0[1]);
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(both!(vaddq_f32(self.0, other.0)))
    }

    #[inline(always)]
    fn subtract(self, other: Self) -> Self {
        Self(both!(vsubq_f32(self.0, other.0)))
    }

    #[inline(always)]
    fn multiply(self, other: Self) -> Self {
        Self(both!(vmulq_f32(self.0, other.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(both!(vabsq_f32(self.0)))
    }

    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: see the module.
        let [sign, below_half] =
            unsafe { [[vdupq_n_u32(1 << 31); 2], [vdupq_n_u32(BELOW_HALF.to_bits()); 2]] };
        let below_half = both!(vreinterpretq_f32_u32(below_half));
        let below_half = both!(vbslq_f32(sign, self.0, below_half));
        let away = both!(vaddq_f32(self.0, below_half));
        Self(both!(vrndq_f32(away)))
    }

    #[inline(always)]
    fn gather(self, table: &Table) -> Self {
        let whole = both!(vcvtq_s32_f32(self.0));
        let mut index = [0; 8];
        // SAFETY: room for eight numbers.
        unsafe {
            vst1q_s32(index.as_mut_ptr(), whole[0]);
            vst1q_s32(index.as_mut_ptr().add(4), whole[1]);
        }
        let entries = index.map(|index| table[index as usize % TABLE]);
        // SAFETY: eight numbers.
        Self::from_u16(unsafe { vld1q_u16(entries.as_ptr()) })
    }

    #[inline(always)]
    fn select_less(self, than: Self, yes: Self, no: Self) -> Self {
        let less = both!(vcltq_f32(self.0, than.0));
        Self(both!(vbslq_f32(less, yes.0, no.0)))
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: see the module.
        unsafe {
            let four = vaddq_f32(self.0[0], self.0[1]);
            vpadds_f32(vadd_f32(vget_low_f32(four), vget_high_f32(four)))
        }
    }

    #[inline(always)]
    fn min(self) -> f32 {
        // SAFETY: see the module.
        unsafe { vminvq_f32(vminq_f32(self.0[0], self.0[1])) }
    }
}

/// Sixteen int16.
#[derive(Clone, Copy)]
pub(super) struct Words([int16x8_t; 2]);

impl Int16x16 for Words {
    /// Four sums of each block.
    type Sums = [int32x4_t; 2];

    #[inline(always)]
    fn splat(value: i16) -> Self {
        // SAFETY: see the module.
        Self([unsafe { vdupq_n_s16(value) }; 2])
    }

    #[inline(always)]
    fn from_u8(from: &[u8; 16]) -> Self {
        // SAFETY: sixteen bytes.
        let words = unsafe {
            let bytes = vld1q_u8(from.as_ptr());
            [vmovl_u8(vget_low_u8(bytes)), vmovl_high_u8(bytes)]
        };
        Self(both!(vreinterpretq_s16_u16(words)))
    }

    #[inline(always)]
    fn from_i8(from: &[i8; 16]) -> Self {
        // SAFETY: sixteen bytes.
        Self(unsafe {
            let bytes = vld1q_s8(from.as_ptr());
            [vmovl_s8(vget_low_s8(bytes)), vmovl_high_s8(bytes)]
        })
    }

    #[inline(always)]
    fn zero_sums() -> [int32x4_t; 2] {
        Pairs::zero().0
    }

    #[inline(always)]
    fn multiply_add(self, other: Self, sums: [int32x4_t; 2]) -> [int32x4_t; 2] {
        let halves = |of: [int16x8_t; 2]| both!(vget_low_s16(of));
        let sums = both!(vmlal_s16(sums, halves(self.0), halves(other.0)));
        both!(vmlal_high_s16(sums, self.0, other.0))
    }

    #[inline(always)]
    fn totals(sums: [[int32x4_t; 2]; 8]) -> [[i32; 8]; 2] {
        [0, 1].map(|block| {
            let [a, b, c, d, e, f, g, h] = sums.map(|sums| sums[block]);
            let two = both!(vpaddq_s32([a, e], [b, f]));
            let other_two = both!(vpaddq_s32([c, g], [d, h]));
            let four = both!(vpaddq_s32(two, other_two));
            let mut totals = [0; 8];
            // SAFETY: room for eight numbers.
            unsafe {
                vst1q_s32(totals.as_mut_ptr(), four[0]);
                vst1q_s32(totals.as_mut_ptr().add(4), four[1]);
            }
            totals
        })
    }
}
