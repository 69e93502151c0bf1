//! A panic, a fault of the core, or an interrupt that nobody serves: the chip restarts at once. The watchdog would take
//! up to 188 ms, in which the grip does not react. The line keeps its last value until then, and `reset` brings it back.
//!
//! What is known of the place is kept over the reset and logged by the next start: addresses of the program, for
//! `addr2line` and its kin; file names would take kilobytes of flash.

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m::register::msp;
use cortex_m_rt::{ExceptionFrame, exception};

use crate::reset::{self, CRASH_PLACES};

/// Odd words in here are return addresses of code in flash.
const FLASH: core::ops::Range<u32> = 0x0800_0000..0x0810_0000;

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    gripline_panic()
}

/// Where every panic ends. The name is for debuggers and for the emulated board, which has the program panic by it.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn gripline_panic() -> ! {
    cortex_m::interrupt::disable();
    restart(return_addresses(msp::read()))
}

/// The first return addresses on the stack, or what looks like them.
fn return_addresses(stack: u32) -> [u32; CRASH_PLACES] {
    unsafe extern "C" {
        static _stack_start: u32;
    }
    let end = (&raw const _stack_start).addr() as u32;
    let mut places = [0; CRASH_PLACES];
    let mut filled = 0;
    for address in (stack..end).step_by(4) {
        // SAFETY: between the stack pointer and the stack's upper end there is RAM.
        let word = unsafe { core::ptr::with_exposed_provenance::<u32>(address as usize).read_volatile() };
        if FLASH.contains(&word) && word & 1 == 1 && filled < CRASH_PLACES {
            places[filled] = word;
            filled += 1;
        }
    }
    places
}

/// A fault of the core: what it was doing, and who called that.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    restart([frame.pc(), frame.lr()])
}

/// An interrupt without a handler: nothing enables one.
#[exception]
unsafe fn DefaultHandler(_number: i16) {
    gripline_panic()
}

fn restart(places: [u32; CRASH_PLACES]) -> ! {
    reset::keep_crash(places);
    SCB::sys_reset()
}
