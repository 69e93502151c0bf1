//! What the loop, the hub and the connections share.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use gripline_control::Handle;

use crate::metrics::Values;
use crate::readers::Readers;

/// One run's.
pub(crate) struct Site {
    /// For `/metrics`.
    pub(crate) values: Mutex<Values>,
    /// Readers of `/frames`.
    pub(crate) lines: Readers,
    /// Readers of `/events`.
    pub(crate) events: Readers,
    /// One of them is new: it wants the next frame whole, whatever the pace.
    pub(crate) has_new_page: AtomicBool,
    /// Streams that are served.
    pub(crate) streams: AtomicUsize,
    /// The way to the loop.
    pub(crate) handle: Handle,
    /// What a request must know.
    pub(crate) token: String,
    /// Only this machine can connect.
    pub(crate) is_loopback: bool,
}
