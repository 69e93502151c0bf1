//! What a coupled contact step costs: `cargo run --release -p gripline-simulation --example contact_world`.
//! A 12 mm sphere on the default gel, pressed, then dragged and twisted in small steps until it slides, then
//! back; then every built-in shape; then whole training samples. One core.

use std::sync::Arc;
use std::time::Instant;

use gripline_simulation::contact_world::{
    Contact, Drive, HeightMap, Mount, Press, Shape, Skin, TRAINING_SHAPES, UNSEEN_SHAPES,
};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image, block_mean_88};

const FRICTION: f64 = 0.65;
const STEPS: u32 = 20;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let gel = Gel::default();
    println!(
        "{:<30} {:>9} {:>9} {:>7} {:>7} {:>6} {:>6}",
        "", "press ms", "drag ms", "normal", "shear", "rounds", "cells"
    );
    for cells in [40, 80] {
        let start = Instant::now();
        let skin = Arc::new(Skin::new(&gel, cells)?);
        println!(
            "influence of {cells} x {cells} cells {:31.1} ms",
            start.elapsed().as_secs_f64() * 1e3
        );
        for force_n in [1.0, 5.0, 10.0] {
            let sphere: Arc<dyn HeightMap> = Arc::new(Shape::Sphere { radius_mm: 12.0 });
            path(
                &format!("sphere, {force_n} N, {cells} x {cells}"),
                &skin,
                &sphere,
                force_n,
            )?;
        }
    }
    let skin = Arc::new(Skin::new(&gel, 40)?);
    for shape in TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES) {
        let indenter: Arc<dyn HeightMap> = Arc::new(shape);
        path(&format!("{}, 2 N, 40 x 40", shape.name()), &skin, &indenter, 2.0)?;
    }
    rendered(&Arc::new(Skin::new(&gel, 40)?))
}

/// Training as it would go: press in eight steps, then eight loads with an image each.
fn rendered(skin: &Arc<Skin>) -> Result<(), Failure> {
    let mut fingertip = Fingertip::new(1, FingertipParams::default())?;
    let mut image = Image::crop();
    let (mut samples, mut solved, mut drawn) = (0, 0.0, 0.0);
    for round in 0..3 {
        (samples, solved, drawn) = if round == 0 {
            (0, 0.0, 0.0)
        } else {
            (samples, solved, drawn)
        };
        for (i, shape) in TRAINING_SHAPES.into_iter().enumerate() {
            let mut contact = Contact::new(Arc::clone(skin), Arc::new(shape), FRICTION, Mount::default())?;
            let drive = |pull: f64| Drive {
                press: Press::Force(1.0 + 0.4 * i as f64),
                at_mm: [0.1 + pull, -0.15],
                turn_rad: 0.05 * pull,
                tilt_rad: [0.0; 2],
            };
            let start = Instant::now();
            contact.go_to(drive(0.0), 8)?;
            solved += start.elapsed().as_secs_f64();
            for step in 1..=8 {
                let start = Instant::now();
                let truth = contact.step(drive(0.12 * f64::from(step)))?;
                std::hint::black_box(truth.force_map());
                solved += start.elapsed().as_secs_f64();
                let start = Instant::now();
                fingertip.render_truth(truth, &mut image);
                std::hint::black_box(block_mean_88(&image.pixels));
                drawn += start.elapsed().as_secs_f64();
                samples += 1;
            }
        }
    }
    let per_sample = |seconds: f64| seconds * 1e3 / f64::from(samples);
    println!(
        "rendered sample, 1 to 3.4 N, eight to a history: contact {:.2} ms, image {:.2} ms; {:.0} a second on one core",
        per_sample(solved),
        per_sample(drawn),
        f64::from(samples) / (solved + drawn)
    );
    Ok(())
}

/// Runs the path twice and times the second: the first makes the spectra.
fn path(name: &str, skin: &Arc<Skin>, indenter: &Arc<dyn HeightMap>, force_n: f64) -> Result<(), Failure> {
    let (mut press, mut drag) = (0.0, 0.0);
    let (mut normal, mut shear, mut rounds, mut cells) = (0, 0, 0, 0.0);
    for _ in 0..2 {
        (press, drag, normal, shear, rounds) = (0.0, 0.0, 0, 0, 0);
        let mut contact = Contact::new(Arc::clone(skin), Arc::clone(indenter), FRICTION, Mount::default())?;
        for step in 0..3 * STEPS {
            let part = f64::from(step % STEPS + 1) / f64::from(STEPS);
            let (share, pull) = match step / STEPS {
                0 => (part, 0.0),
                1 => (1.0, part),
                _ => (1.0, 1.0 - part),
            };
            let start = Instant::now();
            let truth = contact.step(Drive {
                press: Press::Force(force_n * share),
                at_mm: [0.1 + 1.2 * pull, -0.15],
                turn_rad: 0.08 * pull,
                tilt_rad: [0.0; 2],
            })?;
            let spent = start.elapsed().as_secs_f64() * 1e3 / f64::from(STEPS);
            let work = truth.residuals();
            if share < 1.0 || pull == 0.0 && step < STEPS {
                press += spent;
            } else {
                drag += 0.5 * spent;
                normal += work.normal_iterations;
                shear += work.tangential_iterations;
                rounds += work.rounds;
            }
            cells = truth.area_mm2() / (skin.pitch_mm() * skin.pitch_mm());
        }
    }
    let mean = |count: usize| count as f64 / f64::from(2 * STEPS);
    println!(
        "{name:<30} {press:9.3} {drag:9.3} {:7.1} {:7.1} {:6.1} {cells:6.0}",
        mean(normal),
        mean(shear),
        mean(rounds)
    );
    Ok(())
}
