//! What the host asks of the microcontroller.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;

/// What the host asks of the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Take these settings; refused whole when one is out of range.
    Configure(Configuration),
    /// Send the settings in force.
    ReadConfiguration,
    /// Store the settings in force in flash. Writing stops the processor for up to half a second, so it needs a released
    /// gripper with the line at 0 N.
    Store,
    /// Close to the floor force and hold.
    Hold,
    /// Let go, slowly: the only way below the floor force.
    Release,
    /// A person has seen these latched faults: clear them.
    Acknowledge {
        /// Bit n stands for fault number n.
        faults: u32,
    },
    /// Send a status now.
    ReadStatus,
}
