//! The judgements of `gripline doctor`. Pure: every finding is a function of numbers, so that tests can simulate faults that no
//! test machine has. Pictures in grey levels and pixels, times in ms, rates in 1/s.

use std::borrow::Cow;
use std::fmt;

use gripline_network::InstructionSet;
use gripline_protocol::message::{BOARDS, Hello};
use serde::Serialize;

use crate::calibration::Rest;
use gripline_capture::CaptureError;
use gripline_evaluation::calibration::surface::{Change, Figures, limit};
use gripline_link::usb::{Attached, choose};
use gripline_sensor::Sensor;

/// Minimum share of the wanted frame rate for a good result, and for a usable one.
const RATE: [f64; 2] = [0.95, 0.5];
/// A picture this late counts as late or missing, in picture intervals.
const GAP: f64 = 1.5;
/// Budget from the camera's bytes to the microcontroller's, ms: median and maximum (DESIGN.md).
const BUDGET_MS: [f64; 2] = [1.5, 4.0];
/// The same for printed markers, which are tracked in every picture, and the limit as a share of the time between two pictures.
const MARKERS_BUDGET_MS: f64 = 3.0;
const MARKERS_SHARE_MAX: f64 = 0.5;
/// Minimum sharpness as a share of the calibrated one.
const SHARPNESS_KEPT: f64 = 0.8;
/// Maximum noise as a share of the calibrated one.
const NOISE_GROWN: f64 = 1.5;

/// Measurements on pictures of printed markers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    /// Columns and rows of the source; `None` if unknown.
    pub size_px: Option<[usize; 2]>,
    /// Mean level of the first picture, grey levels.
    pub level: f64,
    /// Markers in the largest grid.
    pub markers: usize,
    /// Distance of neighbours, pixels of the crop.
    pub pitch_px: f64,
    /// Largest share of hidden markers among the pictures.
    pub lost_share: f64,
}

/// How serious a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Level {
    Ok,
    Warn,
    Fail,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Fail => "FAIL",
        })
    }
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    #[serde(rename = "name")]
    pub what: Cow<'static, str>,
    #[serde(rename = "state")]
    pub level: Level,
    pub found: String,
    pub expected: String,
    /// What to do; empty when all is well.
    #[serde(rename = "advice")]
    pub fix: String,
}

impl Finding {
    pub(super) fn ok(what: &'static str, found: impl fmt::Display, expected: impl fmt::Display) -> Self {
        Self::new(what, Level::Ok, found, expected, "")
    }

    pub(super) fn fail(
        what: &'static str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
        fix: &str,
    ) -> Self {
        Self::new(what, Level::Fail, found, expected, fix)
    }

    fn new(
        what: &'static str,
        level: Level,
        found: impl fmt::Display,
        expected: impl fmt::Display,
        fix: &str,
    ) -> Self {
        Self {
            what: what.into(),
            level,
            found: found.to_string(),
            expected: expected.to_string(),
            fix: if level == Level::Ok { "" } else { fix }.to_owned(),
        }
    }
}

/// The more serious of two conditions decides.
fn grade(warns: bool, fails: bool) -> Level {
    if fails {
        Level::Fail
    } else if warns {
        Level::Warn
    } else {
        Level::Ok
    }
}

/// `at_s`: times of consecutive pictures; `wanted`: pictures a second.
pub(super) fn frame_rate(at_s: &[f64], wanted: f64) -> Finding {
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
    let [good, minimum] = RATE;
    Finding::new(
        "frame rate",
        grade(rate < good * wanted || gaps > 0, rate < minimum * wanted),
        format!("{rate:.1}/s, {gaps} late or missing of {steps}"),
        expected,
        "more light or a shorter exposure; a USB port of its own; MJPEG instead of YUYV; check what else uses this machine",
    )
}

pub(super) fn light(figures: &Figures) -> Finding {
    let [dark, bright] = limit::LEVEL;
    let level = figures.mean_level;
    let saturated = figures.saturated_share > limit::SATURATED;
    Finding::new(
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

pub(super) fn focus(figures: &Figures, calibrated: Option<&Rest>) -> Finding {
    let minimum = calibrated.map_or(limit::SHARPNESS, |rest| {
        limit::SHARPNESS.max(SHARPNESS_KEPT * rest.sharpness)
    });
    let blurred = figures.sharpness < limit::SHARPNESS;
    let few = figures.particles < limit::PARTICLES;
    Finding::new(
        "focus",
        grade(figures.sharpness < minimum, blurred || few),
        format!(
            "sharpness {:.3}, {} particles",
            figures.sharpness, figures.particles
        ),
        format!("at least {minimum:.3} and {}", limit::PARTICLES),
        "focus the lens on the particles, clean it; then `gripline calibrate rest`",
    )
}

pub(super) fn noise(figures: &Figures, calibrated: &Rest) -> Finding {
    let maximum = NOISE_GROWN * calibrated.noise_levels.max(0.5);
    Finding::new(
        "noise",
        grade(figures.noise_levels > maximum, false),
        format!("{:.2} grey levels from picture to picture", figures.noise_levels),
        format!("at most {maximum:.2}"),
        "less gain and more light; nothing may move; then `gripline calibrate rest`",
    )
}

/// `change` since the calibrated rest picture; `None` without a calibration.
pub(super) fn rest(change: Option<&Change>) -> Finding {
    const WHAT: &str = "rest picture";
    let Some(change) = change else {
        return Finding::new(
            WHAT,
            Level::Warn,
            "no calibrated one",
            "calibration.file with a section [rest]",
            "`gripline calibrate rest`, and name its file in the configuration; until then nothing may touch the sensor surface \
             when a run starts",
        );
    };
    let [good, usable] = limit::LIGHT;
    let light_change = (change.light - 1.0).abs();
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
        100.0 * good
    );
    let lost = change.lost > limit::LOST;
    let fix = if lost {
        "this is not the sensor surface that was calibrated, or something covers it: clean it, or `gripline calibrate rest --anew`"
    } else if change.drift_px > limit::DRIFT_PX {
        "camera and gel moved against each other: fasten them, then `gripline calibrate rest --anew`"
    } else if change.dent_px > limit::STILL_PX {
        "something touches the sensor surface, or a dent is left: remove it, let the gel settle; if it stays, `gripline \
         calibrate rest --anew`"
    } else {
        "set lamps and exposure as they were, or `gripline calibrate rest`"
    };
    let drifted =
        change.drift_px > limit::DRIFT_PX || change.dent_px > limit::STILL_PX || light_change > good;
    Finding::new(
        WHAT,
        grade(drifted, lost || light_change > usable),
        found,
        expected,
        fix,
    )
}

/// Checks ffmpeg, which only clips need.
pub(super) fn ffmpeg(version: Result<String, CaptureError>, is_needed: bool) -> Finding {
    let expected = "ffmpeg, to read and write clips";
    match version {
        Ok(version) => Finding::ok("ffmpeg", version, expected),
        Err(missing) => {
            let level = if is_needed { Level::Fail } else { Level::Warn };
            Finding::new(
                "ffmpeg",
                level,
                missing,
                expected,
                "install it, unless no clip is ever used",
            )
        }
    }
}

/// Whether one of the attached devices can be chosen.
pub(super) fn usb(attached: &[Attached], serial: Option<&str>) -> Finding {
    let expected = serial.map_or_else(
        || "one device".to_owned(),
        |serial| format!("the device {serial}"),
    );
    match choose("usb", attached, serial) {
        Ok(place) => Finding::ok("usb", format!("a device at {}", attached[place].place), expected),
        Err(error) => Finding::fail(
            "usb",
            error,
            expected,
            "plug it in, flash it (`cargo xtask flash`), try another cable; `lsusb` should show 1209:0001",
        ),
    }
}

/// Chips in ST's bootloader, by their places; nothing to say when there are none.
pub(super) fn bootloader(places: &[&str]) -> Option<Finding> {
    (!places.is_empty()).then(|| {
        Finding::new(
            "bootloader",
            Level::Warn,
            format!(
                "a chip in its bootloader (DFU, 0483:df11) at {}",
                places.join(", ")
            ),
            "boards that run their firmware",
            "`gripline flash --usb IMAGE --board BOARD` gives it one; or set BOOT0 low and reset it",
        )
    })
}

/// The firmware that answered the handshake; `build` is ours: `[major, minor, patch]`.
pub(super) fn firmware(hello: &Hello, build: [u8; 3]) -> Finding {
    let dotted = |[a, b, c]: [u8; 3]| format!("{a}.{b}.{c}");
    let board = BOARDS
        .get(usize::from(hello.board))
        .copied()
        .unwrap_or("an unknown board");
    Finding::new(
        "firmware",
        grade(hello.build != build, false),
        format!("{} on {board}, speaks our schema", dotted(hello.build)),
        dotted(build),
        "flash this version: `cargo xtask flash`",
    )
}

/// Names of the active or latched faults.
pub(super) fn faults(names: &[&str]) -> Finding {
    Finding::new(
        "faults",
        grade(!names.is_empty(), false),
        if names.is_empty() {
            "none".to_owned()
        } else {
            names.join(", ")
        },
        "none",
        "docs/safety.md says what each means; check the gripper, then acknowledge",
    )
}

/// Whether the microcontroller's line table is the calibrated one.
pub(super) fn line_table(same: bool) -> Finding {
    Finding::new(
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

/// `used`: what the run would use; `widest`: what the processor has.
pub(super) fn processor(used: InstructionSet, widest: InstructionSet) -> Finding {
    Finding::new(
        "processor",
        grade(used == InstructionSet::Portable, false),
        format!("uses {used}, has {widest}"),
        "avx2, avx512 or neon",
        if widest == InstructionSet::Portable {
            "use a processor with AVX2 or NEON: the network takes three times as long without"
        } else {
            "leave network.instructions out of the configuration"
        },
    )
}

/// Times of whole frames, network included, ms.
pub(super) fn latency(times_ms: &mut [f64]) -> Finding {
    times_ms.sort_by(f64::total_cmp);
    let median = times_ms.get(times_ms.len() / 2).copied().unwrap_or(f64::INFINITY);
    let longest = times_ms.last().copied().unwrap_or(f64::INFINITY);
    let [median_max, longest_max] = BUDGET_MS;
    Finding::new(
        "latency",
        grade(median > median_max || longest > longest_max, median > longest_max),
        format!(
            "median {median:.2} ms, longest of {} {longest:.2} ms",
            times_ms.len()
        ),
        format!("at most {median_max} ms and {longest_max} ms"),
        "a release build (`cargo build --release`); nothing else on this core (realtime.enabled); network.architecture \
         \"unet\"",
    )
}

/// The same of printed markers, from the crop to map and evidence, at the sensor's rate.
pub(super) fn marker_latency(times_ms: &mut [f64], rate_hz: f64) -> Finding {
    times_ms.sort_by(f64::total_cmp);
    let median = times_ms.get(times_ms.len() / 2).copied().unwrap_or(f64::INFINITY);
    let longest = times_ms.last().copied().unwrap_or(f64::INFINITY);
    Finding::new(
        "latency",
        grade(
            median > MARKERS_BUDGET_MS,
            median > 1e3 * MARKERS_SHARE_MAX / rate_hz,
        ),
        format!(
            "median {median:.2} ms, longest of {} {longest:.2} ms",
            times_ms.len()
        ),
        format!("at most {MARKERS_BUDGET_MS} ms"),
        "a release build (`cargo build --release`); nothing else on this core (realtime.enabled)",
    )
}

/// Compares printed markers with their description: size of the pictures, light, number, distance, hidden ones.
pub(super) fn markers(sensor: &Sensor, look: &Look) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some([width, height]) = look.size_px {
        let shape = |[width, height]: [usize; 2]| width as f64 / height as f64;
        let [wanted, camera] = [sensor.capture.size_px, sensor.capture.camera_px];
        let off = (shape([width, height]) / shape(wanted)).ln().abs();
        findings.push(Finding::new(
            "picture",
            grade(off > 0.02 || width < wanted[0], off > 0.1),
            format!("{width}×{height} pixels"),
            format!(
                "{}×{} or {}×{}, or others of that shape",
                wanted[0], wanted[1], camera[0], camera[1]
            ),
            "mend capture.size_px and crop_px of the description, or take pictures that are not cropped",
        ));
    }
    let [dark, bright] = sensor.health.rest_level;
    findings.push(Finding::new(
        "light",
        grade(false, look.level < dark || look.level > bright),
        format!("mean level {:.0}", look.level),
        format!("{dark} to {bright} (health.rest_level)"),
        "set lamps and exposure, or the description's limits",
    ));
    let [fewest, max] = sensor.markers.count;
    let [min_px, max_px] = sensor.pitch_px().unwrap_or_default();
    let is_near = (0.9 * min_px..=1.1 * max_px).contains(&look.pitch_px);
    findings.push(Finding::new(
        "markers",
        grade(look.markers > max || !is_near, look.markers < fewest),
        format!("{} in a grid, {:.1} pixels apart", look.markers, look.pitch_px),
        format!("{fewest} to {max}, {min_px:.0} to {max_px:.0} pixels apart"),
        "markers.count and pitch_mm, view.field_mm and zoom of the description; light and focus",
    ));
    findings.push(Finding::new(
        "hidden markers",
        grade(look.lost_share > sensor.health.lost_share, false),
        format!("{:.0} % at most", 100.0 * look.lost_share),
        format!(
            "at most {:.0} % (health.lost_share)",
            100.0 * sensor.health.lost_share
        ),
        "clean or replace the gel; less light that glares",
    ));
    findings
}

/// `lacks`: what the system refused.
pub(super) fn realtime(lacks: &[String], wanted: bool) -> Finding {
    Finding::new(
        "real time",
        grade(!lacks.is_empty(), wanted && !lacks.is_empty()),
        if lacks.is_empty() {
            "SCHED_FIFO, locked memory and a core are available".to_owned()
        } else {
            lacks.join("; ")
        },
        "all of it, for --realtime",
        "docs/gripline.service has the limits that a service needs; for a shell `ulimit -r 40 -l unlimited` as root, or the \
         capabilities CAP_SYS_NICE and CAP_IPC_LOCK",
    )
}

#[cfg(test)]
mod tests;
