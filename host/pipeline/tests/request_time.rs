//! How long a request takes until the microcontroller confirms it, by the microcontroller's own clock, over a cable that loses packets too.
//! On the emulated board that leaves out what a computer needs to emulate it: up to 0.1 s where it translates code.

use std::time::Duration;

use gripline_link::session::Session;
use gripline_link::{EmbeddedLink, EmulatorLink, Link, LinkError, Transport};
use gripline_network::scene::GateDecision;
use gripline_pipeline::control_loop::{ControlLoop, FrameRequest};
use gripline_protocol::message::{Configuration, GripMode};
use gripline_protocol::{ForceMap, Health, SensorId, TaxelForce};

const FRAME_US: u64 = 16_667;
/// For so long of a frame the host works on a picture and hears nobody: what a frame from picture to link may take.
const DEAF_US: u64 = 4_000;
/// A run looks so often after a request that is not confirmed.
const LOOK: Duration = Duration::from_millis(1);
const REQUESTS: u64 = 100;
/// The handshake is over by then; packets are lost from here on.
const BEGIN_US: u64 = 500_000;

/// A microcontroller behind a cable that loses packets, both ways.
struct Lossy<L> {
    inner: L,
    lost_per_mille: u64,
    random: u64,
}

/// Whether the next packet is lost.
fn is_lost(random: &mut u64, lost_per_mille: u64) -> bool {
    // Knuth's generator; its high bits.
    *random = random
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*random >> 33) % 1_000 < lost_per_mille
}

impl<L: Link> Lossy<L> {
    fn lost_per_mille(&self) -> u64 {
        if self.inner.now_us() < BEGIN_US {
            0
        } else {
            self.lost_per_mille
        }
    }
}

impl<L: Link> Link for Lossy<L> {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let lost_per_mille = self.lost_per_mille();
        if is_lost(&mut self.random, lost_per_mille) {
            return Ok(());
        }
        self.inner.send(packet)
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let lost_per_mille = self.lost_per_mille();
        let random = &mut self.random;
        self.inner.run_until(until_us, &mut |packet| {
            if !is_lost(random, lost_per_mille) {
                received(packet);
            }
        })
    }

    fn now_us(&self) -> u64 {
        self.inner.now_us()
    }

    fn name(&self) -> String {
        format!("{} behind a lossy cable", self.inner.name())
    }
}

/// A loop as that of a run: a map at the start of each frame, then looks until the next one is due.
struct Cell {
    control: ControlLoop,
    map: ForceMap,
    mode: Option<GripMode>,
    frames: u64,
}

impl Cell {
    fn new(inner: impl Link + 'static, lost_per_mille: u64) -> Self {
        let link = Lossy {
            inner,
            lost_per_mille,
            random: 1,
        };
        let mut session = Session::open(Box::new(link), Configuration::DEFAULT).unwrap();
        session.run_until(BEGIN_US).unwrap();
        let mut map = ForceMap::EMPTY;
        // Two packets: with four a fifth of the maps is broken, and five in a row, as by chance in one run of four, are a storm, which latches.
        map.taxels[..9].fill(TaxelForce {
            x: 20,
            y: -30,
            z: 400,
        });
        Self {
            control: ControlLoop::new(session),
            map,
            mode: None,
            frames: 0,
        }
    }

    fn now_us(&self) -> u64 {
        self.control.session.now_us() - BEGIN_US
    }

    /// The next thing that a run does: a frame that is due, or a look.
    fn go_on(&mut self) {
        let due_us = self.frames * FRAME_US;
        if self.now_us() < due_us {
            self.control
                .pass(LOOK.min(Duration::from_micros(due_us - self.now_us())))
                .unwrap();
            return;
        }
        self.frames += 1;
        let request = FrameRequest {
            mode: self.mode,
            ..FrameRequest::of_now(SensorId::FIRST, self.now_us() + DEAF_US)
        };
        let judged = (GateDecision::Infer, Health::GOOD);
        self.control.frame_of(&self.map, judged, request).unwrap();
    }

    /// Asks at this moment; how long it takes until a status shows it, µs.
    fn ask_at(&mut self, at_us: u64, mode: GripMode) -> u64 {
        while self.now_us() < at_us {
            self.go_on();
        }
        self.mode = Some(mode);
        self.control.ask_for(self.mode).unwrap();
        while !self.control.is_confirmed() {
            assert_eq!(self.control.take_unconfirmed(), None);
            self.go_on();
            if let Some(refusal) = self.control.session.take_refusal() {
                self.control.refused(refusal);
            }
            self.control.ask_for(self.mode).unwrap();
        }
        self.now_us() - at_us
    }
}

/// Asks a hundred times, at every moment of a frame; the longest time until a status shows it, µs. Prints a line that
/// `cargo xtask bench requests` reads.
fn longest_us(inner: impl Link + 'static, lost_per_mille: u64) -> u64 {
    let name = inner.name();
    let mut cell = Cell::new(inner, lost_per_mille);
    let mut took_us: Vec<u64> = (1..=REQUESTS)
        .map(|number| {
            let mode = if number % 2 == 1 {
                GripMode::Hold
            } else {
                GripMode::Released
            };
            // Steps of the golden section of a frame.
            cell.ask_at(cell.now_us() + 20_000 + number * 10_301 % FRAME_US, mode)
        })
        .collect();
    took_us.sort_unstable();
    let (median_us, longest_us) = (took_us[took_us.len() / 2], took_us[took_us.len() - 1]);
    println!(
        "{{\"mcu\":\"{name}\",\"lost_per_mille\":{lost_per_mille},\"median_us\":{median_us},\"longest_us\":{longest_us}}}"
    );
    longest_us
}

#[test]
fn in_process_requests_are_confirmed_within_20_ms_with_a_twentieth_of_the_packets_lost_too() {
    for lost_per_mille in [0, 50] {
        let longest_us = longest_us(EmbeddedLink::new(), lost_per_mille);
        assert!(
            longest_us <= 20_000,
            "{longest_us} µs, {lost_per_mille} of 1,000 lost"
        );
    }
}

#[test]
#[ignore = "needs the emulator and the image: cargo xtask test"]
fn over_emulated_usb_requests_are_confirmed_within_50_ms_with_a_twentieth_of_the_packets_lost_too() {
    for lost_per_mille in [0, 50] {
        let longest_us = longest_us(EmulatorLink::spawn(Transport::Usb).unwrap(), lost_per_mille);
        assert!(
            longest_us <= 50_000,
            "{longest_us} µs, {lost_per_mille} of 1,000 lost"
        );
    }
}
