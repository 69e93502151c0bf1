//! Microcontrollers on USB that are none: a gadget of the kernel's on a device controller that is its own host (dummy_hcd),
//! and behind it our program ([`crate::device`]) as a process of its own, which may be hung, killed and unplugged.

use std::fs;
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::mount::{MsFlags, umount};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::device::Memory;
use crate::machine::{GADGETS, mount_at};

/// This program, which is the device's too.
const PROGRAM: &str = "/init";
/// How long a program may take to describe itself.
const PATIENCE: Duration = Duration::from_secs(10);

/// As the firmware's binary describes itself.
const VENDOR: &str = "0x1209";
const PRODUCT: &str = "0x0001";
const ENGLISH: &str = "strings/0x409";
const CONFIGURATION: &str = "configs/c.1";
const FUNCTION_LINK: &str = "configs/c.1/ffs";
const SELF_POWERED: &str = "0xc0";
const MAX_POWER_MA: &str = "100";

/// How fast a device is.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Speed {
    /// As the microcontroller: bulk packets of 64 bytes.
    Full,
    /// Bulk packets of 512 bytes.
    High,
}

/// One device, plugged into the socket of its number.
pub(crate) struct Gadget {
    folder: PathBuf,
    /// Where its endpoints are.
    endpoints: PathBuf,
    memory: PathBuf,
    socket: String,
    /// Where the system that it is plugged into says which configuration it has.
    configuration: PathBuf,
    program: Child,
}

impl Gadget {
    /// Starts a device with this serial number, and plugs it in.
    pub(crate) fn new(socket: u8, serial: &str, speed: Speed) -> io::Result<Self> {
        let name = format!("device{socket}");
        let folder = Path::new(GADGETS).join(&name);
        let function = folder.join("functions").join(format!("ffs.{name}"));
        let configuration = folder.join(CONFIGURATION);
        for made in [&folder, &folder.join(ENGLISH), &configuration, &function] {
            fs::create_dir(made)?;
        }
        let speed = match speed {
            Speed::Full => "full-speed",
            Speed::High => "high-speed",
        };
        for (attribute, value) in [
            ("idVendor", VENDOR),
            ("idProduct", PRODUCT),
            ("max_speed", speed),
            ("strings/0x409/manufacturer", "Gripline"),
            ("strings/0x409/product", "Gripline MCU"),
            ("strings/0x409/serialnumber", serial),
            ("configs/c.1/bmAttributes", SELF_POWERED),
            ("configs/c.1/MaxPower", MAX_POWER_MA),
        ] {
            write(&folder.join(attribute), value)?;
        }
        symlink(&function, folder.join(FUNCTION_LINK))?;
        let endpoints = Path::new("/dev").join(&name);
        mount_at(
            "functionfs",
            &name,
            &endpoints.display().to_string(),
            "",
            MsFlags::empty(),
        )?;
        let memory = Path::new("/tmp").join(&name);
        let program = start(&endpoints, &memory)?;
        let mut gadget = Self {
            folder,
            endpoints,
            memory,
            socket: format!("dummy_udc.{socket}"),
            // There are no other buses, and each has one port.
            configuration: format!("/sys/bus/usb/devices/{}-1/bConfigurationValue", socket + 1).into(),
            program,
        };
        gadget.plug()?;
        gadget.arrive()?;
        Ok(gadget)
    }

    /// Plugs it in, as soon as its program has described itself.
    pub(crate) fn plug(&mut self) -> io::Result<()> {
        let start = Instant::now();
        while !self.endpoints.join("ep2").exists() {
            if let Some(status) = self.program.try_wait()? {
                return Err(io::Error::other(format!("the device's program ended: {status}")));
            }
            if start.elapsed() > PATIENCE {
                return Err(io::Error::other("the device's program does not describe itself"));
            }
            thread::sleep(Duration::from_millis(5));
        }
        write(&self.folder.join("UDC"), &self.socket)
    }

    /// Pulls its plug. Its program goes on.
    pub(crate) fn unplug(&self) -> io::Result<()> {
        write(&self.folder.join("UDC"), "\n")
    }

    /// Waits until the system has seen it and made it usable.
    pub(crate) fn arrive(&self) -> io::Result<()> {
        let is_configured = || fs::read_to_string(&self.configuration).is_ok_and(|value| value.trim() == "1");
        if comes(is_configured) {
            Ok(())
        } else {
            Err(io::Error::other("the system does not see it"))
        }
    }

    /// Takes its configuration away, as where a hub has not the power for it: it is attached, and cannot be used.
    pub(crate) fn unconfigure(&self) -> io::Result<()> {
        write(&self.configuration, "0")
    }

    /// Its program stands still, with the plug in.
    pub(crate) fn hang(&self) -> io::Result<()> {
        self.signal(Signal::SIGSTOP)
    }

    /// It goes on.
    pub(crate) fn wake(&self) -> io::Result<()> {
        self.signal(Signal::SIGCONT)
    }

    /// Its program dies at once; with it the device is gone from the bus.
    pub(crate) fn crash(&mut self) -> io::Result<()> {
        self.program.kill()?;
        self.program.wait().map(drop)
    }

    /// Starts its program again, and plugs it in.
    pub(crate) fn restart(&mut self) -> io::Result<()> {
        self.program = start(&self.endpoints, &self.memory)?;
        self.plug()
    }

    /// What it has to say of itself.
    pub(crate) fn memory(&self) -> io::Result<Memory> {
        Memory::read(&self.memory).ok_or_else(|| io::Error::other("the device has no memory"))
    }

    fn signal(&self, signal: Signal) -> io::Result<()> {
        Ok(kill(Pid::from_raw(self.program.id() as i32), signal)?)
    }
}

impl Drop for Gadget {
    /// A check that failed leaves no device behind for the next one. The order is the kernel's.
    fn drop(&mut self) {
        let _ = self.unplug();
        comes(|| !self.configuration.exists());
        let _ = self.crash();
        let _ = fs::remove_file(self.folder.join(FUNCTION_LINK));
        let _ = umount(&self.endpoints);
        let made = fs::read_dir(self.folder.join("functions"))
            .into_iter()
            .flatten()
            .flatten();
        for function in made {
            let _ = fs::remove_dir(function.path());
        }
        for folder in [CONFIGURATION, ENGLISH, ""] {
            let _ = fs::remove_dir(self.folder.join(folder));
        }
        let _ = fs::remove_file(&self.memory);
    }
}

/// Waits for it, so long; says whether it came.
fn comes(is_there: impl Fn() -> bool) -> bool {
    let start = Instant::now();
    while !is_there() {
        if start.elapsed() > PATIENCE {
            return false;
        }
        thread::sleep(Duration::from_millis(5));
    }
    true
}

fn start(endpoints: &Path, memory: &Path) -> io::Result<Child> {
    Command::new(PROGRAM)
        .arg("device")
        .args([endpoints, memory])
        .stdin(Stdio::null())
        .spawn()
}

fn write(path: &Path, value: &str) -> io::Result<()> {
    fs::write(path, value).map_err(|error| io::Error::other(format!("{}: {error}", path.display())))
}
