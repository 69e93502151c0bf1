//! A real microcontroller on USB: vendor-class bulk endpoints, one packet per transfer.
//! Limits: one device per link; a device that goes away ends the link.

use std::time::{Duration, Instant};

use gripline_protocol::PACKET_MAX;
use nusb::transfer::{Bulk, In, Out};
use nusb::{DeviceInfo, Endpoint, ErrorKind, MaybeFuture};

use super::{Link, LinkError};

/// The firmware's identity: the pid.codes test product, until the project has its own.
const VENDOR: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;
/// What the firmware calls itself, because a test product number is shared.
const PRODUCT_NAME: &str = "Gripline";
const INTERFACE: u8 = 0;
const OUT: u8 = 0x01;
const IN: u8 = 0x81;
/// Transfers that wait for packets from the device.
const IN_FLIGHT: usize = 8;
const SEND_WAIT: Duration = Duration::from_millis(100);

/// A USB device.
pub struct UsbLink {
    name: String,
    out: Endpoint<Bulk, Out>,
    input: Endpoint<Bulk, In>,
    start: Instant,
}

impl UsbLink {
    /// Opens the device with this serial number, or the only one.
    ///
    /// # Errors
    /// [`LinkError`] when there is no such device, when there are several and none was named, or when another
    /// program has it.
    pub fn open(serial: Option<&str>) -> Result<Self, LinkError> {
        let name = serial.map_or_else(
            || "USB device".to_owned(),
            |serial| format!("USB device {serial}"),
        );
        let device = choose(&name, serial)?;
        let opened = |error: nusb::Error| match error.kind() {
            ErrorKind::Busy => LinkError::Busy {
                link: name.clone(),
                found: error.to_string(),
            },
            ErrorKind::PermissionDenied => LinkError::Broken {
                link: name.clone(),
                found: format!("{error}; expected to be allowed to open it, install the udev rule"),
            },
            _ => LinkError::Broken {
                link: name.clone(),
                found: error.to_string(),
            },
        };
        let interface = device
            .open()
            .wait()
            .map_err(opened)?
            .claim_interface(INTERFACE)
            .wait()
            .map_err(opened)?;
        let out = interface.endpoint(OUT).map_err(opened)?;
        let input = interface.endpoint(IN).map_err(opened)?;
        let mut link = Self {
            name,
            out,
            input,
            start: Instant::now(),
        };
        link.keep_listening();
        Ok(link)
    }

    fn keep_listening(&mut self) {
        while self.input.pending() < IN_FLIGHT {
            let buffer = self.input.allocate(PACKET_MAX);
            self.input.submit(buffer);
        }
    }

    fn broken(&self, found: impl std::fmt::Display) -> LinkError {
        LinkError::Broken {
            link: self.name.clone(),
            found: format!("{found}; expected it to stay connected, check cable and power"),
        }
    }
}

fn choose(name: &str, serial: Option<&str>) -> Result<DeviceInfo, LinkError> {
    let missing = |found: String, advice: &str| LinkError::Missing {
        link: name.to_owned(),
        found,
        advice: advice.to_owned(),
    };
    let devices = nusb::list_devices().wait().map_err(|error| {
        missing(
            format!("USB devices cannot be listed: {error}"),
            "check that this system has USB",
        )
    })?;
    let mut found: Vec<_> = devices
        .filter(|device| device.vendor_id() == VENDOR && device.product_id() == PRODUCT)
        .filter(|device| {
            device
                .product_string()
                .is_none_or(|product| product.starts_with(PRODUCT_NAME))
        })
        .collect();
    let serials: Vec<_> = found
        .iter()
        .map(|device| {
            device
                .serial_number()
                .unwrap_or("without serial number")
                .to_owned()
        })
        .collect();
    if let Some(serial) = serial {
        found.retain(|device| device.serial_number() == Some(serial));
    }
    match (found.len(), serials.len()) {
        (1, _) => Ok(found.remove(0)),
        (0, 0) => Err(missing(
            format!("no device {VENDOR:04x}:{PRODUCT:04x}"),
            "plug the microcontroller in, flash it, or use --mcu embedded",
        )),
        _ => Err(missing(
            format!("found {}", serials.join(", ")),
            "name one of them with --mcu usb:SERIAL",
        )),
    }
}

impl Link for UsbLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let completion = self.out.transfer_blocking(packet.to_vec().into(), SEND_WAIT);
        completion.status.map_err(|error| self.broken(error))
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let until = self.start + Duration::from_micros(until_us);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let Some(completion) = self.input.wait_next_complete(left) else {
                return Ok(());
            };
            completion.status.map_err(|error| self.broken(error))?;
            received(&completion.buffer[..completion.actual_len]);
            self.keep_listening();
        }
    }

    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }

    fn name(&self) -> String {
        format!("microcontroller on {}", self.name)
    }
}
