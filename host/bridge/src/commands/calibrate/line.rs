//! `gripline calibrate line`: raises the grip-force line step by step, asks for the measured forces, fits the table.

use std::fs;
use std::io::{self, BufRead as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread;

use clap::Args;
use gripline_firmware::GripForce;
use gripline_firmware::line::{DacCode, LineCalibration};
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{ForceMap, Health, LSB_PER_NEWTON, MapInfo, SensorId};
use serde_json::json;

use super::common::{Common, date, wrote};
use super::guide;
use crate::calibration::{Calibration, Line, with_points};
use crate::commands::device::DeviceArgs;
use crate::error::Error;
use crate::value::number_in;
use gripline_evaluation::calibration::line::{Fit, MEASURED_MIN, Measured, Point, fit};
use gripline_link::session::Session;
use gripline_recording::units::newtons;

/// Time between maps while the line stands still, µs: without maps the microcontroller would tighten.
const MAP_US: u64 = 16_000;
/// Maximum time of the line from step to step, µs.
const STEP_TIMEOUT_US: u64 = 10_000_000;

/// Arguments of `gripline calibrate line`.
#[derive(Debug, Clone, Args)]
pub(super) struct LineArgs {
    /// Forces measured before: CSV with the header `code,force_n`. The line does not move.
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["mcu", "steps", "max_n", "store"])]
    csv: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
    /// How many forces to measure, from 0 N up.
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u64).range(MEASURED_MIN as u64..=101))]
    steps: u64,
    /// Force of the last step by the table in force, newtons. By default the ceiling.
    #[arg(long = "most-n", value_name = "NEWTONS", value_parser = number_in(1.0..=125.0))]
    max_n: Option<f64>,
    /// Store the new table in the microcontroller's flash; it takes effect at its next start.
    #[arg(long)]
    store: bool,
    #[command(flatten)]
    common: Common,
}

/// Measures, fits and writes.
///
/// # Errors
/// [`Error`] when the link fails, a force is not a number, or the forces make no table.
pub(super) fn run(args: &LineArgs) -> Result<(), Error> {
    let mut calibration = Calibration::load_or_new(&args.common.out)?;
    let (measured, device, session) = match &args.csv {
        Some(path) => (read(path)?, path.display().to_string(), None),
        None => measure(args)?,
    };
    let named = |error: String| Error::failed(format!("{device}: {error}; nothing was written"));
    let found = fit(&measured).map_err(named)?;
    print(&args.common, &measured, &found);
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    calibration.line = Some(Line {
        date: date(),
        device: args.common.device.clone().unwrap_or(device),
        measured: measured.len(),
        residual_rms_n: rounded(found.rms_n),
        residual_max_n: rounded(found.max_n),
        points: found.points.to_vec(),
    });
    calibration.save()?;
    wrote(&args.common);
    match session.filter(|_| args.store) {
        Some(session) => store(session, &found.points),
        None => Ok(()),
    }
}

fn store(mut session: Session, points: &[Point]) -> Result<(), Error> {
    let settings = with_points(session.settings(), points);
    // No force beyond the table's end.
    let max = settings.line.points.last().map_or(0, |point| point.force);
    let settings = Configuration {
        ceiling: settings.ceiling.min(max),
        fail_safe: settings.fail_safe.min(max),
        floor: settings.floor.min(max),
        ..settings
    };
    session.configure(settings)?;
    let writes = session.store()?;
    tracing::info!(
        "stored ({writes} times by now); the table takes effect at the microcontroller's next start"
    );
    Ok(())
}

fn print(common: &Common, measured: &[Measured], found: &Fit) {
    if common.json {
        let points: Vec<_> = found
            .points
            .iter()
            .map(|point| json!({"force_n": point.force_n, "code": point.code}))
            .collect();
        println!(
            "{}",
            json!({"points": points, "measured": measured.len(), "residual_rms_n": found.rms_n,
                   "residual_max_n": found.max_n})
        );
        return;
    }
    println!("    code   force N");
    for point in &found.points {
        println!("{:8}{:10.3}", point.code, point.force_n);
    }
    println!(
        "{} forces, off by {:.3} N (root mean square), {:.3} N at most",
        measured.len(),
        found.rms_n,
        found.max_n
    );
}

/// Reads `code,force_n`.
fn read(path: &Path) -> Result<Vec<Measured>, Error> {
    let wrong = |found: String, expected: &str| {
        Error::failed(format!("{}: found {found}, expected {expected}", path.display()))
    };
    let text = fs::read_to_string(path).map_err(|error| wrong(error.to_string(), "a CSV of code,force_n"))?;
    let mut lines = text.lines().enumerate();
    let head = lines.next().map_or("", |(_, line)| line.trim());
    if head != "code,force_n" {
        return Err(wrong(format!("the header {head:?}"), "code,force_n"));
    }
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(place, line)| {
            let read = |line: &str| {
                let (code, force) = line.split_once(',')?;
                Some(Measured {
                    code: code.trim().parse().ok()?,
                    force_n: force.trim().parse().ok()?,
                })
            };
            read(line).ok_or_else(|| {
                wrong(
                    format!("{line:?} in line {}", place + 1),
                    "a code and a force in newtons",
                )
            })
        })
        .collect()
}

/// Steps the line and asks for forces; releases the gripper at the end, after a failure too.
fn measure(args: &LineArgs) -> Result<(Vec<Measured>, String, Option<Session>), Error> {
    let session = args.device.connect()?;
    let device = session.link_name();
    if args.common.asks() {
        for (place, step) in guide::LINE.iter().enumerate() {
            guide::ask(place + 1, step)?;
        }
    }
    let before = *session.settings();
    let max_n = args
        .max_n
        .unwrap_or(newtons(before.ceiling))
        .min(newtons(before.ceiling));
    let mut stepper = Stepper {
        table: LineCalibration::of(&before.line),
        input: input_lines(),
        session,
        sequence: 0,
    };
    let mut step_through = || -> Result<Vec<Measured>, Error> {
        stepper.session.command(Command::Hold)?;
        let last = args.steps - 1;
        (0..=last)
            .map(|step| stepper.step(max_n * step as f64 / last as f64, step + 1, args.steps))
            .collect()
    };
    let measured = step_through();
    // After a failure too: release, and restore the settings.
    let _ = stepper.release();
    let _ = stepper.session.configure(before);
    Ok((measured?, device, Some(stepper.session)))
}

struct Stepper {
    session: Session,
    table: LineCalibration,
    input: Receiver<String>,
    sequence: u32,
}

impl Stepper {
    /// Raises the line to `force_n` by the table in force, and asks for the measured force.
    fn step(&mut self, force_n: f64, number: u64, of: u64) -> Result<Measured, Error> {
        let floor = (force_n * f64::from(LSB_PER_NEWTON)).round() as i32;
        let settings = Configuration {
            floor,
            // At least the floor.
            fail_safe: self.session.settings().fail_safe.max(floor),
            ..*self.session.settings()
        };
        self.session.configure(settings)?;
        let end_us = self.session.now_us() + STEP_TIMEOUT_US;
        while self.line() < floor {
            self.keep_alive()?;
            if self.session.now_us() > end_us {
                return Err(Error::failed(format!(
                    "found the line at {:.2} N after {} s, expected {force_n:.2} N: acknowledge the microcontroller's faults, \
                     check rise_rate_n_per_s",
                    newtons(self.line()),
                    STEP_TIMEOUT_US / 1_000_000
                )));
            }
        }
        let DacCode(code) = self.table.code(GripForce::from_lsb(self.line()));
        loop {
            eprint!(
                "step {number} of {of}, code {code} ({force_n:.2} N by the table in force); measured N: "
            );
            let _ = io::stderr().flush();
            let line = self.wait_for_line()?;
            match line.trim().replace(',', ".").parse::<f64>() {
                Ok(force_n) if force_n.is_finite() => return Ok(Measured { code, force_n }),
                _ => eprintln!("\nfound {:?}, expected newtons, such as 4.25", line.trim()),
            }
        }
    }

    fn line(&self) -> i32 {
        self.session.status().map_or(0, |status| status.line)
    }

    /// Sends an empty map, and runs the session until the next.
    fn keep_alive(&mut self) -> Result<(), Error> {
        let info = MapInfo {
            sensor: SensorId::FIRST,
            sequence: self.sequence,
            capture_us: self.session.capture_us(),
            health: Health::GOOD,
            ..MapInfo::default()
        };
        self.sequence = self.sequence.wrapping_add(1);
        self.session.send_map(&info, &ForceMap::EMPTY)?;
        let until_us = self.session.now_us() + MAP_US;
        Ok(self.session.run_until(until_us)?)
    }

    fn wait_for_line(&mut self) -> Result<String, Error> {
        loop {
            match self.input.try_recv() {
                Ok(line) => return Ok(line),
                Err(TryRecvError::Disconnected) => {
                    return Err(Error::failed(
                        "standard input ended, expected a measured force for every step; nothing was written",
                    ));
                }
                Err(TryRecvError::Empty) => self.keep_alive()?,
            }
        }
    }

    fn release(&mut self) -> Result<(), Error> {
        self.session.command(Command::Release)?;
        let end_us = self.session.now_us() + STEP_TIMEOUT_US;
        while self.line() > 0 && self.session.now_us() < end_us {
            self.keep_alive()?;
        }
        Ok(())
    }
}

/// Lines of standard input, read by a thread: the loop must not wait for them.
fn input_lines() -> Receiver<String> {
    let (sender, receiver) = sync_channel(0);
    thread::spawn(move || {
        for line in io::stdin().lock().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}
