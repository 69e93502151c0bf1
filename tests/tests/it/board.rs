//! The emulated board with a session on it, and maps to show it: what the tests on the unmodified image share.
#![allow(dead_code, reason = "every test program takes its share")]

use std::cell::{Ref, RefCell, RefMut};
use std::path::Path;
use std::rc::Rc;

use gripline_firmware::line::DAC_LIVE_ZERO;
use gripline_firmware::sums::{TaxelRule, stick_ratio, sums_of, total_shear};
use gripline_firmware::{Fault, GripForce};
use gripline_link::session::Session;
use gripline_link::{EmulatorLink, Link, LinkError, Transport};
use gripline_protocol::message::{Command, Configuration, Refusal, Status};
use gripline_protocol::{ForceMap, MapInfo, PER_UNIT, TaxelForce, encode_map};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

/// The DAC's holding register of the line (RM0090, DAC_DHR12R1).
pub(crate) const DAC: u32 = 0x4000_7408;
/// 60 maps a second.
pub(crate) const FRAME_US: u64 = 16_667;

/// No relaxing and no reflex while it sticks: what the line comes to follows from shear and friction alone.
pub(crate) const SETTINGS: Configuration = Configuration {
    relax_rate: 0,
    ..Configuration::CAREFUL
};

/// What a board has that nobody configured.
pub(crate) const SHIPPED: Configuration = Configuration::DEFAULT;

/// A link that the test keeps a hand on while the session has it.
pub(crate) struct Shared(Rc<RefCell<EmulatorLink>>);

impl Link for Shared {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        self.0.borrow_mut().send(packet)
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        self.0.borrow_mut().run_until(until_us, received)
    }

    fn now_us(&self) -> u64 {
        self.0.borrow().now_us()
    }

    fn name(&self) -> String {
        self.0.borrow().name()
    }

    fn line_code(&self) -> Option<u16> {
        self.0.borrow().line_code()
    }
}

pub(crate) struct Board {
    pub(crate) session: Session,
    pub(crate) link: Rc<RefCell<EmulatorLink>>,
    pub(crate) sequence: u32,
}

impl Board {
    pub(crate) fn boot() -> Self {
        Self::boot_over(Transport::Usb)
    }

    pub(crate) fn boot_over(transport: Transport) -> Self {
        let mut board = Self::connected(transport, None);
        board.session.configure(SETTINGS).expect("the settings are taken");
        board
    }

    /// With its own settings in force: those that `settings` keeps over power cycles.
    pub(crate) fn connected(transport: Transport, settings: Option<&Path>) -> Self {
        let link = EmulatorLink::spawn_with_settings(transport, settings)
            .expect("emulator and image are there: cargo xtask emulator");
        let link = Rc::new(RefCell::new(link));
        let session = Session::connect(Box::new(Shared(Rc::clone(&link)))).expect("the firmware answers");
        Self {
            session,
            link,
            sequence: 0,
        }
    }

    /// Holds with the settings as shipped: maps that stick, until the line rests above its floor.
    pub(crate) fn holding_as_shipped() -> (Self, Status) {
        Self::holding_as_shipped_over(Transport::Usb)
    }

    /// The same over either link.
    pub(crate) fn holding_as_shipped_over(transport: Transport) -> (Self, Status) {
        let mut board = Self::connected(transport, None);
        assert_eq!(*board.session.settings(), SHIPPED);
        board.session.command(Command::Hold).unwrap();
        let held = board.maps(&map(0), 60);
        assert_eq!((held.faults, held.latched), (0, 0));
        assert!(held.line > SHIPPED.floor && held.line < SHIPPED.fail_safe);
        (board, held)
    }

    pub(crate) fn link(&self) -> Ref<'_, EmulatorLink> {
        self.link.borrow()
    }

    pub(crate) fn link_mut(&self) -> RefMut<'_, EmulatorLink> {
        self.link.borrow_mut()
    }

    /// Hands a map over without waiting for anything.
    pub(crate) fn send(&mut self, map: &ForceMap) {
        self.sequence += 1;
        let info = MapInfo {
            sequence: self.sequence,
            capture_us: self.session.capture_us(),
            ..MapInfo::default()
        };
        self.session.send_map(&info, map).unwrap();
    }

    /// Waits in steps of a millisecond until `reached`; panics when that takes longer than `limit_ms`.
    pub(crate) fn wait_for(&mut self, limit_ms: u64, what: &str, mut reached: impl FnMut(&Self) -> bool) {
        for _ in 0..limit_ms {
            self.session.run_until(self.session.now_us() + 1_000).unwrap();
            if reached(self) {
                return;
            }
        }
        panic!(
            "{what}: not within {limit_ms} ms; status {:?}",
            self.session.status()
        );
    }

    /// Hands a map over and returns the status that answers it.
    pub(crate) fn answer(&mut self, map: &ForceMap) -> Status {
        self.send(map);
        let sequence = self.sequence;
        let is_answer = |board: &Self| {
            let status = board.session.status();
            status.is_some_and(|status| status.sequence == sequence)
        };
        self.wait_for(20, "the answer to a map", is_answer);
        *self.session.status().expect("the answer")
    }

    /// Maps a second that the firmware takes when `maps` are handed over at once and the bus is never idle.
    pub(crate) fn rate(&mut self, maps: &[ForceMap]) -> f64 {
        let before = self.wait(200_000);
        let start_us = self.session.now_us();
        for map in maps {
            self.send(map);
        }
        self.wait_for(5_000, "the last map", |board| board.link().waiting() == 0);
        let taken_us = self.session.now_us() - start_us;
        let after = self.wait(200_000);
        assert_eq!(after.sequence, self.sequence);
        assert_eq!(after.maps - before.maps, maps.len() as u32, "maps accepted");
        assert_eq!(after.maps_refused, before.maps_refused, "maps refused");
        assert_eq!(self.session.shadow().mismatches(), 0);
        maps.len() as f64 * 1e6 / taken_us as f64
    }

    pub(crate) fn holding() -> Self {
        let mut board = Self::boot();
        board.session.command(Command::Hold).unwrap();
        board
    }

    /// A fresh status, asked for.
    pub(crate) fn status(&mut self) -> Status {
        self.session.command(Command::ReadStatus).unwrap();
        self.wait(30_000)
    }

    pub(crate) fn codes_since(&self, writes: usize) -> Vec<u16> {
        self.link().line_writes()[writes..]
            .iter()
            .map(|write| write.code)
            .collect()
    }

    pub(crate) fn writes(&self) -> usize {
        self.link().line_writes().len()
    }

    /// Acknowledges everything and shows that nothing is left.
    pub(crate) fn acknowledge_all(&mut self) {
        self.session
            .command(Command::Acknowledge { faults: u32::MAX })
            .unwrap();
        let status = self.maps(&map(0), 3);
        assert_eq!((status.faults, status.latched), (0, 0));
    }

    pub(crate) fn refusal(&mut self, command: Command) -> Option<Refusal> {
        self.session.take_refusal();
        self.session.command(command).unwrap();
        self.wait(30_000);
        self.session.take_refusal()
    }

    /// Sends a map with something about it.
    pub(crate) fn odd_map(&mut self, map: &ForceMap, change: impl FnOnce(&mut MapInfo)) -> Status {
        self.sequence += 1;
        let mut info = MapInfo {
            sequence: self.sequence,
            capture_us: self.session.capture_us(),
            ..MapInfo::default()
        };
        change(&mut info);
        self.session.send_map(&info, map).unwrap();
        self.wait(FRAME_US)
    }

    pub(crate) fn wait(&mut self, us: u64) -> Status {
        self.session.run_until(self.session.now_us() + us).unwrap();
        *self.session.status().expect("a status came")
    }

    /// Sends a map 60 times a second for this many maps; returns the status after the last.
    pub(crate) fn maps(&mut self, map: &ForceMap, count: u32) -> Status {
        for _ in 0..count {
            self.send(map);
            self.wait(FRAME_US);
        }
        *self.session.status().unwrap()
    }

    /// Sends thirty maps with a wrong bit, and a packet of nonsense after each.
    pub(crate) fn storm(&mut self) {
        for round in 0..30_u8 {
            let mut packets = Vec::new();
            encode_map(&MapInfo::default(), &map(60), |packet| {
                packets.push(packet.to_vec());
            });
            packets[1][7] ^= 1 << (round % 8);
            for packet in &packets {
                self.session.send_raw(packet).unwrap();
            }
            self.session.send_raw(&[round; 64]).unwrap();
        }
        self.wait(30_000);
    }

    /// The DAC shows the very force that the status tells, as the live-zero line demands.
    pub(crate) fn assert_line(&self, status: &Status, expected_lsb: i32, what: &str) {
        assert_eq!(status.line, expected_lsb, "{what}: the line in the status");
        let code = code(expected_lsb);
        assert_eq!(
            self.session.line_code(),
            Some(code),
            "{what}: the code on the DAC"
        );
    }

    /// The microcontroller's answer for this map is the host's own.
    pub(crate) fn assert_sums(&self, status: &Status, map: &ForceMap, what: &str) {
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

pub(crate) fn code(lsb: i32) -> u16 {
    DAC_LIVE_ZERO.code(GripForce::from_lsb(lsb)).0
}

#[track_caller]
pub(crate) fn assert_has(status: &Status, fault: Fault) {
    assert_ne!(status.faults & fault.bit(), 0, "{} in {status:?}", fault.name());
}

#[track_caller]
pub(crate) fn assert_has_not(status: &Status, fault: Fault) {
    assert_eq!(status.faults & fault.bit(), 0, "{} in {status:?}", fault.name());
}

/// 60 taxels of about 0.2 N; `slipping` of them carry more shear than friction 0.45 holds.
pub(crate) fn map(slipping: usize) -> ForceMap {
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

/// A seeded mixture of maps, from empty to dense, their forces anything that a taxel can carry.
pub(crate) struct Mixture(Pcg64Mcg);

impl Mixture {
    pub(crate) fn new() -> Self {
        Self(Pcg64Mcg::new(0x6772_6970))
    }

    /// A map with this many taxels in contact, of which about half carry more shear than friction 0.45 holds.
    pub(crate) fn map(&mut self, contacts: usize) -> ForceMap {
        let mut map = ForceMap::EMPTY;
        let mut left = contacts;
        for (place, taxel) in map.taxels.iter_mut().enumerate() {
            if self.0.random_range(0..400 - place) < left {
                left -= 1;
                let z = self.0.random_range(1..=i16::MAX);
                let shear = i32::from(z) * 6 / 10;
                *taxel = TaxelForce {
                    x: self.0.random_range(-shear..=shear) as i16,
                    y: self.0.random_range(-shear..=shear) as i16,
                    z,
                };
            }
        }
        map
    }

    /// Every fourth empty, every fourth dense, the rest in between.
    pub(crate) fn next(&mut self, number: usize) -> ForceMap {
        match number % 4 {
            0 => ForceMap::EMPTY,
            1 => self.map(400),
            _ => {
                let contacts = self.0.random_range(1..400);
                self.map(contacts)
            }
        }
    }
}

pub(crate) fn feed_forward(map: &ForceMap) -> i32 {
    let shear = i64::from(total_shear(&sums_of(map, TaxelRule::of(&SETTINGS))));
    let share = i64::from(PER_UNIT) + i64::from(SETTINGS.margin);
    (shear * share / i64::from(SETTINGS.friction)) as i32
}
