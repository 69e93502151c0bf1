//! The firmware library in this process, on a clock of its own: the same code as on the microcontroller. Deterministic: the same
//! packets at the same times give the same line.

use std::collections::VecDeque;

use gripline_firmware::{Device, Start};
use gripline_protocol::Packet;

use crate::error::LinkError;
use crate::link::Link;

/// The microcontroller's safety tick.
const TICK_US: u64 = 1_000;

/// A microcontroller in this process.
#[derive(Debug)]
pub struct EmbeddedLink {
    device: Device,
    now_us: u64,
    next_tick_us: u64,
    outgoing: VecDeque<Packet>,
}

impl EmbeddedLink {
    /// Powered on at time 0.
    #[must_use]
    pub fn new() -> Self {
        Self {
            device: Device::new(Start::default()),
            now_us: 0,
            next_tick_us: TICK_US,
            outgoing: VecDeque::new(),
        }
    }

    fn collect(&mut self) {
        while let Some(packet) = self.device.next_packet() {
            self.outgoing.push_back(packet);
        }
    }
}

impl Default for EmbeddedLink {
    fn default() -> Self {
        Self::new()
    }
}

impl Link for EmbeddedLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if self.device.packet(packet, self.now_us).transmit {
            self.collect();
        }
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        while self.next_tick_us <= until_us {
            let action = self.device.tick(self.next_tick_us);
            if self.device.program.take_store().is_some() {
                // There is no flash in this process.
                self.device.program.stored(None);
            }
            if action.transmit {
                self.collect();
            }
            self.next_tick_us += TICK_US;
        }
        self.now_us = until_us.max(self.now_us);
        while let Some(packet) = self.outgoing.pop_front() {
            received(&packet);
        }
        Ok(())
    }

    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn line(&self) -> Option<i32> {
        Some(self.device.program.line().lsb())
    }

    fn name(&self) -> String {
        "in-process microcontroller".to_owned()
    }
}
