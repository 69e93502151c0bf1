//! Whether the held object is still there: by the contact in the maps, and by the gripper's own object status. Units: µs. Limits:
//! an object that never touched a fingertip, or that the gripper never reported, is not missed.

use gripline_protocol::message::{GripMode, SlipState};

use super::dispatch::Program;
use crate::constants::{CONTACT_GONE_US, MAP_PRESENT_US};
use crate::fault::Fault;
use crate::sums::Kernel;

/// The faults with which a map without contact proves nothing.
const DOUBTFUL: u32 = Fault::StaleMaps.bit() | Fault::UnhealthyMap.bit() | Fault::SaturatedMap.bit();

impl<K: Kernel> Program<K> {
    /// Middle part of the 1 kHz tick: raises OBJECT LOST while a held object is gone.
    pub fn watch_object(&mut self) {
        let is_lost = self.controller.mode() == GripMode::Hold && self.is_object_lost();
        self.safety.set(Fault::ObjectLost, is_lost);
    }

    fn is_object_lost(&mut self) -> bool {
        let is_felt = self.state() != SlipState::NoContact;
        let is_seen = self.has_maps_within(MAP_PRESENT_US) && self.safety.active().bits() & DOUBTFUL == 0;
        let object = &mut self.object;
        if is_felt {
            object.was_felt = true;
            object.gone_us = None;
            object.is_gone = false;
        } else if object.was_felt && is_seen {
            let since_us = *object.gone_us.get_or_insert(self.now_us);
            object.is_gone |= self.now_us.saturating_sub(since_us) >= CONTACT_GONE_US;
        }
        object.is_gone || object.is_lost_by_gripper
    }
}
