//! How long a picture takes from its bytes to evidence of slip, on one core: `cargo run --release -p gripline-markers --example
//! marker_speed CLIP`. Prints milliseconds: median, 99 %, longest.

use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use gripline_capture::clip::ColourClip;
use gripline_markers::{Finger, Hold, Rest, RestKind};
use gripline_sensor::Sensor;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = PathBuf::from(
        std::env::args_os()
            .nth(1)
            .ok_or("found no clip, expected a path to one")?,
    );
    let sensor = Sensor::named(std::path::Path::new("gelsight-mini"))?;
    let mut clip = ColourClip::open(&path, &sensor.capture)?;
    let pictures: Vec<Vec<u8>> = std::iter::from_fn(|| clip.next_picture()).collect();
    let mut finger = Finger::new(&sensor)?;
    let first = finger.see(&pictures[0])?.filled;
    finger.set_rest(Rest::of(&[first], RestKind::Own));
    let mut hold = Hold::default();
    let mut times_ms = Vec::new();
    for _ in 0..10 {
        for picture in &pictures {
            let start = Instant::now();
            let seen = finger.see(picture)?;
            black_box(seen.comparison.and_then(|comparison| hold.step(&[comparison])));
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
    println!(
        "{} pictures, {} markers: median {:.2} ms, 99 % {:.2} ms, longest {:.2} ms",
        times_ms.len(),
        finger.tracker().markers().len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}
