//! A loop without pictures: maps stop, but the microcontroller still hears from it, so the line is held and nothing latches.
//! The device is in this process; times in µs.

use gripline_firmware::Fault;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_network::scene::GateDecision;
use gripline_pipeline::control_loop::{ControlLoop, FrameRequest};
use gripline_protocol::message::{Configuration, GripMode, Status};
use gripline_protocol::{ForceMap, Health, SensorId, TaxelForce};

const FRAME_US: u64 = 16_667;

fn frame(control: &mut ControlLoop, until_us: u64) {
    let mut map = ForceMap::EMPTY;
    map.taxels[100..160].fill(TaxelForce {
        x: 250,
        y: -60,
        z: 800,
    });
    let request = FrameRequest {
        mode: Some(GripMode::Hold),
        ..FrameRequest::of_now(SensorId::FIRST, until_us)
    };
    let judged = (GateDecision::Infer, Health::GOOD);
    control.frame_of(&map, judged, request).unwrap();
}

/// Holding something, after this many frames.
fn holding(frames: u64) -> ControlLoop {
    let session = Session::open(Box::new(EmbeddedLink::new()), Configuration::DEFAULT).unwrap();
    let mut control = ControlLoop::new(session);
    for number in 1..=frames {
        frame(&mut control, number * FRAME_US);
    }
    assert!(control.is_confirmed() && status(&control).line > 0);
    control
}

fn status(control: &ControlLoop) -> Status {
    *control.session.status().unwrap()
}

fn is_without_link(status: &Status) -> bool {
    (status.faults | status.latched) & Fault::LinkLost.bit() != 0
}

#[test]
fn a_camera_that_is_gone_holds_the_line_and_loses_no_link() {
    let mut control = holding(120);
    let line = status(&control).line;
    let begun_us = 120 * FRAME_US;
    for step in 1..=200 {
        control.idle(begun_us + step * 10_000).unwrap();
        assert!(!is_without_link(&status(&control)), "{} ms", step * 10);
    }
    let silent = status(&control);
    assert_ne!(silent.faults & Fault::StaleMaps.bit(), 0);
    assert_eq!((silent.mode, silent.latched), (GripMode::Hold, 0));
    assert!(silent.line <= line, "{} after {line}", silent.line);
}

#[test]
fn pictures_that_come_seldom_lose_no_link_either() {
    let mut control = holding(10);
    for second in 1..=3 {
        frame(&mut control, second * 1_000_000);
        assert!(!is_without_link(&status(&control)), "{second} s");
    }
}

#[test]
fn a_loop_that_does_nothing_loses_the_link() {
    let mut control = holding(120);
    control
        .session
        .run_until(control.session.now_us() + 700_000)
        .unwrap();
    assert!(is_without_link(&status(&control)));
}
