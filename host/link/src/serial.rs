//! A real microcontroller on a serial port: COBS frames at 921,600 baud, 8N1. The port is opened for this program
//! alone. Limits: a port that comes back under another name is not found; `/dev/serial/by-id` has names that stay.

use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::time::Duration;

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use serialport::SerialPort;

use super::hot_plug::{Device, DeviceError, Finder};
use crate::error::LinkError;
use crate::patience::SEND_WAIT;

/// The firmware's baud rate.
const BAUD: u32 = 921_600;

/// The port at this path.
pub(super) struct SerialFinder(pub(super) String);

impl Finder for SerialFinder {
    fn find(&mut self) -> Result<Box<dyn Device>, LinkError> {
        let port = serialport::new(&self.0, BAUD)
            .open()
            .map_err(|error| open_error(&self.0, &error))?;
        Ok(Box::new(Serial {
            port,
            decoder: CobsDecoder::new(),
            is_torn: false,
        }))
    }

    fn name(&self) -> String {
        format!("serial port {}", self.0)
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
        _ if Path::new(path).exists() => LinkError::Busy {
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

/// An open port.
struct Serial {
    port: Box<dyn SerialPort>,
    decoder: CobsDecoder,
    /// A frame was not written to its end.
    is_torn: bool,
}

impl Serial {
    fn write(&mut self, bytes: &[u8]) -> Result<(), DeviceError> {
        self.port
            .set_timeout(SEND_WAIT)
            .map_err(|error| DeviceError::Gone(error.to_string()))?;
        self.port.write_all(bytes).map_err(|error| {
            if is_passing(&error) {
                self.is_torn = true;
                DeviceError::Busy
            } else {
                DeviceError::Gone(error.to_string())
            }
        })
    }
}

impl Device for Serial {
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError> {
        if self.is_torn {
            self.write(&[0])?;
            self.is_torn = false;
        }
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        self.write(&frame[..length])
    }

    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError> {
        let gone = |error: &dyn std::fmt::Display| DeviceError::Gone(error.to_string());
        self.port.set_timeout(patience).map_err(|error| gone(&error))?;
        let mut buffer = [0; 4096];
        match self.port.read(&mut buffer) {
            // Something was announced and nothing is there: the port hung up.
            Ok(0) => Err(gone(&"the port hung up")),
            Ok(length) => {
                for &byte in &buffer[..length] {
                    if let Some(Frame::Packet(packet)) = self.decoder.push(byte) {
                        received(packet);
                    }
                }
                Ok(())
            }
            Err(error) if is_passing(&error) => Ok(()),
            Err(error) => Err(gone(&error)),
        }
    }
}

fn is_passing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}
