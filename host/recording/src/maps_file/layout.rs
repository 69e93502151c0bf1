//! What the start of a NumPy file says about the force maps behind it. Pure: bytes in, layout or problem out.
//! Takes (T, 3, R, C) of float32 or float64, either byte order, C or Fortran order, R and C from 1 to 20.
//! Limits: the header has at most 1,024 bytes (that of a plain array has 118), so that no header costs time or stack.

use std::io;

use gripline_protocol::{SIDE, TAXELS};
use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};

/// x, y and z.
const CHANNELS: usize = 3;
const MAGIC: &[u8] = b"\x93NUMPY";
const HEADER_MAX: usize = 1_024;
/// Bytes from the start of a file that [`Layout::parse`] may want to see.
pub(super) const START_MAX: usize = MAGIC.len() + 2 + 4 + HEADER_MAX;
/// Characters of a bad header that an error shows.
const SHOWN_MAX: usize = 120;
/// Decimal digits of a header whose dimensions surely multiply to less than 2⁶⁴: npyz multiplies them unchecked.
const DIGITS_MAX: usize = 19;

/// Forces of one frame in newtons (or whatever the file holds): (x, y, z) of taxel `row * 20 + column`.
pub type FrameForces = [[f64; CHANNELS]; TAXELS];

/// What is wrong with a file of force maps: what was found, what was expected, what to do.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// Nothing has that name.
    #[error("no such file, expected a NumPy file of force maps: check the path")]
    Missing,
    /// The system does not let us read.
    #[error("cannot be read ({0}), expected a readable NumPy file: check its rights and its disk")]
    Unreadable(#[from] io::Error),
    /// A directory, a pipe or a device.
    #[error("not a regular file, expected a NumPy file of force maps: give the path of the .npy file itself")]
    NotAFile,
    /// No byte at all.
    #[error("empty file (0 bytes), expected a NumPy file of force maps: record or copy it again")]
    Empty,
    /// Other bytes than those that begin a NumPy file.
    #[error("starts with {found}, expected the NumPy signature 93 4e 55 4d 50 59: {advice}")]
    NotNumpy {
        /// The first bytes, hexadecimal.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// The file ends before its data begin.
    #[error(
        "ends inside the NumPy header after {found} bytes, expected at least {expected}: record or copy it again"
    )]
    HeaderTruncated {
        /// Bytes in the file.
        found: usize,
        /// Bytes that signature and header need.
        expected: usize,
    },
    /// A header that is not one, or not one of a plain array.
    #[error("NumPy header {found}, expected that of a plain float array: save it again with numpy.save")]
    Header {
        /// The version, the length or the text of the header.
        found: String,
    },
    /// Not float32 or float64.
    #[error("dtype {found}, expected float32 or float64 ('<f4' or '<f8'): save maps.astype(numpy.float32)")]
    Dtype {
        /// NumPy's description of the type.
        found: String,
    },
    /// Not (T, 3, R, C).
    #[error("shape {found}, expected (T, 3, R, C) with frames, x y z, rows and columns: {what}")]
    Shape {
        /// The shape as NumPy writes it.
        found: String,
        /// Which axis is wrong, and what to do.
        what: String,
    },
    /// Fewer data than the header promises.
    #[error(
        "truncated: found {found} bytes of data, expected {expected} ({frames} frames of {frame_bytes} bytes): \
         record or copy it again"
    )]
    Truncated {
        /// Bytes behind the header.
        found: u64,
        /// Bytes that the shape needs.
        expected: u128,
        /// Frames by the header.
        frames: u64,
        /// Bytes of one frame.
        frame_bytes: u64,
    },
    /// More data than the header promises.
    #[error(
        "found {found} bytes of data, expected {expected} by the shape in the header: \
         save one array per file with numpy.save"
    )]
    TooLong {
        /// Bytes behind the header.
        found: u64,
        /// Bytes that the shape needs.
        expected: u64,
    },
    /// NaN or an infinity.
    #[error(
        "frame {frame}, row {row}, column {column}, axis {axis}: found {found}, expected a finite number: \
         leave the frame out or repair it (numpy.isfinite finds them)"
    )]
    NotFinite {
        /// Frame, from 0.
        frame: u64,
        /// Row of the file's grid.
        row: usize,
        /// Column of the file's grid.
        column: usize,
        /// `x`, `y` or `z`.
        axis: char,
        /// What was found.
        found: f64,
    },
}

/// How the numbers lie in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) frames: u64,
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Where the data begin, bytes from the start of the file.
    pub(super) data_start: usize,
    /// All frames must be in memory: their numbers lie interleaved.
    pub(super) interleaved: bool,
    wide: bool,
    big_endian: bool,
}

impl Layout {
    /// Reads the first [`START_MAX`] bytes of a file, or all of it when it is shorter.
    pub(super) fn parse(start: &[u8]) -> Result<Self, Problem> {
        let (data_start, text) = header_of(start)?;
        let refused = || {
            let shown: String = String::from_utf8_lossy(text)
                .trim()
                .chars()
                .take(SHOWN_MAX)
                .collect();
            Problem::Header {
                found: format!("{shown:?}"),
            }
        };
        if text.iter().filter(|byte| byte.is_ascii_digit()).count() > DIGITS_MAX {
            return Err(refused());
        }
        let header = NpyHeader::from_reader(&start[..data_start]).map_err(|_| refused())?;
        let (wide, big_endian) = float_of(&header.dtype())?;
        let (frames, rows, columns) = grid_of(header.shape())?;
        Ok(Self {
            frames,
            rows,
            columns,
            data_start,
            interleaved: header.order() == Order::Fortran,
            wide,
            big_endian,
        })
    }

    /// Bytes of one frame.
    pub(super) const fn frame_bytes(&self) -> usize {
        CHANNELS * self.rows * self.columns * self.number_bytes()
    }

    const fn number_bytes(&self) -> usize {
        if self.wide { 8 } else { 4 }
    }

    /// Whether a file of `file_bytes` holds exactly the frames that its header promises.
    pub(super) fn check_length(&self, file_bytes: u64) -> Result<(), Problem> {
        let found = file_bytes.saturating_sub(self.data_start as u64);
        let frame_bytes = self.frame_bytes() as u64;
        match self.frames.checked_mul(frame_bytes) {
            Some(expected) if expected == found => Ok(()),
            Some(expected) if expected < found => Err(Problem::TooLong { found, expected }),
            _ => Err(Problem::Truncated {
                found,
                expected: u128::from(self.frames) * u128::from(frame_bytes),
                frames: self.frames,
                frame_bytes,
            }),
        }
    }

    /// Reads frame number `frame` out of `data`: its own bytes, or those of all frames when they lie interleaved.
    /// Taxels outside the file's grid become zero.
    pub(super) fn decode(&self, data: &[u8], frame: u64, forces: &mut FrameForces) -> Result<(), Problem> {
        *forces = [[0.0; CHANNELS]; TAXELS];
        // Distances in numbers between neighbours along channel, row and column, and the frame's first number.
        let (channel_step, row_step, column_step, first) = if self.interleaved {
            // The data are in memory, so their count fits usize.
            let frames = self.frames as usize;
            let row_step = frames * CHANNELS;
            (frames, row_step, row_step * self.rows, frame as usize)
        } else {
            (self.rows * self.columns, self.columns, 1, 0)
        };
        for row in 0..self.rows {
            for column in 0..self.columns {
                let force = &mut forces[row * SIDE + column];
                for (axis, component) in force.iter_mut().enumerate() {
                    let number = first + axis * channel_step + row * row_step + column * column_step;
                    let found = self.number(data, number);
                    if !found.is_finite() {
                        return Err(Problem::NotFinite {
                            frame,
                            row,
                            column,
                            axis: ['x', 'y', 'z'][axis],
                            found,
                        });
                    }
                    *component = found;
                }
            }
        }
        Ok(())
    }

    fn number(&self, data: &[u8], number: usize) -> f64 {
        // `check_length` saw to it that every number is there.
        if self.wide {
            let bytes = array(data, number);
            if self.big_endian {
                f64::from_be_bytes(bytes)
            } else {
                f64::from_le_bytes(bytes)
            }
        } else {
            let bytes = array(data, number);
            f64::from(if self.big_endian {
                f32::from_be_bytes(bytes)
            } else {
                f32::from_le_bytes(bytes)
            })
        }
    }
}

fn array<const BYTES: usize>(data: &[u8], number: usize) -> [u8; BYTES] {
    core::array::from_fn(|byte| data[number * BYTES + byte])
}

/// Where the data begin, and the header's text.
fn header_of(start: &[u8]) -> Result<(usize, &[u8]), Problem> {
    if start.is_empty() {
        return Err(Problem::Empty);
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
        return Err(Problem::NotNumpy {
            found: hex.join(" "),
            advice,
        });
    };
    let truncated = |expected| Problem::HeaderTruncated {
        found: start.len(),
        expected,
    };
    let (length, text) = match *rest {
        [1, _, low, high, ref text @ ..] => (usize::from(u16::from_le_bytes([low, high])), text),
        [2 | 3, _, a, b, c, d, ref text @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, text),
        [] | [1..=3, ..] => return Err(truncated(MAGIC.len() + 6)),
        [version, ..] => {
            return Err(Problem::Header {
                found: format!("of version {version}"),
            });
        }
    };
    if length > HEADER_MAX {
        return Err(Problem::Header {
            found: format!("of {length} bytes"),
        });
    }
    let text_start = start.len() - text.len();
    let header = text.get(..length).ok_or_else(|| truncated(text_start + length))?;
    Ok((text_start + length, header))
}

/// (float64 and not float32, big-endian).
fn float_of(dtype: &DType) -> Result<(bool, bool), Problem> {
    let refused = || Problem::Dtype { found: dtype.descr() };
    let DType::Plain(kind) = dtype else {
        return Err(refused());
    };
    let wide = match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 4) => false,
        (TypeChar::Float, 8) => true,
        _ => return Err(refused()),
    };
    Ok((wide, kind.endianness() == Endianness::Big))
}

/// (frames, rows, columns).
fn grid_of(shape: &[u64]) -> Result<(u64, usize, usize), Problem> {
    let refused = |what: String| Problem::Shape {
        found: numpy_shape(shape),
        what,
    };
    let &[frames, channels, rows, columns] = shape else {
        return Err(refused(format!(
            "found {} dimensions, expected 4; reshape the array",
            shape.len()
        )));
    };
    if channels != CHANNELS as u64 {
        let advice = if columns == CHANNELS as u64 {
            "move them with numpy.moveaxis(maps, -1, 1)"
        } else {
            "save x, y and z"
        };
        return Err(refused(format!(
            "found {channels} channels on axis 1, expected 3; {advice}"
        )));
    }
    for (name, found) in [("rows", rows), ("columns", columns)] {
        if !(1..=SIDE as u64).contains(&found) {
            return Err(refused(format!(
                "found {found} {name}, expected 1 to {SIDE}; cut or bin the grid"
            )));
        }
    }
    if frames == 0 {
        return Err(refused(
            "found 0 frames, expected at least 1; record it again".to_owned(),
        ));
    }
    Ok((frames, rows as usize, columns as usize))
}

/// A shape as NumPy writes it: `(7,)`, `(7, 3)`.
fn numpy_shape(shape: &[u64]) -> String {
    match shape {
        [one] => format!("({one},)"),
        many => {
            let numbers: Vec<String> = many.iter().map(u64::to_string).collect();
            format!("({})", numbers.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn start(version: u8, dict: &str) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        let length = dict.len() + 1;
        if version == 1 {
            bytes.extend((length as u16).to_le_bytes());
        } else {
            bytes.extend((length as u32).to_le_bytes());
        }
        bytes.extend(dict.as_bytes());
        bytes.push(b'\n');
        bytes
    }

    const GOOD: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (7, 3, 4, 5), }";

    #[test]
    fn every_version_of_the_header_is_read() {
        for version in [1, 2, 3] {
            let bytes = start(version, GOOD);
            let layout = Layout::parse(&bytes).unwrap();
            assert_eq!((layout.frames, layout.rows, layout.columns), (7, 4, 5));
            assert_eq!(layout.data_start, bytes.len());
            assert!(
                layout
                    .check_length((bytes.len() + 7 * 3 * 4 * 5 * 4) as u64)
                    .is_ok()
            );
        }
    }

    #[test]
    fn a_shape_whose_bytes_do_not_fit_64_bits_is_truncated_and_not_a_panic() {
        let dict = "{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999999, 3, 20, 20)}";
        let layout = Layout::parse(&start(1, dict)).unwrap();
        assert!(matches!(
            layout.check_length(1_000),
            Err(Problem::Truncated { .. })
        ));
        let dict = "{'descr': '<f8', 'fortran_order': False, 'shape': (18446744073709551615, 3, 20, 20)}";
        assert!(matches!(
            Layout::parse(&start(1, dict)),
            Err(Problem::Header { .. })
        ));
    }

    #[test]
    fn a_deeply_nested_header_is_refused() {
        let dict = "(".repeat(HEADER_MAX - 1);
        assert!(matches!(
            Layout::parse(&start(1, &dict)),
            Err(Problem::Header { .. })
        ));
        let dict = "(".repeat(60_000);
        assert!(matches!(
            Layout::parse(&start(1, &dict)),
            Err(Problem::Header { .. })
        ));
    }

    #[test]
    fn every_cut_of_a_header_is_reported_as_such() {
        let bytes = start(1, GOOD);
        for cut in 6..bytes.len() {
            match Layout::parse(&bytes[..cut]) {
                Err(Problem::HeaderTruncated { found, expected }) => assert!(found == cut && expected > cut),
                other => panic!("{cut}: {other:?}"),
            }
        }
    }

    proptest! {
        #[test]
        fn any_bytes_give_a_layout_or_a_problem_of_one_line(
            bytes in proptest::collection::vec(any::<u8>(), 0..200),
            version in 0u8..5,
        ) {
            let mut file = MAGIC.to_vec();
            file.push(version);
            file.extend(&bytes);
            for input in [&bytes, &file] {
                if let Err(problem) = Layout::parse(input) {
                    prop_assert_eq!(problem.to_string().lines().count(), 1);
                }
            }
        }

        #[test]
        fn a_damaged_header_gives_a_layout_or_a_problem_of_one_line(at in 6usize..70, byte in any::<u8>()) {
            let mut bytes = start(1, GOOD);
            bytes[at] = byte;
            match Layout::parse(&bytes) {
                Ok(layout) => prop_assert!(layout.rows <= SIDE && layout.columns <= SIDE),
                Err(problem) => prop_assert_eq!(problem.to_string().lines().count(), 1),
            }
        }
    }
}
