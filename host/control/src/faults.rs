//! The microcontroller's faults for people: number, name, whether they are active or latched, and what to do.

use gripline_firmware::Fault;
use gripline_protocol::message::Status;
use serde::Serialize;

/// A fault that is active or waits for a person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReportedFault {
    /// Its number.
    pub number: u8,
    /// Its name.
    pub name: &'static str,
    /// It is active now.
    pub active: bool,
    /// It waits for a person to acknowledge it.
    pub latched: bool,
    /// What a person should check.
    pub what_to_do: &'static str,
}

/// The faults of a status.
#[must_use]
pub fn reported(status: &Status) -> Vec<ReportedFault> {
    let has = |bits: u32, fault: Fault| bits & fault.bit() != 0;
    let faults = Fault::ALL.into_iter().filter_map(|fault| {
        let (active, latched) = (has(status.faults, fault), has(status.latched, fault));
        (active || latched).then(|| ReportedFault {
            number: fault as u8,
            name: fault.name(),
            active,
            latched,
            what_to_do: what_to_do(fault),
        })
    });
    faults.collect()
}

/// Names of the faults with these bits.
#[must_use]
pub fn names(bits: u32) -> Vec<&'static str> {
    let faults = Fault::ALL.iter().filter(|fault| bits & fault.bit() != 0);
    faults.map(|fault| fault.name()).collect()
}

/// What a person should check.
#[must_use]
pub const fn what_to_do(fault: Fault) -> &'static str {
    match fault {
        Fault::StaleMaps => "no fresh picture of a fingertip: check its camera, and that a host runs",
        Fault::LinkLost => "the host was silent or the cable out: check cable, power and host",
        Fault::CrcStorm => "many damaged packets: check the cable, its shield and what runs beside it",
        Fault::ReplayedMap | Fault::FutureMap => {
            "maps out of order or with a wrong time: use one host at a time"
        }
        Fault::MapsLost => "maps did not arrive: check the cable and the load of the host",
        Fault::UnhealthyMap => {
            "a picture is not plausible: check lamps, lens and sensor surface (`gripline doctor`)"
        }
        Fault::OutOfRange => "settings were refused: check what the host sends",
        Fault::UnreadableMessage | Fault::SchemaMismatch => {
            "host and firmware differ in version: flash this host's firmware"
        }
        Fault::WatchdogReset => "the program hung or crashed and restarted: check its log",
        Fault::LineAtCeiling => "more force is needed than allowed: check the load and the ceiling",
        Fault::DeadlineMissed => "a map took longer than its deadline: report this",
        Fault::SaturatedMap => "a fingertip measures more than a map can hold: press less",
        Fault::SettingsLost => {
            "the stored settings are damaged: store them again (`gripline config mcu --write`)"
        }
        Fault::LineFailed => "the gripper does not answer or is not ready: check its power, bus and fingers",
        Fault::Undervoltage => "the board's 3.3 V supply is or was too low: check the supply and its wires",
        Fault::LineMismatch => {
            "the gripper does not see the force that was set: check the analog line's wiring"
        }
        Fault::ObjectLost => "the fingers hold nothing any more: look for the object, then release",
        Fault::BrownOutLevel => {
            "the chip may run on a failing supply: set the option bytes (`cargo xtask flash` does)"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_says_what_to_do() {
        for fault in Fault::ALL {
            let advice = what_to_do(fault);
            assert!(advice.contains(": "), "{advice}");
        }
    }
}
