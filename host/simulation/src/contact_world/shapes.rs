//! Rigid indenters as height maps over the gel: seven shapes for training and five that only tests see.
//! Units: mm; height is measured away from the gel, from the indenter's lowest plane. Limits: no overhangs;
//! walls are vertical and stand [`WALL_MM`] high.

use crate::error::{SimulationError, positive};

/// Height given where an indenter has no surface, mm: far beyond any indentation, and finite.
pub const WALL_MM: f64 = 1e3;

/// A rigid surface over the gel.
pub trait HeightMap: std::fmt::Debug + Send + Sync {
    /// Height at a point of the indenter's own frame, mm; [`WALL_MM`] where there is no surface.
    fn height_mm(&self, at_mm: [f64; 2]) -> f64;
}

/// The built-in indenters. Lengths in mm; edges are rounded by `edge_mm`, so pressure stays finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Its radius.
        radius_mm: f64,
    },
    /// A cylinder lying along x, with ends rounded by `edge_mm`.
    Cylinder {
        /// Its radius.
        radius_mm: f64,
        /// Length between the rounded ends.
        length_mm: f64,
        /// Radius of the ends' edge.
        edge_mm: f64,
    },
    /// The flat end of a rod.
    Disc {
        /// Radius of the flat part.
        radius_mm: f64,
        /// Radius of the edge.
        edge_mm: f64,
    },
    /// A cone pointing into the gel, with a rounded tip.
    Cone {
        /// Height over distance from the axis.
        slope: f64,
        /// Radius of the tip.
        tip_mm: f64,
    },
    /// The face of a block.
    Block {
        /// Sides of the flat part.
        sides_mm: [f64; 2],
        /// Radius of the edges.
        edge_mm: f64,
    },
    /// An ellipsoid resting on its side.
    Ellipsoid {
        /// Semi-axes along x, along y and away from the gel.
        axes_mm: [f64; 3],
    },
    /// The rim of a tube: a torus.
    Ring {
        /// Radius of the rim's middle line.
        radius_mm: f64,
        /// Radius of the rim's cross-section.
        edge_mm: f64,
    },
    /// Two equal balls side by side along x.
    TwoSpheres {
        /// Radius of each.
        radius_mm: f64,
        /// Distance between their centres.
        distance_mm: f64,
    },
    /// The end of a three-sided bar.
    Triangle {
        /// Radius of the circle inside the flat part.
        inner_mm: f64,
        /// Radius of the edges.
        edge_mm: f64,
    },
    /// The corner of a cube, pressed point first.
    Corner {
        /// Radius of the point.
        tip_mm: f64,
    },
    /// A cross-shaped stamp.
    Cross {
        /// Length of either bar.
        length_mm: f64,
        /// Width of the flat part of either bar.
        width_mm: f64,
        /// Radius of the edges.
        edge_mm: f64,
    },
    /// A ball with a corrugated surface.
    Wavy {
        /// Radius of the ball.
        radius_mm: f64,
        /// Height from valley to crest.
        height_mm: f64,
        /// Distance between crests.
        wave_mm: f64,
    },
}

/// The seven shapes that training sees, at their usual size.
pub const TRAINING_SHAPES: [Shape; 7] = [
    Shape::Sphere { radius_mm: 12.0 },
    Shape::Cylinder {
        radius_mm: 8.0,
        length_mm: 12.0,
        edge_mm: 2.0,
    },
    Shape::Disc {
        radius_mm: 3.0,
        edge_mm: 2.0,
    },
    Shape::Cone {
        slope: 0.5,
        tip_mm: 2.0,
    },
    Shape::Block {
        sides_mm: [9.0, 4.0],
        edge_mm: 1.5,
    },
    Shape::Ellipsoid {
        axes_mm: [14.0, 7.0, 8.0],
    },
    Shape::Ring {
        radius_mm: 5.0,
        edge_mm: 2.0,
    },
];

/// The five shapes that are kept for testing.
pub const UNSEEN_SHAPES: [Shape; 5] = [
    Shape::TwoSpheres {
        radius_mm: 6.0,
        distance_mm: 8.0,
    },
    Shape::Triangle {
        inner_mm: 2.5,
        edge_mm: 1.5,
    },
    Shape::Corner { tip_mm: 2.0 },
    Shape::Cross {
        length_mm: 11.0,
        width_mm: 2.0,
        edge_mm: 1.5,
    },
    Shape::Wavy {
        radius_mm: 15.0,
        height_mm: 0.4,
        wave_mm: 4.0,
    },
];

impl Shape {
    /// The shape's name, in lower case.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sphere { .. } => "sphere",
            Self::Cylinder { .. } => "cylinder",
            Self::Disc { .. } => "disc",
            Self::Cone { .. } => "cone",
            Self::Block { .. } => "block",
            Self::Ellipsoid { .. } => "ellipsoid",
            Self::Ring { .. } => "ring",
            Self::TwoSpheres { .. } => "two spheres",
            Self::Triangle { .. } => "triangle",
            Self::Corner { .. } => "corner",
            Self::Cross { .. } => "cross",
            Self::Wavy { .. } => "wavy",
        }
    }
}

/// Height of a round edge or a ball of `radius` at `distance` from where it begins to rise.
fn round(distance: f64, radius: f64) -> f64 {
    if distance <= 0.0 {
        0.0
    } else if distance >= radius {
        WALL_MM
    } else {
        // R − √(R² − d²) without cancellation.
        distance * distance / (radius + (radius * radius - distance * distance).sqrt())
    }
}

/// Distance of a point outside a centred rectangle; 0 or below inside.
fn outside_rectangle(at: [f64; 2], sides: [f64; 2]) -> f64 {
    let past = [at[0].abs() - 0.5 * sides[0], at[1].abs() - 0.5 * sides[1]];
    length(past[0].max(0.0), past[1].max(0.0)) + past[0].max(past[1]).min(0.0)
}

/// Sine and cosine of no, one and two thirds of a turn.
const THIRDS: [[f64; 2]; 3] = [[0.0, 1.0], [HALF_ROOT_3, -0.5], [-HALF_ROOT_3, -0.5]];
const HALF_ROOT_3: f64 = 0.866_025_403_784_438_6;

/// √(x² + y²): lengths here are far from where the square overflows, and this runs for every cell of every step.
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Distance of a point outside an upright equilateral triangle around the origin; 0 inside.
fn outside_triangle(at: [f64; 2], inner: f64) -> f64 {
    // By symmetry one side, y = −inner, and its two corners are enough.
    let half_side = inner * 3.0_f64.sqrt();
    let mut nearest = f64::INFINITY;
    let mut inside = true;
    for [sin, cos] in THIRDS {
        let [x, y] = [cos * at[0] + sin * at[1], cos * at[1] - sin * at[0]];
        inside &= y >= -inner;
        nearest = nearest.min(length((x.abs() - half_side).max(0.0), y + inner));
    }
    if inside { 0.0 } else { nearest }
}

impl HeightMap for Shape {
    fn height_mm(&self, at_mm: [f64; 2]) -> f64 {
        let [x, y] = at_mm;
        let r = length(x, y);
        match *self {
            Self::Sphere { radius_mm } => round(r, radius_mm),
            Self::Cylinder {
                radius_mm,
                length_mm,
                edge_mm,
            } => round(y.abs(), radius_mm) + round(x.abs() - 0.5 * length_mm, edge_mm),
            Self::Disc { radius_mm, edge_mm } => round(r - radius_mm, edge_mm),
            Self::Cone { slope, tip_mm } => {
                // The tip's arc meets the flank where the slopes agree.
                let steep = slope / (1.0 + slope * slope).sqrt();
                let meet = tip_mm * steep;
                if r < meet {
                    round(r, tip_mm)
                } else {
                    round(meet, tip_mm) + slope * (r - meet)
                }
            }
            Self::Block { sides_mm, edge_mm } => round(outside_rectangle(at_mm, sides_mm), edge_mm),
            Self::Ellipsoid { axes_mm: [a, b, c] } => {
                let share = (x / a).powi(2) + (y / b).powi(2);
                if share >= 1.0 {
                    WALL_MM
                } else {
                    c * share / (1.0 + (1.0 - share).sqrt())
                }
            }
            Self::Ring { radius_mm, edge_mm } => round((r - radius_mm).abs(), edge_mm),
            Self::TwoSpheres {
                radius_mm,
                distance_mm,
            } => round(length(x.abs() - 0.5 * distance_mm, y), radius_mm),
            Self::Triangle { inner_mm, edge_mm } => round(outside_triangle(at_mm, inner_mm), edge_mm),
            Self::Corner { tip_mm } => {
                // Three faces of slope √2, so edges of slope 1/√2, rounded as a hyperboloid of radius tip.
                let along = THIRDS
                    .map(|[sin, cos]| y * cos - x * sin)
                    .into_iter()
                    .fold(f64::NEG_INFINITY, f64::max);
                let slope = 2.0_f64.sqrt();
                let start = slope * slope * tip_mm;
                length(slope * along, start) - start
            }
            Self::Cross {
                length_mm,
                width_mm,
                edge_mm,
            } => {
                let one = outside_rectangle(at_mm, [length_mm, width_mm]);
                let other = outside_rectangle(at_mm, [width_mm, length_mm]);
                round(one.min(other), edge_mm)
            }
            Self::Wavy {
                radius_mm,
                height_mm,
                wave_mm,
            } => {
                let phase = |v: f64| libm::cos(std::f64::consts::TAU * v / wave_mm);
                round(r, radius_mm) + 0.25 * height_mm * (2.0 - phase(x) - phase(y))
            }
        }
    }
}

/// What lies between the samples of a [`GridShape`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Straight from sample to sample.
    #[default]
    Bilinear,
    /// Catmull and Rom's cubics, smooth across the samples. They overshoot at steps; what would lie under the
    /// lowest sample is cut off.
    Bicubic,
}

/// An indenter sampled on a square grid, as read from a picture or an array (`height_file`).
#[derive(Debug, Clone, PartialEq)]
pub struct GridShape {
    columns: usize,
    rows: usize,
    pitch_mm: f64,
    heights_mm: Vec<f64>,
    interpolation: Interpolation,
}

impl GridShape {
    /// `heights_mm` row by row, `columns` to a row, `pitch_mm` apart, centred on the indenter's origin. The
    /// lowest height becomes 0.
    ///
    /// # Errors
    /// A pitch that is not above 0, a height that is not finite, fewer than two rows or columns, or heights
    /// that do not fill the rows.
    pub fn new(columns: usize, pitch_mm: f64, mut heights_mm: Vec<f64>) -> Result<Self, SimulationError> {
        positive("indenter pitch_mm", pitch_mm)?;
        let rows = heights_mm.len().checked_div(columns).unwrap_or(0);
        if columns < 2 || rows < 2 || rows * columns != heights_mm.len() {
            return Err(SimulationError::OutOfRange {
                field: "indenter heights_mm (count)",
                found: heights_mm.len() as f64,
                expected: "two or more full rows of two or more columns",
            });
        }
        if let Some(&found) = heights_mm.iter().find(|v| !v.is_finite()) {
            return Err(SimulationError::OutOfRange {
                field: "indenter heights_mm",
                found,
                expected: "finite numbers",
            });
        }
        let lowest = heights_mm.iter().copied().fold(f64::INFINITY, f64::min);
        for height in &mut heights_mm {
            *height -= lowest;
        }
        Ok(Self {
            columns,
            rows,
            pitch_mm,
            heights_mm,
            interpolation: Interpolation::default(),
        })
    }

    /// The same samples with something else between them.
    #[must_use]
    pub fn interpolated(mut self, interpolation: Interpolation) -> Self {
        self.interpolation = interpolation;
        self
    }

    /// Height of a sample; outside the grid as if its border went on straight.
    fn sample_mm(&self, row: isize, column: isize) -> f64 {
        let at = |row: usize, column: usize| self.heights_mm[row * self.columns + column];
        let along = |row: usize| match column {
            ..0 => 2.0 * at(row, 0) - at(row, 1),
            column if column as usize >= self.columns => {
                2.0 * at(row, self.columns - 1) - at(row, self.columns - 2)
            }
            column => at(row, column as usize),
        };
        match row {
            ..0 => 2.0 * along(0) - along(1),
            row if row as usize >= self.rows => 2.0 * along(self.rows - 1) - along(self.rows - 2),
            row => along(row as usize),
        }
    }
}

/// Weights of the four samples around a point `part` of the way from the second to the third.
fn catmull_rom(part: f64) -> [f64; 4] {
    let [s, s2, s3] = [part, part * part, part * part * part];
    [
        0.5 * (2.0 * s2 - s3 - s),
        0.5 * (3.0 * s3 - 5.0 * s2 + 2.0),
        0.5 * (4.0 * s2 - 3.0 * s3 + s),
        0.5 * (s3 - s2),
    ]
}

impl HeightMap for GridShape {
    fn height_mm(&self, at_mm: [f64; 2]) -> f64 {
        let place = |v: f64, count: usize| v / self.pitch_mm + 0.5 * (count - 1) as f64;
        let (u, v) = (place(at_mm[0], self.columns), place(at_mm[1], self.rows));
        let (last_u, last_v) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        if !(0.0..=last_u).contains(&u) || !(0.0..=last_v).contains(&v) {
            return WALL_MM;
        }
        let (column, row) = (
            (u as usize).min(self.columns - 2),
            (v as usize).min(self.rows - 2),
        );
        let (s, t) = (u - column as f64, v - row as f64);
        if self.interpolation == Interpolation::Bicubic {
            let (across, down) = (catmull_rom(s), catmull_rom(t));
            let mut height = 0.0;
            for (i, down) in down.into_iter().enumerate() {
                for (j, across) in across.into_iter().enumerate() {
                    let [row, column] = [row + i, column + j].map(|place| place as isize - 1);
                    height += down * across * self.sample_mm(row, column);
                }
            }
            return height.max(0.0);
        }
        let at = |row: usize, column: usize| self.heights_mm[row * self.columns + column];
        (1.0 - t) * ((1.0 - s) * at(row, column) + s * at(row, column + 1))
            + t * ((1.0 - s) * at(row + 1, column) + s * at(row + 1, column + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> impl Iterator<Item = Shape> {
        TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES)
    }

    #[test]
    fn every_shape_touches_at_zero_and_never_lies_below() {
        for shape in all() {
            let mut lowest = f64::INFINITY;
            for i in -200..=200 {
                for j in -200..=200 {
                    let height = shape.height_mm([0.1 * f64::from(i), 0.1 * f64::from(j)]);
                    assert!(
                        (0.0..=WALL_MM * 2.0).contains(&height),
                        "{} {height}",
                        shape.name()
                    );
                    lowest = lowest.min(height);
                }
            }
            assert!(lowest < 1e-9, "{} starts at {lowest} mm", shape.name());
        }
    }

    #[test]
    fn surfaces_have_no_steps_below_a_millimetre_but_at_their_walls() {
        // An edge of 1.5 mm is 2.83 steep where it is 1 mm high.
        for shape in all() {
            for i in -1200..1200 {
                for y in [-4.1, -1.3, 0.0, 0.7, 2.9] {
                    let x = 0.01 * f64::from(i);
                    let (a, b) = (shape.height_mm([x, y]), shape.height_mm([x + 0.01, y]));
                    if a.max(b) < 1.0 {
                        assert!((a - b).abs() < 0.03, "{} at {x}, {y}: {a} {b}", shape.name());
                    }
                }
            }
        }
    }

    #[test]
    fn shapes_have_the_sizes_they_state() {
        let sphere = Shape::Sphere { radius_mm: 12.0 };
        assert!((sphere.height_mm([3.0, 4.0]) - (12.0 - 119.0_f64.sqrt())).abs() < 1e-12);
        let [_, cylinder, disc, cone, block, ellipsoid, ring] = TRAINING_SHAPES;
        assert!(cylinder.height_mm([5.9, 0.0]) < 1e-12);
        assert!(cylinder.height_mm([6.5, 0.0]) > 0.0 && cylinder.height_mm([0.0, 8.1]) >= WALL_MM);
        assert!(disc.height_mm([2.9, 0.0]) == 0.0 && disc.height_mm([3.5, 0.0]) > 0.0);
        assert!((cone.height_mm([7.0, 0.0]) - cone.height_mm([6.0, 0.0]) - 0.5).abs() < 1e-12);
        assert!(block.height_mm([4.4, 1.9]) == 0.0 && block.height_mm([0.0, 2.5]) > 0.0);
        assert!((ellipsoid.height_mm([7.0, 0.0]) - 8.0 * (1.0 - 0.75_f64.sqrt())).abs() < 1e-12);
        assert!(ring.height_mm([0.0, -5.0]) < 1e-12 && ring.height_mm([0.0, 0.0]) >= WALL_MM);
        let [_, triangle, corner, cross, _] = UNSEEN_SHAPES;
        assert!(triangle.height_mm([0.0, 4.9]) == 0.0 && triangle.height_mm([0.0, -2.6]) > 0.0);
        // Far out the cube's corner rises as its faces do.
        let far = corner.height_mm([0.0, 60.0]) - corner.height_mm([0.0, 50.0]);
        assert!((far / 10.0 - 2.0_f64.sqrt()).abs() < 0.02, "{far}");
        assert!(cross.height_mm([5.4, 0.9]) == 0.0 && cross.height_mm([3.0, 3.0]) > 0.3);
    }

    #[test]
    fn a_sampled_sphere_is_the_sphere() {
        let sphere = Shape::Sphere { radius_mm: 12.0 };
        let (columns, rows) = (101, 61);
        let heights = (0..rows * columns)
            .map(|i| {
                let at = [
                    0.1 * ((i % columns) as f64 - 50.0),
                    0.1 * ((i / columns) as f64 - 30.0),
                ];
                3.0 + sphere.height_mm(at)
            })
            .collect();
        let grid = GridShape::new(columns, 0.1, heights).unwrap();
        for at in [[0.0, 0.0], [1.234, -2.3], [-4.9, 2.97]] {
            assert!((grid.height_mm(at) - sphere.height_mm(at)).abs() < 3e-4);
        }
        assert!(grid.height_mm([0.0, 3.1]) >= WALL_MM);
        assert!(GridShape::new(3, 0.1, vec![0.0; 7]).is_err());
        assert!(GridShape::new(0, 0.1, vec![]).is_err());
        assert!(GridShape::new(2, 0.1, vec![0.0, f64::NAN, 0.0, 0.0]).is_err());
    }
}
