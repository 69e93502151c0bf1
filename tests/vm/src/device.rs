//! The microcontroller's program behind a functionfs endpoint: the firmware library, a tick a millisecond, and a page of memory
//! that survives its death as the chip's does a reset. Every packet is one transfer, as in the firmware's binary.
//! Times in µs since the start of this process. Limits: no flash, so settings are not stored; no line but the memory's.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use gripline_firmware::{Action, Device, GripForce, ResetCause, Start};
use gripline_protocol::message::GripMode;
use gripline_protocol::{PACKET_MAX, Packet};
use nix::libc;

use crate::descriptors::{descriptors, strings};

const TICK: Duration = Duration::from_millis(1);
/// Between two tries while nobody has configured the device.
const PAUSE: Duration = Duration::from_millis(5);
/// Bytes of one event of the control endpoint, and where in it its kind stands.
const EVENT_BYTES: usize = 12;
const EVENT_KIND: usize = 8;
const SETUP: u8 = 4;
/// In a request's first byte: the device is to answer with data.
const TO_HOST: u8 = 0x80;

/// What survives the program, in a file: its line, and what whoever watches wants to know. Numbers in text.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Memory {
    /// How often it started.
    pub starts: u32,
    /// The grip-force line, 1/4096 N.
    pub line: i32,
    /// It holds.
    pub holds: bool,
    /// Faults that stand, and those that wait to be acknowledged.
    pub active: u32,
    pub latched: u32,
    /// Maps that it accepted.
    pub maps: u32,
}

impl Memory {
    /// Reads the file; `None` when there is none.
    pub(crate) fn read(path: &Path) -> Option<Self> {
        let text = fs::read_to_string(path).ok()?;
        let mut words = text.split_whitespace();
        let mut word = || words.next()?.parse::<i64>().ok();
        Some(Self {
            starts: word()? as u32,
            line: word()? as i32,
            holds: word()? != 0,
            active: word()? as u32,
            latched: word()? as u32,
            maps: word()? as u32,
        })
    }

    /// Writes the file in one step: whoever reads finds all of one, and a death leaves the one before. In place, a line that
    /// gets shorter was once read as the beginning of the new one and the end of the old.
    fn write(&self, path: &Path) -> io::Result<()> {
        let new = path.with_extension("new");
        fs::write(&new, self.text())?;
        fs::rename(new, path)
    }

    fn text(&self) -> String {
        let Self {
            starts,
            line,
            holds,
            active,
            latched,
            maps,
        } = self;
        format!("{starts} {line} {} {active} {latched} {maps}", u8::from(*holds))
    }
}

/// The program, and a bell for whoever has something to send.
struct Shared {
    device: Mutex<Device>,
    has_words: Condvar,
    started: Instant,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Device> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now_us(&self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    fn ring(&self, action: Action) {
        if action.transmit {
            self.has_words.notify_one();
        }
    }

    /// The next packet for the host, when there is one within a moment.
    fn next_packet(&self) -> Option<Packet> {
        let mut device = self.lock();
        let packet = device.next_packet();
        if packet.is_some() {
            return packet;
        }
        let waited = self.has_words.wait_timeout(device, PAUSE);
        let (mut device, _) = waited.unwrap_or_else(PoisonError::into_inner);
        device.next_packet()
    }
}

/// `device FOLDER MEMORY`: serves the functionfs mounted at FOLDER until it is killed.
pub(crate) fn main(arguments: &[String]) -> ExitCode {
    let [folder, memory] = arguments else {
        eprintln!("found {} arguments, expected FOLDER MEMORY", arguments.len());
        return ExitCode::from(2);
    };
    match serve(Path::new(folder), Path::new(memory)) {
        Ok(never) => match never {},
        Err(error) => {
            eprintln!("{folder}: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve(folder: &Path, memory: &Path) -> io::Result<std::convert::Infallible> {
    // One that waits for events on the control endpoint keeps the kernel from unplugging the device: this asks.
    let mut control = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(libc::O_NONBLOCK)
        .open(folder.join("ep0"))?;
    control.write_all(&descriptors())?;
    control.write_all(&strings())?;
    let from_host = File::open(folder.join("ep1"))?;
    let to_host = OpenOptions::new().write(true).open(folder.join("ep2"))?;

    let before = Memory::read(memory);
    let starts = before.unwrap_or_default().starts + 1;
    let device = Device::new(Start {
        // Whoever dies here was killed or has crashed, as one whose watchdog bites.
        reset: before.map_or(ResetCause::PowerOn, |_| ResetCause::Watchdog),
        restored_line: before.map(|before| GripForce::from_lsb(before.line)),
        session: starts,
        ..Start::default()
    });
    let shared = Arc::new(Shared {
        device: Mutex::new(device),
        has_words: Condvar::new(),
        started: Instant::now(),
    });
    let (listener, speaker) = (Arc::clone(&shared), Arc::clone(&shared));
    thread::spawn(move || listen(&listener, from_host));
    thread::spawn(move || speak(&speaker, to_host));
    thread::spawn(move || answer_requests(control));
    let mut written = Memory::default();
    loop {
        thread::sleep(TICK);
        let mut device = shared.lock();
        let action = device.tick(shared.now_us());
        if device.program.take_store().is_some() {
            device.program.stored(None);
        }
        let status = device.program.status();
        drop(device);
        shared.ring(action);
        let current = Memory {
            starts,
            line: status.line,
            holds: status.mode == GripMode::Hold,
            active: status.faults,
            latched: status.latched,
            maps: status.maps,
        };
        if current != written {
            current.write(memory)?;
            written = current;
        }
    }
}

/// Packets from the host. An endpoint that nobody has configured waits; one that is torn away fails and waits again.
fn listen(shared: &Shared, mut from_host: File) {
    let mut packet = [0; PACKET_MAX];
    loop {
        match from_host.read(&mut packet) {
            Ok(length) => {
                let now_us = shared.now_us();
                let mut device = shared.lock();
                // The chip's timer goes before any packet. A process that was hung or starved would otherwise take the packet
                // that ended a silence without having noticed the silence.
                let aged = device.tick(now_us);
                let action = device.packet(&packet[..length], now_us);
                drop(device);
                shared.ring(aged);
                shared.ring(action);
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => thread::sleep(PAUSE),
        }
    }
}

/// Packets to the host; what was meant for one that has left is lost.
fn speak(shared: &Shared, mut to_host: File) {
    loop {
        if let Some(packet) = shared.next_packet()
            && to_host.write_all(&packet).is_err()
        {
            thread::sleep(PAUSE);
        }
    }
}

/// There are no requests of ours on the control endpoint: each is refused, by moving no bytes the wrong way.
fn answer_requests(mut control: File) {
    let mut event = [0; EVENT_BYTES];
    loop {
        match control.read(&mut event) {
            Ok(EVENT_BYTES) if event[EVENT_KIND] == SETUP => {
                let _ = if event[0] & TO_HOST != 0 {
                    control.read(&mut [])
                } else {
                    control.write(&[])
                };
            }
            Ok(_) => {}
            Err(_) => thread::sleep(PAUSE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_memory_is_read_as_it_was_written() {
        let memory = Memory {
            starts: 2,
            line: 163_840,
            holds: true,
            active: u32::MAX,
            latched: 1 << 31,
            maps: u32::MAX,
        };
        let file = std::env::temp_dir().join(format!("gripline-vm-memory-{}", std::process::id()));
        memory.write(&file).unwrap();
        assert_eq!(Memory::read(&file), Some(memory));
        fs::write(&file, "1 2").unwrap();
        assert_eq!(Memory::read(&file), None);
        fs::remove_file(file).unwrap();
    }
}
