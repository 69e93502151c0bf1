//! The unmodified image beside a gripper on its RS-485 bus: rmodbus is the server, and the board's record shows that the
//! driver is enabled for requests alone. `GRIPLINE_IMAGE` names the image.

use gripline_emulator::{Board, Disturbance};
use gripline_firmware::Fault;
use gripline_firmware::storage::{RECORD_WORDS, SLOTS, SettingsFlash, store};
use gripline_gripper::Gripper;
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_protocol::line::{LineKind, LineSettings};
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets, Report, Status};
use gripline_protocol::{Event, Parser};

const NEWTON: i32 = 4_096;
/// A byte at 115,200 baud, and the silence that ends a frame there (Modbus over serial line V1.02, section 2.5.1.1).
const BYTE_NS: u64 = 86_805;
const SILENCE_NS: u64 = 1_750_000;
/// Gaps within a frame that a server may take for its end (same section).
const GAP_NS: u64 = 750_000;
/// The gripper's registers change at 200 Hz.
const SLOT_NS: u64 = 5_000_000;
const STEP_NS: u64 = 250_000;

fn image() -> Vec<u8> {
    let path = std::env::var("GRIPLINE_IMAGE").expect("GRIPLINE_IMAGE names a firmware image");
    std::fs::read(path).expect("the image can be read")
}

fn settings(floor_n: i32) -> Configuration {
    Configuration {
        floor: floor_n * NEWTON,
        fail_safe: floor_n * NEWTON,
        ceiling: 38 * NEWTON,
        relax_rate: 0,
        line: LineSettings {
            kind: LineKind::Robotiq2f140,
            ..LineSettings::DEFAULT
        },
        ..Configuration::CAREFUL
    }
}

/// The two sectors as `Store` leaves them.
fn stored(settings: &Configuration) -> Vec<u8> {
    const SECTOR: usize = 16 * 1024;
    struct Memory(Vec<u8>);
    impl SettingsFlash for Memory {
        type Error = ();
        fn read(&self, slot: usize, word: usize) -> u32 {
            let at = slot * SECTOR + 4 * word;
            u32::from_le_bytes(self.0[at..at + 4].try_into().unwrap())
        }
        fn erase(&mut self, slot: usize) -> Result<(), ()> {
            self.0[slot * SECTOR..][..SECTOR].fill(0xFF);
            Ok(())
        }
        fn program(&mut self, slot: usize, word: usize, value: u32) -> Result<(), ()> {
            self.0[slot * SECTOR + 4 * word..][..4].copy_from_slice(&value.to_le_bytes());
            Ok(())
        }
    }
    const { assert!(RECORD_WORDS * 4 <= SECTOR) };
    let mut memory = Memory(vec![0xFF; SLOTS * SECTOR]);
    store(&mut memory, settings).expect("memory takes it");
    memory.0
}

struct Bench {
    board: Board,
    gripper: Gripper,
    /// How long the gripper ran before the board started.
    gripper_ahead_us: u64,
    cut: bool,
    heard: usize,
    frame: Vec<u8>,
    /// Starts of the requests, and when the gripper spoke.
    requests_ns: Vec<u64>,
    answers_ns: Vec<(u64, u64)>,
    message_id: u8,
    frames: CobsDecoder,
    parser: Parser,
    status: Option<Status>,
    min_grip: i64,
}

impl Bench {
    fn boot(settings: &Configuration) -> Self {
        Self::boot_beside(Gripper::new(), 0, settings)
    }

    /// Beside a gripper that has run for so long.
    fn boot_beside(gripper: Gripper, gripper_ahead_us: u64, settings: &Configuration) -> Self {
        let mut bench = Self {
            board: Board::boot_with_settings(&image(), &stored(settings)).expect("the image boots"),
            gripper,
            gripper_ahead_us,
            cut: false,
            heard: 0,
            frame: Vec::new(),
            requests_ns: Vec::new(),
            answers_ns: Vec::new(),
            message_id: 0,
            frames: CobsDecoder::new(),
            parser: Parser::new(),
            status: None,
            min_grip: 0,
        };
        // It must listen before it is spoken to.
        for _ in 0..100_000_000 / STEP_NS {
            bench.step();
        }
        bench
    }

    fn step(&mut self) {
        self.board.run_for(STEP_NS).expect("the board runs");
        self.bus();
        self.listen();
    }

    fn send(&mut self, message: &Message) {
        self.message_id = self.message_id.wrapping_add(1);
        let mut frame = [0; FRAME_MAX];
        for packet in MessagePackets::new(message, self.message_id).unwrap() {
            let length = encode_packet(&packet, &mut frame);
            self.board.uart_send(&frame[..length]);
        }
    }

    fn command(&mut self, command: Command) {
        self.send(&Message::Command(command));
    }

    /// Time passes; a host that asks for the status ten times a second is never lost.
    fn pass(&mut self, ms: u64) -> Status {
        self.min_grip = self.gripper.grip();
        for step in 0..ms * 1_000_000 / STEP_NS {
            if step % 400 == 0 {
                self.command(Command::ReadStatus);
            }
            self.step();
            self.min_grip = self.min_grip.min(self.gripper.grip());
        }
        self.status.expect("a status came")
    }

    /// The gripper's end of the bus.
    fn bus(&mut self) {
        let now_ns = self.board.now_ns();
        self.gripper.advance(self.gripper_ahead_us + now_ns / 1_000);
        let bytes = self.board.bus_bytes();
        for byte in &bytes[self.heard..] {
            if self.frame.is_empty() {
                self.requests_ns.push(byte.at_ns - BYTE_NS);
            }
            self.frame.push(byte.byte);
        }
        self.heard = bytes.len();
        let Some(last) = bytes.last().filter(|_| !self.frame.is_empty()) else {
            return;
        };
        if now_ns - last.at_ns >= SILENCE_NS {
            let frame = std::mem::take(&mut self.frame);
            if let Some(answer) = self.gripper.answer(&frame).filter(|_| !self.cut) {
                self.board.bus_send(&answer);
                self.answers_ns
                    .push((now_ns, now_ns + answer.len() as u64 * BYTE_NS));
            }
        }
    }

    fn listen(&mut self) {
        for byte in self.board.uart_take() {
            if let Some(Frame::Packet(packet)) = self.frames.push(byte)
                && let Ok(Event::Message(bytes)) = self.parser.push(packet)
                && let Ok(Message::Report(Report::Status(status))) = Message::from_bytes(bytes)
            {
                self.status = Some(status);
            }
        }
    }

    /// Spans of time in which the driver was enabled.
    fn driver_on(&self) -> Vec<(u64, u64)> {
        let mut spans = Vec::new();
        let mut since = None;
        for &(at_ns, on) in self.board.bus_driver() {
            match (since, on) {
                (None, true) => since = Some(at_ns),
                (Some(start_ns), false) => {
                    spans.push((start_ns, at_ns));
                    since = None;
                }
                _ => {}
            }
        }
        spans
    }
}

#[test]
#[ignore = "needs a firmware image"]
fn a_gripper_on_the_bus_is_activated_grips_rises_survives_a_cut_cable_and_opens() {
    let failed = Fault::LineFailed.bit();
    let mut bench = Bench::boot(&settings(20));
    bench.send(&Message::Hello(Hello::of_this_build(0, 7)));
    let status = bench.pass(4_000);
    assert!(bench.gripper.is_activated(), "{status:?}");
    assert_eq!(
        (
            bench.gripper.activations,
            bench.gripper.motions,
            status.faults & failed
        ),
        (1, 0, 0)
    );

    bench.command(Command::Hold);
    let status = bench.pass(1_500);
    assert_eq!((status.line, status.faults & failed), (20 * NEWTON, 0));
    assert!(
        bench.gripper.grip() >= i64::from(20 * NEWTON),
        "{}",
        bench.gripper.grip()
    );

    bench.command(Command::Configure(settings(30)));
    let status = bench.pass(500);
    assert_eq!((status.line, status.faults & failed), (30 * NEWTON, 0));
    let grip = bench.gripper.grip();
    assert!((30 * NEWTON..31 * NEWTON).contains(&(grip as i32)), "{grip}");

    bench.cut = true;
    let status = bench.pass(500);
    assert_eq!((status.faults & failed, bench.min_grip), (failed, grip));
    bench.cut = false;
    let status = bench.pass(500);
    assert_eq!((status.faults & failed, bench.min_grip), (0, grip));

    bench.command(Command::Release);
    bench.pass(3_000);
    assert_eq!(bench.gripper.grip(), 0);
    assert_eq!(bench.gripper.activations, 1);

    // The wire: every byte of ours under an enabled driver, none of the gripper's.
    let on = bench.driver_on();
    let ours = bench.board.bus_bytes();
    assert!(ours.len() > 10_000, "{} bytes", ours.len());
    assert_eq!(
        on.len(),
        bench.requests_ns.len(),
        "the driver is enabled once a request"
    );
    let under = |start_ns: u64, end_ns: u64| on.iter().any(|span| span.0 <= start_ns && end_ns <= span.1);
    for byte in ours {
        assert!(
            under(byte.at_ns - BYTE_NS, byte.at_ns),
            "a byte at {} ns without driver",
            byte.at_ns
        );
    }
    for answer in &bench.answers_ns {
        let clash = on.iter().find(|span| span.0 < answer.1 && answer.0 < span.1);
        assert_eq!(
            clash, None,
            "driver on while the gripper speaks at {} ns",
            answer.0
        );
    }
    for pair in ours.windows(2) {
        let gap_ns = pair[1].at_ns - pair[0].at_ns - BYTE_NS;
        assert!(
            !(GAP_NS..SILENCE_NS).contains(&gap_ns),
            "a frame with a gap of {gap_ns} ns"
        );
    }
    for pair in bench.requests_ns.windows(2) {
        // The task asks for the time before it starts to send, which takes some microseconds more or less.
        assert!(
            pair[1] - pair[0] >= SLOT_NS - 100_000,
            "requests {} ns apart",
            pair[1] - pair[0]
        );
    }
}

/// As shipped, with a gripper on the bus.
fn shipped() -> Configuration {
    Configuration {
        floor: 12 * NEWTON,
        fail_safe: 12 * NEWTON,
        line: LineSettings {
            kind: LineKind::Robotiq2f140,
            ..LineSettings::DEFAULT
        },
        ..Configuration::DEFAULT
    }
}

/// Activated, and holding an object for a second and a half.
fn holding() -> Bench {
    let mut bench = Bench::boot(&shipped());
    bench.send(&Message::Hello(Hello::of_this_build(0, 7)));
    bench.pass(4_000);
    bench.command(Command::Hold);
    let status = bench.pass(1_500);
    let found = status.faults & (Fault::LineFailed.bit() | Fault::ObjectLost.bit());
    assert_eq!((found, bench.gripper.grip() > 0), (0, true));
    bench
}

#[test]
#[ignore = "needs a firmware image"]
fn an_object_that_the_gripper_holds_no_more_is_reported_until_it_is_released() {
    let lost = Fault::ObjectLost.bit();
    let mut bench = holding();
    bench.gripper.lose_object();
    let status = bench.pass(800);
    assert_eq!(status.faults & (lost | Fault::LineFailed.bit()), lost);
    assert_eq!(status.line, 12 * NEWTON, "the line holds");
    bench.command(Command::Release);
    let status = bench.pass(3_000);
    assert_eq!((status.faults & lost, status.line), (0, 0));
    // Closing on nothing from the beginning loses no object.
    bench.command(Command::Hold);
    assert_eq!(bench.pass(2_000).faults & lost, 0);
}

#[test]
#[ignore = "needs a firmware image"]
fn a_release_opens_a_gripper_that_held_before_the_board_had_power() {
    let before = holding();
    let ran_us = before.board.now_ns() / 1_000;
    let mut bench = Bench::boot_beside(before.gripper, ran_us, &shipped());
    bench.send(&Message::Hello(Hello::of_this_build(0, 8)));
    assert_eq!(bench.pass(500).line, 0);
    assert!(bench.gripper.grip() > 0, "nothing opens by itself");
    bench.command(Command::Release);
    bench.pass(2_000);
    assert_eq!((bench.gripper.grip(), bench.gripper.activations), (0, 1));
}

#[test]
#[ignore = "needs a firmware image"]
fn a_request_that_never_goes_out_is_given_up_and_reported_with_the_driver_off() {
    let mut bench = holding();
    let grip = bench.gripper.grip();
    bench.board.disturb(Disturbance::BusClockStops);
    let status = bench.pass(500);
    assert_ne!(status.faults & Fault::LineFailed.bit(), 0, "{status:?}");
    assert_eq!((status.line, bench.min_grip), (12 * NEWTON, grip));
    let on_for_ns = bench.driver_on().iter().map(|span| span.1 - span.0).max();
    assert!(on_for_ns.is_some_and(|ns| ns <= 6_000_000), "{on_for_ns:?} ns");
    assert!(bench.board.bus_driver().last().is_some_and(|(at_ns, _)| {
        // It still tries.
        bench.board.now_ns() - at_ns < 100_000_000
    }));
}

#[test]
#[ignore = "needs a firmware image"]
fn with_the_analog_line_the_bus_stays_silent() {
    let mut board = Board::boot(&image()).expect("the image boots");
    board.run_for(1_000_000_000).expect("the board runs");
    assert_eq!((board.bus_bytes().len(), board.bus_driver().len()), (0, 0));
}
