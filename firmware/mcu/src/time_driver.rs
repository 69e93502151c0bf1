//! The clock of `embassy_time`, on all 32 bits of TIM5. Units: µs since the start.
//!
//! Why not embassy-stm32 0.6's own driver (376 lines): it uses 16 bits of a timer and counts half periods of 32.8 ms by
//! interrupts. (1) It does not clear the match of the initial zero and counts it as a half period, so readings near a rollover
//! are 65.5 ms off (symptom: <https://github.com/embassy-rs/embassy/issues/4883>). (2) Writing the flash stalls this processor
//! for up to 0.8 s, which loses half periods. Upstream has 32 bits after 0.6
//! (<https://github.com/embassy-rs/embassy/pull/6987>, <https://github.com/embassy-rs/embassy/issues/2456>): with that
//! release this file goes. Here a half period takes 36 minutes; the first ends 8.4 s after the start, so that tests meet it.
//!
//! `half_periods` is even while the counter is in its lower half and odd in its upper half, so a reading between a half period
//! and its interrupt is right too.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac::timer::regs::SrGp16;
use embassy_stm32::pac::timer::vals::Urs;
use embassy_stm32::pac::{RCC, TIM5};
use embassy_stm32::{peripherals, rcc};
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;

const HALF_PERIOD_BITS: u32 = 31;
/// The counter's first value, 8.4 s before its half period; one instruction subtracts it.
const COUNTER_START: u32 = 0xFF << 23;
/// Channel 1 of the timer matches in the middle of a period.
const HALF: usize = 0;
/// Channel 2 matches when the next task is to be woken.
const ALARM: usize = 1;

struct Clock {
    half_periods: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    half_periods: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the clock at zero. Call it once, when the processor's clocks run.
pub(crate) fn start() {
    RCC.apb1enr().modify(|enabled| enabled.set_tim5en(true));
    RCC.apb1rstr().modify(|reset| reset.set_tim5rst(true));
    RCC.apb1rstr().modify(|reset| reset.set_tim5rst(false));
    TIM5.psc()
        .write_value((rcc::frequency::<peripherals::TIM5>().0 / TICK_HZ as u32 - 1) as u16);
    TIM5.arr().write_value(u32::MAX);
    TIM5.ccr(HALF).write_value(1 << HALF_PERIOD_BITS);
    // The prescaler takes effect with an update, which must not count as a period.
    TIM5.cr1().modify(|control| control.set_urs(Urs::COUNTER_ONLY));
    TIM5.egr().write(|event| event.set_ug(true));
    TIM5.cnt().write_value(COUNTER_START);
    // Nor may the matches with the initial zero count.
    TIM5.sr().write_value(SrGp16(0));
    TIM5.dier().write(|enabled| {
        enabled.set_uie(true);
        enabled.set_ccie(HALF, true);
        enabled.set_ccie(ALARM, true);
    });
    interrupt::TIM5.unpend();
    // SAFETY: its handler is below, and the priorities are set.
    unsafe { interrupt::TIM5.enable() };
    TIM5.cr1().modify(|control| control.set_cen(true));
}

/// Counts half periods and wakes the tasks that are due.
///
/// Deadline: none of its own; it runs at the priority of the safety tick. Budget: some microseconds. Miss: tasks wake later.
#[embassy_stm32::interrupt]
unsafe fn TIM5() {
    critical_section::with(|section| {
        let came = TIM5.sr().read();
        // Writing zeros clears. Later events stay pending.
        TIM5.sr().write_value(SrGp16(!came.0));
        let half_periods = u32::from(came.uif()) + u32::from(came.ccif(HALF));
        let counted = CLOCK.half_periods.load(Ordering::Relaxed);
        CLOCK
            .half_periods
            .store(counted.wrapping_add(half_periods), Ordering::Relaxed);
        if came.ccif(ALARM) {
            CLOCK.wake(section);
        }
    });
}

impl Clock {
    /// Wakes the tasks that are due and sets the alarm for the next one. An alarm more than a period away, or none, rings early
    /// and wakes nobody.
    fn wake(&self, section: CriticalSection<'_>) {
        let mut queue = self.queue.borrow_ref_mut(section);
        loop {
            let next_us = queue.next_expiration(self.now());
            TIM5.ccr(ALARM)
                .write_value((next_us as u32).wrapping_add(COUNTER_START));
            // An alarm that has passed meanwhile will not ring: look again.
            if self.now() < next_us {
                return;
            }
        }
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        let half_periods = self.half_periods.load(Ordering::Relaxed);
        compiler_fence(Ordering::Acquire);
        let counter = TIM5.cnt().read() ^ ((half_periods & 1) << HALF_PERIOD_BITS);
        (u64::from(half_periods) << HALF_PERIOD_BITS) + u64::from(counter) - u64::from(COUNTER_START)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            let has_changed = self.queue.borrow_ref_mut(section).schedule_wake(at, waker);
            if has_changed {
                self.wake(section);
            }
        });
    }
}
