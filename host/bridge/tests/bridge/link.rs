//! A microcontroller's device that goes away and comes back under a session, and devices that cannot be told apart: a
//! made-up bus and the firmware's library behind the links' own traits, on a clock of the test's own (`world`). Times in µs.

use std::rc::Rc;

use gripline_firmware::Fault;
use gripline_link::session::Session;
use gripline_link::usb::{Attached, UsbFinder};
use gripline_link::{HotPlug, LinkError};
use gripline_protocol::message::{Command, Configuration, GripMode, Hello};
use gripline_protocol::{ForceMap, MapInfo, TaxelForce};
use gripline_test_board::fake_usb::{FakeBus, FakeClock, FakeUsb, device};

const FRAME_US: u64 = 16_667;

fn plug(world: &Rc<FakeUsb>, serial: Option<&str>) -> Result<HotPlug<FakeClock>, LinkError> {
    let finder = UsbFinder::new(FakeBus(Rc::clone(world)), serial.map(str::to_owned));
    HotPlug::open_with(Box::new(finder), FakeClock(Rc::clone(world)))
}

fn refused(attached: Vec<Attached>, serial: Option<&str>) -> String {
    match plug(&FakeUsb::with(attached), serial) {
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
    world: Rc<FakeUsb>,
    session: Session,
    sequence: u32,
    lost: u32,
}

impl Host {
    fn holding() -> Self {
        let world = FakeUsb::with(vec![device("A1", "1-2"), device("B7", "1-4.1")]);
        let link = plug(&world, Some("A1")).unwrap();
        let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        let mut host = Self {
            world,
            session,
            sequence: 0,
            lost: 0,
        };
        assert!(host.session.command(Command::Hold).unwrap());
        // Until the load is tested, and the line back from that: it would go on doing so for a moment without maps.
        host.maps(90);
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
        self.world.board.borrow().program().line().lsb()
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

        let back_us = host.world.now_us();
        host.world.attached.replace(attached);
        let answered = host.session.shadow().checked();
        while host.session.shadow().checked() == answered {
            host.maps(1);
        }
        let met_us = host.world.now_us() - back_us;
        assert!(met_us < 1_000_000, "{met_us} µs after {away_frames} frames");
        // Greeted first, and nothing was kept for later: the map that is answered is the present one.
        assert_eq!(host.session.status().unwrap().sequence, host.sequence);
        let presence = host.session.presence();
        assert_eq!((presence.losses, presence.away), (1, None));
        assert_eq!(host.session.restarts(), 0, "it kept its power");
        assert_eq!(host.session.shadow().mismatches(), 0);
        assert!(presence.packets_lost >= u64::from(host.lost));
        let latched = host.world.board.borrow().program().status().latched & Fault::LinkLost.bit() != 0;
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
    let world = FakeUsb::with(vec![device("A1", "1-2")]);
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
    assert!(
        matches!(error, gripline_link::LinkError::Schema { .. }),
        "{error}"
    );
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
fn firmware_of_another_version_with_the_same_messages_goes_on_and_is_reported() {
    let world = FakeUsb::with(vec![device("A1", "1-2")]);
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
fn a_device_that_is_just_being_plugged_in_is_waited_for_at_the_start() {
    let world = FakeUsb::with(vec![device("A1", "1-2")]);
    world.ready_us.set(1_234_567);
    assert!(plug(&world, None).is_ok());
    let waited_us = world.now_us() - world.ready_us.get();
    assert!(waited_us <= 100_000, "{waited_us} µs too long");

    let world = FakeUsb::with(vec![device("A1", "1-2")]);
    world.ready_us.set(u64::MAX);
    let error = plug(&world, None).err().expect("it is never ready").to_string();
    assert_says(
        &error,
        &[
            "attached, but not ready (interface not found)",
            "within 2 s",
            "another port",
        ],
    );
    let waited_us = world.now_us();
    assert!((2_000_000..2_200_000).contains(&waited_us), "{waited_us} µs");
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
    assert!(plug(&FakeUsb::with(several()), Some("B7")).is_ok());
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
    assert!(plug(&FakeUsb::with(twins()), Some("B7")).is_ok());
}
