//! The terminal view as a picture: every cell of the screen drawn, without a terminal. Pixels.
//! Blocks and Braille dots are drawn as rectangles, which join from cell to cell as they do on a terminal; everything else
//! is a letter of the built-in font.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use ratatui::buffer::{Buffer, Cell};
use ratatui::style::Color as CellColor;

type Error<B> = DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>;

const FONT: &str = "gripline-terminal";
/// Width and height of a cell.
const CELL: [i32; 2] = [10, 20];
const LETTER: i32 = 16;
/// Around the screen.
const MARGIN: i32 = 10;
/// A dot of Braille.
const DOT: i32 = 3;
/// The first of Braille's 256 signs; its bits say which dots are set.
const BRAILLE: u32 = 0x2800;

/// The same letters on every machine, without a font library.
///
/// # Errors
/// When the font that comes with the program cannot be read.
pub(super) fn register_font() -> Result<(), &'static str> {
    plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::HACK_REGULAR)
        .map_err(|_| "the built-in font cannot be read")
}

/// Width and height of a screen's picture.
pub(super) fn size(cells: &Buffer) -> (u32, u32) {
    let side = |count: u16, of: i32| (i32::from(count) * of + 2 * MARGIN).unsigned_abs();
    (side(cells.area.width, CELL[0]), side(cells.area.height, CELL[1]))
}

/// Draws a screen.
///
/// # Errors
/// The backend's.
pub(super) fn draw<B: DrawingBackend>(root: &DrawingArea<B, Shift>, cells: &Buffer) -> Result<(), Error<B>> {
    // The lower right corner is always ground.
    let ground = cells.content.last().map_or(BLACK, |cell| colour(cell.bg, BLACK));
    root.fill(&ground)?;
    for (place, cell) in cells.content.iter().enumerate() {
        let column = place % usize::from(cells.area.width);
        let row = place / usize::from(cells.area.width);
        let at = [(column, CELL[0]), (row, CELL[1])].map(|(place, of)| MARGIN + place as i32 * of);
        draw_cell(root, at, cell, ground)?;
    }
    root.present()
}

fn draw_cell<B: DrawingBackend>(
    root: &DrawingArea<B, Shift>,
    [x, y]: [i32; 2],
    cell: &Cell,
    ground: RGBColor,
) -> Result<(), Error<B>> {
    let [wide, high] = CELL;
    let (ink, back) = (colour(cell.fg, WHITE), colour(cell.bg, ground));
    // The second corner is the first pixel outside.
    let fill = |left: i32, top: i32, width: i32, height: i32, with: RGBColor| {
        let corners = [(x + left, y + top), (x + left + width, y + top + height)];
        root.draw(&Rectangle::new(corners, with.filled()))
    };
    if back != ground {
        fill(0, 0, wide, high, back)?;
    }
    let Some(sign) = cell.symbol().chars().next().filter(|sign| *sign != ' ') else {
        return Ok(());
    };
    match sign {
        '█' => fill(0, 0, wide, high, ink),
        '▀' => fill(0, 0, wide, high / 2, ink),
        '▄' => fill(0, high / 2, wide, high / 2, ink),
        '─' => fill(0, high / 2 - 1, wide, 1, ink),
        '━' => fill(0, high / 2 - 2, wide, 3, ink),
        '\u{2800}'..='\u{28ff}' => {
            // Dots 1 to 8: two columns of three from the top, then the fourth row.
            const PLACES: [[i32; 2]; 8] = [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2], [0, 3], [1, 3]];
            for (bit, [column, row]) in PLACES.into_iter().enumerate() {
                if (sign as u32 - BRAILLE) >> bit & 1 == 1 {
                    fill(1 + 5 * column, 1 + 5 * row, DOT, DOT, ink)?;
                }
            }
            Ok(())
        }
        _ => {
            let style = (FONT, LETTER)
                .into_font()
                .color(&ink)
                .pos(Pos::new(HPos::Center, VPos::Center));
            root.draw(&Text::new(sign.to_string(), (x + wide / 2, y + high / 2), style))
        }
    }
}

/// The view draws in true colour only.
fn colour(colour: CellColor, otherwise: RGBColor) -> RGBColor {
    match colour {
        CellColor::Rgb(red, green, blue) => RGBColor(red, green, blue),
        _ => otherwise,
    }
}

#[cfg(test)]
mod tests {
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;

    /// A screen of one line as RGB pixels, with its width.
    fn pixels(text: &str) -> (Vec<u8>, usize) {
        let mut cells = Buffer::empty(Rect::new(0, 0, text.chars().count() as u16, 1));
        let style = Style::new()
            .fg(CellColor::Rgb(255, 0, 0))
            .bg(CellColor::Rgb(0, 0, 9));
        cells.set_string(0, 0, text, style);
        register_font().unwrap();
        let (width, height) = size(&cells);
        let mut bytes = vec![0; 3 * (width * height) as usize];
        {
            let root = BitMapBackend::with_buffer(&mut bytes, (width, height)).into_drawing_area();
            draw(&root, &cells).unwrap();
        }
        (bytes, width as usize)
    }

    /// Red pixels of a cell.
    fn inked(text: &str, cell: usize) -> usize {
        let (bytes, width) = pixels(text);
        let [wide, high] = CELL.map(|side| side as usize);
        let margin = MARGIN as usize;
        (margin..margin + high)
            .flat_map(|row| {
                (margin + cell * wide..margin + (cell + 1) * wide)
                    .map(move |column| 3 * (row * width + column))
            })
            .filter(|&at| bytes[at..at + 3] == [255, 0, 0])
            .count()
    }

    #[test]
    fn blocks_fill_their_cells_and_braille_has_as_many_dots_as_bits() {
        assert_eq!(inked("█▀▄ ", 0), 200);
        assert_eq!(inked("█▀▄ ", 1), 100);
        assert_eq!(inked("█▀▄ ", 2), 100);
        assert_eq!(inked("█▀▄ ", 3), 0);
        for (sign, dots) in [('⠁', 1), ('⣿', 8), ('⢸', 4), ('⠒', 2)] {
            assert_eq!(inked(&sign.to_string(), 0), 9 * dots, "{sign}");
        }
    }

    #[test]
    fn letters_and_arrows_are_there_and_stay_in_their_cells() {
        for sign in ['A', 'g', 'µ', '↗', '→', '◆', '●', '–', '·'] {
            let (bytes, _) = pixels(&format!(" {sign} "));
            let red: usize = bytes.chunks_exact(3).filter(|pixel| pixel[0] > 60).count();
            assert!(red > 3, "{sign} draws {red} pixels");
            assert_eq!(
                inked(&format!(" {sign} "), 0) + inked(&format!(" {sign} "), 2),
                0,
                "{sign}"
            );
        }
    }
}
