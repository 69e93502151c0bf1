//! Interrupt priorities, critical sections, and how a task blocks the map-to-line path.
//!
//! The map-to-line path ([`PATH`]) interrupts even critical sections of the HAL and of the log: it shares nothing with them.
//! It shares the program with the task `control`, which blocks it with [`block_path`].
//! Limits: no other interrupt may lie above [`CEILING`]; [`set`] puts all of them at or below it.

use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};

use cortex_m::asm;
use cortex_m::peripheral::{DWT, NVIC};
use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;
use embassy_stm32::interrupt::{self, InterruptExt, Priority};

/// The map-to-line path: the USB core's interrupt (`usb_interrupt`).
const PATH: Priority = Priority::P2;
/// What critical sections block, with everything below: the host's UART, whose bytes must be read within one byte time
/// (10.9 µs), and the rest of USB.
const CEILING: Priority = Priority::P3;
/// The safety tick and what wakes it.
const TICK: Priority = Priority::P4;
/// All others. A byte from the gripper may wait 87 µs, longer than any blocking time.
pub(crate) const OTHERS: Priority = Priority::P5;

/// Since when the path may have waited for who blocked it last, cycles; 0 when it did not.
static WAITS_SINCE: AtomicU32 = AtomicU32::new(0);

/// From the request of an interrupt to its handler's first instruction, cycles: 12 for the integer registers, 17 more when those
/// of the floating-point unit are moved, and a refill (ARM DDI 0439, section 3.9).
const ENTRY_CYCLES: u32 = 35;

/// Notes that the path is pending, before it is let run: since [`DWT::cycle_count`] said this, at the latest. The chip stamps no request;
/// what came while nobody blocked it is entered at once.
#[inline]
fn note_waiting(since: u32) {
    if NVIC::is_pending(interrupt::OTG_FS) {
        WAITS_SINCE.store(since | 1, Ordering::Relaxed);
    }
}

/// For the path, when it is `entered`: since when it may have been pending, cycles.
#[inline]
pub(crate) fn requested(entered: u32) -> u32 {
    match WAITS_SINCE.load(Ordering::Relaxed) {
        0 => entered.wrapping_sub(ENTRY_CYCLES),
        since => {
            WAITS_SINCE.store(0, Ordering::Relaxed);
            since
        }
    }
}

/// Sets every priority; call it before any interrupt is enabled.
pub(crate) fn set() {
    // SAFETY: start-up; nothing else touches the priorities.
    let core = unsafe { cortex_m::Peripherals::steal() };
    for priority in &core.NVIC.ipr {
        // SAFETY: any value is a priority.
        unsafe { priority.write(OTHERS as u8) };
    }
    interrupt::OTG_FS.set_priority(PATH);
    interrupt::UART4.set_priority(CEILING);
    interrupt::USART1.set_priority(CEILING);
    interrupt::UART5.set_priority(TICK);
    interrupt::TIM5.set_priority(TICK);
}

/// Runs `work` with the map-to-line path blocked. Its blocking time is part of the path's worst-case bound:
/// `cargo xtask latency` finds every use.
#[inline]
pub(crate) fn block_path<T>(work: impl FnOnce() -> T) -> T {
    let before = basepri::read();
    basepri_max::write(PATH as u8);
    let since = DWT::cycle_count();
    compiler_fence(Ordering::SeqCst);
    let done = work();
    compiler_fence(Ordering::SeqCst);
    note_waiting(since);
    // SAFETY: the value from before.
    unsafe { basepri::write(before) };
    done
}

/// Runs `work` with only the USB core's interrupt blocked: for a packet from the UART, whose next bytes must be read
/// meanwhile. A host that sends maps over both links at once makes one wait for the other; this project's hosts use one.
#[inline]
pub(crate) fn block_usb<T>(work: impl FnOnce() -> T) -> T {
    NVIC::mask(interrupt::OTG_FS);
    asm::dsb();
    asm::isb();
    let since = DWT::cycle_count();
    let done = work();
    compiler_fence(Ordering::SeqCst);
    note_waiting(since);
    // SAFETY: no critical section relies on this mask.
    unsafe { NVIC::unmask(interrupt::OTG_FS) };
    done
}

/// Critical sections of the HAL, the executors and the log.
struct Section;
critical_section::set_impl!(Section);

// SAFETY: a section blocks every interrupt that uses sections, so no two overlap on the one core; the path uses none.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        basepri_max::write(CEILING as u8);
        compiler_fence(Ordering::SeqCst);
        before
    }

    unsafe fn release(before: RawRestoreState) {
        compiler_fence(Ordering::SeqCst);
        // SAFETY: the value from before.
        unsafe { basepri::write(before) };
    }
}
