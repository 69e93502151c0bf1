//! Friction that falls while something is held, in closed loop: the contact carries its load or, where that is more than friction
//! times normal force, slides and carries that. Friction is known here alone.

use gripline_firmware::{Fault, GripForce};
use gripline_protocol::message::{Command, Configuration, Hello, Message};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, MapInfo, Motion, SensorId};

use crate::bench::Bench;
use crate::grasp_world::contact_map;

/// A hold with the shipped settings.
struct Hold {
    bench: Bench,
    fingertips: u8,
    period_ms: u64,
    normal: f64,
    /// Share of the forces that maps show, and what the host sees of the object.
    seen: f64,
    motion: Motion,
    /// How long the contact has slid, s, and how often the line fell later than 42 ms after a slide began.
    slid: f64,
    late_falls: u32,
    slides_for: f64,
    line: f64,
    /// With one fingertip: the object has the mass of its load, which a slide sets in motion. Its speed, m/s, and how often it began to
    /// slide.
    has_mass: bool,
    speed: f64,
    slides: u32,
}

impl Hold {
    fn new(fingertips: u8, period_ms: u64) -> Self {
        let mut bench = Bench::cold();
        bench.message(Message::Hello(Hello::of_this_build(0, 1)));
        bench.command(Command::Configure(Configuration {
            sensors: fingertips,
            ..Configuration::DEFAULT
        }));
        bench.command(Command::Hold);
        Self {
            bench,
            fingertips,
            period_ms,
            normal: 0.0,
            seen: 1.0,
            motion: Motion::UNKNOWN,
            slid: 0.0,
            late_falls: 0,
            slides_for: 0.0,
            line: 0.0,
            has_mass: false,
            speed: 0.0,
            slides: 0,
        }
    }

    /// A load and a friction per fingertip, for some seconds.
    fn go(&mut self, seconds: f64, load: impl Fn(f64) -> f64, friction: [f64; 2]) {
        let maps = (seconds * 1e3) as u64 / self.period_ms;
        for map in 0..maps {
            let load = load((map * self.period_ms) as f64 / 1e3);
            for _ in 0..self.period_ms {
                self.bench.now_us += 1_000;
                let _ = self.bench.device.tick(self.bench.now_us);
                let line: GripForce = self.bench.device.program.line();
                self.normal += (f64::from(line.lsb()) / f64::from(LSB_PER_NEWTON) - self.normal) / 60.0;
                let excess = load - friction[0] * self.normal;
                if self.has_mass && (self.speed > 0.0 || excess > 0.0) {
                    self.speed = (self.speed + 1e-3 * 9.81 * excess / load).max(0.0);
                }
            }
            self.bench.listen();
            let line = f64::from(self.bench.device.program.line().lsb()) / f64::from(LSB_PER_NEWTON);
            // Two fingertips share the object: while both slide it slides. Less than a percent is less than a map shows.
            let slides = if self.has_mass {
                self.speed > 0.0
            } else {
                friction
                    .iter()
                    .take(self.fingertips.into())
                    .all(|mu| mu * self.normal < 0.99 * load)
            };
            self.slides += u32::from(slides && self.slides_for == 0.0);
            self.late_falls += u32::from(self.slides_for > 0.042 && line < self.line - 1e-3);
            self.slides_for = if slides {
                self.slides_for + self.period_ms as f64 / 1e3
            } else {
                0.0
            };
            self.slid += if slides { self.period_ms as f64 / 1e3 } else { 0.0 };
            self.line = line;
            for sensor in SensorId::ALL.into_iter().take(self.fingertips.into()) {
                let mu = friction[sensor.index()];
                // What still moves is braked by more than its load.
                let shear = if self.speed > 0.0 {
                    mu * self.normal
                } else {
                    load.min(mu * self.normal)
                };
                let [normal, shear] = [self.normal, shear].map(|force| self.seen * force);
                let map = contact_map(normal, shear, normal, shear, mu, slides);
                self.bench.sequence += 1;
                let info = MapInfo {
                    sensor,
                    sequence: self.bench.sequence,
                    capture_us: self.bench.now_us as u32,
                    motion: self.motion,
                    ..MapInfo::default()
                };
                let _ = self.bench.map_with(info, &map);
            }
            self.bench.reports.clear();
        }
    }
}

#[test]
fn friction_that_falls_in_a_hold_raises_the_line_until_it_holds() {
    for fingertips in [1, 2] {
        for period_ms in [7, 17, 40] {
            for (before, after) in [(0.8, 0.4), (0.8, 0.3), (0.9, 0.6), (0.6, 0.25), (0.5, 0.4)] {
                for load in [0.5, 3.0] {
                    let mut hold = Hold::new(fingertips, period_ms);
                    hold.go(4.0, |time| load * time.min(1.0), [before; 2]);
                    hold.go(4.0, |_| load, [after; 2]);
                    let case =
                        format!("{fingertips} fingertips, {period_ms} ms, {before} to {after}, {load} N");
                    assert!(
                        hold.slides_for == 0.0,
                        "{case}: still slides at {} N",
                        hold.normal
                    );
                    assert!(hold.slid < 1.0, "{case}: slid for {} s", hold.slid);
                    assert!(
                        hold.late_falls == 0,
                        "{case}: the line fell at {} maps",
                        hold.late_falls
                    );
                }
            }
        }
    }
}

#[test]
fn a_slide_that_the_grip_has_stopped_is_remembered() {
    for period_ms in [7, 17] {
        for (before, load, share) in [
            (0.8, 3.0, 0.87),
            (0.8, 3.0, 0.85),
            (0.8, 1.0, 0.85),
            (0.9, 2.0, 0.85),
        ] {
            let mut hold = Hold::new(1, period_ms);
            hold.has_mass = true;
            hold.go(4.0, |time| load * time.min(1.0), [before; 2]);
            // To this share of what the grip needs.
            let after = share * load / hold.normal;
            hold.slides = 0;
            let mut highest = 0.0_f64;
            for _ in 0..80 {
                hold.go(0.05, |_| load, [after; 2]);
                highest = highest.max(hold.line);
            }
            let case = format!("{period_ms} ms, {before} to {after:.2}, {load} N");
            assert_eq!(hold.slides, 1, "{case}: slides; {} N at last", hold.line);
            // While the shear hides the load, the grip rises to twice what that needs, with its margin.
            assert!(highest < 3.0 * load / after, "{case}: up to {highest} N");
        }
    }
}

#[test]
fn a_slide_is_remembered_for_as_long_as_the_contact_lasts() {
    for friction in [0.2, 0.3, 0.4] {
        let mut hold = Hold::new(1, 17);
        hold.has_mass = true;
        hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
        hold.go(4.0, |_| 3.0, [friction; 2]);
        hold.slides = 0;
        let line = hold.line;
        hold.go(120.0, |_| 3.0, [friction; 2]);
        assert_eq!(hold.slides, 0, "{friction}: {line} N, then {} N", hold.line);
        assert!(
            hold.line > 0.9 * line,
            "{friction}: {line} N, then {} N",
            hold.line
        );
    }
}

/// A load that is held all the time and that, by the maps, is a little less for a fifth of a second every two seconds.
fn wavering(newtons: f64, share: f64) -> impl Fn(f64) -> f64 {
    move |time| newtons * if time % 2.0 > 1.8 { 1.0 - share } else { 1.0 }
}

#[test]
fn a_held_load_that_wavers_at_the_same_grip_again_and_again_has_not_slid() {
    for share in [0.02, 0.03, 0.05] {
        let mut hold = Hold::new(1, 17);
        hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
        let line = hold.line;
        hold.go(61.0, wavering(3.0, share), [0.8; 2]);
        let case = format!("{share}: {line} N, then {} N", hold.line);
        // A fifth of the friction is forgotten.
        assert!(hold.line < 1.05 * line / 0.8, "{case}");
    }
}

#[test]
fn a_contact_that_slides_from_the_first_load_on_is_found_below_the_detectors_friction() {
    for period_ms in [7, 17, 40] {
        for friction in [0.2, 0.3, 0.4] {
            for load in [0.4, 1.5, 3.0] {
                let mut hold = Hold::new(1, period_ms);
                hold.go(3.0, |time| load * (2.0 * time).min(1.0), [friction; 2]);
                let case = format!("{period_ms} ms, {friction}, {load} N");
                assert!(
                    hold.slides_for == 0.0,
                    "{case}: still slides at {} N",
                    hold.normal
                );
                assert!(
                    hold.late_falls == 0,
                    "{case}: the line fell at {} maps",
                    hold.late_falls
                );
            }
        }
    }
}

#[test]
fn a_first_load_below_the_detectors_friction_lets_the_line_fall_only_after_a_test() {
    for friction in [0.2, 0.3, 0.4] {
        for rise_s in [0.1, 0.4, 1.0] {
            let mut hold = Hold::new(1, 17);
            // A touch that maps hardly show raises the line. Then they show it, and the line falls by plan.
            hold.seen = 0.3;
            hold.go(0.6, |_| 0.02, [1.0; 2]);
            hold.seen = 1.0;
            hold.go(0.3, |_| 0.02, [1.0; 2]);
            let mut line = hold.line;
            let mut is_tested = false;
            for step in 0..40 {
                let load = |time: f64| 0.3 * ((f64::from(step) * 0.034 + time) / rise_s).min(1.0);
                hold.go(0.034, load, [friction; 2]);
                is_tested |= hold.line > line + 0.5;
                // 0.05 N is the least load that counts; two maps more are the mean of a slot.
                let counts = f64::from(step) * 0.034 / rise_s * 0.3 > 0.12;
                assert!(
                    is_tested || !counts || hold.line >= line - 1e-3,
                    "friction {friction}, {rise_s} s: {line} N to {} N at {} s",
                    hold.line,
                    f64::from(step) * 0.034
                );
                line = hold.line;
            }
            assert!(is_tested, "friction {friction}, {rise_s} s");
        }
    }
}

#[test]
fn a_load_too_small_to_be_tested_does_not_hold_up_a_firm_grip() {
    let floor = f64::from(Configuration::DEFAULT.floor) / f64::from(LSB_PER_NEWTON);
    for load in [0.06, 0.08, 0.1] {
        let mut hold = Hold::new(1, 17);
        // A touch that maps hardly show raises the line.
        hold.seen = 0.3;
        hold.go(0.6, |_| 0.02, [1.0; 2]);
        let firm = hold.line;
        assert!(firm > 1.5 * floor, "{firm} N");
        // Below 7 % of the normal force a shear may be the error of the map.
        hold.seen = 1.0;
        hold.go(3.0, |_| load, [0.8; 2]);
        assert!(
            hold.line < 1.1 * floor,
            "{load} N: from {firm} N to {} N",
            hold.line
        );
    }
}

#[test]
fn a_load_that_grows_in_steps_is_not_tested_where_the_stick_ratio_shows_higher_friction() {
    let settings = Configuration::DEFAULT;
    for friction in [0.8, 0.9, 1.1] {
        let mut hold = Hold::new(1, 17);
        let mut load = 0.5;
        hold.go(3.0, |time| load * time.min(1.0), [friction; 2]);
        for _ in 0..6 {
            let grown = 1.35 * load;
            hold.go(
                0.7,
                |time| load + (grown - load) * (time / 0.3).min(1.0),
                [friction; 2],
            );
            load = grown;
        }
        // A test adds a third to this.
        let needed = load * (1.0 + f64::from(settings.margin) / 1e4) / (f64::from(settings.friction) / 1e4);
        assert!(
            hold.line < 1.05 * needed,
            "friction {friction}, {load} N: {} N instead of {needed} N",
            hold.line
        );
    }
}

#[test]
fn a_first_load_that_grows_in_its_test_is_tried_again() {
    for friction in [0.2, 0.3, 0.4] {
        for pause_s in [0.15, 0.3, 0.5] {
            let mut hold = Hold::new(1, 17);
            // A load that seems to have settled is tested, and grows meanwhile; then it slides while all taxels stick by the detector.
            hold.go(pause_s, |_| 0.15, [friction; 2]);
            hold.go(0.1, |time| 0.15 + 8.5 * time, [friction; 2]);
            hold.go(2.0, |_| 1.0, [friction; 2]);
            let case = format!("friction {friction}, {pause_s} s");
            assert!(
                hold.slides_for == 0.0,
                "{case}: still slides at {} N",
                hold.normal
            );
            assert!(hold.slid < 0.6, "{case}: slid for {} s", hold.slid);
        }
    }
}

#[test]
fn a_slide_that_takes_a_twentieth_of_the_shear_is_found_soon_in_a_quiet_hold() {
    let mut hold = Hold::new(1, 17);
    hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    assert!(hold.slid < 0.1, "slid for {} s before", hold.slid);
    let before_s = hold.slid;
    let after = 0.95 * 3.0 / hold.normal;
    hold.go(1.0, |_| 3.0, [after; 2]);
    assert!(hold.slides_for == 0.0, "still slides at {} N", hold.normal);
    assert!(hold.slid - before_s < 0.3, "slid for {} s", hold.slid - before_s);
}

#[test]
fn shear_that_maps_err_by_and_that_follows_the_grip_is_no_friction() {
    for error in [0.06, 0.08, 0.1] {
        let mut hold = Hold::new(1, 17);
        // Nothing pulls, but maps show a share of the normal force as shear.
        hold.go(2.0, |_| 5.0, [error; 2]);
        let load = 1.0;
        hold.go(2.0, |time| load * (time / 0.5).min(1.0), [0.8; 2]);
        let needed = 1.3 * load / (f64::from(Configuration::DEFAULT.friction) / 1e4);
        assert!(
            hold.line < 1.4 * needed,
            "{error}: {} N where {needed} N do",
            hold.line
        );
    }
}

/// A hold of 3 N, right after a test: a dip of the load began it, and it found the load held.
fn held_after_a_test() -> Hold {
    let mut hold = Hold::new(1, 17);
    hold.go(3.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    hold.go(0.1, |_| 2.6, [0.8; 2]);
    hold.go(0.15, |_| 3.0, [0.8; 2]);
    hold
}

#[test]
fn shear_that_falls_far_is_tested_also_right_after_a_test_that_found_it_held() {
    let mut hold = held_after_a_test();
    hold.go(2.0, |_| 3.0, [0.3; 2]);
    assert!(hold.slides_for == 0.0, "still slides at {} N", hold.normal);
    assert!(hold.slid < 0.4, "slid for {} s", hold.slid);
}

#[test]
fn shear_that_falls_by_a_sixth_is_tested_also_right_after_a_test_that_found_it_held() {
    let mut hold = held_after_a_test();
    let before_s = hold.slid;
    let after = 5.0 / 6.0 * 3.0 / hold.normal;
    hold.go(2.0, |_| 3.0, [after; 2]);
    assert!(hold.slides_for == 0.0, "still slides at {} N", hold.normal);
    assert!(hold.slid - before_s < 0.15, "slid for {} s", hold.slid - before_s);
}

#[test]
fn maps_that_show_too_much_are_scaled_back_while_the_host_sees_the_object() {
    let line = |seen: f64, motion: Motion| {
        let mut hold = Hold::new(1, 17);
        (hold.seen, hold.motion) = (seen, motion);
        hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
        assert!(hold.slid < 0.1, "{seen}: slid for {} s", hold.slid);
        hold.line
    };
    let rests = Motion::new(0, 3);
    // Without a view of the object nothing is taken back. A grip that is firmer from the start lets the load prove less friction, so
    // the line grows by more than what maps show too much.
    for (seen, blind_min, watched_max) in [(1.1, 1.15, 1.09), (1.25, 1.4, 1.2)] {
        let [blind, watched] = [Motion::UNKNOWN, rests].map(|motion| line(seen, motion) / line(1.0, motion));
        assert!(blind > blind_min, "{seen}: {blind} of the line, not seen");
        assert!(
            (0.97..watched_max).contains(&watched),
            "{seen}: {watched} of the line, seen"
        );
    }
}

#[test]
fn without_a_new_map_the_line_does_not_fall_by_plan() {
    let mut hold = Hold::new(1, 17);
    hold.go(2.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    hold.go(1.5, |_| 3.0, [0.8; 2]);
    // The load goes, so the line falls by plan.
    hold.go(1.5, |_| 0.5, [0.8; 2]);
    let falling = hold.line;
    hold.go(0.1, |_| 0.5, [0.8; 2]);
    assert!(hold.line < falling - 0.05, "{falling} N to {} N", hold.line);
    let line_after = |bench: &mut Bench, passed_ms: u64| {
        for _ in 0..passed_ms {
            bench.now_us += 1_000;
            let _ = bench.device.tick(bench.now_us);
        }
        bench.device.program.line()
    };
    let at_20_ms = line_after(&mut hold.bench, 21);
    // Less than what makes maps stale.
    assert_eq!(line_after(&mut hold.bench, 25), at_20_ms);
}

#[test]
fn a_load_that_swings_is_not_held_ever_more_firmly() {
    for (hertz, share, most) in [
        (1.5, 0.4, 5.0),
        (3.0, 0.3, 5.0),
        (6.0, 0.2, 6.0),
        (8.0, 0.2, 6.0),
        (12.0, 0.2, 5.0),
    ] {
        for friction in [0.5, 0.7, 0.9] {
            for load in [0.5, 1.0, 3.0] {
                let mut hold = Hold::new(1, 17);
                hold.go(4.0, |time| load * time.min(1.0), [friction; 2]);
                let mut highest = 0.0_f64;
                for second in 0..20 {
                    let swung = |time: f64| {
                        let turns = hertz * (f64::from(second) + time);
                        load * (1.0 + share * (std::f64::consts::TAU * turns).sin())
                    };
                    hold.go(1.0, swung, [friction; 2]);
                    highest = highest.max(hold.line);
                }
                let times = highest * friction / (load * (1.0 + share));
                let case = format!("{hertz} Hz, {share}, friction {friction}, {load} N");
                assert!(times < most, "{case}: {times:.1} times what is needed");
                assert!(hold.slid == 0.0, "{case}: slid for {} s", hold.slid);
            }
        }
    }
}

#[test]
fn a_load_that_recedes_is_tested_without_the_tests_adding_up() {
    for friction in [0.5, 0.7, 0.9] {
        for seconds in [2.0, 4.0] {
            let mut hold = Hold::new(1, 17);
            hold.go(3.0, |time| 3.0 * (time / 2.0).min(1.0), [friction; 2]);
            let (held, mut highest) = (hold.line, 0.0_f64);
            for step in 0..20 {
                let load = |time: f64| 3.0 - 2.5 * (f64::from(step) / 20.0 + time / seconds);
                hold.go(seconds / 20.0, load, [friction; 2]);
                highest = highest.max(hold.line);
            }
            let case = format!("friction {friction}, in {seconds} s: {held:.1} N, then {highest:.1} N");
            // What one test adds.
            assert!(highest < 1.42 * held, "{case}");
            assert!(hold.slid == 0.0, "{case}: slid for {} s", hold.slid);
        }
    }
}

#[test]
fn friction_that_falls_twice_and_a_load_that_grows_are_held() {
    let mut hold = Hold::new(1, 17);
    hold.go(3.0, |time| 2.0 * time.min(1.0), [0.9; 2]);
    hold.go(3.0, |_| 2.0, [0.6; 2]);
    hold.go(3.0, |_| 2.0, [0.35; 2]);
    hold.go(3.0, |time| 2.0 + time.min(1.0), [0.35; 2]);
    assert!(
        hold.slides_for == 0.0 && hold.late_falls == 0,
        "{} N",
        hold.normal
    );
}

#[test]
fn friction_that_falls_again_soon_after_a_first_fall_is_held() {
    for gap in [0.1, 0.2, 0.3, 0.4, 0.6] {
        for frictions in [[0.8, 0.5, 0.3], [0.8, 0.4, 0.2], [0.6, 0.4, 0.25]] {
            let mut hold = Hold::new(1, 17);
            hold.go(3.0, |time| 2.0 * time.min(1.0), [frictions[0]; 2]);
            hold.go(gap, |_| 2.0, [frictions[1]; 2]);
            hold.go(3.0, |_| 2.0, [frictions[2]; 2]);
            let case = format!("{frictions:?} after {gap} s: {} N", hold.normal);
            assert!(hold.slides_for == 0.0, "{case}: still slides");
            assert!(hold.slid < 1.0, "{case}: slid for {} s", hold.slid);
        }
    }
}

#[test]
fn one_wet_fingertip_is_found_beside_a_dry_one() {
    let mut hold = Hold::new(2, 17);
    hold.go(3.0, |time| 2.0 * time.min(1.0), [0.8; 2]);
    hold.go(3.0, |_| 2.0, [0.3, 0.8]);
    // The dry one may hold alone, but the wet one must not let the line fall.
    assert!(hold.normal * 0.3 > 2.0, "{} N", hold.normal);
}

/// What a wet fingertip with this friction still carries, beside a dry one that nobody feels and that takes over whatever slides.
fn carry_beside_another(hold: &mut Hold, share: &mut f64, friction: f64, seconds: f64) -> f64 {
    let mut lowest = hold.line;
    for _ in 0..(seconds * 1e3) as u64 / hold.period_ms {
        *share = share.min(friction * hold.normal);
        let carried = *share;
        hold.go(hold.period_ms as f64 / 1e3, |_| carried, [1.0; 2]);
        lowest = lowest.min(hold.line);
    }
    lowest
}

#[test]
fn what_a_wet_fingertip_no_longer_carries_beside_a_dry_one_is_still_held() {
    for period_ms in [10, 17, 33] {
        for (before, after) in [(0.8, 0.3), (0.9, 0.3), (0.6, 0.25)] {
            let mut hold = Hold::new(1, period_ms);
            hold.go(3.0, |time| 2.0 * time.min(1.0), [before; 2]);
            let (held, mut share) = (hold.line, 2.0);
            let lowest = carry_beside_another(&mut hold, &mut share, after, 4.0);
            let case = format!("{period_ms} ms, {before} to {after}, carries {share} of 2 N");
            assert!(share < 1.9, "{case}: did not slide");
            assert!(lowest > 0.95 * held, "{case}: from {held} N to {lowest} N");
            // Nobody may ever need it again.
            let lowest = carry_beside_another(&mut hold, &mut share, after, 40.0);
            assert!(lowest < 0.8 * held, "{case}: still at {lowest} N");
        }
    }
}

#[test]
fn a_load_that_suddenly_falls_and_comes_back_is_held_no_more_firmly() {
    let mut undisturbed = Hold::new(1, 17);
    undisturbed.go(3.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    undisturbed.go(4.0, |_| 3.0, [0.8; 2]);
    let mut hold = Hold::new(1, 17);
    hold.go(3.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    hold.go(1.0, |_| 2.0, [0.8; 2]);
    assert!(
        hold.line > 0.98 * undisturbed.line,
        "{} N while it is away",
        hold.line
    );
    hold.go(3.0, |_| 3.0, [0.8; 2]);
    assert!(
        hold.line < 1.03 * undisturbed.line,
        "{} N, undisturbed {} N",
        hold.line,
        undisturbed.line
    );
}

#[test]
fn a_hold_that_nothing_disturbs_is_not_tested_again_and_again() {
    for load in [0.3, 3.0] {
        let mut hold = Hold::new(1, 17);
        hold.go(4.0, |time| load * time.min(1.0), [0.8; 2]);
        let (settled, mut before) = (hold.line, hold.line);
        for _ in 0..20 {
            hold.go(1.0, |_| load, [0.8; 2]);
            // A test adds a third; what is forgotten, 2 % a second and a quarter at most.
            assert!(
                hold.line <= 1.025 * before && hold.line <= settled * 1.001 / 0.8,
                "from {settled} N, {before} N a second ago, to {} N",
                hold.line
            );
            before = hold.line;
        }
    }
}

#[test]
fn a_load_that_is_taken_away_lets_the_line_come_down() {
    let mut hold = Hold::new(1, 17);
    hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
    let loaded = hold.line;
    hold.go(4.0, |time| 3.0 - 2.4 * time.min(1.0), [0.8; 2]);
    assert!(hold.line < loaded / 2.0, "from {loaded} N to {} N", hold.line);
    let faults = hold.bench.faults();
    assert_eq!(faults & Fault::LineAtCeiling.bit(), 0);
}

#[test]
fn a_release_in_a_test_of_a_slide_leaves_nothing_to_the_next_grasp() {
    // Whether the load comes off while the line is tested, on its way back, or neither: the next grasp begins at the floor.
    for taken_s in [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6] {
        let mut hold = Hold::new(1, 17);
        hold.go(4.0, |time| 3.0 * time.min(1.0), [0.8; 2]);
        hold.go(taken_s, |time| 3.0 - 4.0 * time.min(0.7), [0.8; 2]);
        hold.bench.command(Command::Release);
        hold.go(1.0, |_| 0.0, [0.8; 2]);
        assert_eq!(hold.bench.device.program.line(), GripForce::ZERO);
        hold.bench.command(Command::Hold);
        let floor = f64::from(Configuration::DEFAULT.floor) / f64::from(LSB_PER_NEWTON);
        let closed = hold.bench.wait_ms(100);
        assert!(
            f64::from(closed.lsb()) / f64::from(LSB_PER_NEWTON) < floor + 1.01,
            "released after {taken_s} s: {} LSB",
            closed.lsb()
        );
    }
}

#[test]
fn an_object_that_leaves_the_skin_in_a_test_of_a_slide_does_not_let_the_line_fall() {
    for fingertips in [1, 2] {
        let mut hold = Hold::new(fingertips, 17);
        hold.go(3.0, |time| 2.0 * time.min(1.0), [0.8; 2]);
        let held = hold.line;
        while hold.line < held + 1.0 {
            hold.go(0.017, |_| 2.0, [0.3; 2]);
        }
        let risen = hold.bench.device.program.line();
        // Of two fingertips one goes on to feel it.
        for _ in 0..5 {
            hold.bench.map(&ForceMap::EMPTY);
            assert!(hold.bench.wait_ms(16) >= risen, "{fingertips} fingertips");
        }
    }
}

#[test]
fn maps_that_stop_after_a_test_do_not_let_the_line_fall() {
    let mut hold = Hold::new(1, 17);
    hold.go(3.0, |time| 2.0 * time.min(1.0), [0.8; 2]);
    let mut fell_n: f64 = 0.0;
    // A load that swings is tested, and held; whenever the line falls fast, maps stop.
    for step in 0..600 {
        let before = hold.line;
        hold.go(
            0.017,
            |_| 1.4 + 0.6 * f64::from(step).mul_add(0.04, 0.0).cos(),
            [0.8; 2],
        );
        if hold.line < before - 0.2 {
            let line = hold.bench.wait_ms(20).lsb();
            let later = hold.bench.wait_ms(60).lsb();
            fell_n = f64::from(line - later) / f64::from(LSB_PER_NEWTON);
            break;
        }
    }
    assert!(hold.line > 0.0 && fell_n <= 0.1, "{fell_n} N without a map");
}

#[test]
fn what_a_test_of_a_contact_that_ended_planned_does_not_loosen_the_next_one() {
    let mut hold = Hold::new(1, 17);
    hold.go(3.0, |time| 2.0 * time.min(1.0), [0.8; 2]);
    // Friction falls, a test finds the slide, and the line is on its way back: then the object is gone.
    let mut is_on_its_way = false;
    for _ in 0..400 {
        let before = hold.line;
        hold.go(0.017, |_| 2.0, [0.3; 2]);
        is_on_its_way = hold.line < before - 0.2;
        if is_on_its_way {
            break;
        }
    }
    assert!(is_on_its_way, "{} N", hold.line);
    for _ in 0..12 {
        hold.bench.map(&ForceMap::EMPTY);
        hold.bench.wait_ms(16);
    }
    let empty = hold.bench.wait_ms(1).lsb();
    // Somebody gives it back: a first load, whose friction nothing is known of.
    hold.go(0.2, |_| 1.5, [0.3; 2]);
    let line = hold.bench.wait_ms(1).lsb();
    assert!(
        line >= empty,
        "{} N became {} N",
        f64::from(empty) / f64::from(LSB_PER_NEWTON),
        f64::from(line) / f64::from(LSB_PER_NEWTON)
    );
}

#[test]
fn settings_that_do_not_learn_leave_the_line_where_a_slide_raised_it() {
    for settings in [
        Configuration::CAREFUL,
        Configuration {
            friction_max: Configuration::DEFAULT.friction,
            ..Configuration::DEFAULT
        },
    ] {
        let mut hold = Hold::new(1, 17);
        hold.go(4.0, |time| 2.0 * time.min(1.0), [0.2; 2]);
        let line = hold.line;
        hold.bench.command(Command::Configure(settings));
        hold.go(15.0, |_| 2.0, [0.2; 2]);
        assert!(hold.line >= line, "{line} N became {} N", hold.line);
    }
}
