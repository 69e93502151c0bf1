//! The clock behind `embassy_time`, on TIM5 with all of its 32 bits. Units: µs since the start.
//!
//! embassy-stm32's own driver takes 16 of them and counts their half turns, 32.8 ms each, by interrupts. It does not clear the
//! match that a timer shows when it is set to zero, counts it as a half turn, and is one off from then on: where a reading meets
//! a half turn that is not counted yet, it is 65.5 ms off, and a tick asked for then comes as late. Flash that is busy
//! stops this processor for up to 0.8 s, which costs it half turns, too. Here a half turn takes 36 minutes, and the first one
//! comes after 8.4 s, so that it is nothing that only happens to a hand that has been on for long.
//!
//! `half_turns` is even while the counter is in its lower half and odd in its upper half, so a reading between a half turn and
//! its interrupt is right as well, by whoever and wherever it is made.

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

const HALF_TURN_BITS: u32 = 31;
/// What the counter begins with: 8.4 s before its half turn, and a number that one instruction can take away.
const BEGIN: u32 = 0xFF << 23;
/// Channel 1 of the timer matches in the middle of a turn.
const HALF: usize = 0;
/// Channel 2 matches when the next task is to be woken.
const ALARM: usize = 1;

struct Clock {
    half_turns: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    half_turns: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the clock at zero. Once, when the processor's clocks run.
pub(crate) fn start() {
    RCC.apb1enr().modify(|enabled| enabled.set_tim5en(true));
    RCC.apb1rstr().modify(|reset| reset.set_tim5rst(true));
    RCC.apb1rstr().modify(|reset| reset.set_tim5rst(false));
    TIM5.psc()
        .write_value((rcc::frequency::<peripherals::TIM5>().0 / TICK_HZ as u32 - 1) as u16);
    TIM5.arr().write_value(u32::MAX);
    TIM5.ccr(HALF).write_value(1 << HALF_TURN_BITS);
    // The prescaler comes into force with an update, which is not to count as a turn.
    TIM5.cr1().modify(|control| control.set_urs(Urs::COUNTER_ONLY));
    TIM5.egr().write(|event| event.set_ug(true));
    TIM5.cnt().write_value(BEGIN);
    // Nor are the matches with zero.
    TIM5.sr().write_value(SrGp16(0));
    TIM5.dier().write(|enabled| {
        enabled.set_uie(true);
        enabled.set_ccie(HALF, true);
        enabled.set_ccie(ALARM, true);
    });
    interrupt::TIM5.unpend();
    // SAFETY: its handler is below; priorities are set.
    unsafe { interrupt::TIM5.enable() };
    TIM5.cr1().modify(|control| control.set_cen(true));
}

#[embassy_stm32::interrupt]
unsafe fn TIM5() {
    critical_section::with(|section| {
        let came = TIM5.sr().read();
        // Zeros clear; what comes from now on stands until the next time.
        TIM5.sr().write_value(SrGp16(!came.0));
        let half_turns = u32::from(came.uif()) + u32::from(came.ccif(HALF));
        let counted = CLOCK.half_turns.load(Ordering::Relaxed);
        CLOCK
            .half_turns
            .store(counted.wrapping_add(half_turns), Ordering::Relaxed);
        if came.ccif(ALARM) {
            CLOCK.wake(section);
        }
    });
}

impl Clock {
    /// Wakes the tasks whose time has come and sets the alarm for the next one. An alarm more than a turn away, or none,
    /// rings early and finds nobody to wake.
    fn wake(&self, section: CriticalSection<'_>) {
        let mut queue = self.queue.borrow_ref_mut(section);
        loop {
            let next_us = queue.next_expiration(self.now());
            TIM5.ccr(ALARM).write_value((next_us as u32).wrapping_add(BEGIN));
            // One that has passed meanwhile will not ring.
            if self.now() < next_us {
                return;
            }
        }
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        let half_turns = self.half_turns.load(Ordering::Relaxed);
        compiler_fence(Ordering::Acquire);
        let counter = TIM5.cnt().read() ^ ((half_turns & 1) << HALF_TURN_BITS);
        (u64::from(half_turns) << HALF_TURN_BITS) + u64::from(counter) - u64::from(BEGIN)
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
