//! What the core did, instruction by instruction: for counting what the firmware's clock cannot see.
//!
//! Limits: the core's own registers (timers, interrupt controller) are no accesses here; an exception shows as an arrival
//! at its handler.

use rigless::emulator::{Host, Settled, Watch};

use crate::hardware::Hardware;

/// Something that a traced board recorded, oldest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The core is about to run the instruction at this address.
    Instruction(u32),
    /// The instruction before read or wrote this address of a peripheral.
    Access(u32),
    /// A bulk packet from the host lies in the receive FIFO.
    Delivery,
    /// A byte lies in the receiver of the UART.
    UartByte,
}

/// Records the events of a board.
#[derive(Debug)]
pub(crate) struct Tracer {
    addresses: Vec<u32>,
    is_watching: bool,
    deliveries: usize,
    uart_bytes: usize,
    events: Vec<Event>,
}

impl Tracer {
    /// A recorder of the instructions at `addresses`; of nothing when there are none.
    pub(crate) fn new(addresses: Vec<u32>) -> Self {
        Self {
            addresses,
            is_watching: false,
            deliveries: 0,
            uart_bytes: 0,
            events: Vec::new(),
        }
    }

    pub(crate) fn settled(&mut self, board: &mut Hardware, host: &mut dyn Host, settled: Settled) {
        if self.addresses.is_empty() {
            return;
        }
        if !self.is_watching && matches!(settled, Settled::Stop(_)) {
            self.is_watching = true;
            for &address in &self.addresses {
                host.watch(Watch::Instruction(address.into()));
            }
        }
        // The count starts anew whenever a report has taken the list.
        let deliveries = board.usb().deliveries();
        for _ in self.deliveries.min(deliveries)..deliveries {
            self.events.push(Event::Delivery);
        }
        self.deliveries = deliveries;
        let uart_bytes = board.far_end().arrived();
        for _ in self.uart_bytes..uart_bytes {
            self.events.push(Event::UartByte);
        }
        self.uart_bytes = uart_bytes;
        match settled {
            Settled::Hit(hit) => self.events.push(Event::Instruction(hit.address as u32)),
            Settled::Access { access, .. } if access.program_counter.is_some() => {
                self.events.push(Event::Access(access.address as u32));
            }
            _ => {}
        }
    }

    pub(crate) fn take(&mut self) -> Vec<Event> {
        self.deliveries = 0;
        std::mem::take(&mut self.events)
    }
}
