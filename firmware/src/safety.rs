//! Which faults are active or latched, and their combined demand on the line. Times are in ms of the 1 kHz tick.

use crate::constants::{STORM_LEVEL, STORM_LEVEL_MAX, STORM_PER_MAP, STORM_PER_PACKET};
use crate::fault::{Fault, FaultSet};
use crate::grip::Guard;
use crate::link::{LINKS, LinkId};

/// The active faults, and those that wait for a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Safety {
    active: FaultSet,
    latched: FaultSet,
    storm_levels: [u32; LINKS],
}

impl Safety {
    /// No fault.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            active: FaultSet::EMPTY,
            latched: FaultSet::EMPTY,
            storm_levels: [0; LINKS],
        }
    }

    /// Raises or clears a fault; latching ones stay latched when they clear.
    pub const fn set(&mut self, fault: Fault, active: bool) {
        self.active.set(fault, active);
        if active && fault.latches() {
            self.latched.set(fault, true);
        }
    }

    /// Counts a refused packet that belongs to no map towards a CRC storm of its link.
    pub const fn packet_refused(&mut self, link: LinkId) {
        self.storm(link, STORM_PER_PACKET);
    }

    /// Counts a broken map, however many of its packets were refused.
    pub const fn map_broken(&mut self, link: LinkId) {
        self.storm(link, STORM_PER_MAP);
    }

    const fn storm(&mut self, link: LinkId, more: u32) {
        let level = &mut self.storm_levels[link as usize];
        *level += more;
        let rages = *level >= STORM_LEVEL;
        if *level > STORM_LEVEL_MAX {
            *level = STORM_LEVEL_MAX;
        }
        if rages {
            self.set(Fault::CrcStorm, true);
        }
    }

    /// One millisecond has passed.
    pub fn tick(&mut self) {
        let [usb, uart] = &mut self.storm_levels;
        (*usb, *uart) = (usb.saturating_sub(1), uart.saturating_sub(1));
        if *usb == 0 && *uart == 0 {
            self.set(Fault::CrcStorm, false);
        }
    }

    /// A person has looked at these faults. Those that are still active stay latched.
    pub fn acknowledge(&mut self, faults: FaultSet) {
        self.latched = self.latched - (faults - self.active);
    }

    /// Faults that are active now.
    #[must_use]
    pub const fn active(&self) -> FaultSet {
        self.active
    }

    /// Faults that wait for `Acknowledge`.
    #[must_use]
    pub const fn latched(&self) -> FaultSet {
        self.latched
    }

    /// The strictest demand of all faults that are active or latched.
    #[must_use]
    pub const fn guard(&self) -> Guard {
        const FAIL_SAFE: u32 = faults_that_demand(Guard::FailSafe);
        const HOLDING: u32 = faults_that_demand(Guard::Hold);
        let faults = self.active.bits() | self.latched.bits();
        if faults & FAIL_SAFE != 0 {
            Guard::FailSafe
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
