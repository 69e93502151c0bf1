//! The linear layer against large-strain finite elements, a 12 mm sphere on the default gel:
//! `cargo run --release -p gripline-simulation --features finite-elements --example finite_elements -- [FINENESS]`.

use std::time::Instant;

use gripline_simulation::Gel;
use gripline_simulation::finite_elements::{Ogden, Setting, Surface, compare_pressed_sphere};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let fineness = std::env::args().nth(1).map_or(Ok(8), |text| text.parse())?;
    let which = std::env::args().nth(2);
    let gel = Gel::default();
    let (ogden, neo_hooke) = (Ogden::of_gel(&gel)?, Ogden::neo_hooke(&gel)?);
    for (name, material, surface) in [
        ("Ogden, frictionless", ogden, Surface::Frictionless),
        ("Ogden, stuck", ogden, Surface::Stuck),
        ("neo-Hooke, frictionless", neo_hooke, Surface::Frictionless),
    ] {
        if which.as_ref().is_some_and(|w| !name.contains(w.as_str())) {
            continue;
        }
        let setting = Setting {
            gel,
            material,
            radius_mm: 12.0,
            surface,
            fineness,
        };
        let start = Instant::now();
        let found = compare_pressed_sphere(&setting, &[0.05, 0.1, 0.15, 0.2, 0.3], &mut |share, text| {
            eprintln!(
                "{:3.0} % {:6.1} s {text}",
                100.0 * share,
                start.elapsed().as_secs_f64()
            );
        })?;
        println!(
            "{name}, fineness {fineness}, {:.1} s",
            start.elapsed().as_secs_f64()
        );
        for c in found {
            println!(
                "{:4.0} %  force {:.4} N / linear {:.4} = {:.4} (mesh {:.4})  at equal force: depth {:.4}, radius {:.3} {:.3} {:.4}, \
                 peak {:.4} {:.4}, normal map {:.4} (mesh {:.4}), whole map {:.4}, turned {:.4}, drag {:.4} {:.4} {:.4}; penetration {:.1e}",
                100.0 * c.indentation,
                c.force_n.large_strain,
                c.force_n.linear,
                c.force_n.ratio(),
                c.force_mesh_change.unwrap_or(f64::NAN),
                c.depth_at_force_mm.ratio(),
                c.contact_radius_mm.large_strain,
                c.contact_radius_mm.linear,
                c.contact_radius_mm.ratio(),
                c.peak_pressure_mpa.large_strain,
                c.peak_pressure_mpa.ratio(),
                c.normal_map_difference,
                c.map_mesh_change.unwrap_or(f64::NAN),
                c.whole_map_difference,
                c.turned_map_difference,
                c.drag_n_per_mm.large_strain,
                c.drag_n_per_mm.linear,
                c.drag_n_per_mm.ratio(),
                c.penetration,
            );
            for d in c.displacements {
                println!(
                    "        {} mm deep: rms {:.4} mm, difference {:.4}, scaled by {:.4}: {:.4}",
                    d.depth_mm, d.rms_mm, d.difference, d.scale, d.difference_scaled
                );
            }
        }
    }
    Ok(())
}
