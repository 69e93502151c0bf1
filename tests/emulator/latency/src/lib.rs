//! How long the firmware takes at most from a map's last packet to the grip-force line: measured on the unmodified
//! image, instruction by instruction, and bounded by a walk over the linked image.
#![forbid(unsafe_code)]

pub mod bound;
pub mod cycles;
pub mod image;
pub mod measure;
pub mod misuse;
pub mod receiver;
pub mod report;
pub mod rounds;
pub mod snapshot;
pub mod source;
pub mod stack;
pub mod sweep;
pub mod tables;
pub mod twin;
pub mod walk;
pub mod walks;

/// Why a figure cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The image cannot be read.
    #[error("image: {0}; build it with `cargo xtask firmware --board stm32f427vi`")]
    Image(String),
    /// The board did not run.
    #[error(transparent)]
    Board(#[from] gripline_emulator::EmulatorError),
    /// The board did not do what every measurement stands on.
    #[error("board: expected {expected}, found {found}")]
    Unexpected {
        /// What had to happen.
        expected: String,
        /// What happened.
        found: String,
    },
}
