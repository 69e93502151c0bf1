//! The checks, in order: what a lab does to a camera, a microcontroller, a program and a disk, and what has to come of it.
//! Lines on the console: `VM begins NAME`, `VM ok NAME: WHAT (S s)`, `VM FAILED NAME: WHY`, and `VM end` last.
//! The processor is emulated, at a tenth of its speed or less: nothing here judges speed but the return of a plug, and what takes a number of frames
//! waits for frames, not for time.

mod microcontroller;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use crate::machine;
use crate::program::{Ended, command, run, start};

/// A device that is plugged in again is to be back within this time.
const BACK_WITHIN: Duration = Duration::from_secs(1);
/// Waiting for something that has no bound of its own.
const PATIENCE: Duration = Duration::from_mins(1);
const CAMERA: &str = "/dev/video0";
/// From the kernel's command line: only checks with this in their name are wanted.
const ONLY: &str = "GRIPLINE_ONLY";
/// The user that owns nothing.
const NOBODY: u32 = 65_534;

type Check = fn() -> Result<String, String>;

const CHECKS: [(&str, Check); 16] = [
    ("camera, YUYV", || camera("yuyv")),
    ("camera, grey", || camera("grey")),
    ("camera without the wanted format", no_format),
    ("camera: gain fixed, exposure it does not have", controls),
    ("camera that is not there, or not allowed", no_camera),
    ("camera unplugged and plugged in", camera_replugged),
    ("killed while recording", killed),
    ("full disk", full_disk),
    ("slow disk", slow_disk),
    ("USB: answers, each checked", microcontroller::answers),
    ("USB: two devices", microcontroller::two_devices),
    ("USB: refused", microcontroller::refused),
    ("USB: unplugged and plugged in", microcontroller::replugged),
    ("USB: the firmware hangs", microcontroller::hangs),
    ("USB: the firmware crashes", microcontroller::crashes),
    (
        "USB: gripline killed while recording",
        microcontroller::host_killed,
    ),
];

/// Brings the machine up and runs everything.
pub(crate) fn run_all() {
    if let Err(error) = machine::bring_up() {
        println!("VM FAILED machine: {error}");
        println!("VM end");
        return;
    }
    println!("VM ok machine: up after {}", uptime());
    let only = std::env::var(ONLY).unwrap_or_default();
    for (name, check) in CHECKS.into_iter().filter(|(name, _)| name.contains(&only)) {
        println!("VM begins {name}");
        let started = Instant::now();
        match check() {
            Ok(what) => println!("VM ok {name}: {what} ({:.1} s)", started.elapsed().as_secs_f64()),
            Err(why) => {
                println!("VM FAILED {name}: {}", why.replace('\n', " | "));
                println!("{}", machine::last_words_of_the_kernel());
            }
        }
    }
    println!("VM end");
}

fn uptime() -> String {
    let text = fs::read_to_string("/proc/uptime").unwrap_or_default();
    format!("{} s", text.split(' ').next().unwrap_or("?"))
}

/// Pictures of a camera that shows no fingertip cannot be believed: the run ends with code 3, and the forces are zero.
const WITH_LOSS: i32 = 3;

fn camera(format: &str) -> Result<String, String> {
    let ended = run(&[
        "run",
        "--json",
        "--camera",
        CAMERA,
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

/// What came was looked at (16 times to learn what rest looks like), overtaken, damaged, or still on its way at the end.
fn every_picture_is_accounted_for(ended: &Ended) -> Result<(), String> {
    let accounted = ended.number("/frames")?
        + 16.0
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

fn no_format() -> Result<String, String> {
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

fn controls() -> Result<String, String> {
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

fn no_camera() -> Result<String, String> {
    let ended = run(&["run", "--camera", "/dev/video9"])?;
    ended.expect(1, &["/dev/video9: not found", "choose one of /dev/video0"])?;
    fs::set_permissions(CAMERA, fs::Permissions::from_mode(0o600)).map_err(|error| error.to_string())?;
    let running =
        start(command(&["run", "--camera", CAMERA]).uid(NOBODY)).map_err(|error| error.to_string())?;
    running.wait()?.expect(1, &["permission denied", "group video"])?;
    Ok("both told".to_owned())
}

fn camera_replugged() -> Result<String, String> {
    let plug = |plug: fn() -> std::io::Result<()>| plug().map_err(|error| format!("the plug: {error}"));
    let mut running = start(&mut command(&[
        "run",
        "--json",
        "--camera",
        CAMERA,
        "--frames-per-second",
        "15",
        "--seconds",
        "12",
        "--network",
        "unet",
    ]))
    .map_err(|error| error.to_string())?;
    running.until_it_says(&["640×480"], PATIENCE)?;
    // The pictures at rest are over.
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

fn back_in_time(returns: &[Duration]) -> Result<String, String> {
    let slowest = returns.iter().max().copied().unwrap_or_default();
    let told = format!("back {:.2} s after the system had it", slowest.as_secs_f64());
    if slowest > BACK_WITHIN {
        Err(told)
    } else {
        Ok(told)
    }
}

fn wait_for(is_there: impl Fn() -> bool, what: &str) -> Result<(), String> {
    let start = Instant::now();
    while !is_there() {
        if start.elapsed() > PATIENCE {
            return Err(format!("{what}: not there after {} s", PATIENCE.as_secs()));
        }
        thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}

/// A recorded run of the camera, until it is stopped.
fn recorded(file: &str) -> Command {
    command(&[
        "run",
        "--json",
        "--network",
        "unet",
        "--camera",
        CAMERA,
        "--frames-per-second",
        "15",
        "--record",
        file,
    ])
}

fn killed() -> Result<String, String> {
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
    let told_s = |frame: usize| ended.lines.get(frame).and_then(|line| line["t_s"].as_f64());
    let last_s = told_s(ended.lines.len().wrapping_sub(1)).ok_or("it never told a frame")?;
    let lost_s = last_s - told_s((frames as usize).wrapping_sub(1)).unwrap_or(0.0);
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

fn full_disk() -> Result<String, String> {
    machine::mount_small_disk().map_err(|error| error.to_string())?;
    let file = format!("{}/full.mcap", machine::SMALL_DISK);
    // 6 MB are some 30 whole pictures.
    let mut running = start(&mut recorded(&file)).map_err(|error| error.to_string())?;
    running.until_it_says(&["No space left"], PATIENCE)?;
    let then = running.told();
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

fn slow_disk() -> Result<String, String> {
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
        "{frames} frames, {dropped} pictures and frames not recorded, all told"
    ))
}
