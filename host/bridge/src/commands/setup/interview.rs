//! The questions of `gripline setup` in order: sensor, camera, board, rest pictures. Pure: the attached hardware and the answering
//! person are passed in as values and functions, so that tests can replace both.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gripline_link::Target;
use gripline_sensor::{MarkerKind, SHIPPED, Sensor};

use super::question::{Answer, Choice, Question};
use crate::error::Error;
use crate::source::Source;

/// What is attached to this machine.
#[derive(Debug, Clone, Default)]
pub(super) struct Hardware {
    pub cameras: Vec<Choice>,
    /// Microcontrollers of ours on USB.
    pub boards: Vec<Choice>,
    /// Serial ports, whatever is connected to them.
    pub ports: Vec<Choice>,
    /// Why USB cannot be listed.
    pub no_usb: Option<String>,
}

/// What to do about rest pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Rest {
    /// Take them now.
    Now,
    /// Each run takes its own.
    Later,
    /// They are in this calibration.
    In(PathBuf),
}

impl FromStr for Rest {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "now" => Ok(Self::Now),
            "later" => Ok(Self::Later),
            file if Path::new(file).extension().is_some_and(|end| end == "toml") => Ok(Self::In(file.into())),
            other => Err(format!("found {other}, expected now, later or FILE.toml")),
        }
    }
}

/// Answers given by flags.
#[derive(Debug, Clone, Default)]
pub(super) struct Said {
    pub sensor: Option<PathBuf>,
    pub camera: Option<Source>,
    pub mcu: Option<Target>,
    pub rest: Option<Rest>,
    /// Missing answers get their default.
    pub yes: bool,
}

/// All answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Chosen {
    /// The sensor's identity.
    pub sensor: String,
    pub camera: Source,
    pub mcu: Target,
    pub rest: Rest,
}

/// The person who answers.
pub(super) trait Person {
    /// Shows a screen and waits for a line.
    ///
    /// # Errors
    /// [`Error`] when there is no more input.
    fn ask(&mut self, screen: &str) -> Result<String, Error>;
    /// Prints a line.
    fn tell(&mut self, line: &str);
}

/// Asks for missing answers. `detect`: the attached hardware now; `person`: `None` without a terminal.
///
/// # Errors
/// [`Error`] that says what was found, what was expected and what to do.
pub(super) fn interview<'a>(
    said: &Said,
    detect: &'a mut dyn FnMut() -> Hardware,
    person: Option<&'a mut dyn Person>,
) -> Result<Chosen, Error> {
    let mut asking = Asking {
        takes_defaults: said.yes,
        detect,
        person,
    };
    let text = |value: &dyn fmt::Display| value.to_string();
    let sensor = asking.one(
        said.sensor.as_ref().map(|sensor| text(&sensor.display())),
        &|_| sensor_question(),
        &sensor,
    )?;
    let camera = asking.one(
        said.camera.as_ref().map(|camera| text(camera)),
        &camera_question,
        &str::parse,
    )?;
    let mcu = asking.one(
        said.mcu.as_ref().map(|mcu| text(mcu)),
        &|hardware| board_question(hardware, &camera),
        &|text| board(text, &camera),
    )?;
    let rest = match &said.rest {
        Some(rest) => rest.clone(),
        None => asking.one(None, &|_| rest_question(&camera), &str::parse)?,
    };
    Ok(Chosen {
        sensor,
        camera,
        mcu,
        rest,
    })
}

struct Asking<'a> {
    takes_defaults: bool,
    detect: &'a mut dyn FnMut() -> Hardware,
    person: Option<&'a mut dyn Person>,
}

impl Asking<'_> {
    /// One answer that passes `check`: the flag's, else the person's, else the default.
    fn one<T>(
        &mut self,
        said: Option<String>,
        question: &dyn Fn(&Hardware) -> Question,
        check: &dyn Fn(&str) -> Result<T, String>,
    ) -> Result<T, Error> {
        let question_now = |detect: &mut dyn FnMut() -> Hardware| question(&detect());
        if let Some(said) = said {
            let flag = question(&Hardware::default()).flag;
            return check(&said).map_err(|error| Error::usage(format!("{flag}: {error}")));
        }
        let Some(person) = &mut self.person else {
            let question = question_now(self.detect);
            let taken = question.unasked(self.takes_defaults).map_err(Error::usage)?;
            return check(&taken).map_err(|error| Error::usage(format!("{}: {error}", question.flag)));
        };
        loop {
            let question = question_now(self.detect);
            let typed = person.ask(&question.screen())?;
            let checked = match question.answer(&typed) {
                Ok(Answer::LookAgain) => continue,
                Ok(Answer::Value(value)) => check(&value),
                Err(error) => Err(error),
            };
            match checked {
                Ok(value) => return Ok(value),
                Err(error) => person.tell(&format!("   {error}")),
            }
        }
    }
}

fn sensor_question() -> Question {
    let what = ["particles in the gel", "printed markers: no forces yet"];
    Question {
        number: 1,
        flag: "--sensor",
        text: "Which fingertip?",
        choices: SHIPPED
            .iter()
            .zip(what)
            .map(|((name, _), what)| Choice::new(*name, what))
            .collect(),
        other: ", the FILE.toml of a description",
        default: Ok(0),
    }
}

/// The identity of a sensor whose forces can drive a line.
fn sensor(name: &str) -> Result<String, String> {
    let named = |name: &str| Sensor::named(Path::new(name)).map_err(|error| error.to_string());
    let sensor = named(name)?;
    let (known, _) = SHIPPED[0];
    let identity = sensor.identity();
    if sensor.markers.kind == MarkerKind::Plane {
        return Err(format!(
            "found {identity}, whose forces are not trained yet, expected {known}: no line can be driven by it; its clips play \
             with `gripline run --sensor {name} --source file:CLIP`"
        ));
    }
    if sensor != named(known)? {
        return Err(format!(
            "found {identity}, expected {known}: the shipped weights know no other particles"
        ));
    }
    Ok(identity)
}

fn camera_question(hardware: &Hardware) -> Question {
    let mut choices = hardware.cameras.clone();
    choices.push(Choice::new("sim", "no camera: a simulated fingertip"));
    let default = match hardware.cameras.len() {
        1 => Ok(0),
        0 => Err("Found no camera, expected one: plug it in (`ls /dev/video*` shows it).".to_owned()),
        count => Err(format!("Found {count} cameras, expected one: choose.")),
    };
    Question {
        number: 2,
        flag: "--camera",
        text: "Which camera looks at the fingertip?",
        choices,
        other: ", another source (dir:FOLDER, mcap:FILE)",
        default,
    }
}

fn board_question(hardware: &Hardware, camera: &Source) -> Question {
    let embedded = Choice::new("embedded", "no board: nothing moves");
    let (choices, default) = if matches!(camera, Source::Camera(_)) {
        let default = match hardware.boards.len() {
            1 => Ok(0),
            0 => Err(format!(
                "Found no microcontroller on USB{}, expected one (1209:0001 in `lsusb`): plug it in and flash it \
                 (`cargo xtask flash`).",
                hardware
                    .no_usb
                    .as_ref()
                    .map_or(String::new(), |why| format!(" ({why})"))
            )),
            count => Err(format!("Found {count} microcontrollers, expected one: choose.")),
        };
        let all = [&hardware.boards[..], &hardware.ports, &[embedded]].concat();
        (all, default)
    } else {
        (vec![embedded], Ok(0))
    };
    Question {
        number: 3,
        flag: "--mcu",
        text: "Which microcontroller drives the gripper?",
        choices,
        other: ", usb:SERIAL, serial:PORT",
        default,
    }
}

/// Only pictures of its own fingertip may move a real gripper.
fn board(text: &str, camera: &Source) -> Result<Target, String> {
    let target: Target = text.parse()?;
    match (&target, camera) {
        (Target::Usb(_) | Target::Serial(_), other) if !matches!(other, Source::Camera(_)) => Err(format!(
            "found {target} with pictures of {other}, expected embedded: they would move a gripper that they do not show; \
             `gripline run --source {other} --mcu {target}` does it where it is wanted"
        )),
        _ => Ok(target),
    }
}

fn rest_question(camera: &Source) -> Question {
    let is_file = matches!(camera, Source::Folder(_) | Source::Clip(_) | Source::Recording(_));
    Question {
        number: 4,
        flag: "--rest",
        text: "Pictures of the untouched fingertip, which all others are compared with?",
        choices: vec![
            Choice::new("now", "take and check them now"),
            Choice::new("later", "each run takes its own at its start"),
        ],
        other: ", the FILE.toml of a calibration",
        // Files say themselves which picture is at rest.
        default: Ok(usize::from(is_file)),
    }
}

#[cfg(test)]
mod tests;
