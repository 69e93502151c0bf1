//! What a lab does to a recording: a killed program, a full disk, a slow one.

use std::fs;
use std::process::Command;
use std::thread;
use std::time::Duration;

use super::wait::{CAMERA, PATIENCE, REST, WITH_LOSS, wait_for};
use crate::machine;
use crate::program::{command, run, start};

/// A recorded run of the camera, until it is stopped.
fn recorded(file: &str) -> Command {
    command(&[
        "run",
        "--json",
        "--network",
        "unet",
        "--camera",
        CAMERA,
        "--calibration",
        REST,
        "--frames-per-second",
        "15",
        "--record",
        file,
    ])
}

pub(super) fn killed() -> Result<String, String> {
    let file = "/tmp/killed.mcap";
    let running = start(&mut recorded(file)).map_err(|error| error.to_string())?;
    wait_for(
        || fs::metadata(file).is_ok_and(|file| file.len() > 0),
        "the recording",
    )?;
    thread::sleep(Duration::from_secs(5));
    let ended = running.kill()?;
    let replayed = run(&["replay", "--json", file])?;
    replayed.expect(WITH_LOSS, &["cut short"])?;
    let frames = replayed
        .lines
        .last()
        .and_then(|line| line["frames"].as_f64())
        .unwrap_or(0.0);
    let different = replayed.lines.last().and_then(|line| line["different"].as_f64());
    let frame_s = |frame: usize| ended.lines.get(frame).and_then(|line| line["t_s"].as_f64());
    let last_s = frame_s(ended.lines.len().wrapping_sub(1)).ok_or("it never reported a frame")?;
    let lost_s = last_s - frame_s((frames as usize).wrapping_sub(1)).unwrap_or(0.0);
    if different != Some(0.0) || lost_s > 1.0 {
        return Err(format!(
            "{lost_s:.2} s lost, {different:?} frames decided otherwise: {}",
            replayed.said
        ));
    }
    Ok(format!(
        "{frames} frames opened and decided alike, {lost_s:.2} s lost"
    ))
}

pub(super) fn full() -> Result<String, String> {
    machine::mount_small_disk().map_err(|error| error.to_string())?;
    let file = format!("{}/full.mcap", machine::SMALL_DISK);
    // 8 MB are some 40 whole pictures, 16 of them at rest; the chunk that no longer fits is lost.
    let mut running = start(&mut recorded(&file)).map_err(|error| error.to_string())?;
    running.until_it_says(&["No space left"], PATIENCE)?;
    let then = running.frames_seen();
    running.until_frames(then + 10, PATIENCE)?;
    let ended = running.interrupt()?;
    ended.expect(WITH_LOSS, &["No space left"])?;
    let (frames, kept) = (ended.number("/frames")?, ended.number("/recording/frames")?);
    if kept < 10.0 || frames < kept + 10.0 || ended.number("/shadow_mismatches")? > 0.0 {
        return Err(format!("{:?}", ended.summary()?));
    }
    let replayed = run(&["replay", "--json", &file])?;
    replayed.expect(WITH_LOSS, &["cut short"])?;
    Ok(format!(
        "{kept} of {frames} frames kept, the run went on, the file opens"
    ))
}

pub(super) fn slow() -> Result<String, String> {
    machine::mount_slow_disk().map_err(|error| error.to_string())?;
    let file = format!("{}/slow.mcap", machine::SLOW_DISK);
    let mut running = start(&mut recorded(&file)).map_err(|error| error.to_string())?;
    // 30 pictures may wait for the disk, which takes most of a second for one: even where few come a second.
    running.until_frames(90, PATIENCE)?;
    let ended = running.interrupt()?;
    let frames = ended.number("/frames")?;
    let dropped = ended.number("/recording/pictures_dropped")? + ended.number("/recording/frames_dropped")?;
    if frames < 90.0 || ended.number("/shadow_mismatches")? > 0.0 {
        return Err(format!("{:?}", ended.summary()?));
    }
    if dropped < 1.0 {
        return Err(format!(
            "nothing dropped, so the disk was not slow: {:?}",
            ended.summary()?
        ));
    }
    ended.expect(WITH_LOSS, &["not in the recording"])?;
    Ok(format!(
        "{frames} frames, {dropped} pictures and frames not recorded, all reported"
    ))
}
