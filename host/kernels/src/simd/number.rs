//! Numbers that convolutions multiply, each with the instruction sets that it runs on.

use super::traits::{Accumulator, Dispatch, Int16Pair, Simd};
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use super::{dispatch, dispatch_256};
use crate::instruction_set::InstructionSet;

/// A number that convolutions multiply.
pub trait Number: Copy + Default {
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

impl Number for Int16Pair {
    type Accumulator<S: Simd> = S::Int16;

    fn dispatch<K: Dispatch>(instructions: InstructionSet, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if instructions == InstructionSet::Avx512 {
            assert!(Self::has_avx512(), "this processor has no avx512vnni");
            // SAFETY: the processor has AVX-512F and VNNI, see above.
            return unsafe { avx512::run_vnni(kernel) };
        }
        #[cfg(target_arch = "x86_64")]
        if instructions == InstructionSet::Avx2 && instructions.is_available() && Self::has_avx_vnni() {
            // SAFETY: the processor has AVX2, FMA and AVX-VNNI, see above.
            return unsafe { avx2::run_vnni(kernel) };
        }
        dispatch_256(instructions, kernel)
    }
}
