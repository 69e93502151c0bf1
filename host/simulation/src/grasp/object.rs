//! What is grasped: mass, where it sits, the patch that the fingers touch, friction; ten built-in objects.
//! Units: g, mm, g·mm². Limits: both fingers touch mirrored patches; the object turns about the grip axis only.

use std::borrow::Cow;
use std::sync::Arc;

use crate::contact_world::{HeightMap, Shape};
use crate::error::{SimulationError, finite, not_negative, positive};

/// The surface that a finger touches.
#[derive(Debug, Clone)]
pub enum Patch {
    /// A built-in one.
    Shape(Shape),
    /// Any other.
    Any(Arc<dyn HeightMap>),
}

impl Patch {
    pub(crate) fn height_map(&self) -> Arc<dyn HeightMap> {
        match self {
            Self::Shape(shape) => Arc::new(*shape),
            Self::Any(surface) => Arc::clone(surface),
        }
    }
}

/// An object. Its frame: origin at the grip point, x and y in the plane of the fingers, y up when it stands.
#[derive(Debug, Clone)]
pub struct Object {
    /// What it is called.
    pub name: Cow<'static, str>,
    /// Mass, g.
    pub mass_g: f64,
    /// Moment of inertia about the grip axis through the centre of mass, g·mm².
    pub inertia_g_mm2: f64,
    /// Centre of mass from the grip point, mm.
    pub centre_of_mass_mm: [f64; 2],
    /// Width and height in the plane of the fingers, and thickness between them, mm.
    pub size_mm: [f64; 3],
    /// The patch at the grip point; the other finger touches its mirror image.
    pub patch: Patch,
    /// Turn of the patch against the object, rad.
    pub patch_turn_rad: f64,
    /// True Coulomb friction against the gel, finger by finger.
    pub friction: [f64; 2],
}

impl Object {
    /// Weight on earth, N.
    #[must_use]
    pub fn weight_n(&self) -> f64 {
        self.mass_g * 1e-6 * crate::constants::GRAVITY_MM_PER_S2
    }

    /// Grip force at which it begins to slide when `shear_n` pulls at the grip point, N.
    #[must_use]
    pub fn min_grip_n(&self, shear_n: f64) -> f64 {
        shear_n / (self.friction[0] + self.friction[1])
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        positive("object mass_g", self.mass_g)?;
        not_negative("object inertia_g_mm2", self.inertia_g_mm2)?;
        finite("object centre_of_mass_mm[0]", self.centre_of_mass_mm[0])?;
        finite("object centre_of_mass_mm[1]", self.centre_of_mass_mm[1])?;
        finite("object patch_turn_rad", self.patch_turn_rad)?;
        for side in self.size_mm {
            positive("object size_mm", side)?;
        }
        for friction in self.friction {
            positive("object friction", friction)?;
        }
        // A point mass at the grip point would turn without effort.
        let lever = self.centre_of_mass_mm[0].powi(2) + self.centre_of_mass_mm[1].powi(2);
        positive(
            "object moment of inertia about the grip point, g·mm²",
            self.inertia_g_mm2 + self.mass_g * lever,
        )?;
        Ok(())
    }
}

const fn object(
    name: &'static str,
    mass_g: f64,
    size_mm: [f64; 3],
    inertia_g_mm2: f64,
    centre_of_mass_mm: [f64; 2],
    (patch, patch_turn_rad): (Shape, f64),
    friction: f64,
) -> Object {
    Object {
        name: Cow::Borrowed(name),
        mass_g,
        inertia_g_mm2,
        centre_of_mass_mm,
        size_mm,
        patch: Patch::Shape(patch),
        patch_turn_rad,
        friction: [friction; 2],
    }
}

const UPRIGHT: f64 = std::f64::consts::FRAC_PI_2;

/// Seventeen objects. The first five have the paper's masses; what they were is not in its text, so their form is
/// assumed: everyday things of that mass. The next five are standard articles, the last seven things with lines, flat
/// ends and round ends of other curvatures, their mass and size assumed. Friction of dry silicone on each material
/// is assumed, within 0.5 to 1. Moments of inertia follow from mass and size: solid box or rod m(w² + h²)/12, solid
/// ball ⅖mr², thin shell ⅔mr², solid cylinder across its axis m(3r² + h²)/12. Where the fingers do not grip above
/// the middle, the centre of mass lies off the grip point and the object pivots.
pub static OBJECTS: [Object; 17] = [
    // Paper, object 1. A hollow plastic ball, thin shell of 36 mm.
    object(
        "hollow plastic ball, 11.90 g",
        11.90,
        [36.0, 36.0, 36.0],
        2_570.0,
        [0.0, 0.0],
        (Shape::Sphere { radius_mm: 18.0 }, 0.0),
        0.7,
    ),
    // Paper, object 2. A marker pen of 130 x 16 mm lying level, gripped 15 mm off its middle.
    object(
        "marker pen, 17.82 g",
        17.82,
        [130.0, 16.0, 16.0],
        25_477.0,
        [15.0, 0.0],
        (
            Shape::Cylinder {
                radius_mm: 8.0,
                length_mm: 12.0,
                edge_mm: 3.0,
            },
            0.0,
        ),
        0.65,
    ),
    // Paper, object 3. A small tin of 52 mm across and 60 mm high, gripped at a rim 10 mm above its middle.
    object(
        "small tin, 91.11 g",
        91.11,
        [52.0, 60.0, 52.0],
        42_730.0,
        [0.0, -10.0],
        (
            Shape::Cylinder {
                radius_mm: 26.0,
                length_mm: 8.0,
                edge_mm: 6.0,
            },
            UPRIGHT,
        ),
        0.6,
    ),
    // Paper, object 4. A wooden block of 40 x 60 x 35 mm with a rounded boss, gripped 6 mm beside its middle.
    object(
        "wooden block, 57.50 g",
        57.50,
        [40.0, 60.0, 35.0],
        24_917.0,
        [6.0, -4.0],
        (
            Shape::Block {
                sides_mm: [5.0, 7.0],
                edge_mm: 4.0,
            },
            0.0,
        ),
        0.55,
    ),
    // Paper, object 5. A glass bottle of 32 x 75 mm with a bulging side, gripped above its middle.
    object(
        "glass bottle, 92.66 g",
        92.66,
        [32.0, 75.0, 28.0],
        51_344.0,
        [0.0, -12.0],
        (
            Shape::Ellipsoid {
                axes_mm: [16.0, 30.0, 14.0],
            },
            0.0,
        ),
        0.9,
    ),
    // Golf ball: at most 45.93 g, at least 42.67 mm (R&A, Equipment Rules 4).
    object(
        "golf ball",
        45.93,
        [42.7, 42.7, 42.7],
        8_363.0,
        [0.0, 0.0],
        (Shape::Sphere { radius_mm: 21.34 }, 0.0),
        0.6,
    ),
    // Table tennis ball: 2.7 g, 40 mm (ITTF, Laws of Table Tennis 2.3).
    object(
        "table tennis ball",
        2.7,
        [40.0, 40.0, 40.0],
        720.0,
        [0.0, 0.0],
        (Shape::Sphere { radius_mm: 20.0 }, 0.0),
        0.75,
    ),
    // AA cell, alkaline: 14.5 x 50.5 mm (IEC 60086-2, LR6), about 23 g; upright, gripped above its middle.
    object(
        "AA cell",
        23.0,
        [14.5, 50.5, 14.5],
        5_191.0,
        [0.0, -8.0],
        (
            Shape::Cylinder {
                radius_mm: 7.25,
                length_mm: 10.0,
                edge_mm: 3.0,
            },
            UPRIGHT,
        ),
        0.5,
    ),
    // Hen's egg, class M: 53 to 63 g (EU 2023/2465), lying, about 57 x 44 mm.
    object(
        "hen's egg",
        58.0,
        [57.0, 44.0, 44.0],
        15_034.0,
        [2.0, 0.0],
        (
            Shape::Ellipsoid {
                axes_mm: [28.5, 22.0, 22.0],
            },
            0.0,
        ),
        0.55,
    ),
    // Tennis ball: 56.0 to 59.4 g, 65.4 to 68.6 mm (ITF, Rules of Tennis, appendix I), a shell 6 mm thick.
    object(
        "tennis ball",
        57.7,
        [67.0, 67.0, 67.0],
        36_000.0,
        [0.0, 0.0],
        (Shape::Sphere { radius_mm: 33.5 }, 0.0),
        1.0,
    ),
    // Glue stick, 26 mm across and 98 mm long, lying, gripped off its middle.
    object(
        "glue stick",
        40.0,
        [98.0, 26.0, 26.0],
        33_703.0,
        [8.0, 0.0],
        (
            Shape::Cylinder {
                radius_mm: 13.0,
                length_mm: 10.0,
                edge_mm: 4.0,
            },
            0.0,
        ),
        0.7,
    ),
    // Board marker's cap, 10 mm across and 60 mm long, upright, gripped above its middle.
    object(
        "marker cap",
        15.0,
        [10.0, 60.0, 10.0],
        4_594.0,
        [0.0, -8.0],
        (
            Shape::Cylinder {
                radius_mm: 5.0,
                length_mm: 14.0,
                edge_mm: 3.0,
            },
            UPRIGHT,
        ),
        0.8,
    ),
    // Domino, large, gripped at a narrow end that lies a little turned.
    object(
        "domino",
        30.0,
        [25.0, 50.0, 12.0],
        7_813.0,
        [4.0, -4.0],
        (
            Shape::Block {
                sides_mm: [6.0, 4.0],
                edge_mm: 3.0,
            },
            0.4,
        ),
        0.65,
    ),
    // Rubber eraser with worn edges.
    object(
        "eraser",
        20.0,
        [22.0, 43.0, 12.0],
        3_888.0,
        [0.0, -6.0],
        (
            Shape::Block {
                sides_mm: [4.0, 4.0],
                edge_mm: 6.0,
            },
            0.0,
        ),
        0.9,
    ),
    // Drawer knob with a flat face of 6 mm.
    object(
        "drawer knob",
        60.0,
        [32.0, 32.0, 25.0],
        7_680.0,
        [0.0, -5.0],
        (
            Shape::Disc {
                radius_mm: 3.0,
                edge_mm: 4.0,
            },
            0.0,
        ),
        0.5,
    ),
    // River pebble, gripped above its middle.
    object(
        "pebble",
        98.0,
        [38.0, 40.0, 28.0],
        19_870.0,
        [3.0, -10.0],
        (
            Shape::Ellipsoid {
                axes_mm: [19.0, 14.0, 15.0],
            },
            0.2,
        ),
        0.6,
    ),
    // Weighted ball of a knob, gripped above its middle.
    object(
        "ball knob",
        95.0,
        [30.0, 42.0, 30.0],
        17_000.0,
        [0.0, -6.0],
        (Shape::Sphere { radius_mm: 15.0 }, 0.0),
        0.8,
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_objects_have_five_masses_of_the_paper_and_constants_that_belong_together() {
        let masses: Vec<f64> = OBJECTS[..5].iter().map(|o| o.mass_g).collect();
        assert_eq!(masses, [11.90, 17.82, 91.11, 57.50, 92.66]);
        for object in &OBJECTS {
            object.check().unwrap();
            assert!(
                object.friction.iter().all(|f| (0.5..=1.0).contains(f)),
                "{}",
                object.name
            );
            // No body in its box turns harder than all mass in the corners or easier than a rod of a quarter
            // of its size.
            let [w, h, _] = object.size_mm;
            let corners = 0.25 * object.mass_g * (w * w + h * h);
            let share = object.inertia_g_mm2 / corners;
            assert!((0.1..0.7).contains(&share), "{}: {share}", object.name);
            for (offset, side) in object.centre_of_mass_mm.iter().zip([w, h]) {
                assert!(offset.abs() < 0.5 * side, "{}", object.name);
            }
        }
    }

    #[test]
    fn an_object_that_turns_without_effort_is_refused() {
        let point = Object {
            inertia_g_mm2: 0.0,
            centre_of_mass_mm: [0.0; 2],
            ..OBJECTS[0].clone()
        };
        assert!(
            point
                .check()
                .unwrap_err()
                .to_string()
                .contains("moment of inertia")
        );
        assert!((OBJECTS[2].weight_n() - 0.8935).abs() < 1e-3);
    }
}
