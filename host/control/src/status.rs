//! What the gripper is doing now. Every client may read it.

use serde::Serialize;

use crate::client::Client;
use crate::faults::ReportedFault;

/// The newest known state. Forces in newtons.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct StatusReport {
    /// Who owns the gripper.
    pub owner: Option<Client>,
    /// The last requested mode over this bridge: `hold`, `released`, or nothing.
    pub requested: Option<&'static str>,
    /// The present mode: `hold`, `released`, or nothing before the first status.
    pub mode: Option<&'static str>,
    /// Slip state of the newest frame: `NO_CONTACT`, `STICK`, `INCIPIENT`, `SLIP`.
    pub state: &'static str,
    /// Grip-force line, newtons.
    pub line_n: f64,
    /// Minimum force while holding, newtons.
    pub floor_n: f64,
    /// Maximum force, newtons.
    pub ceiling_n: f64,
    /// Which microcontroller.
    pub link: String,
    /// Whether it is connected.
    pub is_connected: bool,
    /// How old the newest status is, milliseconds.
    pub status_age_ms: f64,
    /// The microcontroller's faults.
    pub faults: Vec<ReportedFault>,
    /// Names of the host's own faults.
    pub host_faults: Vec<&'static str>,
    /// Pictures so far.
    pub frames: u64,
}
