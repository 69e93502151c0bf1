//! An hour of random faults, and no wrong value on the line: a judge that knows only what was sent and when, and what
//! `docs/safety.md` says of it, looks at every value that the line shows.
//!
//! The firmware library runs the whole hour on a clock of its own. The unmodified image runs `GRIPLINE_FAULT_SECONDS`
//! (60 unless set) of emulated time on the emulated board. Units: µs of the run's clock, forces in 1/4096 N.

use std::collections::VecDeque;

use gripline_firmware::line::DAC_LIVE_ZERO;
use gripline_firmware::sums::{TaxelRule, sums_of, total_shear};
use gripline_firmware::{Fault, GripForce, ResetCause, Start};
use gripline_link::emulator::{Cable, Disturbance, FaultInjection};
use gripline_link::{EmulatorLink, Link, Transport};
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets, Report};
use gripline_protocol::{Event, ForceMap, Health, MapInfo, PER_UNIT, Parser, TaxelForce, encode_map};
use gripline_test_board::TestBoard;
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

const STEP_US: u64 = 1_000;
/// 60 maps a second.
const FRAME_MS: u64 = 16;
/// The most that passes at once: every piece costs a round trip between processes, and on a busy machine those are what
/// an hour takes.
const PIECE_MS: u64 = FRAME_MS;
/// The watchdog's register, whose next touch hangs: the idle loop spins, and the watchdog starves.
const WATCHDOG_KEY: u32 = 0x4000_3000;
/// What the hour must raise at least, so that it proves something.
const RAISED: [Fault; 15] = [
    Fault::StaleMaps,
    Fault::LinkLost,
    Fault::CrcStorm,
    Fault::ReplayedMap,
    Fault::MapsLost,
    Fault::UnhealthyMap,
    Fault::OutOfRange,
    Fault::UnreadableMessage,
    Fault::SchemaMismatch,
    Fault::WatchdogReset,
    Fault::LineAtCeiling,
    Fault::SaturatedMap,
    Fault::FutureMap,
    Fault::Undervoltage,
    Fault::ObjectLost,
];

/// A microcontroller in a world where cables come out and programs hang.
trait World {
    fn now_us(&self) -> u64;
    fn send(&mut self, packet: &[u8]);
    /// Lets so many milliseconds pass and hands over every force that the line showed in them, with its time.
    fn step(&mut self, ms: u64, shown: &mut dyn FnMut(u64, i32));
    fn plug(&mut self, plugged: bool);
    /// Whether a host could speak to it now.
    fn is_ready(&self) -> bool;
    /// Has it hang; some time later the watchdog resets it.
    fn hang(&mut self);
    /// The supply dips below the brown-out level.
    fn brown_out(&mut self);
    fn resets(&self) -> usize;
    /// Faults reported or latched since the start, as bits.
    fn reported(&self) -> u32;
    /// How exactly the line can be read, 1/4096 N.
    fn resolution(&self) -> i32;
    /// How late a packet or a tick may take effect, µs.
    fn slack_us(&self) -> u64;
}

/// The firmware library on a simulated clock.
struct LibraryWorld {
    board: TestBoard,
    plugged: bool,
    reset_at_us: Option<u64>,
    reset_cause: ResetCause,
    resets: usize,
    reported: u32,
    shown: Vec<i32>,
}

impl LibraryWorld {
    fn new() -> Self {
        Self {
            board: TestBoard::new(Start::default()),
            plugged: true,
            reset_at_us: None,
            reset_cause: ResetCause::Watchdog,
            resets: 0,
            reported: 0,
            shown: Vec::new(),
        }
    }

    fn tick(&mut self, shown: &mut dyn FnMut(u64, i32)) {
        let from_us = self.board.now_us();
        for line in self.shown.drain(..) {
            shown(from_us, line);
        }
        if self.reset_at_us.is_some_and(|at_us| from_us + STEP_US >= at_us) {
            self.board.reset(self.reset_cause, 0);
            self.reset_at_us = None;
            self.resets += 1;
        }
        let reported = &mut self.reported;
        self.board.pass_to(from_us + STEP_US, |program, _| {
            shown(from_us, program.line().lsb());
            let status = program.status();
            *reported |= status.faults | status.latched;
        });
        self.board.replies.clear();
    }
}

impl World for LibraryWorld {
    fn now_us(&self) -> u64 {
        self.board.now_us()
    }

    fn send(&mut self, packet: &[u8]) {
        if self.plugged
            && let Some(action) = self.board.packet(packet)
        {
            self.shown.push(action.line.lsb());
        }
    }

    fn step(&mut self, ms: u64, shown: &mut dyn FnMut(u64, i32)) {
        for _ in 0..ms {
            self.tick(shown);
        }
    }

    fn plug(&mut self, plugged: bool) {
        self.plugged = plugged;
    }

    fn is_ready(&self) -> bool {
        self.plugged && self.board.is_up()
    }

    fn hang(&mut self) {
        self.reset_cause = ResetCause::Watchdog;
        self.reset_at_us = Some(self.board.now_us() + 100_000);
        self.board.stop_until(u64::MAX);
    }

    fn brown_out(&mut self) {
        self.reset_cause = ResetCause::BrownOut;
        self.reset_at_us = Some(self.now_us());
    }

    fn resets(&self) -> usize {
        self.resets
    }

    fn reported(&self) -> u32 {
        self.reported
    }

    fn resolution(&self) -> i32 {
        1
    }

    fn slack_us(&self) -> u64 {
        2_000
    }
}

/// The unmodified image on the emulated board.
struct BoardWorld {
    link: EmulatorLink,
    cable: Cable,
    replies: Parser,
    reported: u32,
    writes: usize,
}

impl BoardWorld {
    fn new() -> Self {
        let link = EmulatorLink::spawn(Transport::Usb).expect("emulator and image are there");
        Self {
            link,
            cable: Cable::In,
            replies: Parser::new(),
            reported: 0,
            writes: 0,
        }
    }
}

/// The greatest force that shows as this code.
fn force_of(code: u16) -> i32 {
    let mut range = (0, 40 * 4_096);
    while range.0 < range.1 {
        let middle = (range.0 + range.1 + 1) / 2;
        if DAC_LIVE_ZERO.code(GripForce::from_lsb(middle)).0 <= code {
            range.0 = middle;
        } else {
            range.1 = middle - 1;
        }
    }
    range.0
}

impl World for BoardWorld {
    fn now_us(&self) -> u64 {
        self.link.now_us()
    }

    fn send(&mut self, packet: &[u8]) {
        if self.cable == Cable::In {
            self.link.send(packet).unwrap();
        }
    }

    fn step(&mut self, ms: u64, shown: &mut dyn FnMut(u64, i32)) {
        let Self {
            replies, reported, ..
        } = self;
        let mut listen = |packet: &[u8]| {
            if let Ok(Event::Message(bytes)) = replies.push(packet)
                && let Ok(Message::Report(Report::Status(status))) = Message::from_bytes(bytes)
            {
                *reported |= status.faults | status.latched;
            }
        };
        let until_us = self.link.now_us() + ms * STEP_US;
        self.link.run_until(until_us, &mut listen).unwrap();
        // The line's times count from power-on.
        let since_us = self.link.powered_ns() / 1_000 - until_us;
        for write in &self.link.line_writes()[self.writes..] {
            shown(
                (write.at_ns / 1_000).saturating_sub(since_us),
                force_of(write.code),
            );
        }
        self.writes = self.link.line_writes().len();
    }

    fn plug(&mut self, plugged: bool) {
        self.cable = if plugged { Cable::In } else { Cable::Out };
        self.link.set_cable(self.cable);
    }

    fn is_ready(&self) -> bool {
        self.cable == Cable::In && self.link.is_configured()
    }

    fn hang(&mut self) {
        self.link.inject_fault(FaultInjection::Hang, WATCHDOG_KEY);
    }

    fn brown_out(&mut self) {
        self.link.disturb(Disturbance::BrownOut { forgets: false });
    }

    fn resets(&self) -> usize {
        self.link.resets() as usize
    }

    fn reported(&self) -> u32 {
        self.reported
    }

    fn resolution(&self) -> i32 {
        // A code is 50 units wide.
        51
    }

    fn slack_us(&self) -> u64 {
        30_000
    }
}

/// What the table allows, from what was sent. A fault counts as certain when it must be there whatever the delays;
/// only then is more demanded of the line.
#[derive(Default)]
struct Judge {
    /// In force from every beginning on; a reset leads back to the default ones, until the host sets these again.
    settings: Configuration,
    slack_us: u64,
    resolution: i32,
    line: i32,
    now_us: u64,
    /// When `Hold` went out; none while a `Release` may be in force.
    held_us: Option<u64>,
    readable_us: u64,
    fresh_us: u64,
    /// Since when the newest map is one that holds the line (doubtful, saturated, replayed, from the future).
    doubt_us: Option<u64>,
    /// Since when a fault must be latched: lost link, storm, watchdog reset.
    link_latched_us: Option<u64>,
    storm_latched_us: Option<u64>,
    reset_latched_us: Option<u64>,
    /// Feed-forward of the maps accepted lately.
    wanted: VecDeque<(u64, i32)>,
    /// The line at times, against falling faster than the plan.
    anchor: (u64, i32),
    /// How often each demand was looked at.
    looks: [u64; 6],
    /// What the line showed lately and in which phase, for whoever has to find out why.
    lately: VecDeque<(u64, i32, String)>,
}

/// The demands, in the order of [`Judge::looks`].
const DEMANDS: [&str; 6] = [
    "never above the ceiling",
    "a fault that holds: no fall",
    "a lost link: at least the fail-safe force",
    "holding: at least the floor",
    "holding: what friction needs for the maps of the last third of a second",
    "falling: no faster than the plan or a release allow",
];

impl Judge {
    fn since(&self, start_us: u64, limit_us: u64) -> bool {
        self.now_us > start_us + limit_us + self.slack_us
    }

    fn stale(&self, held_us: u64) -> bool {
        self.since(
            self.fresh_us.max(held_us),
            u64::from(self.settings.stale_ms) * 1_000,
        )
    }

    fn passed(&self, start: Option<u64>) -> bool {
        start.is_some_and(|us| self.since(us, 0))
    }

    /// A fault that forbids falling must be there.
    fn must_hold(&self, held_us: u64) -> bool {
        self.stale(held_us)
            || [
                self.doubt_us,
                self.link_latched_us,
                self.storm_latched_us,
                self.reset_latched_us,
            ]
            .into_iter()
            .any(|start| self.passed(start))
    }

    fn may_be_released(&self) -> bool {
        !(self.passed(self.link_latched_us)
            || self.passed(self.storm_latched_us)
            || self.passed(self.reset_latched_us))
    }

    /// Time for the line to come up to a force, µs.
    fn rise_us(&self, force: i32) -> u64 {
        (i64::from(force) * 1_000 / i64::from(self.settings.rise_rate)) as u64
    }

    fn step(&mut self, now_us: u64) {
        self.now_us = now_us;
        if let Some(held_us) = self.held_us
            && self.link_latched_us.is_none()
            && self.since(
                self.readable_us.max(held_us),
                u64::from(self.settings.link_lost_ms) * 1_000,
            )
        {
            self.link_latched_us = Some(now_us);
        }
        let window_us = self.rise_us(self.settings.ceiling) + 2 * self.slack_us;
        while self.wanted.len() > 1 && self.wanted[1].0 + window_us < now_us {
            self.wanted.pop_front();
        }
    }

    /// Looks at the line every millisecond until then.
    fn watch(&mut self, until_us: u64, what: &str) {
        while self.now_us + STEP_US <= until_us {
            self.look(self.line, what);
            self.step(self.now_us + STEP_US);
        }
    }

    /// Looks at what the line shows now.
    fn look(&mut self, line: i32, what: &str) {
        let (before, tolerance) = (self.line, self.resolution);
        self.line = line;
        if line != before {
            self.lately.push_back((self.now_us, line, what.to_owned()));
            if self.lately.len() > 40 {
                self.lately.pop_front();
            }
        }
        let fail = |demand: usize, expected: i32| {
            panic!(
                "{}: line {line} after {before}, expected {expected}, at {} µs in {what}; lately {:#?}",
                DEMANDS[demand], self.now_us, self.lately
            );
        };
        let mut looked = [true, false, false, false, false, true];
        if line > self.settings.ceiling + tolerance {
            fail(0, self.settings.ceiling);
        }
        let held = self.held_us.filter(|&us| self.since(us, 0));
        if let Some(held_us) = held {
            if self.must_hold(held_us) {
                looked[1] = true;
                if line < before {
                    fail(1, before);
                }
            }
            if let Some(us) = self.link_latched_us
                && self.since(us, self.rise_us(self.settings.fail_safe))
            {
                looked[2] = true;
                if line < self.settings.fail_safe - tolerance {
                    fail(2, self.settings.fail_safe);
                }
            }
            if self.since(held_us, self.rise_us(self.settings.floor)) {
                looked[3] = true;
                if line < self.settings.floor - tolerance {
                    fail(3, self.settings.floor);
                }
            }
            let window_us = self.rise_us(self.settings.ceiling) + 2 * self.slack_us;
            let whole = self
                .wanted
                .front()
                .is_some_and(|(us, _)| us + window_us < self.now_us)
                && held_us + window_us < self.now_us
                && !self.stale(held_us);
            if let (true, Some(min)) = (whole, self.wanted.iter().map(|(_, force)| *force).min()) {
                looked[4] = true;
                if line < min.min(self.settings.ceiling) - tolerance {
                    fail(4, min);
                }
            }
        }
        // Over half a second, so that rounding does not hide a slow fall.
        let passed_us = self.now_us - self.anchor.0;
        let rate_per_s = if held.is_some() {
            // A controller that learns takes back at the release's rate what a test of a slide added.
            let after_a_test =
                i64::from(self.settings.release_rate) * 1_000 * i64::from(self.settings.learns());
            i64::from(self.settings.relax_rate).max(after_a_test)
        } else {
            i64::from(self.settings.release_rate) * 1_000
        };
        let fall = rate_per_s * (passed_us + STEP_US + self.slack_us) as i64 / 1_000_000;
        if i64::from(self.anchor.1 - line) > fall + i64::from(2 * tolerance) {
            fail(5, self.anchor.1 - fall as i32);
        }
        if passed_us > 500_000 || held.is_none() {
            self.anchor = (self.now_us, line);
        }
        for (count, looked) in self.looks.iter_mut().zip(looked) {
            *count += u64::from(looked);
        }
    }
}

/// The host, gone mad: what it does is drawn by chance.
struct Host<W> {
    world: W,
    judge: Judge,
    dice: Pcg64Mcg,
    sequence: u32,
    id: u8,
    session: u32,
    phases: [u64; PHASES],
}

const PHASES: usize = 22;

impl<W: World> Host<W> {
    fn new(world: W, settings: Configuration, seed: u64) -> Self {
        let judge = Judge {
            settings,
            slack_us: world.slack_us(),
            resolution: world.resolution(),
            ..Judge::default()
        };
        Self {
            world,
            judge,
            dice: Pcg64Mcg::new(seed.into()),
            sequence: 0,
            id: 0,
            session: 0,
            phases: [0; PHASES],
        }
    }

    fn message(&mut self, message: &Message) {
        self.id = self.id.wrapping_add(1);
        for packet in MessagePackets::new(message, self.id).unwrap() {
            self.world.send(&packet);
        }
        self.judge.readable_us = self.world.now_us();
    }

    fn command(&mut self, command: Command) {
        self.message(&Message::Command(command));
    }

    fn hello(&mut self) {
        self.session += 1;
        self.message(&Message::Hello(Hello::of_this_build(0, self.session)));
    }

    /// A new start for both sides: handshake, a prompt map, and hold.
    fn begin(&mut self) {
        self.hello();
        self.command(Command::Configure(self.judge.settings));
        let map = self.map(60, 0);
        self.good_map(&map, Health::GOOD);
        self.hold();
    }

    fn hold(&mut self) {
        self.command(Command::Hold);
        if self.judge.held_us.is_none() {
            self.judge.wanted.clear();
            self.judge.held_us = Some(self.world.now_us());
        }
    }

    fn wait(&mut self, ms: u64, what: &str) {
        let mut left_ms = ms;
        while left_ms > 0 {
            let piece_ms = left_ms.min(PIECE_MS);
            left_ms -= piece_ms;
            let resets = self.world.resets();
            let Self { world, judge, .. } = self;
            judge.step(world.now_us());
            world.step(piece_ms, &mut |at_us, line| {
                judge.watch(at_us, what);
                judge.look(line, what);
            });
            judge.watch(world.now_us(), what);
            if self.world.resets() != resets {
                self.was_reset(what);
            }
        }
    }

    /// The program lost everything but the line: it holds, waits for a host and for an acknowledgement.
    fn was_reset(&mut self, what: &str) {
        let now_us = self.world.now_us();
        self.judge.reset_latched_us = Some(now_us);
        self.judge.storm_latched_us = None;
        self.judge.link_latched_us = None;
        self.judge.doubt_us = None;
        self.judge.wanted.clear();
        self.judge.fresh_us = now_us;
        self.judge.readable_us = now_us;
        self.get_ready(what);
    }

    fn get_ready(&mut self, what: &str) {
        for _ in 0..3_000 {
            if self.world.is_ready() {
                self.begin();
                return;
            }
            self.wait(1, what);
        }
        panic!("not ready 3 s after {what}");
    }

    fn info(&mut self) -> MapInfo {
        self.sequence = self.sequence.wrapping_add(1);
        MapInfo {
            sequence: self.sequence,
            capture_us: self.world.now_us() as u32,
            ..MapInfo::default()
        }
    }

    fn packets(info: &MapInfo, map: &ForceMap) -> Vec<Vec<u8>> {
        let mut packets = Vec::new();
        encode_map(info, map, |packet| packets.push(packet.to_vec()));
        packets
    }

    fn send_map(&mut self, info: &MapInfo, map: &ForceMap) {
        for packet in Self::packets(info, map) {
            self.world.send(&packet);
        }
        self.judge.readable_us = self.world.now_us();
    }

    fn good_map(&mut self, map: &ForceMap, health: Health) {
        let info = MapInfo {
            health,
            ..self.info()
        };
        self.send_map(&info, map);
        let now_us = self.world.now_us();
        self.judge.fresh_us = now_us;
        self.judge.doubt_us = (!health.is_good()).then_some(now_us);
        let settings = self.judge.settings;
        let shear = i64::from(total_shear(&sums_of(map, TaxelRule::of(&settings))));
        let share = i64::from(PER_UNIT) + i64::from(settings.margin);
        let force = if settings.learns() {
            // No friction beyond the most is ever learnt. A load that is a sixteenth more than what is held is a
            // fluctuation, and followed slowly.
            shear * 16 / 17 * share / i64::from(settings.friction_max)
        } else {
            shear * share / i64::from(settings.friction)
        };
        self.judge
            .wanted
            .push_back((now_us, force.min(i64::from(settings.ceiling)) as i32));
    }

    /// `contacts` taxels that press with 0.2 N, `slipping` of them with more shear than friction 0.45 holds.
    fn map(&mut self, contacts: usize, slipping: usize) -> ForceMap {
        let mut map = ForceMap::EMPTY;
        for taxel in 0..contacts {
            map.taxels[taxel * 3 % 400] = TaxelForce {
                x: if taxel < slipping { 500 } else { 150 },
                y: self.dice.random_range(-60..=60),
                z: self.dice.random_range(700..900),
            };
        }
        map
    }

    fn stream(&mut self, ms: u64, contacts: usize, slipping: usize, health: Health, what: &str) {
        for _ in 0..ms.div_ceil(FRAME_MS) {
            let map = self.map(contacts, slipping);
            self.good_map(&map, health);
            self.wait(FRAME_MS, what);
        }
    }

    fn acknowledge(&mut self) {
        self.command(Command::Acknowledge { faults: u32::MAX });
        self.judge.link_latched_us = None;
        self.judge.storm_latched_us = None;
        self.judge.reset_latched_us = None;
    }

    #[expect(clippy::too_many_lines, reason = "a list of injected faults")]
    fn phase(&mut self) {
        // Often enough that most injected faults come to a controller with nothing latched.
        if self.dice.random_range(0..3) == 0 {
            self.acknowledge();
        }
        let phase = self.dice.random_range(0..PHASES);
        self.phases[phase] += 1;
        let ms = self.dice.random_range(20..900);
        match phase {
            0 | 1 => self.stream(3 * ms, 60, 0, Health::GOOD, "sticking maps"),
            2 => self.stream(ms, 60, 45, Health::GOOD, "slipping maps"),
            3 => {
                for _ in 0..ms / FRAME_MS {
                    let contacts = self.dice.random_range(0..120);
                    let slipping = self.dice.random_range(0..=contacts);
                    self.stream(1, contacts, slipping, Health::GOOD, "random maps");
                }
            }
            4 => self.stream(ms, 0, 0, Health::GOOD, "empty maps"),
            5 => {
                for _ in 0..ms / 20 {
                    self.command(Command::ReadStatus);
                    self.wait(20, "a host without maps");
                }
            }
            6 => self.wait(2 * ms, "silence"),
            7 => {
                for round in 0..30 {
                    self.world.send(&[round; 40]);
                }
                self.judge.storm_latched_us.get_or_insert(self.world.now_us());
                self.stream(ms / 2, 60, 0, Health::GOOD, "a storm of bad packets");
            }
            8 => {
                // A number that was never accepted, of a map from the future, would be no replay.
                self.stream(1, 60, 60, Health::GOOD, "the map that is replayed");
                let map = self.map(60, 60);
                for back in 0..ms as u32 / 16 {
                    let info = MapInfo {
                        sequence: self.sequence.wrapping_sub(back),
                        capture_us: self.world.now_us() as u32,
                        ..MapInfo::default()
                    };
                    self.send_map(&info, &map);
                    self.judge.doubt_us.get_or_insert(self.world.now_us());
                    self.wait(FRAME_MS, "replayed maps");
                }
            }
            9 | 10 => {
                let (future, what) = if phase == 9 {
                    (2_000_000, "maps from the future")
                } else {
                    (-130_000_i32, "maps of long ago")
                };
                for _ in 0..ms / FRAME_MS {
                    let map = self.map(60, 0);
                    let mut info = self.info();
                    info.capture_us = info.capture_us.wrapping_add_signed(future);
                    self.send_map(&info, &map);
                    if phase == 9 {
                        self.judge.doubt_us.get_or_insert(self.world.now_us());
                    } else {
                        // Accepted, good, and old: nothing about the picture holds the line any more.
                        self.judge.doubt_us = None;
                    }
                    self.judge.wanted.clear();
                    self.wait(FRAME_MS, what);
                }
            }
            11 => {
                let flags = 1 << self.dice.random_range(0..4);
                self.stream(2 * ms, 60, 0, Health::from_bits(flags), "doubtful maps");
            }
            12 => self.stream(2 * ms, 60, 0, Health::SATURATED, "saturated maps"),
            13 => {
                for _ in 0..100 {
                    let class = self.dice.random_range(3..=255);
                    self.unreadable(class);
                }
                self.stream(ms / 2, 60, 0, Health::GOOD, "unreadable messages");
            }
            14 => {
                let wrong = Configuration {
                    floor: 0,
                    fail_safe: 0,
                    ceiling: i32::MAX,
                    ..self.judge.settings
                };
                for _ in 0..20 {
                    self.command(Command::Configure(wrong));
                }
                self.stream(ms, 60, 0, Health::GOOD, "settings out of range");
            }
            15 => {
                if self.judge.may_be_released() {
                    self.judge.held_us = None;
                }
                self.command(Command::Release);
                self.stream(ms, 60, 0, Health::GOOD, "a release");
                self.hold();
                self.stream(ms, 60, 0, Health::GOOD, "a new hold");
            }
            16 => {
                self.acknowledge();
                self.stream(ms, 60, 0, Health::GOOD, "an acknowledgement");
            }
            17 => {
                // Rare, as on a real bench; each costs a second.
                match self.dice.random_range(0..6) {
                    0 => {
                        self.world.hang();
                        self.wait(250, "a program that hangs");
                    }
                    1 => {
                        self.world.brown_out();
                        self.wait(5, "a brown-out");
                    }
                    _ => {}
                }
            }
            18 => {
                let map = self.map(110, 0);
                let info = self.info();
                for packet in Self::packets(&info, &map).iter().take(4) {
                    self.world.send(packet);
                }
                self.judge.readable_us = self.world.now_us();
                self.wait(1, "a cable pulled in mid map");
                self.world.plug(false);
                self.wait(2 * ms, "a cable that is out");
                self.world.plug(true);
                self.wait(5, "a cable plugged in");
                self.get_ready("a cable plugged in");
            }
            19 => {
                self.sequence = self.sequence.wrapping_add(self.dice.random_range(1..5));
                self.stream(ms / 2, 60, 0, Health::GOOD, "lost maps");
            }
            20 => {
                for _ in 0..ms / FRAME_MS {
                    let map = self.map(60, 60);
                    let info = self.info();
                    let mut packets = Self::packets(&info, &map);
                    let place = self.dice.random_range(0..packets.len());
                    let byte = self.dice.random_range(4..packets[place].len());
                    packets[place][byte] ^= 1 << self.dice.random_range(0..8);
                    for packet in &packets {
                        self.world.send(packet);
                    }
                    // Parts of it could be read, so the link counts as alive, and no more is sure.
                    self.judge.readable_us = self.world.now_us();
                    self.wait(FRAME_MS, "maps with a wrong bit");
                }
            }
            _ => {
                let stranger = Hello {
                    schema_version: 7,
                    ..Hello::of_this_build(0, 1)
                };
                self.message(&Message::Hello(stranger));
                self.stream(ms / 2, 60, 0, Health::GOOD, "a host of another schema");
                self.begin();
            }
        }
    }

    /// A message whose CRC is right and whose class does not exist; nothing that proves a host.
    fn unreadable(&mut self, class: u8) {
        let mut packets = MessagePackets::new(&Message::Command(Command::Release), 1).unwrap();
        let mut packet = packets.next().unwrap();
        packet[6] = class;
        let end = packet.len() - 4;
        let crc = gripline_protocol::crc::crc32(packet[..end].iter().copied());
        packet[end..].copy_from_slice(&crc.to_le_bytes());
        self.world.send(&packet);
    }

    fn run(mut self, seconds: u64) {
        self.begin();
        while self.world.now_us() < seconds * 1_000_000 {
            self.phase();
        }
        let looks: Vec<_> = DEMANDS.iter().zip(self.judge.looks).collect();
        println!(
            "{} s, {} phases, {} resets; looks {looks:?}",
            self.world.now_us() / 1_000_000,
            self.phases.iter().sum::<u64>(),
            self.world.resets()
        );
        for (demand, looks) in looks {
            assert!(looks > 0, "never looked at: {demand}");
        }
        if seconds >= 600 {
            for fault in RAISED {
                assert_ne!(
                    self.world.reported() & fault.bit(),
                    0,
                    "never raised: {}",
                    fault.name()
                );
            }
        }
    }
}

#[test]
fn an_hour_of_random_faults_shows_no_wrong_line_in_the_firmware_library() {
    Host::new(LibraryWorld::new(), Configuration::CAREFUL, 1).run(3_600);
}

#[test]
fn an_hour_of_random_faults_shows_no_wrong_line_of_a_grip_that_learns() {
    Host::new(LibraryWorld::new(), Configuration::DEFAULT, 3).run(3_600);
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn random_faults_show_no_wrong_line_on_the_unmodified_image() {
    let seconds = std::env::var("GRIPLINE_FAULT_SECONDS").map_or(60, |text| {
        text.parse()
            .unwrap_or_else(|_| panic!("GRIPLINE_FAULT_SECONDS: found {text}, expected seconds"))
    });
    Host::new(BoardWorld::new(), Configuration::CAREFUL, 2).run(seconds);
}
