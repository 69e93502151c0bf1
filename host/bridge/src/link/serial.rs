//! A real microcontroller on a serial port: COBS frames at 921,600 baud, 8N1. The port is opened for this program
//! alone.

use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use serialport::SerialPort;

use super::{Link, LinkError};

/// The firmware's baud rate.
const BAUD: u32 = 921_600;
/// How long one read waits, so that the end of the time slice is met within a millisecond.
const READ_WAIT: Duration = Duration::from_millis(1);

/// A serial port.
pub struct SerialLink {
    path: String,
    port: Box<dyn SerialPort>,
    decoder: CobsDecoder,
    start: Instant,
}

impl SerialLink {
    /// Opens the port.
    ///
    /// # Errors
    /// [`LinkError`] when there is no such port or another program has it.
    pub fn open(path: &str) -> Result<Self, LinkError> {
        let port = serialport::new(path, BAUD)
            .timeout(READ_WAIT)
            .open()
            .map_err(|error| open_error(path, &error))?;
        Ok(Self {
            path: path.to_owned(),
            port,
            decoder: CobsDecoder::new(),
            start: Instant::now(),
        })
    }

    fn broken(&self, error: &std::io::Error) -> LinkError {
        LinkError::Broken {
            link: format!("serial port {}", self.path),
            found: format!("{error}; expected it to stay open, check cable and power"),
        }
    }
}

fn open_error(path: &str, error: &serialport::Error) -> LinkError {
    let link = format!("serial port {path}");
    let ports = || {
        let names: Vec<_> = serialport::available_ports()
            .unwrap_or_default()
            .into_iter()
            .map(|port| port.port_name)
            .collect();
        if names.is_empty() {
            "no serial port is there".to_owned()
        } else {
            format!("found {}", names.join(", "))
        }
    };
    match error.kind() {
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => LinkError::Broken {
            link,
            found: "permission denied, expected to be allowed to open it; join its group (often `dialout`)"
                .to_owned(),
        },
        // The library reports a port that exists but is locked by another program as "no device".
        _ if std::path::Path::new(path).exists() => LinkError::Busy {
            link,
            found: error.to_string(),
        },
        _ => LinkError::Missing {
            link,
            found: ports(),
            advice: "check --mcu serial:PORT, cable and power".to_owned(),
        },
    }
}

impl Link for SerialLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        self.port
            .write_all(&frame[..length])
            .map_err(|error| self.broken(&error))
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let until = self.start + Duration::from_micros(until_us);
        let mut buffer = [0; 4096];
        loop {
            match self.port.read(&mut buffer) {
                Ok(length) => {
                    for &byte in &buffer[..length] {
                        if let Some(Frame::Packet(packet)) = self.decoder.push(byte) {
                            received(packet);
                        }
                    }
                }
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
                    ) => {}
                Err(error) => return Err(self.broken(&error)),
            }
            if Instant::now() >= until {
                return Ok(());
            }
        }
    }

    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }

    fn name(&self) -> String {
        format!("microcontroller on serial port {}", self.path)
    }
}
