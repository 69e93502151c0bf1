//! The virtual machine itself: file systems, kernel modules, plugging and unplugging.

use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::process::Command;

use nix::kmod::{ModuleInitFlags, finit_module};
use nix::mount::{MsFlags, mount};
use nix::sys::reboot::{RebootMode, reboot};

/// Modules in the order in which they are to be loaded, one a line: file name, then parameters. Written by the host.
const MODULES: &str = "/modules/order";
/// The virtual camera's place on its bus.
const CAMERA: &str = "vivid.0";
const CAMERA_DRIVER: &str = "/sys/bus/platform/drivers/vivid";
/// Where devices on USB are made.
pub(crate) const GADGETS: &str = "/sys/kernel/config/usb_gadget";
/// The busybox of the image, for the one thing that has no system call: making a file system.
const BUSYBOX: &str = "/bin/busybox";

/// Where the slow disk is mounted.
pub(crate) const SLOW_DISK: &str = "/slow";
/// Where the small disk is mounted.
pub(crate) const SMALL_DISK: &str = "/small";

/// Mounts what a machine has and loads the modules.
pub(crate) fn bring_up() -> io::Result<()> {
    for (kind, at) in [
        ("proc", "/proc"),
        ("sysfs", "/sys"),
        ("devtmpfs", "/dev"),
        ("tmpfs", "/tmp"),
    ] {
        mount_at(kind, kind, at, "", MsFlags::empty())?;
    }
    load_modules()
}

/// Loads the modules, and mounts the folder in which devices are made.
pub(crate) fn load_modules() -> io::Result<()> {
    for line in fs::read_to_string(MODULES)?.lines() {
        let (file, parameters) = line.split_once(' ').unwrap_or((line, ""));
        let parameters = std::ffi::CString::new(parameters)?;
        finit_module(
            File::open(Path::new("/modules").join(file))?,
            &parameters,
            ModuleInitFlags::empty(),
        )
        .map_err(|error| io::Error::other(format!("module {file}: {error}")))?;
    }
    if Path::new(GADGETS).exists() {
        // systemd was faster.
        return Ok(());
    }
    mount_at("configfs", "configfs", "/sys/kernel/config", "", MsFlags::empty())
}

/// Mounts, and makes the folder for it.
pub(crate) fn mount_at(kind: &str, what: &str, at: &str, options: &str, flags: MsFlags) -> io::Result<()> {
    fs::create_dir_all(at)?;
    mount(Some(what), at, Some(kind), flags, Some(options))
        .map_err(|error| io::Error::other(format!("{kind} at {at}: {error}")))
}

/// A disk of 8 MB.
pub(crate) fn mount_small_disk() -> io::Result<()> {
    mount_at("tmpfs", "small", SMALL_DISK, "size=8m", MsFlags::empty())
}

/// A disk that takes 200 ms for every block that it is given, and keeps nothing back in memory.
pub(crate) fn mount_slow_disk() -> io::Result<()> {
    let disk = Path::new("/sys/kernel/config/nullb/slow");
    fs::create_dir(disk)?;
    for (name, value) in [
        ("memory_backed", "1"),
        // MB.
        ("size", "16"),
        // Completes by a timer, after this many nanoseconds.
        ("irqmode", "2"),
        ("completion_nsec", "200000000"),
        ("power", "1"),
    ] {
        fs::write(disk.join(name), value)
            .map_err(|error| io::Error::other(format!("nullb {name}: {error}")))?;
    }
    // Newer kernels call it by its folder, older ones by a number.
    let index = fs::read_to_string(disk.join("index"))?;
    let names = ["/dev/slow".to_owned(), format!("/dev/nullb{}", index.trim())];
    let device = names
        .into_iter()
        .find(|name| Path::new(name).exists())
        .ok_or_else(|| io::Error::other("the slow disk has no device file"))?;
    let made = Command::new(BUSYBOX).args(["mke2fs", "-F", &device]).output()?;
    if !made.status.success() {
        return Err(io::Error::other(format!(
            "mke2fs {device}: {}",
            String::from_utf8_lossy(&made.stderr)
        )));
    }
    mount_at("ext4", &device, SLOW_DISK, "", MsFlags::MS_SYNCHRONOUS)
}

/// Pulls the virtual camera's plug.
pub(crate) fn unplug_camera() -> io::Result<()> {
    fs::write(format!("{CAMERA_DRIVER}/unbind"), CAMERA)
}

/// Plugs it in again.
pub(crate) fn plug_camera() -> io::Result<()> {
    fs::write(format!("{CAMERA_DRIVER}/bind"), CAMERA)
}

/// The end of the kernel's log, for whoever looks for the cause of a failure.
pub(crate) fn last_words_of_the_kernel() -> String {
    let log = Command::new(BUSYBOX).arg("dmesg").output();
    let log = log
        .map(|log| String::from_utf8_lossy(&log.stdout).into_owned())
        .unwrap_or_default();
    let lines: Vec<&str> = log.lines().collect();
    lines[lines.len().saturating_sub(12)..].join("\n")
}

/// Ends the machine.
pub(crate) fn power_off() -> ! {
    match reboot(RebootMode::RB_POWER_OFF) {
        Ok(never) => match never {},
        Err(error) => panic!("power off: {error}"),
    }
}
