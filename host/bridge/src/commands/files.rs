//! Picture and force-map files as bytes: grey and coloured PNG, NumPy.

use std::io;

use gripline_simulation::{ForceMap, Image};
use npyz::WriterBuilder;

use crate::error::Error;

/// A grey picture as PNG.
pub(crate) fn grey_png(image: &Image) -> Result<Vec<u8>, Error> {
    encode_png(
        &image.pixels,
        image.width,
        image.height,
        png::ColorType::Grayscale,
    )
}

/// 8-bit pixels as PNG.
pub(crate) fn encode_png(
    pixels: &[u8],
    width: usize,
    height: usize,
    colour: png::ColorType,
) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(pixels))?;
    Ok(bytes)
}

/// A grey picture from the bytes of one of our PNGs; `name` is for the message.
pub(crate) fn decode_grey(bytes: &[u8], name: &str) -> Result<Image, Error> {
    let damaged = |error: png::DecodingError| {
        Error::failed(format!(
            "{name}: found a damaged picture ({error}), expected a frame of this scene: delete it and run again"
        ))
    };
    let mut reader = png::Decoder::new(io::Cursor::new(bytes))
        .read_info()
        .map_err(damaged)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let mut image = Image::new(width, height);
    if reader.output_buffer_size() != Some(image.pixels.len()) {
        return Err(Error::failed(format!(
            "{name}: found a picture that is not grey of 8 bits, expected a frame of this scene: delete it and run \
             again"
        )));
    }
    reader.next_frame(&mut image.pixels).map_err(damaged)?;
    Ok(image)
}

/// (T, 3, 20, 20) float32 newtons in NumPy's format.
pub(crate) fn maps_npy<'a>(maps: impl ExactSizeIterator<Item = &'a ForceMap>) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let write = |bytes: &mut Vec<u8>| -> io::Result<()> {
        let mut writer = npyz::WriteOptions::<f32>::new()
            .default_dtype()
            .shape(&[maps.len() as u64, 3, 20, 20])
            .writer(bytes)
            .begin_nd()?;
        for map in maps {
            for axis in 0..3 {
                writer.extend(map.iter().map(|force| force[axis]))?;
            }
        }
        writer.finish()
    };
    write(&mut bytes)?;
    Ok(bytes)
}
