//! Random indenters for samples: the built-in shapes in random sizes, and random surfaces (rough bowls, blobs with
//! a wavy outline). Which ones a stream may draw depends on its split. Units: mm.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::Split;
use crate::contact_world::{GridShape, HeightMap, Shape, TRAINING_SHAPES, UNSEEN_SHAPES};
use crate::error::SimulationError;
use crate::random::Random;

/// Purpose of a random surface's own stream.
const SURFACE: u64 = 9;
/// Samples of a random surface along a side, and their distance.
const GRID_POINTS: usize = 61;
const GRID_PITCH_MM: f64 = 0.4;
/// From here on a random surface bends away, so that its grid's border never touches.
const GRID_RIM_MM: f64 = 9.0;
/// Waves on a random surface.
const WAVES: usize = 6;
/// Outline terms of a blob: two lobes and more.
const LOBES: std::ops::Range<u32> = 2..6;
/// Names of the two random surfaces.
const ROUGH: &str = "rough";
const BLOB: &str = "blob";

/// An indenter that was drawn.
#[derive(Debug, Clone)]
pub(crate) struct Indenter {
    /// The built-in shape's name, `rough` or `blob`.
    pub(crate) name: &'static str,
    pub(crate) surface: Arc<dyn HeightMap>,
}

impl Indenter {
    /// A built-in shape of the split in a random size, or as likely a random surface that no other split has.
    pub(crate) fn draw(random: &mut Random, split: Split) -> Result<Self, SimulationError> {
        if random.unit() < 0.5 {
            let known: &[Shape] = if split == Split::Test {
                &UNSEEN_SHAPES
            } else {
                &TRAINING_SHAPES
            };
            let shape = resized(known[random.below(known.len())], random);
            return Ok(Self {
                name: shape.name(),
                surface: Arc::new(shape),
            });
        }
        let mut own = Random::new(split.own_number(random), SURFACE);
        let name = if own.unit() < 0.5 { ROUGH } else { BLOB };
        Ok(Self {
            name,
            surface: Arc::new(random_surface(name == BLOB, &mut own)?),
        })
    }

    /// Farthest point whose surface lies less than `height_mm` above the lowest plane, mm from the origin.
    pub(crate) fn reach_mm(&self, height_mm: f64) -> f64 {
        const STEP_MM: f64 = 0.25;
        const DIRECTIONS: u32 = 16;
        let low = |r: f64| {
            (0..DIRECTIONS).any(|i| {
                let (sin, cos) = libm::sincos(TAU * f64::from(i) / f64::from(DIRECTIONS));
                self.surface.height_mm([r * cos, r * sin]) < height_mm
            })
        };
        (0..60)
            .rev()
            .map(|i| f64::from(i) * STEP_MM)
            .find(|&r| low(r))
            .unwrap_or(0.0)
    }
}

/// The shape with random lengths; slopes and proportions change too.
fn resized(shape: Shape, random: &mut Random) -> Shape {
    let mut length = |from: f64, to: f64| random.log_uniform(from, to);
    match shape {
        Shape::Sphere { .. } => Shape::Sphere {
            radius_mm: length(4.0, 25.0),
        },
        Shape::Cylinder { .. } => Shape::Cylinder {
            radius_mm: length(3.0, 15.0),
            length_mm: length(5.0, 18.0),
            edge_mm: length(1.0, 3.0),
        },
        Shape::Disc { .. } => Shape::Disc {
            radius_mm: length(1.2, 5.0),
            edge_mm: length(1.0, 3.0),
        },
        Shape::Cone { .. } => Shape::Cone {
            slope: length(0.25, 1.0),
            tip_mm: length(1.0, 4.0),
        },
        Shape::Block { .. } => Shape::Block {
            sides_mm: [length(3.0, 12.0), length(1.5, 7.0)],
            edge_mm: length(0.8, 3.0),
        },
        Shape::Ellipsoid { .. } => Shape::Ellipsoid {
            axes_mm: [length(6.0, 20.0), length(4.0, 12.0), length(4.0, 12.0)],
        },
        Shape::Ring { .. } => Shape::Ring {
            radius_mm: length(3.0, 7.0),
            edge_mm: length(1.0, 3.0),
        },
        Shape::TwoSpheres { .. } => Shape::TwoSpheres {
            radius_mm: length(4.0, 9.0),
            distance_mm: length(4.0, 11.0),
        },
        Shape::Triangle { .. } => Shape::Triangle {
            inner_mm: length(1.5, 3.5),
            edge_mm: length(0.8, 2.5),
        },
        Shape::Corner { .. } => Shape::Corner {
            tip_mm: length(1.0, 4.0),
        },
        Shape::Cross { .. } => Shape::Cross {
            length_mm: length(7.0, 14.0),
            width_mm: length(1.2, 3.5),
            edge_mm: length(0.8, 2.5),
        },
        Shape::Wavy { .. } => Shape::Wavy {
            radius_mm: length(9.0, 25.0),
            height_mm: length(0.15, 0.6),
            wave_mm: length(3.0, 7.0),
        },
    }
}

/// A bowl with two radii and waves on it, or a blob: a dome that ends at a wavy outline with a round edge.
fn random_surface(blob: bool, random: &mut Random) -> Result<GridShape, SimulationError> {
    let [along, across] = if blob {
        let radius = random.log_uniform(8.0, 60.0);
        [radius, radius]
    } else {
        [random.log_uniform(5.0, 40.0), random.log_uniform(5.0, 40.0)]
    };
    let slope = random.log_uniform(0.01, if blob { 0.04 } else { 0.12 });
    let waves: [([f64; 2], f64, f64); WAVES] = std::array::from_fn(|_| {
        let wave = TAU / random.log_uniform(2.5, 12.0);
        let [x, y] = random.direction();
        let height = slope * random.uniform(0.3, 1.0) / wave;
        ([wave * x, wave * y], random.uniform(0.0, TAU), height)
    });
    let outline_mm = random.log_uniform(2.0, 6.0);
    let lobes = LOBES.map(|lobe| (lobe, random.uniform(0.0, 0.25), random.uniform(0.0, TAU)));
    let lobes: Vec<(u32, f64, f64)> = lobes.collect();
    let edge_mm = random.log_uniform(0.8, 3.0);

    let mut heights = Vec::with_capacity(GRID_POINTS * GRID_POINTS);
    let place = |i: usize| GRID_PITCH_MM * (i as f64 - 0.5 * (GRID_POINTS - 1) as f64);
    for row in 0..GRID_POINTS {
        for column in 0..GRID_POINTS {
            let (x, y) = (place(column), place(row));
            let r = libm::hypot(x, y);
            let mut height = 0.5 * (x * x / along + y * y / across);
            for ([wave_x, wave_y], phase, amount) in waves {
                height += amount * libm::cos(wave_x * x + wave_y * y + phase);
            }
            if blob {
                let turn = libm::atan2(y, x);
                let wide = |&(lobe, share, phase): &(u32, f64, f64)| {
                    share * libm::cos(f64::from(lobe) * turn + phase)
                };
                let outline = outline_mm * (1.0 + lobes.iter().map(wide).sum::<f64>()).max(0.3);
                height += 0.5 * (r - outline).max(0.0).powi(2) / edge_mm;
            }
            height += 0.5 * (r - GRID_RIM_MM).max(0.0).powi(2);
            heights.push(height);
        }
    }
    GridShape::new(GRID_POINTS, GRID_PITCH_MM, heights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_stream_draws_no_shape_that_training_draws() {
        let names = |split: Split| {
            let mut random = Random::new(1, 1);
            let mut names: Vec<&str> = (0..200)
                .map(|_| Indenter::draw(&mut random, split).unwrap().name)
                .filter(|name| ![ROUGH, BLOB].contains(name))
                .collect();
            names.sort_unstable();
            names.dedup();
            names
        };
        let (train, test) = (names(Split::Train), names(Split::Test));
        assert_eq!((train.len(), test.len()), (7, 5));
        assert!(train.iter().all(|name| !test.contains(name)));
        assert_eq!(names(Split::Validation), train);
    }

    #[test]
    fn random_surfaces_start_at_zero_and_rise_at_their_border() {
        let mut random = Random::new(2, 1);
        for _ in 0..20 {
            for blob in [false, true] {
                let surface = random_surface(blob, &mut random).unwrap();
                let border = GRID_PITCH_MM * 0.5 * (GRID_POINTS - 1) as f64;
                let mut lowest = f64::INFINITY;
                for i in 0..GRID_POINTS {
                    for j in 0..GRID_POINTS {
                        let at = [i, j].map(|i| GRID_PITCH_MM * i as f64 - border + 1e-9);
                        let height = surface.height_mm(at);
                        lowest = lowest.min(height);
                        if at[0].abs().max(at[1].abs()) > border - 0.1 {
                            assert!(height > 2.5, "{height} mm at the border");
                        }
                    }
                }
                assert!((0.0..0.01).contains(&lowest), "{lowest}");
            }
        }
    }

    #[test]
    fn reach_is_where_the_surface_leaves_the_given_height() {
        let sphere = Indenter {
            name: "sphere",
            surface: Arc::new(Shape::Sphere { radius_mm: 10.0 }),
        };
        // √(2·10·0.5 − 0.25) = 3.12 mm.
        assert!((sphere.reach_mm(0.5) - 3.0).abs() < 1e-9);
    }
}
