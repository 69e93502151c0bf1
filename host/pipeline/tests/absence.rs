//! A microcontroller on USB that loses its cable, its power or both under the control loop: what a person asked for is asked for
//! again after a lost cable, and never after a restart. Times in µs.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

use gripline_firmware::ResetCause;
use gripline_link::session::Session;
use gripline_link::usb::UsbFinder;
use gripline_link::{HotPlug, Link, LinkError, Presence};
use gripline_network::scene::GateDecision;
use gripline_pipeline::Unconfirmed;
use gripline_pipeline::control_loop::{ControlLoop, FrameRequest};
use gripline_protocol::message::{Command, Configuration, GripMode};
use gripline_protocol::{ForceMap, Health, SensorId};
use gripline_test_board::fake_usb::{FakeBus, FakeClock, FakeUsb, device};

const FRAME_US: u64 = 16_667;

/// A link whose packets from the device take this time, µs.
struct Delayed {
    inner: HotPlug<FakeClock>,
    delay_us: u64,
    under_way: VecDeque<(u64, Vec<u8>)>,
    /// None of them comes any more.
    is_deaf: Rc<Cell<bool>>,
}

impl Link for Delayed {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        self.inner.send(packet)
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let there_us = self.inner.now_us() + self.delay_us;
        let under_way = &mut self.under_way;
        self.inner.run_until(until_us, &mut |packet| {
            under_way.push_back((there_us, packet.to_vec()));
        })?;
        while let Some((_, packet)) = self.under_way.pop_front_if(|(there_us, _)| *there_us <= until_us) {
            if !self.is_deaf.get() {
                received(&packet);
            }
        }
        Ok(())
    }

    fn now_us(&self) -> u64 {
        self.inner.now_us()
    }

    fn is_real_time(&self) -> bool {
        self.inner.is_real_time()
    }

    fn name(&self) -> String {
        self.inner.name()
    }

    fn presence(&self) -> Presence {
        self.inner.presence()
    }
}

/// A loop around a board on USB; nothing touches the fingertip.
struct Host {
    world: Rc<FakeUsb>,
    is_deaf: Rc<Cell<bool>>,
    control: ControlLoop,
    begun_us: u64,
    mode: Option<GripMode>,
}

impl Host {
    fn new() -> Self {
        Self::delayed(0)
    }

    /// With this delay of what the board sends, µs.
    fn delayed(delay_us: u64) -> Self {
        let world = FakeUsb::with(vec![device("A1", "1-2")]);
        let finder = UsbFinder::new(FakeBus(Rc::clone(&world)), None);
        let inner = HotPlug::open_with(Box::new(finder), FakeClock(Rc::clone(&world))).unwrap();
        let is_deaf = Rc::new(Cell::new(false));
        let link = Delayed {
            inner,
            delay_us,
            under_way: VecDeque::new(),
            is_deaf: Rc::clone(&is_deaf),
        };
        let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        Self {
            begun_us: world.now_us(),
            control: ControlLoop::new(session),
            world,
            is_deaf,
            mode: None,
        }
    }

    /// After a hold that a status has shown.
    fn holding() -> Self {
        let mut host = Self::new();
        host.mode = Some(GripMode::Hold);
        host.frames(10);
        assert!(host.control.is_confirmed() && host.line() > 0);
        host
    }

    fn frames(&mut self, count: u32) {
        for _ in 0..count {
            let end_us = self.world.now_us() + FRAME_US;
            let request = FrameRequest {
                mode: self.mode,
                ..FrameRequest::of_now(SensorId::FIRST, end_us - self.begun_us)
            };
            let judged = (GateDecision::NoContact, Health::GOOD);
            self.control.frame_of(&ForceMap::EMPTY, judged, request).unwrap();
            self.control.session.run_until(end_us).unwrap();
        }
    }

    fn mode(&self) -> GripMode {
        self.world.board.borrow().program().status().mode
    }

    fn line(&self) -> i32 {
        self.world.board.borrow().program().line().lsb()
    }

    /// Power and cable are lost together, and come back.
    fn lose_power_and_cable(&mut self, away_frames: u32) {
        let attached = self.world.pull();
        self.frames(away_frames);
        self.world.reset(ResetCause::PowerOn, 100_000);
        self.world.attached.replace(attached);
        self.frames(60);
        assert!(self.control.session.is_sound());
        assert_eq!(self.control.session.restarts(), 1);
    }
}

#[test]
fn a_hold_is_not_said_again_to_a_microcontroller_that_lost_its_power_with_its_cable() {
    for away_frames in [0, 1, 5, 60] {
        let mut host = Host::holding();
        host.lose_power_and_cable(away_frames);
        assert_eq!((host.mode(), host.line()), (GripMode::Released, 0));
        // Nor when only the cable comes out for a moment later.
        let attached = host.world.pull();
        host.frames(5);
        host.world.attached.replace(attached);
        host.frames(60);
        assert_eq!((host.mode(), host.line()), (GripMode::Released, 0));
        // Nor when the loop wants what was refused again.
        host.control.request_again();
        host.frames(10);
        assert_eq!((host.mode(), host.line()), (GripMode::Released, 0));
        // A new request is one.
        host.control.request_anew();
        host.frames(10);
        assert_eq!(host.mode(), GripMode::Hold);
    }
}

#[test]
fn a_hold_that_no_link_took_is_not_said_to_a_microcontroller_that_restarted() {
    let mut host = Host::new();
    let attached = host.world.pull();
    host.frames(1);
    host.mode = Some(GripMode::Hold);
    host.frames(5);
    host.world.reset(ResetCause::PowerOn, 100_000);
    host.world.attached.replace(attached);
    host.frames(60);
    assert_eq!((host.mode(), host.line()), (GripMode::Released, 0));
    assert_eq!(
        host.control.take_unconfirmed(),
        Some(Unconfirmed::Restarted(GripMode::Hold))
    );
}

#[test]
fn a_release_that_a_lost_cable_kept_back_is_said_again_when_it_is_in() {
    let mut host = Host::holding();
    let attached = host.world.pull();
    host.mode = Some(GripMode::Released);
    host.frames(5);
    host.world.attached.replace(attached);
    host.frames(60);
    assert_eq!(host.control.session.restarts(), 0);
    assert_eq!(host.mode(), GripMode::Released);
    assert!(host.control.is_confirmed());
}

#[test]
fn a_restart_that_is_not_known_yet_is_given_no_hold() {
    // A restart without a lost cable shows in an answer or in half a second of silence; a hold may come at any time between.
    for hold_after in 0..60 {
        let mut host = Host::delayed(30_000);
        host.frames(10);
        host.world.reset(ResetCause::PowerOn, 100_000);
        host.frames(hold_after);
        let is_known = host.control.session.restarts() == 1;
        host.mode = Some(GripMode::Hold);
        host.frames(60);
        let expected = if is_known {
            GripMode::Hold
        } else {
            GripMode::Released
        };
        assert_eq!(host.mode(), expected, "{hold_after} frames after the restart");
    }
}

/// A person may always open: also when nothing comes back from the board, as over a UART of which one wire is broken.
#[test]
fn a_release_is_said_over_a_link_that_hears_nothing_from_the_board() {
    let mut host = Host::holding();
    host.is_deaf.set(true);
    host.frames(60);
    assert!(!host.control.session.is_sound());
    host.mode = Some(GripMode::Released);
    host.frames(20);
    assert_eq!(host.mode(), GripMode::Released);
}

#[test]
fn a_release_that_was_done_is_not_said_again_when_the_gripper_holds_once_more() {
    let mut host = Host::holding();
    host.mode = Some(GripMode::Released);
    host.frames(10);
    assert!(host.control.is_confirmed());
    // Something else closes it: the input that inhibits a release, or another host.
    host.control.session.command(Command::Hold).unwrap();
    host.frames(10);
    assert_eq!(host.mode(), GripMode::Hold);
    // As after an acknowledgement, and after a lost cable.
    host.control.request_again();
    host.frames(10);
    let attached = host.world.pull();
    host.frames(5);
    host.world.attached.replace(attached);
    host.frames(60);
    assert_eq!(host.mode(), GripMode::Hold);
}

#[test]
fn one_that_restarts_again_before_it_has_its_settings_is_met_again() {
    let mut host = Host::new();
    host.frames(10);
    host.world.reset(ResetCause::PowerOn, 100_000);
    let session = &mut host.control.session;
    while session.restarts() == 0 {
        session.run_until(session.now_us() + 1_000).unwrap();
    }
    assert!(!host.control.session.is_sound(), "its settings are on their way");
    host.world.reset(ResetCause::PowerOn, 100_000);
    host.frames(120);
    assert!(host.control.session.is_sound());
    assert_eq!(host.control.session.restarts(), 2);
    host.mode = Some(GripMode::Hold);
    host.frames(10);
    assert_eq!(host.mode(), GripMode::Hold);
}
