//! The interrupt of the USB core: decides on packets of maps at once and hands on everything else.
//!
//! [`MapPackets`] takes a packet of a map from the FIFO to the line, ahead of the HAL's driver, whose buffers, wakers and tasks
//! would take half of the deadline. A packet of a message waits for the task `control` ([`MESSAGE`]); the endpoint takes no other
//! meanwhile, so the order stays. The HAL's driver does the rest in an interrupt of its own ([`HalDriver`], in the place of
//! UART4, which no board wires), because it may not interrupt its own critical sections.
//! Limits: no loop over packets; what is left in the FIFO raises the interrupt again.

use core::arch::asm;
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt::typelevel::{self, Binding, Handler};
use embassy_stm32::pac::USB_OTG_FS as REGISTERS;
use embassy_stm32::pac::otg::regs::{Gintmsk, Grxsts};
use embassy_stm32::pac::otg::vals::Pktstsd;
use embassy_stm32::usb::InterruptHandler;
use embassy_stm32::{bind_interrupts, interrupt, peripherals};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use gripline_firmware::LinkId;
use gripline_protocol::PACKET_MAX;
use gripline_protocol::constants::TAXELS_PER_PACKET;
use gripline_protocol::packet::Kind;
use gripline_protocol::rounds::at_most;

use crate::control::{self, Control};
use crate::priority::{self, Path, block_path};
use crate::uart;

bind_interrupts!(pub(crate) struct Interrupts {
    OTG_FS => MapPackets;
    UART4 => HalDriver;
});

// SAFETY: `HalDriver` runs that handler for every event that `MapPackets` leaves.
unsafe impl Binding<typelevel::OTG_FS, InterruptHandler<peripherals::USB_OTG_FS>> for Interrupts {}

/// The bulk endpoint of the host's packets.
const ENDPOINT: usize = 1;

/// Taxels of a map whose second packet is not its last.
const ANOTHER: u32 = TAXELS_PER_PACKET as u32;

/// A packet from the FIFO; not on the stack, where it would have to be cleared first.
struct Slot {
    words: UnsafeCell<[u32; PACKET_MAX / 4]>,
    length: AtomicUsize,
}

// SAFETY: `MapPackets` writes it while `IS_HELD` is false, `take_message` reads it while it is true.
unsafe impl Sync for Slot {}

static PACKET: Slot = Slot {
    words: UnsafeCell::new([0; PACKET_MAX / 4]),
    length: AtomicUsize::new(0),
};

/// [`PACKET`] holds a message's packet, and the endpoint takes no other.
static IS_HELD: AtomicBool = AtomicBool::new(false);
/// The end of a packet is still to come out of the FIFO.
static IS_OPEN: AtomicBool = AtomicBool::new(false);
/// The USB core's interrupts before some were masked for [`HalDriver`]; 0 when none are.
static MASK: AtomicU32 = AtomicU32::new(0);
/// [`PACKET`] holds a message's packet for the task `control`.
pub(crate) static MESSAGE: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Takes bulk packets out of the USB core's FIFO as they arrive; those of maps go to the line.
///
/// Deadline: 25 µs from a map's last packet in the FIFO to the line. Budget: 4,200 cycles. Miss: fault 12, DEADLINE
/// MISSED, in the status.
pub(crate) struct MapPackets;

impl Handler<typelevel::OTG_FS> for MapPackets {
    #[inline]
    unsafe fn on_interrupt() {
        let entered = control::cycles();
        let requested = priority::requested(Path::Usb, entered);
        take(entered, requested);
        priority::note_blocked(Path::Uart, requested);
    }
}

/// Takes one entry out of the FIFO, or leaves what is there to the HAL. `entered` is when the interrupt began, `requested` since
/// when it may have been pending.
#[inline]
fn take(entered: u32, requested: u32) {
    // Read once: what lands after it interrupts again, and is not left to the HAL.
    if !is_received() {
        return defer(false);
    }
    let Some(status) = top() else {
        return defer(true);
    };
    // SAFETY: this interrupt lies above all other users, who block it, except for that of the UART, which does not interrupt it.
    let Some(control) = (unsafe { control::from_isr() }) else {
        return defer(true);
    };
    control.note_request(requested);
    if status.pktstsd() == Pktstsd::OUT_DATA_RX {
        packet(status, control, entered);
    } else if IS_OPEN.load(Ordering::Relaxed) {
        end_of_packet();
    } else {
        // It belongs to a packet that the HAL is reading.
        defer(true);
    }
}

/// The top of the receive FIFO, which is not empty, when it belongs to the bulk endpoint.
#[inline]
fn top() -> Option<Grxsts> {
    let status = REGISTERS.grxstsr().read();
    (usize::from(status.epnum()) == ENDPOINT).then_some(status)
}

#[inline]
fn is_received() -> bool {
    REGISTERS.gintsts().read().rxflvl()
}

/// Takes a packet out of the FIFO and handles it. `entered` is when its interrupt began.
#[inline]
fn packet(status: Grxsts, control: &mut Control, entered: u32) {
    let _ = REGISTERS.grxstsp().read();
    let length = usize::from(status.bcnt()).min(PACKET_MAX);
    IS_OPEN.store(true, Ordering::Relaxed);
    // SAFETY: no message is held, as the endpoint takes no packet meanwhile.
    let words = unsafe { &mut *PACKET.words.get() };
    read_words(words, length.div_ceil(4));
    let bytes = bytemuck::bytes_of(words).get(..length).unwrap_or_default();
    match Kind::of(bytes) {
        Some(Kind::MapTail) => control.map_tail(bytes, LinkId::Usb, entered, || {}),
        Some(Kind::MapTaxels) => {
            ask_for_next();
            control.map_taxels(bytes, LinkId::Usb, entered);
        }
        Some(Kind::MapHead) => {
            if words[3] & 0x1FF >= ANOTHER {
                ask_for_next();
            }
            control.map_head(bytes, LinkId::Usb, entered);
        }
        Some(Kind::Message) => {
            PACKET.length.store(length, Ordering::Relaxed);
            IS_HELD.store(true, Ordering::Relaxed);
            NVIC::pend(interrupt::UART4);
        }
        None => control.unknown_packet(bytes, LinkId::Usb, entered),
    }
}

/// Asks for the next packet of a map before the work on this one. It takes at least 8.3 µs to arrive, about as long as this work; what
/// remains of the work then is part of the bound.
#[inline]
fn ask_for_next() {
    if is_received() && top().is_some_and(|next| next.pktstsd() != Pktstsd::OUT_DATA_RX) {
        end_of_packet();
    }
}

/// Reads words from the FIFO, four at a time. Every address of its window reads the next word.
#[inline]
fn read_words(words: &mut [u32; PACKET_MAX / 4], count: usize) {
    let fifo = REGISTERS.fifo(0).as_ptr();
    let (blocks, rest) = words[..count.min(PACKET_MAX / 4)].as_chunks_mut::<4>();
    for block in at_most::<{ PACKET_MAX / 16 }, _>(blocks) {
        // SAFETY: the window is 4 KiB; nothing interrupts this handler, so no word is taken twice; `block` has four.
        unsafe {
            asm!(
                "ldm {fifo}, {{r4, r5, r8, r12}}",
                "stm {block}, {{r4, r5, r8, r12}}",
                fifo = in(reg) fifo,
                block = in(reg) block.as_mut_ptr(),
                out("r4") _, out("r5") _, out("r8") _, out("r12") _,
                options(nostack, preserves_flags),
            );
        }
    }
    for word in at_most::<3, _>(rest) {
        *word = REGISTERS.fifo(0).read().data();
    }
}

/// Takes the end of a packet out of the FIFO and lets the endpoint take the next one.
#[inline]
fn end_of_packet() {
    let _ = REGISTERS.grxstsp().read();
    IS_OPEN.store(false, Ordering::Relaxed);
    if !IS_HELD.load(Ordering::Relaxed) {
        accept_next();
    }
}

/// Lets the endpoint take the next packet. Only after the end of the one before, or the core may lose a word
/// (<https://github.com/libopencm3/libopencm3/issues/873>).
#[inline]
fn accept_next() {
    REGISTERS.doeptsiz(ENDPOINT).modify(|size| {
        size.set_xfrsiz(PACKET_MAX as u32);
        size.set_pktcnt(1);
    });
    REGISTERS
        .doepctl(ENDPOINT)
        .modify(|control| control.set_cnak(true));
}

/// Leaves the event to [`HalDriver`]. Until then only bulk packets interrupt; not even these when something else lies on top of
/// the FIFO.
#[inline]
fn defer(is_received: bool) {
    let mask = REGISTERS.gintmsk().read();
    MASK.store(MASK.load(Ordering::Relaxed) | mask.0, Ordering::Relaxed);
    REGISTERS.gintmsk().write_value(deferred_mask(mask, is_received));
    NVIC::pend(interrupt::UART4);
}

/// The mask while an event is deferred.
#[inline]
fn deferred_mask(mask: Gintmsk, is_received: bool) -> Gintmsk {
    let mut deferred = Gintmsk(0);
    deferred.set_rxflvlm(mask.rxflvlm() && !is_received);
    deferred
}

/// Runs the HAL's driver, and wakes the task `control` for a message of either link.
///
/// Deadline: 11 µs, the least that a map's packet behind one of the control endpoint takes on the bus. Budget: that. Miss: the
/// map's packet is handled so much later.
pub(crate) struct HalDriver;

impl Handler<typelevel::UART4> for HalDriver {
    #[inline]
    unsafe fn on_interrupt() {
        if MASK.load(Ordering::Relaxed) != 0 {
            // SAFETY: the HAL's critical sections block this interrupt. While it reads a packet from the FIFO, `MapPackets`
            // leaves the FIFO alone.
            unsafe {
                <InterruptHandler<peripherals::USB_OTG_FS> as Handler<typelevel::OTG_FS>>::on_interrupt();
            };
            block_path(unmask);
        }
        if IS_HELD.load(Ordering::Relaxed) {
            MESSAGE.signal(());
        }
        uart::wake();
    }
}

/// Restores the interrupts of the USB core from before [`defer`].
#[inline]
fn unmask() {
    let saved = MASK.load(Ordering::Relaxed);
    MASK.store(0, Ordering::Relaxed);
    let mask = REGISTERS.gintmsk().read();
    // The HAL sets this mask after a reset or a suspend, until its task has handled it.
    let mut reset_mask = Gintmsk(0);
    reset_mask.set_iepint(true);
    reset_mask.set_oepint(true);
    reset_mask.set_rxflvlm(true);
    if mask != reset_mask {
        REGISTERS.gintmsk().write_value(Gintmsk(mask.0 | saved));
    }
    // The HAL may have read the end of a packet that lay behind one of its own.
    if IS_OPEN.load(Ordering::Relaxed) && !is_received() {
        IS_OPEN.store(false, Ordering::Relaxed);
        if !IS_HELD.load(Ordering::Relaxed) {
            accept_next();
        }
    }
}

/// The packet that [`MESSAGE`] announced; none when it was announced twice.
pub(crate) fn message() -> Option<&'static [u8]> {
    if !IS_HELD.load(Ordering::Relaxed) {
        return None;
    }
    // SAFETY: nothing writes it until `next_packet`; its only reader, the task `control`, is done with it by then.
    let words = unsafe { &*PACKET.words.get() };
    bytemuck::bytes_of(words).get(..PACKET.length.load(Ordering::Relaxed))
}

/// The message's packet has been read: lets the endpoint take the next one.
pub(crate) fn next_packet() {
    block_path(|| {
        IS_HELD.store(false, Ordering::Relaxed);
        // Otherwise `end_of_packet` does it.
        if !IS_OPEN.load(Ordering::Relaxed) {
            accept_next();
        }
    });
}
