//! What a device says of itself, held against the standards that say how: USB 2.0 chapter 9, the BOS descriptor of its
//! ECN, Microsoft OS 2.0 descriptors, WebUSB. Written from those, not from the firmware. Lengths in bytes.
//! Limits: full-speed devices; of classes nothing is known.

use super::host::{ControlOutcome, ControlTransfer};

const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const STRING: u8 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
const DEVICE_QUALIFIER: u8 = 6;
const BOS: u8 = 15;
const DEVICE_CAPABILITY: u8 = 16;
/// Device capability types of the BOS (USB 3.1 table 9-14).
const USB_2_EXTENSION: u8 = 2;
const PLATFORM: u8 = 5;
/// Platform capability of MS OS 2.0: D8DD60DF-4589-4CC7-9CD2-659D9E648A9F.
const MICROSOFT_OS_2: [u8; 16] = [
    0xDF, 0x60, 0xDD, 0xD8, 0x89, 0x45, 0xC7, 0x4C, 0x9C, 0xD2, 0x65, 0x9D, 0x9E, 0x64, 0x8A, 0x9F,
];
/// Platform capability of WebUSB: 3408B638-09A9-47A0-8BFD-A0768815B665.
const WEB_USB: [u8; 16] = [
    0x38, 0xB6, 0x08, 0x34, 0xA9, 0x09, 0xA0, 0x47, 0x8B, 0xFD, 0xA0, 0x76, 0x88, 0x15, 0xB6, 0x65,
];
/// The first Windows that reads MS OS 2.0 descriptors: 8.1.
const WINDOWS_8_1: u32 = 0x0603_0000;
/// Bytes of the platform capability before its data.
const PLATFORM_HEADER: usize = 20;

/// Every rule that the answers to an enumeration break, a line each, with the section it comes from.
/// `transfers` are those of one enumeration, in any order.
#[must_use]
pub fn violations(transfers: &[ControlTransfer]) -> Vec<String> {
    let mut found = Findings::default();
    let Some(device) = descriptor(transfers, DEVICE, 0, 18) else {
        found.that(false, "no device descriptor was read");
        return found.0;
    };
    if let Some(first) = descriptor(transfers, DEVICE, 0, 64) {
        found.that(
            device.starts_with(first),
            "9.6.1: the device descriptor changed between two readings",
        );
    }
    check_device(device, &mut found);
    if device.len() == 18 {
        for index in device[14..17].iter().filter(|&&index| index != 0) {
            match descriptor(transfers, STRING, *index, 255) {
                Some(string) => check_string(*index, string, &mut found),
                None => found.that(
                    false,
                    &format!("9.6.7: string {index} is named and cannot be read"),
                ),
            }
        }
        match descriptor(transfers, STRING, 0, 255) {
            Some(languages) => found.that(
                languages.len() >= 4
                    && languages.len().is_multiple_of(2)
                    && usize::from(languages[0]) == languages.len()
                    && languages[1] == STRING,
                "9.6.7: string 0 must be a list of languages",
            ),
            None => found.that(
                device[14..17].iter().all(|&index| index == 0),
                "9.6.7: strings without a list of languages",
            ),
        }
    }
    let mut interfaces = 0;
    match longest(transfers, CONFIGURATION) {
        Some(configuration) => {
            if let Some(header) = descriptor(transfers, CONFIGURATION, 0, 9) {
                found.that(
                    configuration.starts_with(header),
                    "9.6.3: the configuration descriptor changed between two readings",
                );
            }
            interfaces = check_configuration(configuration, &mut found);
        }
        None => found.that(false, "9.6.3: no configuration descriptor was read"),
    }
    found.that(
        of(transfers, DEVICE_QUALIFIER).all(|transfer| transfer.outcome == ControlOutcome::Stalled),
        "9.6.2: a full-speed-only device must refuse the device qualifier",
    );
    let bos = longest(transfers, BOS);
    found.that(
        bos.is_some() || word(device, 2) < 0x0201,
        "BOS: bcdUSB 2.01 and above promises a BOS descriptor",
    );
    if let Some(bos) = bos {
        check_bos(bos, &mut found);
        if let Some((code, length)) = microsoft_set(bos) {
            let set = transfers.iter().find(|transfer| {
                transfer.setup[..2] == [0xC0, code]
                    && transfer.setup[4] == 7
                    && transfer.outcome == ControlOutcome::Done
            });
            match set {
                Some(set) => check_microsoft(&set.data, length, interfaces, &mut found),
                None => found.that(false, "MS OS 2.0: the set that the BOS promises cannot be read"),
            }
        }
    }
    found.0
}

/// The request code and the length of the Microsoft OS 2.0 set that a BOS descriptor promises.
pub(super) fn microsoft_set(bos: &[u8]) -> Option<(u8, u16)> {
    let capability = split(bos.get(5..)?)
        .find(|this| this.len() >= 28 && this[2] == PLATFORM && this[4..20] == MICROSOFT_OS_2)?;
    Some((capability[26], word(capability, 24)))
}

#[derive(Default)]
struct Findings(Vec<String>);

impl Findings {
    fn that(&mut self, holds: bool, rule: &str) {
        if !holds {
            self.0.push(rule.to_owned());
        }
    }
}

fn of(transfers: &[ControlTransfer], kind: u8) -> impl Iterator<Item = &ControlTransfer> {
    transfers
        .iter()
        .filter(move |transfer| transfer.setup[..2] == [0x80, 6] && transfer.setup[3] == kind)
}

fn descriptor(transfers: &[ControlTransfer], kind: u8, index: u8, length: u16) -> Option<&[u8]> {
    of(transfers, kind)
        .find(|transfer| {
            transfer.setup[2] == index
                && word(&transfer.setup, 6) == length
                && transfer.outcome == ControlOutcome::Done
        })
        .map(|transfer| transfer.data.as_slice())
}

fn longest(transfers: &[ControlTransfer], kind: u8) -> Option<&[u8]> {
    of(transfers, kind)
        .filter(|transfer| transfer.outcome == ControlOutcome::Done)
        .map(|transfer| transfer.data.as_slice())
        .max_by_key(|data| data.len())
}

/// Two bytes at `at`, little-endian; zero past the end.
fn word(bytes: &[u8], at: usize) -> u16 {
    let byte = |at| bytes.get(at).copied().unwrap_or(0);
    u16::from_le_bytes([byte(at), byte(at + 1)])
}

/// Descriptors one after the other, each as long as its first byte says; the last may be cut short.
fn split(mut bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        let length = usize::from(*bytes.first()?).max(1);
        let (this, after) = bytes.split_at(length.min(bytes.len()));
        bytes = after;
        Some(this)
    })
}

fn is_decimal(number: u16) -> bool {
    (0..4).all(|digit| number >> (4 * digit) & 0xF < 10)
}

fn check_device(device: &[u8], found: &mut Findings) {
    found.that(
        device.len() == 18 && device[0] == 18,
        "9.6.1: a device descriptor has 18 bytes",
    );
    if device.len() != 18 {
        return;
    }
    found.that(device[1] == DEVICE, "9.6.1: type of the device descriptor");
    found.that(
        matches!(word(device, 2), 0x0110 | 0x0200 | 0x0201 | 0x0210) && is_decimal(word(device, 12)),
        "9.6.1: release numbers are binary-coded decimals, bcdUSB one of the standard's",
    );
    found.that(
        device[4] != 0 || device[5] == 0 && device[6] == 0,
        "9.6.1: a device without class has neither subclass nor protocol",
    );
    found.that(
        matches!(device[7], 8 | 16 | 32 | 64),
        "9.6.1: endpoint 0 takes packets of 8, 16, 32 or 64 bytes",
    );
    found.that(word(device, 8) != 0, "9.6.1: a vendor id of 0 belongs to nobody");
    found.that(device[17] >= 1, "9.6.1: at least one configuration");
    found.that(
        device[14] == 0 || !device[15..17].contains(&device[14]),
        "9.6.1: each string has an index of its own",
    );
}

fn check_string(index: u8, string: &[u8], found: &mut Findings) {
    let header = string.len() >= 4
        && string.len().is_multiple_of(2)
        && usize::from(string[0]) == string.len()
        && string[1] == STRING;
    found.that(header, &format!("9.6.7: string {index}: length and type"));
    let units: Vec<u16> = string
        .get(2..)
        .unwrap_or_default()
        .chunks(2)
        .map(|unit| word(unit, 0))
        .collect();
    found.that(
        String::from_utf16(&units).is_ok_and(|text| !text.contains('\0')),
        &format!("9.6.7: string {index} is UTF-16 without a zero at its end"),
    );
}

/// Answers the number of interfaces.
fn check_configuration(configuration: &[u8], found: &mut Findings) -> u8 {
    let is_whole = configuration.len() >= 9 && usize::from(word(configuration, 2)) == configuration.len();
    found.that(is_whole, "9.6.3: wTotalLength is what comes back");
    if configuration.len() < 9 {
        return 0;
    }
    found.that(
        configuration[0] == 9 && configuration[1] == CONFIGURATION,
        "9.6.3: length and type of the configuration descriptor",
    );
    found.that(configuration[5] != 0, "9.6.3: configuration 0 means none");
    found.that(
        configuration[7] & 0x9F == 0x80,
        "9.6.3: bmAttributes: bit 7 is one, bits 4 to 0 are zero",
    );
    found.that(configuration[8] <= 250, "9.6.3: at most 500 mA");
    let mut numbers: Vec<u8> = Vec::new();
    let mut endpoints_left = 0;
    let mut taken: Vec<u8> = Vec::new();
    for this in split(&configuration[9..]) {
        found.that(
            this.len() >= 2 && usize::from(this[0]) == this.len(),
            "9.5: a descriptor of length 0 or cut short",
        );
        match this.get(1) {
            Some(&INTERFACE) if this.len() == 9 => {
                found.that(
                    endpoints_left == 0,
                    "9.6.5: an interface has fewer endpoints than it says",
                );
                endpoints_left = this[4];
                taken.clear();
                if this[3] == 0 {
                    found.that(
                        usize::from(this[2]) == numbers.len(),
                        "9.6.5: interfaces are numbered from 0, each with a setting 0",
                    );
                    numbers.push(this[2]);
                }
            }
            Some(&INTERFACE) => found.that(false, "9.6.5: an interface descriptor has 9 bytes"),
            Some(&ENDPOINT) => {
                found.that(
                    endpoints_left > 0,
                    "9.6.5: an interface has more endpoints than it says",
                );
                endpoints_left = endpoints_left.saturating_sub(1);
                check_endpoint(this, found);
                if let Some(&address) = this.get(2) {
                    found.that(!taken.contains(&address), "9.6.6: an endpoint comes twice");
                    taken.push(address);
                }
            }
            _ => {}
        }
    }
    found.that(
        endpoints_left == 0,
        "9.6.5: an interface has fewer endpoints than it says",
    );
    found.that(
        usize::from(configuration[4]) == numbers.len(),
        "9.6.3: bNumInterfaces is the number of interfaces",
    );
    configuration[4]
}

fn check_endpoint(endpoint: &[u8], found: &mut Findings) {
    if endpoint.len() != 7 {
        return found.that(false, "9.6.6: an endpoint descriptor has 7 bytes");
    }
    let (address, attributes, size) = (endpoint[2], endpoint[3], word(endpoint, 4));
    found.that(
        address & 0x70 == 0 && address & 0xF != 0,
        "9.6.6: endpoint number 1 to 15, reserved bits zero",
    );
    let kind = attributes & 0b11;
    found.that(
        attributes & if kind == 1 { 0xC0 } else { 0xFC } == 0,
        "9.6.6: reserved bits of bmAttributes are zero",
    );
    match kind {
        2 => found.that(
            matches!(size, 8 | 16 | 32 | 64),
            "5.8.3: full-speed bulk packets have at most 8, 16, 32 or 64 bytes",
        ),
        3 => found.that(
            size <= 64 && endpoint[6] >= 1,
            "5.7.3: full-speed interrupt packets have at most 64 bytes, every 1 to 255 ms",
        ),
        _ => found.that(
            size <= 1023,
            "5.6.3: full-speed isochronous packets have at most 1023 bytes",
        ),
    }
}

fn check_bos(bos: &[u8], found: &mut Findings) {
    let is_whole = bos.len() >= 5 && bos[0] == 5 && bos[1] == BOS && usize::from(word(bos, 2)) == bos.len();
    found.that(is_whole, "BOS: length, type and wTotalLength");
    let capabilities: Vec<&[u8]> = split(bos.get(5..).unwrap_or_default()).collect();
    found.that(
        bos.get(4).map(|&count| usize::from(count)) == Some(capabilities.len()),
        "BOS: bNumDeviceCaps is the number of capabilities",
    );
    for this in capabilities {
        found.that(
            this.len() >= 3 && usize::from(this[0]) == this.len() && this[1] == DEVICE_CAPABILITY,
            "BOS: length and type of a capability",
        );
        match this.get(2) {
            Some(&USB_2_EXTENSION) => found.that(
                this.len() == 7 && this[3] & 1 == 0,
                "BOS: the USB 2.0 extension has 7 bytes, bit 0 reserved",
            ),
            Some(&PLATFORM) => check_platform(this, found),
            _ => {}
        }
    }
}

fn check_platform(platform: &[u8], found: &mut Findings) {
    if platform.len() < PLATFORM_HEADER {
        return found.that(false, "BOS: a platform capability has at least 20 bytes");
    }
    found.that(platform[3] == 0, "BOS: bReserved of a platform capability");
    let data = &platform[PLATFORM_HEADER..];
    if platform[4..PLATFORM_HEADER] == MICROSOFT_OS_2 {
        found.that(
            data.len().is_multiple_of(8) && !data.is_empty() && u32::from(word(data, 2)) << 16 >= WINDOWS_8_1,
            "MS OS 2.0: 8 bytes for each Windows, from 8.1 on",
        );
    } else if platform[4..PLATFORM_HEADER] == WEB_USB {
        found.that(
            data.len() == 4 && word(data, 0) == 0x0100,
            "WebUSB: version 1.0, request code, landing page",
        );
    }
}

/// Types of MS OS 2.0 descriptors.
mod microsoft {
    pub(super) const SET_HEADER: u16 = 0;
    pub(super) const CONFIGURATION_SUBSET: u16 = 1;
    pub(super) const FUNCTION_SUBSET: u16 = 2;
    pub(super) const COMPATIBLE_ID: u16 = 3;
    pub(super) const REGISTRY_PROPERTY: u16 = 4;
    pub(super) const REG_MULTI_SZ: u16 = 7;
}

fn check_microsoft(set: &[u8], promised: u16, interfaces: u8, found: &mut Findings) {
    let header = set.len() >= 10
        && word(set, 0) == 10
        && word(set, 2) == microsoft::SET_HEADER
        && u32::from(word(set, 6)) << 16 | u32::from(word(set, 4)) >= WINDOWS_8_1;
    found.that(header, "MS OS 2.0: header of the set");
    found.that(
        set.len() == usize::from(word(set, 8)) && word(set, 8) == promised,
        "MS OS 2.0: wTotalLength is what comes back and what the BOS promised",
    );
    let mut at = 10;
    let mut subsets = 0;
    let mut has_driver = false;
    while let Some(rest) = set.get(at..).filter(|rest| !rest.is_empty()) {
        let length = usize::from(word(rest, 0));
        if length < 4 || length > rest.len() {
            found.that(false, "MS OS 2.0: length of a descriptor");
            break;
        }
        match word(rest, 2) {
            microsoft::CONFIGURATION_SUBSET | microsoft::FUNCTION_SUBSET => {
                subsets += 1;
                let total = usize::from(word(rest, 6));
                found.that(
                    length == 8 && total >= 8 && total <= rest.len(),
                    "MS OS 2.0: a subset has a header of 8 bytes and ends within the set",
                );
                found.that(
                    word(rest, 2) == microsoft::CONFIGURATION_SUBSET || rest[4] < interfaces,
                    "MS OS 2.0: a function subset names an interface that is there",
                );
            }
            microsoft::COMPATIBLE_ID => {
                found.that(length == 20, "MS OS 2.0: a compatible id has 20 bytes");
                found.that(
                    subsets == 0 || interfaces > 1,
                    "MS OS 2.0: a device of one interface has its compatible id outside every subset",
                );
                has_driver |= rest.get(4..12) == Some(b"WINUSB\0\0");
            }
            microsoft::REGISTRY_PROPERTY => check_registry(&rest[..length], found),
            _ => {}
        }
        at += length;
    }
    found.that(
        has_driver,
        "MS OS 2.0: WINUSB is what makes the device driverless",
    );
}

fn check_registry(property: &[u8], found: &mut Findings) {
    let name_length = usize::from(word(property, 6));
    let data_at = 10 + name_length;
    let data_length = usize::from(word(property, 8 + name_length));
    found.that(
        property.len() == data_at + data_length,
        "MS OS 2.0: lengths of a registry property",
    );
    let text = |bytes: &[u8]| -> Vec<u16> { bytes.chunks(2).map(|unit| word(unit, 0)).collect() };
    let name = text(property.get(8..8 + name_length).unwrap_or_default());
    let data = text(property.get(data_at..).unwrap_or_default());
    found.that(
        name.last() == Some(&0),
        "MS OS 2.0: a property's name ends with a zero",
    );
    if word(property, 4) == microsoft::REG_MULTI_SZ {
        found.that(
            data.ends_with(&[0, 0]),
            "MS OS 2.0: a list of strings ends with two zeros",
        );
    }
    if String::from_utf16_lossy(&name) == "DeviceInterfaceGUIDs\0" {
        let list = String::from_utf16_lossy(&data);
        found.that(
            word(property, 4) == microsoft::REG_MULTI_SZ
                && list
                    .split_terminator('\0')
                    .filter(|guid| !guid.is_empty())
                    .all(is_guid)
                && list.starts_with('{'),
            "MS OS 2.0: DeviceInterfaceGUIDs is a list of GUIDs in braces",
        );
    }
}

fn is_guid(text: &str) -> bool {
    let Some(inner) = text.strip_prefix('{').and_then(|text| text.strip_suffix('}')) else {
        return false;
    };
    let parts: Vec<&str> = inner.split('-').collect();
    parts.iter().map(|part| part.len()).eq([8, 4, 4, 4, 12])
        && parts
            .iter()
            .all(|part| part.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(kind: u8, index: u8, length: u16, data: &[u8]) -> ControlTransfer {
        let [low, high] = length.to_le_bytes();
        ControlTransfer {
            at_ns: 0,
            setup: [0x80, 6, index, kind, 0, 0, low, high],
            data: data.to_vec(),
            outcome: ControlOutcome::Done,
        }
    }

    /// The answers of a vendor device made up from the examples of the standards.
    fn answers() -> Vec<ControlTransfer> {
        let device = [18, 1, 0x01, 2, 0, 0, 0, 64, 0x09, 0x12, 1, 0, 0x10, 0, 1, 2, 3, 1];
        let configuration = [
            9, 2, 32, 0, 1, 1, 0, 0xC0, 50, 9, 4, 0, 0, 2, 0xFF, 0, 0, 0, 7, 5, 0x01, 2, 64, 0, 0, 7, 5,
            0x81, 2, 64, 0, 0,
        ];
        let mut bos = vec![5, 15, 33, 0, 1, 28, 16, 5, 0];
        bos.extend(MICROSOFT_OS_2);
        bos.extend([0, 0, 3, 6, 30, 0, 0x20, 0]);
        let set = *b"\x0A\0\0\0\0\0\x03\x06\x1E\0\x14\0\x03\0WINUSB\0\0\0\0\0\0\0\0\0\0";
        let mut set = read(0, 0, 30, &set);
        set.setup = [0xC0, 0x20, 0, 0, 7, 0, 30, 0];
        let mut answers = vec![
            read(DEVICE, 0, 18, &device),
            read(CONFIGURATION, 0, 9, &configuration[..9]),
            read(CONFIGURATION, 0, 32, &configuration),
            read(BOS, 0, 33, &bos),
            set,
            read(STRING, 0, 255, &[4, 3, 9, 4]),
        ];
        answers.extend((1..4).map(|index| read(STRING, index, 255, &[4, 3, b'A', 0])));
        answers
    }

    #[test]
    fn a_device_that_keeps_every_rule_is_found_without_fault() {
        assert_eq!(violations(&answers()), [""; 0]);
    }

    #[test]
    fn every_broken_rule_is_named() {
        // (which answer, which byte, what it becomes, a word of the finding)
        let cases: [(usize, usize, u8, &str); 24] = [
            (0, 0, 17, "18 bytes"),
            (0, 1, 2, "type of the device"),
            (0, 2, 0x0A, "binary-coded"),
            (0, 6, 1, "neither subclass"),
            (0, 7, 63, "endpoint 0"),
            (0, 17, 0, "one configuration"),
            (0, 15, 9, "string 9 is named"),
            (2, 2, 31, "wTotalLength"),
            (2, 4, 2, "bNumInterfaces"),
            (2, 5, 0, "configuration 0"),
            (2, 7, 0x40, "bit 7"),
            (2, 8, 251, "500 mA"),
            (2, 13, 3, "fewer endpoints"),
            (2, 13, 1, "more endpoints"),
            (2, 20, 0x81, "twice"),
            (2, 20, 0x11, "reserved bits zero"),
            (2, 21, 0x06, "bmAttributes are zero"),
            (2, 22, 63, "bulk packets"),
            (3, 4, 2, "bNumDeviceCaps"),
            (3, 8, 1, "bReserved"),
            (4, 8, 31, "promised"),
            (4, 10, 19, "length of a descriptor"),
            (4, 14, b'X', "driverless"),
            (6, 0, 5, "string 1: length"),
        ];
        for (answer, byte, value, words) in cases {
            let mut broken = answers();
            broken[answer].data[byte] = value;
            let found = violations(&broken);
            assert!(
                found.iter().any(|line| line.contains(words)),
                "byte {byte} of answer {answer} = {value}: {found:?}"
            );
        }
        let mut fast = answers();
        fast.push(read(DEVICE_QUALIFIER, 0, 10, &[10, 6, 0, 2, 0, 0, 0, 64, 1, 0]));
        assert!(violations(&fast)[0].contains("qualifier"));
        let mut without_bos = answers();
        without_bos.remove(3);
        assert!(violations(&without_bos)[0].contains("promises a BOS"));
    }
}
