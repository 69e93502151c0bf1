//! The map-to-line path: every packet as it lands, the grip-force line at once, and the safety tick between.
//!
//! One task owns the program, the line and both transports' incoming halves, so that nothing is shared and nothing is
//! locked. Units: microseconds, cycles of 168 MHz.

use cortex_m::peripheral::DWT;
use embassy_futures::select::{Either3, select3};
use embassy_stm32::usart::BufferedUartRx;
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointOut};
use embedded_io_async::Read;
use gripline_firmware::line::GripLine;
use gripline_firmware::{Action, Mcu, storage};
use gripline_protocol::PACKET_MAX;
use gripline_protocol::cobs::{CobsDecoder, Frame};
use gripline_protocol::message::{Configuration, Stage};

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

    /// The safety tick.
    fn tick(&mut self) {
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
        if action.transmit && (is_quiet || is_late) {
            self.words_us = now_us;
            self.answer();
        }
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

    /// What the program has to say, for the host that spoke last.
    fn answer(&mut self) {
        let Some(answers) = self.answers else {
            return;
        };
        while !answers.is_full() {
            let mut bytes = [0; PACKET_MAX];
            let Some(length) = self.mcu.poll_transmit(&mut bytes) else {
                return;
            };
            // There was room, and only this task fills the outbox.
            let _ = answers.try_send(Packet::new(bytes, length));
        }
    }
}

fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// Packet to line, and the safety tick every millisecond.
///
/// Deadline: 25 µs from a map's last packet to the line; the tick within its millisecond. Budget: 4,200 cycles a
/// packet. Miss: the worst time is in every status; when ticks stop, the watchdog is not fed and the chip resets with
/// its line restored. The tick is asked for after every packet, so that no flood of them can hold it up; a packet goes
/// first, because the driver takes the next one only when this one is fetched.
#[embassy_executor::task]
pub(crate) async fn control(
    mcu: &'static mut Mcu<Dsp>,
    line: AnalogLine,
    flash: SettingsSectors,
    mut uart: BufferedUartRx<'static>,
    mut usb: HostToMcu,
) {
    let mut control = Control {
        mcu,
        line,
        flash,
        answers: None,
        packet_us: 0,
        words_us: 0,
    };
    let mut frames = CobsDecoder::new();
    let mut tick_at = Instant::now() + TICK;
    let mut from_uart = [0; PACKET_MAX];
    let mut from_usb = Aligned([0; PACKET_MAX]);
    loop {
        if Instant::now() >= tick_at {
            tick_at += TICK;
            control.tick();
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
                control.packet(from_usb.0.get(..length).unwrap_or_default(), &outbox::USB);
            }
            Either3::Third(Ok(length)) => {
                for &byte in &from_uart[..length] {
                    match frames.push(byte) {
                        Some(Frame::Packet(packet)) => control.packet(packet, &outbox::UART),
                        Some(Frame::Malformed) => control.mcu.malformed_frame(),
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
