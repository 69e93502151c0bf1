//! The second transport: USART1 on PA9 (out) and PA10 (in), 921,600 baud, 8N1, packets framed with COBS.
//!
//! While its maps count, its interrupt lies on the level of the USB core's: neither interrupts the other, and of two that wait this one comes first;
//! while those over USB do, it lies below (`priority::let_uart`). It decodes byte by byte, so that a map's last byte leads to the line as a map's
//! last packet over USB does ([`Control::map_tail`]). A message's frame waits for the task `control`. The HAL's buffered driver hands bytes to a
//! task instead, which a tick holds up.
//! A byte takes 10.8 µs, a packet of 64 bytes 715 µs; a dense map takes about 30 ms. The receiver holds a byte while the next one comes, so an
//! interrupt may take two byte times; that of a map's last byte takes longer, and so reads a byte half-way ([`take_ahead`]).
//! `cargo xtask latency` fails when a byte could be lost.
//! Limits: no flow control. A byte is lost when maps over USB block the receiver for longer than a byte time, or when the task leaves
//! [`FRAMES`] frames unread. The CRC then refuses what it belonged to.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

use cortex_m::peripheral::NVIC;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::USART1 as REGISTERS;
use embassy_stm32::pac::usart::regs::{Dr, Sr};
use embassy_stm32::usart::{Config, Uart};
use embassy_stm32::{Peri, interrupt, peripherals};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use gripline_firmware::LinkId;
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_protocol::packet::Kind;

use crate::control::{self, Control};
use crate::outbox;
use crate::priority::{self, Path, block_path};

/// Symbols a second: what common USB adapters and the chip both make exactly enough (84 MHz / 91, error 0.2 %).
const BAUD: u32 = 921_600;
/// Frames that may wait on the way in, the one under way included: 2.2 ms.
const FRAMES: usize = 4;

/// Frames of messages for the task `control`, in the order of a ring, and the one under way.
struct Received {
    frames: UnsafeCell<[CobsDecoder; FRAMES]>,
    /// Frames that ended since the start, and those of them that were read; the difference is at most [`FRAMES`] − 1.
    ended: AtomicUsize,
    read: AtomicUsize,
    /// A frame was lost or damaged.
    is_broken: AtomicBool,
}

// SAFETY: the interrupt has the frame `ended`, the task `control` those from `read` up to it: never the same.
unsafe impl Sync for Received {}

static RECEIVED: Received = Received {
    frames: UnsafeCell::new([const { CobsDecoder::new() }; FRAMES]),
    ended: AtomicUsize::new(0),
    read: AtomicUsize::new(0),
    is_broken: AtomicBool::new(false),
};

/// A frame on its way out.
struct Sending {
    frame: UnsafeCell<[u8; FRAME_MAX]>,
    length: AtomicUsize,
    /// Bytes that are out.
    sent: AtomicUsize,
}

// SAFETY: the task `transmit` writes the frame while it has no byte left to send, the interrupt reads it while it has.
unsafe impl Sync for Sending {}

static SENDING: Sending = Sending {
    frame: UnsafeCell::new([0; FRAME_MAX]),
    length: AtomicUsize::new(0),
    sent: AtomicUsize::new(0),
};

/// A byte that the interrupt read ahead, as [`read`] gives it; 0 when there is none.
static AHEAD: AtomicU32 = AtomicU32::new(0);

/// A message's frame waits, or one was lost: for the task `control`.
pub(crate) static MESSAGE: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// The last byte of a frame is on its way out.
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Opens the UART.
pub(crate) fn open(
    uart: Peri<'static, peripherals::USART1>,
    input: Peri<'static, peripherals::PA10>,
    output: Peri<'static, peripherals::PA9>,
) {
    let mut config = Config::default();
    config.baudrate = BAUD;
    // A line that nothing drives reads as idle, not as noise.
    config.rx_pull = Pull::Up;
    let uart = Uart::new_blocking(uart, input, output, config).expect("84 MHz makes this baud rate");
    // From here on this module has the registers.
    core::mem::forget(uart);
    REGISTERS.cr1().modify(|control| control.set_rxneie(true));
    // SAFETY: the priorities are set, and the handler does nothing but receive before the program runs.
    unsafe { interrupt::USART1.enable() };
}

/// Takes bytes as they arrive; a map's last byte leads to the line. Sends what waits.
///
/// Deadline: 25 µs from a map's last byte in the receiver to the line. Budget: 4,200 cycles. Miss: fault 12, DEADLINE MISSED, in the status.
#[embassy_stm32::interrupt]
unsafe fn USART1() {
    let entered = control::cycles();
    let requested = priority::requested(Path::Uart, entered);
    let status = REGISTERS.sr().read();
    let ahead = AHEAD.load(Ordering::Relaxed);
    let came = if ahead == 0 { read(status) } else { ahead };
    AHEAD.store(0, Ordering::Relaxed);
    if came != 0 {
        block_path(|| {
            // SAFETY: the interrupt of the USB core is blocked, and all other users lie below.
            if let Some(control) = unsafe { control::from_isr() } {
                control.note_request(requested);
                received(came as u8, came & DAMAGED != 0, control, entered);
            }
        });
    }
    if status.txe() {
        send_next();
    }
}

/// In what [`read`] gives: it is a byte; an error came with it.
const IS_BYTE: u32 = 1 << 8;
const DAMAGED: u32 = 1 << 9;

/// Takes the byte that is in the receiver; 0 when none is.
#[inline]
fn read(status: Sr) -> u32 {
    if !(status.rxne() || status.ore()) {
        return 0;
    }
    // Reading it clears the errors as well.
    let byte = IS_BYTE | u32::from(REGISTERS.dr().read().dr() as u8);
    if status.ore() || status.fe() || status.ne() {
        byte | DAMAGED
    } else {
        byte
    }
}

/// Takes a byte out of the receiver while the interrupt works on the one before, and has the interrupt come again for it.
#[inline(never)]
fn take_ahead() {
    let ahead = read(REGISTERS.sr().read());
    if ahead != 0 {
        AHEAD.store(ahead, Ordering::Relaxed);
        NVIC::pend(interrupt::USART1);
    }
}

/// Takes a byte; `entered` is when its interrupt began.
#[inline]
fn received(byte: u8, is_damaged: bool, control: &mut Control, entered: u32) {
    let ended = RECEIVED.ended.load(Ordering::Relaxed);
    // SAFETY: the frame `ended` is this interrupt's.
    let frame = unsafe { &mut (*RECEIVED.frames.get())[ended % FRAMES] };
    if is_damaged {
        frame.spoil();
    }
    match frame.push(byte) {
        // A map's head takes longer than the receiver can wait, so the bytes behind it work on it.
        None => control.list_places(LinkId::Uart),
        Some(Frame::Packet(packet)) => match Kind::of(packet) {
            Some(Kind::MapTail) => control.map_tail(packet, LinkId::Uart, entered, take_ahead),
            Some(Kind::MapTaxels) => control.map_taxels(packet, LinkId::Uart, entered),
            Some(Kind::MapHead) => control.map_begins(packet, LinkId::Uart, entered),
            Some(Kind::Message) => hold(ended),
            None => control.unknown_packet(packet, LinkId::Uart, entered),
        },
        Some(Frame::Malformed) => {
            control.malformed_frame();
            tell_broken();
        }
    }
}

/// Keeps the frame that ended for the task, if there is another one for what comes next.
#[inline]
fn hold(ended: usize) {
    if ended.wrapping_sub(RECEIVED.read.load(Ordering::Relaxed)) < FRAMES - 1 {
        RECEIVED.ended.store(ended.wrapping_add(1), Ordering::Release);
        NVIC::pend(interrupt::UART4);
    } else {
        tell_broken();
    }
}

#[inline]
fn tell_broken() {
    RECEIVED.is_broken.store(true, Ordering::Relaxed);
    NVIC::pend(interrupt::UART4);
}

/// Sends the next byte of the frame on its way out, if one is.
#[inline]
fn send_next() {
    let (sent, length) = (
        SENDING.sent.load(Ordering::Relaxed),
        SENDING.length.load(Ordering::Relaxed),
    );
    if sent >= length {
        return;
    }
    // SAFETY: `transmit` writes it only while this interrupt has nothing to send.
    let Some(&byte) = (unsafe { &*SENDING.frame.get() }).get(sent) else {
        return;
    };
    let mut data = Dr(0);
    data.set_dr(byte.into());
    REGISTERS.dr().write_value(data);
    SENDING.sent.store(sent + 1, Ordering::Relaxed);
    if sent + 1 == length {
        REGISTERS.cr1().modify(|control| control.set_txeie(false));
        NVIC::pend(interrupt::UART4);
    }
}

/// Wakes who waits for the UART. Called from an interrupt that critical sections block, unlike the UART's own.
#[inline]
pub(crate) fn wake() {
    let is_waiting = RECEIVED.ended.load(Ordering::Relaxed) != RECEIVED.read.load(Ordering::Relaxed);
    if is_waiting || RECEIVED.is_broken.load(Ordering::Relaxed) {
        MESSAGE.signal(());
    }
    if is_sent() {
        SENT.signal(());
    }
}

fn is_sent() -> bool {
    SENDING.sent.load(Ordering::Relaxed) == SENDING.length.load(Ordering::Relaxed)
}

/// Whether a frame was lost or damaged since the last call.
pub(crate) fn take_broken() -> bool {
    RECEIVED.is_broken.swap(false, Ordering::Relaxed)
}

/// The next packet of a message that waits; [`next_message`] makes place for another one.
pub(crate) fn message() -> Option<&'static [u8]> {
    let read = RECEIVED.read.load(Ordering::Relaxed);
    if read == RECEIVED.ended.load(Ordering::Acquire) {
        return None;
    }
    // SAFETY: from `read` to `ended` the frames are those of the task `control`, the only caller.
    Some(unsafe { (*RECEIVED.frames.get())[read % FRAMES].packet() })
}

/// The packet has been read.
pub(crate) fn next_message() {
    RECEIVED.read.fetch_add(1, Ordering::Release);
}

/// Sends the packets of the outbox.
///
/// Deadline: none, the host waits. Budget: a copy of 66 bytes a packet. Miss: the outbox fills, and the library keeps only
/// the newest status.
#[embassy_executor::task]
pub(crate) async fn transmit() {
    loop {
        let packet = outbox::UART.receive().await;
        SENT.reset();
        // SAFETY: all bytes of the frame before are out, so the interrupt has nothing to send.
        let length = encode_packet(&packet, unsafe { &mut *SENDING.frame.get() });
        block_path(|| {
            SENDING.sent.store(0, Ordering::Relaxed);
            SENDING.length.store(length, Ordering::Relaxed);
            REGISTERS.cr1().modify(|control| control.set_txeie(true));
        });
        // Other packets wake it as well.
        while !is_sent() {
            SENT.wait().await;
        }
    }
}
