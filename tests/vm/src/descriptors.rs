//! What a functionfs device writes to its control endpoint before anything else: the interface of the firmware's binary, at
//! full and at high speed (Linux, include/uapi/linux/usb/functionfs.h). The addresses are numbers to tell endpoints apart:
//! the device controller gives them others.

const DESCRIPTORS_MAGIC: u32 = 3;
const HAS_FULL_SPEED: u32 = 1;
const HAS_HIGH_SPEED: u32 = 2;
const STRINGS_MAGIC: u32 = 2;
/// Bulk packets at full speed, the firmware's; high speed has no other size than this.
const FULL_SPEED_BYTES: u16 = 64;
const HIGH_SPEED_BYTES: u16 = 512;
/// Interface and two endpoints.
const PER_SPEED: u32 = 3;

/// The descriptors' block.
pub(crate) fn descriptors() -> Vec<u8> {
    let body: Vec<u8> = [FULL_SPEED_BYTES, HIGH_SPEED_BYTES]
        .into_iter()
        .flat_map(of_speed)
        .collect();
    let header_bytes = 5 * size_of::<u32>();
    let header = [
        DESCRIPTORS_MAGIC,
        (header_bytes + body.len()) as u32,
        HAS_FULL_SPEED | HAS_HIGH_SPEED,
        PER_SPEED,
        PER_SPEED,
    ];
    little_endian(&header).chain(body).collect()
}

/// The strings' block: the interface has none.
pub(crate) fn strings() -> Vec<u8> {
    little_endian(&[STRINGS_MAGIC, 4 * size_of::<u32>() as u32, 0, 0]).collect()
}

fn little_endian(words: &[u32]) -> impl Iterator<Item = u8> {
    words.iter().flat_map(|word| word.to_le_bytes())
}

/// Vendor-specific interface with bulk OUT and IN.
fn of_speed(packet_bytes: u16) -> Vec<u8> {
    let [low, high] = packet_bytes.to_le_bytes();
    let mut bytes = vec![9, 4, 0, 0, 2, 0xFF, 0, 0, 0];
    for address in [0x01, 0x81] {
        bytes.extend([7, 5, address, 2, low, high, 0]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_is_the_one_that_is_written() {
        let block = descriptors();
        assert_eq!(block[4..8], (block.len() as u32).to_le_bytes());
        let mut rest = &block[20..];
        let mut count = 0;
        while let Some(&length) = rest.first() {
            rest = &rest[usize::from(length)..];
            count += 1;
        }
        assert_eq!(count, 2 * PER_SPEED);
        assert_eq!(strings().len(), 16);
    }
}
