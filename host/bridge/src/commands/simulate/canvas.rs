//! An RGB picture to draw grey images, force maps, contact states and text on.

use gripline_chart::{Colour, draw_text};
use gripline_simulation::contact_world::CellState;
use gripline_simulation::{ForceMap, Image};

pub(super) type Rgb = [u8; 3];

pub(super) const GROUND: Rgb = [12, 14, 18];
pub(super) const TEXT: Rgb = [215, 220, 228];
/// A taxel or cell that nothing touches.
pub(super) const FREE: Rgb = [30, 34, 42];
pub(super) const STICK: Rgb = [70, 140, 255];
pub(super) const SLIP: Rgb = [255, 140, 40];
const ARROW: Rgb = [255, 255, 245];
/// Normal force, dark to bright.
const RAMP: [Rgb; 4] = [[24, 34, 58], [24, 98, 148], [64, 178, 150], [246, 228, 104]];
/// Width of a letter, pixels.
pub(super) const LETTER: usize = 8;
/// Taxels along one side.
const SIDE: usize = 20;

/// A picture under way.
#[derive(Debug, Clone)]
pub(super) struct Canvas {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Red, green, blue, row by row.
    pub(super) pixels: Vec<u8>,
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: GROUND.repeat(width * height),
        }
    }

    /// Sets a pixel; outside nothing happens.
    pub(super) fn put(&mut self, x: usize, y: usize, colour: Rgb) {
        if x < self.width && y < self.height {
            let at = 3 * (y * self.width + x);
            self.pixels[at..at + 3].copy_from_slice(&colour);
        }
    }

    pub(super) fn fill(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], colour: Rgb) {
        for row in y..y + height {
            for column in x..x + width {
                self.put(column, row, colour);
            }
        }
    }

    /// One line of text from its upper left corner.
    pub(super) fn text(&mut self, [x, y]: [usize; 2], text: &str, [red, green, blue]: Rgb) {
        let size = (self.width as u32, self.height as u32);
        // The font has room above its letters.
        let at = (x as i32, y as i32 - 3);
        draw_text(&mut self.pixels, size, at, text, Colour(red, green, blue));
    }

    /// A grey picture, its pixels passed through `shade`.
    pub(super) fn grey(&mut self, [x, y]: [usize; 2], picture: &Grey, shade: impl Fn(usize) -> u8) {
        for row in 0..picture.side {
            for column in 0..picture.side {
                self.put(x + column, y + row, [shade(row * picture.side + column); 3]);
            }
        }
    }

    /// A force map: colour for the normal force up to `full_n`, arrows for the shear, a taxel long at `full_shear_n`.
    pub(super) fn forces(
        &mut self,
        [x, y]: [usize; 2],
        side: usize,
        forces: &ForceMap,
        [full_n, full_shear_n]: [f64; 2],
    ) {
        let taxel = side / SIDE;
        for (place, force) in forces.iter().enumerate() {
            let corner = [x + place % SIDE * taxel, y + place / SIDE * taxel];
            let normal = f64::from(force[2]);
            let colour = if normal > 0.0 { ramp(normal / full_n) } else { FREE };
            self.fill(corner, [taxel - 1, taxel - 1], colour);
        }
        for (place, [fx, fy, _]) in forces.iter().enumerate() {
            let middle = [
                x + place % SIDE * taxel + taxel / 2,
                y + place / SIDE * taxel + taxel / 2,
            ];
            let length = 1.5 * taxel as f64 / full_shear_n;
            let tip = [f64::from(*fx) * length, f64::from(*fy) * length];
            if tip[0].hypot(tip[1]) >= 1.5 {
                self.line(middle, tip, ARROW);
            }
        }
    }

    /// What the cells of the skin do; rows of `states` fill a square of `side`.
    pub(super) fn states(&mut self, [x, y]: [usize; 2], side: usize, states: &[CellState]) {
        let cells = states.len().isqrt();
        if cells == 0 {
            return;
        }
        for row in 0..side {
            for column in 0..side {
                let state = states[row * cells / side * cells + column * cells / side];
                let colour = match state {
                    CellState::Free => FREE,
                    CellState::Stick => STICK,
                    CellState::Slip => SLIP,
                };
                self.put(x + column, y + row, colour);
            }
        }
    }

    fn line(&mut self, [x, y]: [usize; 2], by: [f64; 2], colour: Rgb) {
        let steps = by[0].abs().max(by[1].abs()).ceil().max(1.0) as usize;
        for step in 0..=steps {
            let part = step as f64 / steps as f64;
            let at = |from: usize, by: f64| (from as f64 + by * part).round().max(0.0) as usize;
            self.put(at(x, by[0]), at(y, by[1]), colour);
        }
        // The foot, so that the direction can be seen.
        self.fill([x, y], [2, 2], colour);
    }
}

/// The colour at `level` of the ramp, 0 to 1, clamped.
pub(super) fn ramp(level: f64) -> Rgb {
    let place = level.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
    let below = (place as usize).min(RAMP.len() - 2);
    let part = place - below as f64;
    std::array::from_fn(|channel| {
        let [a, b] = [RAMP[below], RAMP[below + 1]].map(|colour| f64::from(colour[channel]));
        (a + (b - a) * part).round() as u8
    })
}

/// The middle 440×440 of a picture at half size: means of 2×2 pixels.
#[derive(Debug, Clone)]
pub(super) struct Grey {
    pub(super) side: usize,
    pub(super) levels: Vec<u8>,
}

impl Grey {
    /// Pixels along one side.
    pub(super) const SIDE: usize = 220;

    /// Of a 440×440 crop or a larger frame.
    pub(super) fn of(image: &Image) -> Self {
        let side = Self::SIDE;
        let [left, top] = [image.width, image.height].map(|all| all.saturating_sub(2 * side) / 2);
        let at = |x: usize, y: usize| u32::from(image.pixels[(top + y) * image.width + left + x]);
        let levels = (0..side * side)
            .map(|place| {
                let [x, y] = [2 * (place % side), 2 * (place / side)];
                ((at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4) as u8
            })
            .collect();
        Self { side, levels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_stand_where_they_are_put_and_nothing_is_drawn_outside() {
        let mut canvas = Canvas::new(20, 10);
        canvas.text([4, 1], "Iµ", [255; 3]);
        let is_lit = |x: usize| (0..10).any(|y| canvas.pixels[3 * (y * 20 + x)] > 128);
        assert!((4..12).any(is_lit) && (12..20).any(is_lit));
        assert!(!(0..4).any(is_lit));
        let before = canvas.pixels.clone();
        canvas.text([200, 100], "out", [255; 3]);
        canvas.put(20, 0, [255; 3]);
        assert_eq!(canvas.pixels, before);
    }

    #[test]
    fn half_size_is_the_middle_of_a_frame_and_the_mean_of_four_pixels() {
        let mut frame = Image::new(640, 480);
        for (offset, level) in [(0, 10), (1, 20), (640, 30), (641, 41)] {
            frame.pixels[20 * 640 + 100 + offset] = level;
        }
        let grey = Grey::of(&frame);
        assert_eq!(
            (grey.levels.len(), grey.levels[0], grey.levels[1]),
            (220 * 220, 25, 0)
        );
    }

    #[test]
    fn a_map_is_brightest_where_it_presses_most_and_its_arrow_points_with_the_shear() {
        let mut canvas = Canvas::new(220, 220);
        let mut forces = [[0.0; 3]; 400];
        forces[20 * 10 + 10] = [0.1, 0.0, 0.2];
        canvas.forces([0, 0], 220, &forces, [0.2, 0.1]);
        let at = |x: usize, y: usize| {
            let place = 3 * (y * 220 + x);
            [
                canvas.pixels[place],
                canvas.pixels[place + 1],
                canvas.pixels[place + 2],
            ]
        };
        assert_eq!(at(111, 111), ramp(1.0));
        assert_eq!(at(1, 1), FREE);
        assert!(at(125, 115) == ARROW && at(108, 115) != ARROW);
    }
}
