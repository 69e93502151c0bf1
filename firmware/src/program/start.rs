//! What the program knows when it starts.

use gripline_protocol::message::{LineSettings, Revision};

use crate::fault::Fault;
use crate::grip::GripForce;
use crate::storage::Stored;

/// Why the microcontroller started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// Power-on, reset pin or debug probe.
    #[default]
    PowerOn,
    /// The program hung.
    Watchdog,
    /// The program panicked, or ran into a fault of the core.
    Software,
    /// The supply dipped below the brown-out level.
    BrownOut,
}

impl ResetCause {
    /// Its fault; none after power-on, reset pin or debug probe.
    #[must_use]
    pub const fn fault(self) -> Option<Fault> {
        match self {
            Self::PowerOn => None,
            Self::Watchdog | Self::Software => Some(Fault::WatchdogReset),
            Self::BrownOut => Some(Fault::Undervoltage),
        }
    }
}

/// What the program knows when it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// Time now, µs.
    pub now_us: u64,
    /// Why it started.
    pub reset: ResetCause,
    /// The line's value before a reset, from memory that survives it.
    pub restored_line: Option<GripForce>,
    /// The line's settings before a reset, from memory that survives it.
    pub line_before: Option<LineSettings>,
    /// The settings from flash.
    pub stored: Stored,
    /// Number of the board, for the handshake: its place in `BOARDS`.
    pub board: u8,
    /// The commit that the image was built from, for the handshake.
    pub revision: Option<Revision>,
    /// A number that differs from start to start, for the handshake.
    pub session: u32,
}

impl Start {
    /// The line's settings in force: they never change while the program runs. While a force is restored, they are those before the
    /// reset, whatever was stored since: the same force must not become another voltage.
    #[must_use]
    pub const fn line(&self) -> &LineSettings {
        match (&self.restored_line, &self.line_before, &self.stored.settings) {
            (Some(force), Some(line), _) if force.lsb() > 0 => line,
            (_, _, Some(settings)) => &settings.line,
            _ => &LineSettings::DEFAULT,
        }
    }
}
