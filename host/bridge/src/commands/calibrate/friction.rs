//! `gripline calibrate friction`: the friction coefficient from a recording of slides.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::common::{Common, date, wrote};
use super::{guide, maps};
use crate::calibration::{Calibration, Friction};
use crate::error::Error;
use crate::value::number_in;
use gripline_evaluation::calibration::friction::{Estimate, Moment, Slide, estimate, slides};

/// Relative error of a network's F_T / F_N that all slides of one sensor share, standard deviation. Measured by
/// `cargo test -p gripline --test calibrate -- --nocapture`, which slides objects over simulated sensors.
pub(super) const MAP_ERROR: f64 = 0.05;

/// Arguments of `gripline calibrate friction`.
#[derive(Debug, Clone, Args)]
pub(super) struct FrictionArgs {
    /// A recording of `gripline run --record`, or force maps of `gripline infer` (T, 3, 20, 20). Without it the command
    /// explains how to make one.
    #[arg(value_name = "REC.mcap|MAPS.npy")]
    recording: Option<PathBuf>,
    /// Confidence of the interval: the share of such intervals that contain the true coefficient.
    #[arg(long, value_name = "P", default_value_t = 0.9, value_parser = number_in(0.5..=0.999))]
    confidence: f64,
    /// Maps per second of a MAPS.npy.
    #[arg(long, value_name = "HZ", default_value_t = 60.0, value_parser = number_in(1.0..=1000.0))]
    rate: f64,
    /// Which fingertip of the recording.
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    fingertip: u8,
    /// Relative error of the maps' F_T / F_N that all slides share, standard deviation; 0 for true maps.
    #[arg(long, value_name = "SHARE", default_value_t = MAP_ERROR, value_parser = number_in(0.0..=0.5))]
    map_error: f64,
    #[command(flatten)]
    common: Common,
}

/// Reads, estimates and writes.
///
/// # Errors
/// [`Error`] when the recording cannot be read or has too few slides.
pub(super) fn run(args: &FrictionArgs) -> Result<(), Error> {
    let Some(path) = &args.recording else {
        for (place, step) in guide::FRICTION.iter().enumerate() {
            guide::show(place + 1, step);
        }
        return Err(Error::usage(
            "found no recording, expected one of slides as drawn above",
        ));
    };
    let mut calibration = Calibration::load_or_new(&args.common.out)?;
    let maps::Maps {
        all: moments, device, ..
    } = maps::read(path, args.rate, args.fingertip, Moment::of)?;
    let slides = slides(&moments);
    let found = estimate(&slides, args.confidence, args.map_error)
        .map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    if !(0.05..=2.0).contains(&found.friction) || found.detector < 0.01 {
        return Err(Error::failed(format!(
            "{}: found a friction of {:.3}, expected 0.05 to 2: are these maps in newtons?",
            path.display(),
            found.friction
        )));
    }
    print(&args.common, &slides, &found);
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    calibration.friction = Some(Friction {
        date: date(),
        device: args.common.device.clone().unwrap_or(device),
        estimate: rounded(found.friction),
        low: rounded(found.low),
        high: rounded(found.high),
        confidence: found.confidence,
        slides: slides.len(),
        residual: rounded(found.between_slides),
        detector: rounded(found.detector.min(2.0)),
    });
    calibration.save()?;
    wrote(&args.common);
    Ok(())
}

fn print(common: &Common, slides: &[Slide], found: &Estimate) {
    if common.json {
        let slides: Vec<_> = slides
            .iter()
            .map(|slide| {
                json!({"from_s": slide.from_s, "to_s": slide.to_s, "frames": slide.frames, "fn": slide.normal_n,
                       "ratio": slide.ratio})
            })
            .collect();
        println!(
            "{}",
            json!({"friction": found.friction, "low": found.low, "high": found.high, "confidence": found.confidence,
                   "between_slides": found.between_slides, "detector": found.detector, "slides": slides})
        );
        return;
    }
    println!("   from s     to s   frames   F_N N   F_T/F_N");
    for slide in slides {
        println!(
            "{:9.2}{:9.2}{:9}{:8.2}{:10.3}",
            slide.from_s, slide.to_s, slide.frames, slide.normal_n, slide.ratio
        );
    }
    println!(
        "friction {:.3}, {:.0} % interval {:.3} to {:.3} (Student's t over {} slides that differ by {:.3}, and the maps' own \
         error)\nthe detector uses {:.3}, a sixth below the interval: slipping taxels sit exactly at the true coefficient",
        found.friction,
        100.0 * found.confidence,
        found.low,
        found.high,
        slides.len(),
        found.between_slides,
        found.detector
    );
}
