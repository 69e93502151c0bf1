//! Picture files: 8-bit grey PNG and JPEG, as the crop. Touches the world.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

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
    let bytes = fs::read(path).map_err(|source| CaptureError::File {
        path: path.to_owned(),
        source,
        expected: "a picture that can be read",
    })?;
    let mut crop = Vec::new();
    let decoded = if bytes.starts_with(&[0xff, 0xd8]) {
        JpegCrop::default().decode(&bytes, &mut crop)
    } else {
        decode_png(&bytes, small, &mut crop)
    };
    decoded.map(|()| crop).map_err(|source| CaptureError::Picture {
        picture: path.display().to_string(),
        source,
    })
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
