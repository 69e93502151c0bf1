//! The microcontroller's program: packets and time in, the line's value and messages for the host out.
//!
//! A board calls [`Program::map_packet`] for every packet of a map, [`MessageReader::read`] and [`Program::message`] for every
//! other packet, [`Program::lesson`], [`Program::age`], [`Program::teach_grip`], [`Program::watch_object`] and [`Program::advance`]
//! once a millisecond, and [`MessageWriter::next_packet`] with [`Program::poll_message`] to answer. [`Device`] does the same on
//! hosts.

mod board;
mod bootloader;
mod bootloader_request;
mod commands;
mod device;
mod dispatch;
mod learner;
mod lesson;
mod map_source;
mod messages;
mod object;
mod object_watch;
mod outbox;
mod receiver;
mod start;
mod store;

pub use device::Device;
pub use dispatch::{Action, Program};
pub use learner::{Learner, Learnt, Lesson};
pub use messages::{MessageEvent, MessageReader, MessageWriter, Request};
pub use start::{ResetCause, Start};
