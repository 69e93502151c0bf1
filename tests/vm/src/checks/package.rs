//! The Debian package on a machine with dpkg, systemd and udev: what somebody who installs it does, in order. The camera shows
//! no fingertip and the microcontroller is the firmware's library on the kernel's USB; the service is the shipped one.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::wait::{CAMERA, wait_for};
use crate::usb::{Gadget, Speed};

/// Written by the host.
const PACKAGE: &str = "/gripline.deb";
const CONFIGURATION: &str = "/etc/gripline/gripline.toml";
const UNIT: &str = "gripline.service";
const SERIAL: &str = "2A0041";
/// Maps that the microcontroller has got when all is well.
const ENOUGH_MAPS: u32 = 30;
/// What the unit says (WatchdogSec), and how long systemd may take to start it again on an emulated processor.
const WATCHDOG: Duration = Duration::from_secs(10);

/// What the checks share: the microcontroller, which stays plugged in.
pub(super) struct Lab {
    gadget: Option<Gadget>,
    /// When the service was ready.
    ready: Instant,
}

type Check = fn(&mut Lab) -> Result<String, String>;

pub(super) const CHECKS: [(&str, Check); 6] = [
    ("package: installed, and nothing runs", |_| installed()),
    ("package: the service may open board and camera", allowed),
    ("package: started with camera and board", started),
    ("package: the loop hangs and is started again", hung),
    ("package: stopped", stopped),
    ("package: removed and purged", |_| removed()),
];

impl Lab {
    pub(super) fn new() -> Self {
        Self {
            gadget: None,
            ready: Instant::now(),
        }
    }

    fn maps(&self) -> u32 {
        let memory = self.gadget.as_ref().and_then(|gadget| gadget.memory().ok());
        memory.unwrap_or_default().maps
    }

    fn gets_maps(&self) -> Result<(), String> {
        let before = self.maps();
        wait_for(
            || self.maps() > before + ENOUGH_MAPS,
            "maps at the microcontroller",
        )
        .map_err(|error| format!("{error}; {}", journal()))
    }
}

/// Runs a program to its end; what it printed.
fn run(program: &str, arguments: &[&str]) -> Result<String, String> {
    let ended = Command::new(program)
        .args(arguments)
        .env("PATH", "/usr/sbin:/usr/bin")
        .env("LC_ALL", "C")
        .output()
        .map_err(|error| format!("{program}: {error}"))?;
    let said = String::from_utf8_lossy(&ended.stdout).trim().to_owned();
    if ended.status.success() {
        return Ok(said);
    }
    let wrong = String::from_utf8_lossy(&ended.stderr).trim().to_owned();
    Err(format!(
        "{program} {}: {}; {said} {wrong}",
        arguments.join(" "),
        ended.status
    ))
}

/// A property of the service.
fn property(name: &str) -> Result<String, String> {
    run("systemctl", &["show", "--value", "-p", name, UNIT])
}

fn journal() -> String {
    run("journalctl", &["-u", UNIT, "-n", "12", "-o", "cat", "--no-pager"]).unwrap_or_default()
}

fn expect(what: &str, found: &str, expected: &str) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!(
        "{what}: found {found:?}, expected {expected:?}; {}",
        journal()
    ))
}

fn installed() -> Result<String, String> {
    run("dpkg", &["--install", PACKAGE])?;
    expect(
        "state of the package",
        &run("dpkg-query", &["-W", "-f", "${Status}", "gripline"])?,
        "install ok installed",
    )?;
    expect("the service", &property("ActiveState")?, "inactive")?;
    expect("the service", &property("UnitFileState")?, "disabled")?;
    let groups = run("id", &["-nG", "gripline"])?;
    for group in ["gripline", "video", "dialout"] {
        if !groups.split(' ').any(|name| name == group) {
            return Err(format!("the user's groups: found {groups}, expected {group} too"));
        }
    }
    let version = run("gripline", &["--version"])?;
    for file in [
        CONFIGURATION,
        "/usr/share/man/man1/gripline-run.1.gz",
        "/usr/share/bash-completion/completions/gripline",
    ] {
        if fs::metadata(file).map_or(0, |about| about.len()) == 0 {
            return Err(format!("{file}: not there, or empty"));
        }
    }
    // What was edited stays when the package comes again.
    let configuration = format!(
        "[camera]\nsource = \"{CAMERA}\"\nframes_per_second = 15.0\n[calibration]\nfile = \"/rest.toml\"\n\
         [network]\narchitecture = \"unet\"\n[link]\nmcu = \"usb\"\n"
    );
    fs::write(CONFIGURATION, &configuration).map_err(|error| error.to_string())?;
    run("dpkg", &["--install", PACKAGE])?;
    let kept = fs::read_to_string(CONFIGURATION).unwrap_or_default();
    expect("the configuration", &kept, &configuration)?;
    Ok(format!(
        "{version}, user in {groups}, neither enabled nor started"
    ))
}

fn allowed(lab: &mut Lab) -> Result<String, String> {
    let plugged = Gadget::new(0, SERIAL, Speed::Full);
    lab.gadget = Some(plugged.map_err(|error| format!("the device: {error}"))?);
    run("udevadm", &["settle"])?;
    let board = board().ok_or("the microcontroller has no file in /dev/bus/usb")?;
    let mut lines = Vec::new();
    for (file, group) in [(board.as_path(), "gripline"), (Path::new(CAMERA), "video")] {
        let about = fs::metadata(file).map_err(|error| format!("{}: {error}", file.display()))?;
        let line = run("getent", &["group", &about.gid().to_string()])?;
        let found = line.split(':').next().unwrap_or_default().to_owned();
        expect(&file.display().to_string(), &found, group)?;
        let rights = about.permissions().mode() & 0o777;
        expect(&file.display().to_string(), &format!("{rights:o}"), "660")?;
        lines.push(format!("{} {group} {rights:o}", file.display()));
    }
    Ok(lines.join(", "))
}

/// The microcontroller's file.
fn board() -> Option<PathBuf> {
    let number = |name: &str| {
        let text = fs::read_to_string(format!("/sys/bus/usb/devices/1-1/{name}")).ok()?;
        text.trim().parse::<u32>().ok()
    };
    let path = format!("/dev/bus/usb/{:03}/{:03}", number("busnum")?, number("devnum")?);
    Some(path.into())
}

fn started(lab: &mut Lab) -> Result<String, String> {
    let start = Instant::now();
    // Returns when the program has said that it is ready.
    run("systemctl", &["start", UNIT]).map_err(|error| format!("{error}; {}", journal()))?;
    let took = start.elapsed();
    lab.ready = Instant::now();
    expect("the service", &property("ActiveState")?, "active")?;
    let pid = property("MainPID")?;
    let about = fs::metadata(format!("/proc/{pid}")).map_err(|error| format!("{pid}: {error}"))?;
    let user = run("id", &["-nu", &about.uid().to_string()])?;
    expect("whose process it is", &user, "gripline")?;
    lab.gets_maps()?;
    Ok(format!(
        "ready after {:.1} s, of user {user}, watchdog {}, {} maps at the board",
        took.as_secs_f64(),
        property("WatchdogUSec")?,
        lab.maps()
    ))
}

fn hung(lab: &mut Lab) -> Result<String, String> {
    // The watchdog is fed: a run that lasts longer than its patience is still the first.
    thread::sleep((WATCHDOG + Duration::from_secs(2)).saturating_sub(lab.ready.elapsed()));
    expect("starts of a loop that turns", &property("NRestarts")?, "0")?;
    let pid: i32 = property("MainPID")?
        .parse()
        .map_err(|_| "no MainPID".to_owned())?;
    kill(Pid::from_raw(pid), Signal::SIGSTOP).map_err(|error| error.to_string())?;
    let start = Instant::now();
    wait_for(
        || property("NRestarts").is_ok_and(|count| count == "1"),
        "another start by the watchdog",
    )
    .map_err(|error| format!("{error}; {}", journal()))?;
    let took = start.elapsed();
    wait_for(
        || property("ActiveState").is_ok_and(|state| state == "active"),
        "the service after the watchdog",
    )?;
    let said = journal();
    lab.gets_maps()?;
    if !said.to_lowercase().contains("watchdog") {
        let all = run("journalctl", &["-n", "40", "-o", "cat", "--no-pager"])?;
        if !all.to_lowercase().contains("watchdog timeout") {
            return Err(format!("no word of a watchdog in the journal: {said}"));
        }
    }
    Ok(format!(
        "started again {:.1} s after it stood still",
        took.as_secs_f64()
    ))
}

fn stopped(lab: &mut Lab) -> Result<String, String> {
    let start = Instant::now();
    run("systemctl", &["stop", UNIT])?;
    let took = start.elapsed();
    expect("the service", &property("ActiveState")?, "inactive")?;
    expect("how it ended", &property("Result")?, "success")?;
    let before = lab.maps();
    thread::sleep(Duration::from_secs(1));
    expect("maps after the end", &lab.maps().to_string(), &before.to_string())?;
    Ok(format!("after {:.1} s, with success", took.as_secs_f64()))
}

fn removed() -> Result<String, String> {
    const LINK: &str = "/etc/systemd/system/multi-user.target.wants/gripline.service";
    run("systemctl", &["enable", "--now", UNIT]).map_err(|error| format!("{error}; {}", journal()))?;
    expect("the service", &property("ActiveState")?, "active")?;
    run("dpkg", &["--remove", "gripline"])?;
    if run("systemctl", &["is-active", UNIT]).is_ok() {
        return Err("the service runs after its removal".to_owned());
    }
    for (path, is_there) in [
        ("/usr/bin/gripline", false),
        (LINK, false),
        (CONFIGURATION, true),
        ("/var/lib/gripline", true),
    ] {
        if fs::symlink_metadata(path).is_ok() != is_there {
            return Err(format!("{path} after the removal: expected there: {is_there}"));
        }
    }
    fs::write("/var/lib/gripline/today.mcap", "a recording").map_err(|error| error.to_string())?;
    run("dpkg", &["--purge", "gripline"])?;
    let left: Vec<&str> = [
        "/etc/gripline",
        "/usr/share/doc/gripline",
        "/usr/lib/sysusers.d/gripline.conf",
        LINK,
    ]
    .into_iter()
    .filter(|path| fs::symlink_metadata(path).is_ok())
    .collect();
    if !left.is_empty() {
        return Err(format!("left behind: {}", left.join(", ")));
    }
    if !Path::new("/var/lib/gripline/today.mcap").exists() {
        return Err("the user's recording is gone".to_owned());
    }
    Ok("program, unit, link and configuration are gone; the recording stayed".to_owned())
}
