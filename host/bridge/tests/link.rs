//! A microcontroller's device that goes away and comes back under a session, and devices that cannot be told apart: a
//! made-up bus and the firmware's library behind the links' own traits, on a clock of the test's own. Times in µs.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use gripline::link::hot_plug::{Clock, Device, DeviceError};
use gripline::link::usb::{Attached, Bus, UsbFinder};
use gripline::link::{HotPlug, LinkError};
use gripline::session::{Session, SessionError};
use gripline_firmware::{Fault, Mcu, Start};
use gripline_protocol::message::{Command, Configuration, GripMode, Hello, Message, MessagePackets};
use gripline_protocol::{Event, ForceMap, MapInfo, PACKET_MAX, Parser, TaxelForce};

const FRAME_US: u64 = 16_667;

/// The world: what is attached, and the one microcontroller in it.
struct World {
    now_us: Cell<u64>,
    attached: RefCell<Vec<Attached>>,
    mcu: RefCell<Mcu>,
    next_tick_us: Cell<u64>,
    /// When the microcontroller took its first packet after the device came back.
    first_packet_us: Cell<Option<u64>>,
    replies: RefCell<VecDeque<Vec<u8>>>,
    /// Nothing is taken though the device is there.
    is_stuck: Cell<bool>,
    /// What it says of itself in the handshake, instead of the truth.
    stranger: Cell<Option<Hello>>,
    opened: Cell<u32>,
}

fn device(serial: &str, place: &str) -> Attached {
    Attached {
        serial: Some(serial.to_owned()),
        place: place.to_owned(),
    }
}

impl World {
    fn with(attached: Vec<Attached>) -> Rc<Self> {
        Rc::new(Self {
            now_us: Cell::new(0),
            attached: RefCell::new(attached),
            mcu: RefCell::new(Mcu::new(Start {
                session: 7,
                ..Start::default()
            })),
            next_tick_us: Cell::new(1_000),
            first_packet_us: Cell::new(None),
            replies: RefCell::default(),
            is_stuck: Cell::new(false),
            stranger: Cell::new(None),
            opened: Cell::new(0),
        })
    }

    /// The microcontroller lives on whether its cable is in or not.
    fn pass_to(&self, until_us: u64) {
        while self.next_tick_us.get() <= until_us {
            let _ = self.mcu.borrow_mut().tick(self.next_tick_us.get());
            self.next_tick_us.set(self.next_tick_us.get() + 1_000);
            self.collect();
        }
        self.now_us.set(until_us.max(self.now_us.get()));
    }

    fn collect(&self) {
        let mut packet = [0; PACKET_MAX];
        while let Some(length) = self.mcu.borrow_mut().poll_transmit(&mut packet) {
            let reply = self.disguised(&packet[..length]);
            self.replies.borrow_mut().push_back(reply);
        }
    }

    /// A handshake says what the stranger would say.
    fn disguised(&self, packet: &[u8]) -> Vec<u8> {
        let mut parser = Parser::new();
        let (Some(stranger), Ok(Event::Message(message))) = (self.stranger.get(), parser.push(packet)) else {
            return packet.to_vec();
        };
        let Ok(Message::Hello(_)) = Message::from_bytes(message) else {
            return packet.to_vec();
        };
        let mut disguised = [0; PACKET_MAX];
        let length = MessagePackets::new(&Message::Hello(stranger), 1)
            .unwrap()
            .next_packet(&mut disguised)
            .unwrap();
        disguised[..length].to_vec()
    }

    fn is_there(&self, serial: &str) -> bool {
        let attached = self.attached.borrow();
        attached
            .iter()
            .any(|device| device.serial.as_deref() == Some(serial))
    }

    fn pull(&self) -> Vec<Attached> {
        // What was on the wire is lost.
        self.replies.borrow_mut().clear();
        self.first_packet_us.set(None);
        self.attached.take()
    }
}

struct FakeClock(Rc<World>);

impl Clock for FakeClock {
    fn now_us(&self) -> u64 {
        self.0.now_us.get()
    }

    fn wait_until(&self, us: u64) {
        self.0.pass_to(us);
    }
}

struct FakeBus(Rc<World>);

impl Bus for FakeBus {
    fn attached(&mut self) -> Result<Vec<Attached>, String> {
        Ok(self.0.attached.borrow().clone())
    }

    fn open(&mut self, number: usize, _link: &str) -> Result<Box<dyn Device>, LinkError> {
        self.0.opened.set(self.0.opened.get() + 1);
        let serial = self.0.attached.borrow()[number].serial.clone();
        Ok(Box::new(FakeDevice {
            world: Rc::clone(&self.0),
            serial: serial.unwrap_or_default(),
        }))
    }
}

struct FakeDevice {
    world: Rc<World>,
    serial: String,
}

impl FakeDevice {
    fn check(&self) -> Result<(), DeviceError> {
        if self.world.is_there(&self.serial) {
            Ok(())
        } else {
            Err(DeviceError::Gone("device disconnected".to_owned()))
        }
    }
}

impl Device for FakeDevice {
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError> {
        self.check()?;
        let world = &self.world;
        if world.is_stuck.get() {
            return Err(DeviceError::Busy);
        }
        let now_us = world.now_us.get();
        if world.first_packet_us.get().is_none() {
            world.first_packet_us.set(Some(now_us));
        }
        let _ = world.mcu.borrow_mut().packet(packet, now_us);
        world.collect();
        Ok(())
    }

    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError> {
        self.check()?;
        self.world
            .pass_to(self.world.now_us.get() + patience.as_micros() as u64);
        while let Some(packet) = self.world.replies.borrow_mut().pop_front() {
            received(&packet);
        }
        Ok(())
    }
}

fn plug(world: &Rc<World>, serial: Option<&str>) -> Result<HotPlug<FakeClock>, LinkError> {
    let finder = UsbFinder::new(FakeBus(Rc::clone(world)), serial.map(str::to_owned));
    HotPlug::open_with(Box::new(finder), FakeClock(Rc::clone(world)))
}

fn refused(attached: Vec<Attached>, serial: Option<&str>) -> String {
    match plug(&World::with(attached), serial) {
        Ok(_) => panic!("it was opened"),
        Err(error) => error.to_string(),
    }
}

#[track_caller]
fn assert_says(error: &str, parts: &[&str]) {
    for part in parts {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}

/// A session that holds.
struct Host {
    world: Rc<World>,
    session: Session,
    sequence: u32,
    lost: u32,
}

impl Host {
    fn holding() -> Self {
        let world = World::with(vec![device("A1", "1-2"), device("B7", "1-4.1")]);
        let link = plug(&world, Some("A1")).unwrap();
        let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        let mut host = Self {
            world,
            session,
            sequence: 0,
            lost: 0,
        };
        assert!(host.session.command(Command::Hold).unwrap());
        host.maps(40);
        assert_eq!(host.session.status().unwrap().mode, GripMode::Hold);
        host
    }

    fn maps(&mut self, count: u32) {
        let mut map = ForceMap::EMPTY;
        map.taxels[100..160].fill(TaxelForce {
            x: 250,
            y: -60,
            z: 800,
        });
        for _ in 0..count {
            self.sequence += 1;
            let info = MapInfo {
                sequence: self.sequence,
                capture_us: self.session.capture_us(),
                ..MapInfo::default()
            };
            self.lost += u32::from(self.session.send_map(&info, &map).unwrap().is_lost);
            self.session.run_until(self.session.now_us() + FRAME_US).unwrap();
        }
    }

    fn line(&self) -> i32 {
        self.world.mcu.borrow().line().lsb()
    }
}

#[test]
fn a_device_that_comes_back_is_met_within_a_second_and_every_map_between_is_counted() {
    for away_frames in [1, 7, 60, 613] {
        let mut host = Host::holding();
        let line = host.line();
        let attached = host.world.pull();
        host.maps(away_frames);
        assert!(host.session.presence().away.is_some());
        assert_eq!(host.lost, away_frames, "each of them and nothing else");
        assert!(host.line() >= line, "nothing lets go because a cable is out");

        let back_us = host.world.now_us.get();
        host.world.attached.replace(attached);
        let answered = host.session.shadow().checked();
        while host.session.shadow().checked() == answered {
            host.maps(1);
        }
        let met_us = host.world.now_us.get() - back_us;
        assert!(met_us < 1_000_000, "{met_us} µs after {away_frames} frames");
        // Greeted first, and nothing was kept for later: the map that is answered is the present one.
        assert_eq!(host.session.status().unwrap().sequence, host.sequence);
        let presence = host.session.presence();
        assert_eq!((presence.losses, presence.away), (1, None));
        assert_eq!(host.session.restarts(), 0, "it kept its power");
        assert_eq!(host.session.shadow().mismatches(), 0);
        assert!(presence.packets_lost >= u64::from(host.lost));
        let latched = host.world.mcu.borrow().status().latched & Fault::LinkLost.bit() != 0;
        assert_eq!(latched, away_frames >= 60, "half a second is a lost link");
    }
}

#[test]
fn a_device_that_flutters_ends_no_session_and_is_counted_each_time() {
    let mut host = Host::holding();
    for round in 1..=50 {
        let attached = host.world.pull();
        host.maps(round % 3);
        host.world.attached.replace(attached);
        host.maps(12);
        assert_eq!(host.session.presence().away, None, "round {round}");
    }
    host.maps(30);
    assert!(host.session.is_sound());
    // A loss that nobody saw, because no packet went either way, is none.
    assert!((33..=50).contains(&host.session.presence().losses));
    assert_eq!(host.session.shadow().mismatches(), 0);
}

#[test]
fn only_the_very_device_is_taken_up_again() {
    // Without a serial number: the only one there is at the beginning.
    let world = World::with(vec![device("A1", "1-2")]);
    let link = plug(&world, None).unwrap();
    let mut session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
    let opened = world.opened.get();
    world.pull();
    world.attached.replace(vec![device("C9", "1-2")]);
    for _ in 0..200 {
        session.run_until(session.now_us() + FRAME_US).unwrap();
    }
    assert_says(
        &session.presence().away.unwrap(),
        &["USB device A1", "found C9 at 1-2"],
    );
    assert_eq!(world.opened.get(), opened);
    // In another socket, beside the other one.
    world.attached.borrow_mut().push(device("A1", "2-1"));
    for _ in 0..20 {
        session.run_until(session.now_us() + FRAME_US).unwrap();
    }
    assert_eq!(session.presence().away, None);
    assert!(session.is_sound());
}

#[test]
fn a_device_that_takes_nothing_costs_the_maps_and_not_the_run() {
    let mut host = Host::holding();
    host.world.is_stuck.set(true);
    host.maps(30);
    assert!(!host.session.command(Command::ReadStatus).unwrap());
    assert_eq!(
        (host.lost, host.session.presence().losses),
        (30, 0),
        "it is there all the time"
    );
    host.world.is_stuck.set(false);
    host.maps(2);
    assert_eq!(
        (host.lost, host.session.status().unwrap().sequence),
        (30, host.sequence)
    );
    assert_eq!(host.session.shadow().mismatches(), 0);
}

#[test]
fn a_device_that_comes_back_with_other_firmware_ends_the_session_and_says_what_to_flash() {
    let mut host = Host::holding();
    let attached = host.world.pull();
    host.maps(5);
    host.world.stranger.set(Some(Hello {
        schema_version: 99,
        build: [9, 8, 7],
        ..Hello::of_this_build(1, 4)
    }));
    host.world.attached.replace(attached);
    let error = (0..60).find_map(|_| {
        let until_us = host.session.now_us() + FRAME_US;
        host.session.run_until(until_us).err()
    });
    let error = error.expect("the session ends");
    assert!(matches!(error, SessionError::Schema { .. }), "{error}");
    assert_says(
        &error.to_string(),
        &[
            "USB device A1",
            "9.8.7 on stm32f405rg",
            "speaks schema 99",
            "flash",
            "cargo xtask flash --board stm32f405rg",
        ],
    );
}

#[test]
fn firmware_of_another_version_with_the_same_messages_goes_on_and_is_told() {
    let world = World::with(vec![device("A1", "1-2")]);
    let link = plug(&world, None).unwrap();
    let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
    assert_eq!(session.other_version(), None);
    world.stranger.set(Some(Hello {
        build: [0, 0, 9],
        ..Hello::of_this_build(2, 4)
    }));
    let link = plug(&world, None).unwrap();
    let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
    assert_says(
        &session.other_version().unwrap(),
        &[
            "USB device A1",
            "found firmware 0.0.9 on stm32f427vi",
            concat!("expected ", env!("CARGO_PKG_VERSION")),
            "cargo xtask flash --board stm32f427vi",
        ],
    );
}

#[test]
fn several_devices_are_listed_and_one_is_chosen_by_its_serial_number() {
    let several = || {
        vec![
            device("A1", "1-2"),
            device("B7", "1-4.1"),
            Attached {
                serial: None,
                place: "2-1".to_owned(),
            },
        ]
    };
    assert_says(
        &refused(several(), None),
        &[
            "found 3: A1 at 1-2, B7 at 1-4.1, without serial number at 2-1",
            "expected one",
            "--mcu usb:SERIAL",
        ],
    );
    assert!(plug(&World::with(several()), Some("B7")).is_ok());
    assert_says(
        &refused(several(), Some("b7")),
        &["USB device b7", "not found", "found A1 at 1-2, B7"],
    );
    assert_says(
        &refused(Vec::new(), None),
        &["no device 1209:0001", "plug the microcontroller in"],
    );
}

#[test]
fn two_devices_with_one_serial_number_have_a_message_of_their_own() {
    let twins = || vec![device("A1", "1-2"), device("B7", "1-3"), device("A1", "1-4.1")];
    let expected = [
        "two devices with the serial number A1",
        "at 1-2 and 1-4.1",
        "unplug one of them",
        "--mcu serial:PORT",
    ];
    assert_says(&refused(twins(), Some("A1")), &expected);
    assert_says(&refused(twins(), None), &["found 3: "]);
    let mut only_twins = twins();
    only_twins.remove(1);
    assert_says(&refused(only_twins, None), &expected);
    assert!(plug(&World::with(twins()), Some("B7")).is_ok());
}
