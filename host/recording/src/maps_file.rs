//! Files of force maps: NumPy arrays of shape (T, 3, R, C), float32 or float64 in either byte order, channels x, y, z, R and
//! C up to 20. A smaller grid sits in the corner (row 0, column 0) of an empty 20×20 map. Numbers come out as they stand in
//! the file. C order is read frame by frame; Fortran order needs the whole file in memory, because its frames interleave.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use gripline_protocol::{SIDE, TAXELS};
use npyz::{DType, NpyFile, NpyReader, Order, TypeChar};

use crate::error::{MapsProblem, RecordingError};

/// x, y and z.
const CHANNELS: usize = 3;
const MAGIC: &[u8] = b"\x93NUMPY";
/// Bytes of a header; that of a plain array has 118. npyz parses headers recursively, so longer ones are refused unread.
const HEADER_MAX: usize = 1_024;
/// Decimal digits of a header whose dimensions surely multiply to less than 2⁶⁴: npyz multiplies them unchecked.
const DIGITS_MAX: usize = 19;
/// Characters of a bad header that an error shows.
const SHOWN_MAX: usize = 120;

/// Forces of one frame in newtons (or whatever the file holds): (x, y, z) of taxel `row * 20 + column`.
pub type FrameForces = [[f64; CHANNELS]; TAXELS];

/// The numbers of a file, one after the other.
enum Numbers {
    F32(NpyReader<f32, BufReader<File>>),
    F64(NpyReader<f64, BufReader<File>>),
    /// Fortran order: all of them, channel by channel of all frames.
    Interleaved(Vec<f64>),
}

impl Numbers {
    fn next(&mut self) -> io::Result<f64> {
        let number = match self {
            Self::F32(reader) => reader.next().map(|number| number.map(f64::from)),
            Self::F64(reader) => reader.next(),
            Self::Interleaved(_) => None,
        };
        number.unwrap_or_else(|| Err(io::ErrorKind::UnexpectedEof.into()))
    }
}

/// An open file of force maps, whose header and length have been checked.
pub struct MapsFile {
    path: PathBuf,
    numbers: Numbers,
    frames: u64,
    rows: usize,
    columns: usize,
    next: u64,
}

impl std::fmt::Debug for MapsFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MapsFile")
            .field("path", &self.path)
            .field("next", &self.next)
            .finish_non_exhaustive()
    }
}

impl MapsFile {
    /// Opens a file and checks everything but the numbers themselves.
    ///
    /// # Errors
    /// [`RecordingError::Maps`] when the file is missing, is not a NumPy file of (T, 3, R, C) floats, or has another length
    /// than its header says.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        Self::read_header(path).map_err(|problem| maps_error(path, problem))
    }

    fn read_header(path: &Path) -> Result<Self, MapsProblem> {
        // Asked before opening, because opening a pipe would wait for its other end.
        let metadata = fs::metadata(path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => MapsProblem::Missing,
            _ => error.into(),
        })?;
        if !metadata.is_file() {
            return Err(MapsProblem::NotAFile);
        }
        let mut file = File::open(path)?;
        let mut start = Vec::new();
        (&mut file)
            .take((MAGIC.len() + 6 + HEADER_MAX) as u64)
            .read_to_end(&mut start)?;
        let (data_start, text) = header_of(&start)?;
        file.seek(SeekFrom::Start(0))?;
        let array = NpyFile::new(BufReader::with_capacity(1 << 16, file)).map_err(|_| refused(text))?;
        let number_bytes = float_bytes(&array.dtype())?;
        let (frames, rows, columns) = grid_of(array.shape())?;
        let frame_bytes = (CHANNELS * rows * columns * number_bytes) as u64;
        check_length(
            metadata.len().saturating_sub(data_start as u64),
            frames,
            frame_bytes,
        )?;
        let is_interleaved = array.order() == Order::Fortran;
        let other_type = |error: npyz::DTypeError| MapsProblem::Dtype(error.to_string());
        let mut numbers = if number_bytes == 4 {
            Numbers::F32(array.data().map_err(other_type)?)
        } else {
            Numbers::F64(array.data().map_err(other_type)?)
        };
        if is_interleaved {
            // The length was checked, so the count fits the memory's address space.
            let count = frames as usize * CHANNELS * rows * columns;
            let all: io::Result<Vec<f64>> = (0..count).map(|_| numbers.next()).collect();
            numbers = Numbers::Interleaved(all?);
        }
        Ok(Self {
            path: path.to_owned(),
            numbers,
            frames,
            rows,
            columns,
            next: 0,
        })
    }

    /// Frames in the file, at least 1.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// Rows and columns of the file's grid, 1 to 20 each.
    #[must_use]
    pub const fn grid(&self) -> (usize, usize) {
        (self.rows, self.columns)
    }

    /// Reads the next frame; `false` when there is none left. Taxels outside the file's grid become zero.
    ///
    /// # Errors
    /// [`RecordingError::Maps`] when a number is NaN or infinite, or the file cannot be read any more.
    pub fn read_frame(&mut self, forces: &mut FrameForces) -> Result<bool, RecordingError> {
        if self.next >= self.frames {
            return Ok(false);
        }
        *forces = [[0.0; CHANNELS]; TAXELS];
        for axis in 0..CHANNELS {
            for row in 0..self.rows {
                for column in 0..self.columns {
                    let number = self.number(axis, row, column);
                    let found = number.map_err(|error| maps_error(&self.path, error.into()))?;
                    if !found.is_finite() {
                        let problem = MapsProblem::NotFinite {
                            frame: self.next,
                            row,
                            column,
                            axis: ['x', 'y', 'z'][axis],
                            found,
                        };
                        return Err(maps_error(&self.path, problem));
                    }
                    forces[row * SIDE + column][axis] = found;
                }
            }
        }
        self.next += 1;
        Ok(true)
    }

    /// A number of the next frame; in C order they must be asked for in the order of the file.
    fn number(&mut self, axis: usize, row: usize, column: usize) -> io::Result<f64> {
        match &mut self.numbers {
            Numbers::Interleaved(all) => {
                let place = axis + CHANNELS * (row + self.rows * column);
                Ok(all[self.next as usize + self.frames as usize * place])
            }
            numbers => numbers.next(),
        }
    }
}

fn maps_error(path: &Path, problem: MapsProblem) -> RecordingError {
    RecordingError::Maps {
        path: path.to_owned(),
        problem,
    }
}

fn refused(text: &[u8]) -> MapsProblem {
    let shown: String = String::from_utf8_lossy(text)
        .trim()
        .chars()
        .take(SHOWN_MAX)
        .collect();
    MapsProblem::Header(format!("{shown:?}"))
}

/// Where the data begin, and the header's text.
fn header_of(start: &[u8]) -> Result<(usize, &[u8]), MapsProblem> {
    if start.is_empty() {
        return Err(MapsProblem::Empty);
    }
    let Some(rest) = start.strip_prefix(MAGIC) else {
        let hex: Vec<String> = start
            .iter()
            .take(MAGIC.len())
            .map(|byte| format!("{byte:02x}"))
            .collect();
        let advice = if start.starts_with(b"PK") {
            "this is a .npz archive; save the one array with numpy.save"
        } else {
            "save the array with numpy.save"
        };
        return Err(MapsProblem::NotNumpy(hex.join(" "), advice));
    };
    let truncated = |expected| MapsProblem::HeaderTruncated {
        found: start.len(),
        expected,
    };
    let (length, text) = match *rest {
        [1, _, low, high, ref text @ ..] => (usize::from(u16::from_le_bytes([low, high])), text),
        [2 | 3, _, a, b, c, d, ref text @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, text),
        [] | [1..=3, ..] => return Err(truncated(MAGIC.len() + 6)),
        [version, ..] => return Err(MapsProblem::Header(format!("of version {version}"))),
    };
    if length > HEADER_MAX {
        return Err(MapsProblem::Header(format!("of {length} bytes")));
    }
    let text_start = start.len() - text.len();
    let text = text.get(..length).ok_or_else(|| truncated(text_start + length))?;
    if text.iter().filter(|byte| byte.is_ascii_digit()).count() > DIGITS_MAX {
        return Err(refused(text));
    }
    Ok((text_start + length, text))
}

/// Bytes of a number: 4 for float32, 8 for float64.
fn float_bytes(dtype: &DType) -> Result<usize, MapsProblem> {
    match dtype {
        DType::Plain(kind) if kind.type_char() == TypeChar::Float && [4, 8].contains(&kind.size_field()) => {
            Ok(kind.size_field() as usize)
        }
        _ => Err(MapsProblem::Dtype(dtype.descr())),
    }
}

/// (frames, rows, columns).
fn grid_of(shape: &[u64]) -> Result<(u64, usize, usize), MapsProblem> {
    let refused = |what: String| {
        let shown = match shape {
            [one] => format!("({one},)"),
            many => format!("{many:?}").replace('[', "(").replace(']', ")"),
        };
        Err(MapsProblem::Shape(shown, what))
    };
    match *shape {
        [_, CHANNELS_U64, rows, columns] => {
            for (name, found) in [("rows", rows), ("columns", columns)] {
                if !(1..=SIDE as u64).contains(&found) {
                    return refused(format!(
                        "found {found} {name}, expected 1 to {SIDE}; cut or bin the grid"
                    ));
                }
            }
            if shape[0] == 0 {
                return refused("found 0 frames, expected at least 1; record it again".to_owned());
            }
            Ok((shape[0], rows as usize, columns as usize))
        }
        [_, channels, _, columns] => {
            let advice = if columns == CHANNELS_U64 {
                "move them with numpy.moveaxis(maps, -1, 1)"
            } else {
                "save x, y and z"
            };
            refused(format!(
                "found {channels} channels on axis 1, expected 3; {advice}"
            ))
        }
        _ => refused(format!(
            "found {} dimensions, expected 4; reshape the array",
            shape.len()
        )),
    }
}

const CHANNELS_U64: u64 = CHANNELS as u64;

/// Whether the data behind the header are exactly the frames that it promises.
fn check_length(found: u64, frames: u64, frame_bytes: u64) -> Result<(), MapsProblem> {
    match frames.checked_mul(frame_bytes) {
        Some(expected) if expected == found => Ok(()),
        Some(expected) if expected < found => Err(MapsProblem::TooLong { found, expected }),
        _ => Err(MapsProblem::Truncated {
            found,
            expected: u128::from(frames) * u128::from(frame_bytes),
            frames,
            frame_bytes,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A file of this header and these data.
    fn bytes_of(version: u8, dict: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = [MAGIC, &[version, 0]].concat();
        let length = (dict.len() + 1).to_le_bytes();
        bytes.extend(&length[..if version == 1 { 2 } else { 4 }]);
        bytes.extend(dict.as_bytes());
        bytes.push(b'\n');
        bytes.extend(data);
        bytes
    }

    fn opened(version: u8, dict: &str, data: &[u8]) -> Result<MapsFile, RecordingError> {
        opened_bytes(&bytes_of(version, dict, data))
    }

    fn opened_bytes(bytes: &[u8]) -> Result<MapsFile, RecordingError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("maps.npy");
        fs::write(&path, bytes).unwrap();
        MapsFile::open(&path)
    }

    fn problem(result: Result<MapsFile, RecordingError>) -> MapsProblem {
        match result {
            Err(RecordingError::Maps { problem, .. }) => problem,
            other => panic!("found {other:?}, expected a problem"),
        }
    }

    const GOOD: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (7, 3, 4, 5), }";

    #[test]
    fn every_version_of_the_header_is_read() {
        for version in [1, 2, 3] {
            let maps = opened(version, GOOD, &[0; 7 * 3 * 4 * 5 * 4]).unwrap();
            assert_eq!((maps.frames(), maps.grid()), (7, (4, 5)));
        }
    }

    #[test]
    fn a_shape_whose_bytes_do_not_fit_64_bits_is_refused_and_not_a_panic() {
        for (frames, is_truncated) in [("9999999999999", true), ("18446744073709551615", false)] {
            let dict = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({frames}, 3, 20, 20)}}");
            match problem(opened(1, &dict, &[0; 100])) {
                MapsProblem::Truncated { .. } => assert!(is_truncated),
                MapsProblem::Header(_) => assert!(!is_truncated),
                other => panic!("{other}"),
            }
        }
        assert!(matches!(
            check_length(1_000, u64::MAX / 2, 9_600),
            Err(MapsProblem::Truncated { .. })
        ));
    }

    #[test]
    fn a_deeply_nested_or_a_long_header_is_refused() {
        for nested in ["(".repeat(HEADER_MAX - 1), "(".repeat(60_000)] {
            assert!(matches!(problem(opened(1, &nested, &[])), MapsProblem::Header(_)));
        }
    }

    #[test]
    fn every_cut_of_a_header_is_reported_as_such() {
        let bytes = bytes_of(1, GOOD, &[]);
        for cut in 6..bytes.len() {
            match problem(opened_bytes(&bytes[..cut])) {
                MapsProblem::HeaderTruncated { found, expected } => assert!(found == cut && expected > cut),
                other => panic!("{cut}: {other}"),
            }
        }
    }

    proptest! {
        #[test]
        fn any_bytes_give_maps_or_a_problem_of_one_line(
            bytes in proptest::collection::vec(any::<u8>(), 0..200),
            version in 0u8..5,
        ) {
            let numpy = [MAGIC, &[version], &bytes[..]].concat();
            for input in [&bytes, &numpy] {
                if let Err(error) = opened_bytes(input) {
                    prop_assert_eq!(error.to_string().lines().count(), 1);
                }
            }
        }

        #[test]
        fn a_damaged_header_gives_maps_or_a_problem_of_one_line(at in 6usize..70, byte in any::<u8>()) {
            let mut bytes = bytes_of(1, GOOD, &[0; 7 * 3 * 4 * 5 * 4]);
            bytes[at] = byte;
            match opened_bytes(&bytes) {
                Ok(maps) => prop_assert!(maps.rows <= SIDE && maps.columns <= SIDE),
                Err(error) => prop_assert_eq!(error.to_string().lines().count(), 1),
            }
        }
    }
}
