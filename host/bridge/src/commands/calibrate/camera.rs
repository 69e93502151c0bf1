//! `gripline calibrate camera`: scale, distortion and field of a camera, from dots at a known distance.

use std::path::PathBuf;

use clap::Args;
use gripline_capture::ColourPlayback;
use gripline_evaluation::calibration::camera::{CameraFit, Dot, fit};
use gripline_markers::{MarkerError, Tracker};
use gripline_sensor::Sensor;
use serde_json::json;

use super::common::{Common, date, wrote};
use crate::calibration::{Calibration, Camera};
use crate::error::Error;
use crate::value::number_in;

/// Number of pictures used of a clip or folder.
const PICTURES: usize = 16;
/// A distance of dots that is not given is known to this share at best.
const UNSURE: f64 = 0.02;

/// Arguments of `gripline calibrate camera`.
#[derive(Debug, Clone, Args)]
pub(super) struct CameraArgs {
    /// Pictures of the untouched gel, or of a plate of dots pressed flat on it: a picture, a clip, or a folder.
    #[arg(value_name = "PICTURE|CLIP|FOLDER")]
    pictures: PathBuf,
    /// The sensor: the name of a shipped description, or your own file.
    #[arg(long, value_name = "NAME|FILE.toml", default_value = "gelsight-mini")]
    sensor: PathBuf,
    /// Measured distance of neighbouring dots: the gel's own, or the plate's. Without it the middle of the description's range.
    #[arg(long, value_name = "MM", value_parser = number_in(0.1..=20.0))]
    pitch_mm: Option<f64>,
    #[command(flatten)]
    common: Common,
}

/// Looks, fits and writes.
///
/// # Errors
/// [`Error`] when the pictures cannot be read, or show no regular grid of dots.
pub(super) fn run(args: &CameraArgs) -> Result<(), Error> {
    let mut calibration = Calibration::load_or_new(&args.common.out)?;
    let sensor = Sensor::named(&args.sensor)?;
    let Some([min, max]) = sensor.markers.pitch_mm else {
        return Err(Error::usage(format!(
            "sensor {}: found particles, expected printed markers: their lens is calibrated by `gripline calibrate geometry`",
            sensor.identity()
        )));
    };
    let described = 0.5 * (min + max);
    let pitch_mm = args.pitch_mm.unwrap_or(described);
    if args.pitch_mm.is_none() && max - min > UNSURE * described {
        tracing::warn!(
            "no --pitch-mm: the description says {min} to {max} mm, so the scale is known to {:.0} % only; measure over ten dots",
            50.0 * (max - min) / described
        );
    }
    let (dots, count) = dots_of(&args.pictures, &sensor, pitch_mm)?;
    let [_, _, width, height] = sensor.capture.crop_px;
    let found = fit(&dots, pitch_mm, [width, height])
        .map_err(|error| Error::failed(format!("{}: {error}", args.pictures.display())))?;
    let rounded = |value: f64, places: i32| (value * 10_f64.powi(places)).round() / 10_f64.powi(places);
    let field_mm = [width, height].map(|side| rounded(side as f64 / found.px_per_mm, 3));
    print(args, &sensor, &found, field_mm, count);
    calibration.camera = Some(Camera {
        date: date(),
        device: args.common.device.clone().unwrap_or_else(|| sensor.identity()),
        sensor: sensor.identity(),
        px_per_mm: rounded(found.px_per_mm, 4),
        px_per_mm_error: rounded(found.px_per_mm_error, 4),
        field_mm,
        distortion_per_mm2: rounded(found.distortion_per_mm2, 7),
        dots: found.dots,
        residual_px: rounded(found.residual_px, 3),
    });
    calibration.save()?;
    wrote(&args.common);
    Ok(())
}

/// The dots where they lie in the mean of the pictures, and how many pictures there are.
fn dots_of(path: &std::path::Path, sensor: &Sensor, pitch_mm: f64) -> Result<(Vec<Dot>, usize), Error> {
    // Dots are looked for at the distance that they have, at any scale that lenses may have.
    let mut wider = sensor.clone();
    let [min, max] = sensor.markers.pitch_mm.unwrap_or([pitch_mm; 2]);
    wider.markers.pitch_mm = Some([min.min(pitch_mm) / 1.3, max.max(pitch_mm) * 1.3]);
    let wrong = |error: MarkerError| Error::failed(format!("{}: {error}", path.display()));
    let mut tracker = Tracker::new(&wider).map_err(wrong)?;
    let mut frames = ColourPlayback::open(path, &sensor.capture, 0)?;
    let mut sums: Vec<([f64; 2], usize)> = Vec::new();
    let mut count = 0;
    while count < PICTURES
        && let Some((picture, _)) = frames.next_picture()
    {
        let markers = tracker.see(&picture).map_err(wrong)?;
        sums.resize(markers.len(), ([0.0; 2], 0));
        for (sum, marker) in sums.iter_mut().zip(markers).filter(|(_, marker)| marker.seen) {
            sum.0 = [0, 1].map(|axis| sum.0[axis] + f64::from(marker.at_px[axis]));
            sum.1 += 1;
        }
        count += 1;
    }
    let dots = sums
        .iter()
        .zip(tracker.markers())
        .filter(|((_, seen), _)| *seen > 0)
        .map(|((sum, seen), marker)| Dot {
            node: [marker.node.column, marker.node.row],
            at_px: sum.map(|sum| sum / *seen as f64),
        })
        .collect();
    Ok((dots, count))
}

fn print(args: &CameraArgs, sensor: &Sensor, found: &CameraFit, field_mm: [f64; 2], pictures: usize) {
    let described = sensor.px_per_mm()[0];
    if args.common.json {
        println!(
            "{}",
            json!({"sensor": sensor.identity(), "px_per_mm": found.px_per_mm, "px_per_mm_error": found.px_per_mm_error,
                   "described_px_per_mm": described, "field_mm": field_mm, "distortion_per_mm2": found.distortion_per_mm2,
                   "distortion_error": found.distortion_error, "turn_deg": found.turn_rad.to_degrees(),
                   "residual_px": found.residual_px, "dots": found.dots, "pictures": pictures})
        );
        return;
    }
    println!(
        "{:.3} ± {:.3} pixels a millimetre ({described:.3} in the description), so the crop shows {:.2}×{:.2} mm; a lens that bends by \
         {:+.1} % at its corner; the grid is turned by {:.1}°\n{} dots in {pictures} pictures lie {:.2} pixels from an even grid",
        found.px_per_mm,
        found.px_per_mm_error,
        field_mm[0],
        field_mm[1],
        100.0 * found.distortion_per_mm2 * 0.25 * (field_mm[0].powi(2) + field_mm[1].powi(2)),
        found.turn_rad.to_degrees(),
        found.dots,
        found.residual_px
    );
}
