//! The bytes of the flash array while the firmware writes it (RM0090 section 3.6). rigless's FLASH has the registers,
//! their locks and times; what an erasure and a store leave in the array is here.
//! An erasure under way leaves rubbish, so that a power cut in it is as bad as it gets. A store counts when the controller
//! is unlocked, idle and set to program whole words; it turns ones into zeros only.
//! Limits: the processor does not stall while the array is busy; no mass erasure.

use rigless::emulator::{Access, AccessKind, Host};
use rigless::soc::Width;

use crate::constants::{FLASH_BASE, FLASH_BYTES, FLASH_CR, FLASH_SR, SETTINGS_BASE, SETTINGS_BYTES};

/// Bits of the control and status registers (sections 3.9.6 and 3.9.8).
mod bits {
    pub(super) const PG: u64 = 1;
    pub(super) const SER: u64 = 1 << 1;
    pub(super) const SNB_SHIFT: u64 = 3;
    pub(super) const SNB_MASK: u64 = 0x1F;
    pub(super) const PSIZE: u64 = 0b11 << 8;
    pub(super) const PSIZE_WORD: u64 = 0b10 << 8;
    pub(super) const STRT: u64 = 1 << 16;
    pub(super) const LOCK: u64 = 1 << 31;
    pub(super) const BSY: u64 = 1 << 16;
}

/// What the array reads while it is being erased.
const RUBBISH: u64 = 0xA55A_C396;
const ERASED: u64 = 0xFFFF_FFFF;

/// The array's own state: what the registers do not say.
#[derive(Debug, Default)]
pub(crate) struct FlashArray {
    /// Start and length of the sector that is being erased.
    erasing: Option<(u64, u64)>,
    is_changed: bool,
}

impl FlashArray {
    /// After every access that the core made: `value` is what a register read or holds now, `control` gives `CR`.
    pub(crate) fn settled(
        &mut self,
        access: &Access,
        value: u64,
        control: impl FnOnce() -> u64,
        host: &mut dyn Host,
    ) {
        match access.kind {
            AccessKind::Read if access.address == FLASH_SR && value & bits::BSY == 0 => {
                if let Some(sector) = self.erasing.take() {
                    self.fill(sector, ERASED, host);
                }
            }
            AccessKind::Write if access.address == FLASH_CR => {
                let control = control();
                if control & (bits::STRT | bits::SER | bits::LOCK) == bits::STRT | bits::SER {
                    let sector = sector((control >> bits::SNB_SHIFT) & bits::SNB_MASK);
                    self.erasing = Some(sector);
                    self.fill(sector, RUBBISH, host);
                }
            }
            AccessKind::Write
                if (FLASH_BASE..FLASH_BASE + FLASH_BYTES).contains(&access.address)
                    && access.width == Width::W32 =>
            {
                let mode = control() & (bits::PG | bits::PSIZE | bits::LOCK);
                if mode == bits::PG | bits::PSIZE_WORD && self.erasing.is_none() {
                    let before = host.read(access.address, Width::W32).unwrap_or(ERASED);
                    self.put(access.address, before & access.value, host);
                }
            }
            _ => {}
        }
    }

    /// What lies where the firmware keeps its settings, when that has changed since the last call.
    pub(crate) fn take_changed_settings(&mut self, host: &mut dyn Host) -> Option<Vec<u8>> {
        std::mem::take(&mut self.is_changed).then(|| {
            (SETTINGS_BASE..SETTINGS_BASE + SETTINGS_BYTES)
                .map(|at| host.read(at, Width::W8).unwrap_or(0) as u8)
                .collect()
        })
    }

    fn fill(&mut self, (start, bytes): (u64, u64), word: u64, host: &mut dyn Host) {
        for at in (start..start + bytes).step_by(4) {
            self.put(at, word, host);
        }
    }

    fn put(&mut self, at: u64, word: u64, host: &mut dyn Host) {
        self.is_changed |= host.program(at, Width::W32, word).is_ok();
    }
}

/// Start and length of a sector of bank 1: four of 16 KiB, one of 64, the rest of 128 (RM0090 table 6).
fn sector(number: u64) -> (u64, u64) {
    const KIB: u64 = 1024;
    let (start, bytes) = match number {
        0..=3 => (number * 16 * KIB, 16 * KIB),
        4 => (64 * KIB, 64 * KIB),
        _ => ((number - 4) * 128 * KIB, 128 * KIB),
    };
    (FLASH_BASE + start, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_of_bank_one_lie_end_to_end_over_one_mebibyte() {
        let mut end = FLASH_BASE;
        for number in 0..12 {
            let (start, bytes) = sector(number);
            assert_eq!(start, end, "sector {number}");
            end = start + bytes;
        }
        assert_eq!(end, FLASH_BASE + (1 << 20));
        assert_eq!(sector(1).0, SETTINGS_BASE);
    }
}
