//! Firmware update over USB without a probe: reads an image, and hands it to the chip's own bootloader (ST's DfuSe, AN3156).
//!
//! [`image`] reads a file and says whom it is for. [`dfu`] speaks the protocol over a [`dfu::Wire`], [`layout`] reads the sectors that
//! the bootloader tells, [`update`] erases, writes, verifies and starts, in an order that leaves no half image that runs.
//! [`usb`] is the system's USB. Units: bytes, addresses of the chip, milliseconds.
#![forbid(unsafe_code)]

pub mod dfu;
pub mod dfu_status;
pub mod error;
pub mod image;
pub mod layout;
pub mod update;
pub mod usb;
