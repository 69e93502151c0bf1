//! Whole grasps without pictures: `cargo run --release -p gripline-simulation --example grasp`. Every built-in
//! object is gripped, lifted, shaken, pulled, twisted, set down and released under an oracle's grip; then what
//! each cost in time . One core. `-- 40` on a grid of 40 cells; a part of a name
//! traces that object's frames.

use std::time::Instant;

use gripline_simulation::grasp::{
    ArmMotion, Course, GraspParts, GraspScene, GraspWorld, OBJECTS, Object, Oracle, Pull, Stroke,
};

const FRAME_S: f64 = 1.0 / 60.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let trace = std::env::args().nth(1);
    println!(
        "{:<32} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>8} {:>8} {:>8}",
        "", "ms/frame", "worst ms", "steps/s", "solves", "peak N", "slip mm", "balance", "SLIP", "dropped"
    );
    let parts = GraspParts::new(&scene(&OBJECTS[0]))?;
    let (mut whole, mut frames) = (0.0, 0);
    for object in &OBJECTS {
        for different in [0.0, 0.05] {
            let mut object = object.clone();
            object.friction[1] += different;
            let scene = scene(&object);
            let mut world = GraspWorld::with_parts(&scene, &parts)?;
            let mut policy = Oracle::new(object.friction[0], 1.0);
            let (mut solves, mut steps, mut peak, mut slip, mut slips) = (0, 0, 0.0_f64, 0.0_f64, 0);
            let (mut count, mut worst, mut balance) = (0, 0.0_f64, 0.0_f64);
            let start = Instant::now();
            let mut last = start;
            let ended = world.run(&mut policy, FRAME_S, 6.0, |frame| {
                let took = last.elapsed().as_secs_f64() * 1e3;
                last = Instant::now();
                worst = worst.max(took);
                (steps, solves, count) = (steps + frame.steps, solves + frame.solves, count + 1);
                peak = peak.max(frame.grip_n);
                slip = slip.max(frame.fingers[0].slip_mm);
                balance = balance.max(frame.balance);
                slips += u32::from(frame.slip);
                if trace.as_deref().is_some_and(|name| object.name.contains(name)) {
                    let finger = &frame.fingers[0];
                    println!(
                        "{:.3} grip {:.2} at {:.3} {:.3} turn {:.4} load {:.3} {:.3} {:.2} F {:.3} {:.3} {:.3} M {:.2} sr {:.2} slip {:.3} v {:.2} {} {} {} steps {} solves {} bal {:.1e} {took:.2} ms",
                        frame.time_s, frame.grip_n, frame.object.at_mm[0], frame.object.at_mm[1], frame.object.turn_rad,
                        frame.load[0], frame.load[1], frame.load[2], finger.force_n[0], finger.force_n[1], finger.force_n[2], finger.torsional_moment_nmm,
                        finger.stick_ratio.unwrap_or(-1.0), finger.slip_mm, finger.slip_speed_mm_per_s,
                        if frame.slip {"SLIP"} else {""}, if frame.on_table {"table"} else {""}, if frame.dropped {"DROPPED"} else {""},
                        frame.steps, frame.solves, frame.balance
                    );
                }
                true
            });
            let took = start.elapsed().as_secs_f64();
            if let Err(error) = ended {
                println!("{}: {error}", object.name);
            }
            whole += took;
            frames += count;
            println!(
                "{:<32} {:8.2} {:8.2} {:8.0} {:8.1} {:7.2} {:7.3} {:8.1e} {:8} {:>8}",
                object.name,
                took * 1e3 / f64::from(count),
                worst,
                steps as f64 / took,
                solves as f64 / f64::from(count),
                peak,
                slip,
                balance,
                slips,
                world.frame().dropped
            );
        }
    }
    println!("{:.2} ms a frame over all", whole * 1e3 / f64::from(frames));
    Ok(())
}

/// Six seconds with a bit of everything, loads in proportion to the object's weight.
fn scene(object: &Object) -> GraspScene {
    let mut scene = GraspScene::new(object.clone());
    if let Some(cells) = std::env::args().find_map(|word| word.parse().ok()) {
        scene.cells = cells;
    }
    let pull = object.weight_n().max(0.3);
    scene.arm = ArmMotion {
        strokes: vec![
            Stroke::Move {
                from_s: 1.0,
                duration_s: 0.8,
                by_mm: [0.0, 60.0],
            },
            Stroke::Shake {
                from_s: 2.0,
                duration_s: 1.0,
                amplitude_mm: [4.0, 0.0],
                frequency_hz: 3.0,
            },
            Stroke::Move {
                from_s: 4.6,
                duration_s: 0.6,
                by_mm: [0.0, -60.0],
            },
        ],
    };
    scene.pulls = vec![
        Pull::force(
            [0.6 * pull, -0.8 * pull],
            Course::smooth(vec![[3.0, 0.0], [3.4, 1.0], [3.6, 1.0], [3.8, 0.0]]),
        ),
        Pull::torsion(
            3.0 * pull,
            Course::smooth(vec![[3.8, 0.0], [4.2, 1.0], [4.4, 0.0]]),
        ),
    ];
    scene
}
