//! The far end of the board's serial line: bytes for the firmware wait here, bytes from it are recorded.
//! Times are virtual nanoseconds. The port's model paces both directions at the baud rate the firmware set, so this
//! end always agrees with it. An open wire reads as the level of the pin that nothing drives.
//! Limits: no wrong baud rate, no noise, no framing error; a word's low byte is all that crosses.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A byte on the serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct UartByte {
    /// Virtual time since power-on, nanoseconds: the end of its stop bit.
    pub at_ns: u64,
    /// The byte.
    pub byte: u8,
}

/// What hangs on the line.
#[derive(Debug, Default)]
pub(crate) struct FarEnd {
    waiting: VecDeque<u8>,
    heard: Vec<UartByte>,
    /// A byte is on its way to the firmware.
    is_sending: bool,
    arrived: usize,
    /// The wire to the firmware's receiver is open.
    is_open: bool,
    /// What the receiver sees then: a line at zero, a byte of zeros after the other.
    is_low: bool,
}

impl FarEnd {
    /// Puts `bytes` behind those that still wait; they go back to back, from the instant the receiver is free.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        self.waiting.extend(bytes);
    }

    /// Opens the wire to the firmware, or closes it; what waited on it is lost.
    pub(crate) fn set_open(&mut self, is_open: bool) {
        self.is_open = is_open;
        self.waiting.clear();
    }

    /// The level of the firmware's pin while nothing drives it.
    pub(crate) fn set_undriven_level(&mut self, is_low: bool) {
        self.is_low = is_low;
    }

    /// Takes what the firmware sent since the last call, oldest first.
    pub(crate) fn take_heard(&mut self) -> Vec<UartByte> {
        std::mem::take(&mut self.heard)
    }

    /// Bytes that have arrived in the firmware's receiver since power-on.
    pub(crate) fn arrived(&self) -> usize {
        self.arrived
    }
}

impl Store for FarEnd {}

impl Peer for FarEnd {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        self.heard.push(UartByte {
            at_ns: context.now().0,
            byte: word as u8,
        });
    }

    /// The receiver asks for a byte when the one before has arrived.
    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        self.arrived += usize::from(self.is_sending);
        let next = if self.is_open {
            self.waiting.clear();
            self.is_low.then_some(0)
        } else {
            self.waiting.pop_front()
        };
        self.is_sending = next.is_some();
        next.map(u16::from)
    }
}
