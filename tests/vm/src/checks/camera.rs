//! What a lab does to a camera.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::thread;
use std::time::Duration;

use super::wait::{CAMERA, PATIENCE, REST, WITH_LOSS, back_in_time};
use crate::machine;
use crate::program::{Ended, command, run, start};

/// The user that owns nothing.
const NOBODY: u32 = 65_534;

pub(super) fn pictures(format: &str) -> Result<String, String> {
    let ended = run(&[
        "run",
        "--json",
        "--camera",
        CAMERA,
        "--calibration",
        REST,
        "--camera-format",
        format,
        "--frames-per-second",
        "15",
        "--seconds",
        "3",
        "--network",
        "unet",
    ])?;
    ended.expect(WITH_LOSS, &["640×480", format, "exposure not settable"])?;
    let (came, frames) = (ended.number("/pictures/came")?, ended.number("/frames")?);
    let late = ended.number("/pictures_late")? + ended.number("/maps_late")?;
    let answers = ended.number("/answers_checked")?;
    if frames < 2.0 || ended.number("/shadow_mismatches")? > 0.0 || answers < frames - late {
        return Err(format!(
            "{came} pictures came, {frames} frames: {:?}",
            ended.summary()?
        ));
    }
    forces_are_zero(&ended)?;
    every_picture_is_accounted_for(&ended)?;
    Ok(format!(
        "{came} pictures came, {frames} looked at, {} missed",
        ended.number("/pictures/missed")?
    ))
}

/// A picture that cannot be believed makes no force.
fn forces_are_zero(ended: &Ended) -> Result<(), String> {
    let pushes = ended
        .lines
        .iter()
        .find(|line| line["fn"].as_f64().is_some_and(|force| force > 0.0));
    pushes.map_or(Ok(()), |line| {
        Err(format!("a force out of a test pattern: {line}"))
    })
}

/// What came was looked at, overtaken, damaged, or still on its way at the end.
fn every_picture_is_accounted_for(ended: &Ended) -> Result<(), String> {
    let accounted = ended.number("/frames")?
        + ended.number("/pictures/overtaken")?
        + ended.number("/pictures/damaged")?;
    let came = ended.number("/pictures/came")?;
    if (accounted..=accounted + 2.0).contains(&came) {
        Ok(())
    } else {
        Err(format!(
            "{came} pictures came, {accounted} accounted for: {:?}",
            ended.summary()?
        ))
    }
}

pub(super) fn no_format() -> Result<String, String> {
    let ended = run(&[
        "run",
        "--camera",
        CAMERA,
        "--camera-format",
        "mjpeg",
        "--seconds",
        "1",
    ])?;
    ended.expect(
        1,
        &[
            "no usable format",
            "YUYV 640×480 at",
            "expected mjpeg with 640×480 pixels",
        ],
    )?;
    Ok("refused, with what it offers".to_owned())
}

pub(super) fn controls() -> Result<String, String> {
    let ended = run(&["run", "--camera", CAMERA, "--exposure-ms", "4", "--seconds", "1"])?;
    ended.expect(
        1,
        &["no control for the exposure time", "camera.exposure_ms is set"],
    )?;
    let ended = run(&[
        "run",
        "--json",
        "--camera",
        CAMERA,
        "--calibration",
        REST,
        "--gain",
        "10",
        "--seconds",
        "0.5",
        "--frames-per-second",
        "15",
    ])?;
    ended.expect(WITH_LOSS, &["gain 10"])?;
    let ended = run(&["run", "--camera", CAMERA, "--gain", "9999", "--seconds", "1"])?;
    ended.expect(1, &["camera.gain: found 9999"])?;
    Ok("gain 10 taken, gain 9999 and an exposure refused".to_owned())
}

pub(super) fn missing() -> Result<String, String> {
    let ended = run(&["run", "--camera", "/dev/video9"])?;
    ended.expect(1, &["/dev/video9: not found", "choose one of /dev/video0"])?;
    fs::set_permissions(CAMERA, fs::Permissions::from_mode(0o600)).map_err(|error| error.to_string())?;
    let running =
        start(command(&["run", "--camera", CAMERA]).uid(NOBODY)).map_err(|error| error.to_string())?;
    running.wait()?.expect(1, &["permission denied", "group video"])?;
    Ok("both reported".to_owned())
}

pub(super) fn replugged() -> Result<String, String> {
    let plug = |plug: fn() -> std::io::Result<()>| plug().map_err(|error| format!("the plug: {error}"));
    let mut running = start(&mut command(&[
        "run",
        "--json",
        "--camera",
        CAMERA,
        "--calibration",
        REST,
        "--frames-per-second",
        "15",
        "--seconds",
        "12",
        "--network",
        "unet",
    ]))
    .map_err(|error| error.to_string())?;
    running.until_it_says(&["640×480"], PATIENCE)?;
    thread::sleep(Duration::from_secs(4));
    let mut returns = Vec::new();
    for _ in 0..2 {
        plug(machine::unplug_camera)?;
        running.until_it_says(&[CAMERA, "gone"], PATIENCE)?;
        thread::sleep(Duration::from_millis(500));
        plug(machine::plug_camera)?;
        returns.push(running.until_it_says(&["back after"], PATIENCE)?);
        thread::sleep(Duration::from_secs(1));
    }
    let ended = running.wait()?;
    ended.expect(WITH_LOSS, &["2 times the camera went away"])?;
    if (
        ended.number("/pictures/lost")?,
        ended.number("/pictures/returned")?,
    ) != (2.0, 2.0)
    {
        return Err(format!("{:?}", ended.summary()?));
    }
    every_picture_is_accounted_for(&ended)?;
    back_in_time(&returns)
}
