//! How long the world's stages take on this machine: `cargo run --release -p gripline-simulation --example
//! speed`. Milliseconds per call, one core.

use std::time::Instant;

use gripline_simulation::{
    Fingertip, FingertipParams, GripScene, Image, Load, SampleGenerator, SphereContact, SphereParams,
    block_mean_88,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut fingertip = Fingertip::new(1, FingertipParams::default())?;
    let mut image = Image::crop();
    time("render at rest", 200, || fingertip.render(None, &mut image));

    for (name, normal_n, pull_n, torsion_nmm) in [
        ("1 N, pull", 1.0, 0.4, 0.0),
        ("5 N, pull", 5.0, 2.0, 0.0),
        ("5 N, pull and twist", 5.0, 2.0, 4.0),
    ] {
        let mut contact = SphereContact::new(SphereParams::default())?;
        let mut sign = 1.0;
        let load = |sign: f64| Load {
            normal_n,
            shear_n: [pull_n * sign, 0.0],
            torsion_nmm,
        };
        contact.step(load(1.0))?;
        time(&format!("contact step, {name}"), 200, || {
            sign *= -0.95;
            contact.step(load(sign)).expect("the loads are inside the limit");
        });
        contact.step(load(1.0))?;
        time(&format!("force map, {name}"), 200, || {
            std::hint::black_box(contact.state().force_map());
        });
        time(&format!("render, {name}"), 200, || {
            fingertip.render(Some(contact.state()), &mut image);
        });
    }
    time("block mean 88 x 88", 500, || {
        std::hint::black_box(block_mean_88(&image.pixels));
    });

    let mut scene = GripScene::new(1);
    time("scene frame, whole script", 720, || {
        scene.step(1.0 / 60.0, 5.0).expect("a good step");
    });

    let samples = 400;
    let start = Instant::now();
    for sample in SampleGenerator::new(1).take(samples) {
        std::hint::black_box(sample);
    }
    println!(
        "{:<36} {:8.1} per second",
        "training samples",
        samples as f64 / start.elapsed().as_secs_f64()
    );
    Ok(())
}

fn time(name: &str, times: u32, mut work: impl FnMut()) {
    work();
    let start = Instant::now();
    for _ in 0..times {
        work();
    }
    println!(
        "{name:<36} {:8.3} ms",
        start.elapsed().as_secs_f64() * 1e3 / f64::from(times)
    );
}
