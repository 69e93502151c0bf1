//! `gripline faults`: which faults the microcontroller has, what each is about, and the acknowledgement that latched ones wait
//! for (docs/safety.md). A person must look: nothing here acknowledges what it has not shown.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use gripline_firmware::Fault;
use gripline_protocol::message::{Command, GripMode, Refusal, Status};
use serde::Serialize;

use crate::config::{Overrides, Settings};
use crate::error::Failure;
use gripline_link::Target;
use gripline_link::session::Session;
use gripline_recording::units::newtons;

/// How long the microcontroller may take to say how it is: it does so ten times a second.
const STATUS_US: u64 = 1_000_000;
/// Work between two looks.
const STEP_US: u64 = 5_000;

/// Arguments of `gripline faults`.
#[derive(Debug, Clone, Args)]
pub struct FaultsArgs {
    /// Acknowledge the latched faults that are shown: somebody has looked. A fault that is still there stays. Under way the key
    /// a of `gripline run` does the same; a gripper that holds loses its link again when this command ends.
    #[arg(long)]
    acknowledge: bool,
    /// Then let go, which latched faults forbid: what is held falls.
    #[arg(long, requires = "acknowledge")]
    release: bool,
    /// Which microcontroller: usb, usb:SERIAL, serial:PORT, emulator or embedded. By default the configuration's link.mcu.
    #[arg(long, value_name = "MCU")]
    mcu: Option<Target>,
    /// Configuration file that names the microcontroller.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How the microcontroller is.
#[derive(Debug, PartialEq, Serialize)]
struct Found {
    mode: &'static str,
    line_n: f64,
    faults: Vec<FoundFault>,
    /// Names of those that were acknowledged.
    acknowledged: Vec<&'static str>,
}

#[derive(Debug, PartialEq, Serialize)]
struct FoundFault {
    number: u8,
    name: &'static str,
    /// Its cause is there now.
    active: bool,
    /// It waits for an acknowledgement.
    latched: bool,
    what_to_do: &'static str,
}

/// Shows, and acknowledges where that was asked for.
///
/// # Errors
/// [`Failure`] when the link fails, or a latched fault that was acknowledged is still there.
pub fn run(args: &FaultsArgs) -> Result<(), Failure> {
    let mcu = match &args.mcu {
        Some(mcu) => mcu.clone(),
        None => Settings::load(&Overrides::of_file(args.config.as_deref()))?.mcu,
    };
    let link = mcu.open()?;
    let mut session = Session::connect(link)?;
    let found = look_and_acknowledge(&mut session, args.acknowledge)?;
    if args.json {
        println!("{}", serde_json::to_string(&found)?);
    } else {
        print!("{}", text(&found));
    }
    let left: Vec<_> = found.faults.iter().filter(|fault| fault.latched).collect();
    if args.acknowledge && !left.is_empty() {
        let names: Vec<_> = left.iter().map(|fault| fault.name).collect();
        return Err(Failure::failed(format!(
            "{}: found {} still there after the acknowledgement, expected its cause gone first: {}",
            session.link_name(),
            names.join(", "),
            left[0].what_to_do
        )));
    }
    if args.release {
        release(&mut session)?;
    }
    Ok(())
}

/// What is there; and, where a person has said so, acknowledged.
fn look_and_acknowledge(session: &mut Session, acknowledge: bool) -> Result<Found, Failure> {
    // That somebody speaks ends a silence with the next tick only.
    status(session)?;
    let before = status(session)?;
    if !acknowledge || before.latched == 0 {
        return Ok(found(&before, 0));
    }
    session.command(Command::Acknowledge {
        faults: before.latched,
    })?;
    let after = status(session)?;
    Ok(found(&after, before.latched & !after.latched))
}

/// What the microcontroller says of itself, asked now.
fn status(session: &mut Session) -> Result<Status, Failure> {
    session.command(Command::ReadStatus)?;
    let asked_us = session.now_us();
    while session.now_us() < asked_us + STATUS_US {
        session.run_until(session.now_us() + STEP_US)?;
        if session.status_age_us() == 0
            && let Some(status) = session.status()
        {
            return Ok(*status);
        }
    }
    Err(Failure::failed(format!(
        "{}: found no status within {} s, expected ten a second; check power and wiring",
        session.link_name(),
        STATUS_US / 1_000_000
    )))
}

fn release(session: &mut Session) -> Result<(), Failure> {
    session.command(Command::Release)?;
    let status = status(session)?;
    match session.take_refusal() {
        Some(Refusal::Latched) => Err(Failure::failed(format!(
            "{}: release refused, expected no latched fault: one has come anew",
            session.link_name()
        ))),
        Some(other) => Err(Failure::failed(format!(
            "{}: release refused: {other:?}",
            session.link_name()
        ))),
        None if status.mode == GripMode::Released => Ok(()),
        None => Err(Failure::failed(format!(
            "{}: the gripper still holds, expected it to let go; say it again",
            session.link_name()
        ))),
    }
}

fn found(status: &Status, acknowledged: u32) -> Found {
    let has = |bits: u32, fault: Fault| bits & fault.bit() != 0;
    let faults = Fault::ALL.into_iter().filter_map(|fault| {
        let (active, latched) = (has(status.faults, fault), has(status.latched, fault));
        (active || latched).then(|| FoundFault {
            number: fault as u8,
            name: fault.name(),
            active,
            latched,
            what_to_do: what_to_do(fault),
        })
    });
    Found {
        mode: match status.mode {
            GripMode::Hold => "hold",
            GripMode::Released => "released",
        },
        line_n: newtons(status.line),
        faults: faults.collect(),
        acknowledged: names(acknowledged),
    }
}

/// Names of the faults with these bits.
pub(crate) fn names(bits: u32) -> Vec<&'static str> {
    let there = Fault::ALL.iter().filter(|fault| bits & fault.bit() != 0);
    there.map(|fault| fault.name()).collect()
}

fn text(found: &Found) -> String {
    let mut text = format!("{}, line at {:.2} N\n", found.mode, found.line_n);
    for name in &found.acknowledged {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "acknowledged: {name}");
    }
    if found.faults.is_empty() {
        text += "no fault\n";
    }
    for fault in &found.faults {
        let state = match (fault.active, fault.latched) {
            (true, true) => "there, latched",
            (false, true) => "over, latched: waits for --acknowledge",
            _ => "there",
        };
        let _ = writeln!(
            text,
            "{:2} {} ({state})\n   {}",
            fault.number, fault.name, fault.what_to_do
        );
    }
    text
}

/// What a person should look at.
const fn what_to_do(fault: Fault) -> &'static str {
    match fault {
        Fault::StaleMaps => "no fresh picture of a fingertip: look at its camera, and that a host runs",
        Fault::LinkLost => "the host was silent or the cable out: look at cable, power and host",
        Fault::CrcStorm => "many damaged packets: look at the cable, its shield and what runs beside it",
        Fault::ReplayedMap | Fault::FutureMap => "maps out of order or of another time: one host at a time",
        Fault::MapsLost => "maps did not arrive: look at the cable and at how busy the host is",
        Fault::UnhealthyMap => {
            "a picture cannot be believed: look at lamps, lens and skin (`gripline doctor`)"
        }
        Fault::OutOfRange => "settings were refused: look at what the host sends",
        Fault::UnreadableMessage | Fault::SchemaMismatch => {
            "another version speaks: flash this host's firmware"
        }
        Fault::WatchdogReset => "the program hung or crashed and started again: look at its log",
        Fault::LineAtCeiling => "more force is wanted than allowed: look at the load and at the ceiling",
        Fault::DeadlineMissed => "a map took longer than it may: report this",
        Fault::SaturatedMap => "a fingertip feels more than a map can say: press less",
        Fault::SettingsLost => {
            "the stored settings are damaged: store them again (`gripline config mcu --write`)"
        }
        Fault::LineFailed => {
            "the gripper does not answer or is not ready: look at its power, bus and fingers"
        }
    }
}

#[cfg(test)]
mod tests {
    use gripline_protocol::message::Configuration;

    use super::*;
    use gripline_link::EmbeddedLink;

    /// Holding, and then silent for longer than the link may be.
    fn lost() -> Session {
        let mut session = Session::open(Box::new(EmbeddedLink::new()), Configuration::DEFAULT).unwrap();
        session.command(Command::Hold).unwrap();
        session.run_until(session.now_us() + 900_000).unwrap();
        session
    }

    #[test]
    fn a_lost_link_is_shown_waits_for_a_person_and_then_lets_go() {
        let mut session = lost();
        let shown = look_and_acknowledge(&mut session, false).unwrap();
        let latched: Vec<_> = shown.faults.iter().filter(|fault| fault.latched).collect();
        assert_eq!((latched.len(), latched[0].name), (1, "LINK LOST"));
        assert_eq!((shown.mode, shown.acknowledged.len()), ("hold", 0));
        assert!(text(&shown).contains("2 LINK LOST (over, latched: waits for --acknowledge)"));
        assert!(
            release(&mut session)
                .unwrap_err()
                .to_string()
                .contains("release refused")
        );

        let after = look_and_acknowledge(&mut session, true).unwrap();
        assert_eq!(after.acknowledged, ["LINK LOST"]);
        assert!(after.faults.iter().all(|fault| !fault.latched), "{after:?}");
        // Nobody sends maps, which is no reason to hold on to anything.
        release(&mut session).unwrap();
        session.run_until(session.now_us() + 2_000_000).unwrap();
        let released = look_and_acknowledge(&mut session, false).unwrap();
        assert_eq!((released.mode, released.line_n), ("released", 0.0));
        assert!(text(&released).contains("no fault"), "{}", text(&released));
    }

    #[test]
    fn every_fault_says_what_to_do() {
        for fault in Fault::ALL {
            let advice = what_to_do(fault);
            assert!(advice.contains(": "), "{advice}");
        }
    }
}
