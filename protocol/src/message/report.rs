//! What the microcontroller tells the host. Units: forces 1/4096 N, ratios 1/10000, times as named.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, OutOfRange};
use crate::sensor_id::SensorId;

/// A message of the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Report {
    /// After every map, on request, and ten times a second.
    Status(Status),
    /// The settings in force: the answer to `Configure` and `ReadConfiguration`.
    Configuration(Configuration),
    /// The settings are in flash and were verified: the answer to `Store`.
    Stored {
        /// How often settings were stored since the chip was new.
        writes: u32,
    },
    /// A command that was understood but not carried out.
    Refused(Refusal),
}

/// Why a command was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// A setting is out of its range.
    OutOfRange(OutOfRange),
    /// The message cannot be read: another schema, or damaged at its source.
    Unreadable,
    /// No handshake yet, or one with another schema.
    NoHandshake,
    /// `Release` while a latched fault waits for `Acknowledge`: a person must look first.
    Latched,
    /// `Store` while holding, or before the line is back at 0 N: `Release` first.
    Holding,
    /// `Store` failed: the flash refused. The settings stored before are still there.
    FlashFailed,
    /// `Release` while the release-inhibit input is active: the robot must allow it first.
    Inhibited,
}

/// State of the contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SlipState {
    /// No contact, so no stick ratio.
    #[default]
    NoContact,
    /// The contact holds.
    Stick,
    /// The contact still holds, but slip is coming.
    Incipient,
    /// The stick ratio is below the threshold.
    Slip,
}

impl SlipState {
    /// The name that people read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoContact => "NO_CONTACT",
            Self::Stick => "STICK",
            Self::Incipient => "INCIPIENT",
            Self::Slip => "SLIP",
        }
    }
}

/// What each witness of slip would say if it were the only one, 1/10000: how sure it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Witnesses {
    /// The stick ratio and the load on the contact.
    pub stick_ratio: u16,
    /// The map changes although the load does not.
    pub unrest: u16,
    /// The shear follows the grip.
    pub shear_follows: u16,
    /// The host's evidence of motion.
    pub motion: u16,
}

impl Witnesses {
    /// Names and values, in the order of the fields.
    #[must_use]
    pub const fn named(&self) -> [(&'static str, u16); 4] {
        [
            ("stick_ratio", self.stick_ratio),
            ("unrest", self.unrest),
            ("shear_follows", self.shear_follows),
            ("motion", self.motion),
        ]
    }

    /// The surer of both, witness by witness.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self {
            stick_ratio: self.stick_ratio.max(other.stick_ratio),
            unrest: self.unrest.max(other.unrest),
            shear_follows: self.shear_follows.max(other.shear_follows),
            motion: self.motion.max(other.motion),
        }
    }
}

/// The gripper's mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum GripMode {
    /// Let go, or never closed.
    #[default]
    Released,
    /// Holding.
    Hold,
}

/// The sums of one map, in the wire's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MapSums {
    /// Taxels in contact: normal force above `contact_min`.
    pub contact: u16,
    /// Taxels in contact that stick: fx² + fy² ≤ μ² fz².
    pub stick: u16,
    /// Sums over the whole map of fx, fy, fz, 1/4096 N.
    pub force: [i32; 3],
    /// Moment about z at the map's centre, Σ(x fy − y fx), in 1/4096 N × half a taxel pitch.
    pub moment: i32,
    /// First moment of pressure: Σ x fz and Σ y fz, in 1/4096 N × half a taxel pitch. Over Σ fz it is the centre of pressure.
    #[serde(alias = "pressure")] // recordings made before
    pub first_moment: [i32; 2],
    /// Second moment of pressure: Σ (x² + y²)/2 fz about the map's centre, in 1/4096 N × half a taxel pitch squared.
    #[serde(alias = "spread")] // recordings made before
    pub second_moment: i32,
}

/// Places in [`Status::worst_cycles`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// One packet of a map taken in.
    Packet = 0,
    /// The last packet of a map: sums, CRC, decision, control.
    Decide = 1,
    /// The line written.
    Line = 2,
    /// The 1 kHz safety tick.
    Tick = 3,
}

/// Number of [`Stage`]s.
pub const STAGES: usize = 4;

/// The state of the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Milliseconds since start; wraps after 49 days.
    pub uptime_ms: u32,
    /// Sensor of the last accepted map.
    pub sensor: SensorId,
    /// Sequence number of the last accepted map.
    pub sequence: u32,
    /// The sums of that map.
    pub sums: MapSums,
    /// Whether F_T > μ F_N in that map: the Coulomb baseline.
    pub coulomb_slip: bool,
    /// Slip state over all fingertips: the worst.
    pub state: SlipState,
    /// How sure the whole detector is that something slips, 1/10000: all witnesses, of the fingertip that says more.
    // Recordings from before have none.
    #[serde(default)]
    pub slip_evidence: u16,
    /// What the witnesses say by themselves.
    #[serde(default)]
    pub witnesses: Witnesses,
    /// Estimated time to slip, ms; `None` unless the stick ratio falls.
    pub time_to_slip_ms: Option<u16>,
    /// The gripper's mode.
    pub mode: GripMode,
    /// Grip-force line, 1/4096 N.
    pub line: i32,
    /// Active faults: bit n for fault number n.
    pub faults: u32,
    /// Latched faults that wait for `Acknowledge`.
    pub latched: u32,
    /// Maps accepted since start; wraps.
    pub maps: u32,
    /// Maps refused since start (CRC, order, sequence); wraps.
    pub maps_refused: u32,
    /// Packets refused since start; wraps.
    pub packets_refused: u32,
    /// Worst stage times since start, core cycles; see [`Stage`].
    pub worst_cycles: [u32; STAGES],
}
