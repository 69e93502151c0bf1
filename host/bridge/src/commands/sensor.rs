//! `gripline sensor`: checks the description of a fingertip, and says what it describes.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use gripline_sensor::{Sensor, SensorError};

use crate::error::Failure;

/// Arguments of `gripline sensor`.
#[derive(Debug, Clone, Args)]
pub struct SensorArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// Say what is missing or implausible in a sensor's description, every key with its line.
    Check(CheckArgs),
}

#[derive(Debug, Clone, Args)]
struct CheckArgs {
    /// The description: a TOML file, or the name of a shipped one (particle-fingertip, gelsight-mini).
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the description cannot be read or used; its problems stand on standard error, one a line.
pub fn run(args: &SensorArgs) -> Result<(), Failure> {
    let Action::Check(CheckArgs { file }) = &args.action;
    match Sensor::named(file) {
        Ok(sensor) => {
            print!("{}", described(&sensor));
            Ok(())
        }
        Err(SensorError::Description { file, problems }) => {
            for problem in &problems {
                eprintln!("{}:{problem}", file.display());
            }
            let count = problems.len();
            Err(Failure::failed(format!(
                "{}: found {count} problem{}, expected none: mend the lines above",
                file.display(),
                if count == 1 { "" } else { "s" }
            )))
        }
        Err(error) => Err(error.into()),
    }
}

/// What a description means, in pixels and numbers that a person can compare with a picture.
fn described(sensor: &Sensor) -> String {
    let [columns, rows] = sensor.capture.size_px;
    let [left, top, width, height] = sensor.capture.crop_px;
    let [field_x, field_y] = sensor.view.field_mm;
    let [scale_x, scale_y] = sensor.px_per_mm();
    let span = |[least, most]: [f64; 2]| format!("{least:.1} to {most:.1}");
    let grid = sensor.pitch_px().map_or_else(
        || "particles in the volume".to_owned(),
        |pitch| format!("printed grid, {} pixels apart", span(pitch)),
    );
    format!(
        "{}: {}\n\
         pictures: {columns}×{rows}, {} a second; used: {width}×{height} from column {left}, row {top}\n\
         view: {field_x}×{field_y} mm, {scale_x:.1} by {scale_y:.1} pixels a millimetre, zoom {} to {}\n\
         markers: {grid}, diameter {} pixels, {} to {} of them\n\
         force map: {}×{} taxels of {} mm\n\
         nothing is missing, nothing is implausible\n",
        sensor.identity(),
        sensor.summary,
        sensor.capture.rate_hz,
        sensor.view.zoom[0],
        sensor.view.zoom[1],
        span(sensor.diameter_px()),
        sensor.markers.count[0],
        sensor.markers.count[1],
        sensor.taxels.grid[0],
        sensor.taxels.grid[1],
        sensor.taxels.pitch_mm,
    )
}
