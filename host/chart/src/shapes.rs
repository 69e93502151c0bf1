//! Plain shapes, and text on another's pixels.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Area, Colour, Drawn, MONO, register_fonts};

/// A plain shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A filled rectangle.
    Box {
        /// Upper left corner.
        at: [i32; 2],
        /// Width and height.
        size: [i32; 2],
        /// Its colour.
        colour: Colour,
    },
    /// A letter of the monospaced font, 16 px high.
    Letter {
        /// Its middle.
        centre: [i32; 2],
        /// Which one.
        letter: char,
        /// Its colour.
        colour: Colour,
    },
}

impl Shape {
    pub(crate) fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn<B> {
        match *self {
            Self::Box {
                at: [x, y],
                size: [width, height],
                colour,
            } => area.draw(&Rectangle::new(
                [(x, y), (x + width, y + height)],
                colour.filled(),
            )),
            Self::Letter {
                centre: [x, y],
                letter,
                colour,
            } => {
                let centred = Pos::new(HPos::Center, VPos::Center);
                let style = (MONO, 16).into_font().color(&colour).pos(centred);
                area.draw(&Text::new(letter.to_string(), (x, y), style))
            }
        }
    }
}

/// Draws a line of monospaced text, 8 px a letter, onto RGB pixels of this width and height; `at` is its upper left corner.
/// What lies outside is cut off.
pub fn draw_text(pixels: &mut [u8], (width, height): (u32, u32), at: (i32, i32), text: &str, colour: Colour) {
    register_fonts();
    let style = (MONO, 13).into_font().color(&colour);
    let area = BitMapBackend::with_buffer(pixels, (width, height)).into_drawing_area();
    // Drawing into memory cannot fail.
    let _ = area.draw(&Text::new(text.to_owned(), at, style));
}
