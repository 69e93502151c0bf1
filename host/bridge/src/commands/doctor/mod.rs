//! `gripline doctor`: looks at everything that a run needs, with the flags and the configuration of `gripline run`, and says
//! for each what was found, what was expected and what to do. Exit code 0 all well, 3 warnings, 1 something fails.
//! `judge` judges; here the world is touched, and nothing in it changed: the microcontroller is only asked.

mod judge;

use std::time::Instant;

use clap::Args;
use gripline_firmware::Fault;
use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{InstructionSet, Network};
use gripline_protocol::message::{Command, Hello};
use gripline_simulation::constants::REST_PICTURES;
use serde_json::json;

use self::judge::{Check, State};
use crate::calibration::{Calibration, with_points};
use crate::config::{Overrides, Settings};
use crate::error::{Completion, Failure};
use crate::run::network_for;
use crate::run::realtime;
use crate::source::{AtRest, SimulatedSource, Source, SourceSettings};
use gripline_evaluation::calibration::surface::{Change, Figures, mean};
use gripline_link::Target;
use gripline_link::session::Session;
use gripline_link::usb::attached;
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;

/// Pictures that the latency is measured with: as many as show the longest of a second.
const TIMED: usize = 60;
/// Before them, so that caches and clocks are warm.
const WARM: usize = 10;
/// How long the microcontroller may take to say how it is: it does so ten times a second by itself.
const ANSWER_US: u64 = 250_000;
/// Frames a second of the simulated touch.
const TOUCH_FRAMES_PER_SECOND: f64 = 60.0;
/// Grip of the simulated touch that the network is timed with, N.
const TOUCH_N: f64 = 3.0;

/// Arguments of `gripline doctor`.
#[derive(Debug, Clone, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// Print the checks as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Looks and says.
///
/// # Errors
/// [`Failure`] of kind Loss when there are warnings, Failed when a check fails, Usage when the configuration is wrong.
pub fn run(args: &DoctorArgs) -> Result<Completion, Failure> {
    let settings = Settings::load(&args.overrides)?;
    let mut doctor = Doctor {
        json: args.json,
        of_second: false,
        checks: Vec::new(),
    };
    let calibration = settings.calibration.as_ref();
    let rest = doctor.camera(&settings.source, &settings.pictures_of, calibration);
    if let Some(second) = &settings.second_source {
        doctor.of_second = true;
        let of_second = SourceSettings {
            fingertip: 1,
            ..settings.pictures_of.clone()
        };
        doctor.camera(second, &of_second, settings.second_calibration.as_ref());
        doctor.of_second = false;
    }
    doctor.link(&settings);
    doctor.machine(&settings, &rest);
    let worst = doctor
        .checks
        .iter()
        .map(|check| check.state)
        .max()
        .unwrap_or(State::Ok);
    if args.json {
        println!("{}", json!({"worst": worst, "checks": doctor.checks}));
    }
    let named = |state: State| -> Vec<&str> {
        let of = doctor.checks.iter().filter(|check| check.state == state);
        of.map(|check| check.name.as_ref()).collect()
    };
    match worst {
        State::Ok => Ok(Completion::Whole),
        State::Warn => Ok(Completion::WithLoss(format!(
            "warnings: {}",
            named(State::Warn).join(", ")
        ))),
        State::Fail => Err(Failure::failed(format!(
            "not fit: {}",
            named(State::Fail).join(", ")
        ))),
    }
}

struct Doctor {
    json: bool,
    /// What is said now is of the second fingertip.
    of_second: bool,
    checks: Vec<Check>,
}

impl Doctor {
    /// Says it at once: some checks take seconds.
    fn say(&mut self, mut check: Check) {
        if self.of_second {
            check.name = format!("second {}", check.name).into();
        }
        if !self.json {
            println!("{:<5}{:<21}{}", check.state, check.name, check.found);
            if check.state != State::Ok {
                println!("{:26}expected {}\n{:26}{}", "", check.expected, "", check.advice);
            }
        }
        self.checks.push(check);
    }

    /// Camera, light, focus and rest picture of a fingertip; the pictures at rest.
    fn camera(
        &mut self,
        source: &Source,
        pictures_of: &SourceSettings,
        calibrated: Option<&Calibration>,
    ) -> Vec<Vec<u8>> {
        let source = source.open(pictures_of);
        let opened = source.and_then(|mut source| {
            let rest = source.rest(REST_PICTURES.into())?;
            Ok((source.told, source.frames_per_second, rest))
        });
        let (
            told,
            frames_per_second,
            AtRest {
                crops: pictures,
                at_s,
            },
        ) = match opened {
            Ok(opened) => opened,
            Err(failure) => {
                let advice = "do what it says, or choose another source";
                self.say(Check::fail("camera", failure, "pictures", advice));
                return Vec::new();
            }
        };
        self.say(Check::ok("camera", told, "pictures"));
        self.say(judge::frame_rate(&at_s, frames_per_second));
        let figures = Figures::of(&pictures);
        let rest = calibrated.and_then(|calibration| calibration.rest.as_ref());
        self.say(judge::light(&figures));
        self.say(judge::focus(&figures, rest));
        if let Some(rest) = rest {
            self.say(judge::noise(&figures, rest));
        }
        match calibrated.map_or(Ok(None), Calibration::rest_pictures) {
            Ok(before) => {
                let change = before.map(|before| Change::between(&mean(&before), &figures.mean));
                self.say(judge::rest(change.as_ref()));
            }
            Err(failure) => self.say(Check::fail(
                "rest picture",
                failure,
                "the calibrated one",
                "`gripline calibrate rest`",
            )),
        }
        pictures
    }

    /// USB presence, handshake, faults, table of the line.
    fn link(&mut self, settings: &Settings) {
        if let Target::Usb(serial) = &settings.mcu {
            match attached() {
                Ok(found) => self.say(judge::usb(&found, serial.as_deref())),
                Err(error) => self.say(Check::fail(
                    "usb",
                    error,
                    "a list of devices",
                    "check that this system has USB",
                )),
            }
        }
        let session = settings
            .mcu
            .open()
            .map_err(|error| error.to_string())
            .and_then(|link| Session::connect(link).map_err(|error| error.to_string()));
        let mut session = match session {
            Ok(session) => session,
            Err(error) => {
                let advice = "check power, cable and udev rule; flash this version (`cargo xtask flash`)";
                self.say(Check::fail(
                    "firmware",
                    error,
                    format!("an answer from {}", settings.mcu),
                    advice,
                ));
                return;
            }
        };
        if let Some(hello) = session.firmware() {
            self.say(judge::firmware(hello, Hello::of_this_build(0, 0).build));
        }
        let asked = session
            .command(Command::ReadStatus)
            .and_then(|_| session.run_until(session.now_us() + ANSWER_US));
        if let Err(error) = asked {
            self.say(Check::fail("faults", error, "a status", "check cable and power"));
        }
        if let Some(status) = session.status() {
            let bits = status.faults | status.latched;
            let there: Vec<&str> = Fault::ALL
                .iter()
                .filter(|fault| bits & fault.bit() != 0)
                .map(|fault| fault.name())
                .collect();
            self.say(judge::faults(&there));
        }
        if let Some(line) = settings.calibration.as_ref().and_then(|all| all.line.as_ref()) {
            let now = session.settings();
            self.say(judge::line_table(with_points(now, &line.points).line == now.line));
        }
    }

    /// Processor, network, latency and rights; the rights last, because locked memory stays locked.
    fn machine(&mut self, settings: &Settings, rest: &[Vec<u8>]) {
        let widest = InstructionSet::widest();
        self.say(judge::processor(settings.instructions.unwrap_or(widest), widest));
        match network_for(settings) {
            Ok(network) => {
                let name = network.architecture();
                self.say(Check::ok(
                    "network",
                    format!("{name}: {}", what_of(&network)),
                    "weights that can be read",
                ));
                match frame_times_ms(settings, network, rest) {
                    Ok(mut times) => self.say(judge::latency(&mut times)),
                    Err(failure) => self.say(Check::fail("latency", failure, "maps", "report this")),
                }
            }
            Err(failure) => self.say(Check::fail(
                "network",
                failure,
                "weights that can be read",
                "leave network.weights out, or name a file that the trainer wrote",
            )),
        }
        let lacks = std::thread::scope(|scope| {
            let core = settings.realtime_core;
            scope
                .spawn(move || realtime::enter(core))
                .join()
                .unwrap_or_default()
        });
        self.say(judge::realtime(&lacks, settings.realtime));
    }
}

/// How many particles or multiply-adds it looks at is of no use here; who it is.
fn what_of(network: &Network) -> String {
    let calibration = network.calibration();
    format!(
        "friction {:.2}, contact from {:.3} N a taxel",
        calibration.friction, calibration.contact_min_n
    )
}

/// Pictures of a touch through the whole pipeline, the network in each.
fn frame_times_ms(settings: &Settings, network: Network, rest: &[Vec<u8>]) -> Result<Vec<f64>, Failure> {
    let rule = TaxelRule::of(&settings_for(&network));
    let mut source = SimulatedSource::new(settings.pictures_of.seed, TOUCH_FRAMES_PER_SECOND);
    // Its own rest pictures where the camera is a real one: the touch is simulated.
    let own = source.rest(REST_PICTURES.into());
    let rest = if matches!(settings.source, Source::Simulated) {
        rest
    } else {
        &own
    };
    let mut pictures = Vec::new();
    while pictures.len() < TIMED + WARM {
        let picture = source.next(TOUCH_N)?;
        if picture.truth.is_some_and(|truth| truth.normal_n > 0.5 * TOUCH_N) {
            pictures.push(picture.crop);
        }
    }
    let mut pipeline = Pipeline::new(network, rest, GateKind::Off, rule);
    let mut times = Vec::with_capacity(TIMED);
    for crop in &pictures {
        let start = Instant::now();
        let processed = pipeline.process(crop)?;
        if processed.gate == GateDecision::Infer {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    Ok(times.split_off(WARM.min(times.len())))
}
