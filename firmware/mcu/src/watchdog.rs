//! The independent watchdog: it is fed only while the safety ticks go on.
//!
//! Units: microseconds, milliseconds. Limits: its clock is the chip's own oscillator, 17 to 47 kHz around 32, so
//! [`PERIOD_US`] is between 68 and 188 ms on a real chip.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::pac::IWDG;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::peripherals;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Ticker};

/// How long the watchdog waits, microseconds at its nominal clock.
const PERIOD_US: u32 = 100_000;
/// Time between two checks of the ticks, milliseconds: three fit in the shortest real period.
const CHECK_MS: u64 = 20;
/// Fewer safety ticks than this between two checks starve the watchdog; there should be [`CHECK_MS`].
const TICKS_MIN: u32 = 10;

/// Prescaler and reload value for [`PERIOD_US`]: 32 kHz / 4, 800 counts.
const NORMAL: (Pr, u16) = (Pr::DIVIDE_BY4, 799);
/// The same while the flash is written: 32 kHz / 64, 2,000 counts are 4 s, at least 2.7 s on a real chip.
const EXTENDED: (Pr, u16) = (Pr::DIVIDE_BY64, 1_999);

/// Safety ticks since the start; only the task `control` counts them.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// A running watchdog.
pub(crate) struct Watchdog(IndependentWatchdog<'static, peripherals::IWDG>);

impl Watchdog {
    /// Starts it. It has its own clock, so this may come before the clocks are set up.
    pub(crate) fn start() -> Self {
        // SAFETY: the only handle that is ever used; the one of `embassy_stm32::init` is dropped unused.
        let peripheral = unsafe { peripherals::IWDG::steal() };
        let mut watchdog = IndependentWatchdog::new(peripheral, PERIOD_US);
        watchdog.unleash();
        // It starts with its longest reload value (512 ms); this loads ours.
        watchdog.pet();
        Self(watchdog)
    }
}

/// Extends the period while the flash is written, which stalls the processor. Only with nothing in the gripper.
pub(crate) fn extend_period() {
    set_period(EXTENDED);
}

/// Back to the normal period.
pub(crate) fn restore_period() {
    set_period(NORMAL);
}

fn set_period((prescaler, reload): (Pr, u16)) {
    IWDG.kr().write(|key| key.set_key(Key::ENABLE));
    IWDG.pr().write(|register| register.set_pr(prescaler));
    IWDG.rlr().write(|register| register.set_rl(reload));
    // Both values take effect in the watchdog's own clock, some 100 µs later.
    while {
        let status = IWDG.sr().read();
        status.pvu() || status.rvu()
    } {}
    IWDG.kr().write(|key| key.set_key(Key::RESET));
}

/// Counts a safety tick. Only the task `control` may call it.
pub(crate) fn count_tick() {
    // There is one writer, so load and store are enough; a read-modify-write loop could be delayed.
    TICKS.store(TICKS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Feeds the watchdog while the safety ticks go on.
///
/// Deadline: the watchdog's period. Budget: microseconds every 20 ms, below everything else: a task that spins anywhere
/// starves it. Miss: the chip resets and the line is restored.
#[embassy_executor::task]
pub(crate) async fn feed(mut watchdog: Watchdog) {
    let mut check = Ticker::every(Duration::from_millis(CHECK_MS));
    let mut seen = TICKS.load(Ordering::Relaxed);
    loop {
        check.next().await;
        let ticks = TICKS.load(Ordering::Relaxed);
        if ticks.wrapping_sub(seen) >= TICKS_MIN {
            seen = ticks;
            watchdog.0.pet();
        }
    }
}
