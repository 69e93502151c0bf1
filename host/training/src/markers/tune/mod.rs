//! `gripline-training markers tune`: fine-tunes weights on recorded presses of one's own gel. A force-torque sensor's totals and the
//! area that the imprint shows touched are the labels; simulated contacts keep the rest. Newtons. Touches files.

mod fit;
mod presses;

use std::path::{Path, PathBuf};

use clap::Args;
use gripline_evaluation::calibration::gel::{self, HeldOut, Press};
use gripline_network::marker_forces::MarkerWeights;
use gripline_sensor::Sensor;
use gripline_simulation::Split;
use serde_json::json;

use self::fit::{Errors, LeftOut, Tuning};
use self::presses::PressSamples;
use super::samples::Samples;
use crate::error::{TrainingError, at, usage};

/// What to tune on.
#[derive(Debug, Args)]
pub(crate) struct TuneArgs {
    /// Recordings of `gripline run --record` with their pictures, one a day.
    #[arg(value_name = "REC.mcap", required = true)]
    recordings: Vec<PathBuf>,
    /// A force-torque sensor's log of each, CSV or MCAP as `gripline calibrate gel` takes them, in the same order.
    #[arg(long, value_name = "LOG", required = true)]
    forces: Vec<PathBuf>,
    /// Topic of the forces, where a log has several.
    #[arg(long, value_name = "TOPIC")]
    forces_topic: Option<String>,
    /// The sensor: a shipped one's name, or its file.
    #[arg(long, default_value = "gelsight-mini")]
    sensor: PathBuf,
    /// Weights to begin with; without it, those that the sensor's file names.
    #[arg(long, value_name = "W.safetensors")]
    from: Option<PathBuf>,
    /// Simulated contacts that keep what presses do not show.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(100..=100_000))]
    contacts: u32,
    /// Gradient steps of 32 samples.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    steps: u32,
    /// Where the weights go.
    #[arg(long, value_name = "W.safetensors")]
    out: PathBuf,
}

/// Tunes with each day left out in turn, prints the errors of what was left out, and writes weights tuned on all days when they
/// are better than gains alone.
pub(super) fn run(args: &TuneArgs, data: &Path, seed: u32) -> Result<(), TrainingError> {
    if args.forces.len() != args.recordings.len() {
        return Err(usage(format!(
            "--forces: found {} logs, expected {}, one for each recording",
            args.forces.len(),
            args.recordings.len()
        )));
    }
    let sensor = Sensor::named(&args.sensor).map_err(usage)?;
    let mut weights = match &args.from {
        Some(file) => MarkerWeights::from_file(file, &sensor),
        None => MarkerWeights::for_sensor(&sensor, args.sensor.parent()),
    }?;
    let mut all = PressSamples::default();
    for (recording, log) in args.recordings.iter().zip(&args.forces) {
        let log = (log.as_path(), args.forces_topic.as_deref());
        all.add(recording, log, (&sensor, &weights))?;
    }
    let simulated = Samples::load(data, &sensor, Split::Train, seed, args.contacts)?;
    let tuning = Tuning {
        weights: &weights,
        simulated: &simulated.all,
        presses: &all.presses,
        pictures: &all.pictures,
        truth_n: &all.truth_n,
        steps: args.steps,
        seed,
    };
    let left_out = fit::leave_out(&tuning).map_err(TrainingError::Usage)?;
    print(&all.presses, &all.truth_n, &left_out);
    let [alone, tuned] = [&left_out.gains, &left_out.tuned].map(|errors| errors.mean_share(&all.truth_n));
    if tuned >= alone {
        return Err(usage(format!(
            "presses that were left out are off by {:.1} % in the mean after tuning, {:.1} % with gains alone, expected less: nothing \
             is written; stay with `gripline calibrate gel`, or record more presses",
            100.0 * tuned,
            100.0 * alone
        )));
    }
    let (layers, gains) = fit::tune(&tuning, &|_| true).map_err(TrainingError::Usage)?;
    weights.tensors = layers.tensors();
    let held_out_share = left_out.tuned.median_share(&all.truth_n);
    weights.held_out_share = Some(held_out_share as f32);
    weights.manifest = json!({
        "sensor": sensor.identity(), "tuned_on": all.presses.len(), "recordings": args.recordings.len(), "gains": gains,
        "held_out_share": held_out_share, "mean_share": tuned, "mean_share_of_gains": alone, "steps": args.steps, "seed": seed,
    })
    .to_string();
    if let Some(folder) = args.out.parent() {
        std::fs::create_dir_all(folder).map_err(at(folder))?;
    }
    std::fs::write(&args.out, weights.to_bytes()).map_err(at(&args.out))?;
    println!(
        "the force is off by {:.1} % of the normal force in the mean with gains alone, {:.1} % tuned\nwrote {}",
        100.0 * alone,
        100.0 * tuned,
        args.out.display()
    );
    Ok(())
}

/// One part of the errors.
type Part = fn(&Errors) -> &[f64];

/// Errors of presses that nothing was fitted to, by load, place and recording.
fn print(presses: &[Press], truth_n: &[[f64; 3]], left_out: &LeftOut) {
    let LeftOut {
        described,
        gains,
        tuned,
    } = left_out;
    let groups = gel::groups(presses, truth_n);
    let every = [("all".to_owned(), (0..presses.len()).collect())];
    let parts: [(&str, Part); 2] = [
        ("normal force", |errors| &errors.normal_n),
        ("shear", |errors| &errors.shear_n),
    ];
    println!(
        "median and largest error of presses that were left out, and the median's share of the normal force"
    );
    for (part, of) in parts {
        println!("{part:24}presses   weights as they were    gains alone             tuned");
        for (name, members) in groups.iter().chain(&every) {
            let columns = [described, gains, tuned].map(|errors| {
                let HeldOut {
                    median_n,
                    largest_n,
                    median_share,
                } = HeldOut::of(of(errors), truth_n, members);
                format!("{median_n:.3} {largest_n:.3} N {:5.1} %", 100.0 * median_share)
            });
            println!("{name:24}{:7}   {}", members.len(), columns.join("   "));
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        tune: TuneArgs,
    }

    #[test]
    fn logs_weights_and_recordings_that_cannot_be_used_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("tuned.safetensors");
        let refused = |words: &str, parts: &[&str]| {
            let words = words.split(' ').chain(["--out", out.to_str().unwrap()]);
            let line = Line::parse_from(std::iter::once("tune").chain(words));
            let error = run(&line.tune, folder.path(), 1).unwrap_err().to_string();
            for part in parts {
                assert!(error.contains(part), "{part:?} is missing in: {error}");
            }
        };
        refused(
            "monday.mcap tuesday.mcap --forces monday.csv",
            &["--forces: found 1 logs, expected 2"],
        );
        let other = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../network/weights/tracked.safetensors"
        );
        refused(
            &format!("none.mcap --forces none.csv --from {other}"),
            &[
                "tracked.safetensors",
                "sensor particle-fingertip.1",
                "expected gelsight-mini.1",
            ],
        );
        refused("none.mcap --forces none.csv", &["none.mcap", "a recording"]);
        assert!(!out.exists());
    }
}
