//! The interrupt of the USB core: packets of maps to the line at once, everything else to whom it belongs.
//!
//! A packet of a map goes to the line here ([`MapPackets`]), ahead of the HAL's driver, whose way over buffers, wakers and
//! tasks would take half of the time bound. Messages wait in [`MESSAGE`] for the task `control`, and the endpoint with
//! them: the host's packets are worked on in their order. What is no bulk packet is the HAL's, in an interrupt of its own
//! ([`Rest`], in the place of UART4, which no board wires), because the HAL may not interrupt its own critical sections.
//! Limits: no loop here; what is left in the FIFO raises the interrupt again.

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
use gripline_protocol::PACKET_MAX;
use gripline_protocol::constants::TAXELS_PER_PACKET;
use gripline_protocol::packet::Kind;

use crate::control::{self, Control};
use crate::outbox;
use crate::priority::hold_off;

bind_interrupts!(pub(crate) struct Interrupts {
    OTG_FS => MapPackets;
    UART4 => Rest;
});

// SAFETY: `Rest` runs that handler for every event that `MapPackets` leaves.
unsafe impl Binding<typelevel::OTG_FS, InterruptHandler<peripherals::USB_OTG_FS>> for Interrupts {}

/// The bulk endpoint of the host's packets.
const ENDPOINT: usize = 1;

/// Taxels of a map whose second packet is not its last.
const ANOTHER: u32 = TAXELS_PER_PACKET as u32;

/// A packet that was taken out of the FIFO; not on the stack, where it would have to be cleared first.
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

/// A message's packet lies in [`PACKET`], and the next packet is not asked for.
static IS_HELD: AtomicBool = AtomicBool::new(false);
/// The end of a packet is still to come out of the FIFO.
static IS_OPEN: AtomicBool = AtomicBool::new(false);
/// The USB core's interrupts before some were masked for [`Rest`]; 0 when none are.
static MASK: AtomicU32 = AtomicU32::new(0);
/// [`PACKET`] holds a message's packet for the task `control`.
pub(crate) static MESSAGE: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Takes bulk packets out of the USB core's FIFO as they land and carries those of maps to the line.
///
/// Deadline: 25 µs from a map's last packet in the FIFO to the line. Budget: 4,200 cycles. Miss: the status tells.
pub(crate) struct MapPackets;

impl Handler<typelevel::OTG_FS> for MapPackets {
    #[inline]
    unsafe fn on_interrupt() {
        let Some(status) = next() else {
            return leave(is_received());
        };
        // SAFETY: this interrupt lies above all other users, who hold it off.
        let Some(control) = (unsafe { control::of_the_path() }) else {
            return leave(true);
        };
        if status.pktstsd() == Pktstsd::OUT_DATA_RX {
            packet(status, control);
        } else if IS_OPEN.load(Ordering::Relaxed) {
            end_of_packet();
        } else {
            // Of a packet that the HAL is taking out.
            leave(true);
        }
    }
}

/// What lies on top of the receive FIFO, when it belongs to the bulk endpoint.
#[inline]
fn next() -> Option<Grxsts> {
    if !is_received() {
        return None;
    }
    let status = REGISTERS.grxstsr().read();
    (usize::from(status.epnum()) == ENDPOINT).then_some(status)
}

#[inline]
fn is_received() -> bool {
    REGISTERS.gintsts().read().rxflvl()
}

/// Takes a packet out of the FIFO and works on it.
#[inline]
fn packet(status: Grxsts, control: &mut Control) {
    let _ = REGISTERS.grxstsp().read();
    let length = usize::from(status.bcnt()).min(PACKET_MAX);
    IS_OPEN.store(true, Ordering::Relaxed);
    // SAFETY: no message is held, as the endpoint takes no packet meanwhile.
    let words = unsafe { &mut *PACKET.words.get() };
    take(words, length.div_ceil(4));
    let bytes = bytemuck::bytes_of(words).get(..length).unwrap_or_default();
    let kind = Kind::of(bytes);
    if kind == Some(Kind::Message) {
        PACKET.length.store(length, Ordering::Relaxed);
        IS_HELD.store(true, Ordering::Relaxed);
        return NVIC::pend(interrupt::UART4);
    }
    // Before more packets the host is answered first, so that the bus never waits: a map's last packet takes at least 8.3 µs
    // from then on, about as long as this one, whose rest is part of the bound.
    let is_followed = match kind {
        Some(Kind::MapTaxels) => true,
        Some(Kind::MapHead) => words[3] & 0x1FF >= ANOTHER,
        _ => false,
    };
    if is_followed && next().is_some_and(|next| next.pktstsd() != Pktstsd::OUT_DATA_RX) {
        end_of_packet();
    }
    control.map_packet(bytes, &outbox::USB);
}

/// Takes words out of the FIFO, four at a time as long as there are four. Every address of its window is its next word.
#[inline]
fn take(words: &mut [u32; PACKET_MAX / 4], count: usize) {
    let fifo = REGISTERS.fifo(0).as_ptr();
    let (blocks, rest) = words[..count.min(PACKET_MAX / 4)].as_chunks_mut::<4>();
    for block in blocks {
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
    for word in rest {
        *word = REGISTERS.fifo(0).read().data();
    }
}

/// Takes the end of a packet out of the FIFO and asks for the next packet.
#[inline]
fn end_of_packet() {
    let _ = REGISTERS.grxstsp().read();
    IS_OPEN.store(false, Ordering::Relaxed);
    if !IS_HELD.load(Ordering::Relaxed) {
        ask();
    }
}

/// Asks for the next packet: after the end of the one before, or the core may lose a word (libopencm3 issue 873).
#[inline]
fn ask() {
    REGISTERS.doeptsiz(ENDPOINT).modify(|size| {
        size.set_xfrsiz(PACKET_MAX as u32);
        size.set_pktcnt(1);
    });
    REGISTERS
        .doepctl(ENDPOINT)
        .modify(|control| control.set_cnak(true));
}

/// Leaves what happened to [`Rest`] and lets none but bulk packets interrupt until then; no packet either when
/// something else lies on top of the FIFO.
#[inline]
fn leave(is_received: bool) {
    let mask = REGISTERS.gintmsk().read();
    MASK.store(MASK.load(Ordering::Relaxed) | mask.0, Ordering::Relaxed);
    REGISTERS.gintmsk().write_value(left(mask, is_received));
    NVIC::pend(interrupt::UART4);
}

/// What [`leave`] leaves of the mask.
#[inline]
fn left(mask: Gintmsk, is_received: bool) -> Gintmsk {
    let mut left = Gintmsk(0);
    left.set_rxflvlm(mask.rxflvlm() && !is_received);
    left
}

/// The HAL's driver, and the call for the task `control`.
///
/// Deadline: a packet behind one for the control endpoint waits for it, and takes 11 µs on the bus to come (the least that
/// a packet of a map takes). Budget: that. Miss: the map's packet is worked on so much later.
pub(crate) struct Rest;

impl Handler<typelevel::UART4> for Rest {
    #[inline]
    unsafe fn on_interrupt() {
        if MASK.load(Ordering::Relaxed) != 0 {
            // SAFETY: in an interrupt that the HAL's critical sections hold off. Packets of maps are not its business:
            // while it has something in its hands that came out of the FIFO, `MapPackets` leaves the FIFO alone.
            unsafe {
                <InterruptHandler<peripherals::USB_OTG_FS> as Handler<typelevel::OTG_FS>>::on_interrupt();
            };
            hold_off(let_in);
        }
        if IS_HELD.load(Ordering::Relaxed) {
            MESSAGE.signal(());
        }
    }
}

/// Lets the USB core interrupt again as before [`leave`].
#[inline]
fn let_in() {
    let saved = MASK.load(Ordering::Relaxed);
    MASK.store(0, Ordering::Relaxed);
    let mask = REGISTERS.gintmsk().read();
    // This is what the HAL lets in after a reset or a suspend, until its own task has seen it.
    let mut few = Gintmsk(0);
    few.set_iepint(true);
    few.set_oepint(true);
    few.set_rxflvlm(true);
    if mask != few {
        REGISTERS.gintmsk().write_value(Gintmsk(mask.0 | saved));
    }
    // The HAL may have taken the end of a packet that lay behind something of its own.
    if IS_OPEN.load(Ordering::Relaxed) && !is_received() {
        IS_OPEN.store(false, Ordering::Relaxed);
        if !IS_HELD.load(Ordering::Relaxed) {
            ask();
        }
    }
}

/// The packet that [`MESSAGE`] announced; nothing when it announced the same one twice.
pub(crate) fn message() -> Option<&'static [u8]> {
    if !IS_HELD.load(Ordering::Relaxed) {
        return None;
    }
    // SAFETY: nothing writes it until `next_packet`, after which its only reader, the task `control`, is done with it.
    let words = unsafe { &*PACKET.words.get() };
    bytemuck::bytes_of(words).get(..PACKET.length.load(Ordering::Relaxed))
}

/// The message's packet is done with: the endpoint takes the next one.
pub(crate) fn next_packet() {
    hold_off(|| {
        IS_HELD.store(false, Ordering::Relaxed);
        // Otherwise its end, when it comes.
        if !IS_OPEN.load(Ordering::Relaxed) {
            ask();
        }
    });
}
