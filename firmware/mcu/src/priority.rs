//! Interrupt priorities, critical sections, and how a task blocks the map-to-line path.
//!
//! The map-to-line path ([`PATH_LEVEL`]) interrupts even critical sections of the HAL and of the log: it shares nothing with them.
//! It shares the program with the task `control`, which blocks it with [`block_path`].
//! Limits: no other interrupt may lie above [`CEILING`]; [`set`] puts all of them at or below it.

use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};

use cortex_m::peripheral::{DWT, NVIC};
use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;
use embassy_stm32::interrupt::{self, InterruptExt, Priority};

/// The map-to-line path: the interrupts of the USB core (`usb_interrupt`) and of the host's UART (`uart`). Neither interrupts the other.
const PATH_LEVEL: Priority = Priority::P2;
/// What critical sections block, with everything below: the rest of USB.
const CEILING: Priority = Priority::P3;
/// The safety tick and what wakes it.
const TICK: Priority = Priority::P4;
/// All others. A byte from the gripper may wait 87 µs, longer than any blocking time.
pub(crate) const OTHERS: Priority = Priority::P5;

/// An interrupt of the map-to-line path.
#[derive(Clone, Copy)]
pub(crate) enum Path {
    /// The USB core's.
    Usb,
    /// The host's UART's.
    Uart,
}

impl Path {
    #[inline]
    const fn interrupt(self) -> interrupt::Interrupt {
        match self {
            Self::Usb => interrupt::OTG_FS,
            Self::Uart => interrupt::USART1,
        }
    }

    /// Since when it may have waited for who blocked it last, cycles; 0 when it did not.
    #[inline]
    const fn waits_since(self) -> &'static AtomicU32 {
        static USB: AtomicU32 = AtomicU32::new(0);
        static UART: AtomicU32 = AtomicU32::new(0);
        match self {
            Self::Usb => &USB,
            Self::Uart => &UART,
        }
    }
}

/// From the request of an interrupt to its handler's first instruction, cycles: 12 for the integer registers, 17 more when those
/// of the floating-point unit are moved, and a refill (ARM DDI 0439, section 3.9).
const ENTRY_CYCLES: u32 = 35;

/// Notes whether an interrupt of the path is pending, before it is let run: since [`DWT::cycle_count`] said this, at the latest. The chip stamps no
/// request; what came while nobody blocked it is entered at once.
#[inline]
pub(crate) fn note_waiting(path: Path, since: u32) {
    let waits_since = path.waits_since();
    if NVIC::is_pending(path.interrupt()) && waits_since.load(Ordering::Relaxed) == 0 {
        waits_since.store(since | 1, Ordering::Relaxed);
    }
}

/// For an interrupt of the path, when it is `entered`: since when it may have been pending, cycles.
#[inline]
pub(crate) fn requested(path: Path, entered: u32) -> u32 {
    let waits_since = path.waits_since();
    match waits_since.load(Ordering::Relaxed) {
        0 => entered.wrapping_sub(ENTRY_CYCLES),
        since => {
            waits_since.store(0, Ordering::Relaxed);
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
    interrupt::OTG_FS.set_priority(PATH_LEVEL);
    interrupt::UART4.set_priority(CEILING);
    interrupt::USART1.set_priority(PATH_LEVEL);
    interrupt::UART5.set_priority(TICK);
    interrupt::TIM5.set_priority(TICK);
}

/// Runs `work` with the map-to-line path blocked. Its blocking time is part of the path's worst-case bound:
/// `cargo xtask latency` finds every use.
#[inline]
pub(crate) fn block_path<T>(work: impl FnOnce() -> T) -> T {
    let before = basepri::read();
    basepri_max::write(PATH_LEVEL as u8);
    let since = DWT::cycle_count();
    compiler_fence(Ordering::SeqCst);
    let done = work();
    compiler_fence(Ordering::SeqCst);
    note_waiting(Path::Usb, since);
    note_waiting(Path::Uart, since);
    // SAFETY: the value from before.
    unsafe { basepri::write(before) };
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
