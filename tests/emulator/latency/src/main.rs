//! `gripline-latency --image FILE.elf --twin FILE.elf [--short] [--json]`: measures, bounds, prints; exit code 1 when a number of the
//! design does not hold, 2 for wrong usage. `--bless FILE` writes the snapshot of instruction counts instead.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use gripline_latency::report::Report;
use gripline_latency::sweep::Length;
use gripline_latency::{Error, snapshot};

const USAGE: &str =
    "gripline-latency --image FILE.elf --twin FILE.elf [--short] [--json] | --image FILE.elf --bless FILE";

fn main() -> ExitCode {
    let (mut image, mut twin, mut bless) = (None, None, None);
    let (mut is_json, mut length) = (false, Length::Full);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--json" => is_json = true,
            "--short" => length = Length::Short,
            "--image" => image = arguments.next().map(PathBuf::from),
            "--twin" => twin = arguments.next().map(PathBuf::from),
            "--bless" => bless = arguments.next().map(PathBuf::from),
            unknown => {
                eprintln!("gripline-latency: found {unknown}, expected {USAGE}");
                return ExitCode::from(2);
            }
        }
    }
    let result = match (image, twin, bless) {
        (Some(image), None, Some(file)) => bless_snapshot(&image, &file).map(|()| true),
        (Some(image), Some(twin), None) => Report::make(&image, &twin, length).map(|report| {
            print!("{}", if is_json { report.json() } else { report.text() });
            for why in report.failures() {
                eprintln!("gripline-latency: {why}");
            }
            report.failures().is_empty()
        }),
        _ => {
            eprintln!("gripline-latency: expected {USAGE}");
            return ExitCode::from(2);
        }
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("gripline-latency: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bless_snapshot(image: &std::path::Path, file: &std::path::Path) -> Result<(), Error> {
    let counts = snapshot::count(image)?;
    std::fs::write(file, snapshot::text(&counts))
        .map_err(|error| Error::Image(format!("{}: {error}", file.display())))
}
