//! The emulated board: an STM32F427 that runs the unmodified firmware image, for tests and for `--mcu emulator`.
//!
//! [`Board`] is the board as a library; [`wire`] is the pipe that the binary `gripline-emulator` serves to a parent
//! process. The core, the clock tree, timers, ports, UART and watchdog are rigless's; the DAC ([`dac`]) and the USB port
//! with a host at its other end ([`usb`]) are ours.
#![forbid(unsafe_code)]

mod analog;
mod board;
pub mod constants;
pub mod dac;
mod fault_injection;
mod flash;
mod hardware;
mod part;
mod rtt;
mod trace;
mod uart;
pub mod usb;

pub use board::{Board, EmulatorError, Reset};
pub use dac::DacWrite;
pub use gripline_emulator_wire::{self as wire, Disturbance, FaultInjection, LineWiring};
pub use trace::{Event, EventKind};
pub use uart::UartByte;
