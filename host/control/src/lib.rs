//! Control of a running bridge from outside: requests with an identity and a number, each with an answer. The terminal, HTTP, ROS 2
//! and Python all speak through a [`Handle`]; the loop reads the [`Inbox`] between its frames, and the [`Arbiter`] decides.
//!
//! One client owns the gripper at a time. The first to ask owns it; others read, and take over only by an explicit request.
#![forbid(unsafe_code)]

mod answer;
mod arbiter;
mod channel;
mod client;
mod faults;
mod request;
mod status;

pub use answer::{Answer, Outcome, Why};
pub use arbiter::{Arbiter, News, Step};
pub use channel::{Asked, Handle, Inbox, channel};
pub use client::{BadClient, Client};
pub use faults::{ReportedFault, names, reported, what_to_do};
pub use request::{Action, BadRequest, Request};
pub use status::StatusReport;
