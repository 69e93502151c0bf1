//! The links over which hosts reach the program. Each has receivers of its own: what one brings broken costs the other nothing.

/// Number of links.
pub const LINKS: usize = 2;

/// A link to a host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum LinkId {
    /// USB bulk; also what stands in its place without a board.
    Usb = 0,
    /// The UART.
    Uart = 1,
}

impl LinkId {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; LINKS] = [Self::Usb, Self::Uart];
}
