//! The board of all host tests: the microcontroller's program on a simulated clock. It ticks once a millisecond, can be
//! reset and stay down for a while, and keeps what it sends.
//!
//! Units: µs of the test's clock; the program's own clock starts at 0 with every power-on, as on the chip.
//! Limits: no flash; like the chip, it sends nothing before a host has spoken.
#![forbid(unsafe_code)]

pub mod fake_usb;
pub mod link;

use std::collections::VecDeque;

use gripline_firmware::{Action, Device, Program, ResetCause, Start};
use gripline_protocol::Packet;

/// The safety tick.
pub const TICK_US: u64 = 1_000;

/// A microcontroller on a simulated clock.
#[derive(Debug)]
pub struct TestBoard {
    /// The program with both ends of its messages.
    pub device: Device,
    /// What it sent and the host has not taken yet.
    pub replies: VecDeque<Packet>,
    now_us: u64,
    next_tick_us: u64,
    /// The test's time at the program's time 0.
    zero_us: u64,
    down_until_us: u64,
    session: u32,
    is_spoken_to: bool,
}

impl TestBoard {
    /// Powers on at time 0.
    #[must_use]
    pub fn new(start: Start) -> Self {
        Self {
            device: Device::new(start),
            replies: VecDeque::new(),
            now_us: 0,
            next_tick_us: TICK_US,
            zero_us: 0,
            down_until_us: 0,
            session: start.session,
            is_spoken_to: false,
        }
    }

    /// The test's time, µs.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_us
    }

    /// Whether the program runs.
    #[must_use]
    pub const fn is_up(&self) -> bool {
        self.now_us >= self.down_until_us
    }

    /// The program.
    #[must_use]
    pub const fn program(&self) -> &Program {
        &self.device.program
    }

    /// Stops until `until_us` and then goes on: nothing is forgotten.
    pub fn stop_until(&mut self, until_us: u64) {
        self.down_until_us = until_us;
    }

    /// Takes a packet; `None` while the program is down.
    pub fn packet(&mut self, packet: &[u8]) -> Option<Action> {
        if !self.is_up() {
            return None;
        }
        self.is_spoken_to = true;
        let action = self.device.packet(packet, self.now_us - self.zero_us);
        self.collect();
        Some(action)
    }

    /// Time passes to `until_us`. After every tick `watch` sees the program and the time.
    pub fn pass_to(&mut self, until_us: u64, mut watch: impl FnMut(&Program, u64)) {
        while self.next_tick_us <= until_us {
            self.now_us = self.next_tick_us;
            self.next_tick_us += TICK_US;
            if self.is_up() {
                let _ = self.device.tick(self.now_us - self.zero_us);
                watch(&self.device.program, self.now_us);
                self.collect();
            }
        }
        self.now_us = until_us.max(self.now_us);
    }

    /// Resets: everything is forgotten but, without a power cut, the line. It is back after `down_us`.
    pub fn reset(&mut self, cause: ResetCause, down_us: u64) {
        let line = self.program().line();
        self.session += 1;
        self.start_anew(
            Start {
                reset: cause,
                restored_line: (cause != ResetCause::PowerOn).then_some(line),
                session: self.session,
                ..Start::default()
            },
            down_us,
        );
    }

    /// Restarts with what `start` knows. It is back after `down_us`.
    pub fn start_anew(&mut self, start: Start, down_us: u64) {
        self.device = Device::new(start);
        self.replies.clear();
        self.is_spoken_to = false;
        self.down_until_us = self.now_us + down_us;
        self.zero_us = self.down_until_us;
    }

    fn collect(&mut self) {
        if self.is_spoken_to {
            self.replies
                .extend(std::iter::from_fn(|| self.device.next_packet()));
        }
    }
}
