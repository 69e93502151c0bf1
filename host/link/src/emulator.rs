//! The unmodified firmware image in the emulator, a program of its own that is driven over its standard input and
//! output (the format stands in `tests/emulator/README.md`). Packets travel in virtual time, over the emulated USB as
//! they are or over the emulated UART as COBS frames.

use std::env;
use std::ffi::OsStr;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};

use super::{Link, LinkError};

const NAME: &str = "emulator";
const MAGIC: [u8; 8] = *b"GRIPEMU\0";
const VERSION: u32 = 4;
const RUN: u8 = 1;
/// The number of "configured" among the USB states of a reply.
const CONFIGURED: u8 = 2;
/// How long the emulated host may take to make the device ready, and how often that is looked at, µs: it waits 160 ms
/// for the plug and two resets alone.
const ENUMERATION_US: u64 = 2_000_000;
const ENUMERATION_STEP_US: u64 = 10_000;

/// Where the program and the image are looked for besides the environment: beside the build that this program is
/// part of (`target/<profile>/gripline`), where `cargo xtask emulator` puts them.
const FOLDER: &str = "gripline";
/// (environment variable, file name).
const PROGRAM: (&str, &str) = ("GRIPLINE_EMULATOR", "gripline-emulator");
const IMAGE: (&str, &str) = ("GRIPLINE_IMAGE", "firmware-stm32f427vi.elf");

/// Which of its two transports the emulated microcontroller is spoken to over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// Full-speed USB, behind a host of the emulator's own.
    #[default]
    Usb,
    /// The UART at the firmware's baud rate; no USB cable is plugged in.
    Uart,
}

/// What happens to the emulated USB cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cable {
    /// Pulled out: packets under way are lost.
    Out = 0,
    /// Plugged in.
    In = 1,
    /// Plugged in, with the bus suspended.
    Asleep = 2,
}

/// What may become of the emulated program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mishap {
    /// It loops for ever.
    Hang = 0,
    /// It runs into an undefined instruction.
    Fault = 1,
    /// It panics.
    Panic = 2,
}

/// A control transfer over the emulated USB that is over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ControlTransfer {
    /// What was asked.
    pub setup: [u8; 8],
    /// Whether it went through its status stage.
    pub is_done: bool,
    /// What the device answered, or was written.
    pub data: Vec<u8>,
}

/// A code that appeared on the DAC of the grip-force line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct LineWrite {
    /// Virtual time since power-on, nanoseconds.
    pub at_ns: u64,
    /// The code, 0..=4095.
    pub code: u16,
}

/// An emulated microcontroller.
#[derive(Debug)]
pub struct EmulatorLink {
    process: Child,
    to: ChildStdin,
    from: ChildStdout,
    transport: Transport,
    cable: Cable,
    uart_bytes: Vec<u8>,
    usb_packets: Vec<Vec<u8>>,
    controls: Vec<[u8; 8]>,
    mishap: (Mishap, u32),
    decoder: CobsDecoder,
    now_us: u64,
    now: Reply,
    line_writes: Vec<LineWrite>,
    transfers: Vec<ControlTransfer>,
    resets_ns: Vec<u64>,
}

/// What the emulator's last reply said of the present.
#[derive(Debug, Clone, Copy, Default)]
struct Reply {
    now_ns: u64,
    resets: u32,
    dac_code: u16,
    usb_state: u8,
    usb_enumerations: u32,
    usb_waiting: u32,
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

    /// The same with a file that keeps the microcontroller's settings while the power is off; it need not be there yet.
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
        let (Some(to), Some(mut from)) = (process.stdin.take(), process.stdout.take()) else {
            return Err(broken("no pipes to the emulator"));
        };
        let magic: [u8; 8] = read(&mut from)?;
        let version = read_u32(&mut from)?;
        if (magic, version) != (MAGIC, VERSION) {
            return Err(broken(format!(
                "pipe format {version}, expected {VERSION}: rebuild the emulator with `cargo xtask emulator`"
            )));
        }
        let mut link = Self {
            process,
            to,
            from,
            transport,
            cable: Cable::Out,
            uart_bytes: Vec::new(),
            usb_packets: Vec::new(),
            controls: Vec::new(),
            mishap: (Mishap::Hang, 0),
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
        self.cable = cable;
    }

    /// Has the emulator's USB host make a control transfer that reads or has no data, from the next run on.
    pub fn control(&mut self, setup: [u8; 8]) {
        self.controls.push(setup);
    }

    /// Every control transfer that is over, those of the enumerations among them.
    #[must_use]
    pub fn transfers(&self) -> &[ControlTransfer] {
        &self.transfers
    }

    /// Whether the USB host has set the device's configuration and the bus is awake.
    #[must_use]
    pub fn is_configured(&self) -> bool {
        self.now.usb_state == CONFIGURED
    }

    /// How often the USB host has made the device ready.
    #[must_use]
    pub fn enumerations(&self) -> u32 {
        self.now.usb_enumerations
    }

    /// USB packets that the firmware has not taken yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.now.usb_waiting as usize + self.usb_packets.len()
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

    /// From the next run on, has `mishap` befall the instruction that next touches `address`, and with it whatever program
    /// part it belongs to, until a reset.
    pub fn mishap_at(&mut self, mishap: Mishap, address: u32) {
        self.mishap = (mishap, address);
    }

    /// Every code on the grip-force line since power-on.
    #[must_use]
    pub fn line_writes(&self) -> &[LineWrite] {
        &self.line_writes
    }

    fn request(&mut self, advance_ns: u64) -> io::Result<()> {
        let mut request = vec![RUN];
        request.extend(advance_ns.to_le_bytes());
        request.push(self.cable as u8);
        request.extend((self.uart_bytes.len() as u32).to_le_bytes());
        request.append(&mut self.uart_bytes);
        request.extend((self.usb_packets.len() as u32).to_le_bytes());
        for packet in self.usb_packets.drain(..) {
            request.push(packet.len() as u8);
            request.extend(packet);
        }
        request.extend((self.controls.len() as u32).to_le_bytes());
        for setup in self.controls.drain(..) {
            request.extend(setup);
            request.extend(0_u16.to_le_bytes());
        }
        let (mishap, address) = std::mem::replace(&mut self.mishap, (Mishap::Hang, 0));
        request.push(mishap as u8);
        request.extend(address.to_le_bytes());
        self.to.write_all(&request)?;
        self.to.flush()
    }

    fn reply(&mut self, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let from = &mut self.from;
        self.now.now_ns = read_u64(from)?;
        let _instructions = read_u64(from)?;
        self.now.resets = read_u32(from)?;
        self.now.dac_code = u16::from_le_bytes(read(from)?);
        let length = read_u32(from)? as usize;
        let uart_bytes = read_bytes(from, length)?;
        for _ in 0..read_u32(from)? {
            self.line_writes.push(LineWrite {
                at_ns: read_u64(from)?,
                code: u16::from_le_bytes(read(from)?),
            });
        }
        [self.now.usb_state] = read(from)?;
        self.now.usb_enumerations = read_u32(from)?;
        self.now.usb_waiting = read_u32(from)?;
        for _ in 0..read_u32(from)? {
            let _at_ns = read_u64(from)?;
            let [length] = read(from)?;
            received(&read_bytes(from, length.into())?);
        }
        for _ in 0..read_u32(from)? {
            let _at_ns = read_u64(from)?;
            let setup = read(from)?;
            let [outcome] = read(from)?;
            let length = u16::from_le_bytes(read(from)?);
            self.transfers.push(ControlTransfer {
                setup,
                is_done: outcome == 0,
                data: read_bytes(from, length.into())?,
            });
        }
        for _ in 0..read_u32(from)? {
            self.resets_ns.push(read_u64(from)?);
        }
        for byte in uart_bytes {
            if let Some(Frame::Packet(packet)) = self.decoder.push(byte) {
                received(packet);
            }
        }
        Ok(())
    }
}

impl Link for EmulatorLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        match self.transport {
            Transport::Usb => self.usb_packets.push(packet.to_vec()),
            Transport::Uart => {
                let mut frame = [0; FRAME_MAX];
                let length = encode_packet(packet, &mut frame);
                self.uart_bytes.extend_from_slice(&frame[..length]);
            }
        }
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let advance_ns = until_us.saturating_sub(self.now_us) * 1_000;
        self.now_us = until_us.max(self.now_us);
        self.request(advance_ns).map_err(ended)?;
        self.reply(received)
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

#[expect(clippy::needless_pass_by_value, reason = "the shape that map_err wants")]
fn ended(error: io::Error) -> LinkError {
    broken(format!(
        "the emulator ended, expected it to answer ({error}); its reason stands above"
    ))
}

fn read<const N: usize>(from: &mut impl Read) -> Result<[u8; N], LinkError> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes).map_err(ended)?;
    Ok(bytes)
}

fn read_u32(from: &mut impl Read) -> Result<u32, LinkError> {
    read(from).map(u32::from_le_bytes)
}

fn read_u64(from: &mut impl Read) -> Result<u64, LinkError> {
    read(from).map(u64::from_le_bytes)
}

fn read_bytes(from: &mut impl Read, length: usize) -> Result<Vec<u8>, LinkError> {
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes).map_err(ended)?;
    Ok(bytes)
}
