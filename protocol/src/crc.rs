//! The CRC-32 (ISO-HDLC, as in Ethernet and zip) that ends every map and every message.
//!
//! Units: bytes. Limits: four bytes a step where the bytes are aligned to words, else one byte a step.

use crate::constants::PACKET_MAX;
use crate::rounds::at_most;

/// The reflected polynomial of CRC-32/ISO-HDLC.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Slicing by four: table n holds a byte's effect on the CRC when n bytes of its word follow. This takes a quarter of the
/// time of one table and 4 KiB. (The `crc` crate offers one byte a step in 1 KiB, or sixteen in 16 KiB.)
/// Four separate tables, so that each address stays in a register.
static CRC_0: [u32; 256] = crc_table(0);
static CRC_1: [u32; 256] = crc_table(1);
static CRC_2: [u32; 256] = crc_table(2);
static CRC_3: [u32; 256] = crc_table(3);

const fn crc_table(following: usize) -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u32, 0);
        while bit < 8 * (1 + following) {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ POLYNOMIAL
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// Words per round of the unrolled loop.
const WORDS_AT_ONCE: usize = 4;

/// A CRC-32 in progress, over every byte of a map or message in order, headers included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunningCrc(u32);

impl RunningCrc {
    pub(crate) const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Adds the bytes of a packet; four at a time when they are aligned to words.
    #[inline]
    pub(crate) fn update(&mut self, bytes: &[u8]) {
        let (start, rest) = bytes.split_at(bytes.len() & !3);
        let Ok(words) = bytemuck::try_cast_slice::<u8, u32>(start) else {
            return self.update_bytes(bytes);
        };
        let (blocks, words) = words.as_chunks::<WORDS_AT_ONCE>();
        // Unrolled by hand: the compiler keeps a loop.
        for &[first, second, third, fourth] in at_most::<{ PACKET_MAX / 4 / WORDS_AT_ONCE }, _>(blocks) {
            self.update_word(first);
            self.update_word(second);
            self.update_word(third);
            self.update_word(fourth);
        }
        for &word in at_most::<{ WORDS_AT_ONCE - 1 }, _>(words) {
            self.update_word(word);
        }
        for &byte in at_most::<3, _>(rest) {
            self.update_byte(byte);
        }
    }

    #[cold]
    #[inline(never)]
    fn update_bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.update_byte(byte);
        }
    }

    #[inline]
    fn update_word(&mut self, word: u32) {
        let four = self.0 ^ u32::from_le(word);
        self.0 = CRC_3[(four & 0xFF) as usize]
            ^ CRC_2[(four >> 8 & 0xFF) as usize]
            ^ CRC_1[(four >> 16 & 0xFF) as usize]
            ^ CRC_0[(four >> 24) as usize];
    }

    #[inline]
    fn update_byte(&mut self, byte: u8) {
        self.0 = CRC_0[usize::from(self.0 as u8 ^ byte)] ^ self.0 >> 8;
    }

    #[inline]
    pub(crate) const fn finish(self) -> u32 {
        !self.0
    }
}

/// The CRC-32 (ISO-HDLC) of bytes, as on the wire; for records in flash too.
pub fn crc32(bytes: impl IntoIterator<Item = u8>) -> u32 {
    let mut crc = RunningCrc::new();
    for byte in bytes {
        crc.update(&[byte]);
    }
    crc.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_crc_is_that_of_another_implementation_however_the_bytes_are_cut(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
            cut in 0_usize..300,
        ) {
            // From any address.
            let bytes = &bytes[(cut & 3).min(bytes.len())..];
            let cut = cut.min(bytes.len());
            let mut crc = RunningCrc::new();
            crc.update(&bytes[..cut]);
            crc.update(&bytes[cut..]);
            prop_assert_eq!(crc.finish(), crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(bytes));
        }
    }
}
