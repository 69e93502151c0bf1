//! Hold and Release over a link that loses packets: said again until the device's status shows them, and answered why not.

use gripline_link::session::Session;
use gripline_link::{EmbeddedLink, Link, LinkError};
use gripline_network::scene::GateDecision;
use gripline_pipeline::Unconfirmed;
use gripline_pipeline::control_loop::{ControlLoop, FrameRequest};
use gripline_protocol::message::{Command, Configuration, GripMode, Message};
use gripline_protocol::{Event, ForceMap, Health, Parser, SensorId};

const FRAME_US: u64 = 16_667;

/// The in-process device behind a wire that loses commands for a mode.
struct Lossy {
    inner: EmbeddedLink,
    /// So many more of them are lost.
    to_lose: u32,
    /// What comes back is lost too.
    is_mute: bool,
}

impl Link for Lossy {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        if let Ok(Event::Message(bytes)) = Parser::new().push(packet)
            && let Ok(Message::Command(Command::Hold | Command::Release)) = Message::from_bytes(bytes)
            && self.to_lose > 0
        {
            self.to_lose -= 1;
            return Ok(());
        }
        self.inner.send(packet)
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let is_mute = self.is_mute && until_us > 5_000_000;
        self.inner.run_until(until_us, &mut |packet| {
            if !is_mute {
                received(packet);
            }
        })
    }

    fn now_us(&self) -> u64 {
        self.inner.now_us()
    }

    fn name(&self) -> String {
        "a lossy link".to_owned()
    }
}

fn losing(to_lose: u32, is_mute: bool) -> ControlLoop {
    let link = Lossy {
        inner: EmbeddedLink::new(),
        to_lose,
        is_mute,
    };
    let mut session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
    session.run_until(5_000_000).unwrap();
    ControlLoop::new(session)
}

/// Frames with this requested mode until the device does it, or says why not; how many they were.
fn frames_until_answered(
    control: &mut ControlLoop,
    mode: GripMode,
    until_us: &mut u64,
) -> (u32, Option<Unconfirmed>) {
    for frame in 1..=400 {
        *until_us += FRAME_US;
        let request = FrameRequest {
            mode: Some(mode),
            ..FrameRequest::of_now(SensorId::FIRST, *until_us)
        };
        let judged = (GateDecision::NoContact, Health::GOOD);
        let outcome = control.frame_of(&ForceMap::EMPTY, judged, request).unwrap();
        if let Some(refusal) = control.session.take_refusal() {
            control.refused(refusal);
        }
        let why = control.take_unconfirmed();
        if why.is_some() || outcome.answered && outcome.status.mode == mode {
            return (frame, why);
        }
    }
    panic!("{mode:?} was neither done nor answered");
}

#[test]
fn hold_and_release_that_are_lost_are_said_again_until_the_status_shows_them() {
    for lost in [0, 1, 3] {
        let mut control = losing(lost, false);
        let mut until_us = 0;
        let (frames, why) = frames_until_answered(&mut control, GripMode::Hold, &mut until_us);
        assert_eq!(why, None, "{lost} lost");
        // A repetition every 5 ms: three in a frame.
        assert!(frames <= 1 + lost / 3, "{frames} frames, {lost} lost");
        let (_, why) = frames_until_answered(&mut control, GripMode::Released, &mut until_us);
        assert_eq!(why, None);
    }
}

#[test]
fn a_request_without_effect_is_answered_after_two_seconds_and_once() {
    let mut control = losing(u32::MAX, false);
    let mut until_us = 0;
    let (frames, why) = frames_until_answered(&mut control, GripMode::Hold, &mut until_us);
    assert_eq!(why, Some(Unconfirmed::NoEffect(GripMode::Hold)));
    assert!((110..130).contains(&frames), "{frames} frames of 1/60 s");
    let mut control = losing(u32::MAX, true);
    let mut until_us = 0;
    let (_, why) = frames_until_answered(&mut control, GripMode::Hold, &mut until_us);
    assert_eq!(why, Some(Unconfirmed::NoStatus(GripMode::Hold)));
    assert_eq!(control.take_unconfirmed(), None);
}

#[test]
fn what_is_not_asked_for_does_not_move_and_a_request_that_is_withdrawn_is_not_said_again() {
    let mut control = losing(0, false);
    let judged = (GateDecision::NoContact, Health::GOOD);
    let mut request = FrameRequest::of_now(SensorId::FIRST, 0);
    for frame in 1..30_u64 {
        request.until_us = frame * FRAME_US;
        request.mode = (frame == 20).then_some(GripMode::Hold);
        let status = control
            .frame_of(&ForceMap::EMPTY, judged, request)
            .unwrap()
            .status;
        let expected = if frame < 20 {
            GripMode::Released
        } else {
            GripMode::Hold
        };
        assert_eq!(status.mode, expected, "frame {frame}");
        assert_eq!(control.is_confirmed(), frame == 20, "frame {frame}");
    }
}

#[test]
fn a_device_in_this_process_confirms_before_the_frame_goes_on() {
    let mut control = losing(0, false);
    for mode in [GripMode::Hold, GripMode::Released] {
        control.ask_for(Some(mode)).unwrap();
        assert!(control.is_confirmed(), "{mode:?}");
    }
}
