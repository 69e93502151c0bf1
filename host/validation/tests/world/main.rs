//! The contact world and the grasp world against closed forms, statics, dynamics and their own promises;
//! `cargo test -p gripline-validation -- --nocapture` prints the figures.

mod contact;
mod friction;
mod grasp;

use gripline_simulation::ForceMap;
use gripline_simulation::contact_world::Shape;
use gripline_simulation::grasp::{FixedForce, GraspFrame, GraspScene, GraspWorld, Object, Patch};

/// The hand lets go when the grip has settled, s.
const FREE_S: f64 = 0.5;

/// A ball of 12 mm radius in the air, held by a hand until the grip has settled.
fn ball(mass_g: f64, inertia_g_mm2: f64, friction: f64) -> GraspScene {
    let object = Object {
        name: "ball".into(),
        mass_g,
        inertia_g_mm2,
        centre_of_mass_mm: [0.0; 2],
        size_mm: [24.0; 3],
        patch: Patch::Shape(Shape::Sphere { radius_mm: 12.0 }),
        patch_turn_rad: 0.0,
        friction: [friction; 2],
    };
    GraspScene {
        table: None,
        held_until_s: FREE_S,
        cells: 40,
        ..GraspScene::new(object)
    }
}

/// Frames of a scene under a fixed grip, one every `dt_s`.
fn frames(scene: &GraspScene, grip_n: f64, dt_s: f64, duration_s: f64) -> Vec<GraspFrame> {
    let mut world = GraspWorld::new(scene).unwrap().vertical_pressure();
    let mut frames = Vec::new();
    world
        .run(&mut FixedForce(grip_n), dt_s, duration_s, |frame| {
            frames.push(frame.clone());
            true
        })
        .unwrap();
    frames
}

/// Root of the sum of squares of the difference over that of the second, over all components of all taxels.
fn difference(a: &ForceMap, b: &ForceMap) -> f64 {
    let (mut off, mut size) = (0.0, 0.0);
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        off += f64::from(a - b).powi(2);
        size += f64::from(*b).powi(2);
    }
    (off / size).sqrt()
}
