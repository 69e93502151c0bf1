//! Whether the UART's receiver can lose a byte while maps over it count, over the linked image alone. Cycles.
//!
//! The receiver holds a byte while the next one comes in, so each has to be read within a byte time. A byte that ends a packet leads into the
//! program, whose interrupt then works on it; the one behind it waits for that. The interrupt of a map's last byte takes longer than two byte
//! times, so it reads a byte half-way (`uart::take_ahead`).
//! Limits: while maps over USB count, a byte may wait for those; settings go to flash only when released.

use crate::Error;
use crate::bound::{Code, Walk};
use crate::cycles::{ENTRY, EXIT};
use crate::image::Function;
use crate::measure::UART_DATA;
use crate::tables::Left;

/// By how much a sender may be faster than the receiver, hundredths (RM0090, section 30.3.5: what the receiver stands is a little more).
const FASTER_PERCENT: u64 = 3;

/// A time that must not be longer than another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Need {
    /// Which byte, and from when it counts.
    pub what: &'static str,
    /// Until it is read, at most.
    pub found: u64,
    /// Until the byte behind it wants its place, at least.
    pub allowed: u64,
}

/// What the receiver needs, in the order of the bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Receiver {
    /// A byte of the fastest sender.
    pub byte_cycles: u64,
    /// Each.
    pub needs: Vec<Need>,
}

impl Receiver {
    /// For the UART's interrupt, which waits so long at most before it begins, in an image whose own byte time is this.
    ///
    /// # Errors
    /// An image without the functions that this stands on.
    pub fn of(
        code: Code<'_>,
        uart: &Function,
        ahead: &Function,
        waits: u64,
        own_byte_cycles: u64,
    ) -> Result<(Self, Vec<String>), Error> {
        let byte = own_byte_cycles * (100 - FASTER_PERCENT) / 100;
        let (enter, leave) = (u64::from(ENTRY), u64::from(EXIT));
        let mut findings = Vec::new();
        let mut whole = |left: Left| {
            let mut walk = Walk::new(code, left);
            let cycles = walk.function(uart).cycles;
            findings.extend(walk.findings);
            cycles
        };
        let [head, taxels, tail, inside, other] =
            [Left::Head, Left::Taxels, Left::Tail, Left::Byte, Left::Foreign].map(&mut whole);
        let look = Walk::new(code, Left::Tail)
            .ending_with(ahead)
            .function(uart)
            .cycles;
        let rest = Walk::new(code, Left::Tail).after_call(uart, ahead)?;
        let read = enter + Walk::new(code, Left::Always).until_load(uart, UART_DATA)?;
        let behind = |one: u64| waits + enter + one + leave + read;
        let need = |what, found, bytes: u64| Need {
            what,
            found,
            allowed: bytes * byte,
        };
        let needs = vec![
            need("a byte, from when it came", waits + read, 1),
            need(
                "the one behind a map's first packet, from that one's last byte",
                behind(head),
                2,
            ),
            need("the one behind a full packet", behind(taxels), 2),
            need(
                "the one behind a map's last packet, when it is read half-way",
                waits + enter + look,
                2,
            ),
            need("the same, when it came right after that", rest + leave + read, 1),
            need(
                "the second one behind a map's last packet",
                behind(tail) + other + leave + enter,
                3,
            ),
            need("one after the other", inside + leave + enter, 1),
        ];
        let receiver = Self {
            byte_cycles: byte,
            needs,
        };
        Ok((receiver, findings))
    }

    /// The least time that is left, cycles; negative when a byte can be lost.
    #[must_use]
    pub fn room(&self) -> i64 {
        let rooms = self.needs.iter();
        let rooms = rooms.map(|need| need.allowed.cast_signed() - need.found.cast_signed());
        rooms.min().unwrap_or_default()
    }
}
