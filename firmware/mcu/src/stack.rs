//! The stack lies at the lower end of its memory (memory.x), below all data: an overflow leaves the memory instead of writing into
//! data. There the memory protection unit forbids every access, so an overflow is a hard fault at once, whatever the bus would
//! answer. What survives a reset lies above the stack, which cannot reach it.
//!
//! All contexts share the one stack. `cargo xtask latency` adds up the deepest of each over the linked image.
//! Limits: an access that skips 64 MiB would not be seen; no frame is that large.

use cortex_m::asm;

/// Kept in place of the address of a panic when the stack overflowed; no instruction lies there.
pub(crate) const OVERFLOW: u32 = 0xFFFF_FFFE;

/// The first address that is forbidden, 64 MiB below the stack's lower end at 0x1000_0000. The chips have nothing there
/// (reference manual, section 2.3).
const FORBIDDEN: u32 = 0x0C00_0000;
/// Its size as the unit counts it: 2 to the power of one more (ARM DDI 0403, B3.5.9).
const SIZE: u32 = 25;
/// Bits of the region registers (B3.5.8, B3.5.9) and of the control register (B3.5.5).
const VALID: u32 = 1 << 4;
const NEVER_EXECUTE: u32 = 1 << 28;
const ENABLE: u32 = 1;
const OTHER_ADDRESSES_AS_WITHOUT: u32 = 1 << 2;

/// Forbids what lies below the stack. Call it once, at start-up.
pub(crate) fn guard() {
    // SAFETY: start-up; nothing else touches the unit.
    let core = unsafe { cortex_m::Peripherals::steal() };
    // SAFETY: region 0 without any permission, over addresses that no program uses.
    unsafe {
        core.MPU.rbar.write(FORBIDDEN | VALID);
        core.MPU.rasr.write(NEVER_EXECUTE | SIZE << 1 | ENABLE);
        core.MPU.ctrl.write(OTHER_ADDRESSES_AS_WITHOUT | ENABLE);
    }
    asm::dsb();
    asm::isb();
}
