//! Pictures of the fingertip's camera: `cargo run --release -p gripline-simulation --example pictures -- DIR` writes
//! PNG files into DIR (default `target/pictures`): the 640 x 480 frame at rest and under a sphere of 12 mm radius,
//! pressed with 5 N and pulled, without noise; their difference; and a part of it, enlarged, without noise, with it,
//! and with noise and JPEG of quality 50.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gripline_simulation::contact_world::{
    Contact, Drive, GelSurface, Mount, Press, Shape, Truth, production_cells,
};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image};

const SEED: u64 = 1;
const LOAD_N: f64 = 5.0;
const PULL_MM: [f64; 2] = [0.8, 0.5];
const STEPS: u32 = 8;
/// Part of the frame that is shown larger: left, top, width and height.
const PART: [usize; 4] = [330, 200, 100, 80];
const ZOOM: usize = 4;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let dir = PathBuf::from(std::env::args().nth(1).unwrap_or("target/pictures".to_owned()));
    std::fs::create_dir_all(&dir)?;
    let truth = pressed()?;
    let take = |params: FingertipParams| -> Result<[Image; 2], Box<dyn std::error::Error>> {
        let mut fingertip = Fingertip::new(SEED, params)?;
        let rest = fingertip.rest_frame();
        let mut now = Image::frame();
        fingertip.render_frame(&truth, &mut now);
        Ok([rest, now])
    };
    let noisy = FingertipParams::default();
    // Noise would double the files.
    let clean = FingertipParams {
        noise_levels: 0.0,
        ..noisy
    };
    let compressed = FingertipParams {
        jpeg_quality: Some(50),
        ..noisy
    };
    let [rest, now] = take(clean)?;
    let [rest_noisy, now_noisy] = take(noisy)?;
    let [_, small] = take(compressed)?;
    println!(
        "mean gray level at rest {:.2}, under load {:.2}",
        mean(&rest),
        mean(&now)
    );
    println!(
        "root mean square change by load {:.1}, by noise {:.1}, by JPEG of quality 50 {:.1} gray levels",
        rms(&now, &rest),
        rms(&rest_noisy, &rest),
        rms(&now_noisy, &small)
    );
    save(&dir, "rest", &rest)?;
    save(&dir, "pressed", &now)?;
    save(&dir, "difference", &difference(&now, &rest))?;
    save(
        &dir,
        "detail",
        &beside(&[now, now_noisy, small].map(|image| enlarge(&image))),
    )?;
    Ok(())
}

/// The sphere pressed, then pulled.
fn pressed() -> Result<Truth, Box<dyn std::error::Error>> {
    let surface = Arc::new(GelSurface::new(&Gel::default(), production_cells(LOAD_N))?);
    let sphere = Arc::new(Shape::Sphere { radius_mm: 12.0 });
    let mut contact = Contact::new(surface, sphere, 0.65, Mount::default())?;
    let mut drive = Drive {
        press: Press::Force(LOAD_N),
        at_mm: [0.0; 2],
        turn_rad: 0.0,
        tilt_rad: [0.0; 2],
    };
    contact.go_to(drive, STEPS)?;
    drive.at_mm = PULL_MM;
    contact.go_to(drive, STEPS)?;
    let [x, y, z] = contact.truth().force_n();
    println!(
        "forces {x:.2}, {y:.2}, {z:.2} N, stick ratio {:?}",
        contact.truth().stick_ratio()
    );
    Ok(contact.truth().clone())
}

fn mean(image: &Image) -> f64 {
    image.pixels.iter().map(|p| f64::from(*p)).sum::<f64>() / image.pixels.len() as f64
}

fn rms(a: &Image, b: &Image) -> f64 {
    let pairs = a.pixels.iter().zip(&b.pixels);
    let sum: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (sum / a.pixels.len() as f64).sqrt()
}

/// Gray 128 where both are alike, brighter where `a` is; half a level for each level of difference.
fn difference(a: &Image, b: &Image) -> Image {
    let mut out = Image::new(a.width, a.height);
    for (out, (a, b)) in out.pixels.iter_mut().zip(a.pixels.iter().zip(&b.pixels)) {
        *out = (128 + (i32::from(*a) - i32::from(*b)) / 2).clamp(0, 255) as u8;
    }
    out
}

fn enlarge(image: &Image) -> Image {
    let [left, top, width, height] = PART;
    let mut out = Image::new(width * ZOOM, height * ZOOM);
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        let (x, y) = (i % (width * ZOOM) / ZOOM, i / (width * ZOOM) / ZOOM);
        *pixel = image.pixels[(top + y) * image.width + left + x];
    }
    out
}

/// Images of one size in a row, with a white line between.
fn beside(images: &[Image]) -> Image {
    let (width, height) = (images[0].width, images[0].height);
    let mut out = Image::new(images.len() * (width + ZOOM) - ZOOM, height);
    out.pixels.fill(255);
    for (n, image) in images.iter().enumerate() {
        for (row, from) in image.pixels.chunks_exact(width).enumerate() {
            let start = row * out.width + n * (width + ZOOM);
            out.pixels[start..start + width].copy_from_slice(from);
        }
    }
    out
}

fn save(dir: &Path, name: &str, image: &Image) -> Result<(), Box<dyn std::error::Error>> {
    let path = dir.join(name).with_extension("png");
    let mut encoder = png::Encoder::new(File::create(&path)?, image.width as u32, image.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(&image.pixels)?;
    println!("{} {} bytes", path.display(), std::fs::metadata(&path)?.len());
    Ok(())
}
