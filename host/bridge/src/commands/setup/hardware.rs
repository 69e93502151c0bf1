//! What is attached to this machine: cameras, microcontrollers on USB, serial ports. The lists become choices in pure functions.

use std::fs;
use std::path::{Path, PathBuf};

use gripline_link::usb::{Attached, attached};

use super::interview::Hardware;
use super::question::Choice;

/// Stable names of cameras, independent of the order of plugging in.
const BY_ID: &str = "/dev/v4l/by-id";
/// Every device of Video4Linux, with its name.
const DEVICES: &str = "/sys/class/video4linux";

/// A device of Video4Linux.
struct Device {
    /// Its file.
    file: PathBuf,
    /// The driver's name of it.
    name: String,
    /// A camera's first device takes pictures, its others carry metadata.
    index: u32,
}

/// Lists them.
pub(super) fn detect() -> Hardware {
    let (boards, no_usb) = match attached() {
        Ok(boards) => (boards, None),
        Err(error) => (Vec::new(), Some(error)),
    };
    let ports = serialport::available_ports().unwrap_or_default();
    Hardware {
        cameras: cameras(devices(), &links()),
        boards: boards.iter().map(board).collect(),
        ports: ports.iter().filter_map(port).collect(),
        no_usb,
    }
}

fn devices() -> Vec<Device> {
    let mut devices: Vec<Device> = entries(Path::new(DEVICES))
        .into_iter()
        .filter_map(|folder| {
            let read = |name: &str| fs::read_to_string(folder.join(name)).ok();
            Some(Device {
                file: Path::new("/dev").join(folder.file_name()?),
                name: read("name")?.trim().to_owned(),
                index: read("index")?.trim().parse().ok()?,
            })
        })
        .collect();
    devices.sort_by(|one, other| one.file.cmp(&other.file));
    devices
}

/// Stable names, with their present files.
fn links() -> Vec<(PathBuf, PathBuf)> {
    let links = entries(Path::new(BY_ID)).into_iter();
    links
        .filter_map(|link| Some((link.clone(), fs::canonicalize(&link).ok()?)))
        .collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let listed = fs::read_dir(folder).into_iter().flatten().flatten();
    listed.map(|entry| entry.path()).collect()
}

/// The devices that take pictures, by their stable name if there is one.
fn cameras(devices: Vec<Device>, links: &[(PathBuf, PathBuf)]) -> Vec<Choice> {
    let pictures = devices.into_iter().filter(|device| device.index == 0);
    pictures
        .map(|device| {
            let link = links.iter().find(|(_, file)| *file == device.file);
            let path = link.map_or(&device.file, |(link, _)| link);
            Choice::new(path.display().to_string(), device.name)
        })
        .collect()
}

fn board(device: &Attached) -> Choice {
    match &device.serial {
        Some(serial) => Choice::new(format!("usb:{serial}"), format!("at {}", device.place)),
        None => Choice::new("usb", format!("at {}, without serial number", device.place)),
    }
}

/// Serial ports on USB; those on the mainboard exist whether anything is connected or not.
fn port(port: &serialport::SerialPortInfo) -> Option<Choice> {
    let serialport::SerialPortType::UsbPort(about) = &port.port_type else {
        return None;
    };
    let product = about.product.as_deref().unwrap_or("serial port on USB");
    Some(Choice::new(format!("serial:{}", port.port_name), product))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_listed_once_each_by_the_name_that_stays() {
        let device = |file: &str, name: &str, index| Device {
            file: file.into(),
            name: name.to_owned(),
            index,
        };
        let devices = vec![
            device("/dev/video0", "A webcam", 0),
            device("/dev/video1", "A webcam", 1),
            device("/dev/video2", "Another", 0),
        ];
        let links = [
            ("/dev/v4l/by-id/usb-a-index1".into(), "/dev/video1".into()),
            ("/dev/v4l/by-id/usb-a-index0".into(), "/dev/video0".into()),
        ];
        assert_eq!(
            cameras(devices, &links),
            [
                Choice::new("/dev/v4l/by-id/usb-a-index0", "A webcam"),
                Choice::new("/dev/video2", "Another")
            ]
        );
    }

    #[test]
    fn boards_are_named_by_their_serial_number() {
        let device = |serial: Option<&str>| Attached {
            serial: serial.map(str::to_owned),
            place: "1-2".to_owned(),
        };
        assert_eq!(board(&device(Some("A1"))), Choice::new("usb:A1", "at 1-2"));
        assert_eq!(board(&device(None)).value, "usb");
    }
}
