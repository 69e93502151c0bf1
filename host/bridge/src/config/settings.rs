//! Every key of the configuration: **a field of [`Settings`] is a key**. Its attribute holds the name in the file (`id`), the
//! flag (`long`), the default and the range; its doc comment is the help text and the comment in the default file. The
//! environment variable of `camera.source` is `GRIPLINE_CAMERA_SOURCE`. A key without a default ends its doc comment with
//! `Example:` and a TOML value.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, InstructionSet, Network};
use gripline_protocol::message::Configuration;
use toml::Table;

use super::device;
use crate::calibration::Calibration;
use crate::error::Error;
use crate::live::fleet::{FleetSettings, check_endpoint, check_name};
use crate::live::ros2::{Ros2Settings, check_domain};
use crate::marker_rest::RestSource;
use crate::source::{Source, SourceSettings};
use crate::value::{number_in, whole_in};
use gripline_capture::PixelFormat;
use gripline_link::Target;
use gripline_recording::Pictures;
use gripline_recording::ros2::{Namespace, Range, Rmw};

/// The section whose keys are those of `gripline config mcu`.
pub(super) const MICROCONTROLLER: &str = "microcontroller";

/// What a run does. Keys of one section stand together.
#[derive(Debug, Clone, Args)]
#[group(skip)]
#[expect(clippy::struct_excessive_bools, reason = "each of them is a key")]
pub struct Settings {
    /// Where pictures come from: the simulated fingertip and gripper (sim), a camera (/dev/video0, or better its name in
    /// /dev/v4l/by-id, which stays the same when cameras are plugged in another order), the pictures of a folder
    /// (dir:FOLDER, with rest.png in or beside it), of a clip (file:CLIP, any format that ffmpeg reads, with rest.png beside it) or of a
    /// recording (mcap:FILE).
    #[arg(
        id = "camera.source",
        long = "source",
        visible_alias = "camera",
        value_name = "SOURCE",
        default_value = "sim"
    )]
    pub source: Source,

    /// Where the pictures of a second fingertip come from, of the same kind as those of the first. The microcontroller then
    /// waits for maps of both and acts on the worse one. By default there is one fingertip. Example: "/dev/video2"
    #[arg(id = "camera.second_source", long = "second-source", value_name = "SOURCE")]
    pub second_source: Option<Source>,

    /// Pixel format of the camera, 640×480. By default the one that reaches the wanted rate with the least decoding time. Example:
    /// "mjpeg"
    #[arg(id = "camera.format", long = "camera-format", value_name = "mjpeg|yuyv|grey")]
    pub format: Option<PixelFormat>,

    /// Pictures per second. By default 60, or the recording's rate. A camera uses the nearest rate that it supports. Example: 120.0
    #[arg(id = "camera.frames_per_second", long = "frames-per-second", value_name = "RATE", value_parser = number_in(1.0..=1_000.0))]
    pub frames_per_second: Option<f64>,

    /// Fixed exposure time of the camera. By default the camera's own; automatic exposure changes the brightness when
    /// something touches. Example: 4.0
    #[arg(id = "camera.exposure_ms", long = "exposure-ms", value_name = "MS", value_parser = number_in(0.1..=1_000.0))]
    pub exposure_ms: Option<f64>,

    /// Fixed gain of the camera, in its own units. By default the camera's own. Example: 32
    #[arg(id = "camera.gain", long = "gain", value_name = "GAIN", value_parser = whole_in(0..=65_535_i64))]
    pub gain: Option<i64>,

    /// The file that `gripline calibrate` wrote. Its rest pictures replace those taken at the start, its friction that of the
    /// weights, its geometry the microcontroller's; its line table is compared with the microcontroller's. Without it the rest
    /// pictures are taken at the start, while nothing may touch the sensor surface. Example: "calibration.toml"
    #[arg(id = "calibration.file", long = "calibration", value_name = "FILE.toml")]
    pub calibration_file: Option<PathBuf>,

    /// The same for the second fingertip. The lower one of two friction coefficients is used. Example: "second.toml"
    #[arg(
        id = "calibration.second_file",
        long = "second-calibration",
        value_name = "FILE.toml"
    )]
    pub second_calibration_file: Option<PathBuf>,

    /// The fingertip: the name of a shipped description (particle-fingertip, gelsight-mini) or your own file (docs/own-sensor.md).
    #[arg(
        id = "sensor.file",
        long = "sensor",
        value_name = "NAME|FILE.toml",
        default_value = "particle-fingertip"
    )]
    pub sensor: PathBuf,

    /// Printed markers at rest: frames of the clip or folder (12..20), a picture, or a folder of pictures. By default the rest.png
    /// beside the pictures, or without one the regular grid of the markers, which makes the evidence of slip less accurate.
    /// Example: "12..20"
    #[arg(id = "sensor.rest", long = "rest", value_name = "FROM..TO|PATH")]
    pub rest: Option<RestSource>,

    /// Force network: tracked follows particles at full resolution, unet uses small images. By default that of the weights file;
    /// with the built-in weights tracked. Example: "unet"
    #[arg(id = "network.architecture", long = "network", value_name = "NETWORK")]
    pub architecture: Option<Architecture>,

    /// Weights of the force network (safetensors) instead of the built-in ones. Example: "weights.safetensors"
    #[arg(id = "network.weights", long = "weights", value_name = "FILE")]
    pub weights: Option<PathBuf>,

    /// Vector instructions that the force network uses: portable, avx2, avx512 or neon. By default the widest that the processor
    /// has. Example: "avx2"
    #[arg(id = "network.instructions", long = "instructions", value_name = "SET")]
    pub instructions: Option<InstructionSet>,

    /// Threads that share a picture in tracked, the loop's among them; no more than there are cores. The forces do not depend on it.
    #[arg(
        id = "network.threads",
        long = "threads",
        value_name = "THREADS",
        default_value = "2",
        value_parser = whole_in(1..=64_usize)
    )]
    pub threads: usize,

    /// Scene gate: network (small, int8) and difference (thresholds) skip the force network when nothing touches or changes; off
    /// never skips it.
    #[arg(
        id = "network.gate",
        long = "gate",
        value_name = "network|difference|off",
        default_value = "network"
    )]
    pub gate: GateKind,

    /// Which microcontroller: embedded (the firmware's library in this process), emulator, emulator:uart, usb, usb:SERIAL or
    /// serial:PORT.
    #[arg(id = "link.mcu", long = "mcu", value_name = "MCU", default_value = "embedded")]
    pub mcu: Target,

    /// Close the gripper and hold from the start. By default nothing moves until a request comes by key, HTTP, or another way of
    /// docs/control.md. The simulated scene and recordings follow their script, unless a real gripper could move.
    #[arg(id = "run.hold", long = "hold")]
    pub hold: bool,

    /// Stop after this many seconds. By default never on a terminal, and after one round of the scene (12 s) elsewhere.
    /// Example: 60.0
    #[arg(id = "run.seconds", long = "seconds", value_name = "S", value_parser = number_in(0.1..=LONGEST_RUN_S))]
    pub seconds: Option<f64>,

    /// Do not wait for the wall clock: run as fast as the machine can, with the embedded or the emulated microcontroller.
    #[arg(id = "run.unpaced", long = "unpaced")]
    pub unpaced: bool,

    /// Record the run to this file, which must not exist yet (MCAP, for Foxglove, gripline replay and export). {time} in its
    /// name becomes the time of the start, 2026-11-21T10-40-00Z. Example: "run-{time}.mcap"
    #[arg(id = "record.file", long = "record", value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,

    /// Which pictures are recorded: full (440×440, 12 MB a second), small (88×88, all that unet needs, 0.5 MB a second) or off
    /// (replay then starts from the maps).
    #[arg(
        id = "record.pictures",
        long = "record-pictures",
        value_name = "full|small|off",
        default_value = "full"
    )]
    pub pictures: Pictures,

    /// Serve a live page over HTTP at this address, /status and /control for programs (docs/control.md), /metrics for Prometheus
    /// and /frames as newline JSON. By default nothing is served. Example: "127.0.0.1:9617"
    #[arg(id = "serve.listen", long = "serve", value_name = "ADDRESS:PORT", value_parser = address)]
    pub serve: Option<SocketAddr>,

    /// The file with the token that HTTP requests must contain. By default gripline/token in the state folder; it is created when
    /// it does not exist. Example: "/etc/gripline/token"
    #[arg(id = "serve.token_file", long = "token-file", value_name = "FILE")]
    pub token_file: Option<PathBuf>,

    /// Publish every frame over zenoh under gripline/NAME, so that many grippers report to one place (docs/zenoh.md; needs a build
    /// with --features zenoh). By default nothing is published. Example: "cell-3/left"
    #[arg(id = "zenoh.name", long = "zenoh-name", value_name = "NAME", value_parser = |text: &str| check_name(text).map(|()| text.to_owned()))]
    pub zenoh_name: Option<String>,

    /// Where a zenoh router or another peer listens. Without this and zenoh.listen, peers are found by multicast.
    /// Example: "tcp/192.0.2.1:7447"
    #[arg(id = "zenoh.connect", long = "zenoh-connect", value_name = "ENDPOINT", value_parser = endpoint)]
    pub zenoh_connect: Option<String>,

    /// Where this run listens for zenoh peers. Example: "tcp/0.0.0.0:7447"
    #[arg(id = "zenoh.listen", long = "zenoh-listen", value_name = "ENDPOINT", value_parser = endpoint)]
    pub zenoh_listen: Option<String>,

    /// Publish every frame in ROS 2 under /NAME: forces, map, slip, diagnostics (docs/ros2.md; needs a gripline built with
    /// --features ros2). By default nothing is published. Example: "cell_3/left"
    #[arg(id = "ros2.name", long = "ros2-name", value_name = "NAME")]
    pub ros2_name: Option<Namespace>,

    /// DDS domain, 0 to 232. By default the environment variable ROS_DOMAIN_ID, else 0. Example: 7
    #[arg(id = "ros2.domain", long = "ros2-domain", value_name = "DOMAIN", value_parser = check_domain)]
    pub ros2_domain: Option<u16>,

    /// Range of ROS 2: localhost sends nothing to other machines, subnet finds them by multicast.
    #[arg(
        id = "ros2.range",
        long = "ros2-range",
        value_name = "localhost|subnet",
        default_value = "localhost"
    )]
    pub ros2_range: Range,

    /// How services are mapped to DDS, in which ROS 2 implementations differ: fastrtps or cyclonedds. By default the environment
    /// variable RMW_IMPLEMENTATION, else fastrtps. Example: "cyclonedds"
    #[arg(id = "ros2.rmw", long = "ros2-rmw", value_name = "fastrtps|cyclonedds")]
    pub ros2_rmw: Option<Rmw>,

    /// Offer the services that move the gripper: hold, release, and the others. DDS has no passwords: every program in the domain
    /// may call them.
    #[arg(id = "ros2.control", long = "ros2-control")]
    pub ros2_control: bool,

    /// Serve the content of a recording live to the Foxglove app at this address (docs/foxglove.md; needs a gripline built with
    /// --features foxglove). The pictures are chosen by record.pictures. By default nothing is served. Example: "127.0.0.1:8765"
    #[arg(id = "foxglove.listen", long = "foxglove", value_name = "ADDRESS:PORT", value_parser = address)]
    pub foxglove: Option<SocketAddr>,

    /// Run the loop with real-time priority (`SCHED_FIFO`), in memory that is never swapped, on one core. What the system
    /// does not allow is reported, and the run goes on without it.
    #[arg(id = "realtime.enabled", long = "realtime")]
    pub realtime: bool,

    /// The core that the loop runs on, from 0. By default the last one. Example: 3
    #[arg(id = "realtime.core", long = "realtime-core", value_name = "CORE", value_parser = whole_in(0..=1_023_usize))]
    pub realtime_core: Option<usize>,

    /// Seed of the simulated world.
    #[arg(id = "simulation.seed", long = "seed", value_name = "SEED", default_value = "1", value_parser = whole_in(0..=SEED_MAX))]
    pub seed: u64,

    /// The contents of [`Self::calibration_file`].
    #[arg(skip)]
    pub(crate) calibration: Option<Calibration>,

    /// The contents of [`Self::second_calibration_file`].
    #[arg(skip)]
    pub(crate) second_calibration: Option<Calibration>,

    /// The section `[microcontroller]`.
    #[arg(skip)]
    pub(super) microcontroller: Table,
}

/// The longest run that can be requested, seconds: 30 years.
const LONGEST_RUN_S: f64 = 1e9;
/// TOML's whole numbers end here.
const SEED_MAX: u64 = i64::MAX as u64;

/// The standard library's error does not contain the text found.
fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse()
        .map_err(|_| format!("found {text}, expected an address and a port such as 127.0.0.1:9617"))
}

fn endpoint(text: &str) -> Result<String, String> {
    check_endpoint(text).map(|()| text.to_owned())
}

impl Settings {
    /// Reads the calibrations and checks for settings that contradict each other.
    ///
    /// # Errors
    /// [`Error`] of kind usage that names the keys, or what is wrong with a calibration.
    pub(super) fn complete(mut self, microcontroller: Table) -> Result<Self, Error> {
        self.microcontroller = microcontroller;
        let load = |file: &Option<PathBuf>| file.as_deref().map(Calibration::load).transpose();
        self.calibration = load(&self.calibration_file)?;
        self.second_calibration = load(&self.second_calibration_file)?;
        self.record = self.record.map(|file| with_time(&file, SystemTime::now()));
        let conflict = if self.unpaced && matches!(self.mcu, Target::Serial(_) | Target::Usb(_)) {
            format!(
                "run.unpaced (--unpaced) with link.mcu {}, expected embedded or emulator: a real one keeps its own time",
                self.mcu
            )
        } else if self.unpaced && matches!(self.source, Source::Camera(_)) {
            format!(
                "run.unpaced (--unpaced) with camera.source {}, expected sim, dir:FOLDER, file:CLIP or mcap:FILE: a camera \
                 keeps its own time",
                self.source
            )
        } else if self.unpaced && self.realtime {
            "run.unpaced (--unpaced) with realtime.enabled (--realtime), expected one of them: a run that waits for nothing \
             has no deadline and would take the core for itself"
                .to_owned()
        } else if self.second_calibration.is_some() && self.second_source.is_none() {
            "calibration.second_file (--second-calibration) without camera.second_source, expected both: there is no second \
             fingertip"
                .to_owned()
        } else {
            return Ok(self);
        };
        Err(Error::usage(conflict))
    }

    /// The force network, with the configured weights and instructions.
    ///
    /// # Errors
    /// [`Error`] when the weights cannot be read, or the processor lacks the instructions.
    pub fn network(&self) -> Result<Network, Error> {
        let network = match &self.weights {
            Some(path) => Network::from_file(path, self.architecture)?,
            None => Network::embedded(self.architecture.unwrap_or_default())?,
        };
        match self.instructions {
            Some(set) => Ok(network.with_instructions(set)?),
            None => Ok(network),
        }
    }

    /// The settings of the source of fingertip 0 or 1.
    #[must_use]
    pub fn source_settings(&self, fingertip: usize) -> SourceSettings {
        SourceSettings {
            format: self.format,
            frames_per_second: self.frames_per_second,
            exposure_ms: self.exposure_ms,
            gain: self.gain,
            seed: self.seed,
            fingertip,
            colour: None,
            realtime: self.realtime,
        }
    }

    /// What to publish over zenoh; `None`: nothing.
    pub(crate) fn fleet(&self) -> Option<FleetSettings> {
        self.zenoh_name.clone().map(|name| FleetSettings {
            name,
            connect: self.zenoh_connect.clone(),
            listen: self.zenoh_listen.clone(),
        })
    }

    /// What to offer in ROS 2; `None`: nothing.
    pub(crate) fn ros2(&self) -> Option<Ros2Settings> {
        self.ros2_name.clone().map(|namespace| Ros2Settings {
            namespace,
            domain: self.ros2_domain,
            range: self.ros2_range,
            rmw: self.ros2_rmw,
            control: self.ros2_control,
        })
    }

    /// The microcontroller's settings `now`, changed by the configuration.
    ///
    /// # Errors
    /// [`Error`] that names the setting that is out of range.
    pub fn microcontroller(&self, now: &Configuration) -> Result<Configuration, Error> {
        device::applied(&self.microcontroller, now)
            .map_err(|error| Error::usage(format!("{MICROCONTROLLER}.{error}")))
    }
}

/// A file name with the time in it, without colons, which some file systems refuse.
fn with_time(file: &Path, now: SystemTime) -> PathBuf {
    let time = humantime::format_rfc3339_seconds(now)
        .to_string()
        .replace(':', "-");
    file.to_str()
        .map_or_else(|| file.to_owned(), |name| name.replace("{time}", &time).into())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_recording_can_be_named_after_the_time_of_its_start() {
        // 2001-09-09T01:46:40Z is the first second with ten digits.
        let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        for (file, expected) in [
            ("a/{time}.mcap", "a/2001-09-09T01-46-40Z.mcap"),
            ("a.mcap", "a.mcap"),
        ] {
            assert_eq!(with_time(Path::new(file), then), Path::new(expected));
        }
    }
}
