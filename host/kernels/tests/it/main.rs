//! Kernels and vector instructions, on every instruction set of this processor.

use gripline_kernels::InstructionSet;

mod convolution;
mod instruction_set;
mod int16;
mod lines;
mod simd;

/// The instruction sets of this processor, narrowest first.
fn sets() -> impl Iterator<Item = InstructionSet> {
    InstructionSet::ALL.into_iter().filter(|set| set.is_available())
}
