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
mod lines;
#[cfg(target_arch = "aarch64")]
mod neon;
mod number;
mod portable;
mod traits;

pub use lines::Lines;
pub use number::Number;
pub use traits::*;

use crate::instruction_set::InstructionSet;

/// Runs a kernel on an instruction set.
///
/// # Panics
/// When the processor does not have it.
pub fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
    assert_available(instructions);
    match instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2 and FMA, see above.
        InstructionSet::Avx2 => unsafe { avx2::run(kernel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX-512F, see above; that implies AVX2 and FMA.
        InstructionSet::Avx512 => unsafe { avx512::run(kernel) },
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => neon::run(kernel),
        _ => portable::run(kernel),
    }
}

/// The same for kernels that gain nothing from vectors of more than 256 bits: AVX-512 runs them as AVX2.
///
/// # Panics
/// When the processor does not have the instruction set.
pub fn dispatch_256<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
    assert_available(instructions);
    match instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2 and FMA, see above; AVX-512F implies them.
        InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { avx2::run(kernel) },
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => neon::run(kernel),
        _ => portable::run(kernel),
    }
}

fn assert_available(instructions: InstructionSet) {
    assert!(
        instructions.is_available(),
        "this processor has no {instructions}"
    );
}
