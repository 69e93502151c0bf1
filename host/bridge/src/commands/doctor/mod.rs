//! `gripline doctor`: checks everything that a run needs, with the flags and the configuration of `gripline run`, and reports
//! for each what was found, what was expected and what to do. Exit code 0: all well, 3: warnings, 1: a check failed.
//! This file measures and changes nothing; `judge` judges.

mod judge;
mod markers;

use std::time::Instant;

use clap::Args;
use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{InstructionSet, Network};
use gripline_protocol::message::{Command, Hello};
use gripline_sensor::{MarkerKind, Sensor};
use gripline_simulation::constants::REST_PICTURES;
use serde_json::json;

use self::judge::{Finding, Level};
use crate::calibration::{Calibration, with_points};
use crate::config::{Overrides, Settings};
use crate::error::{Completion, Error};
use crate::model::Model;
use crate::realtime;
use crate::source::{AtRest, SimulatedSource, Source, SourceSettings};
use gripline_capture::clip::ffmpeg_version;
use gripline_control::names as fault_names;
use gripline_evaluation::calibration::surface::{Change, Figures, mean};
use gripline_flash::usb as bootloader;
use gripline_link::Target;
use gripline_link::session::Session;
use gripline_link::usb::attached;
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;

/// Pictures that the latency is measured with: a second of them.
const TIMED: usize = 60;
/// Pictures before them, to warm up caches and clocks.
const WARM_UP: usize = 10;
/// How long to wait for a status: the microcontroller sends ten a second.
const STATUS_US: u64 = 250_000;
/// Frame rate of the simulated touch.
const TOUCH_FRAMES_PER_SECOND: f64 = 60.0;
/// Grip force of the simulated touch, N.
const TOUCH_N: f64 = 3.0;

/// Arguments of `gripline doctor`.
#[derive(Debug, Clone, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// Print the findings as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Checks and reports.
///
/// # Errors
/// [`Error`] of kind Loss when there are warnings, Failed when a check fails, Usage when the configuration is wrong.
pub fn run(args: &DoctorArgs) -> Result<Completion, Error> {
    check(&Settings::load(&args.overrides)?, args.json)
}

/// The same for settings that were read.
///
/// # Errors
/// As [`run`], except for the configuration.
pub(super) fn check(settings: &Settings, json: bool) -> Result<Completion, Error> {
    let mut doctor = Doctor {
        json,
        is_second: false,
        findings: Vec::new(),
    };
    let model = Model::of(settings)
        .map_err(|failure| {
            doctor.report(Finding::fail(
                "network",
                failure,
                "weights and a description that can be read",
                "leave network.weights out, or name a file that the trainer wrote for this sensor",
            ));
        })
        .ok();
    let fingertips = [Some(&settings.source), settings.second_source.as_ref()];
    let calibrations = [&settings.calibration, &settings.second_calibration];
    let mut rest = Vec::new();
    for (fingertip, (source, calibration)) in fingertips.iter().zip(calibrations).enumerate() {
        let Some(source) = *source else { continue };
        doctor.is_second = fingertip == 1;
        match &model {
            Some(model) if model.has_markers() => doctor.markers(settings, model, fingertip, source),
            // Pictures of particles can be looked at without weights.
            None if !has_particles(settings) => {}
            _ => {
                let pictures =
                    doctor.camera(source, &settings.source_settings(fingertip), calibration.as_ref());
                if fingertip == 0 {
                    rest = pictures;
                }
            }
        }
    }
    doctor.is_second = false;
    let is_clip = |source: &Source| matches!(source, Source::Clip(_));
    let is_needed = fingertips.into_iter().flatten().any(is_clip);
    doctor.report(judge::ffmpeg(ffmpeg_version(), is_needed));
    doctor.link(settings);
    doctor.machine(settings, model.as_ref(), &rest);
    let findings = &doctor.findings;
    let worst = findings
        .iter()
        .map(|finding| finding.level)
        .max()
        .unwrap_or(Level::Ok);
    if json {
        println!("{}", json!({"worst": worst, "checks": findings}));
    }
    let at_worst = findings.iter().filter(|finding| finding.level == worst);
    let names = at_worst
        .map(|finding| finding.what.as_ref())
        .collect::<Vec<_>>()
        .join(", ");
    match worst {
        Level::Ok => Ok(Completion::Whole),
        Level::Warn => Ok(Completion::WithLoss(format!("warnings: {names}"))),
        Level::Fail => Err(Error::failed(format!("not fit: {names}"))),
    }
}

struct Doctor {
    json: bool,
    /// From now on findings are about the second fingertip.
    is_second: bool,
    findings: Vec<Finding>,
}

/// Whether the sensor is described as one with particles in its gel.
fn has_particles(settings: &Settings) -> bool {
    let sensor =
        Sensor::text_of(&settings.sensor).and_then(|text| Sensor::from_toml(&settings.sensor, &text));
    sensor.is_ok_and(|sensor| sensor.markers.kind == MarkerKind::Volume)
}

impl Doctor {
    /// Prints it at once: some checks take seconds.
    fn report(&mut self, mut finding: Finding) {
        if self.is_second {
            finding.what = format!("second {}", finding.what).into();
        }
        if !self.json {
            println!("{:<5}{:<21}{}", finding.level, finding.what, finding.found);
            if finding.level != Level::Ok {
                println!("{:26}expected {}\n{:26}{}", "", finding.expected, "", finding.fix);
            }
        }
        self.findings.push(finding);
    }

    /// Camera, light, focus and rest picture of a fingertip; returns its pictures at rest.
    fn camera(
        &mut self,
        source: &Source,
        pictures_of: &SourceSettings,
        calibrated: Option<&Calibration>,
    ) -> Vec<Vec<u8>> {
        let source = source.open(pictures_of);
        let opened = source.and_then(|mut source| {
            let rest = source.rest(REST_PICTURES.into())?;
            Ok((source.description, source.frames_per_second, rest))
        });
        let (
            description,
            frames_per_second,
            AtRest {
                crops: pictures,
                at_s,
            },
        ) = match opened {
            Ok(opened) => opened,
            Err(failure) => {
                let fix = "do what it says, or choose another source";
                self.report(Finding::fail("camera", failure, "pictures", fix));
                return Vec::new();
            }
        };
        self.report(Finding::ok("camera", description, "pictures"));
        self.report(judge::frame_rate(&at_s, frames_per_second));
        let figures = Figures::of(&pictures);
        let rest = calibrated.and_then(|calibration| calibration.rest.as_ref());
        self.report(judge::light(&figures));
        self.report(judge::focus(&figures, rest));
        if let Some(rest) = rest {
            self.report(judge::noise(&figures, rest));
        }
        match calibrated.map_or(Ok(None), Calibration::rest_pictures) {
            Ok(before) => {
                let change = before.map(|before| Change::between(&mean(&before), &figures.mean));
                self.report(judge::rest(change.as_ref()));
            }
            Err(failure) => self.report(Finding::fail(
                "rest picture",
                failure,
                "the calibrated one",
                "`gripline calibrate rest`",
            )),
        }
        pictures
    }

    /// USB device, handshake, faults, line table.
    fn link(&mut self, settings: &Settings) {
        let chips = bootloader::attached().unwrap_or_default();
        let places: Vec<&str> = chips.iter().map(|chip| chip.place.as_str()).collect();
        if let Some(finding) = judge::bootloader(&places) {
            self.report(finding);
        }
        if let Target::Usb(serial) = &settings.mcu {
            match attached() {
                Ok(found) => self.report(judge::usb(&found, serial.as_deref())),
                Err(error) => self.report(Finding::fail(
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
                let fix = "check power, cable and udev rule; flash this version (`cargo xtask flash`)";
                self.report(Finding::fail(
                    "firmware",
                    error,
                    format!("an answer from {}", settings.mcu),
                    fix,
                ));
                return;
            }
        };
        if let Some(hello) = session.firmware() {
            self.report(judge::firmware(hello, Hello::of_this_build(0, 0).build));
        }
        let asked = session
            .command(Command::ReadStatus)
            .and_then(|_| session.run_until(session.now_us() + STATUS_US));
        if let Err(error) = asked {
            self.report(Finding::fail(
                "faults",
                error,
                "a status",
                "check cable and power",
            ));
        }
        if let Some(status) = session.status() {
            self.report(judge::faults(&fault_names(status.faults | status.latched)));
        }
        if let Some(line) = settings.calibration.as_ref().and_then(|all| all.line.as_ref()) {
            let now = session.settings();
            self.report(judge::line_table(with_points(now, &line.points).line == now.line));
        }
    }

    /// Processor, network, latency and real-time rights; the rights come last, because locked memory stays locked.
    fn machine(&mut self, settings: &Settings, model: Option<&Model>, rest: &[Vec<u8>]) {
        let widest = InstructionSet::widest();
        self.report(judge::processor(settings.instructions.unwrap_or(widest), widest));
        // Of markers the pictures themselves were timed.
        if let Some(network) = model.and_then(Model::network) {
            let network = network.clone();
            let calibration = network.calibration();
            let found = format!(
                "{}: friction {:.2}, contact from {:.3} N a taxel",
                network.architecture(),
                calibration.friction,
                calibration.contact_min_n
            );
            self.report(Finding::ok("network", found, "weights that can be read"));
            match frame_times_ms(settings, network, rest) {
                Ok(mut times) => self.report(judge::latency(&mut times)),
                Err(failure) => self.report(Finding::fail("latency", failure, "maps", "report this")),
            }
        }
        let lacks = std::thread::scope(|scope| {
            let core = settings.realtime_core;
            scope
                .spawn(move || realtime::enter(core))
                .join()
                .unwrap_or_default()
        });
        self.report(judge::realtime(&lacks, settings.realtime));
    }
}

/// How long a frame takes in the whole pipeline, network included: pictures of a simulated touch.
fn frame_times_ms(settings: &Settings, network: Network, rest: &[Vec<u8>]) -> Result<Vec<f64>, Error> {
    let rule = TaxelRule::of(&settings_for(&network));
    let mut source = SimulatedSource::new(settings.seed, TOUCH_FRAMES_PER_SECOND);
    // The touch is simulated: a real camera's rest pictures do not belong to it.
    let own = source.rest(REST_PICTURES.into());
    let rest = if matches!(settings.source, Source::Simulated) {
        rest
    } else {
        &own
    };
    let mut pictures = Vec::new();
    while pictures.len() < TIMED + WARM_UP {
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
    Ok(times.split_off(WARM_UP.min(times.len())))
}
