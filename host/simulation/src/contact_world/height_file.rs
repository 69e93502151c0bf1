//! Indenters from files: a grey PNG (8 or 16 bit) or a 2-D float array in NumPy's format. Bytes in, grid of
//! heights out; nothing here opens a file. Units: mm; heights are measured away from the gel. The first row
//! lies at the lowest y, so that an indenter's print in the camera's picture looks like its file.
//! Limits: 2 to 2048 samples along each side.

use std::io::Cursor;

use npyz::{DType, NpyFile, NpyHeader, Order, TypeChar};

use super::shapes::{GridShape, Interpolation};
use crate::error::SimulationError;

/// Most samples along one side: finer than any grid of the gel by ten.
const LARGEST_SIDE: usize = 2048;
/// Decimal digits of a NumPy header whose dimensions surely multiply to less than 2⁶⁴; npyz multiplies them
/// unchecked.
const DIGITS_MAX: usize = 19;
/// Bytes of a NumPy header at most; that of a plain array has 128.
const HEADER_MAX: usize = 1_024;

/// A file that is no height map: what it holds, what was expected, what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found {found}, expected {expected}: {advice}")]
pub struct HeightFileError {
    /// What the file holds.
    pub found: String,
    /// What it should hold.
    pub expected: &'static str,
    /// What to do.
    pub advice: &'static str,
}

const A_PNG: &str = "a grey PNG of 8 or 16 bits";
const AN_ARRAY: &str = "a NumPy array (rows, columns) of float32 or float64";
const A_SIZE: &str = "2 to 2048 rows and columns";

fn problem(found: impl Into<String>, expected: &'static str, advice: &'static str) -> HeightFileError {
    HeightFileError {
        found: found.into(),
        expected,
        advice,
    }
}

fn check_size(rows: u64, columns: u64) -> Result<[usize; 2], HeightFileError> {
    let fits = |side: u64| (2..=LARGEST_SIDE as u64).contains(&side);
    if fits(rows) && fits(columns) {
        Ok([rows as usize, columns as usize])
    } else {
        let found = format!("{rows} rows of {columns}");
        Err(problem(
            found,
            A_SIZE,
            "resample or crop it; 0.1 mm from sample to sample is fine enough",
        ))
    }
}

impl GridShape {
    /// Reads a grey PNG: height = level × `mm_per_level`, above 0 so that black touches first, below 0 so that
    /// white does; neighbours `mm_per_pixel` apart.
    ///
    /// # Errors
    /// Not a whole grey PNG of 8 or 16 bits, of a wrong size, or a scale that [`GridShape::new`] refuses.
    pub fn from_png(
        bytes: &[u8],
        mm_per_pixel: f64,
        mm_per_level: f64,
        interpolation: Interpolation,
    ) -> Result<Self, HeightFileError> {
        let damaged = |error: png::DecodingError| {
            let text = error.to_string();
            problem(format!("a damaged PNG ({text})"), A_PNG, "save it again")
        };
        if bytes.is_empty() {
            return Err(problem("an empty file", A_PNG, "save it again"));
        }
        if !bytes.starts_with(b"\x89PNG") {
            return Err(problem("other bytes than a PNG's", A_PNG, "convert it"));
        }
        let mut reader = png::Decoder::new(Cursor::new(bytes))
            .read_info()
            .map_err(damaged)?;
        let info = reader.info();
        let [_, columns] = check_size(info.height.into(), info.width.into())?;
        let (colour, depth) = (info.color_type, info.bit_depth);
        let wide = match (colour, depth) {
            (png::ColorType::Grayscale, png::BitDepth::Eight) => false,
            (png::ColorType::Grayscale, png::BitDepth::Sixteen) => true,
            _ => {
                let found = format!("{colour:?} of {} bits", depth as u8);
                return Err(problem(found, A_PNG, "convert it to grey without transparency"));
            }
        };
        // The size was checked: at most 8 MiB.
        let mut levels = vec![0; reader.output_buffer_size().unwrap_or_default()];
        reader.next_frame(&mut levels).map_err(damaged)?;
        let heights = if wide {
            levels
                .chunks_exact(2)
                .map(|level| f64::from(u16::from_be_bytes([level[0], level[1]])) * mm_per_level)
                .collect()
        } else {
            levels
                .iter()
                .map(|&level| f64::from(level) * mm_per_level)
                .collect()
        };
        Self::new(columns, mm_per_pixel, heights)
            .map(|grid| grid.interpolated(interpolation))
            .map_err(|error| refused(&error))
    }

    /// Reads a 2-D float array in NumPy's format: heights in mm, rows along +y, neighbours `mm_per_sample` apart.
    ///
    /// # Errors
    /// Not a whole 2-D array of float32 or float64, of a wrong size, a number that is not finite, or a pitch
    /// that [`GridShape::new`] refuses.
    pub fn from_npy(
        bytes: &[u8],
        mm_per_sample: f64,
        interpolation: Interpolation,
    ) -> Result<Self, HeightFileError> {
        const SAVE: &str = "save it with numpy.save(name, heights.astype(numpy.float32))";
        if bytes.is_empty() {
            return Err(problem("an empty file", AN_ARRAY, SAVE));
        }
        if !bytes.starts_with(b"\x93NUMPY") {
            return Err(problem("other bytes than a NumPy file's", AN_ARRAY, SAVE));
        }
        let start = &bytes[..bytes.len().min(HEADER_MAX)];
        let text = &start[..start.iter().position(|b| *b == b'\n').unwrap_or(start.len())];
        let shape_digits = text.iter().filter(|b| b.is_ascii_digit()).count();
        let header = (shape_digits <= DIGITS_MAX)
            .then(|| NpyHeader::from_reader(bytes).ok())
            .flatten()
            .ok_or_else(|| problem("a header that is not that of a plain array", AN_ARRAY, SAVE))?;
        let dtype = header.dtype();
        let wide = match &dtype {
            DType::Plain(kind) if kind.type_char() == TypeChar::Float && kind.size_field() == 8 => true,
            DType::Plain(kind) if kind.type_char() == TypeChar::Float && kind.size_field() == 4 => false,
            _ => return Err(problem(format!("dtype {}", dtype.descr()), AN_ARRAY, SAVE)),
        };
        let &[rows, columns] = header.shape() else {
            let found = format!("{} dimensions", header.shape().len());
            return Err(problem(found, AN_ARRAY, "save one plane of heights"));
        };
        let [rows, columns] = check_size(rows, columns)?;
        let by_columns = header.order() == Order::Fortran;
        let file = NpyFile::new(bytes).map_err(|_| problem("a header cut short", AN_ARRAY, SAVE))?;
        let numbers = if wide {
            file.into_vec::<f64>()
        } else {
            file.into_vec::<f32>()
                .map(|numbers| numbers.into_iter().map(f64::from).collect())
        };
        let numbers = numbers.map_err(|_| problem("fewer numbers than its shape says", AN_ARRAY, SAVE))?;
        let place = |row: usize, column: usize| {
            if by_columns {
                column * rows + row
            } else {
                row * columns + column
            }
        };
        let mut heights = Vec::with_capacity(rows * columns);
        for row in 0..rows {
            for column in 0..columns {
                let height = numbers[place(row, column)];
                if !height.is_finite() {
                    return Err(problem(
                        format!("{height} in row {row}, column {column}"),
                        "finite heights in mm",
                        "fill the holes (numpy.isfinite finds them)",
                    ));
                }
                heights.push(height);
            }
        }
        Self::new(columns, mm_per_sample, heights)
            .map(|grid| grid.interpolated(interpolation))
            .map_err(|error| refused(&error))
    }
}

fn refused(error: &SimulationError) -> HeightFileError {
    problem(error.to_string(), "a height map", "change the scale or the file")
}

#[cfg(test)]
mod tests {
    use super::super::shapes::{HeightMap, WALL_MM};
    use super::*;
    use Interpolation::{Bicubic, Bilinear};

    fn png_of(columns: u32, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let per_pixel = colour.samples() * depth as usize / 8;
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, columns, (data.len() / per_pixel) as u32 / columns);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    fn npy_of(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let mut header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn f64_bytes(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    #[test]
    fn levels_become_heights_and_rows_run_along_y() {
        let grey = png::ColorType::Grayscale;
        let small = png_of(3, grey, png::BitDepth::Eight, &[0, 10, 20, 30, 40, 250]);
        let grid = GridShape::from_png(&small, 2.0, 0.01, Bilinear).unwrap();
        for (at, height) in [
            ([-2.0, -1.0], 0.0),
            ([0.0, -1.0], 0.1),
            ([2.0, 1.0], 2.5),
            ([-1.0, 0.0], 0.2),
        ] {
            assert!((grid.height_mm(at) - height).abs() < 1e-12, "{at:?}");
        }
        assert!(grid.height_mm([0.0, 1.1]) >= WALL_MM);
        // Below 0 white touches first.
        let grid = GridShape::from_png(&small, 2.0, -0.01, Bilinear).unwrap();
        assert!(grid.height_mm([2.0, 1.0]) == 0.0 && (grid.height_mm([-2.0, -1.0]) - 2.5).abs() < 1e-12);
        let fine = png_of(2, grey, png::BitDepth::Sixteen, &[0, 0, 0, 1, 1, 0, 255, 255]);
        let grid = GridShape::from_png(&fine, 1.0, 1e-4, Bilinear).unwrap();
        assert!((grid.height_mm([-0.5, 0.5]) - 0.0256).abs() < 1e-12);
        assert!((grid.height_mm([0.5, 0.5]) - 6.5535).abs() < 1e-12);
    }

    #[test]
    fn arrays_of_either_width_order_and_endianness_give_the_same_indenter() {
        let heights = [0.0, 1.0, 2.0, 3.0, 4.0, 5.5];
        let by_columns = [0.0, 3.0, 1.0, 4.0, 2.0, 5.5];
        let single: Vec<u8> = heights.iter().flat_map(|v| (*v as f32).to_be_bytes()).collect();
        let files = [
            npy_of("<f8", "False", "(2, 3)", &f64_bytes(&heights)),
            npy_of(">f4", "False", "(2, 3)", &single),
            npy_of("<f8", "True", "(2, 3)", &f64_bytes(&by_columns)),
        ];
        let expected = GridShape::new(3, 0.5, heights.to_vec()).unwrap();
        for bytes in files {
            assert_eq!(GridShape::from_npy(&bytes, 0.5, Bilinear).unwrap(), expected);
        }
    }

    #[test]
    fn bicubic_keeps_the_samples_and_planes_and_comes_nearer_to_a_ball() {
        let ball = |x: f64, y: f64| 0.05 * (x * x + y * y);
        let (columns, pitch) = (21, 0.5);
        let at = |i: usize| pitch * (i as f64 - 10.0);
        let heights: Vec<f64> = (0..columns * columns)
            .map(|i| ball(at(i % columns), at(i / columns)))
            .collect();
        let linear = GridShape::new(columns, pitch, heights).unwrap();
        let cubic = linear.clone().interpolated(Bicubic);
        let mut worst = [0.0_f64; 2];
        for i in 0..80 {
            for j in 0..80 {
                let point = [0.1 * f64::from(i) - 4.0, 0.1 * f64::from(j) - 4.0];
                let exact = ball(point[0], point[1]);
                for (worst, grid) in worst.iter_mut().zip([&linear, &cubic]) {
                    *worst = worst.max((grid.height_mm(point) - exact).abs());
                }
            }
        }
        assert!(worst[0] > 5e-3 && worst[1] < 1e-12, "{worst:?}");
        let plane: Vec<f64> = (0..25)
            .map(|i| 0.3 * f64::from(i % 5) + 0.2 * f64::from(i / 5))
            .collect();
        let plane = GridShape::new(5, 1.0, plane).unwrap().interpolated(Bicubic);
        assert!((plane.height_mm([0.25, -0.6]) - (0.3 * 2.25 + 0.2 * 1.4)).abs() < 1e-12);
        // A step rings; what would lie under the lowest height is cut off.
        let step: Vec<f64> = (0..36).map(|i| f64::from(i % 6 / 3)).collect();
        let step = GridShape::new(6, 1.0, step).unwrap().interpolated(Bicubic);
        assert!(step.height_mm([-1.0, 0.0]) == 0.0 && step.height_mm([1.0, 0.0]) > 1.0);
    }

    #[test]
    fn files_that_are_no_height_map_say_what_was_found_and_expected() {
        let (rgb, grey) = (png::ColorType::Rgb, png::ColorType::Grayscale);
        let good = png_of(2, grey, png::BitDepth::Eight, &[0, 1, 2, 3]);
        let wide = png_of(2049, grey, png::BitDepth::Eight, &vec![0; 2 * 2049]);
        for (bytes, expected) in [
            (
                Vec::new(),
                "found an empty file, expected a grey PNG of 8 or 16 bits: save it again",
            ),
            (
                b"GIF89a".to_vec(),
                "found other bytes than a PNG's, expected a grey PNG of 8 or 16 bits: convert it",
            ),
            (
                png_of(2, rgb, png::BitDepth::Eight, &[0; 12]),
                "found Rgb of 8 bits, expected a grey PNG of 8 or 16 bits: convert it to grey without transparency",
            ),
            (
                wide,
                "found 2 rows of 2049, expected 2 to 2048 rows and columns: resample or crop it; 0.1 mm from \
                 sample to sample is fine enough",
            ),
        ] {
            let error = GridShape::from_png(&bytes, 0.1, 0.01, Bilinear).unwrap_err();
            assert_eq!(error.to_string(), expected);
        }
        let cut = GridShape::from_png(&good[..good.len() - 20], 0.1, 0.01, Bilinear).unwrap_err();
        assert!(cut.found.starts_with("a damaged PNG ("), "{cut}");
        let save = "expected a NumPy array (rows, columns) of float32 or float64: save it with \
                    numpy.save(name, heights.astype(numpy.float32))";
        let four = f64_bytes(&[0.0, 1.0, f64::NAN, 3.0]);
        for (bytes, expected) in [
            (Vec::new(), format!("found an empty file, {save}")),
            (b"PK\x03\x04".to_vec(), format!("found other bytes than a NumPy file's, {save}")),
            (npy_of("<i4", "False", "(2, 2)", &[0; 16]), format!("found dtype '<i4', {save}")),
            (
                npy_of("<f8", "False", "(1, 2, 2)", &four),
                "found 3 dimensions, expected a NumPy array (rows, columns) of float32 or float64: save one plane \
                 of heights"
                    .to_owned(),
            ),
            (
                npy_of("<f8", "False", "(2, 2)", &four),
                "found NaN in row 1, column 0, expected finite heights in mm: fill the holes (numpy.isfinite \
                 finds them)"
                    .to_owned(),
            ),
            (
                npy_of("<f8", "False", "(2, 2)", &four[..24]),
                format!("found fewer numbers than its shape says, {save}"),
            ),
            (
                npy_of("<f8", "False", "(0, 2)", &[]),
                "found 0 rows of 2, expected 2 to 2048 rows and columns: resample or crop it; 0.1 mm from sample \
                 to sample is fine enough"
                    .to_owned(),
            ),
            (
                npy_of("<f8", "False", "(99999999999, 99999999999)", &[]),
                format!("found a header that is not that of a plain array, {save}"),
            ),
        ] {
            assert_eq!(GridShape::from_npy(&bytes, 0.1, Bilinear).unwrap_err().to_string(), expected);
        }
    }
}
