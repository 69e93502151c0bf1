//! The unmodified firmware image on the emulated board, spoken to over its UART by the very session that
//! `gripline run` uses. `cargo xtask test` builds emulator and image and runs these with `--include-ignored`; they
//! fail when either is missing.

use gripline::link::{EmulatorLink, Link};
use gripline::session::Session;
use gripline_firmware::GripForce;
use gripline_firmware::constants::DECIDE_BUDGET_CYCLES;
use gripline_firmware::line::DAC_LIVE_ZERO;
use gripline_firmware::sums::{TaxelRule, stick_ratio, sums_of, total_shear};
use gripline_protocol::message::{Command, Configuration, GripMode, SlipState, Status};
use gripline_protocol::{ForceMap, MapInfo, PER_UNIT, TaxelForce, encode_map};

/// 60 maps a second.
const FRAME_US: u64 = 16_667;

/// No relaxing and no reflex while it sticks: what the line comes to follows from shear and friction alone.
const SETTINGS: Configuration = Configuration {
    relax_rate: 0,
    ..Configuration::DEFAULT
};

struct Board {
    session: Session,
    sequence: u32,
}

impl Board {
    fn boot() -> Self {
        let link = EmulatorLink::spawn().expect("emulator and image are there: cargo xtask emulator");
        let session = Session::open(Box::new(link), SETTINGS).expect("the firmware answers");
        Self { session, sequence: 0 }
    }

    fn holding() -> Self {
        let mut board = Self::boot();
        board.session.command(Command::Hold).unwrap();
        board
    }

    fn wait(&mut self, us: u64) -> Status {
        self.session.run_until(self.session.now_us() + us).unwrap();
        *self.session.status().expect("a status came")
    }

    /// Sends a map 60 times a second for so many maps; returns the status after the last.
    fn maps(&mut self, map: &ForceMap, count: u32) -> Status {
        for _ in 0..count {
            self.sequence += 1;
            let info = MapInfo {
                sequence: self.sequence,
                capture_us: self.session.now_us() as u32,
                ..MapInfo::default()
            };
            self.session.send_map(&info, map).unwrap();
            self.wait(FRAME_US);
        }
        *self.session.status().unwrap()
    }

    /// The DAC shows the very force that the status tells, as the live-zero line demands.
    fn assert_line(&self, status: &Status, expected_lsb: i32, what: &str) {
        assert_eq!(status.line, expected_lsb, "{what}: the line in the status");
        let code = DAC_LIVE_ZERO.code(GripForce::from_lsb(expected_lsb));
        assert_eq!(
            self.session.line_code(),
            Some(code),
            "{what}: the code on the DAC"
        );
    }

    /// The microcontroller's answer for this map is the host's own.
    fn assert_sums(&self, status: &Status, map: &ForceMap, what: &str) {
        let host = sums_of(map, TaxelRule::of(&SETTINGS));
        assert_eq!(status.sums, host, "{what}: sums");
        assert_eq!(
            stick_ratio(&status.sums),
            stick_ratio(&host),
            "{what}: stick ratio"
        );
        assert_eq!(status.sequence, self.sequence, "{what}: sequence");
    }
}

/// 60 taxels of about 0.2 N; `slipping` of them carry more shear than friction 0.45 holds.
fn map(slipping: usize) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for n in 0..60 {
        let taxel = 120 + n / 10 * 20 + n % 10;
        map.taxels[taxel] = TaxelForce {
            x: if n < slipping { 500 } else { 150 },
            y: -60,
            z: 800 + n as i16,
        };
    }
    map
}

fn feed_forward(map: &ForceMap) -> i32 {
    let shear = i64::from(total_shear(&sums_of(map, TaxelRule::of(&SETTINGS))));
    let share = i64::from(PER_UNIT) + i64::from(SETTINGS.margin);
    (shear * share / i64::from(SETTINGS.friction)) as i32
}

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
    let told = DAC_LIVE_ZERO.code(GripForce::from_lsb(later.line));
    assert!(
        board.session.line_code() >= Some(told),
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
fn two_runs_of_the_emulated_board_are_the_same() {
    let script = || {
        let mut board = Board::holding();
        let mut seen = Vec::new();
        for slipping in [0, 30, 60] {
            let status = board.maps(&map(slipping), 5);
            seen.push((
                Status {
                    uptime_ms: 0,
                    ..status
                },
                board.session.line_code(),
            ));
        }
        seen
    };
    assert_eq!(script(), script());
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn noise_on_the_line_before_a_map_does_not_cost_the_map() {
    let mut link = EmulatorLink::spawn().unwrap();
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
