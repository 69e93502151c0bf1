//! A simple picture of a unit, to try tracker and forces together: dark or bright dots on a coloured ground, an imprint that
//! shades it by the surface's slope, noise. Rows run from the top, where y is greatest. Not for training: that has the markers'
//! places themselves, with the tracker's measured noise.

use gripline_sensor::{Polarity, Sensor};

use super::unit::{PrintedUnit, normal};
use crate::field::DisplacementField;
use crate::random::Random;

/// Width of a dot's edge, pixels: as a lens blurs it.
const EDGE_PX: f64 = 1.5;
/// Share of the light that a dot takes (or adds).
const INK: f64 = 0.75;
/// Grey levels per slope of the surface, each colour from its own side.
const SHADE: f64 = 220.0;
/// Sigma of the noise of the picture that the makers' software hands over, grey levels.
const NOISE_LEVELS: f64 = 1.0;
/// Pixels from node to node of the shading.
const STEP: usize = 8;

/// Draws one unit.
#[derive(Debug)]
pub struct PrintedPicture {
    size_px: [usize; 2],
    is_dark: bool,
}

impl PrintedPicture {
    /// For pictures of a sensor's crop.
    #[must_use]
    pub fn new(sensor: &Sensor) -> Self {
        let [.., width, height] = sensor.capture.crop_px;
        Self {
            size_px: [width, height],
            is_dark: sensor.markers.polarity == Polarity::Dark,
        }
    }

    /// Red, green and blue of every pixel under a contact, or untouched.
    #[must_use]
    pub fn draw(
        &self,
        unit: &PrintedUnit,
        field: Option<&DisplacementField>,
        random: &mut Random,
    ) -> Vec<u8> {
        let [width, height] = self.size_px;
        let px_per_mm = unit.px_per_mm();
        let to_px = |[x, y]: [f64; 2]| {
            [
                0.5 * width as f64 + x * px_per_mm,
                0.5 * height as f64 - y * px_per_mm,
            ]
        };
        let by_mm = |at: [f64; 2]| field.map_or([0.0; 3], |field| unit.gel().displacement_mm(field, at));
        let dots: Vec<[f64; 2]> = unit
            .printed_mm()
            .iter()
            .map(|at| to_px(unit.seen_mm(*at, by_mm(*at))))
            .collect();
        let radius = 0.5 * unit.diameter_mm() * px_per_mm * unit.scale();
        let mut ink = vec![0.0_f64; width * height];
        for [u, v] in dots {
            let reach = radius + EDGE_PX;
            let span = |at: f64, of: usize| {
                (at - reach).max(0.0) as usize..((at + reach).ceil().max(0.0) as usize).min(of)
            };
            for row in span(v, height) {
                for column in span(u, width) {
                    let away = libm::hypot(column as f64 + 0.5 - u, row as f64 + 0.5 - v);
                    let cover = (0.5 + (radius - away) / EDGE_PX).clamp(0.0, 1.0);
                    let pixel = &mut ink[row * width + column];
                    *pixel = pixel.max(cover);
                }
            }
        }
        let (columns, rows) = (width / STEP + 2, height / STEP + 2);
        let mut slopes = vec![[0.0_f64; 2]; columns * rows];
        if field.is_some() {
            for (node, slope) in slopes.iter_mut().enumerate() {
                let at = [node % columns, node / columns].map(|at| (at * STEP) as f64);
                let mm = [
                    (at[0] - 0.5 * width as f64) / px_per_mm,
                    (0.5 * height as f64 - at[1]) / px_per_mm,
                ];
                let step = 0.2;
                let down = |x: f64, y: f64| by_mm([mm[0] + x, mm[1] + y])[2];
                *slope = [
                    (down(step, 0.0) - down(-step, 0.0)) / (2.0 * step),
                    (down(0.0, step) - down(0.0, -step)) / (2.0 * step),
                ];
            }
        }
        let mut rgb = Vec::with_capacity(width * height * 3);
        for row in 0..height {
            for column in 0..width {
                let (u, v) = (column as f64 / width as f64, row as f64 / height as f64);
                let slope = {
                    let (x, y) = (column as f64 / STEP as f64, row as f64 / STEP as f64);
                    let (i, j) = (x as usize, y as usize);
                    let (a, b) = (x - i as f64, y - j as f64);
                    [0, 1].map(|axis| {
                        let at = |i: usize, j: usize| slopes[j * columns + i][axis];
                        (1.0 - b) * ((1.0 - a) * at(i, j) + a * at(i + 1, j))
                            + b * ((1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1))
                    })
                };
                let light = [60.0 + 90.0 * u, 120.0 - 30.0 * v, 150.0 - 80.0 * u];
                // Lamps stand a third of a turn apart.
                let sides = [[1.0, 0.0], [-0.5, 0.866], [-0.5, -0.866]];
                let covered = ink[row * width + column];
                let ink = if self.is_dark {
                    1.0 - INK * covered
                } else {
                    1.0 + INK * covered
                };
                for (light, side) in light.into_iter().zip(sides) {
                    let shaded = light + SHADE * (side[0] * slope[0] + side[1] * slope[1]);
                    let level = shaded.max(8.0) * ink + NOISE_LEVELS * normal(random);
                    rgb.push(level.round().clamp(0.0, 255.0) as u8);
                }
            }
        }
        rgb
    }
}
