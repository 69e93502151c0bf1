//! A microcontroller that restarts, falls silent or is replaced while a session is under way: the host meets it again,
//! gives it its settings and repeats no command. The firmware library on a clock of its own; times in µs.

use std::cell::RefCell;
use std::rc::Rc;

use gripline_firmware::{Fault, ResetCause, Start};
use gripline_link::session::Session;
use gripline_protocol::message::{Command, Configuration, GripMode, Hello, Message, MessagePackets, Refusal};
use gripline_protocol::{ForceMap, MapInfo, TaxelForce};
use gripline_test_board::link::{Bench, BenchLink};

const SETTINGS: Configuration = Configuration {
    friction: 4_321,
    relax_rate: 0,
    ..Configuration::CAREFUL
};

struct Host {
    session: Session,
    bench: Rc<RefCell<Bench>>,
    sequence: u32,
}

impl Host {
    /// Holding, with maps that stick, the host's own settings in force.
    fn holding() -> Self {
        let bench = Bench::shared();
        let session = Session::open(Box::new(BenchLink(Rc::clone(&bench))), SETTINGS).unwrap();
        let mut host = Self {
            session,
            bench,
            sequence: 0,
        };
        host.session.command(Command::Hold).unwrap();
        host.maps(40);
        assert_eq!(host.session.status().unwrap().mode, GripMode::Hold);
        assert!(host.line() > SETTINGS.floor);
        host.bench.borrow_mut().heard.clear();
        host
    }

    fn line(&self) -> i32 {
        self.bench.borrow().board.program().line().lsb()
    }

    /// 60 maps a second.
    fn maps(&mut self, count: u32) {
        let mut map = ForceMap::EMPTY;
        for (place, taxel) in map.taxels[100..160].iter_mut().enumerate() {
            *taxel = TaxelForce {
                x: 250,
                y: -60,
                z: 800 + place as i16,
            };
        }
        for _ in 0..count {
            self.sequence += 1;
            let info = MapInfo {
                sequence: self.sequence,
                capture_us: self.session.capture_us(),
                ..MapInfo::default()
            };
            self.session.send_map(&info, &map).unwrap();
            self.session.run_until(self.session.now_us() + 16_667).unwrap();
        }
    }

    fn heard(&self) -> Vec<Message> {
        self.bench.borrow().heard.clone()
    }

    fn hellos(&self) -> usize {
        let heard = self.heard();
        heard
            .iter()
            .filter(|message| matches!(message, Message::Hello(_)))
            .count()
    }
}

#[test]
fn a_watchdog_reset_under_way_is_noticed_and_met_with_a_handshake_and_the_settings_alone() {
    let mut host = Host::holding();
    let line = host.line();
    let checked = host.session.shadow().checked();
    host.bench.borrow_mut().board.reset(ResetCause::Watchdog, 100_000);
    host.maps(30);
    assert_eq!((host.session.restarts(), host.session.is_sound()), (1, true));
    assert_eq!(*host.bench.borrow().board.program().settings(), SETTINGS);
    // Nothing that moves the grip was said again: it holds by itself, and a person must look.
    for message in host.heard() {
        assert!(
            matches!(
                message,
                Message::Hello(_) | Message::Command(Command::Configure(_) | Command::ReadConfiguration)
            ),
            "{message:?}"
        );
    }
    let status = *host.session.status().unwrap();
    assert_eq!(
        (status.mode, status.latched),
        (GripMode::Hold, Fault::WatchdogReset.bit())
    );
    assert!(status.line >= line);
    // Maps are judged again, by the same settings on both sides.
    assert!(host.session.shadow().checked() >= checked + 15);
    assert_eq!(host.session.shadow().mismatches(), 0);
    host.session.command(Command::Release).unwrap();
    host.maps(2);
    assert_eq!(host.session.take_refusal(), Some(Refusal::Latched));
    host.session
        .command(Command::Acknowledge { faults: u32::MAX })
        .unwrap();
    host.session.command(Command::Release).unwrap();
    host.maps(2);
    assert_eq!(host.session.take_refusal(), None);
    assert_eq!(host.session.status().unwrap().mode, GripMode::Released);
}

#[test]
fn every_restart_counts_whatever_its_cause_and_however_soon_it_comes() {
    let mut host = Host::holding();
    for (number, (cause, down_us)) in [
        (ResetCause::Software, 0),
        (ResetCause::Watchdog, 40_000),
        (ResetCause::PowerOn, 2_000_000),
        (ResetCause::Watchdog, 300_000),
        (ResetCause::Software, 5_000),
    ]
    .into_iter()
    .enumerate()
    {
        host.bench.borrow_mut().board.reset(cause, down_us);
        host.maps(160);
        assert_eq!(host.session.restarts(), number as u32 + 1, "{cause:?}");
        assert!(host.session.is_sound());
        assert_eq!(*host.bench.borrow().board.program().settings(), SETTINGS);
    }
    assert_eq!(host.session.shadow().mismatches(), 0);
}

/// Without a single map or command, by silence alone: a microcontroller that restarted says nothing until it is asked.
#[test]
fn a_restart_is_noticed_by_a_host_that_only_listens() {
    let mut host = Host::holding();
    host.bench.borrow_mut().board.reset(ResetCause::PowerOn, 900_000);
    for _ in 0..2_000 {
        host.session.run_until(host.session.now_us() + 1_000).unwrap();
    }
    assert_eq!((host.session.restarts(), host.session.is_sound()), (1, true));
}

#[test]
fn a_silence_without_a_restart_is_met_with_a_greeting_and_counts_as_none() {
    let mut host = Host::holding();
    let now_us = host.session.now_us();
    host.bench.borrow_mut().board.stop_until(now_us + 1_000_000);
    host.maps(90);
    assert_eq!((host.session.restarts(), host.session.is_sound()), (0, true));
    let hellos = host.hellos();
    assert!(
        (1..=5).contains(&hellos),
        "{hellos} greetings in half a second of doubt"
    );
    assert_eq!(host.session.shadow().mismatches(), 0);
    // A greeting by the same host starts no count again: the maps go on where they were.
    assert_eq!(host.session.status().unwrap().sequence, host.sequence);
}

#[test]
fn a_session_without_restarts_says_hello_once() {
    let mut host = Host::holding();
    host.maps(200);
    assert_eq!((host.hellos(), host.session.restarts()), (0, 0));
}

/// The stored line forbids the settings that were in force before: those of the flash then count, and the host knows it.
#[test]
fn settings_that_are_refused_after_a_restart_are_not_insisted_on() {
    let mut host = Host::holding();
    host.bench.borrow_mut().board.reset(ResetCause::Watchdog, 10_000);
    let mut stored = Configuration::DEFAULT;
    stored.ceiling = 20 * 4_096;
    for (quarter, point) in (0..).zip(&mut stored.line.points) {
        point.force = 5 * quarter * 4_096;
    }
    let line = host.bench.borrow().board.program().line();
    let start = Start {
        reset: ResetCause::Watchdog,
        restored_line: Some(line),
        stored: gripline_firmware::storage::Stored {
            settings: Some(stored),
            lost: false,
            writes: 1,
        },
        session: 77,
        ..Start::default()
    };
    host.bench.borrow_mut().board.start_anew(start, 10_000);
    host.maps(60);
    assert_eq!((host.session.restarts(), host.session.is_sound()), (1, true));
    assert_eq!(*host.session.settings(), stored);
    assert!(matches!(
        host.session.take_refusal(),
        Some(Refusal::OutOfRange(_))
    ));
    assert_eq!(host.session.shadow().mismatches(), 0);
}

#[test]
fn one_who_comes_back_with_another_schema_ends_the_session_by_name() {
    let mut host = Host::holding();
    host.bench
        .borrow_mut()
        .board
        .reset(ResetCause::PowerOn, 3_000_000);
    let stranger = Hello {
        schema_version: 99,
        ..Hello::of_this_build(1, 4)
    };
    let packet = MessagePackets::new(&Message::Hello(stranger), 1)
        .unwrap()
        .next()
        .unwrap();
    host.session.run_until(host.session.now_us() + 600_000).unwrap();
    host.bench.borrow_mut().board.replies.push_back(packet);
    let error = host.session.run_until(host.session.now_us() + 1_000).unwrap_err();
    assert!(
        matches!(error, gripline_link::LinkError::Schema { .. }),
        "{error}"
    );
    assert!(error.to_string().contains("schema 99"), "{error}");
}

#[test]
fn a_first_map_that_was_held_up_for_longer_than_is_forgiven_locks_the_others_out_for_half_a_second_only() {
    let bench = Bench::shared();
    let session = Session::open(Box::new(BenchLink(Rc::clone(&bench))), SETTINGS).unwrap();
    let mut host = Host {
        session,
        bench,
        sequence: 1,
    };
    host.session.command(Command::Hold).unwrap();
    for _ in 0..180 {
        host.session.run_until(host.session.now_us() + 16_667).unwrap();
    }
    host.bench.borrow_mut().heard.clear();
    let held_up = MapInfo {
        sequence: 1,
        capture_us: host.session.capture_us() - 2_000_000,
        ..MapInfo::default()
    };
    host.session.send_map(&held_up, &ForceMap::EMPTY).unwrap();
    host.maps(24);
    let status = *host.session.status().unwrap();
    assert!(
        status.faults & Fault::FutureMap.bit() != 0 && status.maps == 1,
        "{status:?}"
    );
    host.maps(36);
    let status = *host.session.status().unwrap();
    assert!(
        status.faults & Fault::FutureMap.bit() == 0 && status.maps > 20,
        "{status:?}"
    );
    let session = &host.session;
    assert_eq!(
        (session.clock_jumps(), session.restarts(), host.hellos()),
        (1, 0, 1)
    );
    assert_eq!(session.shadow().mismatches(), 0);
}
