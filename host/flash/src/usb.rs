//! Devices in ST's bootloader on this system's USB.

use std::num::NonZeroU8;
use std::thread;
use std::time::Duration;

use nusb::transfer::{ControlIn, ControlOut, ControlType, Recipient, TransferError};
use nusb::{DeviceInfo, ErrorKind, MaybeFuture};

use crate::dfu::{Dfu, Wire, WireError};
use crate::error::FlashError;
use crate::layout::{INTERNAL_FLASH, Sector, sectors};

/// The identity of ST's bootloader (AN2606, section 3).
pub const VENDOR: u16 = 0x0483;
/// See [`VENDOR`].
pub const PRODUCT: u16 = 0xDF11;
const INTERFACE: u8 = 0;
/// English of the United States, in which the bootloader names its memories.
const LANGUAGE: u16 = 0x0409;
/// The functional descriptor (DFU 1.1, table 4.2), and what it says of the longest block.
const FUNCTIONAL: u8 = 0x21;
const TRANSFER_BYTES_AT: usize = 5;
/// Longer than any answer takes; the bootloader answers while the flash is busy, but late.
const PATIENCE: Duration = Duration::from_secs(5);

/// A device in its bootloader.
#[derive(Debug, Clone)]
pub struct Attached {
    /// Bus and ports on the way to it, as in `lsusb -t`.
    pub place: String,
    info: DeviceInfo,
}

/// Every device in ST's bootloader.
///
/// # Errors
/// [`FlashError`] when they cannot be listed.
pub fn attached() -> Result<Vec<Attached>, FlashError> {
    let devices = nusb::list_devices().wait().map_err(|error| FlashError::List {
        found: error.to_string(),
    })?;
    let is_one = |device: &DeviceInfo| (device.vendor_id(), device.product_id()) == (VENDOR, PRODUCT);
    let found = devices.filter(is_one).map(|info| {
        let ports: Vec<_> = info.port_chain().iter().map(u8::to_string).collect();
        Attached {
            place: format!("{}-{}", info.bus_id(), ports.join(".")),
            info,
        }
    });
    Ok(found.collect())
}

impl Attached {
    /// Opens it, with its flash chosen; tells its sectors too.
    ///
    /// # Errors
    /// [`FlashError`] when it is not allowed, or is no such bootloader.
    pub fn open(&self) -> Result<(Dfu<Usb>, Vec<Sector>), FlashError> {
        let failed = |error: nusb::Error| match error.kind() {
            ErrorKind::PermissionDenied => FlashError::Forbidden {
                place: self.place.clone(),
                found: error.to_string(),
            },
            _ => self.broken(error.to_string(), "its interface"),
        };
        let device = self.info.open().wait().map_err(failed)?;
        let interface = device.claim_interface(INTERFACE).wait().map_err(failed)?;
        let name = |index: Option<NonZeroU8>| {
            let text = index.map(|index| device.get_string_descriptor(index, LANGUAGE, PATIENCE).wait());
            text.and_then(Result::ok).unwrap_or_default()
        };
        let names: Vec<(u8, String)> = interface
            .descriptors()
            .map(|setting| (setting.alternate_setting(), name(setting.string_index())))
            .collect();
        let flash = names
            .iter()
            .find_map(|(setting, name)| Some((*setting, sectors(name)?)));
        let Some((setting, sectors)) = flash else {
            let names: Vec<&str> = names.iter().map(|(_, name)| name.as_str()).collect();
            return Err(self.broken(format!("memories {names:?}"), INTERNAL_FLASH));
        };
        let transfer_bytes = interface
            .descriptors()
            .flat_map(|setting| setting.descriptors().map(|one| one.to_vec()).collect::<Vec<_>>())
            .find_map(|descriptor| transfer_bytes(&descriptor));
        let Some(transfer_bytes) = transfer_bytes else {
            return Err(self.broken("no functional descriptor".to_owned(), "one"));
        };
        interface.set_alt_setting(setting).wait().map_err(failed)?;
        Ok((Dfu::new(Usb { interface }, transfer_bytes), sectors))
    }

    fn broken(&self, found: String, expected: &'static str) -> FlashError {
        FlashError::Broken {
            place: self.place.clone(),
            found,
            expected,
        }
    }
}

/// The longest block that a functional descriptor allows.
fn transfer_bytes(descriptor: &[u8]) -> Option<u16> {
    let bytes = descriptor.get(TRANSFER_BYTES_AT..)?.first_chunk()?;
    (descriptor.get(1) == Some(&FUNCTIONAL)).then(|| u16::from_le_bytes(*bytes))
}

/// The control endpoint of an open device.
pub struct Usb {
    interface: nusb::Interface,
}

impl std::fmt::Debug for Usb {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Usb").finish_non_exhaustive()
    }
}

fn failed(error: TransferError) -> WireError {
    match error {
        TransferError::Stall => WireError::Stalled,
        other => WireError::Gone(other.to_string()),
    }
}

impl Wire for Usb {
    fn send(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), WireError> {
        let request = ControlOut {
            control_type: ControlType::Class,
            recipient: Recipient::Interface,
            request,
            value,
            index: INTERFACE.into(),
            data,
        };
        self.interface
            .control_out(request, PATIENCE)
            .wait()
            .map_err(failed)
    }

    fn ask(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, WireError> {
        let request = ControlIn {
            control_type: ControlType::Class,
            recipient: Recipient::Interface,
            request,
            value,
            index: INTERFACE.into(),
            length,
        };
        self.interface
            .control_in(request, PATIENCE)
            .wait()
            .map_err(failed)
    }

    fn wait(&mut self, ms: u32) {
        thread::sleep(Duration::from_millis(ms.into()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_block_is_that_of_the_functional_descriptor() {
        // The STM32F405's: attributes 0x0B, detach within 255 ms, 2,048 bytes, DFU 1.1a.
        let st = [9, 0x21, 0x0B, 0xFF, 0x00, 0x00, 0x08, 0x1A, 0x01];
        assert_eq!(transfer_bytes(&st), Some(2_048));
        assert_eq!(transfer_bytes(&st[..6]), None);
        let interface = [9, 0x04, 0, 0, 0, 0xFE, 1, 2, 4];
        assert_eq!(transfer_bytes(&interface), None);
    }
}
