//! Plain arrays, which the compiler puts into whatever vectors the target has.

use super::traits::{
    Accumulator, Dispatch, F32x8, Int16Pair, Int16x16, IntegerSums, Simd, TABLE, Table, Vector, round,
};

/// Runs a kernel.
#[inline(never)]
pub(super) fn run<K: Dispatch>(kernel: K) -> K::Output {
    kernel.run::<Portable>()
}

pub(super) struct Portable;

impl Simd for Portable {
    type F32 = [f32; 8];
    type Int16 = Pairs;
    type F32x8 = [f32; 8];
    type Int16x16 = Words;

    #[inline(always)]
    fn sad_x8<const ROWS: usize>(template: &[[u8; 8]; ROWS], pixels: &[u8], stride: usize) -> [u16; 8] {
        let mut sums = [0; 8];
        for (place, sum) in sums.iter_mut().enumerate() {
            for (row, template) in template.iter().enumerate() {
                let pixels: &[u8; 8] = pixels[row * stride + place..]
                    .first_chunk()
                    .expect("eight pixels");
                for k in 0..8 {
                    *sum += u16::from(template[k].abs_diff(pixels[k]));
                }
            }
        }
        sums
    }

    #[inline(always)]
    fn min_sum(a: &[u16; 8], b: &[u16; 8]) -> (u16, usize) {
        let mut min = (u16::MAX, 0);
        for (place, (a, b)) in a.iter().zip(b).enumerate() {
            let sum = a.saturating_add(*b);
            if sum < min.0 {
                min = (sum, place);
            }
        }
        min
    }

    #[inline(always)]
    fn sums_5x5_x8(rows: [&[u8; 40]; 5]) -> [u16; 8] {
        let columns: [u16; 40] = std::array::from_fn(|k| rows.iter().map(|row| u16::from(row[k])).sum());
        std::array::from_fn(|block| columns[5 * block..][..5].iter().sum())
    }
}

impl Vector for [f32; 8] {
    const LANES: usize = 8;

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        *from.first_chunk().expect("eight numbers")
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        match out.as_mut_array::<8>() {
            Some(out) => *out = self,
            None => out.copy_from_slice(&self[..out.len()]),
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }

    #[inline(always)]
    fn relu(self) -> Self {
        self.map(|value| if value < 0.0 { 0.0 } else { value })
    }
}

// SAFETY: eight lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for [f32; 8] {
    type Number = f32;
    type Out = Self;

    const VECTORS: usize = 1;
    const SPLITS: bool = false;
    // Of SSE2's sixteen registers: two for each vector of sums, two for the weights, one for a product.
    const PIXELS_MAX: [usize; 2] = [6, 3];

    #[inline(always)]
    fn zero() -> Self {
        [0.0; 8]
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const f32) -> Self {
        // SAFETY: the caller promises S readable numbers.
        let numbers = unsafe { from.cast::<[f32; S]>().read_unaligned() };
        std::array::from_fn(|lane| numbers[lane % S])
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const f32) -> Self {
        // SAFETY: the caller promises eight readable numbers.
        unsafe { from.cast::<[f32; 8]>().read_unaligned() }
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        let of = |lane: usize| if lane < 8 { self[lane] } else { other[lane - 8] };
        std::array::from_fn(|lane| of(2 * lane) + of(2 * lane + 1))
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        std::array::from_fn(|lane| self[lane] * weight[lane] + sum[lane])
    }

    #[inline(always)]
    fn scale(self, _factors: &[f32]) -> Self {
        self
    }

    #[inline(always)]
    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        kernel.run::<Portable>()
    }
}

/// Eight pairs, the first int16 in the lower half, or eight sums.
#[derive(Clone, Copy)]
pub(super) struct Pairs([i32; 8]);

#[inline(always)]
fn packed(Int16Pair([low, high]): Int16Pair) -> i32 {
    i32::from(high) << 16 | i32::from(low) & 0xFFFF
}

// SAFETY: eight lanes, as `Out` has; it reads what its methods say.
unsafe impl Accumulator for Pairs {
    type Number = Int16Pair;
    type Out = [f32; 8];
    const VECTORS: usize = 1;
    const SPLITS: bool = false;
    const PIXELS_MAX: [usize; 2] = [6, 3];

    #[inline(always)]
    fn zero() -> Self {
        Self([0; 8])
    }

    #[inline(always)]
    unsafe fn broadcast<const S: usize>(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises S readable pairs.
        let pairs = unsafe { from.cast::<[Int16Pair; S]>().read_unaligned() };
        Self(std::array::from_fn(|lane| packed(pairs[lane % S])))
    }

    #[inline(always)]
    unsafe fn load_unchecked(from: *const Int16Pair) -> Self {
        // SAFETY: the caller promises eight readable pairs.
        let pairs = unsafe { from.cast::<[Int16Pair; 8]>().read_unaligned() };
        Self(pairs.map(packed))
    }

    #[inline(always)]
    fn pairwise_sums(self, other: Self) -> Self {
        let of = |lane: usize| if lane < 8 { self.0[lane] } else { other.0[lane - 8] };
        Self(std::array::from_fn(|lane| {
            of(2 * lane).wrapping_add(of(2 * lane + 1))
        }))
    }

    #[inline(always)]
    fn multiply_add(self, weight: Self, sum: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            let (a, b) = (self.0[lane], weight.0[lane]);
            let low = i32::from(a as i16) * i32::from(b as i16);
            let high = (a >> 16) * (b >> 16);
            // The vector instructions wrap too; the weights are such that nothing does.
            sum.0[lane].wrapping_add(low).wrapping_add(high)
        }))
    }

    #[inline(always)]
    fn scale(self, factors: &[f32]) -> [f32; 8] {
        let factors = <[f32; 8] as Vector>::load(factors);
        std::array::from_fn(|lane| self.0[lane] as f32 * factors[lane])
    }

    #[inline(always)]
    fn apart<K: Dispatch>(kernel: K) -> K::Output {
        kernel.run::<Portable>()
    }
}

impl IntegerSums for Pairs {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            self.0[lane].wrapping_add(other.0[lane])
        }))
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            self.0[lane].wrapping_sub(other.0[lane])
        }))
    }
}

impl F32x8 for [f32; 8] {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; 8]
    }

    #[inline(always)]
    fn load(from: &[f32; 8]) -> Self {
        *from
    }

    #[inline(always)]
    fn from_u8(from: [u8; 8]) -> Self {
        from.map(f32::from)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        *to = self;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] + other[k])
    }

    #[inline(always)]
    fn subtract(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] - other[k])
    }

    #[inline(always)]
    fn multiply(self, other: Self) -> Self {
        std::array::from_fn(|k| self[k] * other[k])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }

    #[inline(always)]
    fn round(self) -> Self {
        self.map(|value| round(value) as f32)
    }

    #[inline(always)]
    fn gather(self, table: &Table) -> Self {
        self.map(|index| table[index as i32 as usize % TABLE].into())
    }

    #[inline(always)]
    fn select_less(self, than: Self, yes: Self, no: Self) -> Self {
        std::array::from_fn(|k| if self[k] < than[k] { yes[k] } else { no[k] })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        let four: [f32; 4] = std::array::from_fn(|k| self[k] + self[k + 4]);
        (four[0] + four[2]) + (four[1] + four[3])
    }

    #[inline(always)]
    fn min(self) -> f32 {
        self.into_iter().fold(f32::INFINITY, f32::min)
    }
}

#[derive(Clone, Copy)]
pub(super) struct Words([i16; 16]);

impl Int16x16 for Words {
    type Sums = [i32; 8];

    #[inline(always)]
    fn splat(value: i16) -> Self {
        Self([value; 16])
    }

    #[inline(always)]
    fn from_u8(from: &[u8; 16]) -> Self {
        Self(from.map(i16::from))
    }

    #[inline(always)]
    fn from_i8(from: &[i8; 16]) -> Self {
        Self(from.map(i16::from))
    }

    #[inline(always)]
    fn zero_sums() -> [i32; 8] {
        [0; 8]
    }

    #[inline(always)]
    fn multiply_add(self, other: Self, sums: [i32; 8]) -> [i32; 8] {
        let product = |k: usize| i32::from(self.0[k]) * i32::from(other.0[k]);
        std::array::from_fn(|k| sums[k] + product(2 * k) + product(2 * k + 1))
    }

    #[inline(always)]
    fn totals(sums: [[i32; 8]; 8]) -> [[i32; 8]; 2] {
        [0, 4].map(|first| sums.map(|sums| sums[first..first + 4].iter().sum()))
    }
}
