//! What the board watches itself, on the unmodified image with the settings as shipped: its supply, its line, the robot's wires.

use crate::board::{Board, SHIPPED, assert_has, assert_has_not, code, map};
use gripline_firmware::Fault;
use gripline_firmware::fault::Severity;
use gripline_firmware::grip::Guard;
use gripline_link::Transport;
use gripline_link::emulator::{Disturbance, FaultInjection, LineWiring, LineWrite};
use gripline_protocol::crc::crc32;
use gripline_protocol::message::{Command, Configuration, GripMode, Hello, Message, MessagePackets, Refusal};
use gripline_protocol::{ForceMap, Health};

/// How soon after a reset the line is back.
const RESTORED_NS: u64 = 2_000_000;

/// Twice the load of `map(0)`, which sticks as well: from its line the plan lets the line of `map(0)` fall.
fn loaded() -> ForceMap {
    let mut map = map(0);
    for taxel in map.taxels.iter_mut().filter(|taxel| taxel.z > 0) {
        taxel.x *= 2;
    }
    map
}

/// A brown-out while holding: the first code on the line after it, and the board when a session runs again.
fn brown_out(forgets: bool) -> (Board, i32, LineWrite) {
    let (mut board, held) = Board::holding_as_shipped();
    let writes = board.writes();
    let at_ns = board.link().powered_ns();
    board.link_mut().disturb(Disturbance::BrownOut { forgets });
    board.wait_for(1_500, "the device is back", |board| {
        board.link().resets() == 1 && board.link().is_configured()
    });
    let first = board.link().line_writes()[writes];
    assert!(first.at_ns - at_ns <= RESTORED_NS, "{} ns", first.at_ns - at_ns);
    let status = board.maps(&map(0), 30);
    assert_eq!(
        (status.latched, status.mode),
        (Fault::Undervoltage.bit(), GripMode::Hold)
    );
    assert!(board.codes_since(writes).iter().all(|code| *code >= first.code));
    assert_eq!(board.refusal(Command::Release), Some(Refusal::Latched));
    board.acknowledge_all();
    (board, held.line, first)
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_brown_out_while_holding_brings_the_line_back_and_a_person_must_acknowledge() {
    let (_, line, first) = brown_out(false);
    assert_eq!(first.code, code(line));
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_brown_out_that_damages_the_kept_line_brings_the_fail_safe_force() {
    let (_, _, first) = brown_out(true);
    assert_eq!(first.code, code(SHIPPED.fail_safe));
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_brown_out_while_nothing_is_held_closes_nothing() {
    let mut board = Board::connected(Transport::Usb, None);
    board.link_mut().disturb(Disturbance::BrownOut { forgets: false });
    board.wait_for(1_500, "the device is back", |board| {
        board.link().resets() == 1 && board.link().is_configured()
    });
    let status = board.wait(500_000);
    assert_eq!((status.mode, status.line), (GripMode::Released, 0));
    board.assert_line(&status, 0, "nothing was held");
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_supply_that_is_too_low_is_reported_and_holds_the_line_until_a_person_has_looked() {
    let (mut board, _) = Board::holding_as_shipped();
    board.maps(&loaded(), 30);
    board.link_mut().disturb(Disturbance::Supply(2_900));
    // Without a fault, the line would fall from here by plan.
    let high = board.maps(&map(0), 2);
    assert_has(&high, Fault::Undervoltage);
    let low = board.maps(&map(0), 60);
    assert_has(&low, Fault::Undervoltage);
    assert!(low.line >= high.line, "{} after {}", low.line, high.line);
    board.link_mut().disturb(Disturbance::Supply(3_300));
    let back = board.maps(&map(0), 30);
    assert_has_not(&back, Fault::Undervoltage);
    assert_eq!(back.latched, Fault::Undervoltage.bit());
    assert!(back.line >= high.line, "a latched fault holds the line");
    let acknowledge = Command::Acknowledge { faults: u32::MAX };
    assert_eq!(board.refusal(acknowledge), None);
    assert_eq!(board.maps(&map(0), 2).latched, 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_chip_without_brown_out_level_3_is_reported_and_works() {
    const OFF: u8 = 3;
    let (mut board, held) = Board::holding_as_shipped();
    board.link_mut().disturb(Disturbance::BrownOutLevel(OFF));
    let status = board.maps(&map(0), 2);
    assert_has(&status, Fault::BrownOutLevel);
    assert_eq!((status.latched, status.maps), (0, held.maps + 2));
    assert_eq!(board.refusal(Command::Release), None);
    board.link_mut().disturb(Disturbance::BrownOutLevel(0));
    assert_has_not(&board.status(), Fault::BrownOutLevel);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_release_is_refused_while_the_robot_inhibits_it_and_one_under_way_stops() {
    let (mut board, held) = Board::holding_as_shipped();
    board.link_mut().disturb(Disturbance::ReleaseInhibit(true));
    board.maps(&map(0), 1);
    assert_eq!(board.refusal(Command::Release), Some(Refusal::Inhibited));
    let status = board.maps(&map(0), 2);
    assert_eq!(
        (status.mode, status.line >= SHIPPED.floor),
        (GripMode::Hold, true)
    );
    board.link_mut().disturb(Disturbance::ReleaseInhibit(false));
    board.maps(&map(0), 1);
    board.session.command(Command::Release).unwrap();
    let falling = board.maps(&map(0), 4);
    assert!(falling.line > 0 && falling.line < held.line, "{}", falling.line);
    board.link_mut().disturb(Disturbance::ReleaseInhibit(true));
    let stopped = board.maps(&map(0), 2);
    assert_eq!(stopped.mode, GripMode::Hold);
    assert!(stopped.line > 0, "{}", stopped.line);
    // Once nothing is held there is nothing to inhibit.
    board.link_mut().disturb(Disturbance::ReleaseInhibit(false));
    board.maps(&map(0), 1);
    assert_eq!(board.refusal(Command::Release), None);
    let open = board.maps(&map(0), 60);
    assert_eq!((open.mode, open.line), (GripMode::Released, 0));
    board.link_mut().disturb(Disturbance::ReleaseInhibit(true));
    assert_eq!(board.maps(&map(0), 2).mode, GripMode::Released);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn the_fault_output_says_fault_while_one_is_there_and_while_the_chip_restarts() {
    let (mut board, _) = Board::holding_as_shipped();
    assert!(board.link().fault_output(), "high: no fault");
    // What only costs data is none.
    board.sequence += 3;
    board.maps(&map(0), 1);
    assert!(board.link().fault_output());
    board.wait(150_000);
    assert!(!board.link().fault_output(), "stale maps hold the line");
    board.maps(&map(0), 3);
    assert!(board.link().fault_output());
    board.link_mut().disturb(Disturbance::BrownOut { forgets: false });
    board.wait(1_000);
    assert!(!board.link().fault_output(), "nobody drives the pin in a start");
    board.wait_for(1_500, "the device is back", |board| board.link().is_configured());
    board.maps(&map(0), 30);
    assert!(!board.link().fault_output(), "a latched fault waits for a person");
    board.acknowledge_all();
    assert!(board.link().fault_output());
}

/// Shorted, open before the op-amp, and off by its gain. Ten milliseconds to be reported, ten to be over.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_line_that_does_not_measure_as_written_is_reported_and_holds() {
    for wiring in [
        LineWiring::Shorted,
        LineWiring::Broken,
        LineWiring::Gain(750),
        LineWiring::Gain(1_250),
    ] {
        let (mut board, _) = Board::holding_as_shipped();
        board.maps(&loaded(), 30);
        board.link_mut().disturb(Disturbance::Line(wiring));
        board.wait(10_000);
        let wrong = board.maps(&map(0), 1);
        assert_has(&wrong, Fault::LineMismatch);
        let later = board.maps(&map(0), 60);
        assert_has(&later, Fault::LineMismatch);
        assert!(later.line >= wrong.line, "{wiring:?}: the line fell");
        assert!(!board.link().fault_output(), "{wiring:?}");
        board.link_mut().disturb(Disturbance::Line(LineWiring::Sound));
        board.wait(10_000);
        let right = board.maps(&map(0), 1);
        assert_has_not(&right, Fault::LineMismatch);
        assert_eq!(right.latched, 0, "{wiring:?}");
    }
}

/// Up to the ceiling at the full rate, down by plan, up to the fail-safe force, and open.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_sound_line_is_never_reported_as_a_wrong_one() {
    let (mut board, _) = Board::holding_as_shipped();
    let mut seen = 0;
    for _ in 0..3 {
        for _ in 0..20 {
            seen |= board.maps(&map(60), 1).faults;
        }
        for _ in 0..60 {
            seen |= board.maps(&map(0), 1).faults;
        }
    }
    assert_eq!(seen & !Fault::LineAtCeiling.bit(), 0);
    seen |= board.wait(900_000).faults;
    board.maps(&map(0), 3);
    board
        .session
        .command(Command::Acknowledge { faults: u32::MAX })
        .unwrap();
    assert_eq!(board.refusal(Command::Release), None);
    for _ in 0..120 {
        seen |= board.maps(&map(0), 1).faults;
    }
    assert_eq!(board.status().line, 0);
    assert_eq!(seen & Fault::LineMismatch.bit(), 0);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn an_object_that_is_lost_while_held_is_reported_until_it_is_back_or_released() {
    let (mut board, _) = Board::holding_as_shipped();
    // A touch that flickers is none, nor is a picture that the host doubts.
    assert_has_not(&board.maps(&ForceMap::EMPTY, 3), Fault::ObjectLost);
    board.maps(&map(0), 10);
    for _ in 0..20 {
        let status = board.odd_map(&ForceMap::EMPTY, |info| info.health = Health::TOO_DARK);
        assert_has_not(&status, Fault::ObjectLost);
    }
    board.maps(&map(0), 10);
    let gone = board.maps(&ForceMap::EMPTY, 8);
    assert_has(&gone, Fault::ObjectLost);
    assert_eq!((gone.latched, gone.mode), (0, GripMode::Hold));
    let later = board.maps(&ForceMap::EMPTY, 60);
    assert_has(&later, Fault::ObjectLost);
    assert!(later.line >= gone.line, "the line fell");
    assert_has_not(&board.maps(&map(0), 2), Fault::ObjectLost);
    assert_has(&board.maps(&ForceMap::EMPTY, 8), Fault::ObjectLost);
    assert_eq!(board.refusal(Command::Release), None);
    assert_has_not(&board.maps(&ForceMap::EMPTY, 2), Fault::ObjectLost);
    // A new hold has lost nothing yet.
    board.session.command(Command::Hold).unwrap();
    assert_has_not(&board.maps(&ForceMap::EMPTY, 20), Fault::ObjectLost);
}

/// An access to the DAC that takes this long is longer than the path's bound by itself.
const LATE_NS: u32 = 26_000;

/// The unmodified program, whose DAC lies behind a bus that keeps it waiting. Not over the UART: while the tick waits for so long,
/// bytes are lost there.
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_map_that_reaches_the_line_too_late_is_reported_and_raises_it_all_the_same() {
    assert_eq!(Fault::DeadlineMissed as u8, 12);
    let (mut board, _) = Board::holding_as_shipped();
    // A wait that the bound has room for.
    board.link_mut().disturb(Disturbance::SlowDac(LATE_NS / 8));
    assert_eq!(board.maps(&map(0), 3).faults, 0);
    board.link_mut().disturb(Disturbance::SlowDac(LATE_NS));
    let mut line = board.status().line;
    let writes = board.writes();
    for slipping in [50, 55, 60] {
        let late = board.maps(&map(slipping), 1);
        assert_has(&late, Fault::DeadlineMissed);
        assert_eq!(late.latched, 0);
        assert!(late.line > line, "{} after {line}", late.line);
        line = late.line;
    }
    assert!(board.codes_since(writes).is_sorted(), "the line fell");
    assert!(board.link().fault_output(), "nobody has to do anything");
    // It is there until a map is in time, and nothing waits for a person.
    board.link_mut().disturb(Disturbance::SlowDac(0));
    assert_has(&board.status(), Fault::DeadlineMissed);
    let in_time = board.maps(&map(60), 1);
    assert_has_not(&in_time, Fault::DeadlineMissed);
    assert_eq!(in_time.latched, 0);
    board.maps(&map(0), 3);
    assert_eq!(board.refusal(Command::Release), None);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn a_uart_that_nothing_is_wired_to_is_idle() {
    let (mut board, _) = Board::holding_as_shipped();
    let before = board.status();
    board.link_mut().disturb(Disturbance::UartOpen(true));
    for _ in 0..60 {
        let status = board.maps(&map(0), 1);
        assert_eq!((status.faults, status.latched), (0, 0));
    }
    let after = board.status();
    assert_eq!(after.packets_refused, before.packets_refused);
    // Pulled out in the middle of a grip it is a link that falls silent, and never a storm.
    let (mut board, held) = Board::holding_as_shipped_over(Transport::Uart);
    board.link_mut().disturb(Disturbance::UartOpen(true));
    let writes = board.writes();
    board.wait(1_000_000);
    board.link_mut().disturb(Disturbance::UartOpen(false));
    let back = board.maps(&map(0), 3);
    assert_eq!((back.faults, back.latched), (0, Fault::LinkLost.bit()));
    assert!(board.codes_since(writes).is_sorted(), "the line fell");
    assert!(back.line > held.line, "tightened");
    board.acknowledge_all();
}

/// How a fault is raised, with the settings as shipped.
type Raise = fn(&mut Board);

/// Maps of the one fingertip that the host doubts.
fn doubtful(board: &mut Board, health: Health) {
    board.odd_map(&map(0), |info| info.health = health);
}

fn stranger(board: &mut Board, hello: &Hello) {
    for packet in MessagePackets::new(&Message::Hello(*hello), 9).unwrap() {
        board.session.send_raw(&packet).unwrap();
    }
    board.wait(30_000);
}

/// Every fault that can be raised while something is held by the analog line, and how.
const RAISED: [(Fault, Raise); 18] = [
    (Fault::StaleMaps, |board| {
        board.wait(150_000);
    }),
    (Fault::LinkLost, |board| {
        board.wait(600_000);
    }),
    (Fault::CrcStorm, |board| board.storm()),
    (Fault::ReplayedMap, |board| {
        board.odd_map(&map(0), |info| info.sequence -= 3);
        board.sequence -= 1;
    }),
    (Fault::MapsLost, |board| {
        board.sequence += 3;
        board.maps(&map(0), 1);
    }),
    (Fault::UnhealthyMap, |board| doubtful(board, Health::TOO_DARK)),
    (Fault::OutOfRange, |board| {
        let wrong = Configuration {
            ceiling: SHIPPED.line.points[4].force + 1,
            ..SHIPPED
        };
        assert!(board.refusal(Command::Configure(wrong)).is_some());
    }),
    (Fault::UnreadableMessage, |board| {
        for packet in unreadable() {
            board.session.send_raw(&packet).unwrap();
        }
        board.wait(30_000);
    }),
    (Fault::SchemaMismatch, |board| {
        let hello = Hello {
            schema_version: 99,
            ..Hello::of_this_build(0, 1)
        };
        stranger(board, &hello);
    }),
    (Fault::WatchdogReset, |board| {
        // The watchdog's key: the idle loop.
        board.link_mut().inject_fault(FaultInjection::Hang, 0x4000_3000);
        board.wait_for(1_500, "the restart", |board| {
            board.link().resets() == 1 && board.link().is_configured()
        });
        // The session meets it again.
        board.maps(&map(0), 30);
    }),
    (Fault::LineAtCeiling, |board| {
        board.maps(&map(60), 200);
    }),
    (Fault::DeadlineMissed, |board| {
        board.link_mut().disturb(Disturbance::SlowDac(LATE_NS));
        board.maps(&map(45), 1);
    }),
    (Fault::SaturatedMap, |board| doubtful(board, Health::SATURATED)),
    (Fault::FutureMap, |board| {
        board.odd_map(&map(0), |info| {
            info.capture_us = info.capture_us.wrapping_add(2_000_000);
        });
    }),
    (Fault::Undervoltage, |board| {
        board.link_mut().disturb(Disturbance::Supply(2_900));
    }),
    (Fault::BrownOutLevel, |board| {
        board.link_mut().disturb(Disturbance::BrownOutLevel(3));
    }),
    (Fault::LineMismatch, |board| {
        board.link_mut().disturb(Disturbance::Line(LineWiring::Shorted));
        board.wait(20_000);
    }),
    (Fault::ObjectLost, |board| {
        board.maps(&ForceMap::EMPTY, 9);
    }),
];

/// A message of a class that there is not, with the right CRC.
fn unreadable() -> Vec<Vec<u8>> {
    let packets = MessagePackets::new(&Message::Command(Command::Release), 9).unwrap();
    let mut all: Vec<_> = packets.map(|packet| packet.to_vec()).collect();
    all[0][6] = 9;
    let end = all[0].len() - 4;
    let crc = crc32(all[0][..end].iter().copied());
    all[0][end..].copy_from_slice(&crc.to_le_bytes());
    all
}

/// The others need another start (15 SETTINGS LOST, 16 LINE FAILED).
#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn every_fault_with_the_settings_as_shipped_does_what_the_table_says() {
    let elsewhere = [Fault::SettingsLost, Fault::LineFailed];
    let here = RAISED.map(|(fault, _)| fault);
    assert!(
        Fault::ALL
            .iter()
            .all(|fault| here.contains(fault) != elsewhere.contains(fault))
    );
    for (fault, raise) in RAISED {
        let (mut board, _) = Board::holding_as_shipped();
        // Above what the load needs, so that the plan would let the line fall.
        let high = board.maps(&map(45), 3);
        let writes = board.writes();
        raise(&mut board);
        // A message would end some of them; a status comes by itself.
        let status = board.wait(130_000);
        let name = fault.name();
        assert_ne!(
            (status.faults | status.latched) & fault.bit(),
            0,
            "{name}: {status:?}"
        );
        assert_eq!(
            status.latched & fault.bit() != 0,
            fault.latches(),
            "{name}: latched"
        );
        if fault.severity() > Severity::Info {
            assert!(!board.link().fault_output(), "{name}: the fault output");
        }
        match fault.guard() {
            Guard::Free => {}
            Guard::Hold => {
                let later = board.wait(60_000);
                assert!(status.line >= high.line, "{name}: the line fell");
                assert!(later.line >= status.line, "{name}: the line fell");
            }
            Guard::FailSafe => {
                let end = board.wait(300_000);
                assert!(end.line >= SHIPPED.fail_safe, "{name}: not tightened");
                assert!(board.codes_since(writes).is_sorted(), "{name}: the line fell");
            }
        }
        println!("{name}: line {} after {}", status.line, high.line);
    }
}
