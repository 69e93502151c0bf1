//! Copies the code of the map-to-line path from flash to SRAM (see hot.x), before `main` and before any interrupt.

use core::arch::naked_asm;

/// Called by the start-up code, which has set up nothing yet but the stack.
///
/// # Safety
/// Called once, by the reset handler; uses registers that every function may.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn __pre_init() {
    naked_asm!(
        "ldr r0, =__hot_start",
        "ldr r1, =__hot_end",
        "ldr r2, =__hot_load",
        "1:",
        "cmp r0, r1",
        "beq 2f",
        "ldm r2!, {{r3}}",
        "stm r0!, {{r3}}",
        "b 1b",
        "2:",
        "bx lr",
    )
}
