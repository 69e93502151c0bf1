//! Random paths of every shape on mounts that give way: their steps, with those of all other sections, are held to
//! equilibrium, complementarity and Coulomb's law.

use gripline_simulation::constants::GEL_THICKNESS_MM;
use gripline_simulation::contact_world::{
    Drive, Mount, Press, TRAINING_SHAPES, UNSEEN_SHAPES, production_cells,
};
use gripline_simulation::{Gel, SimulationError};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

use crate::failure::Failure;
use crate::report::{Bound, Report};
use crate::world::World;

const STEPS: usize = 25;

/// Walks every shape along two random paths; along one when quick.
pub(crate) fn walk(world: &World) -> Result<(), Failure> {
    let mut random = Pcg64::new(2026, 17);
    let mut uniform =
        |from: f64, to: f64| from + (to - from) * (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    for shape in TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES) {
        for _ in 0..if world.quick { 1 } else { 2 } {
            let peak = uniform(0.3_f64.ln(), 10.0_f64.ln()).exp();
            let mount = Mount {
                shift_mm_per_n: uniform(0.05, 1.5),
                turn_rad_per_nmm: uniform(0.005, 0.05),
            };
            let cells = production_cells(peak);
            let mut contact = world.rubbing(&Gel::default(), cells, shape, mount, uniform(0.3, 1.0))?;
            let mut at_mm = [uniform(-2.0, 2.0), uniform(-2.0, 2.0)];
            let mut turn_rad = uniform(-3.0, 3.0);
            for step in 0..STEPS {
                at_mm = at_mm.map(|at| (at + uniform(-0.6, 0.6)).clamp(-3.0, 3.0));
                turn_rad += uniform(-0.06, 0.06);
                let force = peak * f64::min(1.0, (step + 1) as f64 / 6.0) * uniform(0.5, 1.0);
                let order = Drive {
                    press: Press::Force(force),
                    at_mm,
                    turn_rad,
                    tilt_rad: [uniform(-0.02, 0.02), uniform(-0.02, 0.02)],
                };
                match contact.step(order) {
                    Ok(truth) if truth.pose().depth_mm > GEL_THICKNESS_MM => break,
                    // Counted in the ledger; the walk goes on from where it was.
                    Ok(_) | Err(SimulationError::ContactUnsolved { .. }) => {}
                    // A path may lead over the edge: refused, and it ends there.
                    Err(SimulationError::OffSurface { .. }) => break,
                    Err(error) => return Err(error.into()),
                }
            }
        }
    }
    Ok(())
}

/// What all steps of the run came to.
pub(crate) fn rows(world: &World, report: &mut Report) {
    let ledger = world.ledger();
    let all = format!("{} steps", ledger.steps);
    report.row(
        "equilibrium_force",
        "sum of taxel forces, every step of every section",
        "applied load, share of the normal force",
        Bound::AtMost(0.1),
        (100.0 * ledger.force, "%"),
        &all,
    );
    report.row(
        "equilibrium_moment",
        "moment of the tractions, every step",
        "applied moment, share of the most that friction holds",
        Bound::AtMost(0.1),
        (100.0 * ledger.moment, "%"),
        "",
    );
    report.row(
        "equilibrium_taxel_moment",
        "moment by taxel centres, as a detector forms it",
        "moment of the tractions, share of the most that friction holds",
        Bound::Reported,
        (100.0 * ledger.taxel_moment, "%"),
        "1.6 mm taxels",
    );
    report.row(
        "residual_gap",
        "complementarity: gap in contact or penetration outside, worst step",
        "deepest indentation",
        Bound::AtMost(1e-4),
        (ledger.gap, ""),
        &all,
    );
    report.row(
        "residual_friction",
        "Coulomb's law: residual of the shear, worst step",
        "friction bound",
        Bound::AtMost(1e-4),
        (ledger.friction, ""),
        &all,
    );
    report.row(
        "unsolved",
        "solves that did not converge (refused, kept out of data)",
        "count",
        Bound::Reported,
        (ledger.unsolved as f64, ""),
        &all,
    );
}
