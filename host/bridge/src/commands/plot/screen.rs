//! The terminal view as a figure: every cell of the screen, without a terminal. Pixels.
//! Blocks and Braille dots become rectangles, which join from cell to cell as they do on a terminal.

use gripline_chart::{Colour, Figure, Panel, Shape};
use ratatui::buffer::{Buffer, Cell};
use ratatui::style::Color;

/// Width and height of a cell.
const CELL: [i32; 2] = [10, 20];
/// Around the screen.
const MARGIN: i32 = 10;
/// Places of Braille dots 1 to 8: two columns of three from the top, then the fourth row.
const DOTS: [[i32; 2]; 8] = [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2], [0, 3], [1, 3]];
const WHITE: Colour = Colour(255, 255, 255);
const BLACK: Colour = Colour(0, 0, 0);

/// A screen as a figure.
pub(super) fn figure(cells: &Buffer) -> Figure {
    let columns = usize::from(cells.area.width);
    let [width, height] = [(cells.area.width, CELL[0]), (cells.area.height, CELL[1])]
        .map(|(count, side)| i32::from(count) * side + 2 * MARGIN);
    // The lower right corner is always background.
    let ground = cells.content.last().map_or(BLACK, |cell| rgb(cell.bg, BLACK));
    let mut shapes = vec![Shape::Box {
        at: [0, 0],
        size: [width, height],
        colour: ground,
    }];
    for (number, cell) in cells.content.iter().enumerate() {
        let at = [(number % columns, CELL[0]), (number / columns, CELL[1])]
            .map(|(place, side)| MARGIN + place as i32 * side);
        shapes.extend(cell_shapes(at, cell, ground));
    }
    Figure::single(width.unsigned_abs(), height.unsigned_abs(), Panel::Shapes(shapes))
}

fn cell_shapes([x, y]: [i32; 2], cell: &Cell, ground: Colour) -> Vec<Shape> {
    let [width, height] = CELL;
    let (ink, back) = (rgb(cell.fg, WHITE), rgb(cell.bg, ground));
    let fill = |left: i32, top: i32, width: i32, height: i32, colour: Colour| Shape::Box {
        at: [x + left, y + top],
        size: [width, height],
        colour,
    };
    let mut shapes = Vec::new();
    if back != ground {
        shapes.push(fill(0, 0, width, height, back));
    }
    match cell.symbol().chars().next().unwrap_or(' ') {
        ' ' => {}
        '█' => shapes.push(fill(0, 0, width, height, ink)),
        '▀' => shapes.push(fill(0, 0, width, height / 2, ink)),
        '▄' => shapes.push(fill(0, height / 2, width, height / 2, ink)),
        '─' => shapes.push(fill(0, height / 2 - 1, width, 1, ink)),
        '━' => shapes.push(fill(0, height / 2 - 2, width, 3, ink)),
        dots @ '\u{2800}'..='\u{28ff}' => {
            // The low byte says which dots are set.
            let set = DOTS.into_iter().enumerate();
            let set = set.filter(|(bit, _)| (dots as u32) >> bit & 1 == 1);
            shapes.extend(set.map(|(_, [column, row])| fill(1 + 5 * column, 1 + 5 * row, 3, 3, ink)));
        }
        letter => shapes.push(Shape::Letter {
            centre: [x + width / 2, y + height / 2],
            letter,
            colour: ink,
        }),
    }
    shapes
}

/// The view draws in true colour only.
const fn rgb(colour: Color, otherwise: Colour) -> Colour {
    match colour {
        Color::Rgb(red, green, blue) => Colour(red, green, blue),
        _ => otherwise,
    }
}

#[cfg(test)]
mod tests {
    use gripline_chart::Format;
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;

    /// Pixels with more than `level` of red in cell `cell` of a line of red text.
    fn red_pixels(text: &str, cell: usize, level: u8) -> usize {
        let mut cells = Buffer::empty(Rect::new(0, 0, text.chars().count() as u16, 1));
        let style = Style::new().fg(Color::Rgb(255, 0, 0)).bg(Color::Rgb(0, 0, 9));
        cells.set_string(0, 0, text, style);
        let png = figure(&cells).encode(Format::Png).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let width = reader.next_frame(&mut bytes).unwrap().width as usize;
        let [wide, high] = CELL.map(|side| side as usize);
        let margin = MARGIN as usize;
        let left = margin + cell * wide;
        (margin..margin + high)
            .flat_map(|row| (left..left + wide).map(move |column| 3 * (row * width + column)))
            .filter(|&at| bytes[at] > level)
            .count()
    }

    #[test]
    fn blocks_fill_their_cells_and_braille_has_as_many_dots_as_bits() {
        for (cell, pixels) in [200, 100, 100, 0].into_iter().enumerate() {
            assert_eq!(red_pixels("█▀▄ ", cell, 254), pixels);
        }
        for (sign, dots) in [('⠁', 1), ('⣿', 8), ('⢸', 4), ('⠒', 2)] {
            assert_eq!(red_pixels(&sign.to_string(), 0, 254), 9 * dots, "{sign}");
        }
    }

    #[test]
    fn letters_and_arrows_are_there_and_stay_in_their_cells() {
        for sign in ['A', 'g', 'µ', '↗', '→', '◆', '●', '–', '·'] {
            let text = format!(" {sign} ");
            assert!(red_pixels(&text, 1, 60) > 3, "{sign}");
            assert_eq!(red_pixels(&text, 0, 254) + red_pixels(&text, 2, 254), 0, "{sign}");
        }
    }
}
