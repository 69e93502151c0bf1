//! The command `gripline evaluate real`: recorded trials of real sensors as they are. `gelsight` judges pictures, `uskin` counts.

mod gelsight;
mod uskin;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::document::write_section;
use crate::error::EvaluationError;

/// Where the recordings lie: the folder that holds those of the sensors.
const VARIABLE: &str = "GRIPLINE_RECORDINGS";

/// The arguments of `gripline evaluate real`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct RealArgs {
    /// Print the figures as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Write the figures as a section of this document.
    #[arg(long, value_name = "FILE.md")]
    pub out: Option<PathBuf>,
}

/// What was found; a sensor without recordings is not there.
#[derive(Debug, Serialize)]
struct Report {
    #[serde(skip_serializing_if = "Option::is_none")]
    gelsight_mini: Option<gelsight::Figures>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fingers: Option<Vec<uskin::Finger>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uskin_evidence: Option<Vec<uskin::evidence::Evidence>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uskin_quiet: Option<uskin::evidence::QuietTotals>,
}

/// Runs the command.
///
/// # Errors
/// [`EvaluationError`] when a recording is damaged or a file cannot be written.
pub fn run(args: &RealArgs) -> Result<(), EvaluationError> {
    let base = std::env::var_os(VARIABLE);
    let of = |folder, file| find(base.clone(), folder, file);
    let (pictures, counts) = (
        of(gelsight::FOLDER, "trials.csv"),
        of(uskin::FOLDER, "trial1_labels.npy"),
    );
    if pictures.is_none() && counts.is_none() {
        println!("skipped: recordings not found, set {VARIABLE}");
        return Ok(());
    }
    let quiet = of(uskin::evidence::FOLDER, "trial4_labels.npy");
    let uskin_evidence = counts
        .as_deref()
        .map(|slips| uskin::evidence::evaluate(slips, quiet.as_deref()))
        .transpose()?;
    let report = Report {
        gelsight_mini: pictures.as_deref().map(gelsight::evaluate).transpose()?,
        fingers: counts.as_deref().map(uskin::evaluate).transpose()?,
        uskin_quiet: uskin_evidence
            .as_deref()
            .and_then(uskin::evidence::QuietTotals::of),
        uskin_evidence,
    };
    let page = markdown(&report);
    let text = if args.json {
        serde_json::to_string(&report)? + "\n"
    } else {
        page.clone()
    };
    io::stdout().write_all(text.as_bytes())?;
    match &args.out {
        Some(path) => write_section(path, "gripline evaluate real", &page),
        None => Ok(()),
    }
}

/// The sensor's folder, where it is the given one or lies in it: it has this file.
fn find(given: Option<OsString>, folder: &str, file: &str) -> Option<PathBuf> {
    let given = PathBuf::from(given?);
    [given.join(folder), given]
        .into_iter()
        .find(|folder: &PathBuf| Path::is_file(&folder.join(file)))
}

fn markdown(report: &Report) -> String {
    let parts = [
        report.gelsight_mini.as_ref().map(gelsight::markdown),
        report.fingers.as_deref().map(uskin::markdown),
        report.uskin_evidence.as_deref().map(uskin::evidence::markdown),
    ];
    let mut page = format!("## Recorded trials of real sensors\n\n`{VARIABLE}=… gripline evaluate real`\n");
    for part in parts.into_iter().flatten() {
        page += "\n";
        page += &part;
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_the_variable_or_with_a_folder_of_something_else_there_are_no_recordings() {
        assert_eq!(find(None, uskin::FOLDER, "trial1_labels.npy"), None);
        assert_eq!(
            find(Some("/nowhere".into()), uskin::FOLDER, "trial1_labels.npy"),
            None
        );
    }

    #[test]
    fn recordings_are_found_in_their_folder_and_in_the_one_above() {
        let base = tempfile::tempdir().unwrap();
        let folder = base.path().join(gelsight::FOLDER);
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("trials.csv"), "").unwrap();
        for given in [base.path(), &folder] {
            let found = find(Some(given.into()), gelsight::FOLDER, "trials.csv");
            assert_eq!(found.as_deref(), Some(folder.as_path()));
        }
    }
}
