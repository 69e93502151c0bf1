//! The unmodified firmware image behind the modelled USB port: enumeration against the standards, control transfers
//! good and bad, bulk packets both ways, cables and sleep. `GRIPLINE_IMAGE` names the image; `cargo xtask test` sets it.

use std::fmt::Write as _;

use gripline_emulator::Board;
use gripline_emulator::usb::{Cable, ControlOutcome, ControlTransfer, Setup, UsbPacket, UsbState};

const MS: u64 = 1_000_000;
/// A host debounces 100 ms and resets twice for 60 ms; the device needs a fraction of the rest.
const ENUMERATION_NS: u64 = 300 * MS;
/// The firmware's bulk endpoints.
const OUT: u8 = 0x01;
const IN: u8 = 0x81;

const GET_STATUS: Setup = [0x80, 0, 0, 0, 0, 0, 2, 0];
const GET_CONFIGURATION: Setup = [0x80, 8, 0, 0, 0, 0, 1, 0];
const SET_CONFIGURATION: Setup = [0x00, 9, 1, 0, 0, 0, 0, 0];
/// The Microsoft set: the longest answer, three packets.
const LONG_ANSWER: Setup = [0xC0, 0x47, 0, 0, 7, 0, 162, 0];

fn image() -> Vec<u8> {
    let path = std::env::var_os("GRIPLINE_IMAGE").expect("GRIPLINE_IMAGE names an image for the STM32F427");
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn plugged() -> Board {
    let mut board = Board::boot(&image()).unwrap();
    board.usb_cable(Cable::In);
    configure(&mut board);
    board
}

/// Waits until the device is ready.
fn configure(board: &mut Board) {
    let before = board.usb_enumerations();
    let is_ready = board.run_until(|board| board.usb_enumerations() > before, ENUMERATION_NS);
    assert!(
        is_ready.unwrap(),
        "{:?}: {:?}",
        board.usb_state(),
        board.usb_transfers()
    );
    assert_eq!(board.usb_state(), UsbState::Configured);
}

/// Makes a control transfer and waits for its end.
fn ask(board: &mut Board, setup: Setup, data: &[u8]) -> ControlTransfer {
    let before = board.usb_transfers().len();
    board.usb_control(setup, data);
    let is_over = board.run_until(|board| board.usb_transfers().len() > before, 1_000 * MS);
    assert!(is_over.unwrap());
    board.usb_transfers()[before].clone()
}

fn halt(endpoint: u8, is_set: bool) -> Setup {
    [0x02, if is_set { 3 } else { 1 }, 0, 0, endpoint, 0, 0, 0]
}

/// Sends so many packets that are no packets of Gripline and waits until they are gone.
fn send(board: &mut Board, count: u8) {
    for number in 0..count {
        board.usb_send(&[number; 64]);
    }
    assert!(
        board
            .run_until(|board| board.usb_waiting() == 0, 100 * MS)
            .unwrap()
    );
}

/// Waits for a status, which the firmware sends every 100 ms to whoever spoke to it.
fn hear(board: &mut Board) -> UsbPacket {
    let before = board.usb_packets().len();
    let is_heard = board.run_until(|board| board.usb_packets().len() > before, 300 * MS);
    assert!(
        is_heard.unwrap(),
        "the device sends nothing any more: {:?}",
        board.usb_counters()
    );
    board.usb_packets()[before].clone()
}

/// What the firmware did that the USB core cannot stand. Looking at an endpoint before the clock is on is harmless, and
/// embassy's driver does so.
fn complaints(board: &Board) -> Vec<&String> {
    let is_complaint =
        |gap: &&String| gap.contains("OTG_FS") && !gap.starts_with("refused: OTG_FS.window is gated");
    board.gaps().iter().filter(is_complaint).collect()
}

/// A transfer as the golden file has it: what was asked, how it ended, what was answered.
fn line_of(transfer: &ControlTransfer) -> String {
    let hex = |bytes: &[u8]| {
        bytes.iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    };
    format!(
        "{} {:?} {}\n",
        hex(&transfer.setup),
        transfer.outcome,
        hex(&transfer.data)
    )
}

/// Holds a text against a file beside this one. The file was written when every descriptor had been held against USB 2.0 chapter 9,
/// the BOS descriptor's ECN and Microsoft's OS 2.0 descriptors; `GRIPLINE_BLESS=1` writes it anew, and whoever does so holds the
/// change against these standards.
fn assert_golden(name: &str, found: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests")
        .join(name);
    if std::env::var_os("GRIPLINE_BLESS").is_some() {
        std::fs::write(&path, found).unwrap();
    }
    assert_eq!(
        found,
        std::fs::read_to_string(&path).unwrap(),
        "{}",
        path.display()
    );
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_device_enumerates_and_says_of_itself_what_it_always_said() {
    let board = plugged();
    let transfers = board.usb_transfers();
    assert_golden(
        "descriptors.txt",
        &transfers.iter().map(line_of).collect::<String>(),
    );
    let answer = |kind: u8, index: u8| {
        let found = transfers
            .iter()
            .rfind(|transfer| transfer.setup[..4] == [0x80, 6, index, kind]);
        &found.expect("it was asked").data
    };
    let text = |index| {
        let units: Vec<u16> = answer(3, index)[2..]
            .chunks(2)
            .map(|unit| u16::from_le_bytes([unit[0], unit[1]]))
            .collect();
        String::from_utf16(&units).unwrap()
    };
    assert_eq!((text(1), text(2)), ("Gripline".into(), "Gripline MCU".into()));
    assert_eq!(text(3).len(), 24, "96 bits of the chip's own number");
    assert_eq!(
        answer(1, 0)[8..12],
        [0x09, 0x12, 0x01, 0x00],
        "vendor and product"
    );
    let configuration = answer(2, 0);
    assert_eq!(configuration[9..18], [9, 4, 0, 0, 2, 0xFF, 0, 0, 0]);
    assert_eq!((configuration[20], configuration[27]), (OUT, IN));
    assert_eq!(board.usb_counters().resets, 2);
    assert_eq!((complaints(&board), board.resets()), (vec![], &[][..]));
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn requests_are_answered_or_refused_as_the_standard_says() {
    let mut board = plugged();
    let cases: [(Setup, &[u8], ControlOutcome, &[u8]); 12] = [
        // Powers itself, does not wake the host.
        (GET_STATUS, &[], ControlOutcome::Done, &[1, 0]),
        (GET_CONFIGURATION, &[], ControlOutcome::Done, &[1]),
        ([0x81, 0, 0, 0, 0, 0, 2, 0], &[], ControlOutcome::Done, &[0, 0]),
        ([0x81, 10, 0, 0, 0, 0, 1, 0], &[], ControlOutcome::Done, &[0]),
        ([0x82, 0, 0, 0, IN, 0, 2, 0], &[], ControlOutcome::Done, &[0, 0]),
        // Nothing is asked for, so only the status stage is left.
        ([0x80, 0, 0, 0, 0, 0, 0, 0], &[], ControlOutcome::Done, &[]),
        // Endpoints that the device, and those that the chip does not have.
        ([0x82, 0, 0, 0, 0x82, 0, 2, 0], &[], ControlOutcome::Stalled, &[]),
        ([0x82, 0, 0, 0, 0x8F, 0, 2, 0], &[], ControlOutcome::Stalled, &[]),
        (halt(0x0F, true), &[], ControlOutcome::Stalled, &[]),
        // A descriptor and requests of nobody, with little and with much data to come.
        ([0x80, 6, 0, 0x22, 0, 0, 64, 0], &[], ControlOutcome::Stalled, &[]),
        (
            [0x40, 0x99, 0, 0, 0, 0, 8, 0],
            &[7; 8],
            ControlOutcome::Stalled,
            &[7; 8],
        ),
        (
            [0x40, 0x99, 0, 0, 0, 0, 200, 0],
            &[7; 200],
            ControlOutcome::Stalled,
            &[7; 200],
        ),
    ];
    for (setup, data, outcome, answer) in cases {
        let transfer = ask(&mut board, setup, data);
        assert_eq!(
            (transfer.outcome, transfer.data.as_slice()),
            (outcome, answer),
            "{setup:02x?}"
        );
        let after = ask(&mut board, GET_CONFIGURATION, &[]);
        assert_eq!(after.outcome, ControlOutcome::Done, "after {setup:02x?}");
    }
    assert_eq!((complaints(&board), board.resets()), (vec![], &[][..]));
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn a_control_transfer_may_be_broken_off_anywhere() {
    let mut board = plugged();
    for packets in 1..=5 {
        board.usb_control_abandoned(LONG_ANSWER, packets);
        let broken_off = ask(&mut board, GET_STATUS, &[]);
        assert_eq!(broken_off.outcome, ControlOutcome::Abandoned);
        let before = board.usb_transfers().len();
        assert!(
            board
                .run_until(|board| board.usb_transfers().len() > before, 1_000 * MS)
                .unwrap()
        );
        let status = &board.usb_transfers()[before];
        assert_eq!(
            (status.outcome, status.data.as_slice()),
            (ControlOutcome::Done, &[1, 0][..])
        );
        let again = ask(&mut board, LONG_ANSWER, &[]);
        assert_eq!((again.outcome, again.data.len()), (ControlOutcome::Done, 162));
    }
    // The same with the cable: what was asked last must not be in the way of the next host.
    for packets in 1..=5 {
        board.usb_control_abandoned(LONG_ANSWER, packets);
        board.run_for(2 * MS).unwrap();
        board.usb_cable(Cable::Out);
        board.run_for(50 * MS).unwrap();
        board.usb_cable(Cable::In);
        configure(&mut board);
    }
    assert_eq!((complaints(&board), board.resets()), (vec![], &[][..]));
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn halts_and_new_configurations_start_both_ends_at_the_same_toggle() {
    let mut board = plugged();
    let mut sent = 0;
    // An odd number of packets leaves the next toggle at DATA1.
    for again in [
        &[halt(OUT, true), halt(OUT, false)][..],
        &[halt(IN, true), halt(IN, false)],
        &[SET_CONFIGURATION],
        &[[0x01, 11, 0, 0, 0, 0, 0, 0]],
    ] {
        send(&mut board, 3);
        sent += 3;
        hear(&mut board);
        for &setup in again {
            assert_eq!(ask(&mut board, setup, &[]).outcome, ControlOutcome::Done);
        }
        send(&mut board, 2);
        sent += 2;
        hear(&mut board);
        assert_eq!(board.usb_deliveries_ns().len(), sent, "after {again:02x?}");
        assert_eq!(board.usb_counters().in_repeats, 0, "after {again:02x?}");
    }
    // While it is halted the host hears so.
    ask(&mut board, halt(OUT, true), &[]);
    board.usb_send(&[0; 64]);
    board.run_for(MS).unwrap();
    assert_eq!(board.usb_counters().stalls, 1);
    assert_eq!(ask(&mut board, [0x82, 0, 0, 0, OUT, 0, 2, 0], &[]).data, [1, 0]);
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn a_host_that_leaves_without_reading_is_followed_by_one_that_is_heard() {
    let mut board = plugged();
    for _ in 0..4 {
        send(&mut board, 3);
        hear(&mut board);
        // A status lies in the FIFO when the cable goes.
        board.usb_listen(false);
        board.run_for(250 * MS).unwrap();
        board.usb_cable(Cable::Out);
        board.run_for(20 * MS).unwrap();
        assert_eq!(board.usb_state(), UsbState::Detached);
        board.usb_listen(true);
        board.usb_cable(Cable::In);
        configure(&mut board);
        send(&mut board, 2);
        hear(&mut board);
    }
    assert_eq!(board.usb_deliveries_ns().len(), 4 * 5);
    assert_eq!(board.usb_counters().in_repeats, 0);
    assert_eq!((complaints(&board), board.resets()), (vec![], &[][..]));
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn a_bus_that_sleeps_for_any_time_goes_on_where_it_was() {
    let mut board = plugged();
    let mut sent = 0;
    // Shorter than the 3 ms after which a device notices, and longer.
    for sleep_ms in [1, 2, 3, 4, 50] {
        send(&mut board, 3);
        sent += 3;
        board.usb_cable(Cable::Asleep);
        board.run_for((1 + sleep_ms) * MS).unwrap();
        assert_eq!(board.usb_state(), UsbState::Suspended);
        board.usb_cable(Cable::In);
        board.run_for(40 * MS).unwrap();
        send(&mut board, 2);
        sent += 2;
        hear(&mut board);
        assert_eq!(board.usb_deliveries_ns().len(), sent, "after {sleep_ms} ms");
        assert_eq!(ask(&mut board, GET_CONFIGURATION, &[]).data, [1]);
    }
    // A sleeping host that is unplugged, and another one.
    board.usb_cable(Cable::Asleep);
    board.run_for(20 * MS).unwrap();
    board.usb_cable(Cable::Out);
    board.run_for(20 * MS).unwrap();
    board.usb_cable(Cable::In);
    configure(&mut board);
    assert_eq!((complaints(&board), board.resets()), (vec![], &[][..]));
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_bus_carries_19_full_packets_a_frame_and_never_more() {
    let mut board = plugged();
    for number in 0..1_000_u32 {
        board.usb_send(&[number as u8; 64]);
    }
    assert!(
        board
            .run_until(|board| board.usb_waiting() == 0, 100 * MS)
            .unwrap()
    );
    let times = board.usb_deliveries_ns();
    assert_eq!(times.len(), 1_000);
    for pair in times.windows(20) {
        // 19 lie between the first and the last of 20: a frame's worth, less the gaps at its ends.
        assert!(pair[19] - pair[0] >= 975_000, "{pair:?}");
    }
    let taken_ms = (times[999] - times[0]) as f64 / 1e6;
    assert!(
        taken_ms < 1_000.0 / 18.5,
        "{taken_ms} ms: the firmware puts the host off too often"
    );
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn a_host_that_does_not_read_is_still_listened_to() {
    let mut board = plugged();
    board.usb_listen(false);
    send(&mut board, 3);
    board.run_for(1_000 * MS).unwrap();
    send(&mut board, 200);
    assert_eq!(
        (board.usb_packets(), board.usb_deliveries_ns().len()),
        (&[][..], 203)
    );
    board.usb_listen(true);
    hear(&mut board);
}

/// What a talk with cables, sleep, packets and requests leads to.
#[derive(Debug, PartialEq)]
struct Outcome {
    packets: Vec<UsbPacket>,
    transfers: Vec<ControlTransfer>,
    deliveries_ns: Vec<u64>,
    instructions: u64,
}

fn talk(elf: &[u8], step_ns: u64) -> Outcome {
    let mut board = Board::boot(elf).unwrap();
    let run = |board: &mut Board, ms: u64| {
        for _ in 0..ms * MS / step_ns {
            board.run_for(step_ns).unwrap();
        }
    };
    run(&mut board, 7);
    board.usb_cable(Cable::In);
    run(&mut board, 250);
    for number in 0..40 {
        board.usb_send(&[number; 64]);
        board.usb_control(GET_STATUS, &[]);
    }
    run(&mut board, 2);
    board.usb_cable(Cable::Asleep);
    run(&mut board, 20);
    board.usb_cable(Cable::In);
    run(&mut board, 180);
    board.usb_cable(Cable::Out);
    run(&mut board, 20);
    Outcome {
        packets: board.usb_packets().to_vec(),
        transfers: board.usb_transfers().to_vec(),
        deliveries_ns: board.usb_deliveries_ns().to_vec(),
        instructions: board.instructions(),
    }
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_same_talk_over_usb_gives_the_same_record_however_the_time_is_cut() {
    let elf = image();
    let once = talk(&elf, MS);
    assert!(once.deliveries_ns.len() == 40 && !once.packets.is_empty() && once.transfers.len() > 50);
    assert_eq!(once, talk(&elf, MS), "a second run");
    assert_eq!(once, talk(&elf, 125_000), "eight times as many steps");
}
