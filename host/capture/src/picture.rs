//! Picture files: 8-bit grey PNG and JPEG, as the crop; PNG of any kind in colour. Touches the world.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use gripline_sensor::Capture;

use crate::colour;
use crate::error::{CaptureError, PictureError};
use crate::geometry::{Cropping, Size};
use crate::jpeg::JpegCrop;

/// Endings of picture files.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Whether the file's name is that of a picture.
pub(crate) fn is_picture(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// The pictures of a folder in the order of their names, or the one file; at least one.
///
/// # Errors
/// [`CaptureError`] that names the folder.
pub fn list(path: &Path) -> Result<Vec<PathBuf>, CaptureError> {
    let failed = |source| CaptureError::File {
        path: path.to_owned(),
        source,
        expected: "a picture or a folder of pictures (*.png, *.jpg) that can be read",
    };
    if !fs::metadata(path).map_err(failed)?.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(path).map_err(failed)? {
        let entry = entry.map_err(failed)?.path();
        if is_picture(&entry) {
            found.push(entry);
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(CaptureError::NoPictureFiles {
            path: path.to_owned(),
        });
    }
    Ok(found)
}

/// The 440×440 crop of a picture file of 640×480 or 440×440 pixels, or, as a `small` PNG, 88×88.
///
/// # Errors
/// [`CaptureError`] that names the file, what was found and what was expected.
pub fn crop(path: &Path, small: bool) -> Result<Vec<u8>, CaptureError> {
    let bytes = read(path)?;
    let mut crop = Vec::new();
    let decoded = if bytes.starts_with(&[0xff, 0xd8]) {
        JpegCrop::default().decode(&bytes, &mut crop)
    } else {
        decode_png(&bytes, small, &mut crop)
    };
    decoded.map(|()| crop).map_err(|source| of_file(path, source))
}

fn read(path: &Path) -> Result<Vec<u8>, CaptureError> {
    fs::read(path).map_err(|source| CaptureError::File {
        path: path.to_owned(),
        source,
        expected: "a picture that can be read",
    })
}

fn of_file(path: &Path, source: PictureError) -> CaptureError {
    CaptureError::Picture {
        picture: path.display().to_string(),
        source,
    }
}

/// The picture of a PNG file of any size and kind as the sensor's description says: its own size, and red, green, blue of the crop. A grey one
/// becomes three equal colours; transparency is dropped. `None` for another kind of file.
///
/// # Errors
/// [`CaptureError`] that names the file, what was found and what was expected.
pub(crate) fn colour_png(path: &Path, capture: &Capture) -> Result<Option<(Size, Vec<u8>)>, CaptureError> {
    let bytes = read(path)?;
    if !bytes.starts_with(b"\x89PNG") {
        return Ok(None);
    }
    let (size, rgb) = decode_colour_png(&bytes).map_err(|source| of_file(path, source))?;
    let mut crop = Vec::new();
    colour::scale(&rgb, size, capture, &mut crop);
    Ok(Some((size, crop)))
}

fn decode_colour_png(bytes: &[u8]) -> Result<(Size, Vec<u8>), PictureError> {
    let damaged = |error: png::DecodingError| PictureError {
        found: format!("no good PNG ({error})"),
        expected: "a whole one".to_owned(),
    };
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(damaged)?;
    let size = Size::new(reader.info().width as usize, reader.info().height as usize);
    let samples = reader.output_color_type().0.samples();
    let mut pixels = vec![0; samples * size.pixels()];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    let rgb = pixels
        .chunks_exact(samples)
        .flat_map(|pixel| match *pixel {
            [red, green, blue, ..] => [red, green, blue],
            _ => [pixel[0]; 3],
        })
        .collect();
    Ok((size, rgb))
}

fn decode_png(bytes: &[u8], small: bool, crop: &mut Vec<u8>) -> Result<(), PictureError> {
    let damaged = |error: png::DecodingError| PictureError {
        found: format!("no good PNG ({error})"),
        expected: "a grey PNG of 8 bits or a JPEG".to_owned(),
    };
    let mut reader = png::Decoder::new(Cursor::new(bytes))
        .read_info()
        .map_err(damaged)?;
    let info = reader.info();
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Eight) {
        return Err(PictureError {
            found: format!("{:?} of {} bits", info.color_type, info.bit_depth as u8),
            expected: "grey of 8 bits: convert it".to_owned(),
        });
    }
    let size = Size::new(info.width as usize, info.height as usize);
    let cropping = Cropping::of(size, small)?;
    let mut grey = vec![0; size.pixels()];
    reader.next_frame(&mut grey).map_err(damaged)?;
    cropping.apply(&grey, crop);
    Ok(())
}

#[cfg(test)]
mod tests {
    use gripline_sensor::Sensor;

    use super::*;

    fn png(colour: png::ColorType, depth: png::BitDepth, pixels: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 2, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == png::ColorType::Indexed {
            encoder.set_palette(&[1, 2, 3, 250, 0, 4]);
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(pixels).unwrap();
        writer.finish().unwrap();
        file
    }

    #[test]
    fn every_kind_of_png_becomes_three_colours_of_8_bits() {
        use png::BitDepth::{Eight, One, Sixteen};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        for (colour, depth, pixels, expected) in [
            (Grayscale, Eight, &[7, 200][..], [7, 7, 7, 200, 200, 200]),
            (Grayscale, One, &[0b0100_0000], [0, 0, 0, 255, 255, 255]),
            (GrayscaleAlpha, Eight, &[7, 0, 200, 9], [7, 7, 7, 200, 200, 200]),
            (Indexed, Eight, &[1, 0], [250, 0, 4, 1, 2, 3]),
            (Rgb, Eight, &[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]),
            (Rgba, Eight, &[1, 2, 3, 0, 4, 5, 6, 9], [1, 2, 3, 4, 5, 6]),
            (
                Rgb,
                Sixteen,
                &[1, 99, 2, 99, 3, 99, 4, 99, 5, 99, 6, 99],
                [1, 2, 3, 4, 5, 6],
            ),
        ] {
            let (size, rgb) = decode_colour_png(&png(colour, depth, pixels)).unwrap();
            assert_eq!(
                (size, &rgb[..]),
                (Size::new(2, 1), &expected[..]),
                "{colour:?} {depth:?}"
            );
        }
    }

    #[test]
    fn a_png_that_is_cut_is_refused_by_its_name_and_another_kind_of_file_left_to_others() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cut.png");
        let capture = Sensor::named(Path::new("gelsight-mini")).unwrap().capture;
        let whole = png(png::ColorType::Rgb, png::BitDepth::Eight, &[1, 2, 3, 4, 5, 6]);
        fs::write(&file, &whole[..whole.len() / 2]).unwrap();
        let refused = colour_png(&file, &capture).unwrap_err().to_string();
        assert!(
            refused.contains("cut.png") && refused.contains("no good PNG"),
            "{refused}"
        );
        fs::write(&file, [0xff, 0xd8, 0xff]).unwrap();
        assert!(colour_png(&file, &capture).unwrap().is_none());
    }
}
