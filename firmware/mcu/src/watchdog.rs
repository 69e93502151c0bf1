//! The independent watchdog: it is fed only while the map-to-line path proves that it runs.
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
/// How often the proof is looked at, milliseconds: three looks fit in the shortest real period.
const LOOK_MS: u64 = 20;
/// Safety ticks between two looks below which the path counts as dead; all is well at [`LOOK_MS`].
const TICKS_MIN: u32 = 10;

/// The watchdog's prescaler and reload value for [`PERIOD_US`]: 32 kHz / 4, 800 counts.
const STRICT: (Pr, u16) = (Pr::DIVIDE_BY4, 799);
/// The same while the flash is written: 32 kHz / 64, 2,000 counts are 4 s, at least 2.7 s on a real chip.
const PATIENT: (Pr, u16) = (Pr::DIVIDE_BY64, 1_999);

/// Safety ticks since the start, by the one task that makes them.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// A running watchdog.
pub(crate) struct Watchdog(IndependentWatchdog<'static, peripherals::IWDG>);

impl Watchdog {
    /// Starts it, before the clocks are set up: it has its own.
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

/// Waits long enough for the flash, which stops the processor while it is erased. Only with nothing in the gripper.
pub(crate) fn be_patient() {
    set_period(PATIENT);
}

/// Waits as long as always.
pub(crate) fn be_strict() {
    set_period(STRICT);
}

fn set_period((prescaler, reload): (Pr, u16)) {
    IWDG.kr().write(|key| key.set_key(Key::ENABLE));
    IWDG.pr().write(|register| register.set_pr(prescaler));
    IWDG.rlr().write(|register| register.set_rl(reload));
    // Both values arrive in the watchdog's own clock, some 100 µs later. Should that clock stand, the watchdog does.
    while {
        let status = IWDG.sr().read();
        status.pvu() || status.rvu()
    } {}
    IWDG.kr().write(|key| key.set_key(Key::RESET));
}

/// Says that a safety tick was made. Called by the map-to-line path and nothing else.
pub(crate) fn tick_made() {
    // A store is enough for the one writer, and cannot be delayed by others as a read-modify-write loop can.
    TICKS.store(TICKS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Feeds the watchdog. Deadline: the watchdog's period; budget: microseconds every 20 ms, in the gaps of everything
/// else, so that a task that spins anywhere starves it. Miss: the chip resets and the line is restored.
#[embassy_executor::task]
pub(crate) async fn guard(mut watchdog: Watchdog) {
    let mut look = Ticker::every(Duration::from_millis(LOOK_MS));
    let mut seen = TICKS.load(Ordering::Relaxed);
    loop {
        look.next().await;
        let ticks = TICKS.load(Ordering::Relaxed);
        if ticks.wrapping_sub(seen) >= TICKS_MIN {
            seen = ticks;
            watchdog.0.pet();
        }
    }
}
