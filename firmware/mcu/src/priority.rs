//! Interrupt priorities, critical sections, and how a task blocks the map-to-line path.
//!
//! The map-to-line path ([`PATH_LEVEL`]) interrupts even critical sections of the HAL and of the log: it shares nothing with them.
//! It shares the program with the task `control`, which blocks it with [`block_path`].
//! Limits: no other interrupt may lie above [`CEILING`]; [`set`] puts all of them at or below it.

use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};

use cortex_m::peripheral::DWT;
use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;
use embassy_stm32::interrupt::{self, InterruptExt, Priority};

/// The map-to-line path: the interrupts of the USB core (`usb_interrupt`) and, while its maps count, of the host's UART (`uart`). Neither interrupts
/// the other.
const PATH_LEVEL: Priority = Priority::P2;
/// What critical sections block, with everything below: the rest of USB, and the host's UART while maps over USB count.
const CEILING: Priority = Priority::P3;
/// The safety tick and what wakes it.
const TICK: Priority = Priority::P4;
/// All others. A byte from the gripper may wait 87 µs, longer than any blocking time.
pub(crate) const OTHERS: Priority = Priority::P5;

/// An interrupt of the map-to-line path.
#[derive(Clone, Copy)]
pub(crate) enum Path {
    /// The USB core's.
    Usb = 0,
    /// The host's UART's.
    Uart = 1,
}

/// When something blocked an interrupt of the path last, cycles.
struct Blocked {
    since: AtomicU32,
    until: AtomicU32,
}

impl Blocked {
    const fn never() -> Self {
        Self {
            since: AtomicU32::new(0),
            until: AtomicU32::new(0),
        }
    }
}

/// By [`Path`].
static BLOCKED: [Blocked; 2] = [Blocked::never(), Blocked::never()];

/// From the request of an interrupt to its handler's first instruction, cycles: 12 for the integer registers, 17 more when those
/// of the floating-point unit are moved, and a refill (ARM DDI 0439, section 3.9).
const ENTRY_CYCLES: u32 = 35;
/// From the last look at the counter with the path blocked to the first in its handler, cycles at most.
const LET_RUN_CYCLES: u32 = ENTRY_CYCLES + 40;

/// Notes that an interrupt of the path was blocked since the counter said `since`, until now.
#[inline]
pub(crate) fn note_blocked(path: Path, since: u32) {
    let blocked = &BLOCKED[path as usize];
    blocked.since.store(since, Ordering::Relaxed);
    blocked.until.store(DWT::cycle_count(), Ordering::Relaxed);
}

/// For an interrupt of the path, when it is `entered`: since when it may have been pending, at the earliest, cycles. The chip stamps no request; what
/// comes while nobody blocks it is entered at once, and what is entered as soon as it was let run may have come when the blocking began.
#[inline]
pub(crate) fn requested(path: Path, entered: u32) -> u32 {
    let blocked = &BLOCKED[path as usize];
    if entered.wrapping_sub(blocked.until.load(Ordering::Relaxed)) <= LET_RUN_CYCLES {
        blocked.since.load(Ordering::Relaxed)
    } else {
        entered.wrapping_sub(ENTRY_CYCLES)
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
    interrupt::USART1.set_priority(CEILING);
    interrupt::UART5.set_priority(TICK);
    interrupt::TIM5.set_priority(TICK);
}

/// Puts the host's UART on the path's level while its maps count, and below it while those over USB do: what does not count holds nothing up.
#[inline]
pub(crate) fn let_uart(counts: bool) {
    interrupt::USART1.set_priority(if counts { PATH_LEVEL } else { CEILING });
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
    note_blocked(Path::Usb, since);
    note_blocked(Path::Uart, since);
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
