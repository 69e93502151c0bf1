//! Every fault: number, cause, severity, its demand on the line, and whether it latches. The safe state of a gripper is to
//! hold or to tighten, never to release; no fault ever lowers the line.
//! `docs/safety.md` has the table for people; a test compares the two.

use core::fmt;
use core::ops::{BitOr, Sub};

use crate::grip::Guard;

/// A fault. The numbers travel as bits in every status and never change meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Fault {
    /// While holding, the picture behind a fingertip's newest map is older than `stale_ms`.
    StaleMaps = 1,
    /// While holding, nothing was received for `link_lost_ms`.
    LinkLost = 2,
    /// More refused packets than allowed on a link.
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
    /// Forces of a fingertip's newest map did not fit the wire: the real force is higher than the map's.
    SaturatedMap = 13,
    /// A map's picture was taken after the map arrived: the host's clock cannot be right. The map is refused.
    FutureMap = 14,
    /// Settings were stored and none of them can be read: the default ones are in force.
    SettingsLost = 15,
    /// The gripper on the bus does not answer, reports a fault, or is not ready while something is to be held.
    LineFailed = 16,
    /// The supply is too low, or was so low that the chip restarted.
    Undervoltage = 17,
    /// The option bytes do not keep the chip in reset below 2.8 V.
    BrownOutLevel = 18,
    /// The measured analog line differs from the written one.
    LineMismatch = 19,
    /// While holding, the contact is gone, or the gripper reports that it holds no object any more.
    ObjectLost = 20,
}

impl Fault {
    /// Every fault, in the order of the numbers.
    pub const ALL: [Self; 20] = [
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
        Self::Undervoltage,
        Self::BrownOutLevel,
        Self::LineMismatch,
        Self::ObjectLost,
    ];

    /// Its number, for people, logs and the bits of a status.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Its bit in a status.
    #[must_use]
    pub const fn bit(self) -> u32 {
        1 << self as u8
    }

    /// How severe it is: what stops the grip from following its load is worse than what loses data.
    #[must_use]
    pub const fn severity(self) -> Severity {
        match (self.guard(), self.latches()) {
            (Guard::FailSafe, _) | (_, true) => Severity::Error,
            (Guard::Hold, false) => Severity::Warning,
            (Guard::Free, false) => Severity::Info,
        }
    }

    /// Its cause, in a few words for logs.
    #[must_use]
    pub const fn cause(self) -> &'static str {
        match self {
            Self::StaleMaps => "the newest map of a fingertip is older than stale_ms",
            Self::LinkLost => "nothing received for link_lost_ms",
            Self::CrcStorm => "too many packets refused",
            Self::ReplayedMap => "a map came twice or out of order",
            Self::MapsLost => "maps are missing before the newest one",
            Self::UnhealthyMap => "the host doubts the picture behind a map",
            Self::OutOfRange => "a setting is out of range",
            Self::UnreadableMessage => "a message cannot be read",
            Self::SchemaMismatch => "the host uses another message schema",
            Self::WatchdogReset => "the watchdog, a panic or a core fault reset the chip",
            Self::LineAtCeiling => "the grip needs more than the ceiling allows",
            Self::DeadlineMissed => "a map took longer than the bound to reach the line",
            Self::SaturatedMap => "forces of a map exceed 8 N per taxel",
            Self::FutureMap => "a picture is newer than its arrival: check the host's clock",
            Self::SettingsLost => "stored settings cannot be read: the default ones are in force",
            Self::LineFailed => "the gripper does not answer, reports a fault or is not ready",
            Self::Undervoltage => "the supply is below 2.9 V, or a brown-out reset the chip",
            Self::BrownOutLevel => "the brown-out level in the option bytes is not 3",
            Self::LineMismatch => "the analog line does not measure as it was written",
            Self::ObjectLost => "while holding, the contact or the gripper's object is gone",
        }
    }

    /// Whether it stays until a person acknowledges it.
    #[must_use]
    pub const fn latches(self) -> bool {
        matches!(
            self,
            Self::LinkLost | Self::CrcStorm | Self::WatchdogReset | Self::SettingsLost | Self::Undervoltage
        )
    }

    /// What it demands of the line while it is active or latched.
    #[must_use]
    pub const fn guard(self) -> Guard {
        match self {
            Self::LinkLost => Guard::FailSafe,
            Self::StaleMaps
            | Self::CrcStorm
            | Self::ReplayedMap
            | Self::UnhealthyMap
            | Self::WatchdogReset
            | Self::SaturatedMap
            | Self::FutureMap
            | Self::LineFailed
            | Self::Undervoltage
            | Self::LineMismatch
            | Self::ObjectLost => Guard::Hold,
            Self::MapsLost
            | Self::OutOfRange
            | Self::UnreadableMessage
            | Self::SchemaMismatch
            | Self::LineAtCeiling
            | Self::DeadlineMissed
            | Self::SettingsLost
            | Self::BrownOutLevel => Guard::Free,
        }
    }

    /// Its name, for people.
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
            Self::Undervoltage => "UNDERVOLTAGE",
            Self::BrownOutLevel => "BROWN-OUT LEVEL",
            Self::LineMismatch => "LINE MISMATCH",
            Self::ObjectLost => "OBJECT LOST",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}: {}", self.number(), self.name(), self.cause())
    }
}

/// How severe a fault is, and so the level of its log line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Severity {
    /// Data is missing or a request was refused; the grip works.
    Info,
    /// The line holds until the fault is over.
    Warning,
    /// The line rises to the fail-safe force, or a person must look.
    Error,
}

/// A set of faults: bit n stands for fault number n.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FaultSet(u32);

impl FaultSet {
    /// No fault.
    pub const EMPTY: Self = Self(0);

    /// The set from a status.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The set for a status.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Whether no fault is in it.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether the fault is in it.
    #[must_use]
    pub const fn has(self, fault: Fault) -> bool {
        self.0 & fault.bit() != 0
    }

    /// Its faults, by number.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.into_iter().filter(move |fault| self.has(*fault))
    }

    /// Adds or removes the fault.
    #[inline]
    pub const fn set(&mut self, fault: Fault, active: bool) {
        if active {
            self.0 |= fault.bit();
        } else {
            self.0 &= !fault.bit();
        }
    }
}

impl BitOr for FaultSet {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The faults that the other set lacks.
impl Sub for FaultSet {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faults_that_came_are_the_difference_of_two_sets() {
        let (mut before, mut now) = (FaultSet::EMPTY, FaultSet::EMPTY);
        before.set(Fault::StaleMaps, true);
        now.set(Fault::LineFailed, true);
        now.set(Fault::LinkLost, true);
        assert!((now - before).iter().eq([Fault::LinkLost, Fault::LineFailed]));
        assert!((before - now).iter().eq([Fault::StaleMaps]));
    }

    #[test]
    fn every_fault_is_its_number_and_has_a_cause_of_its_own() {
        for (place, fault) in Fault::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(fault.number()), place + 1);
            let same = Fault::ALL
                .into_iter()
                .filter(|other| other.cause() == fault.cause());
            assert_eq!(same.count(), 1, "{fault}");
        }
    }
}
