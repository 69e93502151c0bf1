//! `gripline config`: one TOML file for what `gripline run` does, checked whole, and the microcontroller's own settings.
//!
//! [`Settings`] is what the rest of the program sees. A key is described once, in the table of `keys`: file, environment,
//! flag, default file and help all come from there.

mod effective;
mod keys;
mod mcu;
mod overrides;
mod show;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::SystemTime;

use clap::{Args, Subcommand};
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, InstructionSet};
use gripline_protocol::message::Configuration;
use toml::{Table, Value};

use self::effective::Effective;
pub(crate) use self::keys::likely;
use self::mcu::McuArgs;
pub use self::overrides::Overrides;
use crate::calibration::Calibration;
use crate::error::Failure;
use crate::live::fleet::FleetSettings;
use crate::source::{Source, SourceSettings};
use gripline_link::Target;
use gripline_recording::Pictures;

/// Arguments of `gripline config`.
#[derive(Debug, Clone, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    of: Of,
}

#[derive(Debug, Clone, Subcommand)]
enum Of {
    /// Print the values in force and where each comes from: default, file, environment or flag.
    Show(ShowArgs),
    /// Print a configuration file with every key explained and commented out.
    Default,
    /// The microcontroller's settings: print them as TOML, or set them from a file and keep them in its flash.
    Mcu(McuArgs),
}

#[derive(Debug, Clone, Args)]
struct ShowArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// Print JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

/// Does what the subcommand says.
///
/// # Errors
/// [`Failure`] when a file or a value is not what it should be, a link fails, or the microcontroller refuses.
pub fn run(args: &ConfigArgs) -> Result<(), Failure> {
    match &args.of {
        Of::Show(args) => {
            let effective = Effective::load(&args.overrides)?;
            // Values that are right one by one may still be wrong together.
            Settings::of(&effective)?;
            if args.json {
                println!("{}", show::shown_json(&effective));
            } else {
                print!("{}", show::shown(&effective));
            }
        }
        Of::Default => print!("{}", show::default_file()),
        Of::Mcu(args) => mcu::run(args)?,
    }
    Ok(())
}

/// What a run is to do, checked.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where pictures come from.
    pub source: Source,
    /// Where the second fingertip's pictures come from; `None`: there is only one.
    pub second_source: Option<Source>,
    /// What `gripline calibrate` found.
    pub(crate) calibration: Option<Calibration>,
    /// The same of the second fingertip.
    pub(crate) second_calibration: Option<Calibration>,
    /// What is asked of it.
    pub pictures_of: SourceSettings,
    /// Which network; `None`: what the weights are for.
    pub architecture: Option<Architecture>,
    /// Weights instead of the built-in ones.
    pub weights: Option<PathBuf>,
    /// Vector instructions; `None`: the widest there are.
    pub instructions: Option<InstructionSet>,
    /// Scene gate.
    pub gate: GateKind,
    /// Which microcontroller.
    pub mcu: Target,
    /// When to stop.
    pub seconds: Option<f64>,
    /// Whether to run as fast as the machine can.
    pub unpaced: bool,
    /// Where to record; `None`: not at all.
    pub record: Option<PathBuf>,
    /// What of the pictures is recorded.
    pub pictures: Pictures,
    /// Where to serve live values; `None`: nowhere.
    pub serve: Option<SocketAddr>,
    /// Under which name, and where, to publish over zenoh.
    pub(crate) fleet: Option<FleetSettings>,
    /// Whether to ask for real-time priority, locked memory and a core.
    pub realtime: bool,
    /// The core; `None`: the last one.
    pub realtime_core: Option<usize>,
    /// What the file says of the microcontroller's settings.
    microcontroller: Table,
}

impl Settings {
    /// Reads file, environment and flags.
    ///
    /// # Errors
    /// [`Failure`] of kind usage that lists everything that is wrong.
    pub fn load(flags: &Overrides) -> Result<Self, Failure> {
        Self::of(&Effective::load(flags)?)
    }

    fn of(effective: &Effective) -> Result<Self, Failure> {
        let text = |name| effective.value(name).and_then(Value::as_str);
        let calibration = |name| {
            let load = |path| Calibration::load(Path::new(path));
            text(name).map(load).transpose()
        };
        let switch = |name| effective.value(name).and_then(Value::as_bool).unwrap_or(false);
        let settings = Self {
            source: parsed("camera.source", text("camera.source"))?.unwrap_or_default(),
            second_source: parsed("camera.second_source", text("camera.second_source"))?,
            calibration: calibration("calibration.file")?,
            second_calibration: calibration("calibration.second_file")?,
            pictures_of: SourceSettings {
                format: parsed("camera.format", text("camera.format"))?,
                frames_per_second: effective.value("camera.frames_per_second").and_then(number),
                exposure_ms: effective.value("camera.exposure_ms").and_then(number),
                gain: effective.value("camera.gain").and_then(Value::as_integer),
                seed: effective
                    .value("simulation.seed")
                    .and_then(Value::as_integer)
                    .unwrap_or(1) as u64,
                fingertip: 0,
            },
            architecture: parsed("network.architecture", text("network.architecture"))?,
            weights: text("network.weights").map(PathBuf::from),
            instructions: parsed("network.instructions", text("network.instructions"))?,
            gate: parsed("network.gate", text("network.gate"))?.unwrap_or_default(),
            mcu: parsed("link.mcu", text("link.mcu"))?.unwrap_or_default(),
            seconds: effective.value("run.seconds").and_then(number),
            unpaced: switch("run.unpaced"),
            record: text("record.file").map(|name| with_time(name, SystemTime::now())),
            pictures: parsed("record.pictures", text("record.pictures"))?.unwrap_or_default(),
            serve: parsed("serve.listen", text("serve.listen"))?,
            fleet: text("zenoh.name").map(|name| FleetSettings {
                name: name.to_owned(),
                connect: text("zenoh.connect").map(str::to_owned),
                listen: text("zenoh.listen").map(str::to_owned),
            }),
            realtime: switch("realtime.enabled"),
            realtime_core: effective
                .value("realtime.core")
                .and_then(Value::as_integer)
                .map(|core| core as usize),
            microcontroller: effective.microcontroller(),
        };
        if settings.unpaced && matches!(settings.mcu, Target::Serial(_) | Target::Usb(_)) {
            return Err(Failure::usage(format!(
                "run.unpaced (--unpaced) with link.mcu {}, expected embedded or emulator: a real one keeps its own time",
                settings.mcu
            )));
        }
        if settings.unpaced && matches!(settings.source, Source::Camera(_)) {
            return Err(Failure::usage(format!(
                "run.unpaced (--unpaced) with camera.source {}, expected sim, dir:FOLDER, file:CLIP or mcap:FILE: a camera \
                 keeps its own time",
                settings.source
            )));
        }
        if settings.second_calibration.is_some() && settings.second_source.is_none() {
            return Err(Failure::usage(
                "calibration.second_file (--second-calibration) without camera.second_source, expected both: there is no second \
                 fingertip",
            ));
        }
        if settings.unpaced && settings.realtime {
            return Err(Failure::usage(
                "run.unpaced (--unpaced) with realtime.enabled (--realtime), expected one of them: a run that waits for \
                 nothing has no deadline and would take the core for itself",
            ));
        }
        Ok(settings)
    }

    /// What the file makes of the microcontroller's settings.
    ///
    /// # Errors
    /// [`Failure`] that names the setting which is out of its range.
    pub fn microcontroller(&self, now: &Configuration) -> Result<Configuration, Failure> {
        mcu::applied(&self.microcontroller, now)
            .map_err(|error| Failure::usage(format!("{}.{error}", keys::MICROCONTROLLER)))
    }
}

/// A file's name with the time in it, without colons, which some file systems refuse.
fn with_time(name: &str, now: SystemTime) -> PathBuf {
    let time = humantime::format_rfc3339_seconds(now)
        .to_string()
        .replace(':', "-");
    PathBuf::from(name.replace("{time}", &time))
}

/// The microcontroller's settings that a text of `gripline config mcu` says.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn settings_from_text(text: &str) -> Result<Configuration, String> {
    mcu::settings_of(text, &Configuration::DEFAULT)
}

/// The microcontroller's settings as `gripline config mcu` prints them.
pub(crate) fn settings_text(settings: &Configuration) -> String {
    mcu::text_of(settings)
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or(value.as_integer().map(|whole| whole as f64))
}

/// A text that the table of keys has already checked.
fn parsed<T: FromStr<Err: std::fmt::Display>>(name: &str, text: Option<&str>) -> Result<Option<T>, Failure> {
    let read = |text: &str| {
        text.parse()
            .map_err(|error| Failure::usage(format!("{name}: {error}")))
    };
    text.map(read).transpose()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_recordings_name_can_have_the_time_of_its_start() {
        // 2001-09-09T01:46:40Z is the first second with ten digits.
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        assert_eq!(
            with_time("a/{time}.mcap", then),
            PathBuf::from("a/2001-09-09T01-46-40Z.mcap")
        );
        assert_eq!(with_time("a.mcap", then), PathBuf::from("a.mcap"));
    }
}
