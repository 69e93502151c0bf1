//! The host's evidence of motion on its way from a map's head to the line and to the status, and the whole detector's evidence of slip.

use gripline_protocol::message::{Command, Configuration, Hello, Message, Status};
use gripline_protocol::{ForceMap, Health, MapInfo, Motion, SensorId};

use crate::bench::Bench;
use crate::grasp_world::contact_map;

/// Clear pictures.
const MOVES: Motion = Motion::new(63, 3);
const RESTS: Motion = Motion::new(0, 3);

/// A contact that carries this shear under this normal force, N.
fn carries(normal: f64, shear: f64) -> ForceMap {
    contact_map(normal, shear, normal, shear, 0.8, false)
}

impl Bench {
    fn seen_map(&mut self, sensor: SensorId, map: &ForceMap, motion: Motion) {
        self.sequence += 1;
        let info = MapInfo {
            sensor,
            sequence: self.sequence,
            capture_us: self.now_us as u32,
            health: Health::GOOD,
            motion,
        };
        assert!(self.map_with(info, map).last().unwrap().decided);
    }

    /// The same map at 60 a second.
    fn seen_maps_for_ms(&mut self, map: &ForceMap, motion: Motion, for_ms: u64) {
        for _ in 0..for_ms / 16 {
            self.seen_map(SensorId::FIRST, map, motion);
            self.wait_ms(16);
        }
    }

    fn line_n(&self) -> f64 {
        f64::from(self.device.program.line().lsb()) / 4_096.0
    }

    fn now(&self) -> Status {
        self.device.program.status()
    }
}

/// A quiet hold of 1.6 N under 5 N with the shipped settings.
fn quiet_hold(sensors: u8) -> Bench {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.command(Command::Configure(Configuration {
        sensors,
        ..Configuration::DEFAULT
    }));
    bench.command(Command::Hold);
    for step in 0..60 {
        for sensor in SensorId::ALL.into_iter().take(sensors.into()) {
            bench.seen_map(
                sensor,
                &carries(5.0, 1.6 * f64::from(step) / 60.0),
                Motion::UNKNOWN,
            );
        }
        bench.wait_ms(16);
    }
    for _ in 0..120 {
        for sensor in SensorId::ALL.into_iter().take(sensors.into()) {
            bench.seen_map(sensor, &carries(5.0, 1.6), Motion::UNKNOWN);
        }
        bench.wait_ms(16);
    }
    bench
}

#[test]
fn motion_that_is_seen_raises_the_line_although_no_force_has_changed() {
    let mut bench = quiet_hold(1);
    let before = bench.line_n();
    bench.seen_maps_for_ms(&carries(5.0, 1.6), MOVES, 48);
    assert!(
        bench.line_n() > before + 1.0,
        "{before} N became {} N within three maps",
        bench.line_n()
    );
    let status = bench.now();
    assert!(
        status.slip_evidence > 8_000 && status.witnesses.motion > 8_000,
        "{status:?}"
    );
    assert!(status.witnesses.unrest < 2_000, "{:?}", status.witnesses);
    // It rests again: the line comes back to what the friction that was found needs, not to what it was.
    bench.seen_maps_for_ms(&carries(5.0, 1.6), RESTS, 1_000);
    let after = bench.line_n();
    assert!(
        after > before + 0.2 && after < 3.0 * before,
        "{before} N became {after} N"
    );
    assert!(bench.now().slip_evidence < 500, "{:?}", bench.now());
}

#[test]
fn motion_that_a_poor_picture_shows_is_reported_and_moves_nothing() {
    let mut bench = quiet_hold(1);
    let before = bench.line_n();
    bench.seen_maps_for_ms(&carries(5.0, 1.6), Motion::new(63, 1), 500);
    assert!(
        (bench.line_n() - before).abs() < 0.05 * before,
        "{before} N became {} N",
        bench.line_n()
    );
    let with = bench.now().slip_evidence;
    bench.seen_maps_for_ms(&carries(5.0, 1.6), Motion::UNKNOWN, 500);
    assert!(with > bench.now().slip_evidence);
}

#[test]
fn rest_that_is_seen_spares_the_test_of_a_load_that_falls() {
    let max = |motion: Motion| {
        let mut bench = quiet_hold(1);
        let before = bench.line_n();
        let mut max = before;
        for step in 0..60 {
            // The arm slows down: less load, the same grip.
            let shear = 1.6 - 0.5 * f64::from(step.min(20)) / 20.0;
            bench.seen_map(SensorId::FIRST, &carries(5.0, shear), motion);
            bench.wait_ms(16);
            max = max.max(bench.line_n());
        }
        max / before
    };
    let (blind, seeing) = (max(Motion::UNKNOWN), max(RESTS));
    assert!(blind > 1.2, "without a picture it is tested: {blind}");
    assert!(seeing < 1.02, "{seeing}");
}

#[test]
fn motion_at_one_fingertip_counts_for_both_and_a_doubtful_map_says_nothing() {
    let mut bench = quiet_hold(2);
    bench.seen_map(SensorId::SECOND, &carries(5.0, 1.6), MOVES);
    bench.seen_map(SensorId::FIRST, &carries(5.0, 1.6), RESTS);
    assert!(bench.now().slip_evidence > 8_000, "{:?}", bench.now());

    let mut bench = quiet_hold(1);
    let calm = bench.now();
    bench.sequence += 1;
    let info = MapInfo {
        sequence: bench.sequence,
        capture_us: bench.now_us as u32,
        health: Health::TOO_DARK,
        motion: MOVES,
        ..MapInfo::default()
    };
    bench.map_with(info, &ForceMap::EMPTY);
    assert_eq!(bench.now().slip_evidence, calm.slip_evidence);
}

#[test]
fn an_object_that_is_gone_leaves_no_evidence_to_the_next() {
    let mut bench = quiet_hold(1);
    bench.seen_map(SensorId::FIRST, &carries(5.0, 1.6), MOVES);
    // Whoever sees the object go says so on the empty map that it leaves behind, and on no other.
    bench.seen_map(SensorId::FIRST, &ForceMap::EMPTY, MOVES);
    assert!(bench.now().slip_evidence > 9_000, "{:?}", bench.now());
    bench.wait_ms(16);
    bench.seen_map(SensorId::FIRST, &ForceMap::EMPTY, Motion::UNKNOWN);
    assert_eq!(bench.now().slip_evidence, 0);
    bench.wait_ms(16);
    bench.seen_map(SensorId::FIRST, &carries(2.0, 0.1), Motion::UNKNOWN);
    assert!(bench.now().slip_evidence < 1_000, "{:?}", bench.now());
}

#[test]
fn at_high_rates_motion_in_any_map_of_a_slot_counts() {
    // 200 maps a second of a camera of 60: motion comes with every third, nothing is known between.
    for phase in 0..3 {
        let mut bench = quiet_hold(1);
        let before = bench.line_n();
        for map in 0..24 {
            let motion = if map % 3 == phase { MOVES } else { Motion::UNKNOWN };
            bench.seen_map(SensorId::FIRST, &carries(5.0, 1.6), motion);
            bench.wait_ms(5);
        }
        let after = bench.line_n();
        assert!(after > before + 1.0, "phase {phase}: {before} N became {after} N");
    }
}

#[test]
fn a_grip_that_learns_nothing_does_not_relax_while_motion_is_seen() {
    let fall_n = |motion: Motion| {
        let mut bench = Bench::holding();
        bench.seen_maps_for_ms(&carries(5.0, 1.6), Motion::UNKNOWN, 1_000);
        let line = bench.line_n();
        bench.seen_maps_for_ms(&carries(5.0, 0.8), motion, 2_000);
        line - bench.line_n()
    };
    let blind = fall_n(Motion::UNKNOWN);
    assert!(blind > 1.0, "it relaxes otherwise: {blind} N");
    assert!(fall_n(MOVES) <= 0.0, "{} N", fall_n(MOVES));
}

#[test]
fn a_fingertip_that_falls_silent_in_a_test_does_not_go_on_with_it() {
    let mut bench = Bench::cold();
    bench.message(Message::Hello(Hello::of_this_build(0, 1)));
    bench.command(Command::Configure(Configuration {
        sensors: 2,
        ..Configuration::DEFAULT
    }));
    bench.command(Command::Hold);
    let light = carries(2.0, 0.3);
    for motion in [Motion::UNKNOWN; 120].into_iter().chain([MOVES; 3]) {
        bench.seen_map(SensorId::FIRST, &light, motion);
        bench.seen_map(SensorId::SECOND, &carries(5.0, 1.6), Motion::UNKNOWN);
        bench.wait_ms(16);
    }
    assert!(bench.now().witnesses.shear_follows > 9_000, "{:?}", bench.now());
    // The first one says no more; what the other one holds grows, but needs no more than 7 N.
    let mut line_n = [0.0; 120];
    for (step, line_n) in (0..).zip(&mut line_n) {
        let shear = 1.6 + 0.8 * f64::from(step) / 120.0;
        bench.seen_map(SensorId::SECOND, &carries(8.0, shear), Motion::UNKNOWN);
        bench.wait_ms(16);
        *line_n = bench.line_n();
    }
    let [before, after] = [line_n[10], line_n[119]];
    // A test of its own adds a third.
    assert!(before > 8.0 && after < 1.4 * before, "{before} N, then {after} N");
}

#[test]
fn a_hold_without_a_map_closes_to_the_floor_and_not_with_the_load_before() {
    // What was held before weighed something, or was hardly felt and sought.
    for (map, least) in [(carries(8.0, 3.9), 8.0), (ForceMap::EMPTY, 1.5)] {
        let mut bench = quiet_hold(1);
        bench.seen_maps_for_ms(&map, Motion::UNKNOWN, 1_000);
        let before = bench.line_n();
        // The camera is gone; the host is not.
        let wait = |bench: &mut Bench, for_ms: u64| {
            for _ in 0..for_ms / 90 {
                bench.command(Command::ReadStatus);
                bench.wait_ms(90);
            }
        };
        wait(&mut bench, 180);
        bench.command(Command::Release);
        wait(&mut bench, 1_980);
        assert!(
            before > least && bench.line_n() == 0.0,
            "{before} N, then {} N",
            bench.line_n()
        );
        bench.command(Command::Hold);
        wait(&mut bench, 360);
        let floor = f64::from(Configuration::DEFAULT.floor) / 4_096.0;
        assert!(
            (bench.line_n() - floor).abs() < 0.01,
            "{} N, the floor is {floor} N",
            bench.line_n()
        );
    }
}
