//! A microcontroller on USB (`usb`): the released program's maps go over the kernel's USB to the firmware library and its
//! answers come back, while plugs are pulled and programs hang and die. What is to have forces plays the recorded scene of
//! the simulated fingertip that lies in the image; what is to last looks at the camera, which shows none. The grip-force line
//! is read where the firmware has it.

use std::thread;
use std::time::Duration;

use gripline_firmware::Fault;

use serde_json::Value;

use super::wait::{CAMERA, PATIENCE, REST, WITH_LOSS, back_in_time, wait_for};
use crate::program::{Ended, Running, command, run, start};
use crate::usb::{Gadget, Speed};

/// Written by the host.
const SCENE: &str = "mcap:/scene.mcap";
const SERIAL: &str = "2A0041";
const OTHER: &str = "2A0042";
/// Maps that have come after something happened when all is well again.
const ENOUGH_MAPS: u32 = 30;
/// Longer than the microcontroller waits for its host.
const LONG_SILENCE: Duration = Duration::from_secs(2);

/// The arguments of a run that plays the recorded scene to its end with this device.
fn scene(mcu: &str) -> [&str; 9] {
    [
        "run",
        "--json",
        "--hold",
        "--source",
        SCENE,
        "--network",
        "unet",
        "--mcu",
        mcu,
    ]
}

/// Those of a run that looks at the camera until it is stopped.
fn filming<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let arguments = [
        "run",
        "--json",
        "--hold",
        "--camera",
        CAMERA,
        "--calibration",
        REST,
    ];
    let ours = ["--frames-per-second", "15", "--network", "unet", "--mcu", "usb"];
    [&arguments[..], &ours, more].concat()
}

fn plugged(socket: u8, serial: &str, speed: Speed) -> Result<Gadget, String> {
    Gadget::new(socket, serial, speed).map_err(|error| format!("the device: {error}"))
}

/// A run with a device at full speed, which holds, and whose maps come.
fn holding(more: &[&str]) -> Result<(Gadget, Running), String> {
    let gadget = plugged(0, SERIAL, Speed::Full)?;
    let running = start(&mut command(&filming(more))).map_err(|error| error.to_string())?;
    let holds = wait_for(
        || {
            gadget
                .memory()
                .is_ok_and(|memory| memory.holds && memory.line > 0 && memory.maps > ENOUGH_MAPS)
        },
        "a line that holds, and maps",
    );
    if let Err(why) = holds {
        let memory = gadget.memory();
        let ended = running.kill()?;
        return Err(format!(
            "{why}: {memory:?}; ended with {:?}, said: {}",
            ended.code,
            ended.said.trim()
        ));
    }
    Ok((gadget, running))
}

/// Waits until the run has the device again. Returns how long that took from when the system had it.
fn back(gadget: &Gadget, running: &mut Running) -> Result<Duration, String> {
    device_result(gadget.arrive())?;
    running.until_it_says(&["is back"], PATIENCE)
}

fn device_result<T>(what: std::io::Result<T>) -> Result<T, String> {
    what.map_err(|error| format!("the device: {error}"))
}

/// Every answer was right. An emulated processor may be too slow for some frames: these are reported.
fn sound(ended: &Ended) -> Result<f64, String> {
    if ended.code != Some(0) {
        ended.expect(WITH_LOSS, &[])?;
    }
    let answers = ended.number("/answers_checked")?;
    if ended.number("/shadow_mismatches")? > 0.0 || answers < 10.0 {
        return Err(format!("{:?}", ended.summary()?));
    }
    Ok(answers)
}

/// The scene was played, and the answers are about forces. Tells how many.
fn played(ended: &Ended) -> Result<String, String> {
    let answers = sound(ended)?;
    met(ended, 0.0, 0.0)?;
    let touches = |line: &&Value| line["contact"].as_u64().is_some_and(|contact| contact > 0);
    let touching = ended.lines.iter().filter(touches).count();
    if touching < 10 {
        return Err(format!("{touching} frames with contact: {:?}", ended.summary()?));
    }
    let frames = ended.number("/frames")?;
    Ok(format!(
        "{answers} answers to {frames} frames, {touching} of them with contact, 0 wrong"
    ))
}

/// What is lost, in order: losses of the device, restarts.
fn met(ended: &Ended, losses: f64, restarts: f64) -> Result<(), String> {
    let found = (
        ended.number("/link_losses")?,
        ended.number("/microcontroller_restarts")?,
    );
    if found == (losses, restarts) {
        Ok(())
    } else {
        Err(format!(
            "found {found:?} losses and restarts, expected {:?}: {:?}",
            (losses, restarts),
            ended.summary()?
        ))
    }
}

pub(super) fn answers() -> Result<String, String> {
    let _gadget = plugged(0, SERIAL, Speed::Full)?;
    Ok(format!("{}, at full speed", played(&run(&scene("usb"))?)?))
}

pub(super) fn two_devices() -> Result<String, String> {
    let first = plugged(0, SERIAL, Speed::Full)?;
    let _other = plugged(1, OTHER, Speed::High)?;
    run(&scene("usb"))?.expect(1, &["found 2: ", SERIAL, OTHER, "--mcu usb:SERIAL"])?;
    let chosen = played(&run(&scene(&format!("usb:{OTHER}")))?)?;
    if device_result(first.memory())?.maps > 0 {
        return Err("the other device was spoken to".to_owned());
    }
    Ok(format!(
        "one chosen by its serial number: {chosen}, at high speed"
    ))
}

pub(super) fn refused() -> Result<String, String> {
    let first = plugged(0, SERIAL, Speed::Full)?;
    let twin = plugged(1, SERIAL, Speed::Full)?;
    let named = format!("usb:{SERIAL}");
    run(&scene(&named))?.expect(1, &["two devices with the serial number", SERIAL])?;
    drop(twin);
    device_result(first.unconfigure())?;
    run(&scene("usb"))?.expect(1, &["attached, but not ready"])?;
    drop(first);
    run(&scene("usb"))?.expect(1, &["no device 1209:0001"])?;
    Ok("one serial number twice, a device that is not configured, and none".to_owned())
}

pub(super) fn replugged() -> Result<String, String> {
    let (mut gadget, mut running) = holding(&[])?;
    let before = device_result(gadget.memory())?;
    let mut returns = Vec::new();
    for _ in 0..2 {
        device_result(gadget.unplug())?;
        running.until_it_says(&["is gone"], PATIENCE)?;
        thread::sleep(Duration::from_millis(300));
        device_result(gadget.plug())?;
        returns.push(back(&gadget, &mut running)?);
        let maps = device_result(gadget.memory())?.maps;
        wait_for(
            || {
                gadget
                    .memory()
                    .is_ok_and(|memory| memory.maps > maps + ENOUGH_MAPS)
            },
            "maps after the return",
        )?;
    }
    let after = device_result(gadget.memory())?;
    if after.line < before.line {
        return Err(format!("the line fell: {before:?}, then {after:?}"));
    }
    let ended = running.interrupt()?;
    sound(&ended)?;
    ended.expect(WITH_LOSS, &["device went away 2 times"])?;
    met(&ended, 2.0, 0.0)?;
    back_in_time(&returns)
}

pub(super) fn hangs() -> Result<String, String> {
    let (gadget, running) = holding(&[])?;
    let before = device_result(gadget.memory())?;
    device_result(gadget.hang())?;
    thread::sleep(LONG_SILENCE);
    device_result(gadget.wake())?;
    let awake = wait_for(
        || {
            gadget
                .memory()
                .is_ok_and(|memory| memory.maps > before.maps + ENOUGH_MAPS)
        },
        "maps after it woke",
    );
    let after = device_result(gadget.memory())?;
    if let Err(why) = awake {
        let ended = running.interrupt()?;
        return Err(format!(
            "{why}: it held {before:?}, then {after:?}: the last frames {:?}, {:?}",
            ended.lines.iter().rev().skip(1).take(2).collect::<Vec<_>>(),
            ended.summary()?
        ));
    }
    if after.line < before.line || after.latched & Fault::LinkLost.bit() == 0 {
        return Err(format!("it held {before:?}, then {after:?}"));
    }
    let ended = running.interrupt()?;
    sound(&ended)?;
    met(&ended, 0.0, 0.0)?;
    let silent = ended
        .lines
        .iter()
        .filter(|line| line["faults"].to_string().contains("NO STATUS"));
    let (silent, lost) = (silent.count(), ended.number("/link_packets_lost")?);
    if silent == 0 {
        return Err(format!("nobody noticed: {:?}", ended.summary()?));
    }
    Ok(format!(
        "{silent} frames reported that it is silent, {lost} packets not taken, the line held, then answered again"
    ))
}

pub(super) fn crashes() -> Result<String, String> {
    let (mut gadget, mut running) = holding(&[])?;
    let before = device_result(gadget.memory())?;
    device_result(gadget.crash())?;
    running.until_it_says(&["is gone"], PATIENCE)?;
    device_result(gadget.restart())?;
    let back = back(&gadget, &mut running)?;
    wait_for(
        || {
            gadget
                .memory()
                .is_ok_and(|memory| memory.starts == before.starts + 1 && memory.maps > ENOUGH_MAPS)
        },
        "maps after the restart",
    )?;
    let after = device_result(gadget.memory())?;
    if after.line < before.line || after.latched & Fault::WatchdogReset.bit() == 0 {
        return Err(format!("it held {before:?}, then {after:?}"));
    }
    let ended = running.interrupt()?;
    sound(&ended)?;
    met(&ended, 1.0, 1.0)?;
    let summary = back_in_time(&[back])?;
    Ok(format!("{summary}, met anew, the line kept"))
}

pub(super) fn host_killed() -> Result<String, String> {
    let file = "/tmp/usb.mcap";
    let (gadget, running) = holding(&["--record", file])?;
    thread::sleep(LONG_SILENCE);
    let frames = running.kill()?.lines.len();
    let before = device_result(gadget.memory())?;
    thread::sleep(LONG_SILENCE);
    let after = device_result(gadget.memory())?;
    if after.line < before.line || after.latched & Fault::LinkLost.bit() == 0 {
        return Err(format!("it held {before:?}, then {after:?}"));
    }
    let exported = run(&["export", file, "--out", "/tmp/usb"])?;
    exported.expect(WITH_LOSS, &["cut short"])?;
    // The one that comes next finds the device as it was left.
    let next = played(&run(&scene("usb"))?)?;
    Ok(format!(
        "after {frames} frames: the line, {:.2} N, was {:.2} N {} s later, the file opens; the next run: {next}",
        f64::from(before.line) / 4096.0,
        f64::from(after.line) / 4096.0,
        LONG_SILENCE.as_secs()
    ))
}
