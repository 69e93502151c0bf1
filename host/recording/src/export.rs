//! `gripline export`: a recording as files that NumPy and spreadsheets read. `maps.npy` (T, 3, 20, 20) float32 newtons as
//! `gripline detect` reads them, `pictures.npy` (T, side, side) uint8 where every frame has a picture, `frames.csv` with a
//! row a frame; of a second fingertip `maps_1.npy` and `pictures_1.npy`. `--mcap` writes a whole file from one that was cut short.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use gripline_protocol::SENSORS;
use mcap::io::MessageReader;
use npyz::WriterBuilder as _;

use super::messages::Stored;
use super::reader::{Ending, Reader, RecordedFrame};
use crate::error::{Completion, Failure};

/// Columns of `frames.csv`; `stick_ratio` is empty when nothing touches, those of the truth when nobody knows it.
const HEADER: &str = "frame,t_s,gate,health,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,state,line_n,latency_us,\
                      faults,truth_phase,truth_fn,truth_ft,truth_stick_ratio,truth_gross_slip,truth_slip_mm,sensor";

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
pub fn run(args: &ExportArgs) -> Result<Completion, Failure> {
    // First to know what there is, then to write it: memory does not grow with the recording.
    let mut reader = Reader::open(&args.recording)?;
    let mut there = [There::default(); SENSORS];
    while let Some(frame) = reader.next_frame()? {
        let there = &mut there[usize::from(frame.status.sensor)];
        there.frames += 1;
        if let Some(picture) = frame.picture {
            there.pictures += 1;
            there.side = picture.side;
        }
    }
    let frames: u64 = there.iter().map(|there| there.frames).sum();
    let ending = reader.ending();
    if let Some(folder) = &args.out {
        write_folder(&args.recording, folder, &there)?;
        let without: u64 = there.iter().map(|there| there.frames - there.pictures).sum();
        let left_out = if without == 0 {
            String::new()
        } else {
            format!("; no pictures.npy: {without} frames have none")
        };
        println!("{frames} frames to {}{left_out}", folder.display());
    }
    if let Some(path) = &args.mcap {
        let messages = copy(&args.recording, path)?;
        println!("{messages} messages to {}", path.display());
    }
    match ending {
        Ending::Whole => Ok(Completion::Whole),
        Ending::Cut(why) => Ok(Completion::WithLoss(format!(
            "{}: a recording cut short after {frames} frames ({why}); what is there was exported",
            args.recording.display()
        ))),
    }
}

/// What there is of a fingertip.
#[derive(Debug, Clone, Copy, Default)]
struct There {
    frames: u64,
    pictures: u64,
    /// Columns and rows of its pictures.
    side: usize,
}

/// An array under way, and its file.
type Array<T> = (PathBuf, npyz::NpyWriter<T, BufWriter<File>>);

/// The files of a fingertip.
struct Arrays {
    maps: Array<f32>,
    /// Where every frame has a picture.
    pictures: Option<Array<u8>>,
}

impl Arrays {
    /// Begins those of fingertip `sensor`; `None` where there is nothing of it.
    fn begin(folder: &Path, sensor: usize, there: There) -> Result<Option<Self>, Failure> {
        if there.frames == 0 {
            return Ok(None);
        }
        let behind = if sensor == 0 { "" } else { "_1" };
        let side = there.side as u64;
        Ok(Some(Self {
            maps: begin(
                &folder.join(format!("maps{behind}.npy")),
                &[there.frames, 3, 20, 20],
            )?,
            pictures: (there.pictures == there.frames)
                .then(|| {
                    begin(
                        &folder.join(format!("pictures{behind}.npy")),
                        &[there.frames, side, side],
                    )
                })
                .transpose()?,
        }))
    }

    fn push(&mut self, frame: RecordedFrame) -> Result<(), Failure> {
        let newtons = frame.map.dequantise();
        let axes = (0..3).flat_map(|axis| newtons.iter().map(move |force| force[axis]));
        let (path, maps) = &mut self.maps;
        maps.extend(axes).map_err(|error| failed(path, &error))?;
        if let (Some((path, pictures)), Some(picture)) = (&mut self.pictures, frame.picture) {
            pictures
                .extend(picture.pixels)
                .map_err(|error| failed(path, &error))?;
        }
        Ok(())
    }

    fn finish(self) -> Result<(), Failure> {
        let (path, maps) = self.maps;
        maps.finish().map_err(|error| failed(&path, &error))?;
        if let Some((path, pictures)) = self.pictures {
            pictures.finish().map_err(|error| failed(&path, &error))?;
        }
        Ok(())
    }
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::failed(format!(
        "{}: {error}, expected a folder that can be written",
        path.display()
    ))
}

fn begin<T: npyz::AutoSerialize>(path: &Path, shape: &[u64]) -> Result<Array<T>, Failure> {
    let file = File::create(path).map_err(|error| failed(path, &error))?;
    let begun = npyz::WriteOptions::<T>::new()
        .default_dtype()
        .shape(shape)
        .writer(BufWriter::new(file))
        .begin_nd()
        .map_err(|error| failed(path, &error))?;
    Ok((path.to_owned(), begun))
}

fn write_folder(recording: &Path, folder: &Path, there: &[There; SENSORS]) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
    let csv_path = folder.join("frames.csv");
    let mut csv = BufWriter::new(File::create(&csv_path).map_err(|error| failed(&csv_path, &error))?);
    let [first, second] = there;
    let mut arrays = [
        Arrays::begin(folder, 0, *first)?,
        Arrays::begin(folder, 1, *second)?,
    ];
    writeln!(csv, "{HEADER}").map_err(|error| failed(&csv_path, &error))?;
    let mut reader = Reader::open(recording)?;
    while let Some(frame) = reader.next_frame()? {
        writeln!(csv, "{}", row(&frame.status)).map_err(|error| failed(&csv_path, &error))?;
        if let Some(arrays) = &mut arrays[usize::from(frame.status.sensor)] {
            arrays.push(frame)?;
        }
    }
    for arrays in arrays.into_iter().flatten() {
        arrays.finish()?;
    }
    csv.flush().map_err(|error| failed(&csv_path, &error))
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
    cells.push(status.sensor.to_string());
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
