//! `gripline infer`: camera pictures to force maps, without detector or link. Pictures are 8-bit grey PNG or JPEG, 640×480 (the
//! middle 440×440 is taken), 440×440, or 88×88 for `unet`; maps go out as (T, 3, 20, 20) float32 newtons, as
//! `gripline detect` reads them. Files are read one after the other, the maps written at the end, whole or not at all.
//! A picture that cannot be believed has a map of zeros, is named on standard error, and makes the exit code 3.

use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use gripline_network::scene::Health;
use gripline_network::{Architecture, Evaluation, ForceMap, Inference, InstructionSet, NO_FORCES, Network};
use serde_json::json;

use crate::calibration::Calibration;
use crate::commands::files::maps_npy;
use crate::error::{Completion, Error};
use crate::model::particle_gain;
use gripline_capture::playback::PictureReader;
use gripline_capture::{CaptureError, picture};

/// Up to this number, implausible pictures are listed one by one.
const NAMED: usize = 5;

/// Arguments of `gripline infer`.
#[derive(Debug, Clone, Args)]
pub struct InferArgs {
    /// Picture of the untouched fingertip.
    #[arg(long, value_name = "REST.png")]
    rest: PathBuf,
    /// A picture, a folder of pictures (*.png, *.jpg, taken in the order of their names), or a clip, in any
    /// format that ffmpeg reads.
    #[arg(long, value_name = "DIR|FILE")]
    frames: PathBuf,
    /// Where the force maps go.
    #[arg(long, value_name = "MAPS.npy")]
    out: PathBuf,
    /// Weights of the force network instead of the built-in ones (safetensors).
    #[arg(long, value_name = "W.safetensors")]
    weights: Option<PathBuf>,
    /// The fingertip's calibration: its gains on shear and normal force (`gripline calibrate gel`) are applied, as `gripline run`
    /// applies them. Leave it out for maps that `gripline calibrate gel` is to read.
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// Force network: `tracked` follows particles at full resolution (the default), `unet` uses small images.
    #[arg(long, value_name = "NETWORK")]
    network: Option<Architecture>,
    /// Compute every frame completely, or only the parts that can differ from the frame before; the maps are the same.
    #[arg(long, value_enum, default_value_t = Engine::Skip)]
    engine: Engine,
    /// Vector instructions: portable, avx2, avx512 or neon. By default the widest that the processor has.
    #[arg(long, value_name = "SET")]
    instructions: Option<InstructionSet>,
    /// Print the summary as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Which part of a frame is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Engine {
    Dense,
    Skip,
}

/// Runs the network over the pictures.
///
/// # Errors
/// [`Error`] that names the file: weights or pictures that cannot be used, maps that cannot be written.
pub fn run(args: &InferArgs) -> Result<Completion, Error> {
    let mut network = match &args.weights {
        Some(path) => Network::from_file(path, args.network),
        None => Network::embedded(args.network.unwrap_or_default()),
    }?
    .with_evaluation(match args.engine {
        Engine::Dense => Evaluation::Dense,
        Engine::Skip => Evaluation::Skip,
    });
    if let Some(set) = args.instructions {
        network = network.with_instructions(set)?;
    }
    if let Some(path) = &args.calibration {
        let gain = particle_gain(&Calibration::load(path)?, &network)?;
        network = network.with_gain(gain);
    }
    let small = network.architecture() == Architecture::Unet;
    let rest = picture::crop(&args.rest, small)?;
    let mut inference = Inference::new(network, &rest);
    let mut unhealthy: Vec<(usize, Health)> = Vec::new();

    let mut frames = PictureReader::open(&args.frames, small)?;
    let mut damaged_clip = None;
    let mut names: Vec<String> = Vec::new();
    let mut maps: Vec<ForceMap> = Vec::new();
    let mut times_us = Vec::new();
    loop {
        let (name, crop) = match frames.next_picture() {
            Ok(Some(picture)) => picture,
            Ok(None) => break,
            Err(damaged @ CaptureError::ClipDamaged { .. }) => {
                damaged_clip = Some(damaged.to_string());
                break;
            }
            Err(error) => return Err(error.into()),
        };
        names.push(name);
        let mut map = NO_FORCES;
        let start = Instant::now();
        let health = inference.infer(&crop, &mut map);
        if !health.is_good() {
            unhealthy.push((maps.len(), health));
        }
        times_us.push(start.elapsed().as_secs_f64() * 1e6);
        maps.push(map);
    }
    let part = args.out.with_extension("part");
    fs::write(&part, maps_npy(maps.iter())?)
        .and_then(|()| fs::rename(&part, &args.out))
        .map_err(|error| Error::failed(format!("{}: {error}", args.out.display())))?;

    times_us.sort_by(f64::total_cmp);
    let median_us = times_us[times_us.len() / 2];
    let network = inference.network();
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
                .map(|(frame, health)| json!({"frame": frame, "file": names[*frame], "health": health.to_string()}))
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
    writeln!(std::io::stdout(), "{line}")?;
    match loss(damaged_clip, &names, &unhealthy) {
        None => Ok(Completion::Whole),
        Some(loss) => Ok(Completion::WithLoss(loss)),
    }
}

/// What the maps lack, as text.
fn loss(damaged_clip: Option<String>, names: &[String], unhealthy: &[(usize, Health)]) -> Option<String> {
    let count = names.len();
    if let Some(damaged) = damaged_clip {
        return Some(format!("done with loss: {count} maps written; {damaged}"));
    }
    if unhealthy.is_empty() {
        return None;
    }
    let named: Vec<String> = unhealthy
        .iter()
        .take(NAMED)
        .map(|(frame, health)| format!("{} ({health})", names[*frame]))
        .collect();
    let more = match unhealthy.len() - named.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    Some(format!(
        "done with loss: {} of {count} pictures cannot be believed and have maps of zeros: {}{more}; expected pictures of the \
         sensor that --rest shows, lit and focused as there",
        unhealthy.len(),
        named.join(", "),
    ))
}
