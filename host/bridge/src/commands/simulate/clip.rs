//! clip.gif: the camera's picture beside the true force map. GIF, because every browser, mail program and office
//! program plays it without a codec; for machines there are the frames themselves. Pure except for the encoder's bytes.
//! Limits: at most 25 pictures a second, 128 greys.

use std::borrow::Cow;
use std::collections::HashMap;

use super::canvas::{Canvas, GROUND, Grey, LETTER, Rgb, TEXT, ramp};
use crate::error::Error;
use gripline_evaluation::play::FingerMoment;

/// Pictures a second at most: what players keep up with.
const RATE_HZ: f64 = 25.0;
const SIDE: usize = Grey::SIDE;
/// Room for a line of text above the pictures.
const HEAD: usize = LETTER + 6;
const GREYS: usize = 128;
const HEATS: usize = 120;

/// A clip under way.
pub(super) struct Clip {
    encoder: gif::Encoder<Vec<u8>>,
    palette: Vec<Rgb>,
    full: [f64; 2],
    delay_cs: u16,
}

impl std::fmt::Debug for Clip {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Clip")
            .field("delay_cs", &self.delay_cs)
            .finish_non_exhaustive()
    }
}

/// Every how many frames the clip takes one.
pub(super) fn stride(frames_per_second: f64) -> usize {
    (frames_per_second / RATE_HZ).ceil().max(1.0) as usize
}

impl Clip {
    /// A clip of a recording of this many frames a second; `full` are the forces of full colour and longest line.
    pub(super) fn new(frames_per_second: f64, full: [f64; 2]) -> Result<Self, Error> {
        let mut palette: Vec<Rgb> = (0..GREYS)
            .map(|grey| [(grey * 255 / (GREYS - 1)) as u8; 3])
            .collect();
        palette.extend((0..HEATS).map(|heat| ramp(heat as f64 / (HEATS - 1) as f64)));
        palette.extend([GROUND, TEXT, super::canvas::FREE]);
        palette.resize(256, GROUND);
        let width = (2 * SIDE) as u16;
        let mut encoder = gif::Encoder::new(Vec::new(), width, (SIDE + HEAD) as u16, &palette.concat())?;
        encoder.set_repeat(gif::Repeat::Infinite)?;
        let delay_cs = (100.0 * stride(frames_per_second) as f64 / frames_per_second)
            .round()
            .max(2.0) as u16;
        Ok(Self {
            encoder,
            palette,
            full,
            delay_cs,
        })
    }

    /// Adds a frame.
    pub(super) fn push(&mut self, caption: &str, picture: &Grey, finger: &FingerMoment) -> Result<(), Error> {
        let mut map = Canvas::new(2 * SIDE, SIDE + HEAD);
        map.text([4, 3], caption, TEXT);
        map.forces([SIDE, HEAD], SIDE, &finger.forces, self.full);
        // A map has few colours, so most are found at once.
        let mut known = HashMap::new();
        let mut indices: Vec<u8> = map
            .pixels
            .chunks_exact(3)
            .map(|pixel| {
                let colour = [pixel[0], pixel[1], pixel[2]];
                *known.entry(colour).or_insert_with(|| self.nearest(colour))
            })
            .collect();
        for (row, levels) in picture.levels.chunks_exact(SIDE).enumerate() {
            let start = (row + HEAD) * 2 * SIDE;
            for (index, level) in indices[start..start + SIDE].iter_mut().zip(levels) {
                *index = level / 2;
            }
        }
        let frame = gif::Frame {
            delay: self.delay_cs,
            width: (2 * SIDE) as u16,
            height: (SIDE + HEAD) as u16,
            buffer: Cow::Owned(indices),
            ..gif::Frame::default()
        };
        Ok(self.encoder.write_frame(&frame)?)
    }

    /// The file's bytes.
    pub(super) fn finish(self) -> Result<Vec<u8>, Error> {
        Ok(self.encoder.into_inner()?)
    }

    /// Place of the nearest colour of the palette; colours of the map stand in it or close by.
    fn nearest(&self, colour: Rgb) -> u8 {
        let distance = |other: &Rgb| -> u32 {
            colour
                .iter()
                .zip(other)
                .map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2))
                .sum()
        };
        let colours = self.palette.iter().enumerate();
        colours
            .min_by_key(|(_, other)| distance(other))
            .map_or(0, |(place, _)| place as u8)
    }
}
