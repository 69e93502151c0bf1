//! A real microcontroller on USB: vendor-class bulk endpoints, one packet per transfer, at full speed (the firmware's) or faster.
//! Choosing among the attached devices ([`choose`]) is pure; [`Bus`] is the system's part.

use std::time::Duration;

use gripline_protocol::PACKET_MAX;
use nusb::descriptors::{InterfaceDescriptor, TransferType};
use nusb::transfer::{Buffer, Bulk, Direction, In, Out};
use nusb::{DeviceInfo, Endpoint, ErrorKind, MaybeFuture};

use super::hot_plug::{Device, DeviceError, Finder};
use crate::error::LinkError;
use crate::patience::SEND_WAIT;

/// The firmware's identity: the pid.codes test product, until the project has its own.
const VENDOR: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;
/// What the firmware calls itself, because a test product number is shared.
const PRODUCT_NAME: &str = "Gripline";
const INTERFACE: u8 = 0;
/// Transfers that wait for packets from the device.
const LISTENING: usize = 8;
/// Packets under way to the device: one dense map and a command.
const UNDER_WAY: usize = 48;

/// A device of ours that is attached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attached {
    /// Its serial number.
    pub serial: Option<String>,
    /// Bus and ports on the way to it, as in `lsusb -t`.
    pub place: String,
}

/// The system's USB.
pub trait Bus {
    /// Every device of ours.
    ///
    /// # Errors
    /// Why they cannot be listed.
    fn attached(&mut self) -> Result<Vec<Attached>, String>;

    /// Opens the device at this place of the last list.
    ///
    /// # Errors
    /// [`LinkError`] with `link` as its name.
    fn open(&mut self, number: usize, link: &str) -> Result<Box<dyn Device>, LinkError>;
}

/// The device with this serial number, or the only one; once found, always the same.
pub struct UsbFinder<B> {
    bus: B,
    serial: Option<String>,
}

impl<B: Bus> UsbFinder<B> {
    /// Looks on this bus.
    pub fn new(bus: B, serial: Option<String>) -> Self {
        Self { bus, serial }
    }
}

impl<B: Bus> Finder for UsbFinder<B> {
    fn find(&mut self) -> Result<Box<dyn Device>, LinkError> {
        let link = self.name();
        let attached = self.bus.attached().map_err(|found| LinkError::Missing {
            link: link.clone(),
            found,
            advice: "check that this system has USB".to_owned(),
        })?;
        let number = choose(&link, &attached, self.serial.as_deref())?;
        let device = self.bus.open(number, &link)?;
        self.serial.clone_from(&attached[number].serial);
        Ok(device)
    }

    fn name(&self) -> String {
        match &self.serial {
            Some(serial) => format!("USB device {serial}"),
            None => "USB device".to_owned(),
        }
    }
}

/// Chooses the device.
///
/// # Errors
/// [`LinkError`] when it is not there, when several could be meant, or when two have the same serial number.
pub fn choose(link: &str, attached: &[Attached], serial: Option<&str>) -> Result<usize, LinkError> {
    let list = || {
        let names: Vec<_> = attached.iter().map(shown).collect();
        names.join(", ")
    };
    let is_meant = |(_, device): &(usize, &Attached)| serial.is_none() || device.serial.as_deref() == serial;
    let mut meant = attached.iter().enumerate().filter(is_meant);
    let Some((number, first)) = meant.next() else {
        let (found, advice) = if attached.is_empty() {
            (
                format!("no device {VENDOR:04x}:{PRODUCT:04x}"),
                "plug the microcontroller in, flash it, or use --mcu embedded",
            )
        } else {
            (
                format!("found {}", list()),
                "name one that is there with --mcu usb:SERIAL",
            )
        };
        return Err(LinkError::Missing {
            link: link.to_owned(),
            found,
            advice: advice.to_owned(),
        });
    };
    let others: Vec<_> = meant.map(|(_, device)| device).collect();
    if others.iter().any(|other| other.serial != first.serial) {
        return Err(LinkError::Several {
            link: link.to_owned(),
            count: attached.len(),
            found: list(),
        });
    }
    match others.first() {
        None => Ok(number),
        Some(twin) => Err(LinkError::Twins {
            link: link.to_owned(),
            serial: first.serial.clone().unwrap_or_else(|| "none".to_owned()),
            places: [first.place.clone(), twin.place.clone()],
        }),
    }
}

fn shown(device: &Attached) -> String {
    let serial = device.serial.as_deref().unwrap_or("without serial number");
    format!("{serial} at {}", device.place)
}

/// The devices of ours that this system has now.
///
/// # Errors
/// Why they cannot be listed.
pub fn attached() -> Result<Vec<Attached>, String> {
    System::default().attached()
}

/// This system's USB.
#[derive(Default)]
pub(super) struct System(Vec<DeviceInfo>);

impl Bus for System {
    fn attached(&mut self) -> Result<Vec<Attached>, String> {
        let is_ours = |device: &DeviceInfo| {
            (device.vendor_id(), device.product_id()) == (VENDOR, PRODUCT)
                && device
                    .product_string()
                    .is_none_or(|product| product.starts_with(PRODUCT_NAME))
        };
        let devices = nusb::list_devices()
            .wait()
            .map_err(|error| format!("USB devices cannot be listed: {error}"))?;
        self.0 = devices.filter(is_ours).collect();
        let attached = self.0.iter().map(|device| {
            let ports: Vec<_> = device.port_chain().iter().map(u8::to_string).collect();
            Attached {
                serial: device.serial_number().map(str::to_owned),
                place: format!("{}-{}", device.bus_id(), ports.join(".")),
            }
        });
        Ok(attached.collect())
    }

    fn open(&mut self, number: usize, link: &str) -> Result<Box<dyn Device>, LinkError> {
        let failed = |error: nusb::Error| match error.kind() {
            ErrorKind::Busy => LinkError::Busy {
                link: link.to_owned(),
                found: error.to_string(),
            },
            ErrorKind::PermissionDenied => LinkError::Broken {
                link: link.to_owned(),
                found: format!(
                    "{error}; expected to be allowed to open it: install the udev rule (docs/70-gripline.rules), or join the \
                     group gripline"
                ),
            },
            // Its address is there and its file or its interface is not, or not any more.
            ErrorKind::NotFound | ErrorKind::Disconnected => LinkError::NotReady {
                link: link.to_owned(),
                found: error.to_string(),
            },
            _ => LinkError::Broken {
                link: link.to_owned(),
                found: error.to_string(),
            },
        };
        let interface = self.0[number]
            .open()
            .wait()
            .map_err(failed)?
            .claim_interface(INTERFACE)
            .wait()
            .map_err(failed)?;
        let pipes = interface.descriptor().map(|descriptor| pipes(&descriptor));
        let pipes = pipes.unwrap_or_else(|| Err("no descriptor of its interface".to_owned()));
        let [out, input] = pipes.map_err(|found| LinkError::Broken {
            link: link.to_owned(),
            found,
        })?;
        let out = interface.endpoint(out).map_err(failed)?;
        let input = interface.endpoint(input).map_err(failed)?;
        let mut device = Usb {
            out,
            input,
            spare: Vec::new(),
        };
        device.listen();
        Ok(Box::new(device))
    }
}

/// Addresses of the bulk endpoints towards the device and from it.
fn pipes(interface: &InterfaceDescriptor) -> Result<[u8; 2], String> {
    let pipe = |direction: Direction| {
        interface.endpoints().find(|endpoint| {
            (endpoint.transfer_type(), endpoint.direction()) == (TransferType::Bulk, direction)
                && endpoint.max_packet_size() >= PACKET_MAX
        })
    };
    match (pipe(Direction::Out), pipe(Direction::In)) {
        (Some(out), Some(input)) => Ok([out.address(), input.address()]),
        (out, _) => {
            let missing = if out.is_none() { "to" } else { "from" };
            Err(format!(
                "no bulk endpoint {missing} the device for packets of {PACKET_MAX} bytes, expected one each way; flash it"
            ))
        }
    }
}

/// An open device.
struct Usb {
    out: Endpoint<Bulk, Out>,
    input: Endpoint<Bulk, In>,
    /// Buffers of packets that went out.
    spare: Vec<Buffer>,
}

impl Usb {
    fn listen(&mut self) {
        while self.input.pending() < LISTENING {
            // A transfer ends with a packet that is short, or with the room for it: one packet either way.
            let buffer = self.input.allocate(self.input.max_packet_size());
            self.input.submit(buffer);
        }
    }

    /// Takes back the buffer of a sent packet, if one completes within this time.
    fn gone_out(&mut self, patience: Duration) -> Result<bool, DeviceError> {
        if self.out.pending() == 0 {
            return Ok(false);
        }
        let Some(completion) = self.out.wait_next_complete(patience) else {
            return Ok(false);
        };
        self.spare.push(completion.buffer);
        completion
            .status
            .map(|()| true)
            .map_err(|error| DeviceError::Gone(error.to_string()))
    }
}

impl Device for Usb {
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError> {
        while self.gone_out(Duration::ZERO)? {}
        if self.out.pending() >= UNDER_WAY && !self.gone_out(SEND_WAIT)? {
            // What it has not taken by now is old; the map that it belongs to is lost with it.
            self.out.cancel_all();
            while self.out.pending() > 0 {
                if let Some(completion) = self.out.wait_next_complete(SEND_WAIT) {
                    self.spare.push(completion.buffer);
                } else {
                    return Err(DeviceError::Gone(
                        "it takes nothing and gives nothing back".to_owned(),
                    ));
                }
            }
            return Err(DeviceError::Busy);
        }
        let mut buffer = self.spare.pop().unwrap_or_else(|| Buffer::new(PACKET_MAX));
        buffer.clear();
        buffer.extend_from_slice(packet);
        self.out.submit(buffer);
        Ok(())
    }

    fn receive(
        &mut self,
        mut patience: Duration,
        received: &mut dyn FnMut(&[u8]),
    ) -> Result<(), DeviceError> {
        while self.gone_out(Duration::ZERO)? {}
        while let Some(completion) = self.input.wait_next_complete(patience) {
            completion
                .status
                .map_err(|error| DeviceError::Gone(error.to_string()))?;
            received(&completion.buffer[..completion.actual_len]);
            self.input.submit(completion.buffer);
            // The rest as far as it is there already.
            patience = Duration::ZERO;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nusb::descriptors::ConfigurationDescriptor;

    use super::*;

    /// A configuration with one vendor-specific interface with these endpoints: address, attributes, packet size.
    fn read(endpoints: &[(u8, u8, u16)]) -> Result<[u8; 2], String> {
        let total = 18 + 7 * endpoints.len() as u8;
        let mut bytes = vec![9, 2, total, 0, 1, 1, 0, 0xC0, 50];
        bytes.extend([9, 4, 0, 0, endpoints.len() as u8, 0xFF, 0, 0, 0]);
        for &(address, attributes, size) in endpoints {
            let [low, high] = size.to_le_bytes();
            bytes.extend([7, 5, address, attributes, low, high, 0]);
        }
        let configuration = ConfigurationDescriptor::new(&bytes).unwrap();
        pipes(&configuration.interface_alt_settings().next().unwrap())
    }

    #[test]
    fn the_endpoints_are_those_of_the_descriptors() {
        // The firmware's; another controller's at high speed, with an interrupt endpoint between.
        assert_eq!(read(&[(0x01, 2, 64), (0x81, 2, 64)]), Ok([0x01, 0x81]));
        assert_eq!(
            read(&[(0x83, 3, 64), (0x81, 2, 512), (0x02, 2, 512)]),
            Ok([0x02, 0x81])
        );
    }

    #[test]
    fn an_interface_without_room_for_a_packet_each_way_is_refused() {
        for (endpoints, missing) in [
            (&[][..], "to the device"),
            (&[(0x81, 2, 64)], "to the device"),
            (&[(0x01, 2, 64)], "from the device"),
            (&[(0x01, 2, 32), (0x81, 2, 64)], "to the device"),
            (&[(0x01, 2, 64), (0x81, 3, 64)], "from the device"),
        ] {
            let error = read(endpoints).unwrap_err();
            assert!(
                error.contains(missing) && error.contains("expected one each way"),
                "{error}"
            );
        }
    }
}
