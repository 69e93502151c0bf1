//! The log of faults: a line when one comes and when it goes, with number and cause, at the level of its severity.
//!
//! A line is some bytes: the causes are names that only the reader of the log knows. Copying their text would block the UART
//! for 176 µs, 16 byte times.
//! Limits: a fault that comes and goes between two ticks leaves no line here; the host sees it in the status.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use gripline_firmware::fault::{FaultSet, Severity};

/// The active faults, whenever they changed.
pub(crate) static CHANGED: Signal<CriticalSectionRawMutex, FaultSet> = Signal::new();

/// Writes the log. Deadline: none; budget: what is left. Miss: a line is lost, never a fault.
#[embassy_executor::task]
pub(crate) async fn write() {
    let mut before = FaultSet::EMPTY;
    loop {
        let now = CHANGED.wait().await;
        for fault in (now - before).iter() {
            match fault.severity() {
                Severity::Error => defmt::error!("fault {=u8}: {}", fault.number(), fault),
                Severity::Warning => defmt::warn!("fault {=u8}: {}", fault.number(), fault),
                Severity::Info => defmt::info!("fault {=u8}: {}", fault.number(), fault),
            }
        }
        for fault in (before - now).iter() {
            defmt::info!("fault {=u8}: {}, over", fault.number(), fault);
        }
        before = now;
    }
}
