//! Gripline on the silicon: an STM32F4 that turns force maps into the grip-force line.
//!
//! Everything that decides is in the library; here are the pins, the clocks, the transports and the order of things.
//! From most to least urgent (interrupt priority): map to line (2), UART byte and the rest of USB (3), the time driver and
//! the safety tick (4, `control`), the gripper's UART byte (5), then in the gaps of all these the answers to the host, USB
//! requests, the gripper on the bus and the watchdog. Nothing waits for a host: without one the safety tick and the
//! watchdog alone run.
//! Limits: one host at a time is answered, over the transport that spoke last.
#![no_std]
#![no_main]

#[cfg(not(target_os = "none"))]
compile_error!("build it for the chip: --target thumbv7em-none-eabihf");
#[cfg(not(any(feature = "stm32f405rg", feature = "stm32f427vi")))]
compile_error!("name the board: --features stm32f405rg or --features stm32f427vi");
#[cfg(all(feature = "stm32f405rg", feature = "stm32f427vi"))]
compile_error!("name one board, not two: an image runs on one chip");

mod board;
mod control;
mod crash;
mod fault_log;
mod flash;
mod gripper_bus;
mod hot;
mod kernel;
mod line;
mod outbox;
mod priority;
mod reset;
mod time_driver;
mod uart;
mod usb;
mod usb_driver;
mod usb_interrupt;
mod watchdog;

use defmt_rtt as _;
use embassy_executor::{Executor, InterruptExecutor};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_time::Instant;
use gripline_firmware::line::LineCalibration;
use gripline_firmware::{GripForce, Program, Start, storage};
use gripline_protocol::line::LineKind;
use static_cell::StaticCell;

use crate::flash::SettingsSectors;
use crate::kernel::Dsp;
use crate::watchdog::Watchdog;

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// Runs `control` in the interrupt of UART5, which no board wires.
static URGENT: InterruptExecutor = InterruptExecutor::new();
/// Runs everything that has time.
static PATIENT: StaticCell<Executor> = StaticCell::new();
static PROGRAM: StaticCell<Program<Dsp>> = StaticCell::new();

#[embassy_stm32::interrupt]
unsafe fn UART5() {
    // SAFETY: called from this handler only, and the interrupt is unmasked only by `URGENT.start`.
    unsafe { URGENT.on_interrupt() }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    // The grip first: the DAC went to zero with the reset, and an object may be in the gripper.
    let reset = reset::read();
    // Two short records, a quarter of a millisecond: the line's calibration is among the settings.
    let flash = SettingsSectors::new();
    let stored = storage::load(&flash);
    let settings = stored.settings.unwrap_or_default();
    let line = line::start(
        reset.line.unwrap_or(GripForce::ZERO),
        LineCalibration::of(&settings.line),
    );
    // The watchdog next: a crystal that does not start must not end in silence.
    let watchdog = Watchdog::start();

    priority::set();
    let p = embassy_stm32::init(board::clocks());
    time_driver::start();
    line::route(p.PA4);
    control::start_cycle_counter();
    let (uart_in, uart_out) = uart::open(p.USART1, p.PA10, p.PA9);
    // SAFETY: the handler is there, and does nothing before the first event.
    unsafe { interrupt::UART4.enable() };
    let (usb_device, usb_in, usb_out) = usb::open(p.USB_OTG_FS, p.PA12, p.PA11);
    let gripper = (settings.line.kind == LineKind::Robotiq2f140)
        .then(|| gripper_bus::open(p.USART2, p.PA3, p.PA2, p.PA1));
    let program = PROGRAM.init(Program::with_kernel(Start {
        now_us: Instant::now().as_micros(),
        reset: reset.cause,
        restored_line: reset.line,
        stored,
        board: board::BOARD,
        revision: board::REVISION,
        session: reset.session,
    }));

    let urgent = URGENT.start(interrupt::UART5);
    urgent.spawn(
        control::control(program, line, settings.line, flash, uart_in, usb_in).expect("one control task"),
    );
    // The log is written with interrupts masked for some microseconds: here, and nowhere on the way to the line.
    defmt::info!(
        "{=str} started: {}, line restored: {}",
        board::NAME,
        reset.cause,
        reset.line
    );
    if let Some([place, caller]) = reset.crash {
        defmt::error!(
            "the program crashed at {=u32:#010x}, called from {=u32:#010x}",
            place,
            caller
        );
    }
    PATIENT.init(Executor::new()).run(|spawner| {
        spawner.spawn(uart::transmit(uart_out).expect("one UART task"));
        spawner.spawn(usb::transmit(usb_out).expect("one USB task"));
        spawner.spawn(usb::device(usb_device).expect("one USB device task"));
        if let Some(gripper) = gripper {
            spawner.spawn(gripper_bus::talk(gripper).expect("one gripper task"));
        }
        spawner.spawn(fault_log::write().expect("one log task"));
        spawner.spawn(watchdog::guard(watchdog).expect("one watchdog task"));
    })
}
