//! `gripline calibrate geometry`: how a fingertip sits in the gripper, from a recording of presses at marks.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use gripline_protocol::constants::TAXEL_PITCH_MM;
use serde_json::json;

use super::common::{Common, date, wrote};
use super::{guide, maps};
use crate::calibration::{Calibration, Geometry};
use crate::error::Error;
use crate::value::number_in;
use gripline_evaluation::calibration::geometry::{Fit, Press, Touch, fit, presses};

/// Arguments of `gripline calibrate geometry`.
#[derive(Debug, Clone, Args)]
pub(super) struct GeometryArgs {
    /// A recording of `gripline run --record`, or force maps of `gripline infer` (T, 3, 20, 20). Without it the command
    /// explains how to make one.
    #[arg(value_name = "REC.mcap|MAPS.npy")]
    recording: Option<PathBuf>,
    /// The marks in the order in which they were pressed, from the gripper's axis: x to the right and y up as seen from
    /// outside the first fingertip, mm.
    #[arg(
        long,
        value_name = "X,Y X,Y ...",
        default_value = "0,0 5,0 0,5 -5,0 0,-5",
        allow_hyphen_values = true
    )]
    marks: Marks,
    /// Which fingertip was pressed; the second one faces the first.
    #[arg(long, value_name = "1|2", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    fingertip: u8,
    /// Nominal distance between taxels; the result may differ by a fifth.
    #[arg(long, value_name = "MM", default_value_t = TAXEL_PITCH_MM, value_parser = number_in(0.1..=10.0))]
    pitch_mm: f64,
    /// Maps per second of a MAPS.npy.
    #[arg(long, value_name = "HZ", default_value_t = 60.0, value_parser = number_in(1.0..=1000.0))]
    rate: f64,
    #[command(flatten)]
    common: Common,
}

/// Places in the gripper's frame, mm.
#[derive(Debug, Clone, PartialEq)]
struct Marks(Vec<[f64; 2]>);

impl FromStr for Marks {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mark = |word: &str| {
            let (x, y) = word.split_once(',')?;
            let read = |part: &str| part.parse::<f64>().ok().filter(|mm| mm.abs() <= 32.0);
            Some([read(x)?, read(y)?])
        };
        let marks: Option<Vec<_>> = text.split_whitespace().map(mark).collect();
        marks.map(Self).ok_or_else(|| {
            format!("found {text}, expected marks of -32 to 32 mm, such as \"0,0 5,0 0,5 -5,0\"")
        })
    }
}

/// Reads, fits and writes.
///
/// # Errors
/// [`Error`] when the recording cannot be read, or its presses do not fit the marks.
pub(super) fn run(args: &GeometryArgs) -> Result<(), Error> {
    let Some(path) = &args.recording else {
        for (place, step) in guide::GEOMETRY.iter().enumerate() {
            guide::show(place + 1, step);
        }
        return Err(Error::usage(
            "found no recording, expected one of presses as drawn above",
        ));
    };
    let mut calibration = Calibration::load_or_new(&args.common.out)?;
    let maps::Maps {
        all: touches, device, ..
    } = maps::read(path, args.rate, args.fingertip, Touch::of)?;
    let presses = presses(&touches);
    let places: Vec<_> = presses.iter().map(|press| press.place).collect();
    let found = fit(&args.marks.0, &places, args.fingertip == 2, args.pitch_mm)
        .map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    print(args, &presses, &found);
    let rounded = |value: f64| (value * 1e3).round() / 1e3;
    calibration.geometry = Some(Geometry {
        date: date(),
        device: args.common.device.clone().unwrap_or(device),
        pitch_mm: rounded(found.pitch_mm),
        centre_mm: found.centre_mm.map(rounded),
        quarter_turns: found.quarter_turns,
        presses: presses.len(),
        turned_deg: rounded(found.off_deg),
        residual_rms_mm: rounded(found.rms_mm()),
        residual_max_mm: rounded(found.max_mm()),
    });
    calibration.save()?;
    wrote(&args.common);
    Ok(())
}

fn print(args: &GeometryArgs, presses: &[Press], found: &Fit) {
    let [x, y] = found.centre_mm;
    let each = presses.iter().zip(&args.marks.0).zip(&found.rests_mm);
    if args.common.json {
        let presses: Vec<_> = each
            .map(|((press, mark), rest)| {
                json!({"from_s": press.from_s, "to_s": press.to_s, "frames": press.frames, "fn": press.normal_n,
                       "place_taxels": press.place, "mark_mm": mark, "residual_mm": rest})
            })
            .collect();
        println!(
            "{}",
            json!({"pitch_mm": found.pitch_mm, "centre_mm": [x, y], "quarter_turns": found.quarter_turns,
                   "turned_deg": found.off_deg, "residual_rms_mm": found.rms_mm(), "residual_max_mm": found.max_mm(),
                   "presses": presses})
        );
        return;
    }
    println!("   from s     to s   F_N N   on the skin, taxels     mark, mm    off by mm");
    for ((press, [mark_x, mark_y]), rest) in each {
        println!(
            "{:9.2}{:9.2}{:8.2}{:12.2}{:10.2}{mark_x:9.1}{mark_y:7.1}{rest:12.2}",
            press.from_s, press.to_s, press.normal_n, press.place[0], press.place[1]
        );
    }
    println!(
        "{:.3} mm between taxels, the map's centre at {x:.2}, {y:.2} mm, rotated by {} quarter turns and {:.1}°; residual {:.2} mm \
         (root mean square), {:.2} mm at most",
        found.pitch_mm,
        found.quarter_turns,
        found.off_deg,
        found.rms_mm(),
        found.max_mm()
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_parsed_and_other_text_is_refused() {
        assert_eq!("0,0 -5,2.5".parse(), Ok(Marks(vec![[0.0, 0.0], [-5.0, 2.5]])));
        for text in ["0", "0,0 5", "0,0 a,b", "0,0 99,0", "0,0,0"] {
            assert!(
                text.parse::<Marks>().unwrap_err().contains("expected marks of"),
                "{text}"
            );
        }
    }
}
