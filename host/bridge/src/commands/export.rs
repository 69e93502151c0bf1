//! `gripline export`: a recording as npy arrays and a CSV table, as a bag for ROS 2, or as a whole MCAP file from one that was cut
//! short.

use std::path::{Path, PathBuf};

use clap::Args;
use gripline_protocol::message::Configuration;
use gripline_recording::ros2::{Bag, Namespace, Sample};
use gripline_recording::units::millimetres;
use gripline_recording::{Completeness, Reader, copy_whole, export_arrays};

use crate::commands::plot::report::report_of;
use crate::config::settings_from_text;
use crate::error::{Completion, Error};

/// Arguments of `gripline export`.
#[derive(Debug, Clone, Args)]
pub struct ExportArgs {
    /// The recording.
    #[arg(value_name = "REC.mcap")]
    recording: PathBuf,
    /// Folder for maps.npy, pictures.npy and frames.csv; created when it does not exist.
    #[arg(long, value_name = "DIR", required_unless_present_any = ["mcap", "ros2"])]
    out: Option<PathBuf>,
    /// Copy the readable part into a complete recording, with index and summary, for programs that need them.
    #[arg(long, value_name = "FILE.mcap")]
    mcap: Option<PathBuf>,
    /// Folder for a ROS 2 bag (rosbag2, MCAP, CDR), which must not exist yet.
    #[arg(long, value_name = "DIR")]
    ros2: Option<PathBuf>,
    /// Namespace of the bag's topics.
    #[arg(long, value_name = "NAME", default_value = "gripline", requires = "ros2")]
    ros2_name: Namespace,
}

/// Exports.
///
/// # Errors
/// [`Error`] that names the file that cannot be read or written. A truncated recording is a [`Completion`] with loss.
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
    if let Some(folder) = &args.ros2 {
        let messages = export_bag(&args.recording, folder, &args.ros2_name)?;
        println!("{messages} messages to {}", folder.display());
    }
    match exported.completeness {
        Completeness::Whole => Ok(Completion::Whole),
        Completeness::Truncated(why) => Ok(Completion::WithLoss(format!(
            "{}: a recording cut short after {frames} frames ({why}); what is there was exported",
            args.recording.display()
        ))),
    }
}

/// Writes a recording as a bag; returns the number of its messages.
fn export_bag(recording: &Path, folder: &Path, namespace: &Namespace) -> Result<u64, Error> {
    let mut reader = Reader::open(recording)?;
    let settings = settings_from_text(&reader.metadata.settings, &Configuration::DEFAULT)
        .map_err(|error| Error::failed(format!("{}: {error}", recording.display())))?;
    let mut bag = Bag::create(folder, namespace)?;
    while let Some(frame) = reader.next_frame()? {
        let fingertip = settings.fingertips[frame.status.sensor.index()];
        let sample = Sample {
            captured_ns: frame.at_ns,
            report: report_of(&frame.status, &settings),
            map: frame.map,
            pitch_mm: millimetres(fingertip.pitch_um),
        };
        bag.frame(&sample, frame.picture)?;
    }
    Ok(bag.finish()?)
}
