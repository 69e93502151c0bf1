//! The two flash sectors that keep the settings: sectors 1 and 2 of the chip, 16 KiB each, left free by memory.x.
//!
//! The processor stalls while the flash is busy, because it runs from it: up to 0.8 s for an erasure (data sheet, 16 KiB at 2.7
//! to 3.6 V), 100 µs for a word. The gripper must hold nothing then, and the watchdog gets a longer period.
//! Units: words of 32 bits.

use core::ptr;

use cortex_m::asm;
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::regs::{Cr, Sr};
use embassy_stm32::pac::flash::vals::Psize;
use gripline_firmware::storage::SettingsFlash;

/// First address of sector 1.
const BASE: usize = 0x0800_4000;
const SECTOR_BYTES: usize = 16 * 1024;
/// The sector of slot 0.
const FIRST_SECTOR: u8 = 1;
/// What unlocks the controller, in this order (reference manual, section 3.6.1).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Write protection, alignment, parallelism and sequence errors in the status register (section 3.9.6).
const ERRORS: u32 = 0b1111 << 4;
/// Processor cycles between two reads of the controller's status: 10 µs.
const POLL_CYCLES: u32 = 1_680;

/// The flash refused: a protected sector, or an access out of order.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
pub(crate) struct Refused;

/// The two sectors. Only the task `control` uses them, between two ticks.
pub(crate) struct SettingsSectors(());

impl SettingsSectors {
    /// Call it once.
    pub(crate) fn new() -> Self {
        Self(())
    }

    fn address(slot: usize, word: usize) -> *mut u32 {
        ptr::with_exposed_provenance_mut(BASE + slot * SECTOR_BYTES + word * 4)
    }

    /// Unlocks, sets the controller to `mode`, starts its operation (an erasure, or a word's value at its address),
    /// waits for its end, locks.
    #[inline(never)]
    fn operate(mode: Cr, word: Option<(*mut u32, u32)>) -> Result<(), Refused> {
        for key in KEYS {
            FLASH.keyr().write_value(key);
        }
        // Clear the flags of an earlier operation: writing ones does.
        FLASH.sr().write_value(Sr(ERRORS));
        FLASH.cr().write_value(mode);
        match word {
            // SAFETY: inside the two sectors, which hold only settings; the controller is set to program words.
            Some((address, value)) => unsafe { address.write_volatile(value) },
            None => FLASH.cr().modify(|control| control.set_strt(true)),
        }
        asm::dsb();
        while FLASH.sr().read().bsy() {
            asm::delay(POLL_CYCLES);
        }
        let flags = FLASH.sr().read().0;
        FLASH.cr().write(|control| control.set_lock(true));
        if flags & ERRORS == 0 { Ok(()) } else { Err(Refused) }
    }
}

impl SettingsFlash for SettingsSectors {
    type Error = Refused;

    fn read(&self, slot: usize, word: usize) -> u32 {
        // SAFETY: inside the two sectors for every slot and word that the library asks for; any bits are a `u32`.
        unsafe { Self::address(slot, word).read_volatile() }
    }

    fn erase(&mut self, slot: usize) -> Result<(), Refused> {
        let mut mode = Cr(0);
        mode.set_psize(Psize::PSIZE32);
        mode.set_ser(true);
        mode.set_snb(FIRST_SECTOR + slot as u8);
        Self::operate(mode, None)
    }

    fn program(&mut self, slot: usize, word: usize, value: u32) -> Result<(), Refused> {
        let mut mode = Cr(0);
        mode.set_psize(Psize::PSIZE32);
        mode.set_pg(true);
        Self::operate(mode, Some((Self::address(slot, word), value)))
    }
}
