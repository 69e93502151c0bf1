//! Packets on their way to a host: a short queue per transport, between the map-to-line path and the task that sends.
//!
//! Limits: when a host does not listen, the queue is full and the library keeps what it has to say.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use gripline_firmware::LinkId;
use gripline_protocol::Packet;

/// Packets that may wait: a status and one answer's fragments.
const WAITING_MAX: usize = 4;

/// The queue of one transport.
pub(crate) type Outbox = Channel<CriticalSectionRawMutex, Packet, WAITING_MAX>;

/// Towards the UART.
pub(crate) static UART: Outbox = Channel::new();
/// Towards USB.
pub(crate) static USB: Outbox = Channel::new();

/// Towards the host of a link.
pub(crate) const fn of(link: LinkId) -> &'static Outbox {
    match link {
        LinkId::Usb => &USB,
        LinkId::Uart => &UART,
    }
}
