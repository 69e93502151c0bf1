//! A witness is shown maps of loads that are held, slide, grow, swing and move.

use gripline_protocol::message::Configuration;

use super::*;

/// A witness that tests a load of 1,000 of 1/4096 N under 4,000, which all taxels hold.
fn in_its_first_test() -> SlideWitness {
    let mut witness = SlideWitness::default();
    for _ in 0..60 {
        if witness.verdict().tests() {
            return witness;
        }
        show(&mut witness, 1_000, 4_000);
    }
    panic!("a load that has settled was not tested");
}

fn show(witness: &mut SlideWitness, load: i32, normal: i32) {
    see(witness, load, normal, Motion::UNKNOWN);
}

fn see(witness: &mut SlideWitness, load: i32, normal: i32, motion: Motion) {
    let sums = MapSums {
        contact: 30,
        stick: 30,
        force: [load, 0, normal],
        ..MapSums::default()
    };
    let settings = LearningSettings::of(&Configuration::DEFAULT);
    witness.observe(load, &sums, 16_000, motion, 7_000, settings);
}

/// What the test finds while load and normal force change by these shares a map.
fn finding(load_share: f64, normal_share: f64) -> Finding {
    let mut witness = in_its_first_test();
    let (mut load, mut normal) = (1_000.0, 4_000.0);
    for _ in 0..60 {
        (load, normal) = (load * load_share, normal * normal_share);
        show(&mut witness, load as i32, normal as i32);
        if !witness.verdict().tests() {
            return witness.verdict().finding;
        }
    }
    panic!("the test did not end");
}

#[test]
fn a_first_load_that_stays_is_held_one_that_follows_slides_and_one_that_grows_says_nothing() {
    assert_eq!(finding(1.0, 1.06), Finding::Held);
    assert_eq!(finding(1.12, 1.0), Finding::Open);
    // Until the grip has come to hold it.
    let mut witness = in_its_first_test();
    for map in 0..20 {
        let share = 1.06_f64.powi(map);
        show(
            &mut witness,
            (1_000.0 * share.min(1.6)) as i32,
            (4_000.0 * share) as i32,
        );
    }
    assert_eq!(witness.verdict().finding, Finding::Slid);
}

#[test]
fn a_load_that_swings_back_in_a_test_and_rises_with_the_grip_for_a_while_has_not_slid() {
    // The load swings back to so much at once, and rises with the grip up to 1.5.
    let of = |swung: f64| {
        let mut witness = in_its_first_test();
        let test = witness.test.as_mut().expect("it tests");
        (test.is_first, test.limit) = (false, UNLIMITED);
        for map in 1..20 {
            let share = 1.04_f64.powi(map);
            let load = 1_000.0 * share.clamp(swung, 1.5);
            show(&mut witness, load as i32, (4_000.0 * share) as i32);
        }
        witness.verdict().finding
    };
    assert_eq!(of(1.0), Finding::Slid);
    assert_eq!(of(1.5), Finding::Held);
}

/// A hold in which friction suddenly falls from 0.6 to 0.24, and the grip rises until the load is held.
fn after_a_slide() -> SlideWitness {
    let mut witness = SlideWitness::default();
    for _ in 0..120 {
        show(&mut witness, 6_000, 10_000);
    }
    for map in 0..24 {
        let share = 1.05_f64.powi(map).min(2.2);
        show(&mut witness, (2_400.0 * share) as i32, (10_000.0 * share) as i32);
    }
    assert_eq!(witness.verdict().finding, Finding::Slid);
    witness
}

#[test]
fn a_slide_is_taken_back_where_the_shear_falls_as_low_again_under_more_force() {
    let mut witness = after_a_slide();
    let limit = witness.limit();
    show(&mut witness, 5_300, 22_000);
    assert_eq!(witness.limit(), limit);
    for _ in 0..3 {
        show(&mut witness, 2_400, 22_000);
    }
    assert!(!witness.has_slid && witness.carried >= 5_900, "{witness:?}");
    // What stays as it is has slid.
    let mut witness = after_a_slide();
    for _ in 0..120 {
        show(&mut witness, 5_300, 22_000);
    }
    assert!(witness.has_slid && witness.limit < 2_500, "{witness:?}");
}

#[test]
fn a_load_that_has_grown_since_its_test_is_tested_where_it_stalls() {
    let mut witness = in_its_first_test();
    while witness.verdict().tests() {
        let grip = witness.slots.normal[0].min(6_000) * 21 / 20;
        show(&mut witness, 1_000, grip);
    }
    // By a fifth: from the most that the grip has carried it slides.
    for map in 0..5 {
        show(&mut witness, 1_000 + 40 * map, 4_000);
        assert!(!witness.verdict().tests(), "tested at map {map}");
    }
    for _ in 0..6 {
        show(&mut witness, 1_200, 4_000);
    }
    assert!(witness.verdict().tests(), "{witness:?}");
}

#[test]
fn a_load_that_grows_in_a_test_while_the_grip_stays_has_not_slid() {
    // The grip rises by 24 %, by which the test is undecided, and then stays; the load grows by 2 to 7 % a map.
    for growth in [1.02, 1.03, 1.05, 1.07] {
        let mut witness = in_its_first_test();
        for map in 1..60 {
            let normal = 4_000.0 * (1.0 + 0.06 * f64::from(map.min(4)));
            let load = 1_000.0 * (1.0 + 0.027 * f64::from(map.min(4)));
            show(
                &mut witness,
                (load * f64::powi(growth, (map - 20).max(0))) as i32,
                normal as i32,
            );
            if !witness.verdict().tests() {
                break;
            }
            assert!(
                witness.verdict().urgency < Urgency::Follows,
                "{growth}: {witness:?}"
            );
        }
        assert_eq!(witness.verdict().finding, Finding::Open, "{growth}");
        assert_eq!(witness.limit, UNLIMITED, "{growth}");
    }
}

/// A held load that has begun to grow under a grip that stays, by 2.5 % a map.
fn while_its_load_grows() -> (SlideWitness, f64) {
    let mut witness = in_its_first_test();
    while witness.verdict().tests() {
        let grip = witness.slots.normal[0].min(6_000) * 21 / 20;
        show(&mut witness, 1_000, grip);
    }
    let mut load = 1_000.0;
    for _ in 0..20 {
        load *= 1.025;
        show(&mut witness, load as i32, 6_300);
        assert!(!witness.verdict().tests(), "tested as it grew: {witness:?}");
    }
    (witness, load)
}

#[test]
fn a_load_that_grows_alone_is_tested_when_it_no_longer_does() {
    let (mut witness, load) = while_its_load_grows();
    for _ in 0..8 {
        show(&mut witness, load as i32, 6_300);
    }
    assert!(witness.verdict().tests(), "{witness:?}");
}

#[test]
fn after_a_slide_only_a_sudden_fall_limits_friction_further() {
    for (step, is_sudden) in [(133, false), (1_600, true)] {
        let mut witness = after_a_slide();
        for _ in 0..120 {
            show(&mut witness, 5_300, 26_000);
        }
        let limit = witness.limit;
        let mut load = 5_300;
        while !witness.verdict().tests() && load > 3_000 {
            load -= step;
            show(&mut witness, load, 26_000);
        }
        assert!(witness.verdict().tests(), "{witness:?}");
        let mut lowest = witness.limit;
        // The shear rises with the grip.
        for map in 0..24 {
            let share = 1.06_f64.powi(map).min(1.8);
            show(
                &mut witness,
                (f64::from(load) * share) as i32,
                (26_000.0 * share) as i32,
            );
            lowest = lowest.min(witness.limit);
        }
        assert_eq!(lowest < limit, is_sudden, "{limit} became {lowest}");
    }
}

#[test]
fn a_slide_that_the_host_sees_after_one_that_a_test_found_is_not_taken_back() {
    let [moves, rests] = [63, 0].map(|evidence| Motion::new(evidence, 3));
    let mut witness = after_a_slide();
    for (load, motion) in [(3_000, moves), (3_000, moves), (3_000, rests), (2_400, rests)] {
        see(&mut witness, load, 22_000, motion);
    }
    // As low again, but the later slide stands.
    assert!(witness.limit < 1_400, "{witness:?}");
}

#[test]
fn shear_that_falls_by_what_a_map_shows_of_the_normal_force_and_comes_back_has_not_slid() {
    // Twice at the same ratio, as a slide would: of 0.52 N are 0.48 or 0.44 left as the grip sinks from 4.6 to 3.7 N.
    for (low, has_slid) in [(1_966, false), (1_802, true)] {
        let mut witness = in_its_first_test();
        let mut test = witness.test.take().expect("it tests");
        (test.shear, test.normal, test.is_first, test.limit) = (low, 15_155, false, UNLIMITED);
        (witness.load, witness.limit, witness.carried) = (2_130, UNLIMITED, 1_400);
        (witness.slots.shear[0], witness.slots.normal[0]) = (2_300, 18_842);
        assert!(!witness.has_come_back(&test, 2_300), "{low}: once");
        assert_eq!(witness.has_come_back(&test, 2_300), has_slid, "{low}: again");
    }
}

#[test]
fn a_fall_of_a_load_that_has_grown_until_then_is_suspect() {
    for growth in [60, 100, 160] {
        let mut witness = SlideWitness::default();
        for map in 0..2_000 / growth {
            // Every other map shows a little less than it should.
            show(&mut witness, growth * map - growth / 8 * (map % 2), 4_600);
            assert!(!witness.verdict().tests(), "{growth} a map: tested as it grew");
        }
        // It slides.
        let carried = witness.peak * 5 / 6;
        for _ in 0..2 {
            show(&mut witness, carried, 4_600);
        }
        assert!(witness.verdict().tests(), "{growth} a map: {witness:?}");
    }
}

#[test]
fn a_slide_that_begins_in_the_middle_of_a_slot_is_found() {
    for first in [0.95, 0.9, 0.85, 0.8, 0.75] {
        let mut witness = SlideWitness::default();
        for _ in 0..120 {
            show(&mut witness, 6_000, 10_000);
        }
        assert!(!witness.verdict().tests(), "a held load is under test");
        show(&mut witness, (6_000.0 * first) as i32, 10_000);
        let mut has_slid = false;
        for map in 0..20 {
            let share = 1.05_f64.powi(map);
            show(&mut witness, (3_600.0 * share) as i32, (10_000.0 * share) as i32);
            has_slid |= witness.verdict().urgency == Urgency::Follows;
        }
        assert!(has_slid, "{first}");
    }
}

#[test]
fn a_contact_that_has_slid_is_not_believed_to_slide_at_less_than_a_third_of_that() {
    let mut witness = SlideWitness {
        carried: 6_000,
        ..SlideWitness::default()
    };
    assert_eq!(witness.min_friction(), 1_500);
    witness.limit = 6_000;
    assert_eq!(witness.min_friction(), 2_000);
    witness.test = Some(Test {
        shear: 0,
        normal: 1,
        for_us: 0,
        limit: UNLIMITED,
        carried: 0,
        proven: 6_000,
        is_first: false,
        highest: 0,
        is_sudden: false,
        fell_from: 0,
        followed: 0,
        stayed: 0,
        is_confirmed: false,
    });
    assert_eq!(witness.min_friction(), 1_500, "what a test supposes is no slide");
}
