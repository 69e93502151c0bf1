//! Indenter and solved pressure as numbers for another program to check (`checks/tamaas_pressure.py`):
//! `half_space_pressure "two spheres"`. A half-space of ν = ½ and E = 0.4 MPa, 3 N, 80 x 80 cells of 0.4 mm;
//! one line per cell, row by row: height in mm, pressure in MPa.

use std::io::Write;
use std::sync::Arc;

use gripline_simulation::Gel;
use gripline_simulation::contact_world::{
    Contact, Drive, HeightMap, Mount, Press, Skin, TRAINING_SHAPES, UNSEEN_SHAPES,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let name = std::env::args().nth(1).unwrap_or_default();
    let shape = TRAINING_SHAPES
        .into_iter()
        .chain(UNSEEN_SHAPES)
        .find(|shape| shape.name() == name)
        .ok_or_else(|| {
            format!("shape is {name:?}, expected the name of a built-in one, such as \"cross\"")
        })?;
    let gel = Gel {
        thickness_mm: 1e9,
        young_mpa: 0.4,
        poisson: 0.5,
    };
    let skin = Arc::new(Skin::new(&gel, 80)?);
    let mut contact = Contact::new(skin, Arc::new(shape), 0.65, Mount::default())?;
    let at_mm = [0.3, -0.1];
    let truth = contact.step(Drive {
        press: Press::Force(3.0),
        at_mm,
        turn_rad: 0.0,
        tilt_rad: [0.0; 2],
    })?;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for (cell, pressure) in truth.pressure_mpa().iter().enumerate() {
        let [x, y] = truth.place_mm(cell);
        let height = shape.height_mm([x - at_mm[0], y - at_mm[1]]);
        writeln!(out, "{height} {pressure}")?;
    }
    out.flush()?;
    Ok(())
}
