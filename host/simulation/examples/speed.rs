//! How long the world's stages take on this machine: `cargo run --release -p gripline-simulation --example
//! speed`. Milliseconds per call on one core, the fastest call.

use std::sync::Arc;
use std::time::Instant;

use gripline_simulation::contact_world::{Contact, Drive, Mount, Press, Shape, Skin, production_cells};
use gripline_simulation::{
    Fingertip, FingertipParams, Gel, GripScene, Image, Load, SphereContact, SphereParams, block_mean_88,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut fingertip = Fingertip::new(1, FingertipParams::default())?;
    let mut image = Image::crop();
    time("render at rest", 200, || fingertip.render(None, &mut image));

    let skin = Arc::new(Skin::new(&Gel::default(), production_cells(5.0))?);
    let sphere = Arc::new(Shape::Sphere { radius_mm: 12.0 });
    let mut solved = Contact::new(skin, sphere, 0.65, Mount::default())?;
    solved.go_to(
        Drive {
            press: Press::Force(5.0),
            at_mm: [0.0; 2],
            turn_rad: 0.0,
            tilt_rad: [0.0; 2],
        },
        8,
    )?;
    for (name, jpeg_quality) in [("", None), (", JPEG 80", Some(80))] {
        let params = FingertipParams {
            jpeg_quality,
            ..FingertipParams::default()
        };
        let mut fingertip = Fingertip::new(1, params)?;
        time(&format!("render_truth, 5 N{name}"), 200, || {
            fingertip.render_truth(solved.truth(), &mut image);
        });
        let mut frame = Image::frame();
        time(&format!("frame_truth, 5 N{name}"), 200, || {
            fingertip.frame_truth(solved.truth(), &mut frame);
        });
    }
    let mut crop = Image::crop();
    let mut unit = 0;
    time("new fingertip and its first picture", 40, || {
        unit += 1;
        let mut fingertip =
            Fingertip::new(unit, FingertipParams::of_sensor(unit)).expect("a sensor's parameters");
        fingertip.render(None, &mut crop);
    });

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
    time("scene, whole script of 720 frames", 3, || {
        for _ in 0..720 {
            scene.step(1.0 / 60.0, 5.0).expect("a good step");
        }
    });
    Ok(())
}

/// Prints the fastest call: others on the machine only ever add.
fn time(name: &str, times: u32, mut work: impl FnMut()) {
    let best = (0..times)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min);
    println!("{name:<36} {:8.3} ms", best * 1e3);
}
