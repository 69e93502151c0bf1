//! A run around a board on a made-up USB bus, on a clock of the test's own: what a restart takes back, and what is published
//! without pictures. Nothing touches the fingertip. Times in µs.

use std::rc::Rc;

use gripline_control::{Action, Handle, Request, StatusReport, Step, channel};
use gripline_firmware::{Fault, FaultSet, ResetCause};
use gripline_link::HotPlug;
use gripline_link::session::Session;
use gripline_link::usb::UsbFinder;
use gripline_network::scene::GateDecision;
use gripline_pipeline::control_loop::FrameRequest;
use gripline_protocol::message::{Configuration, GripMode};
use gripline_protocol::{ForceMap, Health, SensorId};
use gripline_recording::telemetry::{NO_DEVICE, NO_STATUS};
use gripline_test_board::fake_usb::{FakeBus, FakeClock, FakeUsb, device};

use super::requests::{Requests, Unasked};
use super::{Pacing, Run};

const FRAME_US: u64 = 16_667;

struct Bench {
    world: Rc<FakeUsb>,
    run: Run,
    handle: Handle,
    begun_us: u64,
    number: u64,
}

impl Bench {
    fn new(unasked: Unasked) -> Self {
        let world = FakeUsb::with(vec![device("A1", "1-2")]);
        let finder = UsbFinder::new(FakeBus(Rc::clone(&world)), None);
        let link = HotPlug::open_with(Box::new(finder), FakeClock(Rc::clone(&world))).unwrap();
        let session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        let mut run = Run::new(session, Pacing::Pictures, 60.0);
        let (handle, inbox) = channel();
        run.requests = Requests::new(inbox, unasked, 0);
        Self {
            begun_us: world.now_us(),
            world,
            run,
            handle,
            number: 0,
        }
    }

    fn ask(&mut self, action: Action) {
        self.number += 1;
        self.handle.tell(&Request {
            client: "tester".parse().unwrap(),
            number: self.number,
            action,
            take_over: false,
        });
    }

    fn frames(&mut self, count: u32, script: Option<GripMode>) {
        for _ in 0..count {
            let end_us = self.world.now_us() + FRAME_US;
            self.run.requests.scripted(script);
            self.run.handle_requests().unwrap();
            let request = FrameRequest {
                mode: self.run.requests.mode(),
                ..FrameRequest::of_now(SensorId::FIRST, end_us - self.begun_us)
            };
            let judged = (GateDecision::NoContact, Health::GOOD);
            let control = &mut self.run.control;
            control.frame_of(&ForceMap::EMPTY, judged, request).unwrap();
            control.session.run_until(end_us).unwrap();
            self.run.settle_requests().unwrap();
        }
    }

    fn restarts(&self) -> u32 {
        self.run.control.session.restarts()
    }

    fn mode(&self) -> GripMode {
        self.world.board.borrow().program().status().mode
    }

    fn latched(&self) -> u32 {
        self.world.board.borrow().program().status().latched
    }

    /// A fault comes, is latched and goes.
    fn latch(&mut self, script: Option<GripMode>) {
        for faults in [FaultSet::from_bits(Fault::Undervoltage.bit()), FaultSet::EMPTY] {
            self.world.board.borrow_mut().device.program.note_board(faults);
            self.frames(5, script);
        }
        assert_eq!(self.latched(), Fault::Undervoltage.bit());
    }
}

/// The answer to the handshake has arrived and was not read yet: the call that takes the request reads it.
#[test]
fn a_hold_that_is_asked_for_while_a_restart_becomes_known_is_refused_and_not_forgotten() {
    let mut bench = Bench::new(Unasked::SCRIPT);
    bench.frames(10, None);
    let attached = bench.world.pull();
    bench.frames(2, None);
    bench.world.reset(ResetCause::PowerOn, 1_000);
    let session = &mut bench.run.control.session;
    session.run_until(session.now_us() + 10_000).unwrap();
    bench.world.attached.replace(attached);
    let mut rounds = 0;
    while session.presence().away.is_some() {
        session.run_until(session.now_us() + 1_000).unwrap();
        rounds += 1;
        assert!(rounds < 5_000, "it does not come back");
    }
    assert_eq!(bench.restarts(), 0, "it is known already");
    bench.ask(Action::Hold);
    bench.run.handle_requests().unwrap();
    bench.run.handle_requests().unwrap();
    assert_eq!(bench.restarts(), 1);
    assert!(!bench.run.requests.arbiter.waits_for(Step::Hold));
    bench.frames(60, None);
    assert_eq!(bench.mode(), GripMode::Released);
}

#[test]
fn a_hold_from_before_a_restart_is_gone_whatever_is_asked_for_afterwards() {
    const NOTHING: Unasked = Unasked {
        hold: false,
        script: false,
    };
    let held = Some(GripMode::Hold);
    for (unasked, script) in [
        (NOTHING, None),
        (
            Unasked {
                hold: true,
                ..NOTHING
            },
            None,
        ),
        (Unasked::SCRIPT, held),
    ] {
        let mut bench = Bench::new(unasked);
        if !unasked.hold && script.is_none() {
            bench.ask(Action::Hold);
        }
        bench.frames(10, script);
        assert_eq!(bench.mode(), GripMode::Hold);
        bench.world.reset(ResetCause::PowerOn, 100_000);
        bench.frames(60, script);
        assert_eq!((bench.restarts(), bench.mode()), (1, GripMode::Released));
        bench.latch(script);
        bench.ask(Action::Acknowledge);
        bench.frames(10, script);
        assert_eq!((bench.latched(), bench.mode()), (0, GripMode::Released));
        let attached = bench.world.pull();
        bench.frames(5, script);
        bench.world.attached.replace(attached);
        bench.frames(60, script);
        assert_eq!(bench.mode(), GripMode::Released);
        // The script goes on where it asks for something else.
        bench.frames(5, script.map(|_| GripMode::Released));
        bench.frames(5, script);
        assert_eq!(bench.mode() == GripMode::Hold, script.is_some());
        bench.ask(Action::Hold);
        bench.frames(5, script);
        assert_eq!(bench.mode(), GripMode::Hold);
    }
}

#[test]
fn what_is_latched_by_a_restart_is_not_acknowledged_by_a_request_from_before_it() {
    let mut bench = Bench::new(Unasked::SCRIPT);
    bench.world.reset(ResetCause::Watchdog, 100_000);
    bench.frames(60, None);
    assert_eq!(bench.latched(), Fault::WatchdogReset.bit());
    bench.world.is_stuck.set(true);
    bench.ask(Action::Acknowledge);
    bench.frames(3, None);
    bench.world.reset(ResetCause::Watchdog, 100_000);
    bench.frames(1, None);
    bench.world.is_stuck.set(false);
    bench.frames(60, None);
    assert_eq!(
        (bench.restarts(), bench.latched()),
        (2, Fault::WatchdogReset.bit())
    );
    assert!(!bench.run.requests.is_under_way(), "it is answered");
    bench.ask(Action::Acknowledge);
    bench.frames(10, None);
    assert_eq!(bench.latched(), 0);
}

#[test]
fn the_status_goes_on_while_no_pictures_come() {
    let mut bench = Bench::new(Unasked::SCRIPT);
    let idle = |bench: &mut Bench, ms: u64| {
        for _ in 0..ms / 10 {
            bench.world.pass_to(bench.world.now_us() + 10_000);
            bench.run.idle().unwrap();
        }
        bench.handle.status()
    };
    bench.ask(Action::Hold);
    bench.frames(10, None);
    let silent = idle(&mut bench, 300);
    assert_eq!((silent.is_connected, silent.mode), (true, Some("hold")));
    assert!(silent.status_age_ms < 200.0 && silent.line_n > 0.0, "{silent:?}");
    let names = |status: &StatusReport| status.faults.iter().map(|fault| fault.name).collect::<Vec<_>>();
    assert_eq!((names(&silent), silent.host_faults), (vec!["STALE MAPS"], vec![]));

    let attached = bench.world.pull();
    let away = idle(&mut bench, 1_000);
    assert!(!away.is_connected && away.status_age_ms > 800.0, "{away:?}");
    assert_eq!(away.host_faults, [NO_DEVICE, NO_STATUS]);
    bench.world.attached.replace(attached);
    let back = idle(&mut bench, 500);
    assert!(back.is_connected && back.host_faults.is_empty(), "{back:?}");
    // The board was without a host for longer than it waits.
    assert!(names(&back).contains(&"LINK LOST"), "{back:?}");
}
