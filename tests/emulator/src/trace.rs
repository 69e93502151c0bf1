//! What the core did, with the count of its instructions: for counting what the firmware's clock cannot see.
//!
//! Limits: the core's own registers (timers, interrupt controller) are no accesses here; an exception shows as an arrival
//! at its handler.

use rigless::emulator::{Host, Settled, Watch};

use crate::hardware::Hardware;

/// Something that a traced board recorded, oldest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Instructions that the core had run since power-on; for an access, its own included.
    pub retired: u64,
    /// What it was.
    pub kind: EventKind,
}

/// What a traced board records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventKind {
    /// The core is about to run the watched instruction at this address.
    Arrival(u32),
    /// An instruction read or wrote this address of a peripheral.
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
    /// A recorder that watches the instructions at `addresses`; of nothing when there are none.
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
        let retired = match settled {
            Settled::Hit(hit) => hit.instruction_count,
            Settled::Access { access, .. } => access.instruction_count,
            Settled::Stop(stop) => stop.instruction_count,
            _ => return,
        };
        let mut record = |kind| self.events.push(Event { retired, kind });
        // The count starts anew whenever a report has taken the list.
        let deliveries = board.usb().deliveries();
        for _ in self.deliveries.min(deliveries)..deliveries {
            record(EventKind::Delivery);
        }
        self.deliveries = deliveries;
        let uart_bytes = board.far_end().arrived();
        for _ in self.uart_bytes..uart_bytes {
            record(EventKind::UartByte);
        }
        self.uart_bytes = uart_bytes;
        match settled {
            Settled::Hit(hit) => record(EventKind::Arrival(hit.address as u32)),
            Settled::Access { access, .. } if access.program_counter.is_some() => {
                record(EventKind::Access(access.address as u32));
            }
            _ => {}
        }
    }

    pub(crate) fn take(&mut self) -> Vec<Event> {
        self.deliveries = 0;
        std::mem::take(&mut self.events)
    }
}
