//! `gripline calibrate gel`: calibrates a fingertip's maps in newtons, from a ball pressed with known forces.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use gripline_evaluation::calibration::gel::{
    Alignment, GelFit, HeldOut, Measured, Moment, PRESSES_MIN, Press, align, fit, groups, logged, presses,
};
use gripline_network::marker_forces::MarkerForces;
use gripline_network::{Architecture, Network};
use gripline_recording::{Metadata, force_log};
use gripline_sensor::{MarkerKind, Sensor};
use serde_json::json;

use super::common::{Common, date, wrote};
use super::{guide, maps};
use crate::calibration::{Calibration, Gel};
use crate::error::Error;
use crate::model::{accepts, forces_named, network_named};
use crate::value::number_in;

/// Standard acceleration of gravity over 1,000: newtons of a gram on a scale.
const NEWTONS_PER_GRAM: f64 = 9.806_65e-3;
/// Names of a log's axes.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Deepest press in a model's training, share of the gel's thickness.
const DEEPEST: f64 = 0.35;

/// Arguments of `gripline calibrate gel`.
#[derive(Debug, Clone, Args)]
pub(super) struct GelArgs {
    /// Recordings of `gripline run --record`, or force maps (T, 3, 20, 20); one a day. Without one the
    /// command explains how to make it.
    #[arg(value_name = "REC.mcap|MAPS.npy")]
    recordings: Vec<PathBuf>,
    /// Readings of the scale, one per press, in order of time over all recordings.
    #[arg(
        long,
        value_name = "F F ...",
        conflicts_with = "forces",
        allow_hyphen_values = true
    )]
    readings: Option<Readings>,
    /// Unit of the readings.
    #[arg(long, value_enum, default_value_t = Unit::N)]
    unit: Unit,
    /// A force-torque sensor's log of each recording, in the same order: CSV with the columns time_s, fx_n, fy_n, fz_n, or MCAP
    /// with geometry_msgs/WrenchStamped. Its clock offset, the axis of the gel's normal, the rotation about it, and the offset
    /// without load are found automatically.
    #[arg(long, value_name = "LOG.csv|LOG.mcap")]
    forces: Vec<PathBuf>,
    /// Topic of the forces in LOG.mcap, if it has several.
    #[arg(long, value_name = "TOPIC", requires = "forces")]
    forces_topic: Option<String>,
    /// How much later the logs' clock is, if it is known.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    lag_s: Option<f64>,
    /// Radius of the ball.
    #[arg(long, value_name = "MM", default_value_t = 6.0, value_parser = number_in(1.0..=100.0))]
    ball_mm: f64,
    /// The sensor: the name of a shipped description, or your own file.
    #[arg(long, value_name = "NAME|FILE.toml", default_value = "gelsight-mini")]
    sensor: PathBuf,
    /// Weights used for the maps, if not those of the description.
    #[arg(long, value_name = "W.safetensors")]
    weights: Option<PathBuf>,
    /// Maps per second of a MAPS.npy, if not those of the description.
    #[arg(long, value_name = "HZ", value_parser = number_in(1.0..=1000.0))]
    rate: Option<f64>,
    /// Which fingertip of the recordings.
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    fingertip: u8,
    /// Confidence of the intervals.
    #[arg(long, value_name = "P", default_value_t = 0.9, value_parser = number_in(0.5..=0.999))]
    confidence: f64,
    #[command(flatten)]
    common: Common,
}

/// Unit of a scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Unit {
    /// Newtons.
    N,
    /// Grams.
    G,
}

/// Forces as typed in.
#[derive(Debug, Clone, PartialEq)]
struct Readings(Vec<f64>);

impl FromStr for Readings {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let read = |word: &str| {
            word.parse::<f64>()
                .ok()
                .filter(|value| *value > 0.0 && *value < 1e5)
        };
        let all: Option<Vec<f64>> = text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|word| !word.is_empty())
            .map(read)
            .collect();
        all.filter(|all| !all.is_empty())
            .map(Self)
            .ok_or_else(|| format!("found {text}, expected positive numbers such as \"0.5 1.0 2.0 3.0\""))
    }
}

/// Reads, fits and writes.
///
/// # Errors
/// [`Error`] when a recording or log cannot be read, or presses and forces do not match.
pub(super) fn run(args: &GelArgs) -> Result<(), Error> {
    if args.recordings.is_empty() || (args.readings.is_none() && args.forces.is_empty()) {
        for (place, step) in guide::GEL.iter().enumerate() {
            guide::show(place + 1, step);
        }
        return Err(Error::usage(
            "found no recording with --readings or --forces, expected presses as drawn above",
        ));
    }
    let mut calibration = Calibration::load_or_new(&args.common.out)?;
    let sensor = Sensor::named(&args.sensor)?;
    let rate_hz = args.rate.unwrap_or(sensor.capture.rate_hz);
    let (mut all, mut truth, mut turns) = (Vec::new(), Vec::new(), Vec::new());
    let (mut device, mut model) = (String::new(), String::new());
    for (day, path) in args.recordings.iter().enumerate() {
        let maps::Maps {
            all: mut moments,
            device: made_by,
            start_ns,
            gain: [shear, normal],
            metadata,
        } = maps::read(path, rate_hz, args.fingertip, Moment::of)?;
        device = made_by;
        let made_with = model_of(&sensor, args, path, metadata.as_ref())?;
        if day > 0 && made_with != model {
            return Err(Error::usage(format!(
                "{}: recorded with the forces of {made_with}, expected {model} as in {}: a gain belongs to one force model",
                path.display(),
                args.recordings[0].display()
            )));
        }
        model = made_with;
        // The gains that these maps already have are taken back.
        for moment in &mut moments {
            let [x, y, z] = moment.raw_n;
            moment.raw_n = [x / f64::from(shear), y / f64::from(shear), z / f64::from(normal)];
        }
        let found = presses(&moments, day);
        if let Some(log) = args.forces.get(day) {
            let wrong = |error: String| Error::failed(format!("{}: {error}", log.display()));
            let forces = force_log(log, args.forces_topic.as_deref(), start_ns)?;
            let alignment = align(&moments, &forces, args.lag_s).map_err(wrong)?;
            let (forces, turn) = logged(&found, &forces, &alignment).map_err(wrong)?;
            turns.push((alignment, turn));
            truth.extend(forces);
        }
        all.extend(found);
    }
    if !args.forces.is_empty() && args.forces.len() != args.recordings.len() {
        return Err(Error::usage(format!(
            "--forces: found {} logs, expected {}, one for each recording",
            args.forces.len(),
            args.recordings.len()
        )));
    }
    if let Some(Readings(readings)) = &args.readings {
        let newtons = if args.unit == Unit::G {
            NEWTONS_PER_GRAM
        } else {
            1.0
        };
        truth = readings
            .iter()
            .map(|reading| [0.0, 0.0, reading * newtons])
            .collect();
    }
    let named = args.recordings[0].display();
    let has_shear = !args.forces.is_empty();
    let found = fit(&all, &truth, has_shear, args.confidence).map_err(|error| {
        Error::failed(format!(
            "{named}: {error} (at least {PRESSES_MIN} presses are needed)"
        ))
    })?;
    let section = section(args, &sensor, model, device, &found, &truth);
    print(args, &sensor, (&all, &truth), (&found, &section), &turns);
    calibration.gel = Some(section);
    calibration.save()?;
    wrote(&args.common);
    Ok(())
}

/// The name and fingerprint of the force model of these maps. Refuses a recording of another sensor or other weights.
fn model_of(
    sensor: &Sensor,
    args: &GelArgs,
    path: &Path,
    recorded: Option<&Metadata>,
) -> Result<String, Error> {
    if let Some(recorded) = recorded {
        accepts(sensor, recorded, path)?;
    }
    let (named, manifest) = match sensor.markers.kind {
        MarkerKind::Volume => {
            let architecture = recorded
                .map(|of| of.network.parse::<Architecture>())
                .transpose()?;
            let network = match &args.weights {
                Some(file) => Network::from_file(file, architecture)?,
                None => Network::embedded(architecture.unwrap_or_default())?,
            };
            (network_named(&network), network.manifest().to_owned())
        }
        MarkerKind::Plane => {
            let forces = match &args.weights {
                Some(file) => MarkerForces::from_file(file, sensor)?,
                None => MarkerForces::for_sensor(sensor, args.sensor.parent())?,
            };
            (forces_named(&forces), forces.manifest())
        }
    };
    match recorded {
        Some(recorded) if recorded.weights != manifest => Err(Error::usage(format!(
            "{}: recorded with other weights ({}; {}; {}), found {manifest}: name them with --weights",
            path.display(),
            recorded.network,
            recorded.weights_file,
            recorded.weights,
        ))),
        _ => Ok(named),
    }
}

fn section(
    args: &GelArgs,
    sensor: &Sensor,
    model: String,
    device: String,
    found: &GelFit,
    truth: &[[f64; 3]],
) -> Gel {
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    let [shear_gain, normal_gain] = found.gains();
    let shear = found.shear.unwrap_or(found.normal);
    Gel {
        date: date(),
        device: args.common.device.clone().unwrap_or(device),
        sensor: sensor.identity(),
        model,
        normal_gain: rounded(normal_gain),
        normal_interval: found.normal.interval.map(rounded),
        shear_gain: rounded(shear_gain),
        shear_interval: shear.interval.map(rounded),
        shear_was_measured: found.shear.is_some(),
        young_mpa: rounded(normal_gain * sensor.gel.young_mpa),
        young_interval_mpa: found
            .normal
            .interval
            .map(|gain| rounded(gain * sensor.gel.young_mpa)),
        confidence: found.confidence,
        presses: truth.len(),
        held_out_share: rounded(found.held_out_share(truth)),
    }
}

fn print(
    args: &GelArgs,
    sensor: &Sensor,
    (all, truth): (&[Press], &[[f64; 3]]),
    (found, section): (&GelFit, &Gel),
    turns: &[(Alignment, f64)],
) {
    let groups = groups(all, truth);
    let held_out = |members: &[usize]| HeldOut::of(&found.held_out_n, truth, members);
    if args.common.json {
        let measured = |measured: &Measured| json!({"value": measured.value, "interval": measured.interval});
        let held_out: Vec<_> = groups
            .iter()
            .map(|(name, members)| {
                let HeldOut { median_n, largest_n, median_share } = held_out(members);
                json!({"of": name, "presses": members.len(), "median_n": median_n, "largest_n": largest_n, "median_share": median_share})
            })
            .collect();
        println!(
            "{}",
            json!({"sensor": section.sensor, "model": section.model, "normal_gain": measured(&found.normal),
                   "shear_gain": found.shear.as_ref().map(measured), "young_mpa": section.young_mpa,
                   "young_interval_mpa": section.young_interval_mpa, "offset_n": measured(&found.offset_n),
                   "creep_per_decade": found.creep.as_ref().map(measured), "confidence": found.confidence,
                   "presses": truth.len(), "held_out_share": section.held_out_share, "held_out": held_out,
                   "logs": turns.iter().map(|(log, turn)| json!({"lag_s": log.lag_s, "normal_axis": AXES[log.normal],
                       "tare_n": log.tare_n, "turn_deg": turn.to_degrees()})).collect::<Vec<_>>()})
        );
        return;
    }
    for (number, (log, turn)) in turns.iter().enumerate() {
        let [x, y, z] = log.tare_n;
        println!(
            "log {}: {:+.2} s late, its {} is the gel's normal, turned about it by {:.0}°, at rest {x:.2}, {y:.2}, {z:.2} N",
            number + 1,
            log.lag_s,
            AXES[log.normal],
            turn.to_degrees()
        );
    }
    println!("   true N   maps N   left out, off by N");
    for ((press, truth), error) in all.iter().zip(truth).zip(&found.held_out_n) {
        println!("{:9.2}{:9.2}{error:12.3}", truth[2], press.raw_n[2]);
    }
    let of = |name: &str, Measured { value, interval }: &Measured, unit: &str| {
        println!(
            "{name:24}{value:8.3}{unit}   {:.3} to {:.3}",
            interval[0], interval[1]
        );
    };
    println!(
        "\n{:.0} % intervals, over {} presses:",
        100.0 * found.confidence,
        truth.len()
    );
    of("gain of normal force", &found.normal, "");
    match &found.shear {
        Some(shear) => of("gain of shear", shear, ""),
        None => println!("gain of shear           not measured: taken for that of normal force"),
    }
    let young = Measured {
        value: section.young_mpa,
        interval: section.young_interval_mpa,
    };
    of("Young's modulus", &young, " MPa");
    of("offset", &found.offset_n, " N");
    if let Some(creep) = &found.creep {
        of("creep, per decade", creep, "");
    }
    println!("\nerror of presses that the gains were not fitted to (normal force):");
    for (name, members) in &groups {
        let HeldOut {
            median_n,
            largest_n,
            median_share,
        } = held_out(members);
        println!(
            "{name:24}{:4} presses, median {median_n:.3} N ({:.1} %), largest {largest_n:.3} N",
            members.len(),
            100.0 * median_share
        );
    }
    hints(args, sensor, found, truth, section);
}

/// Hints that follow from the figures.
fn hints(args: &GelArgs, sensor: &Sensor, found: &GelFit, truth: &[[f64; 3]], section: &Gel) {
    if let Some(shear) = found.shear
        && (shear.interval[1] < found.normal.interval[0] || shear.interval[0] > found.normal.interval[1])
    {
        println!(
            "\nshear and normal force need different gains: the gel is not as thick as the description says ({} mm), or its \
             markers lie deeper; both gains are used",
            sensor.gel.thickness_mm
        );
    }
    let max_n = truth.iter().map(|force| force[2]).fold(0.0, f64::max);
    let modulus = section.young_mpa / (1.0 - sensor.gel.poisson.powi(2));
    // Hertz; on a layer a ball goes less deep.
    let depth = (9.0 * max_n * max_n / (16.0 * args.ball_mm * modulus * modulus)).cbrt();
    if depth > DEEPEST * sensor.gel.thickness_mm {
        println!(
            "\nthe hardest press, {max_n:.1} N, goes some {depth:.1} mm deep, beyond {:.1} mm that the force model knows: take a larger \
             ball, or press less",
            DEEPEST * sensor.gel.thickness_mm
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_parsed_and_other_text_is_refused() {
        assert_eq!("0.5, 1 2.25".parse(), Ok(Readings(vec![0.5, 1.0, 2.25])));
        for text in ["", "a", "1 -2", "0"] {
            assert!(
                text.parse::<Readings>()
                    .unwrap_err()
                    .contains("expected positive numbers"),
                "{text}"
            );
        }
    }
}
