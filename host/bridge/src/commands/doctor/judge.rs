//! What `gripline doctor` makes of what it found. Pure: every judgement is a function of numbers, so that every one can be
//! tested with faults that no test machine has. Pictures in grey levels and pixels, times in ms, rates in 1/s.

use std::borrow::Cow;
use std::fmt;

use gripline_network::InstructionSet;
use gripline_protocol::message::{BOARDS, Hello};
use serde::Serialize;

use crate::calibration::Rest;
use gripline_capture::CaptureError;
use gripline_evaluation::calibration::surface::{Change, Figures, limit};
use gripline_link::usb::{Attached, choose};

/// Least share of the wanted frame rate that is in order, and that works at all.
const RATE: [f64; 2] = [0.95, 0.5];
/// A picture that comes this much later than its place is missing or late, in picture intervals.
const GAP: f64 = 1.5;
/// What a picture may take from the camera's bytes to the microcontroller's, ms: median and longest (DESIGN.md).
const BUDGET_MS: [f64; 2] = [1.5, 4.0];
/// Least sharpness against the calibrated one, share.
const SHARPNESS_KEPT: f64 = 0.8;
/// Largest noise against the calibrated one, share.
const NOISE_GROWN: f64 = 1.5;
/// Largest change of the mean level since calibration, share, that is in order, and that the network still takes.
const LIGHT: [f64; 2] = [0.1, 0.25];

/// How it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum State {
    Ok,
    Warn,
    Fail,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Fail => "FAIL",
        })
    }
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Check {
    pub name: Cow<'static, str>,
    pub state: State,
    pub found: String,
    pub expected: String,
    /// What to do; empty when all is well.
    pub advice: String,
}

impl Check {
    pub(super) fn ok(name: &'static str, found: impl fmt::Display, expected: impl fmt::Display) -> Self {
        Self::new(name, State::Ok, found, expected, "")
    }

    pub(super) fn fail(
        name: &'static str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
        advice: &str,
    ) -> Self {
        Self::new(name, State::Fail, found, expected, advice)
    }

    fn new(
        name: &'static str,
        state: State,
        found: impl fmt::Display,
        expected: impl fmt::Display,
        advice: &str,
    ) -> Self {
        Self {
            name: name.into(),
            state,
            found: found.to_string(),
            expected: expected.to_string(),
            advice: if state == State::Ok {
                String::new()
            } else {
                advice.to_owned()
            },
        }
    }
}

/// Warn or fail, by which of the two limits is passed.
fn grade(warns: bool, fails: bool) -> State {
    if fails {
        State::Fail
    } else if warns {
        State::Warn
    } else {
        State::Ok
    }
}

/// `at_s` are the times of pictures in a row, `wanted` pictures a second.
pub(super) fn frame_rate(at_s: &[f64], wanted: f64) -> Check {
    let expected = format!("{wanted:.0}/s, none missing");
    let span = at_s
        .last()
        .zip(at_s.first())
        .map_or(0.0, |(last, first)| last - first);
    let steps = at_s.len().saturating_sub(1);
    let rate = if span > 0.0 { steps as f64 / span } else { 0.0 };
    let gaps = at_s
        .windows(2)
        .filter(|pair| (pair[1] - pair[0]) * wanted > GAP)
        .count();
    let [good, least] = RATE;
    Check::new(
        "frame rate",
        grade(rate < good * wanted || gaps > 0, rate < least * wanted),
        format!("{rate:.1}/s, {gaps} late or missing of {steps}"),
        expected,
        "more light or a shorter exposure; a USB port of its own; MJPEG instead of YUYV; check what else uses this machine",
    )
}

pub(super) fn light(figures: &Figures) -> Check {
    let [dark, bright] = limit::LEVEL;
    let level = figures.mean_level;
    let saturated = figures.saturated_share > limit::SATURATED;
    Check::new(
        "light",
        grade(saturated, level < dark || level > bright),
        format!(
            "mean level {level:.0}, {:.1} % saturated",
            100.0 * figures.saturated_share
        ),
        format!(
            "{dark:.0} to {bright:.0}, at most {:.0} %",
            100.0 * limit::SATURATED
        ),
        if level < dark {
            "switch the lamps on, take covers off, expose longer"
        } else {
            "expose shorter, dim the lamps, keep daylight out"
        },
    )
}

pub(super) fn focus(figures: &Figures, calibrated: Option<&Rest>) -> Check {
    let least = calibrated.map_or(limit::SHARPNESS, |rest| {
        limit::SHARPNESS.max(SHARPNESS_KEPT * rest.sharpness)
    });
    let blurred = figures.sharpness < limit::SHARPNESS;
    let few = figures.particles < limit::PARTICLES;
    Check::new(
        "focus",
        grade(figures.sharpness < least, blurred || few),
        format!(
            "sharpness {:.3}, {} particles",
            figures.sharpness, figures.particles
        ),
        format!("at least {least:.3} and {}", limit::PARTICLES),
        "focus the lens on the particles, clean it; then `gripline calibrate rest`",
    )
}

pub(super) fn noise(figures: &Figures, calibrated: &Rest) -> Check {
    let most = NOISE_GROWN * calibrated.noise_levels.max(0.5);
    Check::new(
        "noise",
        grade(figures.noise_levels > most, false),
        format!("{:.2} grey levels from picture to picture", figures.noise_levels),
        format!("at most {most:.2}"),
        "less gain and more light; nothing may move; then `gripline calibrate rest`",
    )
}

/// `change` since the calibrated rest picture; none without a calibration.
pub(super) fn rest(change: Option<&Change>) -> Check {
    const NAME: &str = "rest picture";
    let Some(change) = change else {
        return Check::new(
            NAME,
            State::Warn,
            "no calibrated one",
            "calibration.file with a section [rest]",
            "`gripline calibrate rest`, and name its file in the configuration; until then nothing may touch the skin when a \
             run starts",
        );
    };
    let [unlike, too_unlike] = LIGHT;
    let off = (change.light - 1.0).abs();
    let found = format!(
        "{:.2} px aside, parts {:.2} px more, {:.0} % of the particles gone, {:+.0} % light",
        change.drift_px,
        change.dent_px,
        100.0 * change.lost,
        100.0 * (change.light - 1.0)
    );
    let expected = format!(
        "at most {} px, {} px, {:.0} %, {:.0} %",
        limit::DRIFT_PX,
        limit::STILL_PX,
        100.0 * limit::LOST,
        100.0 * unlike
    );
    let gone = change.lost > limit::LOST;
    let advice = if gone {
        "this is not the skin that was calibrated, or something covers it: clean it, or `gripline calibrate rest --anew`"
    } else if change.drift_px > limit::DRIFT_PX {
        "camera and gel moved against each other: fasten them, then `gripline calibrate rest --anew`"
    } else if change.dent_px > limit::STILL_PX {
        "something touches the skin, or it keeps a dent: take it off, let it settle; if it stays, `gripline calibrate rest \
         --anew`"
    } else {
        "set lamps and exposure as they were, or `gripline calibrate rest`"
    };
    let drifted = change.drift_px > limit::DRIFT_PX || change.dent_px > limit::STILL_PX || off > unlike;
    Check::new(
        NAME,
        grade(drifted, gone || off > too_unlike),
        found,
        expected,
        advice,
    )
}

/// ffmpeg, which only clips need.
pub(super) fn ffmpeg(version: Result<String, CaptureError>, is_needed: bool) -> Check {
    let expected = "ffmpeg, to read and write clips";
    match version {
        Ok(version) => Check::ok("ffmpeg", version, expected),
        Err(missing) => {
            let state = if is_needed { State::Fail } else { State::Warn };
            Check::new(
                "ffmpeg",
                state,
                missing,
                expected,
                "install it, unless no clip is ever used",
            )
        }
    }
}

/// Which of the devices of ours is meant, if any.
pub(super) fn usb(attached: &[Attached], serial: Option<&str>) -> Check {
    let expected = serial.map_or_else(
        || "one device".to_owned(),
        |serial| format!("the device {serial}"),
    );
    match choose("usb", attached, serial) {
        Ok(place) => Check::ok("usb", format!("a device at {}", attached[place].place), expected),
        Err(error) => Check::fail(
            "usb",
            error,
            expected,
            "plug it in, flash it (`cargo xtask flash`), try another cable; `lsusb` should show 1209:0001",
        ),
    }
}

/// What answered the handshake; our own build is `[major, minor, patch]`.
pub(super) fn firmware(hello: &Hello, build: [u8; 3]) -> Check {
    let dotted = |[a, b, c]: [u8; 3]| format!("{a}.{b}.{c}");
    let board = BOARDS
        .get(usize::from(hello.board))
        .copied()
        .unwrap_or("an unknown board");
    Check::new(
        "firmware",
        grade(hello.build != build, false),
        format!("{} on {board}, speaks our schema", dotted(hello.build)),
        dotted(build),
        "flash this version: `cargo xtask flash`",
    )
}

/// Names of the faults that are there or latched.
pub(super) fn faults(names: &[&str]) -> Check {
    Check::new(
        "faults",
        grade(!names.is_empty(), false),
        if names.is_empty() {
            "none".to_owned()
        } else {
            names.join(", ")
        },
        "none",
        "docs/safety.md says what each means; look at the gripper, then acknowledge",
    )
}

/// Whether the microcontroller's table of the line is the calibrated one.
pub(super) fn line_table(same: bool) -> Check {
    Check::new(
        "line table",
        grade(!same, false),
        if same {
            "the calibrated one"
        } else {
            "another than the calibrated one"
        },
        "the calibrated one",
        "`gripline calibrate line --store`, then restart the microcontroller",
    )
}

/// `usable` is what the run would use, `widest` what the processor has.
pub(super) fn processor(usable: InstructionSet, widest: InstructionSet) -> Check {
    Check::new(
        "processor",
        grade(usable == InstructionSet::Portable, false),
        format!("uses {usable}, has {widest}"),
        "avx2 or avx512",
        if widest == InstructionSet::Portable {
            "use a processor with AVX2: the network takes three times as long without"
        } else {
            "leave network.instructions out of the configuration"
        },
    )
}

/// Times of whole frames with the network, ms.
pub(super) fn latency(times_ms: &mut [f64]) -> Check {
    times_ms.sort_by(f64::total_cmp);
    let median = times_ms.get(times_ms.len() / 2).copied().unwrap_or(f64::INFINITY);
    let longest = times_ms.last().copied().unwrap_or(f64::INFINITY);
    let [usual, most] = BUDGET_MS;
    Check::new(
        "latency",
        grade(median > usual || longest > most, median > most),
        format!(
            "median {median:.2} ms, longest of {} {longest:.2} ms",
            times_ms.len()
        ),
        format!("at most {usual} ms and {most} ms"),
        "a release build (`cargo build --release`); nothing else on this core (realtime.enabled); network.architecture \
         \"unet\"",
    )
}

/// What the system did not allow.
pub(super) fn realtime(lacks: &[String], wanted: bool) -> Check {
    Check::new(
        "real time",
        grade(!lacks.is_empty(), wanted && !lacks.is_empty()),
        if lacks.is_empty() {
            "SCHED_FIFO, locked memory and a core can be had".to_owned()
        } else {
            lacks.join("; ")
        },
        "all of it, for --realtime",
        "docs/gripline.service has the limits that a service needs; for a shell `ulimit -r 40 -l unlimited` as root, or the \
         capabilities CAP_SYS_NICE and CAP_IPC_LOCK",
    )
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
