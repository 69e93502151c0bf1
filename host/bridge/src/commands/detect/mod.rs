//! The command `gripline detect`: arguments, files in and out, notes and summary. Touches the world.

mod output;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::{fs, io::ErrorKind};

use clap::Args;
use gripline_protocol::TAXELS;
use gripline_protocol::constants::TAXEL_PITCH_MM;

use self::output::Output;
use crate::error::Error;
use crate::value::number_in;
use gripline_evaluation::detect::judge::{Settings, judge, quantise};
use gripline_evaluation::detect::replay::{RATE_HZ, Replay};
use gripline_evaluation::detect::table::{Extra, Summary, write_header, write_row};
use gripline_recording::maps_file::MapsFile;
use gripline_recording::units::ratio;

/// The arguments of `gripline detect`.
#[derive(Debug, Clone, PartialEq, Args)]
#[command(allow_negative_numbers = true)]
pub struct DetectArgs {
    /// Force maps: a NumPy file of shape (T, 3, R, C), float32 or float64, channels x, y, z, R and C up to 20.
    /// A smaller grid sits in the corner of an empty 20×20 map.
    #[arg(value_name = "MAPS.npy")]
    pub maps: PathBuf,
    /// Friction coefficient of the detector, 0 to 2 in steps of 0.0001.
    #[arg(long, default_value_t = 0.45, value_parser = number_in(0.0..=2.0))]
    pub mu: f64,
    /// A frame slips when its stick ratio is below this, 0 to 1 in steps of 0.0001.
    #[arg(long, default_value_t = 0.5, value_parser = number_in(0.0..=1.0))]
    pub threshold: f64,
    /// A taxel is in contact when its normal force exceeds this, newtons.
    #[arg(long, value_name = "NEWTONS", default_value_t = 0.0, value_parser = number_in(0.0..=8.0))]
    pub contact_min: f64,
    /// Newtons per unit of the file.
    #[arg(long, default_value_t = 1.0, value_parser = positive)]
    pub scale: f64,
    /// Distance of neighbouring taxels, mm, for the column `mz`.
    #[arg(long, value_name = "MM", default_value_t = TAXEL_PITCH_MM, value_parser = number_in(0.1..=10.0))]
    pub pitch_mm: f64,
    /// Write one row per frame to this file; `-` is standard output, and the summary then goes to standard error.
    #[arg(long, value_name = "OUT.csv")]
    pub csv: Option<PathBuf>,
    /// Add the slip state machine's column `state` to the CSV.
    #[arg(long, requires = "csv")]
    pub state: bool,
    /// Add the grip controller's column `line_n` to the CSV, newtons: a controller that already holds before the first map.
    #[arg(long, requires = "csv")]
    pub line: bool,
    /// Maps per second of the recording, for --state and --line.
    #[arg(long, value_name = "HZ", default_value_t = 60.0, value_parser = number_in(RATE_HZ))]
    pub rate: f64,
    /// Print the summary as one JSON object.
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err(format!("found {text}, expected a positive number")),
    }
}

/// Reports on standard error when a value is not a multiple of the detector's step.
fn warn_when_rounded(name: &str, value: f64, taken: f64) {
    if (taken - value).abs() > 0.0 {
        tracing::warn!("--{name} {value} is taken as {taken}: the detector works in steps of 0.0001");
    }
}

impl DetectArgs {
    /// The ranges were checked with the command line.
    fn settings(&self) -> Settings {
        let settings = Settings::of(self.mu, self.threshold, self.contact_min, self.scale);
        warn_when_rounded("mu", self.mu, ratio(settings.friction.per_unit()));
        warn_when_rounded("threshold", self.threshold, ratio(settings.threshold));
        settings
    }
}

/// Where the CSV goes, also named in messages.
struct Csv<'a> {
    path: &'a Path,
    output: Output,
    extra: Extra,
}

impl<'a> Csv<'a> {
    fn create(path: &'a Path, maps: &Path, extra: Extra) -> Result<Self, Error> {
        let output = if path == Path::new("-") {
            Output::stdout()
        } else {
            let same =
                fs::canonicalize(path).is_ok_and(|csv| fs::canonicalize(maps).is_ok_and(|maps| maps == csv));
            if same {
                return Err(Error::usage(format!(
                    "--csv {}: found the recording itself, expected another file: choose another name",
                    path.display()
                )));
            }
            Output::file(path).map_err(|error| unwritable(path, &error))?
        };
        Ok(Self { path, output, extra })
    }
}

fn unwritable(path: &Path, error: &io::Error) -> Error {
    Error::failed(format!(
        "{}: cannot be written ({error}), expected a file in a directory that exists and may be written: \
         create the directory or choose another place",
        path.display()
    ))
}

/// Runs the command.
///
/// # Errors
/// [`Error`] when the recording cannot be read or the CSV cannot be written.
pub fn run(args: &DetectArgs) -> Result<(), Error> {
    let settings = args.settings();
    let mut maps = MapsFile::open(&args.maps)?;
    let extra = Extra {
        state: args.state,
        line: args.line,
    };
    let csv = match &args.csv {
        Some(path) => Some(Csv::create(path, &args.maps, extra)?),
        None => None,
    };
    let to_stdout = args.csv.as_deref() == Some(Path::new("-"));
    let Some(summary) = judge_all(args, &settings, &mut maps, csv)? else {
        // Who read the rows wants no more of them, and no summary either.
        return Ok(());
    };
    let mut text = Vec::new();
    let written = if args.json {
        serde_json::to_writer(&mut text, &summary)
            .map_err(io::Error::from)
            .and_then(|()| text.write_all(b"\n"))
    } else {
        summary.write_text(&mut text)
    };
    let printed = written.and_then(|()| {
        if to_stdout {
            io::stderr().write_all(&text)
        } else {
            io::stdout().write_all(&text)
        }
    });
    match printed {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::failed(format!(
            "the summary cannot be written ({error}), expected an open standard output"
        ))),
        _ => Ok(()),
    }
}

/// Judges every frame; `None` when standard output was closed before the end.
fn judge_all(
    args: &DetectArgs,
    settings: &Settings,
    maps: &mut MapsFile,
    mut csv: Option<Csv>,
) -> Result<Option<Summary>, Error> {
    let mut replay = if csv.as_ref().is_some_and(|csv| csv.extra != Extra::default()) {
        Some(Replay::new(settings, args.rate)?)
    } else {
        None
    };
    let mut summary = Summary::new(args.maps.display().to_string(), maps.grid(), settings);
    let written = |csv: &Csv, result: io::Result<()>| match result {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(unwritable(csv.path, &error)),
    };
    if let Some(csv) = &mut csv {
        let result = write_header(&mut csv.output, csv.extra);
        if !written(csv, result)? {
            return Ok(None);
        }
    }
    let mut forces = Box::new([[0.0; 3]; TAXELS]);
    while maps.read_frame(&mut forces)? {
        let frame = summary.frames;
        let quantised = quantise(&forces, settings.scale);
        let verdict = judge(&quantised.map, settings);
        summary.add(&verdict, quantised.saturated, quantised.max_n);
        let answer = match &mut replay {
            Some(replay) => Some(replay.show(frame, &quantised.map, quantised.saturated > 0, &verdict)?),
            None => None,
        };
        if let Some(csv) = &mut csv {
            let result = write_row(&mut csv.output, csv.extra, args.pitch_mm, frame, &verdict, answer);
            if !written(csv, result)? {
                return Ok(None);
            }
        }
    }
    if let Some(csv) = csv {
        let Csv { path, output, .. } = csv;
        match output.finish() {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => return Ok(None),
            result => result.map_err(|error| unwritable(path, &error))?,
        }
    }
    Ok(Some(summary))
}
