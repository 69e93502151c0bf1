//! Every fault raised on the unmodified image: what the line does, when the fault is reported, what clears it. The table
//! in `docs/safety.md` names the test of each. Times are emulated ones.

use crate::board::{Board, DAC, FRAME_US, SETTINGS, assert_has, assert_has_not, code, feed_forward, map};
use gripline_firmware::Fault;
use gripline_link::emulator::{Cable, FaultInjection, LineWrite};
use gripline_link::{EmulatorLink, Link, Transport};
use gripline_protocol::crc::crc32;
use gripline_protocol::message::{
    Command, Configuration, GripMode, Hello, LineKind, Message, MessagePackets, Refusal, Status,
};
use gripline_protocol::{Health, LSB_PER_NEWTON};

/// Registers at whose next touch something happens: the DAC's value (the way from map to line), the watchdog's key (the idle loop),
/// the USB core's interrupt status (an interrupt above them all).
const PLACES_TO_FAIL: [(&str, u32); 3] = [
    ("the map-to-line path", DAC),
    ("the idle loop", 0x4000_3000),
    ("the USB interrupt", 0x5000_0014),
];

/// From the order to the fault, two touches of the register later: two looks of the idle loop and some slack.
const TOUCHED_NS: u64 = 45_000_000;
/// The same and the longest that the emulated watchdog waits, with the time between two looks at the proof that it is fed by.
const WATCHDOG_NS: u64 = TOUCHED_NS + 125_000_000;
/// The same and a crash, which waits for nothing.
const CRASHED_NS: u64 = TOUCHED_NS + 1_000_000;
/// Forces that share a code of the DAC, 1/4096 N.
const CODE_LSB: u32 = 50;
/// How soon after a reset the line is back.
const RESTORED_NS: u64 = 2_000_000;

/// Holding with a line above the floor, by maps that stick.
fn holding() -> (Board, Status) {
    let mut board = Board::holding();
    let held = board.maps(&map(0), 40);
    assert_eq!((held.faults, held.latched), (0, 0));
    assert!(held.line > SETTINGS.floor && held.line < SETTINGS.fail_safe);
    (board, held)
}

/// The packets of a message, each changed before its CRC is made again.
fn message_packets(message: &Message, change: impl Fn(&mut [u8])) -> Vec<Vec<u8>> {
    let packets = MessagePackets::new(message, 9).unwrap();
    let mut all: Vec<_> = packets.map(|packet| packet.to_vec()).collect();
    assert_eq!(all.len(), 1, "a message of one packet");
    change(&mut all[0]);
    let end = all[0].len() - 4;
    let crc = crc32(all[0][..end].iter().copied());
    all[0][end..].copy_from_slice(&crc.to_le_bytes());
    all
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_host_that_falls_silent_is_stale_and_then_lost_and_a_person_must_acknowledge() {
    let (mut board, held) = holding();
    let silent_us = board.session.now_us();
    let writes = board.writes();
    board.wait(600_000);
    let first = board.link().line_writes()[writes];
    // The last packet was taken within a frame of the map before; emulated time starts before the session's.
    assert!(first.code > code(held.line), "the line rises");
    let status = *board.session.status().unwrap();
    assert_has(&status, Fault::StaleMaps);
    assert_has(&status, Fault::LinkLost);
    let since_us = board.session.now_us() - silent_us;
    assert!(since_us < 610_000);
    let end = board.wait(200_000);
    board.assert_line(&end, SETTINGS.fail_safe, "tightened");
    assert!(
        board.codes_since(writes).is_sorted(),
        "the line fell on its way up"
    );
    // The host is back: what is latched keeps the line up and the grip closed.
    let back = board.maps(&map(0), 60);
    assert_eq!(
        (back.faults, back.latched, back.line),
        (0, Fault::LinkLost.bit(), SETTINGS.fail_safe)
    );
    assert_eq!(board.refusal(Command::Release), Some(Refusal::Latched));
    board.acknowledge_all();
    assert_eq!(board.refusal(Command::Release), None);
    board.wait(800_000);
    assert_eq!(board.session.line_code(), Some(code(0)));
}

/// Told within `link_lost_ms` and two ticks of the last packet.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_lost_link_raises_the_line_within_two_milliseconds_of_its_limit() {
    let (mut board, _) = holding();
    // The last thing said, and when the firmware took it: it answers with a status at once.
    board.session.command(Command::ReadStatus).unwrap();
    let mut taken_us = 0;
    for _ in 0..20 {
        board.session.run_until(board.session.now_us() + 100).unwrap();
        if board.link().waiting() == 0 {
            taken_us = board.session.now_us();
            break;
        }
    }
    assert_ne!(taken_us, 0, "the packet was taken");
    let writes = board.writes();
    let limit_us = u64::from(SETTINGS.link_lost_ms) * 1_000;
    board.session.run_until(taken_us + limit_us - 1_000).unwrap();
    assert_eq!(board.writes(), writes, "not before its limit");
    board.session.run_until(taken_us + limit_us + 2_100).unwrap();
    assert!(board.writes() > writes, "not within two ticks of its limit");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn maps_that_stop_or_come_too_late_hold_the_line_until_a_fresh_one_comes() {
    let (mut board, held) = holding();
    let writes = board.writes();
    // The host goes on speaking, but not of forces.
    let mut told_ms = None;
    for ms in 0..300 {
        board.session.command(Command::ReadStatus).unwrap();
        let status = board.wait(1_000);
        if status.faults & Fault::StaleMaps.bit() != 0 && told_ms.is_none() {
            told_ms = Some(ms);
        }
        assert_has_not(&status, Fault::LinkLost);
    }
    let limit = i32::from(SETTINGS.stale_ms);
    // Counted from the frame after the last map's picture; the answer waits for the bus for up to 25 ms.
    assert!(
        told_ms.is_some_and(|ms| ms >= limit - 20 && ms <= limit + 30),
        "{told_ms:?}"
    );
    assert_eq!(board.writes(), writes, "the line did not move");
    let fresh = board.maps(&map(0), 2);
    assert_eq!((fresh.faults, fresh.latched, fresh.line), (0, 0, held.line));
    // Maps come as often as ever, of pictures long past.
    for _ in 0..20 {
        board.odd_map(&map(0), |info| {
            info.capture_us = info.capture_us.wrapping_sub(150_000);
        });
    }
    let late = board.status();
    assert_has(&late, Fault::StaleMaps);
    assert_eq!(late.line, held.line);
    assert_eq!(board.maps(&map(0), 2).faults, 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_crc_storm_holds_the_line_latches_and_costs_no_good_map() {
    let (mut board, held) = holding();
    board.storm();
    let storm = board.maps(&map(0), 2);
    assert_has(&storm, Fault::CrcStorm);
    assert_eq!(storm.line, held.line);
    assert_eq!(storm.maps, held.maps + 2, "good maps count in a storm");
    let over = board.maps(&map(0), 20);
    assert_eq!((over.faults, over.latched), (0, Fault::CrcStorm.bit()));
    board.acknowledge_all();
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn replayed_maps_change_nothing() {
    let (mut board, held) = holding();
    // What was recorded is played back: right in every bit, and slipping.
    for back in 0..20 {
        let status = board.odd_map(&map(60), |info| info.sequence -= 1 + back);
        board.sequence -= 1;
        assert_eq!((status.maps, status.sums), (held.maps, held.sums));
    }
    let status = board.status();
    assert_has(&status, Fault::ReplayedMap);
    assert_eq!(status.line, held.line);
    assert_eq!(status.maps_refused, held.maps_refused + 20);
    let next = board.maps(&map(0), 1);
    assert_eq!((next.faults, next.latched), (0, 0));
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn lost_maps_are_reported_and_change_nothing_else() {
    let (mut board, held) = holding();
    board.sequence += 3;
    let status = board.maps(&map(0), 1);
    assert_has(&status, Fault::MapsLost);
    assert_eq!((status.latched, status.line), (0, held.line));
    assert_eq!(board.maps(&map(0), 1).faults, 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn malformed_commands_at_the_full_rate_of_the_bus_neither_move_the_line_nor_cost_a_map() {
    let (mut board, held) = holding();
    let unknown_class = message_packets(&Message::Command(Command::Release), |packet| packet[6] = 9);
    let unknown_command = message_packets(&Message::Command(Command::Release), |packet| packet[7] = 77);
    for _ in 0..60 {
        for _ in 0..140 {
            board.session.send_raw(&unknown_class[0]).unwrap();
            board.session.send_raw(&unknown_command[0]).unwrap();
        }
        // Behind nearly three hundred messages, a frame's worth of the bus.
        board.send(&map(0));
        board.wait(FRAME_US);
    }
    board.wait_for(2_000, "the last message", |board| board.link().waiting() == 0);
    let status = board.wait(30_000);
    assert_eq!(status.maps, held.maps + 60);
    assert_eq!((status.line, status.latched), (held.line, 0));
    assert_eq!(board.link().resets(), 0);
    assert_eq!(board.session.shadow().mismatches(), 0);
    board.session.send_raw(&unknown_class[0]).unwrap();
    board.wait(30_000);
    assert_has(&board.wait(130_000), Fault::UnreadableMessage);
    assert_has_not(&board.status(), Fault::UnreadableMessage);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn settings_out_of_range_are_refused_whole_and_named() {
    let (mut board, held) = holding();
    let wrong = Configuration {
        ceiling: SETTINGS.line.points[4].force + 1,
        friction: 9_000,
        ..SETTINGS
    };
    for _ in 0..100 {
        board.session.command(Command::Configure(wrong)).unwrap();
    }
    let status = board.maps(&map(0), 10);
    assert_has(&status, Fault::OutOfRange);
    assert_eq!(
        status.line, held.line,
        "the friction beside it was not taken either"
    );
    let Some(Refusal::OutOfRange(refusal)) = board.refusal(Command::Configure(wrong)) else {
        panic!("refused by name");
    };
    assert_eq!(refusal.to_string(), "ceiling: found 163841, expected 1 to 163840");
    assert_eq!(board.refusal(Command::Configure(SETTINGS)), None);
    assert_eq!(board.maps(&map(0), 1).faults, 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_host_of_another_schema_commands_nothing() {
    let (mut board, held) = holding();
    let stranger = Hello {
        schema_version: 99,
        ..Hello::of_this_build(0, 1)
    };
    for packet in message_packets(&Message::Hello(stranger), |_| {}) {
        board.session.send_raw(&packet).unwrap();
    }
    let status = board.maps(&map(0), 2);
    assert_has(&status, Fault::SchemaMismatch);
    assert_eq!((status.line, status.mode), (held.line, GripMode::Hold));
    assert_eq!(board.refusal(Command::Release), Some(Refusal::NoHandshake));
    for packet in message_packets(&Message::Hello(Hello::of_this_build(0, 2)), |_| {}) {
        board.session.send_raw(&packet).unwrap();
    }
    assert_eq!(board.maps(&map(0), 2).faults, 0);
    assert_eq!(board.refusal(Command::Release), None);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_map_from_the_future_is_refused() {
    let (mut board, held) = holding();
    let future = board.odd_map(&map(60), |info| {
        info.capture_us = info.capture_us.wrapping_add(2_000_000);
    });
    assert_eq!((future.maps, future.sums), (held.maps, held.sums));
    let status = board.status();
    assert_has(&status, Fault::FutureMap);
    assert_eq!((status.line, status.latched), (held.line, 0));
    assert_has_not(&board.maps(&map(0), 1), Fault::FutureMap);
}

/// With relaxing on: a contact that sticks would let the line fall.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn doubtful_and_saturated_maps_hold_the_line_where_good_ones_would_let_it_fall() {
    let mut board = Board::holding();
    board
        .session
        .configure(Configuration {
            relax_rate: 8_192,
            ..SETTINGS
        })
        .unwrap();
    for (health, fault) in [
        (Health::TOO_DARK, Fault::UnhealthyMap),
        (Health::TOO_BRIGHT, Fault::UnhealthyMap),
        (Health::UNLIKE_TRAINING, Fault::UnhealthyMap),
        (Health::PARTICLES_LOST, Fault::UnhealthyMap),
        (Health::SATURATED, Fault::SaturatedMap),
    ] {
        board.maps(&map(45), 15);
        board.maps(&map(0), 10);
        let before = board.status();
        let writes = board.writes();
        for _ in 0..60 {
            let status = board.odd_map(&map(0), |info| info.health = health);
            assert_has(&status, fault);
        }
        let line = board.session.status().unwrap().line;
        assert!(line >= before.line, "{health:?}: {line} after {}", before.line);
        assert!(board.codes_since(writes).is_sorted(), "{health:?}");
        let good = board.maps(&map(0), 60);
        assert_eq!((good.faults, good.latched), (0, 0), "{health:?}");
        assert!(
            good.line < line,
            "{health:?}: good maps let the line fall by plan"
        );
    }
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_line_at_its_ceiling_is_reported() {
    let mut board = Board::holding();
    let status = board.maps(&map(60), 200);
    assert_has(&status, Fault::LineAtCeiling);
    board.assert_line(&status, SETTINGS.ceiling, "slipping for long");
    assert_eq!(status.latched, 0);
}

/// A task, the idle loop and an interrupt that spin (the watchdog ends it), run into a fault of the core, panic, or overflow the
/// stack (the chip restarts at once): the line is back before anything else is, and the host meets the microcontroller again.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn whatever_hangs_or_crashes_while_holding_is_reset_and_the_line_is_back_within_two_milliseconds() {
    for (number, (place, address)) in PLACES_TO_FAIL.into_iter().enumerate() {
        for (fault, limit_ns) in [
            (FaultInjection::Hang, WATCHDOG_NS),
            (FaultInjection::UndefinedInstruction, CRASHED_NS),
            (FaultInjection::Panic, CRASHED_NS),
            (FaultInjection::StackOverflow, CRASHED_NS),
        ] {
            // The jump of a panic takes ten bytes, which would spoil the code around a store that is reached by branches.
            if fault == FaultInjection::Panic && number == 0 {
                continue;
            }
            fails_while_holding(&format!("{fault:?} in {place}"), fault, address, limit_ns);
        }
    }
}

fn fails_while_holding(what: &str, fault: FaultInjection, address: u32, limit_ns: u64) {
    let (mut board, _) = holding();
    board.link_mut().inject_fault(fault, address);
    let asked_ns = board.link().powered_ns();
    // Slip moves the line, so that the path writes it.
    for _ in 0..12 {
        board.send(&map(45));
        board
            .session
            .run_until(board.session.now_us() + FRAME_US)
            .unwrap();
    }
    let resets = board.link().resets_ns().to_vec();
    assert_eq!(resets.len(), 1, "{what}: one reset");
    let writes: Vec<LineWrite> = board.link().line_writes().to_vec();
    let before = writes
        .iter()
        .rfind(|write| write.at_ns < resets[0])
        .expect("it held");
    let after: Vec<&LineWrite> = writes.iter().filter(|write| write.at_ns >= resets[0]).collect();
    println!(
        "{what}: reset {:.1} ms later at most, the line back {} µs after it",
        (resets[0] - asked_ns) as f64 / 1e6,
        (after[0].at_ns - resets[0]) / 1_000
    );
    assert!(resets[0] - asked_ns <= limit_ns, "{what}: the reset came late");
    // A crash in the middle of a write may bring back what was about to be written.
    let step = u32::from(SETTINGS.rise_rate).div_ceil(CODE_LSB) as u16;
    assert!(
        (before.code..=before.code + step).contains(&after[0].code),
        "{what}: the line came back from {} at {}",
        before.code,
        after[0].code
    );
    assert!(after[0].at_ns - resets[0] <= RESTORED_NS, "{what}");
    assert!(
        after.iter().all(|write| write.code >= before.code),
        "{what}: below the hold value after the reset"
    );
    // The session meets it again by itself, and gives it its settings; a person must acknowledge.
    board.wait_for(1_500, "the device is back", |board| board.link().is_configured());
    let status = board.maps(&map(0), 30);
    assert_eq!(
        (status.latched, status.mode),
        (Fault::WatchdogReset.bit(), GripMode::Hold),
        "{what}"
    );
    assert_eq!(
        (board.session.restarts(), board.session.is_sound()),
        (1, true),
        "{what}"
    );
    assert_eq!(board.session.shadow().mismatches(), 0, "{what}");
    assert_eq!(board.refusal(Command::ReadConfiguration), None);
    assert_eq!(*board.session.settings(), SETTINGS, "{what}");
    assert_eq!(board.refusal(Command::Release), Some(Refusal::Latched));
    board.acknowledge_all();
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn settings_stay_over_a_power_cycle_and_the_newest_count() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings");
    for number in 1..=3 {
        let mut board = Board::connected(Transport::Usb, Some(&file));
        let before = *board.session.settings();
        let expected = if number == 1 {
            Configuration::DEFAULT
        } else {
            numbered(number - 1)
        };
        assert_eq!(before, expected, "power-up {number}");
        board.session.configure(numbered(number)).unwrap();
        assert_eq!(board.session.store().unwrap(), u32::from(number));
        let status = board.status();
        assert_eq!(
            (status.faults, status.latched, board.link().resets()),
            (0, 0, 0),
            "writing the flash outlasted the watchdog"
        );
    }
}

fn numbered(number: u16) -> Configuration {
    Configuration {
        friction: 4_000 + number,
        margin: 2_500,
        ..Configuration::DEFAULT
    }
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn settings_are_not_stored_while_something_may_be_in_the_gripper() {
    let (mut board, held) = holding();
    assert_eq!(board.refusal(Command::Store), Some(Refusal::Holding));
    let status = board.maps(&map(0), 2);
    assert_eq!((status.line, board.link().resets()), (held.line, 0));
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_line_table_that_was_stored_does_not_come_into_force_while_the_line_holds() {
    let mut board = Board::connected(Transport::Usb, None);
    // The same forces at lower voltages.
    let mut settings = Configuration::DEFAULT;
    for point in &mut settings.line.points[1..] {
        point.code -= 200;
    }
    board.session.configure(settings).unwrap();
    board.session.store().unwrap();
    board.session.command(Command::Hold).unwrap();
    let held = board.maps(&map(0), 60);
    board.assert_line(&held, held.line, "the table of the start is in force");
    board
        .link_mut()
        .inject_fault(FaultInjection::Panic, PLACES_TO_FAIL[1].1);
    board.maps(&map(0), 60);
    assert_eq!(board.link().resets(), 1);
    board.wait_for(1_500, "the device is back", |board| board.link().is_configured());
    let back = board.maps(&map(0), 30);
    assert_eq!(
        (back.latched, back.mode),
        (Fault::WatchdogReset.bit(), GripMode::Hold)
    );
    board.assert_line(&back, back.line, "after the reset");
}

/// Cut inside the erasure, and at every microsecond of the words behind it: the board is the same to the nanosecond, so a first run
/// tells where those words come.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_power_cut_while_the_flash_is_written_leaves_the_old_settings_or_the_new_ones() {
    let folder = tempfile::tempdir().unwrap();
    let [file, cut] = ["settings", "cut"].map(|name| folder.path().join(name));
    let storing = || {
        let _ = std::fs::remove_file(&file);
        let mut board = Board::connected(Transport::Usb, Some(&file));
        board.session.configure(numbered(1)).unwrap();
        assert_eq!(board.session.store().unwrap(), 1);
        board.session.configure(numbered(2)).unwrap();
        board.session.command(Command::Store).unwrap();
        board
    };
    let mut board = storing();
    let mut last = std::fs::read(&file).unwrap();
    let mut changes_us = Vec::new();
    while changes_us.len() < 2 {
        board.session.run_until(board.session.now_us() + 100).unwrap();
        let now = std::fs::read(&file).unwrap();
        if now != last {
            changes_us.push(board.session.now_us());
        }
        last = now;
    }
    drop(board);
    let [erasing_us, words_us] = changes_us[..] else {
        unreachable!("two were waited for");
    };
    assert!(words_us - erasing_us > 100_000, "the first change is the erasure");

    let mut board = storing();
    let mut last = std::fs::read(&file).unwrap();
    let mut seen = [0; 2];
    let mut step_to = |board: &mut Board, us: u64| {
        board.session.run_until(us).unwrap();
        let now = std::fs::read(&file).unwrap();
        if now == last {
            return;
        }
        last = now;
        // What a power-up at this very moment would find.
        std::fs::write(&cut, &last).unwrap();
        let found = *Board::connected(Transport::Usb, Some(&cut)).session.settings();
        assert!(found == numbered(1) || found == numbered(2), "{found:?}");
        seen[usize::from(found == numbered(2))] += 1;
    };
    step_to(&mut board, erasing_us);
    for us in words_us - 120..words_us + 60 {
        step_to(&mut board, us);
    }
    println!("power cuts that left the old and the new settings: {seen:?}");
    assert!(seen[0] >= 10 && seen[1] >= 1, "{seen:?}");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn settings_that_cannot_be_read_are_reported_and_the_default_ones_are_in_force() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings");
    std::fs::write(&file, vec![0x5A; 0x8000]).unwrap();
    let mut board = Board::connected(Transport::Usb, Some(&file));
    assert_eq!(*board.session.settings(), Configuration::DEFAULT);
    let status = board.status();
    assert_has(&status, Fault::SettingsLost);
    assert_eq!(status.latched, Fault::SettingsLost.bit());
    board.session.configure(numbered(1)).unwrap();
    assert_eq!(board.session.store().unwrap(), 1);
    board.acknowledge_all();
    drop(board);
    let board = Board::connected(Transport::Usb, Some(&file));
    assert_eq!(*board.session.settings(), numbered(1));
}

/// The line's kind is taken at the start: with nobody on the bus, what is to be held is not.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_gripper_on_the_bus_that_does_not_answer_is_reported_once_something_is_to_be_held() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings");
    let mut robotiq = SETTINGS;
    robotiq.line.kind = LineKind::Robotiq2f140;
    robotiq.floor = 12 * LSB_PER_NEWTON;
    robotiq.fail_safe = 12 * LSB_PER_NEWTON;
    let strong = Configuration {
        ceiling: 100 * LSB_PER_NEWTON,
        ..robotiq
    };
    let mut board = Board::connected(Transport::Usb, Some(&file));
    // The analog line drives the gripper until the next start, and reaches 40 N.
    let Some(Refusal::OutOfRange(refusal)) = board.refusal(Command::Configure(strong)) else {
        panic!("refused by name");
    };
    assert_eq!(refusal.to_string(), "ceiling: found 409600, expected 1 to 163840");
    board.session.configure(robotiq).unwrap();
    board.session.store().unwrap();
    drop(board);
    let mut board = Board::connected(Transport::Usb, Some(&file));
    assert_eq!(*board.session.settings(), robotiq);
    board.session.configure(strong).unwrap();
    board.session.command(Command::Hold).unwrap();
    let status = board.maps(&map(0), 60);
    assert_has(&status, Fault::LineFailed);
    assert!(feed_forward(&map(0)) < robotiq.floor);
    board.assert_line(&status, robotiq.floor, "the analog line shows it all the same");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_cable_at_rest_is_no_fault_while_nothing_is_held() {
    let mut link = EmulatorLink::spawn(Transport::Usb).unwrap();
    link.set_cable(Cable::Out);
    link.run_until(2_000_000, &mut |_| {}).unwrap();
    assert_eq!((link.line_code(), link.resets()), (Some(code(0)), 0));
}
