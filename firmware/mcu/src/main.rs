//! Gripline on the silicon: an STM32F4 that turns force maps into the grip-force line.
//!
//! The library decides; this binary has the pins, the clocks, the transports and the priorities.
//! Interrupt priorities, most urgent first: 2 map to line (`usb_interrupt`, and `uart` while its maps count);
//! 3 a byte of the host's UART while maps over USB count, the rest of USB; 4 the time driver and the safety tick (`control_task`); 5 a byte of the gripper's UART. The other tasks run below all
//! interrupts. Nothing waits for a host.
//! Limits: only the host that spoke last gets answers.
#![no_std]
#![no_main]

#[cfg(not(target_os = "none"))]
compile_error!("build it for the chip: --target thumbv7em-none-eabihf");
#[cfg(not(any(feature = "stm32f405rg", feature = "stm32f427vi")))]
compile_error!("name the board: --features stm32f405rg or --features stm32f427vi");
#[cfg(all(feature = "stm32f405rg", feature = "stm32f427vi"))]
compile_error!("name one board, not two: an image runs on one chip");

mod board;
mod bootloader;
mod control;
mod control_task;
mod dsp;
mod fault_log;
mod flash;
mod gripper_bus;
mod hot;
mod line;
mod outbox;
mod panic;
mod priority;
mod readback;
mod reset;
mod robot;
mod stack;
mod supply;
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
use gripline_firmware::{GripForce, Program, ResetCause, Start, storage};
use gripline_protocol::line::LineKind;
use static_cell::StaticCell;

use crate::control_task::Watch;
use crate::dsp::Dsp;
use crate::flash::SettingsSectors;
use crate::readback::ReadBack;
use crate::robot::Robot;
use crate::watchdog::Watchdog;

defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

/// Runs the task `control` in the interrupt of UART5, which no board wires.
static TICK_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
/// Runs all other tasks.
static TASK_EXECUTOR: StaticCell<Executor> = StaticCell::new();
static PROGRAM: StaticCell<Program<Dsp>> = StaticCell::new();

#[embassy_stm32::interrupt]
unsafe fn UART5() {
    // SAFETY: called from this handler only, and the interrupt is unmasked only by `TICK_EXECUTOR.start`.
    unsafe { TICK_EXECUTOR.on_interrupt() }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    // The line first: the reset switched the DAC off, and an object may be in the gripper.
    let reset = reset::read();
    stack::guard();
    // The line's calibration is among the settings: two short records, a quarter of a millisecond.
    let flash = SettingsSectors::new();
    let stored = storage::load(&flash);
    let fail_safe = stored.settings.unwrap_or_default().fail_safe;
    // Never nothing after a brown-out: when it damaged what was kept, the fail-safe force.
    let fail_safe = (reset.cause == ResetCause::BrownOut).then_some(GripForce::from_lsb(fail_safe));
    let restored = reset.line.or(fail_safe);
    let start = Start {
        now_us: 0,
        reset: reset.cause,
        restored_line: restored,
        line_before: reset.line_settings,
        stored,
        board: board::BOARD,
        revision: board::REVISION,
        session: reset.session,
    };
    let line_settings = *start.line();
    let line = line::start(
        restored.unwrap_or(GripForce::ZERO),
        LineCalibration::of(&line_settings),
    );
    reset::keep_line_settings(&line_settings);
    // The watchdog next: it must run when the crystal does not start.
    let watchdog = Watchdog::start();

    priority::set();
    let p = embassy_stm32::init(board::clocks());
    time_driver::start();
    line::route(p.PA4);
    supply::watch();
    let watch = Watch {
        // A gripper on the bus needs no analog line, and its read-back may be unwired.
        read_back: (line_settings.kind == LineKind::Analog).then(|| ReadBack::start(p.PA6)),
        robot: Robot::new(p.PB1, p.PB0),
    };
    control::start_cycle_counter();
    uart::open(p.USART1, p.PA10, p.PA9);
    // SAFETY: its handler (`usb_interrupt`) does nothing before the first event.
    unsafe { interrupt::UART4.enable() };
    let (usb_device, usb_in, usb_out) = usb::open(p.USB_OTG_FS, p.PA12, p.PA11);
    let gripper = (line_settings.kind == LineKind::Robotiq2f140)
        .then(|| gripper_bus::open(p.USART2, p.PA3, p.PA2, p.PA1));
    let program = PROGRAM.init(Program::with_kernel(Start {
        now_us: Instant::now().as_micros(),
        ..start
    }));

    control::start(program, line);
    let tick_spawner = TICK_EXECUTOR.start(interrupt::UART5);
    tick_spawner.spawn(control_task::control(line_settings, flash, watch, usb_in).expect("one control task"));
    // Writing the log masks interrupts for some microseconds: only at task level, never on the path from map to line.
    defmt::info!(
        "{=str} started: {}, line restored: {}",
        board::NAME,
        reset.cause,
        restored
    );
    match reset.panic {
        Some([stack::OVERFLOW, lowest]) => {
            defmt::error!("the stack overflowed, down to {=u32:#010x}", lowest);
        }
        Some([place, caller]) => defmt::error!(
            "the program panicked at {=u32:#010x}, called from {=u32:#010x}",
            place,
            caller
        ),
        None => {}
    }
    TASK_EXECUTOR.init(Executor::new()).run(|spawner| {
        spawner.spawn(uart::transmit().expect("one UART task"));
        spawner.spawn(usb::transmit(usb_out).expect("one USB task"));
        spawner.spawn(usb::device(usb_device).expect("one USB device task"));
        if let Some(gripper) = gripper {
            spawner.spawn(gripper_bus::talk(gripper).expect("one gripper task"));
        }
        spawner.spawn(fault_log::write().expect("one log task"));
        spawner.spawn(watchdog::feed(watchdog).expect("one watchdog task"));
    })
}
