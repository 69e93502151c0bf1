//! The map-to-line path: every packet as it lands, the grip-force line at once, and the safety tick between.
//!
//! A packet of a map goes to the line in the interrupt of the USB core itself ([`MapPackets`]), ahead of the HAL's driver,
//! whose way over buffers, wakers and tasks would take half of the time bound. What is no bulk packet is left to the
//! driver. The task [`control`] makes the tick, takes packets from the UART (and those that the driver took out of the
//! FIFO behind a control packet), and lends itself the program for less than a tick's work at a time.
//! Units: microseconds, cycles of 168 MHz.

use core::cell::UnsafeCell;
use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::peripheral::DWT;
use cortex_m::register::basepri;
use embassy_futures::select::{Either3, select3};
use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_stm32::pac::USB_OTG_FS as REGISTERS;
use embassy_stm32::pac::otg::regs::Grxsts;
use embassy_stm32::pac::otg::vals::Pktstsd;
use embassy_stm32::usart::BufferedUartRx;
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointOut};
use embedded_io_async::Read;
use gripline_firmware::line::GripLine;
use gripline_firmware::{Action, Mcu, storage};
use gripline_protocol::PACKET_MAX;
use gripline_protocol::cobs::{CobsDecoder, Frame};
use gripline_protocol::constants::TAXELS_PER_PACKET;
use gripline_protocol::message::{Configuration, MessagePackets, Stage};
use gripline_protocol::packet::Kind;

use crate::flash::SettingsSectors;
use crate::gripper_bus::BusLine;
use crate::kernel::Dsp;
use crate::line::AnalogLine;
use crate::outbox::{self, Outbox, Packet};
use crate::usb::HostToMcu;
use crate::watchdog;

/// Time between two safety ticks.
const TICK: Duration = Duration::from_millis(1);

/// How long no packet came until the bus counts as free for words to the host, microseconds: maps at full speed bring
/// one every 51 µs and need every one of the bus's turns.
const QUIET_US: u64 = 200;

/// How long words wait for that at most, microseconds. Of what comes in between, only the newest is told.
const WORDS_LATE_US: u64 = 25_000;

/// Starts the counter that the stage times are read from.
pub(crate) fn start_cycle_counter() {
    // SAFETY: start-up, before any task; nothing else in this program uses the core's trace peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
}

/// A packet where its words are aligned, as the fast ways of CRC and sums want them.
#[repr(align(4))]
struct Aligned([u8; PACKET_MAX]);

/// The program, once it runs. The USB interrupt takes it as it is, everything below by [`with`].
struct Shared(UnsafeCell<Option<Control>>);

// SAFETY: reached by the USB interrupt and, with that interrupt held off, by the task `control`: never by both at once.
unsafe impl Sync for Shared {}

static CONTROL: Shared = Shared(UnsafeCell::new(None));

/// BASEPRI that holds off the USB interrupt (priority 3) and everything below it; the upper four bits count.
const HOLD_OFF: u8 = 3 << 4;

/// The packet in the USB interrupt's hands; not on its stack, where it would have to be cleared first.
struct PacketWords(UnsafeCell<[u32; PACKET_MAX / 4]>);

// SAFETY: the USB interrupt is its only user.
unsafe impl Sync for PacketWords {}

static PACKET: PacketWords = PacketWords(UnsafeCell::new([0; PACKET_MAX / 4]));

/// Works on the program with the USB interrupt held off; called by the task `control` alone.
fn with<T>(work: impl FnOnce(&mut Control) -> T) -> Option<T> {
    // SAFETY: raises the priority of the running code, here and back; nothing else uses this register.
    unsafe { basepri::write(HOLD_OFF) };
    compiler_fence(Ordering::SeqCst);
    // SAFETY: the only other user is held off, and this function is not called from `work`.
    let done = unsafe { &mut *CONTROL.0.get() }.as_mut().map(work);
    compiler_fence(Ordering::SeqCst);
    // SAFETY: as above.
    unsafe { basepri::write(0) };
    done
}

/// The bulk endpoint of the maps.
const ENDPOINT: usize = 1;

/// Takes bulk packets out of the USB core's FIFO as they land and carries them to the line; runs before the HAL's handler
/// of the same interrupt, which finds the rest.
///
/// Deadline: 25 µs from a map's last packet in the FIFO to the line. Budget: 4,200 cycles. Miss: the status tells.
pub(crate) struct MapPackets;

impl Handler<typelevel::OTG_FS> for MapPackets {
    #[inline]
    unsafe fn on_interrupt() {
        // SAFETY: this interrupt is the highest of the users of `CONTROL` and does not interrupt itself.
        let control = unsafe { &mut *CONTROL.0.get() };
        let Some(control) = control else {
            return;
        };
        while let Some(status) = next_of_endpoint() {
            if status.pktstsd() != Pktstsd::OUT_DATA_RX {
                end_of_packet();
                continue;
            }
            let _ = REGISTERS.grxstsp().read();
            let length = usize::from(status.bcnt()).min(PACKET_MAX);
            // SAFETY: as `CONTROL`; the packet is read by nothing but the call below.
            let words = unsafe { &mut *PACKET.0.get() };
            for word in words.iter_mut().take(length.div_ceil(4)) {
                *word = REGISTERS.fifo(0).read().data();
            }
            // Before more full packets the host is answered first, so that the bus never waits; otherwise time counts: a
            // map's last packet is asked for when the ones before are done with.
            let kind = words[0] & 0xF;
            let is_long_map = words[3] & 0x1FF >= 2 * TAXELS_PER_PACKET as u32;
            let is_followed = kind == Kind::MapTaxels as u32 || kind == Kind::MapHead as u32 && is_long_map;
            if is_followed && next_of_endpoint().is_some_and(|next| next.pktstsd() != Pktstsd::OUT_DATA_RX) {
                end_of_packet();
            }
            control.packet(
                bytemuck::bytes_of(words).get(..length).unwrap_or_default(),
                &outbox::USB,
            );
        }
    }
}

/// What lies on top of the receive FIFO, when it belongs to the maps' endpoint.
#[inline]
fn next_of_endpoint() -> Option<Grxsts> {
    if !REGISTERS.gintsts().read().rxflvl() {
        return None;
    }
    let status = REGISTERS.grxstsr().read();
    (usize::from(status.epnum()) == ENDPOINT).then_some(status)
}

/// Takes the end of a packet out of the FIFO and asks for the next packet: in this order, or the core may lose a word
/// (libopencm3 issue 873).
#[inline]
fn end_of_packet() {
    let _ = REGISTERS.grxstsp().read();
    REGISTERS.doeptsiz(ENDPOINT).modify(|size| {
        size.set_xfrsiz(PACKET_MAX as u32);
        size.set_pktcnt(1);
    });
    REGISTERS
        .doepctl(ENDPOINT)
        .modify(|control| control.set_cnak(true));
}

/// The program, the line it drives, and the host it answers.
struct Control {
    mcu: &'static mut Mcu<Dsp>,
    line: AnalogLine,
    flash: SettingsSectors,
    /// The transport that spoke last; none until a host spoke.
    answers: Option<&'static Outbox>,
    /// When the last packet came, and when the program was last asked for words, microseconds.
    packet_us: u64,
    words_us: u64,
}

/// What the program says, on its way to the host in packets.
#[derive(Default)]
struct Words {
    sending: Option<MessagePackets>,
    next_id: u8,
}

impl Words {
    /// Fills the outbox. The program is lent for one message at a time.
    fn send(&mut self, answers: &'static Outbox) {
        while !answers.is_full() {
            let mut bytes = [0; PACKET_MAX];
            if let Some(length) = self
                .sending
                .as_mut()
                .and_then(|packets| packets.next_packet(&mut bytes))
            {
                // There was room, and only this task fills the outbox.
                let _ = answers.try_send(Packet::new(bytes, length));
                continue;
            }
            let Some(message) = with(|control| control.mcu.poll_message()).flatten() else {
                self.sending = None;
                return;
            };
            self.next_id = self.next_id.wrapping_add(1);
            // Every message fits, as a test of the library shows; one that did not would be left out.
            self.sending = MessagePackets::new(&message, self.next_id).ok();
        }
    }
}

impl Control {
    /// One packet, to the line and to the answer.
    fn packet(&mut self, packet: &[u8], answers: &'static Outbox) {
        self.answers = Some(answers);
        self.packet_us = now_us();
        let started = DWT::cycle_count();
        let action = self.mcu.packet(packet, self.packet_us);
        self.act(
            action,
            if action.decided {
                Stage::Decide
            } else {
                Stage::Packet
            },
            started,
        );
    }

    /// The safety tick; says where to when there is something to say.
    fn tick(&mut self) -> Option<&'static Outbox> {
        let now_us = now_us();
        self.mcu.note_line(BusLine.health());
        let started = DWT::cycle_count();
        let action = self.mcu.tick(now_us);
        self.act(action, Stage::Tick, started);
        watchdog::tick_made();
        if let Some(settings) = self.mcu.take_store() {
            self.store(&settings);
        }
        let is_quiet = now_us.saturating_sub(self.packet_us) >= QUIET_US;
        let is_late = now_us.saturating_sub(self.words_us) >= WORDS_LATE_US;
        if !action.transmit || !(is_quiet || is_late) {
            return None;
        }
        self.words_us = now_us;
        self.answers
    }

    /// Keeps the settings in flash. The processor stands still for up to a second: nothing is in the gripper.
    fn store(&mut self, settings: &Configuration) {
        watchdog::be_patient();
        let written = storage::store(&mut self.flash, settings);
        watchdog::be_strict();
        defmt::info!("settings stored: {}", written);
        self.mcu.stored(written.ok());
    }

    /// The line first, then the times it took.
    fn act(&mut self, action: Action, stage: Stage, started: u32) {
        let decided = DWT::cycle_count();
        let (Ok(()), Ok(())) = (self.line.write(action.line), BusLine.write(action.line));
        let written = DWT::cycle_count();
        self.mcu.note_cycles(stage, decided.wrapping_sub(started));
        self.mcu.note_cycles(Stage::Line, written.wrapping_sub(decided));
    }
}

fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// The safety tick every millisecond, and packets that did not come the direct way.
///
/// Deadline: the tick within its millisecond. Budget: half of it. Miss: when ticks stop, the watchdog is not fed and the
/// chip resets with its line restored. The tick is asked for after every packet, so that no flood of them can hold it up.
#[embassy_executor::task]
pub(crate) async fn control(
    mcu: &'static mut Mcu<Dsp>,
    line: AnalogLine,
    flash: SettingsSectors,
    mut uart: BufferedUartRx<'static>,
    mut usb: HostToMcu,
) {
    let control = Control {
        mcu,
        line,
        flash,
        answers: None,
        packet_us: 0,
        words_us: 0,
    };
    // SAFETY: the USB interrupt does not touch what is not there yet, and this is one word of a flag in the end.
    cortex_m::interrupt::free(|_| unsafe { *CONTROL.0.get() = Some(control) });
    let mut words = Words::default();
    let mut frames = CobsDecoder::new();
    let mut tick_at = Instant::now() + TICK;
    let mut from_uart = [0; PACKET_MAX];
    let mut from_usb = Aligned([0; PACKET_MAX]);
    loop {
        if Instant::now() >= tick_at {
            tick_at += TICK;
            if let Some(answers) = with(Control::tick).flatten() {
                words.send(answers);
            }
        }
        // Every part may be dropped half-way: none takes a byte before it is done.
        match select3(
            next_transfer(&mut usb, &mut from_usb.0),
            Timer::at(tick_at),
            uart.read(&mut from_uart),
        )
        .await
        {
            Either3::First(Ok(length)) => {
                let packet = from_usb.0.get(..length).unwrap_or_default();
                with(|control| control.packet(packet, &outbox::USB));
            }
            Either3::Third(Ok(length)) => {
                for &byte in &from_uart[..length] {
                    match frames.push(byte) {
                        Some(Frame::Packet(packet)) => {
                            with(|control| control.packet(packet, &outbox::UART));
                        }
                        Some(Frame::Malformed) => {
                            with(|control| control.mcu.malformed_frame());
                        }
                        None => {}
                    }
                }
            }
            // The tick is made above. The cable went, or noise hit a byte: the program notices by itself that maps
            // stopped or do not decode.
            Either3::First(Err(_)) | Either3::Second(()) | Either3::Third(Err(_)) => {}
        }
    }
}

/// The next transfer from the host; waits while no host has configured the device.
async fn next_transfer(usb: &mut HostToMcu, packet: &mut [u8; PACKET_MAX]) -> Result<usize, EndpointError> {
    usb.wait_enabled().await;
    usb.read(packet).await
}
