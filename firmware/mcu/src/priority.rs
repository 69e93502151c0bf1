//! Who may interrupt whom, and who is held off when.
//!
//! The map-to-line path ([`PATH`]) interrupts everything, critical sections of the HAL and of the log included: it shares
//! nothing with them. What it does share, the program, is reached from below under [`hold_off`] alone.
//! Limits: no interrupt but the path may lie above [`CEILING`], so [`set`] puts every one of them at or below it.

use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::asm;
use cortex_m::peripheral::NVIC;
use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;
use embassy_stm32::interrupt::{self, InterruptExt, Priority};

/// The map-to-line path: the USB core's interrupt (`usb_interrupt`).
const PATH: Priority = Priority::P2;
/// What critical sections hold off, with everything below: a byte from the UART must leave it within one byte time
/// (10.9 µs), and the rest of USB.
const CEILING: Priority = Priority::P3;
/// The safety tick and what wakes it.
const TICK: Priority = Priority::P4;
/// All others. A byte from the gripper may wait 87 µs, longer than any decision.
pub(crate) const OTHERS: Priority = Priority::P5;

/// Before any interrupt is let in.
pub(crate) fn set() {
    // SAFETY: start-up; priorities are a matter of this function alone.
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

/// Runs `work` with the map-to-line path held off. Part of the path's time bound: `cargo xtask latency` finds every use.
#[inline]
pub(crate) fn hold_off<T>(work: impl FnOnce() -> T) -> T {
    let before = basepri::read();
    basepri_max::write(PATH as u8);
    compiler_fence(Ordering::SeqCst);
    let done = work();
    compiler_fence(Ordering::SeqCst);
    // SAFETY: what it was.
    unsafe { basepri::write(before) };
    done
}

/// Runs `work` with the USB core's interrupt alone held off: for packets from the UART, whose next bytes must not wait for
/// them. Who sends maps over both links at once makes one wait for the other; this project's hosts use one.
#[inline]
pub(crate) fn without_usb<T>(work: impl FnOnce() -> T) -> T {
    NVIC::mask(interrupt::OTG_FS);
    asm::dsb();
    asm::isb();
    let done = work();
    compiler_fence(Ordering::SeqCst);
    // SAFETY: no critical section stands on this mask.
    unsafe { NVIC::unmask(interrupt::OTG_FS) };
    done
}

/// Critical sections of the HAL, the executors and the log.
struct Section;
critical_section::set_impl!(Section);

// SAFETY: with everything held off that uses critical sections, no two overlap on the one core; the path uses none.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        basepri_max::write(CEILING as u8);
        compiler_fence(Ordering::SeqCst);
        before
    }

    unsafe fn release(before: RawRestoreState) {
        compiler_fence(Ordering::SeqCst);
        // SAFETY: what it was.
        unsafe { basepri::write(before) };
    }
}
