//! Friction that changes with time, speed and place, and mass that is poured in, against closed forms.

use gripline_simulation::constants::GRAVITY_MM_PER_S2;
use gripline_simulation::contact_world::{Shape, Texture};
use gripline_simulation::grasp::{
    ContactModel, Course, FrictionLaw, GraspFrame, GraspScene, GraspWorld, Patch, Pull, Stroke,
};

use crate::{FREE_S, frames};

const FRAME_S: f64 = 1.0 / 60.0;
const FRICTION: f64 = 0.8;

/// A ball of 100 g that may fall far.
fn ball() -> GraspScene {
    GraspScene {
        drop_mm: 100.0,
        ..crate::ball(100.0, 40_000.0, FRICTION)
    }
}

/// What the gels carry upwards, N.
fn carried_n(frame: &GraspFrame) -> f64 {
    -frame.fingers.iter().map(|finger| finger.force_n[1]).sum::<f64>()
}

/// The grip at which friction just holds the weight.
fn needed_n(scene: &GraspScene) -> f64 {
    scene.object.min_grip_n(scene.object.weight_n())
}

#[test]
fn a_world_with_every_adversity_at_nothing_is_the_nominal_world_bit_for_bit() {
    let nominal = GraspScene {
        drop_mm: 6.0,
        ..ball()
    };
    let law = FrictionLaw {
        sliding_share: 1.0,
        speed_mm_per_s: 3.0,
        course: Course::linear(vec![[0.0, 1.0], [1.0, 1.0]]),
        texture: Some(Texture {
            depth: 0.0,
            wavelength_mm: 5.0,
            phase_rad: [0.4, 1.0],
        }),
    };
    let off = GraspScene {
        friction_laws: [law.clone(), law],
        mass_share: Course::linear(vec![[0.0, 1.0], [0.7, 1.0]]),
        ..nominal.clone()
    };
    // It sticks, and it slides out of the grip.
    for share in [1.3, 0.7] {
        let grip_n = share * needed_n(&nominal);
        let [one, other] = [&nominal, &off].map(|scene| frames(scene, grip_n, FRAME_S, 1.0));
        assert_eq!(one, other, "{share} of the needed grip");
        assert_eq!(one.last().unwrap().dropped, share < 1.0);
    }
}

#[test]
fn a_load_decelerates_by_its_sliding_friction_which_falls_with_speed() {
    let mut scene = ball();
    let law = FrictionLaw {
        sliding_share: 0.6,
        speed_mm_per_s: 100.0,
        ..FrictionLaw::default()
    };
    scene.friction_laws = [law.clone(), law.clone()];
    let grip_n = 0.9 * needed_n(&scene);
    let dt_s = 1e-3;
    let frames = frames(&scene, grip_n, dt_s, FREE_S + 0.08);
    let mass = scene.object.mass_g * 1e-6;
    let (mut slow, mut fast) = (0, 0);
    let mut speed = 0.0;
    for pair in frames.windows(2) {
        let [before, now] = [0, 1].map(|k| pair[k].object.velocity_mm_per_s[1]);
        if pair[0].slip && pair[1].slip {
            // The law at the speed of the step before.
            let friction_n = 2.0 * grip_n * FRICTION * law.share(pair[1].time_s, speed);
            let expected = -GRAVITY_MM_PER_S2 + friction_n / mass;
            let found = (now - before) / dt_s;
            assert!(
                (found - expected).abs() < 0.02 * GRAVITY_MM_PER_S2,
                "{} s, {speed} mm/s: {found} mm/s², expected {expected}",
                pair[1].time_s
            );
            assert!((carried_n(&pair[1]) / friction_n - 1.0).abs() < 0.01);
            slow += u32::from(speed < 120.0);
            fast += u32::from(speed > 200.0);
        }
        speed = pair[1].fingers[0].slip_speed_mm_per_s;
    }
    println!("{slow} steps slower than 120 mm/s, {fast} faster than 200 mm/s");
    assert!(slow > 3 && fast > 10, "{slow} {fast}");
}

#[test]
fn an_object_whose_friction_halves_falls_six_millimetres_in_sixty_milliseconds_at_the_oracles_margin() {
    let drop_s = 0.9;
    let mut scene = ball();
    scene.reach_mm = Some(0.1);
    let law = FrictionLaw {
        course: Course::linear(vec![[0.0, 1.0], [drop_s, 1.0], [drop_s, 0.5]]),
        ..FrictionLaw::default()
    };
    scene.friction_laws = [law.clone(), law];
    // The load comes on gently, so that nothing swings.
    let gently = Course::smooth(vec![[FREE_S, 1.0], [FREE_S + 0.25, 0.0]]);
    scene.pulls = vec![Pull::force([0.0, scene.object.weight_n()], gently)];
    let grip_n = 1.3 * needed_n(&scene);
    let frames = frames(&scene, grip_n, 0.02, drop_s + 0.06);
    let before = frames
        .iter()
        .rfind(|frame| frame.time_s < drop_s + 1e-6)
        .unwrap()
        .object
        .at_mm[1];
    let last = frames.last().unwrap();
    // 1.3 / 2 of the weight are still carried.
    let time_s = last.time_s - drop_s;
    let expected = 0.5 * (1.0 - 0.65) * GRAVITY_MM_PER_S2 * time_s * time_s;
    let fallen = before - last.object.at_mm[1];
    let began = frames.iter().find_map(|frame| frame.slid_s).unwrap()[0];
    println!(
        "{:.1} ms after the drop it has fallen {fallen:.2} mm, expected {expected:.2}; it slid from {:.1} ms on",
        1e3 * time_s,
        1e3 * (began - drop_s)
    );
    assert!((fallen / expected - 1.0).abs() < 0.1, "{fallen} {expected}");
    assert!((time_s - 0.06).abs() < 1e-9 && (5.8..6.8).contains(&fallen));
    assert!((began - drop_s).abs() < 0.009, "{began}");
}

#[test]
fn an_object_that_slides_out_of_the_grip_slides_in_every_frame_although_fresh_gel_sticks_at_its_leading_edge()
{
    let shapes = [
        Shape::Sphere { radius_mm: 12.0 },
        Shape::Disc {
            radius_mm: 2.5,
            edge_mm: 0.5,
        },
        Shape::Block {
            sides_mm: [3.0, 5.0],
            edge_mm: 0.5,
        },
    ];
    let mut fresh: f64 = 0.0;
    for contact in [ContactModel::Layer, ContactModel::Brush] {
        for shape in shapes {
            let mut scene = ball();
            scene.contact = contact;
            // Firm enough for gel to stick for a millimetre before friction's limit.
            scene.object.mass_g = 1_000.0;
            scene.object.patch = Patch::Shape(shape);
            let grip_n = 0.8 * needed_n(&scene);
            let frames = frames(&scene, grip_n, 5e-3, FREE_S + 0.06);
            let began = frames.iter().position(|frame| frame.slid_s.is_some()).unwrap();
            let (first, rest) = frames[began..].split_first().unwrap();
            assert!(
                first.time_s < FREE_S + 0.04,
                "{shape:?} {contact:?}: {}",
                first.time_s
            );
            for frame in rest {
                assert!(!frame.dropped && frame.fingers[0].slip_speed_mm_per_s > 10.0);
                let all = [frame.time_s - 5e-3, frame.time_s];
                let slid_s = frame.slid_s.unwrap_or_default();
                fresh = fresh.max(frame.fingers[0].stick_ratio.unwrap());
                assert!(
                    frame.slip && (0..2).all(|i| (slid_s[i] - all[i]).abs() < 1e-9),
                    "{shape:?} {contact:?}, {} s: {frame:?}",
                    frame.time_s
                );
            }
        }
    }
    println!("up to {fresh:.3} of a sliding contact sticks");
    assert!(fresh > 0.05, "{fresh}: nothing that it asks");
}

/// Gel that comes in at the leading edge of a firm contact sticks for a millimetre and more: nearly half of the contact does so when the
/// slide begins slowly.
#[test]
fn a_slide_that_builds_up_slowly_under_a_firm_grip_is_seen_within_a_millimetre() {
    for contact in [ContactModel::Layer, ContactModel::Brush] {
        let mut scene = ball();
        scene.contact = contact;
        scene.object.mass_g = 3_000.0;
        let gently = Course::smooth(vec![[FREE_S, 1.0], [FREE_S + 0.5, 0.0]]);
        scene.pulls = vec![Pull::force([0.0, scene.object.weight_n()], gently)];
        let grip_n = 0.8 * needed_n(&scene);
        let frames = frames(&scene, grip_n, 2e-3, FREE_S + 0.5);
        // Until the gel has stretched to friction's limit, it follows: that is no slide yet.
        let slides = |frame: &GraspFrame| {
            let least = (0.92 * frame.object.velocity_mm_per_s[1].abs()).max(10.0);
            !frame.dropped && (0..2).all(|finger| frame.fingers[finger].slip_speed_mm_per_s > least)
        };
        let first = frames.iter().position(slides).expect("it slides");
        let from_mm = frames[first].fingers[0].slip_mm;
        let sliding: Vec<&GraspFrame> = frames[first..]
            .iter()
            .filter(|frame| slides(frame) && frame.fingers[0].slip_mm > from_mm + 1.0)
            .collect();
        let stick = sliding.iter().map(|frame| frame.fingers[0].stick_ratio.unwrap());
        let fresh = stick.fold(0.0, f64::max);
        let unseen = sliding.iter().filter(|frame| frame.slid_s.is_none()).count();
        println!(
            "{contact:?}: {unseen} of {} frames without a slide; up to {fresh:.2} sticks",
            sliding.len()
        );
        assert!(
            sliding.len() > 5 && unseen == 0,
            "{contact:?}: {unseen} of {}",
            sliding.len()
        );
    }
}

/// A pad ends: what lies beyond hangs over its edge, and what is left of the contact carries the whole grip.
#[test]
fn a_firm_contact_beside_the_middle_leaves_the_grip_where_any_other_does() {
    for contact in [ContactModel::Layer, ContactModel::Brush] {
        let mut scene = ball();
        scene.contact = contact;
        scene.drop_mm = 10.0;
        scene.grip_point_mm = [0.0, -3.0];
        scene.object.mass_g = 2_000.0;
        let grip_n = 0.8 * needed_n(&scene);
        let frames = frames(&scene, grip_n, 2e-3, FREE_S + 0.3);
        let (lost, held): (Vec<&GraspFrame>, Vec<&GraspFrame>) =
            frames.iter().partition(|frame| frame.dropped);
        let (first, last) = (lost.first().expect("it falls"), held.last().unwrap());
        let slid_mm = [last, first].map(|frame| frame.fingers[0].slip_mm);
        println!("{contact:?}, {grip_n:.1} N: slid {slid_mm:?} mm before and after it was lost");
        assert!(slid_mm[0] > 9.0 && slid_mm[1] > 9.99, "{contact:?}: {slid_mm:?}");
        let over = last.fingers[0].forces.iter().take(20).any(|force| force[2] > 0.0);
        assert!(over, "{contact:?}: it does not reach the edge");
        assert!((last.fingers[0].force_n[2] / last.grip_n - 1.0).abs() < 1e-6);
    }
}

#[test]
fn an_object_that_slides_to_and_fro_has_not_left_the_grip() {
    let mut scene = ball();
    scene.drop_mm = 6.0;
    // It floats, and the arm shakes it by more than friction holds.
    scene.pulls = vec![Pull::force([0.0, scene.object.weight_n()], Course::constant(1.0))];
    scene.arm.strokes = vec![Stroke::Shake {
        from_s: FREE_S,
        duration_s: 2.0,
        amplitude_mm: [3.0, 0.0],
        frequency_hz: 6.0,
    }];
    let grip_n = 0.2 * needed_n(&scene);
    let frames = frames(&scene, grip_n, FRAME_S, FREE_S + 2.0);
    let last = frames.last().unwrap();
    let slid_mm = last.fingers[0].slip_mm;
    let from_mm = frames[0].object.at_mm[0];
    let far_mm = frames
        .iter()
        .map(|frame| (frame.object.at_mm[0] - from_mm).abs())
        .fold(0.0, f64::max);
    println!("slid {slid_mm:.1} mm in all, never further than {far_mm:.1} mm from where it was");
    assert!(slid_mm > 18.0 && far_mm < 6.0);
    assert!(!last.dropped && last.fingers.iter().all(|finger| finger.touching));
}

#[test]
fn sliding_over_a_texture_the_gel_carries_the_mean_friction_of_the_place() {
    let mut scene = ball();
    let texture = Texture {
        depth: 0.3,
        wavelength_mm: 12.0,
        phase_rad: [0.5, 0.9],
    };
    let law = FrictionLaw {
        texture: Some(texture),
        ..FrictionLaw::default()
    };
    scene.friction_laws = [law.clone(), law];
    let grip_n = 0.6 * needed_n(&scene);
    let frames = frames(&scene, grip_n, 2e-3, FREE_S + 0.04);
    let sliding: Vec<&GraspFrame> = frames.iter().filter(|frame| frame.slip).collect();
    assert!(sliding.len() > 10);
    for frame in sliding {
        let [sticking, moving] = frame.fingers[0].friction;
        assert!((sticking - moving).abs() < 1e-12);
        let found = carried_n(frame) / (2.0 * frame.grip_n);
        assert!((found / sticking - 1.0).abs() < 0.01, "{found} {sticking}");
        // The contact is small against the wavelength: its mean is near its middle's, at the object's own origin.
        assert!((sticking / (FRICTION * texture.at([0.0; 2])) - 1.0).abs() < 0.1);
    }
}

#[test]
fn a_load_that_is_poured_in_weighs_what_its_course_says_and_is_held_or_not_by_it() {
    let mut scene = ball();
    scene.mass_share = Course::linear(vec![[0.0, 0.5], [0.7, 0.5], [1.7, 1.0]]);
    let grip_n = 0.9 * needed_n(&scene);
    let frames = frames(&scene, grip_n, FRAME_S, 2.0);
    for frame in frames
        .iter()
        .filter(|frame| frame.time_s > FREE_S + 0.1 && !frame.slip)
    {
        let weight_n = scene.object.weight_n() * scene.mass_share.at(frame.time_s);
        assert!((-frame.load[1] / weight_n - 1.0).abs() < 1e-6, "{}", frame.time_s);
    }
    // It slides when nine tenths of the mass are there.
    let began = frames.iter().find_map(|frame| frame.slid_s).unwrap()[0];
    assert!((began - 1.5).abs() < 0.05, "{began} s");
}

#[test]
fn laws_and_masses_out_of_range_are_named() {
    let refused = |change: &dyn Fn(&mut GraspScene)| {
        let mut scene = ball();
        change(&mut scene);
        GraspWorld::new(&scene).unwrap_err().to_string()
    };
    assert!(
        refused(&|scene| scene.friction_laws[1].sliding_share = 0.0).contains("friction sliding_share is 0")
    );
    assert!(refused(&|scene| scene.mass_share = Course::constant(0.0)).contains("mass_share is 0"));
    assert!(refused(&|scene| scene.reach_mm = Some(0.0)).contains("reach_mm is 0"));
    assert!(refused(&|scene| scene.gripper.stick_n = -1.0).contains("gripper stick_n is -1"));
}
