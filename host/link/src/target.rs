//! Which link to open: the value of `--mcu`.

use std::fmt;
use std::str::FromStr;

use crate::embedded::EmbeddedLink;
use crate::emulator::{EmulatorLink, Transport};
use crate::error::LinkError;
use crate::hot_plug::HotPlug;
use crate::link::Link;
use crate::serial::SerialFinder;
use crate::usb::{System, UsbFinder};

/// Which microcontroller to use: the value of `--mcu`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Target {
    /// The firmware library in this process.
    #[default]
    Embedded,
    /// The unmodified firmware image in the emulator, over this transport.
    Emulator(Transport),
    /// A serial port.
    Serial(String),
    /// A USB device, by serial number when there are several.
    Usb(Option<String>),
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once(':') {
            None if text == "embedded" => Ok(Self::Embedded),
            None if text == "emulator" => Ok(Self::Emulator(Transport::Usb)),
            Some(("emulator", "uart")) => Ok(Self::Emulator(Transport::Uart)),
            None if text == "usb" => Ok(Self::Usb(None)),
            Some(("usb", serial)) if !serial.is_empty() => Ok(Self::Usb(Some(serial.to_owned()))),
            Some(("serial", port)) if !port.is_empty() => Ok(Self::Serial(port.to_owned())),
            _ => Err(format!(
                "found {text}, expected embedded, emulator, emulator:uart, usb, usb:SERIAL or serial:PORT"
            )),
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => f.write_str("embedded"),
            Self::Emulator(Transport::Usb) => f.write_str("emulator"),
            Self::Emulator(Transport::Uart) => f.write_str("emulator:uart"),
            Self::Serial(port) => write!(f, "serial:{port}"),
            Self::Usb(None) => f.write_str("usb"),
            Self::Usb(Some(serial)) => write!(f, "usb:{serial}"),
        }
    }
}

impl Target {
    /// Opens the link.
    ///
    /// # Errors
    /// [`LinkError`] when there is no such port or device, or another program has it.
    pub fn open(&self) -> Result<Box<dyn Link>, LinkError> {
        Ok(match self {
            Self::Embedded => Box::new(EmbeddedLink::new()),
            Self::Emulator(transport) => Box::new(EmulatorLink::spawn(*transport)?),
            Self::Serial(port) => Box::new(HotPlug::open(Box::new(SerialFinder(port.clone())))?),
            Self::Usb(serial) => {
                let finder = UsbFinder::new(System::default(), serial.clone());
                Box::new(HotPlug::open(Box::new(finder))?)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_is_read_as_it_is_written() {
        for text in [
            "embedded",
            "emulator",
            "emulator:uart",
            "usb",
            "usb:A1",
            "serial:/dev/ttyUSB0",
            "serial:COM3",
        ] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), text);
        }
        for text in ["", "usb:", "serial", "serial:", "embedded:1", "emulator:", "can"] {
            assert!(
                text.parse::<Target>().unwrap_err().contains("expected embedded"),
                "{text}"
            );
        }
    }
}
