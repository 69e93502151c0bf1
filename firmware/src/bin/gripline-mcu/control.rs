//! The map-to-line path: every packet as it lands, the grip-force line at once, and the safety tick between.
//!
//! One task owns the program, the line and both transports' incoming halves, so that nothing is shared and nothing is
//! locked. Units: microseconds, cycles of 168 MHz.

use cortex_m::peripheral::DWT;
use embassy_futures::select::{Either3, select3};
use embassy_stm32::usart::BufferedUartRx;
use embassy_time::{Duration, Instant, Ticker};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointOut};
use embedded_io_async::Read;
use gripline_firmware::line::GripLine;
use gripline_firmware::{Action, Mcu};
use gripline_protocol::PACKET_MAX;
use gripline_protocol::cobs::{CobsDecoder, Frame};
use gripline_protocol::message::Stage;

use crate::line::AnalogLine;
use crate::outbox::{self, Outbox, Packet};
use crate::usb::HostToMcu;
use crate::watchdog;

/// The safety tick, microseconds.
const TICK_US: u64 = 1_000;

/// Starts the counter that the stage times are read from.
pub(crate) fn start_cycle_counter() {
    // SAFETY: start-up, before any task; nothing else in this program uses the core's trace peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
}

/// The program, the line it drives, and the host it answers.
struct Control {
    mcu: &'static mut Mcu,
    line: AnalogLine,
    /// The transport that spoke last; none until a host spoke.
    answers: Option<&'static Outbox>,
}

impl Control {
    /// One packet, to the line and to the answer.
    fn packet(&mut self, packet: &[u8], answers: &'static Outbox) {
        self.answers = Some(answers);
        let started = DWT::cycle_count();
        let action = self.mcu.packet(packet, now_us());
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
        let started = DWT::cycle_count();
        let action = self.mcu.tick(now_us());
        self.act(action, Stage::Tick, started);
        watchdog::tick_made();
    }

    /// The line first, then the times it took, then words to the host.
    fn act(&mut self, action: Action, stage: Stage, started: u32) {
        let decided = DWT::cycle_count();
        let Ok(()) = self.line.write(action.line);
        let written = DWT::cycle_count();
        self.mcu.note_cycles(stage, decided.wrapping_sub(started));
        self.mcu.note_cycles(Stage::Line, written.wrapping_sub(decided));
        let Some(answers) = self.answers.filter(|_| action.transmit) else {
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
/// its line restored. The tick is asked first, so that no flood of packets can hold it up.
#[embassy_executor::task]
pub(crate) async fn control(
    mcu: &'static mut Mcu,
    line: AnalogLine,
    mut uart: BufferedUartRx<'static>,
    mut usb: HostToMcu,
) {
    let mut control = Control {
        mcu,
        line,
        answers: None,
    };
    let mut frames = CobsDecoder::new();
    let mut tick = Ticker::every(Duration::from_micros(TICK_US));
    let mut from_uart = [0; PACKET_MAX];
    let mut from_usb = [0; PACKET_MAX];
    loop {
        // Every part may be dropped half-way: none takes a byte before it is done.
        match select3(
            tick.next(),
            next_transfer(&mut usb, &mut from_usb),
            uart.read(&mut from_uart),
        )
        .await
        {
            Either3::First(()) => control.tick(),
            Either3::Second(Ok(length)) => control.packet(&from_usb[..length], &outbox::USB),
            Either3::Third(Ok(length)) => {
                for &byte in &from_uart[..length] {
                    match frames.push(byte) {
                        Some(Frame::Packet(packet)) => control.packet(packet, &outbox::UART),
                        Some(Frame::Malformed) => control.mcu.malformed_frame(),
                        None => {}
                    }
                }
            }
            // The cable went, or noise hit a byte: the program notices by itself that maps stopped or do not decode.
            Either3::Second(Err(_)) | Either3::Third(Err(_)) => {}
        }
    }
}

/// The next transfer from the host; waits while no host has configured the device.
async fn next_transfer(usb: &mut HostToMcu, packet: &mut [u8; PACKET_MAX]) -> Result<usize, EndpointError> {
    usb.wait_enabled().await;
    usb.read(packet).await
}
