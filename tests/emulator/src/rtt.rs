//! The debug probe's side of RTT: takes the raw log bytes (defmt frames) out of the firmware's up-channel 0.
//! Layout of the control block as SEGGER's RTT documentation gives it for 32-bit pointers; words are little-endian.
//! Limits: channel 0 only; the block is found by its symbol, so an image without symbols has no log.

use rigless::emulator::Memory;
use rigless::soc::Width;

/// The symbol that every RTT implementation gives its control block.
pub(crate) const SYMBOL: &str = "_SEGGER_RTT";

/// What the block starts with once the firmware has set it up.
const ID: [u8; 10] = *b"SEGGER RTT";
/// Where up-channel 0's descriptor keeps what the probe needs: bytes from the block's start.
const BUFFER: u64 = 28;
const SIZE: u64 = 32;
const WRITE_OFFSET: u64 = 36;
const READ_OFFSET: u64 = 40;
/// A larger buffer than any firmware has: what a spoiled descriptor must not make the probe read.
const MAX_SIZE: u64 = 1 << 16;

/// Takes what the firmware logged since the last call from the block at `block`; nothing while there is none.
pub(crate) fn drain(memory: &mut dyn Memory, block: u64) -> Vec<u8> {
    take(memory, block).unwrap_or_default()
}

fn take(memory: &mut dyn Memory, block: u64) -> Option<Vec<u8>> {
    for (at, byte) in (block..).zip(ID) {
        if memory.read(at, Width::W8).ok()? != u64::from(byte) {
            return None;
        }
    }
    let mut word = |offset| memory.read(block + offset, Width::W32).ok();
    let (buffer, size, write, read) = (
        word(BUFFER)?,
        word(SIZE)?,
        word(WRITE_OFFSET)?,
        word(READ_OFFSET)?,
    );
    if size > MAX_SIZE || write >= size || read >= size {
        return None;
    }
    let waiting = (write + size - read) % size;
    let bytes = (0..waiting)
        .map(|n| {
            memory
                .read(buffer + (read + n) % size, Width::W8)
                .ok()
                .map(|byte| byte as u8)
        })
        .collect::<Option<Vec<u8>>>()?;
    memory.write(block + READ_OFFSET, Width::W32, write).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rigless::emulator::Error;

    const BASE: u64 = 0x2000_0000;
    const BUFFER_AT: u64 = 64;

    /// A little memory at [`BASE`].
    struct Ram([u8; 96]);

    impl Ram {
        /// A block at the base with a 16-byte buffer behind it and these offsets.
        fn with_block(write: u32, read: u32) -> Self {
            let mut ram = Self([0; 96]);
            ram.0[..ID.len()].copy_from_slice(&ID);
            for (offset, value) in [
                (BUFFER, (BASE + BUFFER_AT) as u32),
                (SIZE, 16),
                (WRITE_OFFSET, write),
                (READ_OFFSET, read),
            ] {
                ram.0[offset as usize..][..4].copy_from_slice(&value.to_le_bytes());
            }
            for n in 0..16 {
                ram.0[BUFFER_AT as usize + n] = n as u8;
            }
            ram
        }
    }

    impl Memory for Ram {
        fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
            let start = (address - BASE) as usize;
            let bytes = self.0.get(start..start + width.bytes() as usize);
            let bytes = bytes.ok_or(Error::Memory { address, width })?;
            Ok(bytes
                .iter()
                .rev()
                .fold(0, |value, &byte| value << 8 | u64::from(byte)))
        }

        fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
            let start = (address - BASE) as usize;
            let bytes = width.bytes() as usize;
            self.0[start..start + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
            Ok(())
        }
    }

    #[test]
    fn what_was_logged_is_taken_once_and_across_the_end_of_the_ring() {
        let mut ram = Ram::with_block(3, 14);
        assert_eq!(drain(&mut ram, BASE), [14, 15, 0, 1, 2]);
        assert_eq!(drain(&mut ram, BASE), [], "the read offset was moved past them");
    }

    #[test]
    fn a_block_that_is_not_set_up_or_spoiled_gives_nothing() {
        assert_eq!(drain(&mut Ram([0; 96]), BASE), []);
        assert_eq!(
            drain(&mut Ram::with_block(16, 0), BASE),
            [],
            "a write offset past the ring"
        );
        let mut outside = Ram::with_block(3, 0);
        outside.0[BUFFER as usize..][..4].copy_from_slice(&0x3000_0000_u32.to_le_bytes());
        assert_eq!(drain(&mut outside, BASE), [], "a ring outside the memory");
    }
}
