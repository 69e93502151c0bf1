//! A request for the chip's own bootloader that is under way. Units: µs.

use gripline_protocol::message::Bootloader;

/// A request under way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BootloaderRequest {
    /// The answer to the host.
    pub(super) answer: Option<Bootloader>,
    /// When to restart.
    pub(super) due_us: Option<u64>,
}
