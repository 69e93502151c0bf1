//! The brown-out level in a chip's option bytes, set through the debug probe: level 3 holds the chip in reset below 2.83 V.
//!
//! The registers are those of RM0090 section 3.9. Only the two bits of the level change. Limits: no board has confirmed it; what
//! probe-rs reads back afterwards decides.

use std::process::Command;

use crate::error::Error;
use crate::process;

/// Key, status and option control registers.
const FLASH_OPTKEYR: u32 = 0x4002_3C08;
const FLASH_SR: u32 = 0x4002_3C0C;
const FLASH_OPTCR: u32 = 0x4002_3C14;
/// What unlocks the option control register, in this order.
const KEYS: [u32; 2] = [0x0819_2A3B, 0x4C5D_6E7F];
/// Bits of the option control register: locked, start, and the level, which is 0 for level 3.
const OPTLOCK: u32 = 1;
const OPTSTRT: u32 = 1 << 1;
const BOR_LEV: u32 = 0b11 << 2;
/// The flash is busy.
const BSY: u32 = 1 << 16;
/// How often the status is read until the option bytes are written: each takes some 100 ms.
const POLLS: u32 = 50;

/// Writes (register, value) that set level 3; none when it is set.
fn writes(options: u32) -> Vec<(u32, u32)> {
    if options & BOR_LEV == 0 {
        return Vec::new();
    }
    let options = options & !(BOR_LEV | OPTLOCK | OPTSTRT);
    vec![
        (FLASH_OPTKEYR, KEYS[0]),
        (FLASH_OPTKEYR, KEYS[1]),
        (FLASH_OPTCR, options),
        (FLASH_OPTCR, options | OPTSTRT),
    ]
}

/// Sets brown-out level 3 unless it is set. `tool` makes a probe-rs command of a verb.
pub(crate) fn set_brown_out_level(tool: impl Fn(&str) -> Command) -> Result<(), Error> {
    let read = |register: u32| -> Result<u32, Error> {
        let text = process::word_of(tool("read").args(["b32", &format!("{register:#010x}"), "1"]))?;
        parsed(&text)
    };
    let writes = writes(read(FLASH_OPTCR)?);
    if writes.is_empty() {
        return Ok(());
    }
    for (register, value) in writes {
        process::run(tool("write").args(["b32", &format!("{register:#010x}"), &format!("{value:#010x}")]))?;
    }
    for _ in 0..POLLS {
        if read(FLASH_SR)? & BSY == 0 {
            break;
        }
    }
    let options = read(FLASH_OPTCR)?;
    if options & (BOR_LEV | OPTSTRT) == 0 {
        return Ok(());
    }
    Err(Error::Product {
        what: "brown-out level in the option bytes".to_owned(),
        found: format!("FLASH_OPTCR {options:#010x}"),
        expected:
            "bits 1 to 3 zero (level 3, written): flash again, or set it with the programmer's own program"
                .to_owned(),
    })
}

/// A word as probe-rs prints it.
fn parsed(text: &str) -> Result<u32, Error> {
    let digits = text.trim_start_matches("0x");
    u32::from_str_radix(digits, 16).map_err(|_| Error::Product {
        what: "probe-rs read".to_owned(),
        found: format!("{text:?}"),
        expected: "a word in hexadecimal digits: update probe-rs".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_level_changes_and_only_when_it_is_not_set() {
        // As delivered: level off, locked.
        let options = 0x0FFF_AAED;
        assert_eq!(
            writes(options),
            [
                (0x4002_3C08, 0x0819_2A3B),
                (0x4002_3C08, 0x4C5D_6E7F),
                (0x4002_3C14, 0x0FFF_AAE0),
                (0x4002_3C14, 0x0FFF_AAE2),
            ]
        );
        assert_eq!(writes(0x0FFF_AAE1), []);
    }

    #[test]
    fn a_word_is_read_as_probe_rs_prints_it_and_nothing_else_is() {
        assert_eq!(parsed("0fffaaed").ok(), Some(0x0FFF_AAED));
        assert_eq!(parsed("0x0fffaaed").ok(), Some(0x0FFF_AAED));
        assert!(parsed("no probe").is_err());
    }
}
