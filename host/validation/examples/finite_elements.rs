//! The linear layer against large-strain finite elements, a sphere on the default gel (8 and 12 unless given):
//! `cargo run --release -p gripline-validation --example finite_elements -- [FINENESS
//! [RADIUS_MM]]`. One-term rubber tells how much of the difference is the material's own stiffening.

use std::time::Instant;

use gripline_simulation::Gel;
use gripline_validation::finite_elements::{Comparison, Ogden, Setting, Surface, compare_pressed_sphere};

const INDENTATIONS: [f64; 4] = [0.05, 0.1, 0.2, 0.3];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let fineness = arguments.next().map_or(Ok(8), |text| text.parse())?;
    let radius_mm = arguments.next().map_or(Ok(12.0), |text| text.parse())?;
    let gel = Gel::default();
    let (ogden, neo_hooke) = (Ogden::of_gel(&gel)?, Ogden::neo_hooke(&gel)?);
    for (name, material, surface) in [
        ("Ogden, stuck", ogden, Surface::Stuck),
        ("Ogden, frictionless", ogden, Surface::Frictionless),
        ("neo-Hooke, stuck", neo_hooke, Surface::Stuck),
    ] {
        let setting = Setting {
            gel,
            material,
            radius_mm,
            surface,
            fineness,
        };
        let start = Instant::now();
        let seconds = || start.elapsed().as_secs_f64();
        let found = compare_pressed_sphere(&setting, &INDENTATIONS, &mut |share, next| {
            eprintln!("{:3.0} % {:5.0} s {next}", 100.0 * share, seconds());
        })?;
        println!(
            "{name}: {radius_mm} mm sphere, fineness {fineness}, {:.0} s",
            seconds()
        );
        for comparison in &found {
            print(comparison);
        }
    }
    Ok(())
}

fn print(c: &Comparison) {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mesh = |change: Option<f64>| change.map_or("not known".to_owned(), percent);
    println!(
        "{} of the layer: {:.3} N, {:.3} of the linear layer's; half the mesh changes it by {}",
        percent(c.indentation),
        c.force_n.large_strain,
        c.force_n.ratio(),
        mesh(c.force_mesh_change),
    );
    println!(
        "  at this force: depth {:.3}, contact radius {:.3}, peak pressure {:.3}, drag stiffness {:.3} of the linear's \
         (half the mesh {})",
        c.depth_at_force_mm.ratio(),
        c.contact_radius_mm.ratio(),
        c.peak_pressure_mpa.ratio(),
        c.drag_n_per_mm.ratio(),
        mesh(c.drag_mesh_change),
    );
    println!(
        "  maps differ by {} (normal; half the mesh {}), {} (with shear), {} (pressure straight down); penetration {:.0e}",
        percent(c.normal_map_difference),
        mesh(c.map_mesh_change),
        percent(c.whole_map_difference),
        percent(c.straight_map_difference),
        c.penetration,
    );
    for d in c.displacements {
        println!(
            "  displacements {} mm deep: rms {:.4} mm, differ by {}; the linear ones times {:.3}: {}",
            d.depth_mm,
            d.rms_mm,
            percent(d.difference),
            d.scale,
            percent(d.difference_scaled),
        );
    }
}
