//! The program and the line: every packet of a map at once, the safety tick between, messages when there is time.
//!
//! Packets of maps come from the interrupt of the USB core (`usb_interrupt`). The task [`control`] makes the tick, reads
//! messages, takes packets from the UART (and those that the HAL's driver took out of the FIFO behind a control packet),
//! and lends itself the program for less than a tick's work at a time.
//! Units: microseconds, cycles of 168 MHz.

use core::cell::UnsafeCell;

use cortex_m::peripheral::DWT;
use embassy_futures::select::{Either4, select4};
use embassy_stm32::usart::BufferedUartRx;
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointOut};
use embedded_io_async::Read;
use gripline_firmware::line::GripLine;
use gripline_firmware::program::{MessageEvent, MessageReader, MessageWriter};
use gripline_firmware::{Action, FaultSet, Program, storage};
use gripline_protocol::PACKET_MAX;
use gripline_protocol::cobs::{CobsDecoder, Frame};
use gripline_protocol::message::{Configuration, LineSettings, Message, Stage};
use gripline_protocol::packet::Kind;

use crate::flash::SettingsSectors;
use crate::gripper_bus::BusLine;
use crate::kernel::Dsp;
use crate::line::AnalogLine;
use crate::outbox::{self, Outbox};
use crate::priority::{hold_off, without_usb};
use crate::usb::HostToMcu;
use crate::{fault_log, usb_interrupt, watchdog};

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

/// The program for the USB interrupt; none before it runs.
///
/// # Safety
/// Called by the USB interrupt, which must not keep it.
#[inline]
pub(crate) unsafe fn of_the_path() -> Option<&'static mut Control> {
    // SAFETY: this interrupt is the highest of the users of `CONTROL` and does not interrupt itself.
    unsafe { &mut *CONTROL.0.get() }.as_mut()
}

/// The program for the task `control`, which is the only one to call it.
///
/// # Safety
/// Called with the USB interrupt held off.
#[inline]
unsafe fn of_the_task() -> Option<&'static mut Control> {
    // SAFETY: the only other user is held off.
    unsafe { &mut *CONTROL.0.get() }.as_mut()
}

/// Works on the program with the USB interrupt held off, and all below it.
#[inline]
fn with<T>(work: impl FnOnce(&mut Control) -> T) -> Option<T> {
    // SAFETY: held off, and this function is not called from `work`.
    hold_off(|| unsafe { of_the_task() }.map(work))
}

/// The program, the line it drives, and the host it answers.
pub(crate) struct Control {
    program: &'static mut Program<Dsp>,
    line: AnalogLine,
    /// The transport that spoke last; none until a host spoke.
    answers: Option<&'static Outbox>,
    /// When the last packet came, and when the program was last asked for words, microseconds.
    packet_us: u64,
    words_us: u64,
}

/// Fills the outbox. The program is borrowed for one message at a time.
fn send(writer: &mut MessageWriter, answers: &'static Outbox) {
    while !answers.is_full() {
        let packet = writer.next_packet(|| {
            let mut message = None;
            with(|control| control.message(&mut message));
            message
        });
        let Some(packet) = packet else {
            return;
        };
        // There was room, and only this task fills the outbox.
        let _ = answers.try_send(packet);
    }
}

impl Control {
    /// One packet of a map, to the line and to the answer.
    #[inline]
    pub(crate) fn map_packet(&mut self, packet: &[u8], answers: &'static Outbox) {
        self.answers = Some(answers);
        self.packet_us = now_us();
        let started = DWT::cycle_count();
        let action = self.program.map_packet(packet, self.packet_us);
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

    /// What came of a packet of a message.
    #[inline(never)]
    fn message_packet(&mut self, event: &MessageEvent, answers: &'static Outbox) {
        self.answers = Some(answers);
        self.packet_us = now_us();
        self.program.message(event, self.packet_us);
    }

    /// What there is to say.
    #[inline(never)]
    fn message(&mut self, message: &mut Option<Message>) {
        *message = self.program.poll_message();
    }

    /// The first half of the safety tick.
    #[inline(never)]
    fn age(&mut self) {
        self.program.note_line(BusLine.health());
        self.program.age(now_us());
    }

    /// The second half; says where to when there is something to say.
    #[inline(never)]
    fn tick(&mut self, faults: &mut FaultSet) -> Option<&'static Outbox> {
        let now_us = now_us();
        *faults = self.program.faults();
        let started = DWT::cycle_count();
        let action = self.program.advance(now_us);
        self.act(action, Stage::Tick, started);
        watchdog::tick_made();
        let is_quiet = now_us.saturating_sub(self.packet_us) >= QUIET_US;
        let is_late = now_us.saturating_sub(self.words_us) >= WORDS_LATE_US;
        if !action.transmit || !(is_quiet || is_late) {
            return None;
        }
        self.words_us = now_us;
        self.answers
    }

    /// The settings that have to be kept, when they do.
    #[inline(never)]
    fn settings_to_store(&mut self, settings: &mut Option<Configuration>) {
        *settings = self.program.take_store();
    }

    /// The line first, then the times it took.
    fn act(&mut self, action: Action, stage: Stage, started: u32) {
        let decided = DWT::cycle_count();
        let (Ok(()), Ok(())) = (self.line.write(action.line), BusLine.write(action.line));
        let written = DWT::cycle_count();
        self.program.note_cycles(stage, decided.wrapping_sub(started));
        self.program
            .note_cycles(Stage::Line, written.wrapping_sub(decided));
    }
}

fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// A packet that did not come the direct way. Messages are put together and read with the path free.
fn received(messages: &mut MessageReader, packet: &[u8], answers: &'static Outbox) {
    if Kind::of(packet) != Some(Kind::Message) {
        // SAFETY: as `with`.
        without_usb(|| unsafe { of_the_task() }.map(|control| control.map_packet(packet, answers)));
        return;
    }
    let event = messages.read(packet);
    with(|control| control.message_packet(&event, answers));
}

/// Keeps the settings in flash. The processor stands still for up to a second: nothing is in the gripper, and commands
/// wait until this is done.
fn store(flash: &mut SettingsSectors, settings: &Configuration) {
    watchdog::be_patient();
    let written = storage::store(flash, settings);
    watchdog::be_strict();
    defmt::info!("settings stored: {}", written);
    with(|control| control.program.stored(written.ok()));
}

/// The safety tick every millisecond, and packets that did not come the direct way.
///
/// Deadline: the tick within its millisecond. Budget: half of it. Miss: when ticks stop, the watchdog is not fed and the
/// chip resets with its line restored. The tick is asked for after every packet, so that no flood of them can hold it up.
#[embassy_executor::task]
pub(crate) async fn control(
    program: &'static mut Program<Dsp>,
    line: AnalogLine,
    in_force: LineSettings,
    mut flash: SettingsSectors,
    mut uart: BufferedUartRx<'static>,
    mut usb: HostToMcu,
) {
    let control = Control {
        program,
        line,
        answers: None,
        packet_us: 0,
        words_us: 0,
    };
    // SAFETY: the other user is held off.
    hold_off(|| unsafe { *CONTROL.0.get() = Some(control) });
    let mut writer = MessageWriter::default();
    let mut logged = FaultSet::EMPTY;
    let mut messages = MessageReader::new(in_force);
    let mut frames = CobsDecoder::new();
    let mut tick_at = Instant::now() + TICK;
    let mut from_uart = [0; PACKET_MAX];
    let mut from_usb = Aligned([0; PACKET_MAX]);
    loop {
        if Instant::now() >= tick_at {
            tick_at += TICK;
            // In two, so that a packet need not wait for both.
            with(Control::age);
            let mut faults = logged;
            if let Some(answers) = with(|control| control.tick(&mut faults)).flatten() {
                send(&mut writer, answers);
            }
            if faults != logged {
                logged = faults;
                fault_log::CHANGED.signal(faults);
            }
            let mut settings = None;
            with(|control| control.settings_to_store(&mut settings));
            if let Some(settings) = settings {
                store(&mut flash, &settings);
            }
        }
        // Every part may be dropped half-way: none takes a byte before it is done.
        match select4(
            next_transfer(&mut usb, &mut from_usb.0),
            Timer::at(tick_at),
            uart.read(&mut from_uart),
            usb_interrupt::MESSAGE.wait(),
        )
        .await
        {
            Either4::First(Ok(length)) => {
                let packet = from_usb.0.get(..length).unwrap_or_default();
                received(&mut messages, packet, &outbox::USB);
            }
            Either4::Fourth(()) => {
                if let Some(packet) = usb_interrupt::message() {
                    received(&mut messages, packet, &outbox::USB);
                    usb_interrupt::next_packet();
                }
            }
            Either4::Third(Ok(length)) => {
                for &byte in &from_uart[..length] {
                    match frames.push(byte) {
                        Some(Frame::Packet(packet)) => {
                            received(&mut messages, packet, &outbox::UART);
                        }
                        Some(Frame::Malformed) => {
                            messages.drop_message();
                            with(|control| control.program.refuse_packet());
                        }
                        None => {}
                    }
                }
            }
            // The tick is made above. The cable went, or noise hit a byte: the program notices by itself that maps
            // stopped or do not decode.
            Either4::First(Err(_)) | Either4::Second(()) | Either4::Third(Err(_)) => {}
        }
    }
}

/// The next transfer from the host; waits while no host has configured the device.
async fn next_transfer(usb: &mut HostToMcu, packet: &mut [u8; PACKET_MAX]) -> Result<usize, EndpointError> {
    usb.wait_enabled().await;
    usb.read(packet).await
}
