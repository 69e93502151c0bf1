//! `gripline infer`: camera pictures to force maps, without detector or link. Pictures are 8-bit grey PNG, 640×480 (the
//! middle 440×440 is taken), 440×440, or 88×88 for `unet`; maps go out as (T, 3, 20, 20) float32 newtons, as
//! `gripline detect` reads them. Files are read one after the other, the maps written at the end, whole or not at all.
//! A picture that cannot be believed has a map of zeros, is named on standard error, and makes the exit code 3.

use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use gripline_network::constants::{CROP_SIDE, IMAGE_SIDE};
use gripline_network::scene::{GateKind, Health, Scene};
use gripline_network::{Architecture, Evaluation, ForceMap, InstructionSet, Network, downsample_440_to_88};
use gripline_simulation::{Image, crop_of_frame};
use serde_json::json;

use crate::error::Failure;
use crate::simulate::maps_npy;

/// Pictures that cannot be believed are named one by one up to so many.
const NAMED: usize = 5;

/// Arguments of `gripline infer`.
#[derive(Debug, Clone, Args)]
pub struct InferArgs {
    /// Picture of the untouched fingertip.
    #[arg(long, value_name = "REST.png")]
    rest: PathBuf,
    /// A picture, or a folder of pictures (*.png, taken in the order of their names).
    #[arg(long, value_name = "DIR|FILE")]
    frames: PathBuf,
    /// Where the force maps go.
    #[arg(long, value_name = "MAPS.npy")]
    out: PathBuf,
    /// Weights of the force network instead of the built-in ones (safetensors).
    #[arg(long, value_name = "W.safetensors")]
    weights: Option<PathBuf>,
    /// Force network: `tracked` follows particles at full resolution (the default), `unet` looks at small images.
    #[arg(long, value_name = "NETWORK")]
    network: Option<Architecture>,
    /// Compute every frame as a whole, or only what can differ from the frame before; the maps are the same.
    #[arg(long, value_enum, default_value_t = Engine::Skip)]
    engine: Engine,
    /// Vector instructions: portable, avx2 or avx512. By default the widest there are.
    #[arg(long, value_name = "SET")]
    instructions: Option<InstructionSet>,
    /// Print the summary as one JSON object.
    #[arg(long)]
    json: bool,
}

/// What of a frame is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Engine {
    Dense,
    Skip,
}

/// Runs the network over the pictures.
///
/// # Errors
/// [`Failure`] that names the file: weights or pictures that cannot be used, maps that cannot be written.
pub fn run(args: &InferArgs) -> Result<(), Failure> {
    let mut network = match &args.weights {
        Some(path) => Network::from_file(path, args.network),
        None => Network::embedded(args.network.unwrap_or_default()),
    }
    .map_err(Failure::failed)?
    .with_evaluation(match args.engine {
        Engine::Dense => Evaluation::Dense,
        Engine::Skip => Evaluation::Skip,
    });
    if let Some(set) = args.instructions {
        network = network.with_instructions(set).map_err(Failure::failed)?;
    }
    let small = network.architecture() == Architecture::Unet;
    let rest = crop(&args.rest, small)?;
    network.set_rest(&rest);
    let mut now88 = [0; IMAGE_SIDE * IMAGE_SIDE];
    downsample_440_to_88(&rest, &mut now88);
    // One picture says nothing about noise: the gate stays out of it.
    let mut scene = Scene::new(GateKind::Off, &now88, std::slice::from_ref(&now88));
    let mut unhealthy: Vec<(usize, Health)> = Vec::new();

    let frames = frames(&args.frames)?;
    let mut maps: Vec<ForceMap> = Vec::with_capacity(frames.len());
    let mut times_us = Vec::with_capacity(frames.len());
    for path in &frames {
        let crop = crop(path, small)?;
        let mut map = [[0.0; 3]; 400];
        let start = Instant::now();
        downsample_440_to_88(&crop, &mut now88);
        let (_, mut health) = scene.look(&now88);
        if health.is_good() {
            network.infer(&crop, &mut map);
            health = network.health();
        }
        if !health.is_good() {
            map = [[0.0; 3]; 400];
            unhealthy.push((maps.len(), health));
        }
        times_us.push(start.elapsed().as_secs_f64() * 1e6);
        maps.push(map);
    }
    let part = args.out.with_extension("part");
    fs::write(&part, maps_npy(maps.iter())?)
        .and_then(|()| fs::rename(&part, &args.out))
        .map_err(|error| Failure::failed(format!("{}: {error}", args.out.display())))?;

    times_us.sort_by(f64::total_cmp);
    let median_us = times_us[times_us.len() / 2];
    let name = network.architecture().name();
    let lost = network.particles();
    let line = if args.json {
        let (particles, lost) = lost.unzip();
        json!({
            "network": name,
            "frames": maps.len(),
            "frame_us_median": median_us,
            "particles": particles,
            "particles_lost_in_last_frame": lost,
            "unhealthy": unhealthy
                .iter()
                .map(|(frame, health)| json!({"frame": frame, "file": frames[*frame], "health": health.to_string()}))
                .collect::<Vec<_>>(),
            "out": args.out,
        })
        .to_string()
    } else {
        let count = maps.len();
        let lost = lost.map_or(String::new(), |(particles, lost)| {
            format!("; {particles} particles, {lost} of them lost in the last frame")
        });
        let out = args.out.display();
        format!("{count} maps by {name}, {median_us:.0} µs a frame (median){lost}\nwrote {out}")
    };
    writeln!(std::io::stdout(), "{line}").map_err(Failure::failed)?;
    if unhealthy.is_empty() {
        return Ok(());
    }
    let named: Vec<String> = unhealthy
        .iter()
        .take(NAMED)
        .map(|(frame, health)| format!("{} ({health})", frames[*frame].display()))
        .collect();
    let more = match unhealthy.len() - named.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    Err(Failure::loss(format!(
        "done with loss: {} of {} pictures cannot be believed and have maps of zeros: {}{more}; expected pictures of the \
         sensor that --rest shows, lit and focused as there",
        unhealthy.len(),
        maps.len(),
        named.join(", "),
    )))
}

/// The pictures, in order; at least one.
pub(crate) fn frames(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: std::io::Error| Failure::failed(format!("{}: {error}", path.display()));
    if !fs::metadata(path).map_err(failed)?.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(path).map_err(failed)? {
        let entry = entry.map_err(failed)?.path();
        if entry.extension().is_some_and(|extension| extension == "png") {
            found.push(entry);
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(Failure::failed(format!(
            "{}: found no *.png, expected a folder of pictures",
            path.display()
        )));
    }
    Ok(found)
}

/// A picture's 440×440 crop. A small one, if it may be, is enlarged: its block means are itself again.
pub(crate) fn crop(path: &Path, small: bool) -> Result<Vec<u8>, Failure> {
    let wrong = |found: &str, expected: &str| {
        Failure::failed(format!("{}: found {found}, expected {expected}", path.display()))
    };
    let bytes = fs::read(path).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    let damaged =
        |error: png::DecodingError| wrong(&format!("no good PNG ({error})"), "a grey PNG of 8 bits");
    let mut reader = png::Decoder::new(Cursor::new(bytes))
        .read_info()
        .map_err(damaged)?;
    let info = reader.info();
    let (colour, depth) = (info.color_type, info.bit_depth);
    let size = [info.width as usize, info.height as usize];
    if (colour, depth) != (png::ColorType::Grayscale, png::BitDepth::Eight) {
        return Err(wrong(
            &format!("{colour:?} of {} bits", depth as u8),
            "grey of 8 bits: convert it",
        ));
    }
    let [width, height] = size;
    let sizes: &[[usize; 2]] = if small {
        &[[640, 480], [CROP_SIDE; 2], [IMAGE_SIDE; 2]]
    } else {
        &[[640, 480], [CROP_SIDE; 2]]
    };
    if !sizes.contains(&size) {
        let expected: Vec<String> = sizes.iter().map(|[w, h]| format!("{w}×{h}")).collect();
        return Err(wrong(&format!("{width}×{height} pixels"), &expected.join(" or ")));
    }
    let mut image = Image::new(width, height);
    reader.next_frame(&mut image.pixels).map_err(damaged)?;
    Ok(match width {
        640 => crop_of_frame(&image).pixels,
        CROP_SIDE => image.pixels,
        _ => (0..CROP_SIDE * CROP_SIDE)
            .map(|i| image.pixels[i / CROP_SIDE / 5 * IMAGE_SIDE + i % CROP_SIDE / 5])
            .collect(),
    })
}
