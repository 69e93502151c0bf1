//! How long the world's stages take on this machine: `cargo run --release -p gripline-simulation --example
//! contact_speed`. Milliseconds per call on one core, the fastest call.

use std::sync::Arc;
use std::time::Instant;

use gripline_simulation::contact_world::{Contact, Drive, GelSurface, Mount, Press, Shape, production_cells};
use gripline_simulation::{Fingertip, FingertipParams, Gel, GripScene, Image, block_mean_88};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut fingertip = Fingertip::new(1, FingertipParams::default())?;
    let mut image = Image::crop();
    time("render at rest", 200, || image = fingertip.rest_image());

    let surface = Arc::new(GelSurface::new(&Gel::default(), production_cells(5.0))?);
    let sphere = Arc::new(Shape::Sphere { radius_mm: 12.0 });
    let mut solved = Contact::new(surface, sphere, 0.65, Mount::default())?;
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
        time(&format!("render, 5 N{name}"), 200, || {
            fingertip.render(solved.truth(), &mut image);
        });
        let mut frame = Image::frame();
        time(&format!("render_frame, 5 N{name}"), 200, || {
            fingertip.render_frame(solved.truth(), &mut frame);
        });
    }
    let mut unit = 0;
    time("new fingertip and its first picture", 40, || {
        unit += 1;
        let mut fingertip =
            Fingertip::new(unit, FingertipParams::of_sensor(unit)).expect("a sensor's parameters");
        std::hint::black_box(fingertip.rest_image());
    });

    let mut x_mm = 0.3;
    time("contact step, 5 N, pull there and back", 200, || {
        x_mm = -x_mm;
        let drive = Drive {
            press: Press::Force(5.0),
            at_mm: [x_mm, 0.0],
            turn_rad: 0.0,
            tilt_rad: [0.0; 2],
        };
        solved.step(drive).expect("a good step");
    });
    time("force map", 200, || {
        std::hint::black_box(solved.truth().force_map());
    });
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
