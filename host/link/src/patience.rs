//! How long a device may take.

use std::time::Duration;

/// A real device that accepts nothing for this long is stuck, and the next picture is due: a dense map takes 3 ms on full-speed
/// USB.
pub(crate) const SEND_WAIT: Duration = Duration::from_millis(10);

/// A device that was just plugged in is usable within this time: a few hundred milliseconds, and more on a busy system.
pub(crate) const READY_WITHIN: Duration = Duration::from_secs(2);

/// A handshake is answered within this time, µs: a device boots in well under that.
pub(crate) const HANDSHAKE_US: u64 = 3_000_000;
