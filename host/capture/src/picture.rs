//! Picture files as the camera's crop: PNG (8-bit grey) and JPEG, 640×480 (the middle is taken), 440×440, or 88×88 where
//! the network looks at nothing else. Touches the world.

use std::fs::{self, File};
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

use crate::constants::{CROP_LEFT, CROP_SIDE, CROP_TOP, IMAGE_SIDE};

use super::avi::{ClipReader, Next};
use super::jpeg::JpegCrop;
use gripline_recording::error::Failure;

/// Endings of pictures that can be read.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Whether the file's name is that of a picture.
fn is_picture(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// The pictures of a folder in the order of their names, or the one file; at least one.
///
/// # Errors
/// [`Failure`] that names the folder.
pub fn listed(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error: std::io::Error| {
        Failure::failed(format!(
            "{}: {error}, expected a picture or a folder of pictures (*.png, *.jpg) that can be read; check the path",
            path.display()
        ))
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
        return Err(Failure::failed(format!(
            "{}: found no *.png and no *.jpg, expected a folder of pictures",
            path.display()
        )));
    }
    Ok(found)
}

/// A clip (.avi), up to its first picture.
///
/// # Errors
/// [`Failure`] that names the file, what was found and what was expected.
pub(super) fn open_clip(path: &Path) -> Result<ClipReader<BufReader<File>>, Failure> {
    let failed = |wrong: String| Failure::failed(format!("{}: {wrong}", path.display()));
    let file = File::open(path)
        .map_err(|error| failed(format!("{error}, expected a clip (.avi); check the path")))?;
    ClipReader::new(BufReader::new(file)).map_err(failed)
}

/// The pictures of a folder, a file or a clip, one after the other.
#[derive(Debug)]
pub struct Pictures {
    path: PathBuf,
    of: Of,
    /// Whether they may be 88×88.
    small: bool,
    number: usize,
    cut: Option<String>,
}

#[derive(Debug)]
enum Of {
    Files(std::vec::IntoIter<PathBuf>),
    Clip(ClipReader<BufReader<File>>, Box<JpegCrop>),
}

impl Pictures {
    /// Opens them; at least one file, or a clip.
    ///
    /// # Errors
    /// [`Failure`] that names what cannot be read.
    pub fn open(path: &Path, small: bool) -> Result<Self, Failure> {
        let is_clip = path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("avi"));
        let of = if is_clip && !path.is_dir() {
            Of::Clip(open_clip(path)?, Box::default())
        } else {
            Of::Files(listed(path)?.into_iter())
        };
        Ok(Self {
            path: path.to_owned(),
            of,
            small,
            number: 0,
            cut: None,
        })
    }

    /// Name and 440×440 crop of the next one.
    ///
    /// # Errors
    /// [`Failure`] that names the picture which is none.
    pub fn next(&mut self) -> Result<Option<(String, Vec<u8>)>, Failure> {
        match &mut self.of {
            Of::Files(files) => files
                .next()
                .map(|file| Ok((file.display().to_string(), crop(&file, self.small)?)))
                .transpose(),
            Of::Clip(reader, jpeg) => match reader.next() {
                Next::Picture(file) => {
                    let name = format!("{}: picture {}", self.path.display(), self.number);
                    self.number += 1;
                    let mut crop = Vec::new();
                    jpeg.decode(&file, &mut crop)
                        .map_err(|wrong| Failure::failed(format!("{name}: {wrong}")))?;
                    Ok(Some((name, crop)))
                }
                Next::End => Ok(None),
                Next::Cut(why) => {
                    self.cut = Some(why);
                    Ok(None)
                }
            },
        }
    }

    /// Why there are fewer than there should be.
    pub fn cut(&self) -> Option<&str> {
        self.cut.as_deref()
    }
}

/// A picture's 440×440 crop. A small one, if it may be, is enlarged: its block means are itself again.
///
/// # Errors
/// [`Failure`] that names the file, what it is and what was expected.
pub fn crop(path: &Path, small: bool) -> Result<Vec<u8>, Failure> {
    let bytes = fs::read(path).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    crop_of(&bytes, small).map_err(|wrong| Failure::failed(format!("{}: {wrong}", path.display())))
}

fn crop_of(bytes: &[u8], small: bool) -> Result<Vec<u8>, String> {
    if bytes.starts_with(&[0xff, 0xd8]) {
        let mut crop = Vec::new();
        return JpegCrop::default().decode(bytes, &mut crop).map(|()| crop);
    }
    let damaged = |error: png::DecodingError| {
        format!("found no good PNG ({error}), expected a grey PNG of 8 bits or a JPEG")
    };
    let mut reader = png::Decoder::new(Cursor::new(bytes))
        .read_info()
        .map_err(damaged)?;
    let info = reader.info();
    let (colour, depth) = (info.color_type, info.bit_depth);
    let size = [info.width as usize, info.height as usize];
    if (colour, depth) != (png::ColorType::Grayscale, png::BitDepth::Eight) {
        return Err(format!(
            "found {colour:?} of {} bits, expected grey of 8 bits: convert it",
            depth as u8
        ));
    }
    let [width, height] = size;
    let sizes: &[[usize; 2]] = if small {
        &[[640, 480], [CROP_SIDE; 2], [IMAGE_SIDE; 2]]
    } else {
        &[[640, 480], [CROP_SIDE; 2]]
    };
    if !sizes.contains(&size) {
        let expected: Vec<String> = sizes.iter().map(|[w, h]| format!("{w}×{h}")).collect();
        return Err(format!(
            "found {width}×{height} pixels, expected {}",
            expected.join(" or ")
        ));
    }
    let mut pixels = vec![0; width * height];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    Ok(match width {
        640 => pixels
            .chunks_exact(640)
            .skip(CROP_TOP)
            .take(CROP_SIDE)
            .flat_map(|row| &row[CROP_LEFT..CROP_LEFT + CROP_SIDE])
            .copied()
            .collect(),
        CROP_SIDE => pixels,
        _ => (0..CROP_SIDE * CROP_SIDE)
            .map(|i| pixels[i / CROP_SIDE / 5 * IMAGE_SIDE + i % CROP_SIDE / 5])
            .collect(),
    })
}
