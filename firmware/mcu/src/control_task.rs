//! The task `control`: the safety tick, messages, packets that did not come by the USB interrupt, settings to flash, the restart in
//! the bootloader.
//!
//! Units: microseconds.

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{Endpoint, EndpointError, EndpointOut};
use gripline_firmware::program::{Learner, MessageReader, MessageWriter};
use gripline_firmware::{Fault, FaultSet, LinkId, storage};
use gripline_protocol::message::{Configuration, LineSettings, Message, Report};
use gripline_protocol::packet::Kind;
use gripline_protocol::{PACKET_MAX, SENSORS};

use crate::control::{self, BoardWatch, Control, from_task};
use crate::flash::SettingsSectors;
use crate::outbox::Outbox;
use crate::readback::ReadBack;
use crate::robot::Robot;
use crate::usb::HostToMcu;
use crate::{bootloader, fault_log, supply, uart, usb_interrupt, watchdog};

/// Time between two safety ticks.
const TICK: Duration = Duration::from_millis(1);

/// A packet where its words are aligned, as the fast ways of CRC and sums want them.
#[repr(align(4))]
struct Aligned([u8; PACKET_MAX]);

/// Fills the outbox. Takes the program for one message at a time.
fn fill(outbox: &'static Outbox, writer: &mut MessageWriter) {
    while !outbox.is_full() {
        let packet = writer.next_packet(|| {
            let mut message = None;
            from_task(|control| control.message(&mut message));
            if let Some(Message::Report(Report::Refused(refusal))) = &message {
                defmt::warn!("command refused: {}", refusal);
            }
            message
        });
        let Some(packet) = packet else { return };
        // There was room, and only this task fills the outbox.
        let _ = outbox.try_send(packet);
    }
}

/// Works on what new maps have to teach, with the path free except for copying; one of each fingertip.
fn study(learner: &mut Learner) {
    for _ in 0..SENSORS {
        let mut lesson = None;
        from_task(|control| control.lesson(&mut lesson));
        let Some(lesson) = &lesson else { return };
        let learnt = learner.work(lesson);
        from_task(|control| control.learn(&learnt));
    }
}

/// Takes a packet over USB. Messages are assembled and read with the path free.
fn received(messages: &mut MessageReader, packet: &[u8]) {
    if Kind::of(packet) == Some(Kind::Message) {
        message_packet(messages, packet, LinkId::Usb);
    } else {
        control::map_packet_from_task(packet);
    }
}

fn message_packet(messages: &mut MessageReader, packet: &[u8], link: LinkId) {
    let event = messages.read(packet);
    from_task(|control| control.message_packet(&event, link));
}

/// Takes the packets of messages over the UART that wait.
fn received_over_uart(messages: &mut MessageReader) {
    if uart::take_broken() {
        messages.drop_message();
    }
    while let Some(packet) = uart::message() {
        message_packet(messages, packet, LinkId::Uart);
        uart::next_message();
    }
}

/// Writes the settings to flash. The processor stalls for up to a second: the gripper holds nothing then, and commands wait.
fn store(flash: &mut SettingsSectors, settings: &Configuration) {
    watchdog::extend_period();
    let written = storage::store(flash, settings);
    watchdog::restore_period();
    defmt::info!("settings stored: {}", written);
    from_task(|control| control.stored(written.ok()));
}

/// What the task watches beside its packets.
pub(crate) struct Watch {
    /// The analog line, if it drives the gripper.
    pub(crate) read_back: Option<ReadBack>,
    /// The wires to the robot.
    pub(crate) robot: Robot,
}

impl Watch {
    /// Looks with the path free, and tells the program what has changed.
    fn look(&mut self, known: &mut Option<BoardWatch>) {
        let mut faults = FaultSet::EMPTY;
        supply::check(&mut faults);
        let is_wrong = self.read_back.as_mut().is_some_and(ReadBack::is_wrong);
        faults.set(Fault::LineMismatch, is_wrong);
        let now = BoardWatch {
            faults,
            is_release_inhibited: self.robot.is_release_inhibited(),
        };
        if *known != Some(now) {
            *known = Some(now);
            from_task(|control| control.note_board(now));
        }
    }
}

/// Runs the safety tick every millisecond and takes packets that did not come by the USB interrupt.
///
/// Deadline: the tick within its millisecond. Budget: half of it. Miss: without ticks the watchdog resets the chip, and the
/// line is restored. The loop checks for the tick after every packet, so a flood of packets cannot delay it.
#[embassy_executor::task]
pub(crate) async fn control(
    line: LineSettings,
    mut flash: SettingsSectors,
    mut watch: Watch,
    mut usb: HostToMcu,
) {
    let mut writer = MessageWriter::default();
    let mut learner = Learner::default();
    let mut logged = FaultSet::EMPTY;
    let mut known = None;
    // Each link has its own: what one brings broken costs the other nothing.
    let mut from_usb_messages = MessageReader::new(line);
    let mut from_uart_messages = MessageReader::new(line);
    let mut tick_at = Instant::now() + TICK;
    let mut from_usb = Aligned([0; PACKET_MAX]);
    loop {
        if Instant::now() >= tick_at {
            tick_at += TICK;
            watch.look(&mut known);
            // In parts, so that a packet waits for one of them only.
            study(&mut learner);
            let now_us = control::now_us();
            from_task(|control| control.age(now_us));
            from_task(Control::teach_grip);
            from_task(Control::watch_object);
            let (started, now_us) = (control::cycles(), control::now_us());
            from_task(|control| control.advance(now_us));
            let (mut faults, mut is_at_fault) = (logged, true);
            let tick = |control: &mut Control| control.tick(now_us, started, &mut faults, &mut is_at_fault);
            let outbox = from_task(tick).flatten();
            watch.robot.tell(is_at_fault);
            if let Some(outbox) = outbox {
                fill(outbox, &mut writer);
            }
            if faults != logged {
                logged = faults;
                fault_log::CHANGED.signal(faults);
            }
            let mut settings = None;
            from_task(|control| control.settings_to_store(&mut settings));
            if let Some(settings) = settings {
                store(&mut flash, &settings);
            }
            if from_task(Control::take_bootloader) == Some(true) {
                defmt::warn!("restarting in the bootloader");
                bootloader::restart();
            }
        }
        // Dropping one of these futures loses nothing: each takes bytes only when it completes.
        match select4(
            next_transfer(&mut usb, &mut from_usb.0),
            Timer::at(tick_at),
            uart::MESSAGE.wait(),
            usb_interrupt::MESSAGE.wait(),
        )
        .await
        {
            Either4::First(Ok(length)) => {
                let packet = from_usb.0.get(..length).unwrap_or_default();
                received(&mut from_usb_messages, packet);
            }
            Either4::Fourth(()) => {
                if let Some(packet) = usb_interrupt::message() {
                    received(&mut from_usb_messages, packet);
                    usb_interrupt::next_packet();
                }
            }
            Either4::Third(()) => received_over_uart(&mut from_uart_messages),
            // The tick runs above. A pulled cable: the program itself notices that maps stop.
            Either4::First(Err(_)) | Either4::Second(()) => {}
        }
    }
}

/// The next transfer from the host; waits while no host has configured the device.
async fn next_transfer(usb: &mut HostToMcu, packet: &mut [u8; PACKET_MAX]) -> Result<usize, EndpointError> {
    usb.wait_enabled().await;
    usb.read(packet).await
}
