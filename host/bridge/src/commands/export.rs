//! `gripline export`: a recording as npy arrays and a CSV table, or as a whole MCAP file from one that was cut short.

use std::path::PathBuf;

use clap::Args;
use gripline_recording::{Completeness, copy_whole, export_arrays};

use crate::error::{Completion, Error};

/// Arguments of `gripline export`.
#[derive(Debug, Clone, Args)]
pub struct ExportArgs {
    /// The recording.
    #[arg(value_name = "REC.mcap")]
    recording: PathBuf,
    /// Folder for maps.npy, pictures.npy and frames.csv; made when it is not there.
    #[arg(long, value_name = "DIR", required_unless_present = "mcap")]
    out: Option<PathBuf>,
    /// Copy what can be read into a whole recording, with index and summary, for programs that want one.
    #[arg(long, value_name = "FILE.mcap")]
    mcap: Option<PathBuf>,
}

/// Exports.
///
/// # Errors
/// [`Error`] that names the file which cannot be read or written. A recording that was cut short is a [`Completion`] with loss.
pub fn run(args: &ExportArgs) -> Result<Completion, Error> {
    let exported = export_arrays(&args.recording, args.out.as_deref())?;
    let frames = exported.frames;
    if let Some(folder) = &args.out {
        let left_out = match exported.without_picture {
            0 => String::new(),
            without => format!("; no pictures.npy: {without} frames have none"),
        };
        println!("{frames} frames to {}{left_out}", folder.display());
    }
    if let Some(path) = &args.mcap {
        let messages = copy_whole(&args.recording, path)?;
        println!("{messages} messages to {}", path.display());
    }
    match exported.completeness {
        Completeness::Whole => Ok(Completion::Whole),
        Completeness::Truncated(why) => Ok(Completion::WithLoss(format!(
            "{}: a recording cut short after {frames} frames ({why}); what is there was exported",
            args.recording.display()
        ))),
    }
}
