//! The links over which hosts reach the program. Each has its own receivers: broken packets on one do not affect the other.

/// Number of links.
pub const LINKS: usize = 2;

/// A link to a host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum LinkId {
    /// USB bulk, or its replacement without a board.
    Usb = 0,
    /// The UART.
    Uart = 1,
}

impl LinkId {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; LINKS] = [Self::Usb, Self::Uart];
}
