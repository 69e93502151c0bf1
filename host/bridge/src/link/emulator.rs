//! The unmodified firmware image in the emulator, a program of its own that is driven over its standard input and
//! output (the format stands in `tests/emulator/README.md`). Packets travel over the emulated UART as COBS frames,
//! in virtual time.

use std::env;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};

use super::{Link, LinkError};

const NAME: &str = "emulator";
const MAGIC: [u8; 8] = *b"GRIPEMU\0";
const VERSION: u32 = 1;
const RUN: u8 = 1;

/// Where the program and the image are looked for besides the environment: beside the build that this program is
/// part of (`target/<profile>/gripline`), where `cargo xtask emulator` puts them.
const FOLDER: &str = "gripline";
/// (environment variable, file name).
const PROGRAM: (&str, &str) = ("GRIPLINE_EMULATOR", "gripline-emulator");
const IMAGE: (&str, &str) = ("GRIPLINE_IMAGE", "firmware-stm32f427vi.elf");

/// An emulated microcontroller.
#[derive(Debug)]
pub struct EmulatorLink {
    process: Child,
    to: ChildStdin,
    from: ChildStdout,
    outgoing: Vec<u8>,
    decoder: CobsDecoder,
    now_us: u64,
    dac_code: u16,
}

impl EmulatorLink {
    /// Starts the emulator with the firmware image.
    ///
    /// # Errors
    /// [`LinkError`] when program or image are not there, or the program does not answer as expected.
    pub fn spawn() -> Result<Self, LinkError> {
        let (program, image) = (locate(PROGRAM)?, locate(IMAGE)?);
        let mut process = Command::new(&program)
            .arg("--image")
            .arg(&image)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| broken(format!("{} could not be started: {error}", program.display())))?;
        let (Some(to), Some(mut from)) = (process.stdin.take(), process.stdout.take()) else {
            return Err(broken("no pipes to the emulator"));
        };
        let magic: [u8; 8] = read(&mut from)?;
        let version = u32::from_le_bytes(read(&mut from)?);
        if (magic, version) != (MAGIC, VERSION) {
            return Err(broken(format!(
                "pipe format {version}, expected {VERSION}: rebuild the emulator with `cargo xtask emulator`"
            )));
        }
        let decoder = CobsDecoder::new();
        Ok(Self {
            process,
            to,
            from,
            outgoing: Vec::new(),
            decoder,
            now_us: 0,
            dac_code: 0,
        })
    }
}

impl Link for EmulatorLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        self.outgoing.extend_from_slice(&frame[..length]);
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let advance_ns = until_us.saturating_sub(self.now_us) * 1_000;
        self.now_us = until_us.max(self.now_us);
        let mut request = vec![RUN];
        request.extend(advance_ns.to_le_bytes());
        request.extend((self.outgoing.len() as u32).to_le_bytes());
        request.append(&mut self.outgoing);
        self.to
            .write_all(&request)
            .and_then(|()| self.to.flush())
            .map_err(ended)?;

        let _now_ns: [u8; 8] = read(&mut self.from)?;
        let _instructions: [u8; 8] = read(&mut self.from)?;
        let _resets: [u8; 4] = read(&mut self.from)?;
        self.dac_code = u16::from_le_bytes(read(&mut self.from)?);
        let length = u32::from_le_bytes(read(&mut self.from)?);
        let mut bytes = vec![0; length as usize];
        self.from.read_exact(&mut bytes).map_err(ended)?;
        let writes = u32::from_le_bytes(read(&mut self.from)?);
        let mut dac_writes = vec![0; writes as usize * 10];
        self.from.read_exact(&mut dac_writes).map_err(ended)?;
        for byte in bytes {
            if let Some(Frame::Packet(packet)) = self.decoder.push(byte) {
                received(packet);
            }
        }
        Ok(())
    }

    fn name(&self) -> String {
        "emulated microcontroller (STM32F427, unmodified image)".to_owned()
    }

    fn line_code(&self) -> Option<u16> {
        Some(self.dac_code)
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
