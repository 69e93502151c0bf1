//! The most multiply-adds per second that this processor can do: what benchmarks measure the kernels against.

use std::hint::black_box;

use crate::instruction_set::InstructionSet;
use crate::simd::{Accumulator, Dispatch, LANES_MAX, Simd, Vector, dispatch};

/// Independent chains of multiply-adds: more than units times latency, 2 × 4.
const CHAINS: usize = 12;

/// Runs f32 multiply-adds from registers to registers; returns how many.
///
/// # Panics
/// When the processor lacks the instructions.
#[must_use]
pub fn peak_multiply_adds(instructions: InstructionSet, rounds: usize) -> usize {
    dispatch(instructions, Chains { rounds })
}

struct Chains {
    rounds: usize,
}

impl Dispatch for Chains {
    type Output = usize;

    #[expect(
        clippy::inline_always,
        reason = "compiles for the instruction set of its caller"
    )]
    #[inline(always)]
    fn run<S: Simd>(self) -> usize {
        let [factor, summand, first] =
            black_box([0.9, 0.1, 0.5]).map(|number: f32| S::F32::load(&[number; LANES_MAX]));
        let mut sums = [first; CHAINS];
        for _ in 0..self.rounds {
            for sum in &mut sums {
                *sum = sum.multiply_add(factor, summand);
            }
        }
        let lanes = <S::F32 as Vector>::LANES;
        for sum in sums {
            let mut out = [0.0; LANES_MAX];
            sum.store(&mut out[..lanes]);
            black_box(out);
        }
        self.rounds * CHAINS * lanes
    }
}
