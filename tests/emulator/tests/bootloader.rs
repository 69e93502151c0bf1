//! The unmodified image on its way into the chip's own bootloader and back. What lies in the system memory here is a few instructions
//! in its place: they show that the chip comes there, and how it comes back. `GRIPLINE_IMAGE` names the image.

use gripline_emulator::usb::Cable;
use gripline_emulator::{Board, EmulatorError, EventKind};
use gripline_protocol::message::{Bootloader, Command, GripMode, Hello, Message, MessagePackets, Report};
use gripline_protocol::{Event as Parsed, Parser};

const MS: u64 = 1_000_000;
/// The first instruction of the bootloader.
const ENTRY: u32 = 0x1FFF_0008;
/// Longer than the watchdog waits.
const LONG_NS: u64 = 400 * MS;

/// A stack, the entry, and `b .`: a bootloader that waits for its host.
const WAITS: &[u16] = &[0x2000, 0x2000, 0x0009, 0x1FFF, 0xE7FE];
/// The same, and a jump to the image as ST's makes it: `ldr r0, =0x08000000; ldr r1, [r0]; msr msp, r1; ldr r2, [r0, #4]; bx r2`.
const HANDS_OVER: &[u16] = &[
    0x2000, 0x2000, 0x0009, 0x1FFF, 0x4803, 0x6801, 0xF381, 0x8808, 0x6842, 0x4710, 0xBF00, 0xBF00, 0x0000,
    0x0800,
];

fn image() -> Vec<u8> {
    let path = std::env::var_os("GRIPLINE_IMAGE").expect("GRIPLINE_IMAGE names a firmware image");
    std::fs::read(path).expect("the image can be read")
}

struct Bench {
    board: Board,
    parser: Parser,
    heard: usize,
    id: u8,
    messages: Vec<Message>,
}

impl Bench {
    /// Plugged in and configured, with this program for a bootloader.
    fn new(bootloader: &[u16]) -> Self {
        let bytes: Vec<u8> = bootloader.iter().flat_map(|half| half.to_le_bytes()).collect();
        let mut bench = Self {
            board: Board::boot_with_bootloader(&image(), &bytes, &[ENTRY]).unwrap(),
            parser: Parser::new(),
            heard: 0,
            id: 0,
            messages: Vec::new(),
        };
        bench.board.usb_cable(Cable::In);
        bench.configured(1);
        bench
    }

    fn configured(&mut self, times: u64) {
        let is_ready = self
            .board
            .run_until(|board| board.usb_enumerations() >= times, 600 * MS);
        assert!(is_ready.unwrap(), "{:?}", self.board.usb_state());
    }

    fn say(&mut self, message: &Message) {
        self.id += 1;
        for packet in MessagePackets::new(message, self.id).unwrap() {
            self.board.usb_send(&packet);
        }
    }

    fn run(&mut self, ns: u64) -> Result<(), EmulatorError> {
        self.board.run_for(ns)?;
        for packet in &self.board.usb_packets()[self.heard..] {
            if let Ok(Parsed::Message(bytes)) = self.parser.push(&packet.bytes)
                && let Ok(message) = Message::from_bytes(bytes)
            {
                self.messages.push(message);
            }
        }
        self.heard = self.board.usb_packets().len();
        Ok(())
    }

    fn answers(&self) -> Vec<Bootloader> {
        let answers = self.messages.iter().filter_map(|message| match message {
            Message::Bootloader(answer) => Some(*answer),
            _ => None,
        });
        answers.collect()
    }

    fn mode(&self) -> Option<GripMode> {
        self.messages.iter().rev().find_map(|message| match message {
            Message::Report(Report::Status(status)) => Some(status.mode),
            _ => None,
        })
    }

    /// How often the chip came to its bootloader since this was last asked.
    fn arrivals(&mut self) -> usize {
        let trace = self.board.take_trace();
        trace
            .iter()
            .filter(|event| event.kind == EventKind::Arrival(ENTRY))
            .count()
    }
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_released_board_restarts_in_its_bootloader_and_stays_there_without_watchdog_and_line() {
    let mut bench = Bench::new(WAITS);
    bench.say(&Message::Bootloader(Bootloader::Enter));
    bench.run(50 * MS).unwrap();
    assert_eq!(bench.answers(), [Bootloader::Entering], "the answer comes first");
    assert_eq!((bench.board.resets().len(), bench.arrivals()), (0, 0));
    bench.run(LONG_NS).unwrap();
    let resets = bench.board.resets().to_vec();
    assert_eq!(resets.len(), 1, "{resets:?}");
    assert_eq!(resets[0].cause, "software");
    assert!(bench.arrivals() > 0, "it never came to the bootloader");
    assert_eq!(
        (bench.board.dac_code(1), bench.board.fault_output()),
        (None, false)
    );
    println!("restarted {} ms after power-on", resets[0].at_ns / MS);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn while_it_holds_it_refuses_and_a_hold_in_the_last_moment_wins() {
    let mut bench = Bench::new(WAITS);
    bench.say(&Message::Hello(Hello::of_this_build(0, 7)));
    bench.say(&Message::Command(Command::Hold));
    bench.run(50 * MS).unwrap();
    bench.say(&Message::Bootloader(Bootloader::Enter));
    bench.run(LONG_NS).unwrap();
    assert_eq!(bench.answers(), [Bootloader::Holding]);
    assert_eq!((bench.board.resets().len(), bench.arrivals()), (0, 0));
    assert_eq!(bench.mode(), Some(GripMode::Hold));

    let mut bench = Bench::new(WAITS);
    bench.say(&Message::Hello(Hello::of_this_build(0, 7)));
    bench.say(&Message::Bootloader(Bootloader::Enter));
    bench.say(&Message::Command(Command::Hold));
    bench.run(LONG_NS).unwrap();
    // The first answer may be replaced by the second before it is out.
    assert_eq!(bench.answers().last(), Some(&Bootloader::Holding));
    assert_eq!((bench.board.resets().len(), bench.arrivals()), (0, 0));
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_bootloader_that_hands_over_starts_the_image_as_a_reset_leaves_the_chip() {
    let mut bench = Bench::new(HANDS_OVER);
    bench.say(&Message::Bootloader(Bootloader::Enter));
    bench.configured(2);
    let causes: Vec<&str> = bench.board.resets().iter().map(|reset| reset.cause).collect();
    assert_eq!(
        causes,
        ["software", "software"],
        "once there, once after the way back"
    );
    assert_eq!(bench.arrivals(), 1);
    bench.messages.clear();
    bench.say(&Message::Hello(Hello::of_this_build(0, 8)));
    bench.run(50 * MS).unwrap();
    let is_hello = |message: &Message| matches!(message, Message::Hello(_));
    assert!(bench.messages.iter().any(is_hello), "{:?}", bench.messages);
    // No fault is reported: nothing crashed.
    let latched = bench.messages.iter().rev().find_map(|message| match message {
        Message::Report(Report::Status(status)) => Some(status.latched),
        _ => None,
    });
    assert_eq!(latched.unwrap_or_default(), 0);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_chip_without_a_bootloader_starts_its_image_again() {
    for nothing in [
        &[0x0000_u16; 8][..],
        &[0xFFFF; 8],
        &[0x2000, 0x2000, 0x0009, 0x0800],
    ] {
        let mut bench = Bench::new(nothing);
        bench.say(&Message::Bootloader(Bootloader::Enter));
        bench.configured(2);
        assert_eq!(bench.board.resets().len(), 1);
        assert_eq!(bench.arrivals(), 0);
    }
}
