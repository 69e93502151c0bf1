//! Pictures of what a contact looks like: tractions, slip zones growing from the rim, images at rest and under load.

use gripline_simulation::contact_world::{
    CellState, Mount, TRAINING_SHAPES, Truth, UNSEEN_SHAPES, production_cells,
};
use gripline_simulation::{Fingertip, FingertipParams, Gel, Image};

use crate::chart::{Panel, Pictures, Scale};
use crate::failure::Failure;
use crate::world::{World, drive};

/// The middle of the gel that is shown, mm from the middle to the edge.
const HALF_MM: f64 = 8.0;

/// Side of the part in the middle of the crop that is shown, pixel by pixel.
const SHOWN: usize = 220;

/// A panel of the middle of the gel, one value a cell.
fn panel(truth: &Truth, title: &str, scale: Scale, value: impl Fn(usize) -> f64) -> Panel {
    let cells = truth.cells();
    let first = (0..cells).find(|i| truth.place_mm(*i)[0] > -HALF_MM).unwrap_or(0);
    let side = cells - 2 * first;
    let values = (0..side * side)
        .map(|i| value((first + i / side) * cells + first + i % side))
        .collect();
    Panel {
        title: title.to_owned(),
        side,
        half_mm: HALF_MM,
        values,
        scale,
    }
}

pub(crate) fn run(world: &World, pictures: &Pictures) -> Result<(), Failure> {
    let gel = Gel::default();
    let force_n = 3.0;
    let cells = production_cells(force_n);

    // Tractions of four shapes, pulled into partial slip.
    let (mut pressures, mut shears) = (Vec::new(), Vec::new());
    for shape in [
        TRAINING_SHAPES[0],
        TRAINING_SHAPES[4],
        UNSEEN_SHAPES[3],
        UNSEEN_SHAPES[4],
    ] {
        let mut contact = world.contact(&gel, cells, shape, Mount::default())?;
        contact.go(drive(force_n, [0.0; 2], 0.0), 8)?;
        let truth = contact.go(drive(force_n, [0.3, 0.1], 0.0), 4)?;
        let kpa = |cell: usize| 1e3 * truth.pressure_mpa()[cell];
        let max = (0..cells * cells).map(kpa).fold(0.0, f64::max);
        pressures.push(panel(
            truth,
            &format!("{}: pressure, kPa", shape.name()),
            Scale::Heat(max),
            kpa,
        ));
        let shear = |cell: usize| 1e3 * truth.shear_mpa(cell)[0];
        let max = (0..cells * cells).map(|c| shear(c).abs()).fold(0.0, f64::max);
        shears.push(panel(
            truth,
            &format!("{}: shear along x, kPa", shape.name()),
            Scale::Signed(max),
            shear,
        ));
    }
    pictures.panels("tractions", &[pressures, shears])?;

    // Slip from the rim: a pull and a twist grow.
    let mut rows = Vec::new();
    for twisted in [false, true] {
        let mut contact = world.contact(&gel, cells, TRAINING_SHAPES[0], Mount::default())?;
        contact.go(drive(force_n, [0.0; 2], 0.0), 8)?;
        let mut row = Vec::new();
        for part in [0.0, 0.3, 0.6, 0.85, 1.3] {
            let order = if twisted {
                drive(force_n, [0.0; 2], 0.32 * part)
            } else {
                drive(force_n, [0.75 * part, 0.0], 0.0)
            };
            let truth = contact.go(order, if part > 0.0 { 4 } else { 1 })?;
            let ratio = truth.stick_ratio().unwrap_or(f64::NAN);
            let title = if twisted {
                format!("turned {:.2} rad, SR {ratio:.2}", 0.32 * part)
            } else {
                format!("pulled {:.2} mm, SR {ratio:.2}", 0.75 * part)
            };
            row.push(panel(truth, &title, Scale::Slip, |cell| {
                match truth.states()[cell] {
                    CellState::Free => 0.0,
                    CellState::Stick => 1.0,
                    CellState::Slip => 2.0,
                }
            }));
        }
        rows.push(row);
    }
    pictures.panels("slip-zones", &rows)?;

    // What the camera sees: at rest, pressed and pulled, and the difference, noise left out.
    let mut contact = world.contact(&gel, production_cells(5.0), TRAINING_SHAPES[0], Mount::default())?;
    contact.go(drive(5.0, [0.0; 2], 0.0), 8)?;
    let truth = contact.go(drive(5.0, [0.6, 0.3], 0.0), 4)?;
    let params = FingertipParams {
        noise_levels: 0.0,
        ..FingertipParams::default()
    };
    let mut fingertip = Fingertip::new(1, params)?;
    let rest = fingertip.rest_image();
    let mut now = Image::crop();
    fingertip.render(truth, &mut now);
    let middle = |pixel: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let first = (rest.width - SHOWN) / 2 * (rest.width + 1);
        (0..SHOWN * SHOWN)
            .map(|i| pixel(first + i / SHOWN * rest.width + i % SHOWN))
            .collect()
    };
    let image = |title: &str, scale: Scale, values: Vec<f64>| Panel {
        title: title.to_owned(),
        side: SHOWN,
        half_mm: 0.0,
        values,
        scale,
    };
    pictures.panels(
        "images",
        &[vec![
            image(
                "at rest, middle half",
                Scale::Grey,
                middle(&|i| f64::from(rest.pixels[i])),
            ),
            image(
                "12 mm sphere, 5 N, pulled",
                Scale::Grey,
                middle(&|i| f64::from(now.pixels[i])),
            ),
            image(
                "difference, grey levels",
                Scale::Signed(120.0),
                middle(&|i| f64::from(now.pixels[i]) - f64::from(rest.pixels[i]))
                    .into_iter()
                    .map(|d| (d / 24.0).round() * 24.0)
                    .collect(),
            ),
        ]],
    )
}
