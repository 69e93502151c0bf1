//! The production grid against one twice as fine, over every shape and the loads of training, pressed and pulled.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use gripline_simulation::contact_world::{Mount, Shape, TRAINING_SHAPES, UNSEEN_SHAPES, production_cells};
use gripline_simulation::{ForceMap, Gel, SimulationError};

use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::THREADS;
use crate::world::{World, difference, drive};

/// Every so many cases are taken when quick: no common divisor with the number of loads.
const QUICK_STRIDE: usize = 6;
const LOADS_N: [f64; 5] = [0.3, 1.0, 3.0, 6.0, 10.0];

fn maps(world: &World, shape: Shape, force_n: f64, cells: usize) -> Result<[ForceMap; 2], SimulationError> {
    let mut contact = world.contact(&Gel::default(), cells, shape, Mount::default())?;
    let pressed = contact.go(drive(force_n, [0.25, -0.1], 0.0), 8)?.force_map();
    let pulled = contact.go(drive(force_n, [0.57, -0.1], 0.03), 4)?.force_map();
    Ok([pressed, pulled])
}

pub(crate) fn run(world: &World, report: &mut Report) -> Result<(), Failure> {
    let cases: Vec<(Shape, f64)> = TRAINING_SHAPES
        .into_iter()
        .chain(UNSEEN_SHAPES)
        .flat_map(|shape| LOADS_N.map(|force| (shape, force)))
        .enumerate()
        // Quick: every load and shape, but not every pair of them.
        .filter(|(i, _)| !world.quick || i % QUICK_STRIDE == QUICK_STRIDE - 1)
        .map(|(_, case)| case)
        .collect();
    let some = format!("{} cases of 12 shapes at 0.3, 1, 3, 6, 10 N", cases.len());
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                while let Some(&(shape, force)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let cells = production_cells(force);
                    let both = maps(world, shape, force, cells)
                        .and_then(|own| Ok((own, maps(world, shape, force, 2 * cells)?)));
                    if let Ok(mut found) = found.lock() {
                        found.push((shape, force, both));
                    }
                }
            });
        }
    });
    let mut worst = Worst::default();
    let mut squares = 0.0;
    let found = found
        .into_inner()
        .map_err(|_| "a thread of the grid section panicked")?;
    let count = 2 * found.len();
    for (shape, force, both) in found {
        let (own, fine) = both?;
        for k in 0..2 {
            let off = 100.0 * difference(&own[k], &fine[k]);
            squares += off * off;
            worst.see(off, || {
                let load = ["pressed", "pulled"][k];
                format!(
                    "{} {load}, {force} N, {} cells",
                    shape.name(),
                    production_cells(force)
                )
            });
        }
    }
    report.row(
        "production_grid",
        &format!("force map (L2), {some}, worst"),
        "a grid twice as fine",
        Bound::AtMost(3.0),
        (worst.value, "%"),
        &worst.at,
    );
    report.row(
        "production_grid_mean",
        "the same, root mean square",
        "a grid twice as fine",
        Bound::Reported,
        ((squares / count as f64).sqrt(), "%"),
        "",
    );
    Ok(())
}
