//! The checks, in order: what a lab does to a camera, a microcontroller, a program and a disk, and what has to come of it.
//! Lines on the console: `VM begins NAME`, `VM ok NAME: WHAT (S s)`, `VM FAILED NAME: WHY`, and `VM end` last.
//! The processor is emulated, at a tenth of its speed or less: nothing here judges speed but the return of a plug, and what takes a number of frames
//! waits for frames, not for time.

mod camera;
mod disk;
mod microcontroller;
mod package;
mod wait;

use std::time::Instant;

use crate::machine;

/// From the kernel's command line: only checks with this in their name are wanted.
const ONLY: &str = "GRIPLINE_ONLY";
type Check = fn() -> Result<String, String>;

const CHECKS: [(&str, Check); 16] = [
    ("camera, YUYV", || camera::pictures("yuyv")),
    ("camera, grey", || camera::pictures("grey")),
    ("camera without the wanted format", camera::no_format),
    ("camera: gain fixed, exposure it does not have", camera::controls),
    ("camera that is not there, or not allowed", camera::missing),
    ("camera unplugged and plugged in", camera::replugged),
    ("killed while recording", disk::killed),
    ("full disk", disk::full),
    ("slow disk", disk::slow),
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
        if !tell(name, check) {
            println!("{}", machine::last_words_of_the_kernel());
        }
    }
    println!("VM end");
}

/// On a machine that systemd has brought up: the Debian package.
pub(crate) fn run_package() {
    if let Err(error) = machine::load_modules() {
        println!("VM FAILED machine: {error}");
        println!("VM end");
        return;
    }
    println!("VM ok machine: up after {}", uptime());
    let mut lab = package::Lab::new();
    for (name, check) in package::CHECKS {
        // Each builds on the one before.
        if !tell(name, || check(&mut lab)) {
            break;
        }
    }
    println!("VM end");
}

/// Runs a check and says what came of it; whether it was right.
fn tell(name: &str, check: impl FnOnce() -> Result<String, String>) -> bool {
    println!("VM begins {name}");
    let started = Instant::now();
    match check() {
        Ok(what) => {
            println!("VM ok {name}: {what} ({:.1} s)", started.elapsed().as_secs_f64());
            true
        }
        Err(why) => {
            println!("VM FAILED {name}: {}", why.replace('\n', " | "));
            false
        }
    }
}

fn uptime() -> String {
    let text = std::fs::read_to_string("/proc/uptime").unwrap_or_default();
    format!("{} s", text.split(' ').next().unwrap_or("?"))
}
