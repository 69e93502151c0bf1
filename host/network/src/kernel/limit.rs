//! How many multiply-adds a second the processor can do at best: what `cargo xtask bench network` measures the
//! kernels against.
#![expect(
    unsafe_code,
    reason = "functions for an instruction set, called where there is one, and loads of arrays of its size"
)]
#![expect(
    clippy::inline_always,
    reason = "code compiles for the instruction set of the function that it is inlined into"
)]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m512};
use std::hint::black_box;

use super::vector::{Eight, LANES_MAX, Sums, Vector};
use crate::instruction_set::InstructionSet;

/// Independent chains of multiply-adds: more than the units' number times their latency, 2 × 4.
const CHAINS: usize = 12;

/// Multiply-adds from registers to registers; returns how many.
///
/// # Panics
/// When the processor lacks the instructions.
#[must_use]
pub fn spin(instructions: InstructionSet, rounds: usize) -> usize {
    assert!(
        instructions.is_available(),
        "this processor has no {instructions}"
    );
    match instructions {
        InstructionSet::Portable => run::<Eight>(rounds),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has it, see above.
        InstructionSet::Avx2 => unsafe { run_avx2(rounds) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has it, see above.
        InstructionSet::Avx512 => unsafe { run_avx512(rounds) },
        #[cfg(not(target_arch = "x86_64"))]
        InstructionSet::Avx2 | InstructionSet::Avx512 => run::<Eight>(rounds),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(rounds: usize) -> usize {
    run::<__m256>(rounds)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn run_avx512(rounds: usize) -> usize {
    run::<__m512>(rounds)
}

#[inline(always)]
fn run<V: Vector + Sums<Number = f32>>(rounds: usize) -> usize {
    let numbers = black_box([0.9, 0.1, 0.5].map(|number: f32| [number; LANES_MAX]));
    // SAFETY: no vector has more lanes than there are numbers of each kind.
    let [factor, summand, first] = unsafe {
        [
            <V as Vector>::load(numbers[0].as_ptr()),
            <V as Vector>::load(numbers[1].as_ptr()),
            <V as Vector>::load(numbers[2].as_ptr()),
        ]
    };
    let mut sums = [first; CHAINS];
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = sum.times_plus(factor, summand);
        }
    }
    for sum in sums {
        let mut out = [0.0; LANES_MAX];
        sum.store(&mut out[..V::LANES]);
        black_box(out);
    }
    rounds * CHAINS * V::LANES
}
