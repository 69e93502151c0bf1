//! `gripline faults`: the microcontroller's faults, what to do about each, and acknowledging the latched ones (docs/safety.md). It
//! acknowledges only faults that it has shown.

use std::fmt::Write as _;

use clap::Args;
use gripline_control::{ReportedFault, names, reported};
use gripline_protocol::message::{Command, GripMode, Refusal, Status};
use serde::Serialize;

use crate::commands::device::DeviceArgs;
use crate::error::Error;
use gripline_link::session::Session;
use gripline_recording::units::newtons;

/// How long to wait for a status: the microcontroller sends ten a second.
const STATUS_US: u64 = 1_000_000;
/// Time between two checks.
const STEP_US: u64 = 5_000;

/// Arguments of `gripline faults`.
#[derive(Debug, Clone, Args)]
pub struct FaultsArgs {
    /// Acknowledge the latched faults that are shown, after you have checked the gripper. An active fault stays. During a run the
    /// key a of `gripline run` does the same; a holding gripper loses its link again when this command ends.
    #[arg(long)]
    acknowledge: bool,
    /// Then release the gripper, which latched faults forbid: the held object falls.
    #[arg(long, requires = "acknowledge")]
    release: bool,
    #[command(flatten)]
    device: DeviceArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Mode, line and faults of the microcontroller.
#[derive(Debug, PartialEq, Serialize)]
struct Report {
    mode: &'static str,
    line_n: f64,
    faults: Vec<ReportedFault>,
    /// Names of the acknowledged faults.
    acknowledged: Vec<&'static str>,
}

/// Shows the faults; acknowledges and releases on request.
///
/// # Errors
/// [`Error`] when the link fails, or a latched fault that was acknowledged is still there.
pub fn run(args: &FaultsArgs) -> Result<(), Error> {
    let mut session = args.device.connect()?;
    let report = read_and_acknowledge(&mut session, args.acknowledge)?;
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print!("{}", text(&report));
    }
    let left: Vec<_> = report.faults.iter().filter(|fault| fault.latched).collect();
    if args.acknowledge && !left.is_empty() {
        let names: Vec<_> = left.iter().map(|fault| fault.name).collect();
        return Err(Error::failed(format!(
            "{}: found {} still active after the acknowledgement, expected its cause removed first: {}",
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

/// Reads the faults, and acknowledges the latched ones on request.
fn read_and_acknowledge(session: &mut Session, acknowledge: bool) -> Result<Report, Error> {
    // A lost link ends with the tick after this first message.
    status(session)?;
    let before = status(session)?;
    if !acknowledge || before.latched == 0 {
        return Ok(report(&before, 0));
    }
    session.command(Command::Acknowledge {
        faults: before.latched,
    })?;
    let after = status(session)?;
    Ok(report(&after, before.latched & !after.latched))
}

/// A status that comes from now on.
fn status(session: &mut Session) -> Result<Status, Error> {
    let asked_us = session.now_us();
    session.command(Command::ReadStatus)?;
    while session.now_us() < asked_us + STATUS_US {
        session.run_until(session.now_us() + STEP_US)?;
        // The clock moves between the readings.
        if session.now_us().saturating_sub(session.status_age_us()) > asked_us
            && let Some(status) = session.status()
        {
            return Ok(*status);
        }
    }
    Err(Error::failed(format!(
        "{}: found no status within {} s, expected ten a second; check power and wiring",
        session.link_name(),
        STATUS_US / 1_000_000
    )))
}

fn release(session: &mut Session) -> Result<(), Error> {
    session.command(Command::Release)?;
    let status = status(session)?;
    match session.take_refusal() {
        Some(Refusal::Latched) => Err(Error::failed(format!(
            "{}: release refused, expected no latched fault: a new one came up",
            session.link_name()
        ))),
        Some(Refusal::Inhibited) => Err(Error::failed(format!(
            "{}: release refused, expected the release-inhibit input inactive: let the robot allow it",
            session.link_name()
        ))),
        Some(other) => Err(Error::failed(format!(
            "{}: release refused: {other:?}",
            session.link_name()
        ))),
        None if status.mode == GripMode::Released => Ok(()),
        None => Err(Error::failed(format!(
            "{}: the gripper still holds, expected it to release; try again",
            session.link_name()
        ))),
    }
}

fn report(status: &Status, acknowledged: u32) -> Report {
    Report {
        mode: match status.mode {
            GripMode::Hold => "hold",
            GripMode::Released => "released",
        },
        line_n: newtons(status.line),
        faults: reported(status),
        acknowledged: names(acknowledged),
    }
}

fn text(report: &Report) -> String {
    let mut text = format!("{}, line at {:.2} N\n", report.mode, report.line_n);
    for name in &report.acknowledged {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "acknowledged: {name}");
    }
    if report.faults.is_empty() {
        text += "no fault\n";
    }
    for fault in &report.faults {
        let state = match (fault.active, fault.latched) {
            (true, true) => "active, latched",
            (false, true) => "over, latched: waits for --acknowledge",
            _ => "active",
        };
        let _ = writeln!(
            text,
            "{:2} {} ({state})\n   {}",
            fault.number, fault.name, fault.what_to_do
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::rc::Rc;

    use gripline_link::hot_plug::Clock;
    use gripline_link::usb::UsbFinder;
    use gripline_link::{EmbeddedLink, HotPlug};
    use gripline_protocol::message::Configuration;
    use gripline_test_board::fake_usb::{FakeBus, FakeClock, FakeUsb, device};

    use super::*;

    /// A gripper that was holding when the host fell silent for longer than `link_lost_ms`.
    fn lost() -> Session {
        let mut session = Session::open(Box::new(EmbeddedLink::new()), Configuration::DEFAULT).unwrap();
        session.command(Command::Hold).unwrap();
        session.run_until(session.now_us() + 900_000).unwrap();
        session
    }

    #[test]
    fn a_lost_link_is_shown_waits_for_a_person_and_then_releases() {
        let mut session = lost();
        let shown = read_and_acknowledge(&mut session, false).unwrap();
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

        let after = read_and_acknowledge(&mut session, true).unwrap();
        assert_eq!(after.acknowledged, ["LINK LOST"]);
        assert!(after.faults.iter().all(|fault| !fault.latched), "{after:?}");
        // Missing maps do not forbid a release.
        release(&mut session).unwrap();
        session.run_until(session.now_us() + 2_000_000).unwrap();
        let released = read_and_acknowledge(&mut session, false).unwrap();
        assert_eq!((released.mode, released.line_n), ("released", 0.0));
        assert!(text(&released).contains("no fault"), "{}", text(&released));
    }

    /// A clock that goes on by a microsecond whenever it is read, as one on the wall may.
    struct Ticking {
        inner: FakeClock,
        read: Cell<u64>,
    }

    impl Clock for Ticking {
        fn now_us(&self) -> u64 {
            self.read.set(self.read.get() + 1);
            self.inner.now_us() + self.read.get()
        }

        fn wait_until(&self, us: u64) {
            self.inner.wait_until(us.saturating_sub(self.read.get()));
        }
    }

    #[test]
    fn a_status_is_read_on_a_clock_that_does_not_stand_still() {
        let world = FakeUsb::with(vec![device("A1", "1-2")]);
        let finder = UsbFinder::new(FakeBus(Rc::clone(&world)), None);
        let clock = Ticking {
            inner: FakeClock(Rc::clone(&world)),
            read: Cell::new(0),
        };
        let link = HotPlug::open_with(Box::new(finder), clock).unwrap();
        let mut session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        session.command(Command::Hold).unwrap();
        session.run_until(session.now_us() + 5_000).unwrap();
        world.pass_to(world.now_us() + 900_000);
        let report = read_and_acknowledge(&mut session, true).unwrap();
        assert_eq!((report.mode, report.acknowledged), ("hold", vec!["LINK LOST"]));
        release(&mut session).unwrap();
    }
}
