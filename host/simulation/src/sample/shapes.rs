//! Random indenters for samples: the built-in shapes in random sizes, and random surfaces (rough bowls, blobs with a wavy
//! outline and, where nothing is reported, heaps of balls, facets around a point, and corrugated bowls). Which ones a
//! stream may draw depends on its split. Units: mm.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::split::Split;
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
/// Balls of a heap, and facets around a point; the slots of the draw, not all of which are used.
const MAX_BALLS: usize = 5;
const MAX_FACETS: usize = 6;
/// Where a ball of a heap ends and its grid goes on level, mm above its lowest point.
const BALL_TOP_MM: f64 = 4.0;

/// A kind of random surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Surface {
    /// A bowl with two radii and waves on it.
    Rough,
    /// A dome that ends at a wavy outline with a round edge.
    Blob,
    /// Balls of different sizes at different heights.
    Heap,
    /// Planes around a rounded point.
    Facets,
    /// A rough bowl with steep waves.
    Corrugated,
}

impl Surface {
    fn name(self) -> &'static str {
        match self {
            Self::Rough => "rough",
            Self::Blob => "blob",
            Self::Heap => "heap",
            Self::Facets => "facets",
            Self::Corrugated => "corrugated",
        }
    }

    /// What is reported stays with the first two, so that figures compare; training sees more of what there may be.
    fn draw(random: &mut Random, split: Split) -> Self {
        let all: &[Self] = match split {
            Split::Test | Split::Calibration => &[Self::Rough, Self::Blob],
            Split::Train | Split::Validation => &[
                Self::Rough,
                Self::Blob,
                Self::Heap,
                Self::Facets,
                Self::Corrugated,
            ],
        };
        // One number, cut evenly: of two, the lower half is the first.
        all[((random.unit() * all.len() as f64) as usize).min(all.len() - 1)]
    }
}

/// An indenter that was drawn.
#[derive(Debug, Clone)]
pub(crate) struct Indenter {
    /// The built-in shape's name, or the random surface's.
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
        let kind = Surface::draw(&mut own, split);
        Ok(Self {
            name: kind.name(),
            surface: Arc::new(random_surface(kind, &mut own)?),
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

/// A surface of this kind, sampled on a grid.
fn random_surface(kind: Surface, random: &mut Random) -> Result<GridShape, SimulationError> {
    match kind {
        Surface::Rough => {
            let bowl = [random.log_uniform(5.0, 40.0), random.log_uniform(5.0, 40.0)];
            let slope = random.log_uniform(0.01, 0.12);
            sampled(waves_on(bowl, slope, random))
        }
        Surface::Corrugated => {
            let bowl = [random.log_uniform(6.0, 30.0), random.log_uniform(6.0, 30.0)];
            let slope = random.log_uniform(0.1, 0.35);
            sampled(waves_on(bowl, slope, random))
        }
        Surface::Blob => {
            let radius_mm = random.log_uniform(8.0, 60.0);
            let slope = random.log_uniform(0.01, 0.04);
            let dome = waves_on([radius_mm; 2], slope, random);
            let outline_mm = random.log_uniform(2.0, 6.0);
            let lobes: Vec<(u32, f64, f64)> = LOBES
                .map(|lobe| (lobe, random.uniform(0.0, 0.25), random.uniform(0.0, TAU)))
                .collect();
            let edge_mm = random.log_uniform(0.8, 3.0);
            sampled(move |[x, y]| {
                let turn = libm::atan2(y, x);
                let wide = |&(lobe, share, phase): &(u32, f64, f64)| {
                    share * libm::cos(f64::from(lobe) * turn + phase)
                };
                let outline = outline_mm * (1.0 + lobes.iter().map(wide).sum::<f64>()).max(0.3);
                dome([x, y]) + 0.5 * (libm::hypot(x, y) - outline).max(0.0).powi(2) / edge_mm
            })
        }
        Surface::Heap => {
            let spread_mm = random.log_uniform(1.5, 6.0);
            let count = 2 + random.below(MAX_BALLS - 1);
            let balls: [([f64; 2], f64, f64); MAX_BALLS] = std::array::from_fn(|_| {
                let [x, y] = random.direction();
                let away_mm = spread_mm * random.unit().sqrt();
                (
                    [away_mm * x, away_mm * y],
                    random.log_uniform(3.0, 12.0),
                    random.uniform(0.0, 0.5),
                )
            });
            sampled(move |[x, y]| {
                let heights = balls[..count].iter().map(|&([at_x, at_y], radius_mm, up_mm)| {
                    let off = libm::hypot(x - at_x, y - at_y).min(radius_mm);
                    up_mm + radius_mm - (radius_mm * radius_mm - off * off).sqrt()
                });
                heights.fold(BALL_TOP_MM, f64::min)
            })
        }
        Surface::Facets => {
            let count = 3 + random.below(MAX_FACETS - 2);
            let turn = random.uniform(0.0, TAU);
            let facets: [[f64; 2]; MAX_FACETS] = std::array::from_fn(|facet| {
                // Spread around, so that no direction is left without a flank.
                let angle = turn + TAU * (facet as f64 + random.uniform(-0.25, 0.25)) / count as f64;
                let slope = random.log_uniform(0.3, 1.2);
                let (sin, cos) = libm::sincos(angle);
                [slope * cos, slope * sin]
            });
            let blunt_mm = random.log_uniform(2.0, 6.0);
            sampled(move |[x, y]| {
                let along = facets[..count]
                    .iter()
                    .map(|[slope_x, slope_y]| slope_x * x + slope_y * y)
                    .fold(0.0, f64::max);
                libm::hypot(along, blunt_mm) - blunt_mm
            })
        }
    }
}

/// A bowl with two radii under waves of all directions that are this steep at most.
fn waves_on([along, across]: [f64; 2], slope: f64, random: &mut Random) -> impl Fn([f64; 2]) -> f64 + use<> {
    let waves: [([f64; 2], f64, f64); WAVES] = std::array::from_fn(|_| {
        let wave = TAU / random.log_uniform(2.5, 12.0);
        let [x, y] = random.direction();
        let height = slope * random.uniform(0.3, 1.0) / wave;
        ([wave * x, wave * y], random.uniform(0.0, TAU), height)
    });
    move |[x, y]| {
        let mut height = 0.5 * (x * x / along + y * y / across);
        for ([wave_x, wave_y], phase, amount) in waves {
            height += amount * libm::cos(wave_x * x + wave_y * y + phase);
        }
        height
    }
}

/// A surface on the grid, bent away towards the grid's border.
fn sampled(height_mm: impl Fn([f64; 2]) -> f64) -> Result<GridShape, SimulationError> {
    let place = |i: usize| GRID_PITCH_MM * (i as f64 - 0.5 * (GRID_POINTS - 1) as f64);
    let mut heights = Vec::with_capacity(GRID_POINTS * GRID_POINTS);
    for row in 0..GRID_POINTS {
        for column in 0..GRID_POINTS {
            let at_mm = [place(column), place(row)];
            let past_rim = (libm::hypot(at_mm[0], at_mm[1]) - GRID_RIM_MM).max(0.0);
            heights.push(height_mm(at_mm) + 0.5 * past_rim.powi(2));
        }
    }
    GridShape::new(GRID_POINTS, GRID_PITCH_MM, heights)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Surface; 5] = [
        Surface::Rough,
        Surface::Blob,
        Surface::Heap,
        Surface::Facets,
        Surface::Corrugated,
    ];

    #[test]
    fn a_test_stream_draws_no_shape_that_training_draws() {
        let names = |split: Split| {
            let mut random = Random::new(1, 1);
            let mut names: Vec<&str> = (0..200)
                .map(|_| Indenter::draw(&mut random, split).unwrap().name)
                .filter(|name| !ALL.map(Surface::name).contains(name))
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
            for kind in ALL {
                let surface = random_surface(kind, &mut random).unwrap();
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
