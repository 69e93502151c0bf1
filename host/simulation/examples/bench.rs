//! A simulated stranger for [your own sensor](../../../docs/own-sensor.md): pictures of a unit of a sensor with printed markers whose
//! gel is softer by half and thinner by a fifth than described and whose lens shows 12 % more and bends by 5 %, at rest and under
//! presses with a ball, and a force-torque sensor's log.
//! `cargo run --release -p gripline-simulation --example bench -- FOLDER [SENSOR.toml]`

use std::error::Error;
use std::fs;
use std::path::Path;

use gripline_sensor::Sensor;
use gripline_simulation::printed::{PrintedBench, UnitRange};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected a folder to write to")?;
    let named = arguments.next().unwrap_or_else(|| "gelsight-mini".to_owned());
    let sensor = Sensor::named(Path::new(&named))?;
    let pitch_mm = sensor
        .markers
        .pitch_mm
        .ok_or("expected a sensor with printed markers")?;
    let mut printed = sensor.clone();
    // What a ruler says of its dots.
    printed.markers.pitch_mm = Some([0.5 * (pitch_mm[0] + pitch_mm[1]); 2]);
    let stranger = UnitRange {
        thickness_mm: [0.8 * sensor.gel.thickness_mm; 2],
        modulus: [0.5; 2],
        distance_mm: [35.0; 2],
        scale_error: [0.12; 2],
        distortion: [0.05; 2],
        zoom: [1.0; 2],
        ..UnitRange::of(&sensor)
    };
    let [.., width, height] = sensor.capture.crop_px;
    for (name, seed) in [("monday", 1), ("tuesday", 2)] {
        let bench = PrintedBench::play(&printed, &stranger, 12, 1.0, [7, seed])?;
        for (kind, pictures) in [("rest", &bench.rest), ("presses", &bench.pictures)] {
            let to = Path::new(&folder).join(format!("{name}-{kind}"));
            fs::create_dir_all(&to)?;
            for (number, picture) in pictures.iter().enumerate() {
                let file = fs::File::create(to.join(format!("{number:04}.png")))?;
                let mut encoder = png::Encoder::new(file, width as u32, height as u32);
                encoder.set_color(png::ColorType::Rgb);
                encoder.write_header()?.write_image_data(picture)?;
            }
        }
        fs::write(Path::new(&folder).join(format!("{name}.csv")), bench.csv())?;
    }
    Ok(())
}
