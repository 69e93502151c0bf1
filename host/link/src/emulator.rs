//! The unmodified firmware image in the emulator, a program of its own that is driven over its standard input and
//! output ([`gripline_emulator_wire`]). Packets travel in virtual time, over the emulated USB as
//! they are or over the emulated UART as COBS frames.

use std::env;
use std::ffi::OsStr;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

pub use gripline_emulator_wire::{
    Cable, ControlOutcome, ControlTransfer, Disturbance, FaultInjection, LineWiring, LineWrite, Setup,
};
use gripline_emulator_wire::{Reply, Request, UsbState, WireError, read_greeting};
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};

use crate::link::{Link, LinkError};

const NAME: &str = "emulator";
/// How long the emulated host may take to make the device ready, and how often this is checked, µs: plugging in and two resets take
/// 160 ms.
const ENUMERATION_US: u64 = 2_000_000;
const ENUMERATION_STEP_US: u64 = 10_000;

/// Where the program and the image are looked for besides the environment: beside the build that this program is
/// part of (`target/<profile>/gripline`), where `cargo xtask emulator` puts them.
const FOLDER: &str = "gripline";
/// (environment variable, file name).
const PROGRAM: (&str, &str) = ("GRIPLINE_EMULATOR", "gripline-emulator");
const IMAGE: (&str, &str) = ("GRIPLINE_IMAGE", "firmware-stm32f427vi.elf");

/// The transport to the emulated microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// Full-speed USB, behind a host of the emulator's own.
    #[default]
    Usb,
    /// The UART at the firmware's baud rate; no USB cable is plugged in.
    Uart,
}

/// An emulated microcontroller.
#[derive(Debug)]
pub struct EmulatorLink {
    process: Child,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
    transport: Transport,
    /// The inputs of the next run.
    next: Request,
    decoder: CobsDecoder,
    now_us: u64,
    /// The last reply; its lists are emptied.
    now: Reply,
    line_writes: Vec<LineWrite>,
    transfers: Vec<ControlTransfer>,
    resets_ns: Vec<u64>,
}

impl EmulatorLink {
    /// Starts the emulator with the firmware image; over USB, waits until its device is ready.
    ///
    /// # Errors
    /// [`LinkError`] when program or image are not there, the program does not answer as expected, or the device
    /// does not enumerate.
    pub fn spawn(transport: Transport) -> Result<Self, LinkError> {
        Self::spawn_with_settings(transport, None)
    }

    /// The same with a file that keeps the microcontroller's settings while the power is off; it need not exist yet.
    ///
    /// # Errors
    /// As [`Self::spawn`].
    pub fn spawn_with_settings(transport: Transport, settings: Option<&Path>) -> Result<Self, LinkError> {
        let (program, image) = (locate(PROGRAM)?, locate(IMAGE)?);
        let kept = settings.map(|path| [OsStr::new("--settings"), path.as_os_str()]);
        let mut process = Command::new(&program)
            .arg("--image")
            .arg(&image)
            .args(kept.iter().flatten())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| broken(format!("{} could not be started: {error}", program.display())))?;
        let (Some(to), Some(from)) = (process.stdin.take(), process.stdout.take()) else {
            return Err(broken("no pipes to the emulator"));
        };
        let mut from = BufReader::new(from);
        read_greeting(&mut from).map_err(ended)?;
        let mut link = Self {
            process,
            to: BufWriter::new(to),
            from,
            transport,
            next: Request::default(),
            decoder: CobsDecoder::new(),
            now_us: 0,
            now: Reply::default(),
            line_writes: Vec::new(),
            transfers: Vec::new(),
            resets_ns: Vec::new(),
        };
        if transport == Transport::Usb {
            link.set_cable(Cable::In);
            link.enumerate()?;
            // Time counts from where a session can begin.
            link.now_us = 0;
        }
        Ok(link)
    }

    fn enumerate(&mut self) -> Result<(), LinkError> {
        while !self.is_configured() {
            if self.now_us >= ENUMERATION_US {
                return Err(broken(format!(
                    "the USB device did not enumerate within {} s, expected it to; look at its log",
                    ENUMERATION_US / 1_000_000
                )));
            }
            self.run_until(self.now_us + ENUMERATION_STEP_US, &mut |_| {})?;
        }
        Ok(())
    }

    /// Plugs the USB cable in or out, or suspends the bus, from the next run on.
    pub fn set_cable(&mut self, cable: Cable) {
        self.next.cable = cable;
    }

    /// Has the emulator's USB host make a control transfer that reads or has no data, from the next run on.
    pub fn control(&mut self, setup: Setup) {
        self.next.usb_controls.push((setup, Vec::new()));
    }

    /// Every completed control transfer, including those of enumerations.
    #[must_use]
    pub fn transfers(&self) -> &[ControlTransfer] {
        &self.transfers
    }

    /// Whether the USB host has set the device's configuration and the bus is awake.
    #[must_use]
    pub fn is_configured(&self) -> bool {
        self.now.usb_state == UsbState::Configured
    }

    /// How often the USB host has made the device ready.
    #[must_use]
    pub fn enumerations(&self) -> u32 {
        self.now.usb_enumerations
    }

    /// USB packets that the firmware has not taken yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.now.usb_waiting as usize + self.next.usb_packets.len()
    }

    /// Virtual time since power-on, nanoseconds: the clock of [`LineWrite`] and of the restarts.
    #[must_use]
    pub fn powered_ns(&self) -> u64 {
        self.now.now_ns
    }

    /// Restarts of the microcontroller since power-on.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.now.resets
    }

    /// When those restarts happened: virtual nanoseconds since power-on.
    #[must_use]
    pub fn resets_ns(&self) -> &[u64] {
        &self.resets_ns
    }

    /// From the next run on, injects a fault into the instruction that next touches `address`, and with it into whatever part of
    /// the program that belongs to, until a reset.
    pub fn inject_fault(&mut self, fault: FaultInjection, address: u32) {
        self.next.fault = Some((fault, address));
    }

    /// Disturbs the board from outside, from the next run on.
    pub fn disturb(&mut self, disturbance: Disturbance) {
        self.next.disturbances.push(disturbance);
    }

    /// The level of the board's fault output: high (true) means no fault.
    #[must_use]
    pub fn fault_output(&self) -> bool {
        self.now.fault_output
    }

    /// Every code on the grip-force line since power-on.
    #[must_use]
    pub fn line_writes(&self) -> &[LineWrite] {
        &self.line_writes
    }

    fn exchange(&mut self, advance_ns: u64) -> Result<Reply, WireError> {
        let cable = self.next.cable;
        let request = std::mem::take(&mut self.next);
        self.next.cable = cable;
        Request {
            advance_ns,
            ..request
        }
        .write(&mut self.to)?;
        Reply::read(&mut self.from)
    }
}

impl Link for EmulatorLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        match self.transport {
            Transport::Usb => self.next.usb_packets.push(packet.to_vec()),
            Transport::Uart => {
                let mut frame = [0; FRAME_MAX];
                let length = encode_packet(packet, &mut frame);
                self.next.uart_bytes.extend_from_slice(&frame[..length]);
            }
        }
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let advance_ns = until_us.saturating_sub(self.now_us) * 1_000;
        self.now_us = until_us.max(self.now_us);
        let mut reply = self.exchange(advance_ns).map_err(ended)?;
        for packet in reply.usb_packets.drain(..) {
            received(&packet.bytes);
        }
        for byte in reply.uart_bytes.drain(..) {
            if let Some(Frame::Packet(packet)) = self.decoder.push(byte) {
                received(packet);
            }
        }
        self.line_writes.append(&mut reply.line_writes);
        self.transfers.append(&mut reply.usb_transfers);
        self.resets_ns.append(&mut reply.resets_ns);
        self.now = reply;
        Ok(())
    }

    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn name(&self) -> String {
        let transport = match self.transport {
            Transport::Usb => "USB",
            Transport::Uart => "UART",
        };
        format!("emulated microcontroller over {transport} (STM32F427, unmodified image)")
    }

    fn line_code(&self) -> Option<u16> {
        Some(self.now.dac_code)
    }
}

impl Drop for EmulatorLink {
    fn drop(&mut self) {
        // It has nothing to save; a process that is already gone is as good.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn locate((variable, file): (&str, &str)) -> Result<PathBuf, LinkError> {
    if let Some(path) = env::var_os(variable).map(PathBuf::from) {
        return if path.is_file() {
            Ok(path)
        } else {
            Err(missing(variable, &path))
        };
    }
    let executable = env::current_exe().unwrap_or_default();
    let beside = executable
        .ancestors()
        .skip(1)
        .map(|folder| folder.join(FOLDER).join(file));
    let here = PathBuf::from("target").join(FOLDER).join(file);
    beside
        .chain([here.clone()])
        .find(|path| path.is_file())
        .ok_or_else(|| missing(variable, &here))
}

fn missing(variable: &str, path: &Path) -> LinkError {
    LinkError::Missing {
        link: NAME.to_owned(),
        found: format!("no file {}", path.display()),
        advice: format!("build it with `cargo xtask emulator`, or set {variable}"),
    }
}

fn broken(found: impl Into<String>) -> LinkError {
    LinkError::Broken {
        link: NAME.to_owned(),
        found: found.into(),
    }
}

fn ended(error: WireError) -> LinkError {
    broken(match error {
        WireError::Pipe(error) => {
            format!("the emulator ended, expected it to answer ({error}); its reason stands above")
        }
        other => other.to_string(),
    })
}
