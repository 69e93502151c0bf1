//! Every fault: number, cause, what it does to the line, whether it latches. The safe state of a gripper is to hold
//! or tighten, never to release; no fault ever lowers the line. Times are in ms of the 1 kHz tick.
//! `docs/safety.md` has the table for people, which a test holds against this list.

use crate::constants::{STORM_LEVEL, STORM_LEVEL_MAX, STORM_PER_PACKET};
use crate::grip::Guard;

/// What went wrong. The numbers travel as bits in every status and never change meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Fault {
    /// While holding, the picture behind a fingertip's newest map is older than `stale_ms`.
    StaleMaps = 1,
    /// While holding, nothing was received for `link_lost_ms`.
    LinkLost = 2,
    /// More refused packets than a link may have.
    CrcStorm = 3,
    /// A map came twice, or later than its successor.
    ReplayedMap = 4,
    /// Maps are missing between this one and the one before.
    MapsLost = 5,
    /// The host doubts the picture behind a fingertip's newest map.
    UnhealthyMap = 6,
    /// A command or setting was out of range and was not carried out.
    OutOfRange = 7,
    /// A message could not be read.
    UnreadableMessage = 8,
    /// The host speaks another schema.
    SchemaMismatch = 9,
    /// The watchdog had to reset the controller.
    WatchdogReset = 10,
    /// The controller wants more than the ceiling allows.
    LineAtCeiling = 11,
    /// A map took longer than the bound from last packet to line.
    DeadlineMissed = 12,
    /// Forces of a fingertip's newest map did not fit the wire: it feels more than the map says.
    SaturatedMap = 13,
    /// A map's picture was taken after the map arrived: the host's clock cannot be right. The map is refused.
    FutureMap = 14,
    /// Settings were stored and none of them can be read: the default ones are in force.
    SettingsLost = 15,
    /// The gripper on the bus does not answer, reports a fault, or is not ready while something is to be held.
    LineFailed = 16,
}

impl Fault {
    /// Every fault, in the order of the numbers.
    pub const ALL: [Self; 16] = [
        Self::StaleMaps,
        Self::LinkLost,
        Self::CrcStorm,
        Self::ReplayedMap,
        Self::MapsLost,
        Self::UnhealthyMap,
        Self::OutOfRange,
        Self::UnreadableMessage,
        Self::SchemaMismatch,
        Self::WatchdogReset,
        Self::LineAtCeiling,
        Self::DeadlineMissed,
        Self::SaturatedMap,
        Self::FutureMap,
        Self::SettingsLost,
        Self::LineFailed,
    ];

    /// Its bit in a status.
    #[must_use]
    pub const fn bit(self) -> u32 {
        1 << self as u8
    }

    /// Whether it stays until a person acknowledges it.
    #[must_use]
    pub const fn latches(self) -> bool {
        matches!(
            self,
            Self::LinkLost | Self::CrcStorm | Self::WatchdogReset | Self::SettingsLost
        )
    }

    /// What it demands of the line while it is there or latched.
    #[must_use]
    pub const fn guard(self) -> Guard {
        match self {
            Self::LinkLost => Guard::Tighten,
            Self::StaleMaps
            | Self::CrcStorm
            | Self::ReplayedMap
            | Self::UnhealthyMap
            | Self::WatchdogReset
            | Self::SaturatedMap
            | Self::FutureMap
            | Self::LineFailed => Guard::Hold,
            Self::MapsLost
            | Self::OutOfRange
            | Self::UnreadableMessage
            | Self::SchemaMismatch
            | Self::LineAtCeiling
            | Self::DeadlineMissed
            | Self::SettingsLost => Guard::Free,
        }
    }

    /// The name that people read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::StaleMaps => "STALE MAPS",
            Self::LinkLost => "LINK LOST",
            Self::CrcStorm => "CRC STORM",
            Self::ReplayedMap => "REPLAYED MAP",
            Self::MapsLost => "MAPS LOST",
            Self::UnhealthyMap => "UNHEALTHY MAP",
            Self::OutOfRange => "OUT OF RANGE",
            Self::UnreadableMessage => "UNREADABLE MESSAGE",
            Self::SchemaMismatch => "SCHEMA MISMATCH",
            Self::WatchdogReset => "WATCHDOG RESET",
            Self::LineAtCeiling => "LINE AT CEILING",
            Self::DeadlineMissed => "DEADLINE MISSED",
            Self::SaturatedMap => "SATURATED MAP",
            Self::FutureMap => "FUTURE MAP",
            Self::SettingsLost => "SETTINGS LOST",
            Self::LineFailed => "LINE FAILED",
        }
    }
}

/// The faults that are there, and those that wait for a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Safety {
    active: u32,
    latched: u32,
    storm_level: u32,
}

impl Safety {
    /// No fault.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            active: 0,
            latched: 0,
            storm_level: 0,
        }
    }

    /// Raises or clears a fault; latching ones stay latched when they clear.
    pub const fn set(&mut self, fault: Fault, there: bool) {
        if there {
            self.active |= fault.bit();
            if fault.latches() {
                self.latched |= fault.bit();
            }
        } else {
            self.active &= !fault.bit();
        }
    }

    /// Counts a refused packet towards a CRC storm.
    pub const fn packet_refused(&mut self) {
        self.storm_level += STORM_PER_PACKET;
        if self.storm_level >= STORM_LEVEL {
            self.set(Fault::CrcStorm, true);
        }
        if self.storm_level > STORM_LEVEL_MAX {
            self.storm_level = STORM_LEVEL_MAX;
        }
    }

    /// One millisecond has passed.
    pub const fn tick(&mut self) {
        self.storm_level = self.storm_level.saturating_sub(1);
        if self.storm_level == 0 {
            self.set(Fault::CrcStorm, false);
        }
    }

    /// A person has looked at these faults.
    pub const fn acknowledge(&mut self, faults: u32) {
        self.latched &= !faults | self.active;
    }

    /// Faults that are there now, as bits.
    #[must_use]
    pub const fn active(&self) -> u32 {
        self.active
    }

    /// Faults that wait for `Acknowledge`, as bits.
    #[must_use]
    pub const fn latched(&self) -> u32 {
        self.latched
    }

    /// The strictest demand of all faults that are there or latched.
    #[must_use]
    pub const fn guard(&self) -> Guard {
        const TIGHTENING: u32 = faults_that_demand(Guard::Tighten);
        const HOLDING: u32 = faults_that_demand(Guard::Hold);
        let faults = self.active | self.latched;
        if faults & TIGHTENING != 0 {
            Guard::Tighten
        } else if faults & HOLDING != 0 {
            Guard::Hold
        } else {
            Guard::Free
        }
    }
}

/// The faults that demand this, as bits.
const fn faults_that_demand(guard: Guard) -> u32 {
    let (mut faults, mut place) = (0, 0);
    while place < Fault::ALL.len() {
        if Fault::ALL[place].guard() as u8 == guard as u8 {
            faults |= Fault::ALL[place].bit();
        }
        place += 1;
    }
    faults
}
