//! After a panic, a hard fault or an unexpected interrupt the chip restarts at once. Waiting for the watchdog would leave the
//! grip without control for up to 188 ms. The line keeps its value until the reset, and `reset` restores it.
//!
//! Two code addresses survive the reset, and the next start logs them: `addr2line` finds the source lines.

use core::arch::naked_asm;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m::register::msp;
use cortex_m_rt::exception;

use crate::reset::{self, PANIC_ADDRESSES};
use crate::stack;

/// Odd words in these ranges count as return addresses: Thumb code in flash and in SRAM.
const CODE: [core::ops::Range<u32>; 2] = [0x0800_0000..0x0810_0000, 0x2000_0000..0x2002_0000];

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    gripline_panic()
}

/// Where every panic ends. Debuggers and the emulated board find it by its name.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn gripline_panic() -> ! {
    cortex_m::interrupt::disable();
    restart(return_addresses(msp::read()))
}

/// The first words on the stack that look like return addresses.
fn return_addresses(stack: u32) -> [u32; PANIC_ADDRESSES] {
    unsafe extern "C" {
        static _stack_start: u32;
    }
    let end = (&raw const _stack_start).addr() as u32;
    let mut addresses = [0; PANIC_ADDRESSES];
    let mut filled = 0;
    for address in (stack..end).step_by(4) {
        // SAFETY: between the stack pointer and the stack's upper end there is RAM.
        let word = unsafe { core::ptr::with_exposed_provenance::<u32>(address as usize).read_volatile() };
        if CODE.iter().any(|range| range.contains(&word)) && word & 1 == 1 && filled < PANIC_ADDRESSES {
            addresses[filled] = word;
            filled += 1;
        }
    }
    addresses
}

/// A hard fault, the stack's overflow among them: keeps the address of the instruction and of its caller, and gives the rest a
/// stack, because an overflow leaves none.
#[unsafe(naked)]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".HardFault.user")]
#[allow(non_snake_case, reason = "the name that the vector table looks for")]
unsafe extern "C" fn HardFault() -> ! {
    naked_asm!(
        "mrs r2, msp",
        "ldr r3, =_stack_end",
        "cmp r2, r3",
        "bhs 1f",
        "ldr r0, ={overflow}",
        "mov r1, r2",
        "b 2f",
        "1:",
        // Return address and link register of the frame that the exception left (ARM DDI 0403, B1.5.6).
        "ldr r0, [r2, #24]",
        "ldr r1, [r2, #20]",
        "2:",
        "ldr r3, =_stack_start",
        "mov sp, r3",
        "b {restart}",
        overflow = const stack::OVERFLOW,
        restart = sym restart_after_fault,
    )
}

extern "C" fn restart_after_fault(address: u32, caller: u32) -> ! {
    restart([address, caller])
}

/// An interrupt without a handler; nothing enables one.
#[exception]
unsafe fn DefaultHandler(_number: i16) {
    gripline_panic()
}

fn restart(addresses: [u32; PANIC_ADDRESSES]) -> ! {
    reset::keep_panic(addresses);
    SCB::sys_reset()
}
