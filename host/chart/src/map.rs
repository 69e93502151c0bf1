//! A square grid of coloured cells.

use plotters::prelude::*;

use super::{Area, Colour, Drawn, FAINT, INK, NORMAL, SMALL, style};

/// Colours of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// White at 0 through orange to dark red at this value.
    Heat(f64),
    /// Blue at minus this value, white at 0, red at plus this value.
    Signed(f64),
}

impl Scale {
    /// The colour of a value; values beyond the ends take the end's colour.
    #[must_use]
    pub fn colour(self, value: f64) -> Colour {
        const WHITE: [f64; 3] = [255.0; 3];
        const MIDDLE: [f64; 3] = [253.0, 174.0, 97.0];
        let mix = |from: [f64; 3], to: [f64; 3], part: f64| {
            let part = part.clamp(0.0, 1.0);
            let [r, g, b] = std::array::from_fn(|c| (from[c] + (to[c] - from[c]) * part) as u8);
            RGBColor(r, g, b)
        };
        match self {
            // In two parts, so that steps show at both ends.
            Self::Heat(full) if value < 0.5 * full => mix(WHITE, MIDDLE, 2.0 * value / full),
            Self::Heat(full) => mix(MIDDLE, [128.0, 0.0, 38.0], 2.0 * value / full - 1.0),
            Self::Signed(full) if value < 0.0 => mix(WHITE, [33.0, 102.0, 172.0], -value / full),
            Self::Signed(full) => mix(WHITE, [178.0, 24.0, 43.0], value / full),
        }
    }

    const fn ends(self) -> [f64; 2] {
        match self {
            Self::Heat(full) => [0.0, full],
            Self::Signed(full) => [-full, full],
        }
    }
}

/// A square grid of coloured cells.
#[derive(Debug, Clone)]
pub struct Map {
    /// Above.
    pub title: String,
    /// Cells along a side.
    pub side: usize,
    /// Colours row by row, the uppermost row first.
    pub cells: Vec<Colour>,
    /// From the middle to the edge, mm, for axes; `None` draws none.
    pub half_mm: Option<f64>,
    /// A bar of this scale beside the map.
    pub bar: Option<Scale>,
    /// What colours mean, below the map.
    pub key: Vec<(&'static str, Colour)>,
    /// Start and displacement, in cells from the upper left corner, x to the right and y down.
    pub arrows: Vec<([f64; 2], [f64; 2])>,
}

impl Map {
    pub(crate) fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn<B> {
        const ABOVE: i32 = 28;
        const BELOW: i32 = 34;
        let (left, right) = if self.half_mm.is_some() || self.bar.is_some() {
            (34, 52)
        } else {
            (15, 15)
        };
        let (width, height) = area.dim_in_pixel();
        let pixels = (width as i32 - left - right)
            .min(height as i32 - ABOVE - BELOW)
            .max(1);
        area.draw(&Text::new(self.title.clone(), (left, 7), style(NORMAL, INK)))?;
        let edge = |cell: usize| (cell as i32 * pixels) / self.side as i32;
        for (row, cells) in self.cells.chunks(self.side).enumerate() {
            for (column, colour) in cells.iter().enumerate() {
                let corner = |column, row| (left + edge(column), ABOVE + edge(row));
                let corners = [corner(column, row), corner(column + 1, row + 1)];
                area.draw(&Rectangle::new(corners, colour.filled()))?;
            }
        }
        let per_cell = f64::from(pixels) / self.side as f64;
        for &([x, y], [dx, dy]) in &self.arrows {
            let place = |x: f64, y: f64| (left + (x * per_cell) as i32, ABOVE + (y * per_cell) as i32);
            let (foot, tip) = (place(x, y), place(x + dx, y + dy));
            area.draw(&PathElement::new([foot, tip], INK.stroke_width(1)))?;
            area.draw(&Circle::new(tip, 1, INK.filled()))?;
        }
        let frame = [(left - 1, ABOVE - 1), (left + pixels, ABOVE + pixels)];
        area.draw(&Rectangle::new(frame, FAINT.stroke_width(1)))?;
        let text = |text: String, x: i32, y: i32| area.draw(&Text::new(text, (x, y), style(SMALL, INK)));
        if let Some(half_mm) = self.half_mm {
            for part in [0.0, 0.5, 1.0] {
                let value = format!("{:.0}", (2.0 * part - 1.0) * half_mm);
                let along = (part * f64::from(pixels)) as i32;
                let half = 3 * value.len() as i32;
                text(value.clone(), left + along - half, ABOVE + pixels + 4)?;
                text(value, left - 8 - 2 * half, ABOVE + pixels - along - 7)?;
            }
            text("x, mm".to_owned(), left + pixels / 2 + 18, ABOVE + pixels + 16)?;
        }
        if let Some(scale) = self.bar {
            let [low, high] = scale.ends();
            for y in 0..pixels {
                let value = high + (low - high) * f64::from(y) / f64::from(pixels);
                let corners = [
                    (left + pixels + 6, ABOVE + y),
                    (left + pixels + 15, ABOVE + y + 1),
                ];
                area.draw(&Rectangle::new(corners, scale.colour(value).filled()))?;
            }
            for (value, y) in [(high, 0), (0.5 * (low + high), pixels / 2), (low, pixels)] {
                text(format!("{value:.0}"), left + pixels + 19, ABOVE + y - 7)?;
            }
        }
        for ((word, colour), x) in self.key.iter().zip((left..).step_by(60)) {
            let y = ABOVE + pixels + 20;
            area.draw(&Rectangle::new([(x, y), (x + 10, y + 10)], colour.filled()))?;
            text((*word).to_owned(), x + 14, y - 2)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_scale_have_the_colours_that_its_documentation_names() {
        assert_eq!(Scale::Heat(2.0).colour(0.0), RGBColor(255, 255, 255));
        assert_eq!(Scale::Heat(2.0).colour(5.0), RGBColor(128, 0, 38));
        assert_eq!(Scale::Signed(2.0).colour(-2.0), RGBColor(33, 102, 172));
        assert_eq!(Scale::Signed(2.0).colour(0.0), RGBColor(255, 255, 255));
    }
}
