//! `gripline export`: a recording as files that NumPy and spreadsheets read. `maps.npy` (T, 3, 20, 20) float32 newtons as
//! `gripline detect` reads them, `pictures.npy` (T, side, side) uint8 where every frame has a picture, `frames.csv` with a
//! row a frame. `--mcap` writes a whole file from one that was cut short.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use mcap::io::MessageReader;
use npyz::WriterBuilder as _;

use super::messages::Stored;
use super::reader::{Ending, Reader};
use crate::error::Failure;

/// Columns of `frames.csv`; `stick_ratio` is empty when nothing touches, those of the truth when nobody knows it.
const HEADER: &str = "frame,t_s,gate,health,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,state,line_n,latency_us,\
                      faults,truth_phase,truth_fn,truth_ft,truth_stick_ratio,truth_gross_slip,truth_slip_mm";

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
/// [`Failure`] that names the file which cannot be read or written, and of kind Loss when the recording was cut short.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    // First to know what there is, then to write it: memory does not grow with the recording.
    let mut reader = Reader::open(&args.recording)?;
    let (mut frames, mut pictures, mut side) = (0, 0, 0);
    while let Some(frame) = reader.next_frame()? {
        frames += 1;
        if let Some(picture) = frame.picture {
            pictures += 1;
            side = picture.side;
        }
    }
    let ending = reader.ending();
    if let Some(folder) = &args.out {
        let side = (pictures == frames).then_some(side);
        write_folder(&args.recording, folder, frames, side)?;
        let left_out = if side.is_some() {
            String::new()
        } else {
            format!("; no pictures.npy: {} frames have none", frames - pictures)
        };
        println!("{frames} frames to {}{left_out}", folder.display());
    }
    if let Some(path) = &args.mcap {
        let messages = copy(&args.recording, path)?;
        println!("{messages} messages to {}", path.display());
    }
    match ending {
        Ending::Whole => Ok(()),
        Ending::Cut(why) => Err(Failure::loss(format!(
            "{}: a recording cut short after {frames} frames ({why}); what is there was exported",
            args.recording.display()
        ))),
    }
}

fn write_folder(recording: &Path, folder: &Path, frames: u64, side: Option<usize>) -> Result<(), Failure> {
    let failed = |path: &Path, error: std::io::Error| {
        Failure::failed(format!(
            "{}: {error}, expected a folder that can be written",
            path.display()
        ))
    };
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    let open = |name: &str| {
        let path = folder.join(name);
        let file = File::create(&path).map_err(|error| failed(&path, error))?;
        Ok::<_, Failure>((path, BufWriter::new(file)))
    };
    let (maps_path, maps_file) = open("maps.npy")?;
    let (csv_path, mut csv) = open("frames.csv")?;
    let mut maps = npyz::WriteOptions::<f32>::new()
        .default_dtype()
        .shape(&[frames, 3, 20, 20])
        .writer(maps_file)
        .begin_nd()
        .map_err(|error| failed(&maps_path, error))?;
    let mut pictures = match side {
        None => None,
        Some(side) => {
            let (path, file) = open("pictures.npy")?;
            let begun = npyz::WriteOptions::<u8>::new()
                .default_dtype()
                .shape(&[frames, side as u64, side as u64])
                .writer(file)
                .begin_nd()
                .map_err(|error| failed(&path, error))?;
            Some((path, begun))
        }
    };
    writeln!(csv, "{HEADER}").map_err(|error| failed(&csv_path, error))?;
    let mut reader = Reader::open(recording)?;
    while let Some(frame) = reader.next_frame()? {
        let newtons = frame.map.dequantise();
        let axes = (0..3).flat_map(|axis| newtons.iter().map(move |force| force[axis]));
        maps.extend(axes).map_err(|error| failed(&maps_path, error))?;
        if let (Some((path, pictures)), Some(picture)) = (&mut pictures, frame.picture) {
            pictures
                .extend(picture.pixels)
                .map_err(|error| failed(path, error))?;
        }
        writeln!(csv, "{}", row(&frame.status)).map_err(|error| failed(&csv_path, error))?;
    }
    maps.finish().map_err(|error| failed(&maps_path, error))?;
    if let Some((path, pictures)) = pictures {
        pictures.finish().map_err(|error| failed(&path, error))?;
    }
    csv.flush().map_err(|error| failed(&csv_path, error))
}

/// Numbers are written so that reading them gives the same f64 again; flags are 0 or 1.
fn row(status: &Stored) -> String {
    let flag = |truth: bool| u8::from(truth).to_string();
    let ratio = |ratio: Option<f64>| ratio.map_or(String::new(), |ratio| ratio.to_string());
    let mut cells = vec![
        status.frame.to_string(),
        status.t_s.to_string(),
        status.gate.clone(),
        status.health.join(" "),
        status.normal_n.to_string(),
        status.shear_x_n.to_string(),
        status.shear_y_n.to_string(),
        status.shear_n.to_string(),
        status.moment_nmm.to_string(),
        status.contact.to_string(),
        status.stick.to_string(),
        ratio(status.stick_ratio),
        flag(status.coulomb_slip),
        status.state.clone(),
        status.line_n.to_string(),
        status.latency_us.to_string(),
        status.faults.join(" "),
    ];
    match &status.truth {
        Some(truth) => cells.extend([
            truth.phase.clone(),
            truth.normal_n.to_string(),
            truth.shear_n.to_string(),
            ratio(truth.stick_ratio),
            flag(truth.gross_slip),
            truth.slip_mm.to_string(),
        ]),
        None => cells.extend([const { String::new() }; 6]),
    }
    cells.join(",")
}

/// Every message that can be read, into a file with index and summary.
fn copy(from: &Path, to: &Path) -> Result<u64, Failure> {
    let failed =
        |path: &Path, error: &dyn std::fmt::Display| Failure::failed(format!("{}: {error}", path.display()));
    let source = File::open(from).map_err(|error| failed(from, &error))?;
    let file = File::create_new(to).map_err(|error| failed(to, &error))?;
    let mut writer = mcap::WriteOptions::new()
        .compression(None)
        .create(BufWriter::new(file))
        .map_err(|error| failed(to, &error))?;
    let mut count = 0;
    for message in MessageReader::new(BufReader::new(source)).map_while(Result::ok) {
        writer.write(&message).map_err(|error| failed(to, &error))?;
        count += 1;
    }
    writer.finish().map_err(|error| failed(to, &error))?;
    Ok(count)
}
