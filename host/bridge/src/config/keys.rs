//! Every key of the configuration file, once: name, what it may be, default, flag, and the sentence that explains it.
//! The documented default file, the flags of `gripline run`, the environment's names and every check come from here.

use std::fmt;
use std::net::SocketAddr;
use std::str::FromStr;

use gripline_network::scene::GateKind;
use gripline_network::{Architecture, InstructionSet};
use toml::Value;

use crate::live::fleet::{check_endpoint, check_name};
use crate::source::Source;
use gripline_capture::PixelFormat;
use gripline_link::Target;
use gripline_recording::Pictures;

/// The longest run that can be asked for, seconds: 30 years.
const LONGEST_S: f64 = 1e9;

/// What a key may hold.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Kind {
    /// A text that this function reads; its error says what was found and expected.
    Text(fn(&str) -> Result<(), String>),
    /// The path of a file.
    Path,
    /// A number in this range, ends included.
    Number(f64, f64),
    /// A whole number from 0 to this.
    Whole(u64),
    /// true or false; as a flag it has no value.
    Switch,
}

/// A key of the file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Key {
    /// Its section and name, joined by a point.
    pub name: &'static str,
    /// Flag of `gripline run`, without the dashes.
    pub flag: &'static str,
    /// Stands for the value in help.
    pub value_name: &'static str,
    /// What it may hold.
    pub kind: Kind,
    /// The value, as TOML, when nobody says anything; `None`: it is then not set.
    pub default: Option<&'static str>,
    /// A value that could stand in the file, as TOML, for keys without a default.
    pub example: &'static str,
    /// What it is, in sentences.
    pub help: &'static str,
}

/// Every key, in the file's order. Keys of one section stand together.
pub(crate) const KEYS: [Key; 24] = [
    Key {
        name: "camera.source",
        flag: "source",
        value_name: "SOURCE",
        kind: Kind::Text(reads::<Source>),
        default: Some("\"sim\""),
        example: "",
        help: "Where pictures come from: the simulated fingertip and gripper (sim), a camera (/dev/video0, or better its \
               name in /dev/v4l/by-id, which stays when cameras are plugged in another order), the pictures of a folder \
               (dir:FOLDER, with rest.png in or beside it), of a clip (file:CLIP, any format that ffmpeg reads, with rest.png beside it) or of a \
               recording (mcap:FILE).",
    },
    Key {
        name: "camera.second_source",
        flag: "second-source",
        value_name: "SOURCE",
        kind: Kind::Text(reads::<Source>),
        default: None,
        example: "\"/dev/video2\"",
        help: "Where the pictures of a second fingertip come from, of the same kind as those of the first. The microcontroller \
               then waits for maps of both and goes by the worse one. By default there is one fingertip.",
    },
    Key {
        name: "camera.format",
        flag: "camera-format",
        value_name: "mjpeg|yuyv|grey",
        kind: Kind::Text(reads::<PixelFormat>),
        default: None,
        example: "\"mjpeg\"",
        help: "Pixels of the camera, 640×480. By default what reaches the wanted rate, and of these what needs the least \
               decoding.",
    },
    Key {
        name: "camera.frames_per_second",
        flag: "frames-per-second",
        value_name: "RATE",
        kind: Kind::Number(1.0, 1_000.0),
        default: None,
        example: "120.0",
        help: "Pictures a second. By default 60, or those of the recording. A camera takes the nearest that it has.",
    },
    Key {
        name: "camera.exposure_ms",
        flag: "exposure-ms",
        value_name: "MS",
        kind: Kind::Number(0.1, 1_000.0),
        default: None,
        example: "4.0",
        help: "Exposure time of the camera, fixed. By default as the camera has it; one that chooses by itself changes the \
               brightness when something touches.",
    },
    Key {
        name: "camera.gain",
        flag: "gain",
        value_name: "GAIN",
        kind: Kind::Whole(65_535),
        default: None,
        example: "32",
        help: "Gain of the camera in its own units, fixed. By default as the camera has it.",
    },
    Key {
        name: "calibration.file",
        flag: "calibration",
        value_name: "FILE.toml",
        kind: Kind::Path,
        default: None,
        example: "\"calibration.toml\"",
        help: "What `gripline calibrate` wrote: its rest pictures stand for the untouched skin, its friction for that of the \
               weights, its geometry for how the microcontroller has the fingertip; its table of the line is compared with the microcontroller's. By default the rest pictures are \
               taken at the start, and nothing may touch the skin then.",
    },
    Key {
        name: "calibration.second_file",
        flag: "second-calibration",
        value_name: "FILE.toml",
        kind: Kind::Path,
        default: None,
        example: "\"second.toml\"",
        help: "The same of the second fingertip. Of two frictions the lower one counts.",
    },
    Key {
        name: "network.architecture",
        flag: "network",
        value_name: "NETWORK",
        kind: Kind::Text(reads::<Architecture>),
        default: None,
        example: "\"unet\"",
        help: "Force network: tracked follows particles at full resolution, unet looks at small images. By default what \
               the weights are for, and tracked with the built-in ones.",
    },
    Key {
        name: "network.weights",
        flag: "weights",
        value_name: "FILE",
        kind: Kind::Path,
        default: None,
        example: "\"weights.safetensors\"",
        help: "Weights of the force network instead of the built-in ones (safetensors).",
    },
    Key {
        name: "network.instructions",
        flag: "instructions",
        value_name: "SET",
        kind: Kind::Text(reads::<InstructionSet>),
        default: None,
        example: "\"avx2\"",
        help: "Vector instructions that the force network uses: portable, avx2 or avx512. By default the widest there are.",
    },
    Key {
        name: "network.gate",
        flag: "gate",
        value_name: "network|difference|off",
        kind: Kind::Text(reads::<GateKind>),
        default: Some("\"network\""),
        example: "",
        help: "Scene gate: network (small, int8) and difference (thresholds) skip the force network where nothing touches \
               or changes, off never does.",
    },
    Key {
        name: "link.mcu",
        flag: "mcu",
        value_name: "MCU",
        kind: Kind::Text(reads::<Target>),
        default: Some("\"embedded\""),
        example: "",
        help: "Which microcontroller: embedded (the firmware's library in this process), emulator, emulator:uart, usb, \
               usb:SERIAL or serial:PORT.",
    },
    Key {
        name: "run.seconds",
        flag: "seconds",
        value_name: "S",
        kind: Kind::Number(0.1, LONGEST_S),
        default: None,
        example: "60.0",
        help: "Stop after so many seconds. By default never on a terminal, after one round of the scene (12 s) elsewhere.",
    },
    Key {
        name: "run.unpaced",
        flag: "unpaced",
        value_name: "",
        kind: Kind::Switch,
        default: Some("false"),
        example: "",
        help: "Do not wait for the wall clock: as fast as the machine can, with the embedded or the emulated \
               microcontroller.",
    },
    Key {
        name: "record.file",
        flag: "record",
        value_name: "FILE.mcap",
        kind: Kind::Path,
        default: None,
        example: "\"run-{time}.mcap\"",
        help: "Record the run to this file, which must not be there yet; {time} in its name becomes the time of the start, \
               2026-11-21T10-40-00Z (MCAP, for Foxglove, gripline replay and export).",
    },
    Key {
        name: "record.pictures",
        flag: "record-pictures",
        value_name: "full|small|off",
        kind: Kind::Text(reads::<Pictures>),
        default: Some("\"full\""),
        example: "",
        help: "What of the pictures is recorded: full (440×440, 12 MB a second), small (88×88, all that unet looks at, \
               0.5 MB a second) or off (replay then starts from the maps).",
    },
    Key {
        name: "serve.listen",
        flag: "serve",
        value_name: "ADDRESS:PORT",
        kind: Kind::Text(reads_address),
        default: None,
        example: "\"127.0.0.1:9617\"",
        help: "Serve live values over HTTP at this address: /metrics for Prometheus, /frames as newline JSON. By default \
               nothing is served.",
    },
    Key {
        name: "zenoh.name",
        flag: "zenoh-name",
        value_name: "NAME",
        kind: Kind::Text(check_name),
        default: None,
        example: "\"cell-3/left\"",
        help: "Publish every frame over zenoh under gripline/NAME, so that many grippers report to one place \
               (docs/zenoh.md; needs a gripline that was built with --features zenoh). By default nothing is published.",
    },
    Key {
        name: "zenoh.connect",
        flag: "zenoh-connect",
        value_name: "ENDPOINT",
        kind: Kind::Text(check_endpoint),
        default: None,
        example: "\"tcp/192.0.2.1:7447\"",
        help: "Where a zenoh router or another peer listens. Without this and zenoh.listen, others are found by multicast.",
    },
    Key {
        name: "zenoh.listen",
        flag: "zenoh-listen",
        value_name: "ENDPOINT",
        kind: Kind::Text(check_endpoint),
        default: None,
        example: "\"tcp/0.0.0.0:7447\"",
        help: "Where this run listens for zenoh peers.",
    },
    Key {
        name: "realtime.enabled",
        flag: "realtime",
        value_name: "",
        kind: Kind::Switch,
        default: Some("false"),
        example: "",
        help: "Run the loop with real-time priority (SCHED_FIFO), in memory that is never swapped, on one core. What the \
               system does not allow is told, and the run goes on without it.",
    },
    Key {
        name: "realtime.core",
        flag: "realtime-core",
        value_name: "CORE",
        kind: Kind::Whole(1_023),
        default: None,
        example: "3",
        help: "The core that the loop stays on, from 0. By default the last one.",
    },
    Key {
        name: "simulation.seed",
        flag: "seed",
        value_name: "SEED",
        kind: Kind::Whole(i64::MAX as u64),
        default: Some("1"),
        example: "",
        help: "Seed of the simulated world.",
    },
];

/// The section whose keys are those of `gripline config mcu`.
pub(crate) const MICROCONTROLLER: &str = "microcontroller";

/// A check out of a type that can be read from a text.
fn reads<T>(text: &str) -> Result<(), String>
where
    T: FromStr,
    T::Err: fmt::Display,
{
    text.parse::<T>().map(drop).map_err(|error| error.to_string())
}

/// An address to listen at; the standard library's error does not say what was found.
fn reads_address(text: &str) -> Result<(), String> {
    let read: Result<SocketAddr, _> = text.parse();
    read.map(drop)
        .map_err(|_| format!("found {text}, expected an address and a port such as 127.0.0.1:9617"))
}

impl Key {
    /// The key of this name.
    pub(crate) fn named(name: &str) -> Option<&'static Self> {
        KEYS.iter().find(|key| key.name == name)
    }

    /// The section it stands in.
    pub(crate) fn section(&self) -> &'static str {
        self.name.split_once('.').map_or("", |(section, _)| section)
    }

    /// Its name within the section.
    pub(crate) fn own_name(&self) -> &'static str {
        self.name.split_once('.').map_or("", |(_, name)| name)
    }

    /// The environment variable that sets it.
    pub(crate) fn variable(&self) -> String {
        variable(self.section(), self.own_name())
    }

    /// Whether `value` may stand here.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub(crate) fn check(&self, value: &Value) -> Result<(), String> {
        let expected = |what: &str| Err(format!("found {value}, expected {what}"));
        match (self.kind, value) {
            (Kind::Text(reads), Value::String(text)) => reads(text),
            (Kind::Path, Value::String(text)) if !text.is_empty() => Ok(()),
            (Kind::Switch, Value::Boolean(_)) => Ok(()),
            (Kind::Whole(most), Value::Integer(found)) if (0..=most as i64).contains(found) => Ok(()),
            (Kind::Number(least, most), Value::Integer(found))
                if (least..=most).contains(&(*found as f64)) =>
            {
                Ok(())
            }
            (Kind::Number(least, most), Value::Float(found)) if (least..=most).contains(found) => Ok(()),
            (Kind::Text(_), _) => expected("a text in quotes"),
            (Kind::Path, _) => expected("the path of a file"),
            (Kind::Switch, _) => expected("true or false"),
            (Kind::Whole(most), _) => expected(&format!("a whole number from 0 to {most}")),
            (Kind::Number(least, most), _) => expected(&format!("a number from {least} to {most}")),
        }
    }

    /// The value that a flag or the environment gives, which have texts only.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub(crate) fn value_of(&self, text: &str) -> Result<Value, String> {
        let value = match self.kind {
            Kind::Text(_) | Kind::Path => Some(Value::String(text.to_owned())),
            Kind::Number(..) => text.parse().ok().map(Value::Float),
            Kind::Whole(_) => text.parse().ok().map(Value::Integer),
            Kind::Switch => text.parse().ok().map(Value::Boolean),
        };
        let value = value.unwrap_or_else(|| Value::String(text.to_owned()));
        // As it was written, not as it was read.
        self.check(&value)
            .map_err(|error| error.replacen(&value.to_string(), text, 1))?;
        Ok(value)
    }
}

/// The environment variable of a key.
pub(crate) fn variable(section: &str, name: &str) -> String {
    format!("GRIPLINE_{section}_{name}").to_uppercase()
}

/// The one of `names` that `found` was likely meant to be.
pub(crate) fn likely<'a>(found: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// A letter wrong, missing or swapped in a name of ordinary length.
    const ALIKE: f64 = 0.7;
    names
        .into_iter()
        .map(|name| (strsim::normalized_damerau_levenshtein(found, name), name))
        .filter(|(alike, _)| *alike >= ALIKE)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_one_section_stand_together_and_no_name_or_flag_twice() {
        let mut sections: Vec<_> = KEYS.iter().map(Key::section).collect();
        sections.dedup();
        for lists in [
            sections,
            KEYS.iter().map(|key| key.name).collect(),
            KEYS.iter().map(|key| key.flag).collect(),
        ] {
            let mut once = lists.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(once.len(), lists.len(), "{lists:?}");
        }
    }

    #[test]
    fn every_default_and_every_example_may_stand_where_it_stands() {
        for key in &KEYS {
            let text = key.default.unwrap_or(key.example);
            let table: toml::Table = format!("value = {text}").parse().unwrap();
            assert_eq!(key.check(&table["value"]), Ok(()), "{}", key.name);
        }
    }

    #[test]
    fn what_was_likely_meant_is_found_and_what_is_far_off_is_not() {
        let names = || KEYS.iter().map(|key| key.name);
        assert_eq!(likely("camera.sorce", names()), Some("camera.source"));
        assert_eq!(likely("network.wieghts", names()), Some("network.weights"));
        assert_eq!(likely("sead", ["seed", "gate"]), Some("seed"));
        assert_eq!(likely("camera.brightness", names()), None);
    }
}
