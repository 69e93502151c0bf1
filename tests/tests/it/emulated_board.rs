//! The unmodified firmware image on the emulated board, spoken to over its modelled USB, here and there its UART, by
//! the very session that `gripline run` uses. `cargo xtask test` builds emulator and image and runs these with
//! `--include-ignored`; they fail when either is missing. Rates and times are emulated ones.

use std::path::Path;

use crate::board::{Board, FRAME_US, Mixture, SETTINGS, feed_forward, map};
use gripline_firmware::Fault;
use gripline_firmware::GripForce;
use gripline_firmware::constants::DECIDE_BUDGET_CYCLES;
use gripline_firmware::line::DAC_LIVE_ZERO;
use gripline_firmware::sums::{TaxelRule, sums_of};
use gripline_link::emulator::{Cable, ControlOutcome, Disturbance, LineWrite};
use gripline_link::session::Session;
use gripline_link::{EmulatorLink, Link, Transport};
use gripline_protocol::message::{Command, GripMode, SlipState};
use gripline_protocol::{ForceMap, MapInfo, TaxelForce, encode_map};

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_line_is_at_its_live_zero_until_something_is_held() {
    let mut board = Board::boot();
    let status = board.wait(200_000);
    assert_eq!(
        (status.mode, status.faults, status.latched),
        (GripMode::Released, 0, 0)
    );
    board.assert_line(&status, 0, "released");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_handshake_tells_version_commit_and_board() {
    let board = Board::boot();
    let firmware = board.session.firmware().expect("the handshake was made");
    let is_repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.git").exists();
    assert_eq!(firmware.revision.is_some(), is_repository, "{firmware}");
    let (version, name) = (env!("CARGO_PKG_VERSION"), firmware.to_string());
    assert!(
        name.starts_with(version) && name.ends_with("on stm32f427vi"),
        "{name}"
    );
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn an_empty_map_leads_to_the_floor_force() {
    let mut board = Board::holding();
    let status = board.maps(&ForceMap::EMPTY, 20);
    assert_eq!((status.state, status.sums.contact), (SlipState::NoContact, 0));
    board.assert_sums(&status, &ForceMap::EMPTY, "empty map");
    board.assert_line(&status, SETTINGS.floor, "empty map");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_sticking_map_leads_to_the_force_that_its_shear_needs() {
    let mut board = Board::holding();
    let sticking = map(0);
    let status = board.maps(&sticking, 40);
    assert_eq!(
        (status.state, status.sums.contact, status.sums.stick),
        (SlipState::Stick, 60, 60)
    );
    board.assert_sums(&status, &sticking, "sticking map");
    assert!(
        feed_forward(&sticking) > SETTINGS.floor,
        "the test would not tell it from the floor"
    );
    board.assert_line(&status, feed_forward(&sticking), "sticking map");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_slipping_map_raises_the_line_up_to_the_ceiling() {
    let mut board = Board::holding();
    let before = board.maps(&map(0), 40);
    let slipping = map(40);
    let soon = board.maps(&slipping, 1);
    assert_eq!((soon.state, soon.sums.stick), (SlipState::Slip, 20));
    board.assert_sums(&soon, &slipping, "slipping map");
    assert!(soon.line >= before.line);
    let later = board.maps(&slipping, 6);
    assert!(
        later.line > before.line + 4096,
        "100 ms of slip raise the grip by more than a newton"
    );
    // The line went on rising after that status was written.
    let reported = DAC_LIVE_ZERO.code(GripForce::from_lsb(later.line)).0;
    assert!(
        board.session.line_code() >= Some(reported),
        "the DAC is behind the status"
    );
    let end = board.maps(&slipping, 120);
    board.assert_line(&end, SETTINGS.ceiling, "slipping map, long");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_corrupted_map_changes_nothing_and_the_next_one_is_accepted() {
    let mut board = Board::holding();
    let before = board.maps(&map(0), 40);
    // A slipping map with one wrong bit, sent as it is: it must not raise the line.
    let info = MapInfo {
        sequence: board.sequence + 1,
        ..MapInfo::default()
    };
    let mut packets = Vec::new();
    encode_map(&info, &map(60), |packet| packets.push(packet.to_vec()));
    packets[2][30] ^= 1;
    for packet in &packets {
        board.session.send_raw(packet).unwrap();
    }
    let after = board.wait(2 * FRAME_US);
    assert_eq!(
        (after.sums, after.state, after.sequence, after.maps),
        (before.sums, before.state, before.sequence, before.maps)
    );
    let last = board.maps(&map(0), 1);
    assert!(last.maps_refused > before.maps_refused, "the bad map was counted");
    assert_eq!(last.maps, before.maps + 1);
    board.assert_line(&last, before.line, "after the corrupted map");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn every_answer_equals_that_of_the_in_process_controller() {
    let mut board = Board::holding();
    for slipping in [0, 10, 25, 31, 60, 5] {
        let map = map(slipping);
        let status = board.maps(&map, 1);
        board.assert_sums(&status, &map, "sequence of maps");
    }
    assert_eq!(
        (
            board.session.shadow().mismatches(),
            board.session.counters().refused
        ),
        (0, 0)
    );
    assert!(board.session.shadow().checked() >= 6);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn two_runs_of_the_emulated_board_are_the_same_to_the_nanosecond() {
    let script = || {
        let mut board = Board::holding();
        let mut seen = Vec::new();
        for slipping in [0, 30, 60] {
            seen.push(board.maps(&map(slipping), 5));
        }
        let writes: Vec<LineWrite> = board.link().line_writes().to_vec();
        (seen, writes)
    };
    let (once, again) = (script(), script());
    assert!(once.1.len() > 50, "{} writes to the line", once.1.len());
    assert_eq!(once, again);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn noise_on_the_line_before_a_map_does_not_cost_the_map() {
    let mut link = EmulatorLink::spawn(Transport::Uart).unwrap();
    let mut packets = 0;
    link.run_until(100_000, &mut |_| packets += 1).unwrap();
    // A frame's worth of rubbish, ended by the zero that every frame ends with.
    link.send(&[0xA5; 64]).unwrap();
    let mut session = Session::open(Box::new(link), SETTINGS).unwrap();
    session
        .send_map(
            &MapInfo {
                sequence: 1,
                ..MapInfo::default()
            },
            &map(3),
        )
        .unwrap();
    session.run_until(session.now_us() + 100_000).unwrap();
    assert_eq!(
        session.status().unwrap().sums,
        sums_of(&map(3), TaxelRule::of(&SETTINGS))
    );
}

/// The receiver holds one byte. The way of a map's last byte to the line takes longer than a byte anyway, and here also longer than two.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn maps_without_a_gap_over_the_uart_lose_no_byte_where_the_way_to_the_line_is_long() {
    const MAPS: u32 = 100;
    /// Twice in a map's last byte, once in a tick; a byte takes 10.8 µs.
    const SLOW_NS: u32 = 4_250;
    let (mut board, _) = Board::holding_as_shipped_over(Transport::Uart);
    board.link_mut().disturb(Disturbance::SlowDac(SLOW_NS));
    let before = board.status();
    for number in 0..MAPS {
        board.send(&map(30 + number as usize % 30));
    }
    board.wait(u64::from(MAPS) * 8_000);
    let after = board.status();
    assert_eq!(after.packets_refused, before.packets_refused);
    assert_eq!(after.maps - before.maps, MAPS);
}

/// First evidence for the bound of 25 µs (4,200 cycles at 168 MHz); the emulator counts an instruction as a cycle.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_dense_map_is_decided_within_the_budget() {
    let mut board = Board::holding();
    let dense = ForceMap {
        taxels: [TaxelForce {
            x: 90,
            y: -40,
            z: 700,
        }; 400],
    };
    for _ in 0..5 {
        board.sequence += 1;
        let info = MapInfo {
            sequence: board.sequence,
            ..MapInfo::default()
        };
        board.session.send_map(&info, &dense).unwrap();
        // 2,632 bytes take 29 ms at 921,600 baud.
        board.wait(40_000);
    }
    let status = *board.session.status().unwrap();
    board.assert_sums(&status, &dense, "dense map");
    let [packet, decide, line, tick] = status.worst_cycles;
    println!("instructions at worst: packet {packet}, decide {decide}, line {line}, tick {tick}");
    assert!(decide + line <= DECIDE_BUDGET_CYCLES, "{decide} + {line}");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_thousand_mixed_maps_over_usb_come_back_with_the_hosts_own_sums_and_stick_ratios() {
    let mut board = Board::holding();
    let mut mixture = Mixture::new();
    let mut contacts = [usize::MAX, 0];
    for number in 0..1_000 {
        let map = mixture.next(number);
        let status = board.answer(&map);
        board.assert_sums(&status, &map, "mixed maps");
        let count = usize::from(status.sums.contact);
        contacts = [contacts[0].min(count), contacts[1].max(count)];
    }
    assert_eq!(contacts, [0, 400]);
    let status = board.wait(200_000);
    assert_eq!(
        (status.maps, status.maps_refused, status.packets_refused),
        (1_000, 0, 0)
    );
    assert_eq!(board.session.shadow().mismatches(), 0);
    assert_eq!(board.link().resets(), 0);
}

/// Over the first half turn of the timer behind it, with an answer in every step, and after settings were stored.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_firmwares_clock_keeps_to_the_boards() {
    let mut board = Board::boot();
    // The half turn comes after 8.4 s.
    board.wait(8_000_000);
    let mut offsets_us = Vec::new();
    for step in 0..600 {
        if step == 500 {
            board.session.store().unwrap();
        }
        let uptime_us = u64::from(board.answer(&map(step % 60)).uptime_ms) * 1_000;
        offsets_us.push((board.link().powered_ns() / 1_000).cast_signed() - uptime_us.cast_signed());
    }
    let (min, max) = (offsets_us.iter().min().unwrap(), offsets_us.iter().max().unwrap());
    println!("behind the board's power by {min} to {max} us");
    // The crystal starts first; then whole milliseconds are reported, in steps of one.
    assert!((0..3_000).contains(min) && max - min <= 3_000, "{min} to {max}");
    assert!(board.session.status().unwrap().uptime_ms > 8_500);
}

/// DESIGN.md: at least 450 dense maps a second over full-speed USB.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn dense_maps_are_taken_at_450_a_second_or_more() {
    let mut board = Board::holding();
    let mut mixture = Mixture::new();
    let maps: Vec<ForceMap> = (0..300).map(|_| mixture.map(400)).collect();
    let rate = board.rate(&maps);
    println!("dense maps a second: {rate:.0}");
    assert!(rate >= 450.0, "{rate}");
}

/// DESIGN.md: at least 1,000 maps a second at up to 150 contacts.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn maps_of_150_contacts_are_taken_at_1000_a_second_or_more() {
    let mut board = Board::holding();
    let mut mixture = Mixture::new();
    let maps: Vec<ForceMap> = (0..500).map(|_| mixture.map(150)).collect();
    let rate = board.rate(&maps);
    println!("maps of 150 contacts a second: {rate:.0}");
    assert!(rate >= 1_000.0, "{rate}");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_cable_pulled_in_mid_map_tightens_the_grip_and_a_replugged_one_serves_again() {
    let mut board = Board::holding();
    let held = board.maps(&map(0), 40);
    assert!(
        held.line < SETTINGS.fail_safe,
        "the test would not see it tighten"
    );
    // A dense map takes 2.2 ms on the bus; the cable goes after one.
    board.send(&Mixture::new().map(400));
    board.session.run_until(board.session.now_us() + 1_000).unwrap();
    assert!(board.link().waiting() > 0, "the map is under way");
    board.link_mut().set_cable(Cable::Out);
    let writes = board.link().line_writes().len();
    board.session.run_until(board.session.now_us() + 300_000).unwrap();
    assert_eq!(
        board.session.line_code(),
        Some(DAC_LIVE_ZERO.code(GripForce::from_lsb(held.line)).0),
        "STALE MAPS: the line holds"
    );
    board.session.run_until(board.session.now_us() + 700_000).unwrap();
    assert_eq!(
        board.session.line_code(),
        Some(DAC_LIVE_ZERO.code(GripForce::from_lsb(SETTINGS.fail_safe)).0),
        "LINK LOST: the line rises to the fail-safe force"
    );
    let codes: Vec<u16> = board.link().line_writes()[writes..]
        .iter()
        .map(|write| write.code)
        .collect();
    assert!(codes.is_sorted(), "the line fell on its way: {codes:?}");

    let enumerations = board.link().enumerations();
    board.link_mut().set_cable(Cable::In);
    board.wait_for(1_000, "the second enumeration", |board| {
        board.link().enumerations() > enumerations && board.link().is_configured()
    });
    let sticking = map(0);
    let back = board.maps(&sticking, 10);
    board.assert_sums(&back, &sticking, "after the plug");
    assert_eq!(back.faults & (Fault::LinkLost.bit() | Fault::StaleMaps.bit()), 0);
    assert_ne!(back.latched & Fault::LinkLost.bit(), 0, "a person must know");
    assert_eq!(
        back.line, SETTINGS.fail_safe,
        "and acknowledge before the line may fall"
    );
    assert_eq!(
        back.maps,
        held.maps + 10,
        "the map in two halves was not accepted"
    );
    assert_eq!(board.link().resets(), 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_bus_that_is_suspended_and_resumed_goes_on_without_a_new_enumeration() {
    let mut board = Board::holding();
    board.maps(&map(0), 20);
    board.link_mut().set_cable(Cable::Asleep);
    board.wait(300_000);
    assert!(!board.link().is_configured());
    board.link_mut().set_cable(Cable::In);
    board.wait_for(100, "the resume", |board| board.link().is_configured());
    let slipping = map(40);
    let status = board.maps(&slipping, 3);
    board.assert_sums(&status, &slipping, "after the resume");
    assert_eq!(board.link().enumerations(), 1);
    assert_eq!(board.session.shadow().mismatches(), 0);
}

/// GET_STATUS of the device, then of the bulk OUT endpoint, then the configuration descriptor.
const QUESTIONS: [[u8; 8]; 3] = [
    [0x80, 0, 0, 0, 0, 0, 2, 0],
    [0x82, 0, 0, 0, 1, 0, 2, 0],
    [0x80, 6, 0, 2, 0, 0, 255, 0],
];

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn control_transfers_go_on_while_maps_stream_and_cost_no_map() {
    let mut board = Board::holding();
    let mut mixture = Mixture::new();
    let maps: Vec<ForceMap> = (0..60).map(|_| mixture.map(400)).collect();
    let before = board.link().transfers().len();
    for _ in 0..30 {
        for question in QUESTIONS {
            board.link_mut().control(question);
        }
    }
    board.rate(&maps);
    let link = board.link();
    let answers = &link.transfers()[before..];
    assert_eq!(answers.len(), 90);
    for (answer, question) in answers.iter().zip(QUESTIONS.iter().cycle()) {
        assert!(
            answer.outcome == ControlOutcome::Done && answer.setup == *question,
            "{answer:?}"
        );
    }
    assert!(
        answers
            .iter()
            .skip(2)
            .step_by(3)
            .all(|answer| answer.data.len() == 32)
    );
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn maps_over_the_uart_come_back_with_the_hosts_own_sums() {
    let mut board = Board::boot_over(Transport::Uart);
    board.session.command(Command::Hold).unwrap();
    let mut mixture = Mixture::new();
    for contacts in [0, 5, 150, 400] {
        let map = mixture.map(contacts);
        board.send(&map);
        // A dense map takes 30 ms at 921,600 baud.
        let status = board.wait(45_000);
        board.assert_sums(&status, &map, "over the UART");
    }
    assert_eq!(board.session.shadow().mismatches(), 0);
}
