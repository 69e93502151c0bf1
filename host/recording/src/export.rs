//! A recording as files that NumPy and spreadsheets read. `maps.npy` (T, 3, 20, 20) float32 newtons as `gripline detect` reads
//! them, `pictures.npy` (T, side, side) uint8 where every frame has a picture, `frames.csv` with a row a frame; of a second
//! fingertip `maps_1.npy` and `pictures_1.npy`. Also repairs a truncated file.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use gripline_protocol::SENSORS;
use npyz::WriterBuilder as _;

use crate::error::RecordingError;
use crate::reader::{Completeness, Reader, RecordedFrame, messages_of};
use crate::status::RecordedStatus;
use crate::units;

/// Columns of `frames.csv`; `stick_ratio` is empty when nothing touches, those of the truth when it is unknown.
const HEADER: &str = "frame,t_s,gate,health,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,state,line_n,latency_us,\
                      faults,truth_phase,truth_fn,truth_ft,truth_stick_ratio,truth_gross_slip,truth_slip_mm,sensor,\
                      slip_evidence";

/// Contents of the exported recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Frames of all fingertips.
    pub frames: u64,
    /// Frames without a picture.
    pub without_picture: u64,
    /// Whether the recording was truncated.
    pub completeness: Completeness,
}

/// Writes maps, pictures and the table of a recording into a folder, which is made when it is not contents; without a folder it
/// only counts.
///
/// # Errors
/// [`RecordingError`] that names the file which cannot be read or written.
pub fn export_arrays(recording: &Path, folder: Option<&Path>) -> Result<Exported, RecordingError> {
    // First to count, then to write: memory does not grow with the recording.
    let mut reader = Reader::open(recording)?;
    let mut contents: [Contents; SENSORS] = Default::default();
    while let Some(frame) = reader.next_frame()? {
        let contents = &mut contents[frame.status.sensor.index()];
        contents.frames += 1;
        if let Some(picture) = frame.picture {
            contents.pictures += 1;
            contents.shape = picture.shape();
        }
    }
    if let Some(folder) = folder {
        write_folder(recording, folder, &contents)?;
    }
    Ok(Exported {
        frames: contents.iter().map(|contents| contents.frames).sum(),
        without_picture: contents
            .iter()
            .map(|contents| contents.frames - contents.pictures)
            .sum(),
        completeness: reader.completeness(),
    })
}

/// What a recording has of a fingertip.
#[derive(Debug, Clone, Default)]
struct Contents {
    frames: u64,
    pictures: u64,
    /// Of one of its pictures.
    shape: Vec<usize>,
}

/// An array being written, and its file.
type Array<T> = (PathBuf, npyz::NpyWriter<T, BufWriter<File>>);

/// The files of a fingertip.
struct Arrays {
    maps: Array<f32>,
    /// If every frame has a picture.
    pictures: Option<Array<u8>>,
}

impl Arrays {
    /// Creates those of fingertip `sensor`; `None` without frames of it.
    fn begin(folder: &Path, sensor: usize, contents: &Contents) -> Result<Option<Self>, RecordingError> {
        if contents.frames == 0 {
            return Ok(None);
        }
        let behind = if sensor == 0 { "" } else { "_1" };
        let shape: Vec<u64> = [contents.frames]
            .into_iter()
            .chain(contents.shape.iter().map(|side| *side as u64))
            .collect();
        Ok(Some(Self {
            maps: begin(
                &folder.join(format!("maps{behind}.npy")),
                &[contents.frames, 3, 20, 20],
            )?,
            pictures: (contents.pictures == contents.frames)
                .then(|| begin(&folder.join(format!("pictures{behind}.npy")), &shape))
                .transpose()?,
        }))
    }

    fn push(&mut self, frame: RecordedFrame) -> Result<(), RecordingError> {
        let newtons = frame.map.dequantise();
        let axes = (0..3).flat_map(|axis| newtons.iter().map(move |force| force[axis]));
        let (path, maps) = &mut self.maps;
        maps.extend(axes).map_err(failed(path))?;
        if let (Some((path, pictures)), Some(picture)) = (&mut self.pictures, frame.picture) {
            pictures.extend(picture.pixels).map_err(failed(path))?;
        }
        Ok(())
    }

    fn finish(self) -> Result<(), RecordingError> {
        let (path, maps) = self.maps;
        maps.finish().map_err(failed(&path))?;
        if let Some((path, pictures)) = self.pictures {
            pictures.finish().map_err(failed(&path))?;
        }
        Ok(())
    }
}

fn failed(path: &Path) -> impl Fn(io::Error) -> RecordingError {
    move |error| RecordingError::Export {
        path: path.to_owned(),
        error,
    }
}

fn begin<T: npyz::AutoSerialize>(path: &Path, shape: &[u64]) -> Result<Array<T>, RecordingError> {
    let file = File::create(path).map_err(failed(path))?;
    let begun = npyz::WriteOptions::<T>::new()
        .default_dtype()
        .shape(shape)
        .writer(BufWriter::new(file))
        .begin_nd()
        .map_err(failed(path))?;
    Ok((path.to_owned(), begun))
}

fn write_folder(
    recording: &Path,
    folder: &Path,
    contents: &[Contents; SENSORS],
) -> Result<(), RecordingError> {
    std::fs::create_dir_all(folder).map_err(failed(folder))?;
    let csv_path = folder.join("frames.csv");
    let mut csv = BufWriter::new(File::create(&csv_path).map_err(failed(&csv_path))?);
    let [first, second] = contents;
    let mut arrays = [
        Arrays::begin(folder, 0, first)?,
        Arrays::begin(folder, 1, second)?,
    ];
    writeln!(csv, "{HEADER}").map_err(failed(&csv_path))?;
    let mut reader = Reader::open(recording)?;
    while let Some(frame) = reader.next_frame()? {
        writeln!(csv, "{}", row(&frame.status)).map_err(failed(&csv_path))?;
        if let Some(arrays) = &mut arrays[frame.status.sensor.index()] {
            arrays.push(frame)?;
        }
    }
    for arrays in arrays.into_iter().flatten() {
        arrays.finish()?;
    }
    csv.flush().map_err(failed(&csv_path))
}

/// Numbers are written so that reading them gives the same f64 again; flags are 0 or 1.
fn row(status: &RecordedStatus) -> String {
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
    cells.push(units::ratio(status.wire.slip_evidence).to_string());
    cells.join(",")
}

/// Copies every readable message into a complete recording with index and summary, and returns their number.
///
/// # Errors
/// [`RecordingError`] that names the file which cannot be read or written; `to` must not be there yet.
pub fn copy_whole(from: &Path, to: &Path) -> Result<u64, RecordingError> {
    let source = File::open(from).map_err(|error| RecordingError::Read {
        path: from.to_owned(),
        expected: "a recording",
        error,
    })?;
    let file = File::create_new(to).map_err(failed(to))?;
    let failed = |error| failed(to)(io::Error::other(error));
    let mut writer = mcap::WriteOptions::new()
        .compression(None)
        .create(BufWriter::new(file))
        .map_err(failed)?;
    let mut count = 0;
    for message in messages_of(source).map_while(Result::ok) {
        writer.write(&message).map_err(failed)?;
        count += 1;
    }
    writer.finish().map_err(failed)?;
    Ok(count)
}
