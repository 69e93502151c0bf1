//! Time from an MJPEG frame's bytes to its crop, µs, as JSON: grey 640×480 of quality 95, with noise of a few levels.
//! `cargo run --release --package gripline-capture --example decode`

use std::time::Instant;

use gripline_capture::JpegCrop;
use gripline_capture::geometry::FRAME;
use jpeg_encoder::{ColorType, Encoder};

fn main() {
    for noise_levels in [3, 8, 14] {
        let mut state = 1_u32;
        let grey: Vec<u8> = (0..FRAME.pixels())
            .map(|i| {
                let (x, y) = ((i % FRAME.width) as f64, (i / FRAME.width) as f64);
                let level = 110.0 + 60.0 * (x / 37.0).sin() + 50.0 * (y / 23.0).cos();
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = (state >> 16) as i32 % (2 * noise_levels + 1) - noise_levels;
                (level as i32 + noise).clamp(0, 255) as u8
            })
            .collect();
        let mut file = Vec::new();
        Encoder::new(&mut file, 95)
            .encode(&grey, FRAME.width as u16, FRAME.height as u16, ColorType::Luma)
            .expect("a frame fits into a JPEG file");
        let (mut decoder, mut crop) = (JpegCrop::default(), Vec::new());
        let mut times: Vec<f64> = (0..500)
            .map(|_| {
                let start = Instant::now();
                decoder
                    .decode(&file, &mut crop)
                    .expect("the encoder wrote a whole file");
                start.elapsed().as_secs_f64() * 1e6
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!(
            "{{\"bytes\": {}, \"min_us\": {:.0}, \"median_us\": {:.0}, \"p99_us\": {:.0}}}",
            file.len(),
            times[0],
            times[250],
            times[495]
        );
    }
}
