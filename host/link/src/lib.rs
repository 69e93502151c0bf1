//! Ways to a microcontroller, behind one trait: in this process, emulated, over a serial line, over USB. Packets of at most 64
//! bytes each way; [`session`] handles their content. Times in µs since the link was opened. A real device may go away and come
//! back ([`hot_plug`]).
#![forbid(unsafe_code)]

pub mod bootloader;
mod clock_sync;
mod embedded;
pub mod emulator;
mod error;
mod handshake;
pub mod hot_plug;
mod link;
mod patience;
mod serial;
pub mod session;
pub mod shadow;
mod target;
pub mod usb;

pub use embedded::EmbeddedLink;
pub use emulator::{EmulatorLink, Transport};
pub use error::LinkError;
pub use hot_plug::HotPlug;
pub use link::{Link, Presence};
pub use target::Target;
