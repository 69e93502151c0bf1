//! One suite of properties over every line, and what only the gripper on the bus can do wrong.
//! What a line shows is what the gripper makes of it, in 1/4096 N.

use crate::common::bus::{Bus, BusFault};
use embedded_hal::pwm::{ErrorKind, ErrorType, SetDutyCycle};
use gripline_firmware::GripForce;
use gripline_firmware::line::{DAC_LIVE_ZERO, DacCode, DacLine, DacOutput, GripLine, LineHealth, PwmLine};
use gripline_firmware::robotiq::force_register;
use gripline_gripper::Gripper;
use proptest::prelude::*;

const NEWTON: i32 = 4_096;

/// A line with a gripper behind it, for the suite.
trait Bench {
    /// Greatest force, 1/4096 N.
    const FULL: i32;
    /// What it grips with at least once it grips.
    const LEAST: i32;
    /// Resolution: so much more than written it may show.
    const STEP: i32;
    /// How long until what was written shows, µs.
    const SETTLE_US: u64;
    /// Whether less force shows without letting go.
    const LOOSENS: bool;

    /// Ready, released.
    fn new() -> Self;
    fn write(&mut self, lsb: i32);
    fn pass(&mut self, us: u64);
    fn shown(&self) -> i32;
    /// The worst that can happen to it begins or ends.
    fn fault(&mut self, on: bool);

    fn settle(&mut self) {
        self.pass(Self::SETTLE_US);
    }
}

struct Code {
    code: u16,
    kept: GripForce,
}

impl DacOutput for &mut Code {
    fn show(&mut self, DacCode(code): DacCode) {
        self.code = code;
    }

    fn keep(&mut self, force: GripForce) {
        self.kept = force;
    }
}

/// What the output shows and what is kept, after every single operation.
#[derive(Default)]
struct Steps {
    code: u16,
    kept: GripForce,
    seen: Vec<(u16, GripForce)>,
}

impl DacOutput for &mut Steps {
    fn show(&mut self, DacCode(code): DacCode) {
        self.code = code;
        self.seen.push((self.code, self.kept));
    }

    fn keep(&mut self, force: GripForce) {
        self.kept = force;
        self.seen.push((self.code, self.kept));
    }
}

#[test]
fn a_reset_in_the_middle_of_a_write_brings_back_no_less_than_was_shown() {
    let mut steps = Steps::default();
    let mut line = DacLine::start(&mut steps, DAC_LIVE_ZERO, GripForce::ZERO);
    let forces = [5, 3, 3, 20, 19, 40, 0, 1, 0].map(|newtons| GripForce::from_lsb(newtons * NEWTON));
    for force in forces {
        let Ok(()) = line.write(force);
    }
    // The start, two operations for each of eight changes, and the one force that was there already.
    assert_eq!(steps.seen.len(), 2 + 2 * 8);
    for (code, kept) in steps.seen {
        assert!(DAC_LIVE_ZERO.code(kept).0 >= code, "{code} shown, {kept:?} kept");
    }
    assert_eq!((steps.code, steps.kept), (819, GripForce::ZERO));
}

/// The DAC line; its fault is a reset, over which the wiring's pull-up or the hold holds and RAM keeps the force.
struct DacBench {
    dac: Code,
    written: GripForce,
    down: bool,
}

impl Bench for DacBench {
    const FULL: i32 = 40 * NEWTON;
    const LEAST: i32 = 0;
    const STEP: i32 = 51;
    const SETTLE_US: u64 = 0;
    const LOOSENS: bool = true;

    fn new() -> Self {
        let mut dac = Code {
            code: 0,
            kept: GripForce::ZERO,
        };
        DacLine::start(&mut dac, DAC_LIVE_ZERO, GripForce::ZERO);
        Self {
            dac,
            written: GripForce::ZERO,
            down: false,
        }
    }
    fn write(&mut self, lsb: i32) {
        let force = GripForce::from_lsb(lsb);
        if !self.down {
            let kept = self.dac.kept;
            let Ok(()) = DacLine::start(&mut self.dac, DAC_LIVE_ZERO, kept).write(force);
        }
        self.written = force;
    }
    fn pass(&mut self, _: u64) {}
    fn shown(&self) -> i32 {
        (i32::from(self.dac.code) - 819) * Self::FULL / (4_095 - 819)
    }
    fn fault(&mut self, on: bool) {
        self.down = on;
        if !on {
            self.write(self.written.lsb());
        }
    }
}

/// A PWM output whose bus fails while there is a fault.
#[derive(Default)]
struct Pwm {
    duty: u16,
    broken: bool,
}

#[derive(Debug)]
struct Broken;

impl embedded_hal::pwm::Error for Broken {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Pwm {
    type Error = Broken;
}

impl SetDutyCycle for Pwm {
    fn max_duty_cycle(&self) -> u16 {
        10_000
    }
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Broken> {
        if self.broken {
            return Err(Broken);
        }
        self.duty = duty;
        Ok(())
    }
}

struct PwmBench {
    pwm: Pwm,
    written: i32,
}

impl Bench for PwmBench {
    const FULL: i32 = 40 * NEWTON;
    const LEAST: i32 = 0;
    const STEP: i32 = 21;
    const SETTLE_US: u64 = 0;
    const LOOSENS: bool = true;

    fn new() -> Self {
        let mut bench = Self {
            pwm: Pwm::default(),
            written: 0,
        };
        bench.write(0);
        bench
    }
    fn write(&mut self, lsb: i32) {
        self.written = lsb;
        let full = GripForce::from_lsb(Self::FULL);
        let written = PwmLine::new(&mut self.pwm, full).write(GripForce::from_lsb(lsb));
        assert_eq!(written.is_err(), self.pwm.broken);
    }
    fn pass(&mut self, _: u64) {}
    fn shown(&self) -> i32 {
        (i32::from(self.pwm.duty) - 2_000) * Self::FULL / 8_000
    }
    fn fault(&mut self, on: bool) {
        self.pwm.broken = on;
        if !on {
            self.write(self.written);
        }
    }
}

impl Bench for Bus {
    const FULL: i32 = 125 * NEWTON;
    const LEAST: i32 = 10 * NEWTON;
    const STEP: i32 = 115 * NEWTON / 255 + 1;
    // Closing from open takes 0.3 s to the object in the model.
    const SETTLE_US: u64 = 700_000;
    const LOOSENS: bool = false;

    fn new() -> Self {
        Self::ready()
    }
    fn write(&mut self, lsb: i32) {
        Bus::write(self, lsb);
    }
    fn pass(&mut self, us: u64) {
        Bus::pass(self, us);
    }
    fn shown(&self) -> i32 {
        self.gripper.grip() as i32
    }
    fn fault(&mut self, on: bool) {
        self.fault.cut = on;
    }
}

fn more_force_never_shows_as_less_and_never_less_than_written<B: Bench>() {
    let mut bench = B::new();
    let mut last = bench.shown();
    for lsb in (0..=B::FULL).step_by(B::FULL as usize / 61) {
        bench.write(lsb);
        bench.settle();
        let shown = bench.shown();
        assert!(shown >= last, "{shown} after {last}");
        assert!(shown >= lsb || lsb == 0, "{shown} for {lsb}");
        assert!(shown <= lsb.max(B::LEAST) + B::STEP, "{shown} for {lsb}");
        last = shown;
    }
}

fn above_full_scale_it_shows_full_scale<B: Bench>() {
    for lsb in [B::FULL, B::FULL + 1, i32::MAX] {
        let mut bench = B::new();
        bench.write(lsb);
        bench.settle();
        assert_eq!(bench.shown(), B::FULL, "{lsb}");
    }
}

fn what_was_never_told_to_hold_moves_nothing<B: Bench>() {
    let mut bench = B::new();
    for _ in 0..100 {
        bench.write(0);
        bench.pass(10_000);
        assert_eq!(bench.shown(), 0);
    }
}

fn trouble_never_loosens_the_grip_and_the_newest_force_shows_after_it<B: Bench>() {
    let mut bench = B::new();
    bench.write(20 * NEWTON);
    bench.settle();
    bench.fault(true);
    let held = bench.shown();
    for lsb in [25 * NEWTON, 22 * NEWTON, 30 * NEWTON] {
        bench.write(lsb);
        for _ in 0..100 {
            bench.pass(10_000);
            assert_eq!(bench.shown(), held, "nothing gets through");
        }
    }
    bench.fault(false);
    for _ in 0..100 {
        bench.pass(10_000);
        assert!(bench.shown() >= held);
    }
    bench.settle();
    assert!((30 * NEWTON..=30 * NEWTON + B::STEP).contains(&bench.shown()));
}

fn less_force_is_followed_down_or_held_and_zero_lets_go<B: Bench>() {
    let mut bench = B::new();
    bench.write(30 * NEWTON);
    bench.settle();
    bench.write(20 * NEWTON);
    bench.settle();
    let expected = if B::LOOSENS { 20 * NEWTON } else { 30 * NEWTON };
    assert!((expected..=expected + B::STEP).contains(&bench.shown()));
    bench.write(0);
    bench.settle();
    assert_eq!(bench.shown(), 0);
}

/// The controller's fastest rise, 100 N a second in steps of a millisecond, from a grip to 38 N.
fn a_ramp_is_followed_without_a_leap<B: Bench>() {
    const RATE: i32 = 410;
    const LAG_MS: i32 = 40;
    let mut bench = B::new();
    bench.write(12 * NEWTON);
    bench.settle();
    let mut lsb = 12 * NEWTON;
    for ms in 0.. {
        lsb += RATE;
        bench.write(lsb);
        bench.pass(1_000);
        let shown = bench.shown();
        assert!(shown <= lsb + B::STEP, "{ms} ms: {shown} leaps past {lsb}");
        assert!(
            ms < LAG_MS || shown >= lsb - LAG_MS * RATE,
            "{ms} ms: {shown} lags behind {lsb}"
        );
        if lsb >= 38 * NEWTON {
            break;
        }
    }
}

/// Any forces, any fault: the output is never below the minimum written since it last settled.
fn nothing_that_happens_shows_less_than_was_written<B: Bench>(steps: &[(i32, bool, u16)]) {
    let mut bench = B::new();
    bench.write(15 * NEWTON);
    bench.settle();
    let mut min = 15 * NEWTON;
    for &(lsb, fault, ms) in steps {
        min = min.min(lsb.min(B::FULL));
        bench.write(lsb);
        bench.fault(fault);
        for _ in 0..ms {
            bench.pass(1_000);
            assert!(bench.shown() >= min, "{} below {min}", bench.shown());
        }
        if !fault && u64::from(ms) * 1_000 > B::SETTLE_US {
            assert!(bench.shown() >= lsb.min(B::FULL), "{} below {lsb}", bench.shown());
            min = lsb.min(B::FULL);
        }
    }
}

fn steps() -> impl Strategy<Value = Vec<(i32, bool, u16)>> {
    let times = prop_oneof![Just(1_u16), 5..60_u16, Just(900_u16)];
    proptest::collection::vec((1..130 * NEWTON, any::<bool>(), times), 1..12)
}

macro_rules! suite {
    ($name:ident, $bench:ty, $cases:expr) => {
        mod $name {
            use super::*;

            #[test]
            fn more_force_never_shows_as_less_and_never_less_than_written() {
                super::more_force_never_shows_as_less_and_never_less_than_written::<$bench>();
            }
            #[test]
            fn above_full_scale_it_shows_full_scale() {
                super::above_full_scale_it_shows_full_scale::<$bench>();
            }
            #[test]
            fn what_was_never_told_to_hold_moves_nothing() {
                super::what_was_never_told_to_hold_moves_nothing::<$bench>();
            }
            #[test]
            fn trouble_never_loosens_the_grip_and_the_newest_force_shows_after_it() {
                super::trouble_never_loosens_the_grip_and_the_newest_force_shows_after_it::<$bench>();
            }
            #[test]
            fn less_force_is_followed_down_or_held_and_zero_lets_go() {
                super::less_force_is_followed_down_or_held_and_zero_lets_go::<$bench>();
            }
            #[test]
            fn a_ramp_is_followed_without_a_leap() {
                super::a_ramp_is_followed_without_a_leap::<$bench>();
            }
            proptest! {
                #![proptest_config(ProptestConfig::with_cases($cases))]
                #[test]
                fn nothing_that_happens_shows_less_than_was_written(steps in steps()) {
                    super::nothing_that_happens_shows_less_than_was_written::<$bench>(&steps);
                }
            }
        }
    };
}

suite!(dac, DacBench, 256);
suite!(pwm, PwmBench, 256);
suite!(robotiq_2f_140, Bus, 64);

/// A cable that breaks twice: the last force met a grip that was on its way, and got lost.
#[test]
fn a_force_that_changes_while_a_grip_is_on_its_way_comes_through() {
    for ms in 30..60 {
        let steps = [
            (1, true, 43),
            (1, false, 18),
            (1, true, 52),
            (1, false, ms),
            (63_128, false, 900),
        ];
        nothing_that_happens_shows_less_than_was_written::<Bus>(&steps);
    }
}

#[test]
fn the_force_register_covers_10_to_125_newtons_and_rounds_up() {
    for (newtons, register) in [(0, 0), (1, 0), (10, 0), (125, 255), (126, 255), (1_000, 255)] {
        assert_eq!(
            force_register(GripForce::from_lsb(newtons * NEWTON)),
            register,
            "{newtons} N"
        );
    }
    for lsb in 1..130 * NEWTON {
        let register = force_register(GripForce::from_lsb(lsb));
        let force = 10.0 + 115.0 / 255.0 * f64::from(register);
        let wanted = (f64::from(lsb) / 4_096.0).clamp(10.0, 125.0);
        assert!(
            force >= wanted - 1e-9 && force < wanted + 115.0 / 255.0,
            "{lsb}: {force} N"
        );
    }
}

#[test]
fn it_is_activated_once_and_then_left_alone() {
    let mut bus = Bus::new();
    bus.write(0);
    assert_eq!(bus.line.health(), LineHealth::Starting);
    bus.pass(10_000_000);
    assert_eq!(bus.gripper.activations, 1);
    assert_eq!(bus.gripper.motions, 0);
    assert_eq!(bus.line.health(), LineHealth::Good);
    let status = bus.line.status().unwrap();
    assert_eq!((status.bits & 0x31, status.fault), (0x31, 0));
}

#[test]
fn a_rise_reaches_the_gripper_within_12_ms_and_costs_one_motion() {
    let mut bus = Bus::ready();
    bus.write(20 * NEWTON);
    bus.pass(1_000_000);
    for n in 1..20 {
        let motions = bus.gripper.motions;
        bus.write((20 + n) * NEWTON);
        // A slot under way, its neighbour for the status, the frame, its silence, the gripper's own 5 ms.
        bus.pass(5_000 + 5_000 + 1_305 + 1_750 + 5_000 + 100);
        assert!(bus.gripper.grip() >= i64::from((20 + n) * NEWTON), "rise {n}");
        bus.pass(100_000 + n as u64 * 1_370);
        assert_eq!(bus.gripper.motions, motions + 1, "rise {n}");
    }
}

#[test]
fn a_microcontroller_that_restarts_takes_over_a_gripper_that_holds() {
    let mut bus = Bus::ready();
    bus.write(30 * NEWTON);
    bus.pass(1_000_000);
    let held = bus.gripper.grip();
    // Without a remembered force: not moved at all.
    bus.restart();
    bus.write(0);
    bus.pass(3_000_000);
    assert_eq!((bus.gripper.grip(), bus.gripper.dropped), (held, false));
    // With it: held on, and the next rise arrives.
    bus.restart();
    bus.write(30 * NEWTON);
    bus.pass(500_000);
    assert_eq!(bus.min_grip, held);
    bus.write(40 * NEWTON);
    bus.pass(500_000);
    assert!(bus.gripper.grip() >= i64::from(40 * NEWTON));
    assert_eq!((bus.gripper.activations, bus.gripper.dropped), (1, false));
}

#[test]
fn a_release_opens_a_gripper_that_held_before_a_start_without_memory() {
    let mut bus = Bus::ready();
    bus.write(30 * NEWTON);
    bus.pass(1_000_000);
    bus.restart();
    bus.write(0);
    bus.pass(1_000_000);
    assert!(
        bus.gripper.grip() >= i64::from(30 * NEWTON),
        "nothing opens by itself"
    );
    bus.line.release();
    for _ in 0..2_000 {
        bus.write(0);
        bus.pass(1_000);
    }
    assert_eq!(bus.gripper.grip(), 0);
    assert_eq!(
        (bus.line.health(), bus.gripper.activations),
        (LineHealth::Good, 1)
    );
    // What is gripped since then falls only with the line.
    bus.write(20 * NEWTON);
    bus.pass(1_000_000);
    bus.line.release();
    bus.pass(1_000_000);
    assert!(bus.min_grip >= i64::from(20 * NEWTON));
}

#[test]
fn a_lost_write_that_is_no_longer_wanted_is_no_failure() {
    for first_us in (0..20_000).step_by(500) {
        let mut bus = Bus::ready();
        bus.write(20 * NEWTON);
        bus.pass(1_000_000 + first_us);
        bus.fault.cut = true;
        bus.write(21 * NEWTON);
        bus.pass(8_000);
        bus.write(20 * NEWTON);
        bus.fault.cut = false;
        for ms in 0..1_000 {
            bus.pass(1_000);
            assert_eq!(bus.line.health(), LineHealth::Good, "{ms} ms, {first_us} us");
        }
        bus.write(30 * NEWTON);
        bus.pass(500_000);
        assert!(bus.gripper.grip() >= i64::from(30 * NEWTON));
    }
}

#[test]
fn a_gripper_that_lost_its_power_is_not_activated_while_something_is_held_and_is_after_release() {
    let mut bus = Bus::ready();
    bus.write(30 * NEWTON);
    bus.pass(1_000_000);
    bus.gripper.lose_power();
    bus.pass(5_000_000);
    assert_eq!(bus.line.health(), LineHealth::NotActivated);
    assert_eq!((bus.gripper.activations, bus.gripper.dropped), (1, false));
    bus.write(0);
    bus.pass(5_000_000);
    assert_eq!(bus.gripper.activations, 2);
    assert_eq!(bus.line.health(), LineHealth::Good);
    bus.write(30 * NEWTON);
    bus.pass(1_000_000);
    assert!(bus.gripper.grip() >= i64::from(30 * NEWTON));
}

#[test]
fn a_hold_before_the_activation_begins_keeps_it_from_beginning() {
    // From the first question to the end of the reset takes some slots of 5 ms.
    for wait_us in (0..60_000).step_by(500) {
        let mut bus = Bus::new();
        bus.write(0);
        bus.pass(wait_us);
        let begun = bus.gripper.activations > 0;
        bus.write(20 * NEWTON);
        bus.pass(4_000_000);
        let expected = if bus.gripper.activations > 0 {
            LineHealth::Good
        } else {
            LineHealth::NotActivated
        };
        assert_eq!(bus.line.health(), expected, "{wait_us} us");
        assert!(
            bus.gripper.activations == u32::from(begun) || wait_us > 15_000,
            "{wait_us} us"
        );
        bus.write(0);
        bus.pass(4_000_000);
        assert_eq!(bus.line.health(), LineHealth::Good, "{wait_us} us");
    }
}

#[test]
fn faults_of_the_gripper_show_and_those_that_need_a_reset_get_one_after_release() {
    for fault in [0x0A, 0x0C, 0x0E, 0x0F] {
        let mut bus = Bus::ready();
        bus.write(20 * NEWTON);
        bus.pass(1_000_000);
        bus.gripper.fault = fault;
        bus.pass(3_000_000);
        assert_eq!(bus.line.health(), LineHealth::NotActivated, "fault {fault:#x}");
        assert!(!bus.gripper.dropped);
        bus.write(0);
        bus.pass(5_000_000);
        assert_eq!(bus.line.health(), LineHealth::Good, "fault {fault:#x}");
        assert_eq!(bus.gripper.fault, 0);
    }
    // Too hot: it does not move, and goes on by itself.
    let mut bus = Bus::ready();
    bus.write(20 * NEWTON);
    bus.pass(1_000_000);
    bus.gripper.fault = 8;
    bus.pass(500_000);
    assert_eq!(bus.line.health(), LineHealth::GripperFault);
    bus.gripper.fault = 0;
    bus.pass(500_000);
    assert_eq!(bus.line.health(), LineHealth::Good);
    // That it heard nothing for a second is no fault of its own.
    bus.gripper.fault = 9;
    bus.pass(500_000);
    assert_eq!(bus.line.health(), LineHealth::Good);
}

#[test]
fn every_kind_of_silence_and_nonsense_counts_as_no_answer_and_ends_when_it_ends() {
    let kinds = [
        (
            "cut",
            BusFault {
                cut: true,
                ..BusFault::default()
            },
        ),
        (
            "wrong CRC",
            BusFault {
                wrong_crc: true,
                ..BusFault::default()
            },
        ),
        (
            "busy",
            BusFault {
                exception: Some(6),
                ..BusFault::default()
            },
        ),
        (
            "illegal address",
            BusFault {
                exception: Some(2),
                ..BusFault::default()
            },
        ),
        (
            "too slow",
            BusFault {
                slow_us: 60_000,
                ..BusFault::default()
            },
        ),
        (
            "noise",
            BusFault {
                flipped: 500,
                ..BusFault::default()
            },
        ),
    ];
    for (kind, fault) in kinds {
        let mut bus = Bus::ready();
        bus.write(20 * NEWTON);
        bus.pass(1_000_000);
        let held = bus.gripper.grip();
        bus.fault = fault;
        bus.pass(200_000);
        assert_eq!(bus.line.health(), LineHealth::NoAnswer, "{kind}");
        bus.write(30 * NEWTON);
        bus.pass(2_000_000);
        assert!(bus.min_grip >= held, "{kind}");
        bus.fault = BusFault::default();
        bus.pass(500_000);
        assert_eq!(bus.line.health(), LineHealth::Good, "{kind}");
        assert!(bus.gripper.grip() >= i64::from(30 * NEWTON), "{kind}");
        assert_eq!(
            (bus.gripper.activations, bus.gripper.dropped),
            (1, false),
            "{kind}"
        );
    }
}

#[test]
fn a_slow_gripper_within_the_time_out_is_no_trouble() {
    let mut bus = Bus::new();
    bus.fault.slow_us = 18_000;
    bus.write(0);
    bus.pass(5_000_000);
    bus.write(20 * NEWTON);
    bus.pass(1_000_000);
    for n in 0..10 {
        bus.write((21 + n) * NEWTON);
        bus.pass(100_000);
        assert_eq!(bus.line.health(), LineHealth::Good);
        assert!(bus.gripper.grip() >= i64::from((21 + n) * NEWTON));
    }
}

#[test]
fn one_byte_in_a_hundred_lost_and_one_flipped_delays_but_never_loosens() {
    let mut bus = Bus::ready();
    bus.write(20 * NEWTON);
    bus.pass(1_000_000);
    bus.fault = BusFault {
        dropped: 10,
        flipped: 10,
        ..BusFault::default()
    };
    for n in 1..100 {
        let held = bus.gripper.grip();
        bus.write((20 + n) * NEWTON);
        bus.pass(600_000);
        assert!(bus.min_grip >= held, "rise {n}");
        assert!(bus.gripper.grip() >= i64::from((20 + n) * NEWTON), "rise {n}");
    }
    assert_eq!((bus.gripper.activations, bus.gripper.dropped), (1, false));
}

#[test]
fn without_an_object_it_closes_and_reports_no_fault() {
    let mut bus = Bus::ready();
    bus.gripper.object = None;
    bus.write(20 * NEWTON);
    bus.pass(2_000_000);
    assert_eq!(bus.line.health(), LineHealth::Good);
    assert!(bus.line.status().unwrap().position >= 254);
    assert_eq!(bus.gripper.grip(), 0);
}

/// The model that everything above rests on: only a new position request makes it grip harder.
#[test]
fn the_model_of_the_gripper_keeps_its_grip_when_only_the_force_register_changes() {
    let write = |position: u8, force: u8| {
        let mut frame = vec![9, 16, 3, 0xE8, 0, 3, 6, 9, 0, 0, position, 0xFF, force];
        frame.extend(
            crc::Crc::<u16>::new(&crc::CRC_16_MODBUS)
                .checksum(&frame)
                .to_le_bytes(),
        );
        frame
    };
    let mut gripper = Gripper::new();
    let activate = [9, 16, 3, 0xE8, 0, 3, 6, 1, 0, 0, 0, 0, 0, 0x72, 0xE1];
    assert!(gripper.answer(&activate).is_some(), "the manual's own frame");
    gripper.advance(3_000_000);
    gripper.answer(&write(255, 0));
    gripper.advance(5_000_000);
    assert_eq!(gripper.grip(), i64::from(10 * NEWTON));
    gripper.answer(&write(255, 255));
    gripper.advance(6_000_000);
    assert_eq!(gripper.grip(), i64::from(10 * NEWTON));
    gripper.answer(&write(254, 255));
    gripper.advance(7_000_000);
    assert_eq!(gripper.grip(), i64::from(125 * NEWTON));
    gripper.answer(&write(255, 0));
    gripper.advance(8_000_000);
    assert_eq!(gripper.grip(), i64::from(125 * NEWTON));
}
