//! Which vector instructions the kernels use: by default the widest the processor has. AVX2, AVX-512 and NEON compute
//! the same bits. Portable has no fused multiply-add, so it differs in the last digits; its bits are the same on every machine.

use std::fmt;
use std::str::FromStr;

use crate::error::KernelError;

/// A set of vector instructions that the kernels are built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum InstructionSet {
    /// What every processor of the target has; 8 numbers at a time.
    Portable,
    /// AVX2 and FMA, for int16 AVX-VNNI where the processor has it: 8 numbers at a time.
    Avx2,
    /// AVX-512F: 16 numbers at a time.
    Avx512,
    /// NEON of 64-bit ARM: 8 numbers at a time, in two registers.
    Neon,
}

impl InstructionSet {
    /// All of them; those of one processor narrowest first.
    pub const ALL: [Self; 4] = [Self::Portable, Self::Avx2, Self::Avx512, Self::Neon];

    /// The widest that this processor has.
    #[must_use]
    pub fn widest() -> Self {
        Self::ALL
            .into_iter()
            .rfind(|set| set.is_available())
            .unwrap_or(Self::Portable)
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => is_x86_feature_detected!("avx512f"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
            // Every processor of the target has it.
            Self::Neon => cfg!(target_arch = "aarch64"),
        }
    }

    /// Itself, when this processor has it.
    ///
    /// # Errors
    /// When it does not; the error lists what it has.
    pub fn checked(self) -> Result<Self, KernelError> {
        let available: Vec<Self> = Self::ALL.into_iter().filter(|set| set.is_available()).collect();
        self.among(&available)
    }

    /// Itself, when it is one of these.
    ///
    /// # Errors
    /// When it is not; the error lists them.
    pub fn among(self, available: &[Self]) -> Result<Self, KernelError> {
        if available.contains(&self) {
            return Ok(self);
        }
        let available: Vec<String> = available.iter().map(|set| format!("`{set}`")).collect();
        Err(KernelError::MissingInstructionSet {
            wanted: self.to_string(),
            available: available.join(", "),
        })
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
            Self::Neon => "neon",
        })
    }
}

impl FromStr for InstructionSet {
    type Err = KernelError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|set| set.to_string() == name)
            .ok_or_else(|| KernelError::UnknownInstructionSet {
                found: name.to_owned(),
            })
    }
}
