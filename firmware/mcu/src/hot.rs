//! What comes before `main` and any interrupt: the way into the bootloader, then the copy of the code that runs from SRAM out of
//! the flash (see hot.x).

use core::arch::naked_asm;

use crate::bootloader;

/// Called by the start-up code, which has set up nothing yet but the stack. Eight words a round, which the linker script makes
/// the code a multiple of: 22 cycles of 16 MHz for 32 bytes.
///
/// # Safety
/// Called once, by the reset handler.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn __pre_init() {
    naked_asm!(
        "push {{r4, r5, r6, r7, r8, r9, r10, lr}}",
        "bl {bootloader}",
        "ldr r0, =__hot_start",
        "ldr r1, =__hot_end",
        "ldr r2, =__hot_load",
        "b 2f",
        "1:",
        "ldm r2!, {{r3, r4, r5, r6, r7, r8, r9, r10}}",
        "stm r0!, {{r3, r4, r5, r6, r7, r8, r9, r10}}",
        "2:",
        "cmp r0, r1",
        "bne 1b",
        "pop {{r4, r5, r6, r7, r8, r9, r10, pc}}",
        bootloader = sym bootloader::enter_if_asked,
    )
}
