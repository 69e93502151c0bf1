//! The section `[indenter]`: a built-in shape by name and measures, or a height map from a file.

use std::sync::Arc;

use super::error::SceneError;
use super::keys;
use super::named_file::{Load, load_named};
use super::section::Section;
use crate::contact_world::{GridShape, HeightMap, Interpolation, Shape, TRAINING_SHAPES, UNSEEN_SHAPES};

/// The indenter of a scene.
#[derive(Debug, Clone)]
pub struct Indenter {
    /// Its name: that of the shape, or `file`.
    pub name: String,
    /// Its surface.
    pub shape: Arc<dyn HeightMap>,
    /// Coulomb's coefficient against the gel.
    pub friction: f64,
}

/// A built-in shape's name in a scene file.
pub(super) fn file_name(shape: &Shape) -> String {
    shape.name().replace(' ', "_")
}

/// Reads the section.
pub(super) fn read(section: &Section, load: &mut Load) -> Result<Indenter, SceneError> {
    let name = section.text(&keys::SHAPE)?;
    let friction = section.number(&keys::FRICTION)?;
    let usual = TRAINING_SHAPES
        .into_iter()
        .chain(UNSEEN_SHAPES)
        .find(|shape| file_name(shape) == name);
    let shape: Arc<dyn HeightMap> = match usual {
        Some(usual) => Arc::new(built_in(usual, section)?),
        None => Arc::new(height_map(section, load)?),
    };
    section.finish(&format!("shape = \"{name}\""))?;
    Ok(Indenter {
        name: name.to_owned(),
        shape,
        friction,
    })
}

/// The shape at its usual size, except for the measures that are given.
fn built_in(usual: Shape, section: &Section) -> Result<Shape, SceneError> {
    let set = |value: &mut f64, key| -> Result<(), SceneError> {
        if let Some(given) = section.number_if(key)? {
            *value = given;
        }
        Ok(())
    };
    let mut shape = usual;
    match &mut shape {
        Shape::Sphere { radius_mm } => set(radius_mm, &keys::RADIUS)?,
        Shape::Cylinder {
            radius_mm,
            length_mm,
            edge_mm,
        } => {
            set(radius_mm, &keys::RADIUS)?;
            set(length_mm, &keys::LENGTH)?;
            set(edge_mm, &keys::EDGE)?;
        }
        Shape::Disc { radius_mm, edge_mm } | Shape::Ring { radius_mm, edge_mm } => {
            set(radius_mm, &keys::RADIUS)?;
            set(edge_mm, &keys::EDGE)?;
        }
        Shape::Cone { slope, tip_mm } => {
            set(slope, &keys::SLOPE)?;
            set(tip_mm, &keys::TIP)?;
        }
        Shape::Block { sides_mm, edge_mm } => {
            *sides_mm = section.numbers_if(&keys::SIDES)?.unwrap_or(*sides_mm);
            set(edge_mm, &keys::EDGE)?;
        }
        Shape::Ellipsoid { axes_mm } => *axes_mm = section.numbers_if(&keys::AXES)?.unwrap_or(*axes_mm),
        Shape::TwoSpheres {
            radius_mm,
            distance_mm,
        } => {
            set(radius_mm, &keys::RADIUS)?;
            set(distance_mm, &keys::DISTANCE)?;
        }
        Shape::Triangle { inner_mm, edge_mm } => {
            set(inner_mm, &keys::INNER)?;
            set(edge_mm, &keys::EDGE)?;
        }
        Shape::Corner { tip_mm } => set(tip_mm, &keys::TIP)?,
        Shape::Cross {
            length_mm,
            width_mm,
            edge_mm,
        } => {
            set(length_mm, &keys::LENGTH)?;
            set(width_mm, &keys::WIDTH)?;
            set(edge_mm, &keys::EDGE)?;
        }
        Shape::Wavy {
            radius_mm,
            height_mm,
            wave_mm,
        } => {
            set(radius_mm, &keys::RADIUS)?;
            set(height_mm, &keys::WAVE_HEIGHT)?;
            set(wave_mm, &keys::WAVE)?;
        }
    }
    Ok(shape)
}

fn height_map(section: &Section, load: &mut Load) -> Result<GridShape, SceneError> {
    const WITH_FILE: &str = " with shape = \"file\"";
    let missing = |key| section.missing(key, WITH_FILE);
    let name = section
        .text_if(&keys::FILE)?
        .ok_or_else(|| missing(&keys::FILE))?;
    let pitch = section
        .number_if(&keys::MM_PER_PIXEL)?
        .ok_or_else(|| missing(&keys::MM_PER_PIXEL))?;
    let per_level = section.number_if(&keys::MM_PER_LEVEL)?;
    let interpolation = match section.text(&keys::INTERPOLATION)? {
        "bicubic" => Interpolation::Bicubic,
        _ => Interpolation::Bilinear,
    };
    let extension = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let bytes = load_named(section, &keys::FILE, name, load)?;
    let read = match (&*extension, per_level) {
        ("png", None) => return Err(section.missing(&keys::MM_PER_LEVEL, " with a PNG")),
        ("png", Some(0.0)) => {
            let expected = "another height for every grey level";
            return Err(section.problem(
                keys::MM_PER_LEVEL.name,
                "0",
                expected,
                "give the height of one level in mm",
            ));
        }
        ("png", Some(per_level)) => GridShape::from_png(&bytes, pitch, per_level, interpolation),
        ("npy", None) => GridShape::from_npy(&bytes, pitch, interpolation),
        ("npy", Some(_)) => {
            let found = "a scale beside an array";
            let expected = "heights in mm in the array itself";
            return Err(section.problem(keys::MM_PER_LEVEL.name, found, expected, "remove it"));
        }
        _ => {
            let found = format!("\"{name}\"");
            let expected = "a name that ends with .png or .npy";
            return Err(section.problem(keys::FILE.name, &found, expected, "convert the file"));
        }
    };
    read.map_err(|error| {
        let found = format!("{} in {name}", error.found);
        section.problem(keys::FILE.name, &found, error.expected, error.advice)
    })
}
