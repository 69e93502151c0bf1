//! `gripline sensor`: checks the description of a fingertip, and says what it describes.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use gripline_chart::{Axis, BLUE, Chart, FAINT, Figure, GREY, INK, Legend, Mark, Panel, SKY, Series};
use gripline_sensor::{Sensor, SensorError};
use gripline_simulation::Random;

use crate::error::Error;

/// Arguments of `gripline sensor`.
#[derive(Debug, Clone, Args)]
pub struct SensorArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// List what is missing or implausible in a sensor's description, every key with its line.
    Check(CheckArgs),
}

#[derive(Debug, Clone, Args)]
struct CheckArgs {
    /// The description: a TOML file, or the name of a shipped one (particle-fingertip, gelsight-mini).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Draw the sensor to scale: .png or .svg
    #[arg(long, value_name = "PICTURE")]
    draw: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// [`Error`] when the description cannot be read or used; its problems are on standard error, one per line.
pub fn run(args: &SensorArgs) -> Result<(), Error> {
    let Action::Check(CheckArgs { file, draw }) = &args.action;
    match Sensor::named(file) {
        Ok(sensor) => {
            print!("{}", described(&sensor));
            if let Some(path) = draw {
                drawing(&sensor).save(path)?;
            }
            Ok(())
        }
        Err(SensorError::Description { file, problems }) => {
            for problem in &problems {
                eprintln!("{}:{problem}", file.display());
            }
            let count = problems.len();
            Err(Error::failed(format!(
                "{}: found {count} problem{}, expected none: mend the lines above",
                file.display(),
                if count == 1 { "" } else { "s" }
            )))
        }
        Err(error) => Err(error.into()),
    }
}

/// Pixels per millimetre, and the space beside the view from above.
const PX_PER_MM: f64 = 18.0;
const EDGE_MM: f64 = 2.0;
/// Maximum number of particles drawn; more would merge into grey.
const PARTICLES_DRAWN: usize = 600;
/// Purpose of their random numbers.
const PARTICLES: u64 = 81;
/// Minimum half width, mm: the legend needs it.
const HALF_WIDTH_MIN_MM: f64 = 16.0;

/// The fingertip from outside, and a section through its gel, both to one scale.
fn drawing(sensor: &Sensor) -> Figure {
    let Sensor {
        view,
        gel,
        markers,
        taxels,
        ..
    } = sensor;
    let rectangle = |[width, height]: [f64; 2]| {
        let (x, y) = (0.5 * width, 0.5 * height);
        vec![(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
    };
    let closest_mm = view.field_mm.map(|side| side / view.zoom[1]);
    let map_mm = [0, 1].map(|axis| taxels.grid[axis] as f64 * taxels.pitch_mm);
    let half_mm =
        [0, 1].map(|axis| 0.5 * gel.pad_mm[axis].max(map_mm[axis]).max(view.field_mm[axis]) + EDGE_MM);
    let half_mm = [half_mm[0].max(HALF_WIDTH_MIN_MM), half_mm[1]];
    let marker_mm = f64::midpoint(markers.diameter_mm[0], markers.diameter_mm[1]);
    let dots = Mark::Dots((0.5 * marker_mm * PX_PER_MM).round().max(1.0) as u32);
    let [above, section] = marker_places(sensor);
    let plan = Chart {
        x: Axis::new("mm", [-half_mm[0], half_mm[0]]),
        y: Axis::new("mm", [-half_mm[1], half_mm[1]]),
        series: vec![
            Series {
                opacity: 0.5,
                ..Series::new("markers", GREY, dots, above)
            },
            Series::new(
                "taxels",
                FAINT,
                Mark::Line(1),
                taxel_lines(taxels.grid, taxels.pitch_mm),
            ),
            Series::new("pad", INK, Mark::Line(2), rectangle(gel.pad_mm)),
            Series::new("field of view", BLUE, Mark::Line(2), rectangle(view.field_mm)),
            Series::new("at most zoom", SKY, Mark::Dashed, rectangle(closest_mm)),
        ],
        title: String::new(),
        legend: Legend::Above,
        notes: Vec::new(),
    };
    let side_mm = 0.5 * gel.pad_mm[0];
    let depth_mm = gel.thickness_mm;
    let profile = Chart {
        x: Axis::new("mm", [-half_mm[0], half_mm[0]]),
        y: Axis::new("depth, mm", [-depth_mm - 1.0, 1.0]),
        series: vec![
            Series {
                opacity: 0.5,
                ..Series::new("markers", GREY, dots, section)
            },
            Series::new(
                "gel",
                INK,
                Mark::Line(2),
                vec![
                    (-side_mm, 0.0),
                    (side_mm, 0.0),
                    (side_mm, -depth_mm),
                    (-side_mm, -depth_mm),
                    (-side_mm, 0.0),
                ],
            ),
        ],
        title: String::new(),
        legend: Legend::None,
        notes: Vec::new(),
    };
    let px = |mm: f64| (mm * PX_PER_MM).round() as u32;
    let width = px(2.0 * half_mm[0]) + 90;
    Figure {
        width,
        rows: vec![
            (
                30,
                vec![Panel::Text(format!(
                    "{} from outside: {}",
                    sensor.identity(),
                    sensor.summary
                ))],
            ),
            (px(2.0 * half_mm[1]) + 110, vec![Panel::Chart(plan)]),
            (
                30,
                vec![Panel::Text(format!(
                    "section: Young's modulus {} MPa, Poisson's ratio {}, {} mm thick",
                    gel.young_mpa, gel.poisson, gel.thickness_mm
                ))],
            ),
            (px(depth_mm + 2.0) + 110, vec![Panel::Chart(profile)]),
        ],
    }
}

/// One line through all borders of the taxels, row by row and then column by column.
fn taxel_lines([columns, rows]: [usize; 2], pitch_mm: f64) -> Vec<(f64, f64)> {
    let [half_x, half_y] = [columns, rows].map(|count| 0.5 * count as f64 * pitch_mm);
    let mut points = Vec::new();
    let way = |number: usize| if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    for row in 0..=rows {
        let (y, from) = (row as f64 * pitch_mm - half_y, -way(row) * half_x);
        points.extend([(from, y), (-from, y)]);
    }
    // From the last row's end on.
    let first = if points.last().is_some_and(|(x, _)| *x > 0.0) {
        columns
    } else {
        0
    };
    for step in 0..=columns {
        let column = if first == 0 { step } else { columns - step };
        let (x, from) = (column as f64 * pitch_mm - half_x, way(step) * half_y);
        points.extend([(x, from), (x, -from)]);
    }
    points
}

/// Where markers lie, from outside and in the section: the printed grid, or particles by chance.
fn marker_places(sensor: &Sensor) -> [Vec<(f64, f64)>; 2] {
    let [half_x, half_y] = sensor.gel.pad_mm.map(|side| 0.5 * side);
    let [min, max] = sensor.markers.depth_mm;
    if let Some([closest, widest]) = sensor.markers.pitch_mm {
        let pitch = f64::midpoint(closest, widest);
        let along = |half: f64| {
            let count = (half / pitch).floor() as i32;
            (-count..=count).map(move |place| f64::from(place) * pitch)
        };
        let depth = -f64::midpoint(min, max);
        let above = along(half_y)
            .flat_map(|y| along(half_x).map(move |x| (x, y)))
            .collect();
        return [above, along(half_x).map(|x| (x, depth)).collect()];
    }
    let mut random = Random::new(1, PARTICLES);
    let particles: Vec<[f64; 3]> = (0..sensor.markers.count[1].min(PARTICLES_DRAWN))
        .map(|_| {
            [
                random.uniform(-half_x, half_x),
                random.uniform(-half_y, half_y),
                -random.uniform(min, max),
            ]
        })
        .collect();
    [
        particles.iter().map(|[x, y, _]| (*x, *y)).collect(),
        particles.iter().map(|[x, _, depth]| (*x, *depth)).collect(),
    ]
}

/// The description in pixels and numbers that a person can compare with a picture.
fn described(sensor: &Sensor) -> String {
    let [columns, rows] = sensor.capture.size_px;
    let [left, top, width, height] = sensor.capture.crop_px;
    let [field_x, field_y] = sensor.view.field_mm;
    let [scale_x, scale_y] = sensor.px_per_mm();
    let span = |[min, max]: [f64; 2]| format!("{min:.1} to {max:.1}");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taxels_are_drawn_in_one_line_without_a_slanted_piece() {
        for grid in [[20, 20], [3, 4], [4, 3], [1, 1]] {
            let points = taxel_lines(grid, 0.5);
            for pair in points.windows(2) {
                let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
                assert!(
                    (x0 - x1).abs() < 1e-12 || (y0 - y1).abs() < 1e-12,
                    "{grid:?}: {pair:?}"
                );
            }
        }
    }

    #[test]
    fn every_shipped_sensor_is_drawn_with_its_markers_inside_the_pad() {
        for name in ["particle-fingertip", "gelsight-mini"] {
            let sensor = Sensor::named(&PathBuf::from(name)).unwrap();
            let [above, section] = marker_places(&sensor);
            assert!(above.len() > 50 && !section.is_empty());
            let [x, y] = sensor.gel.pad_mm.map(|side| 0.5 * side);
            assert!(above.iter().all(|place| place.0.abs() <= x && place.1.abs() <= y));
            assert!(
                section
                    .iter()
                    .all(|place| place.1 <= 0.0 && place.1 >= -sensor.gel.thickness_mm)
            );
            drawing(&sensor).encode(gripline_chart::Format::Svg).unwrap();
        }
    }
}
