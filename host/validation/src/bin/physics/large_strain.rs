//! The linear layer against large-strain finite elements: a 12 mm sphere on the default gel, stuck.

use gripline_simulation::Gel;
use gripline_validation::finite_elements::{Comparison, Ogden, Setting, Surface, compare_pressed_sphere};

use crate::chart::{Chart, Curve, Pictures};
use crate::failure::Failure;
use crate::report::{Bound, Report};

const INDENTATIONS: [f64; 4] = [BOUNDED, 0.1, 0.2, 0.3];
/// Indentation that is bounded.
const BOUNDED: f64 = 0.05;
/// Elements along the middle taxel, at the bounded indentation and beyond: what a second core does meanwhile. The
/// example `finite_elements` tells the meshes' error.
const FINENESS: [usize; 2] = [8, 4];

/// Presses the block; beside other sections. When `quick`, to the bounded indentation on the coarse mesh only.
pub(crate) fn compare(quick: bool) -> Result<Vec<Comparison>, Failure> {
    let gel = Gel::default();
    let [fine, coarse] = FINENESS.map(|fineness| {
        Ok::<_, Failure>(Setting {
            gel,
            material: Ogden::of_gel(&gel)?,
            radius_mm: 12.0,
            surface: Surface::Stuck,
            fineness,
        })
    });
    if quick {
        return Ok(compare_pressed_sphere(
            &coarse?,
            &INDENTATIONS[..1],
            &mut |_, _| {},
        )?);
    }
    let mut found = compare_pressed_sphere(&fine?, &INDENTATIONS[..1], &mut |_, _| {})?;
    found.extend(compare_pressed_sphere(
        &coarse?,
        &INDENTATIONS[1..],
        &mut |_, _| {},
    )?);
    Ok(found)
}

pub(crate) fn rows(found: &[Comparison], report: &mut Report, pictures: &Pictures) -> Result<(), Failure> {
    let keys = [
        [
            "finite_elements_force_5",
            "finite_elements_map_5",
            "finite_elements_whole_map_5",
        ],
        [
            "finite_elements_force_10",
            "finite_elements_map_10",
            "finite_elements_whole_map_10",
        ],
        [
            "finite_elements_force_20",
            "finite_elements_map_20",
            "finite_elements_whole_map_20",
        ],
        [
            "finite_elements_force_30",
            "finite_elements_map_30",
            "finite_elements_whole_map_30",
        ],
    ];
    for (comparison, keys) in found.iter().zip(keys) {
        let percent = 100.0 * comparison.indentation;
        let bound = if comparison.indentation < 1.1 * BOUNDED {
            Bound::AtMost(5.0)
        } else {
            Bound::Reported
        };
        report.row(
            keys[0],
            &format!("force of the linear layer at {percent:.0} % indentation"),
            "finite elements, Ogden, sphere stuck",
            bound,
            (
                100.0 * (comparison.force_n.linear / comparison.force_n.large_strain - 1.0).abs(),
                "%",
            ),
            &format!(
                "{:.2} N against {:.2} N",
                comparison.force_n.linear, comparison.force_n.large_strain
            ),
        );
        report.row(
            keys[1],
            &format!("normal force map at the same force, {percent:.0} %"),
            "finite elements",
            bound,
            (100.0 * comparison.normal_map_difference, "%"),
            "",
        );
        report.row(
            keys[2],
            &format!("force map with shear at the same force, {percent:.0} %"),
            "finite elements",
            bound,
            (100.0 * comparison.whole_map_difference, "%"),
            &format!(
                "with pressure straight down: {:.1} %",
                100.0 * comparison.straight_map_difference
            ),
        );
    }
    let curve = |pick: &dyn Fn(&Comparison) -> f64| -> Vec<(f64, f64)> {
        found.iter().map(|c| (100.0 * c.indentation, pick(c))).collect()
    };
    pictures.charts(
        "finite-elements",
        &[
            Chart {
                title: "Force of a 12 mm sphere on the 6 mm layer",
                rising: true,
                x: "indentation, % of the layer",
                y: "force, N",
                x_range: [0.0, 31.0],
                y_range: [
                    0.0,
                    found.iter().map(|c| c.force_n.large_strain).fold(0.0, f64::max) * 1.1,
                ],
                curves: vec![
                    Curve::both(
                        "finite elements, large strain",
                        1,
                        curve(&|c| c.force_n.large_strain),
                    ),
                    Curve::both("linear layer", 0, curve(&|c| c.force_n.linear)),
                ],
            },
            Chart {
                title: "Force map of the linear layer at equal force",
                rising: false,
                x: "indentation, % of the layer",
                y: "difference (L2), %",
                x_range: [0.0, 31.0],
                y_range: [
                    0.0,
                    100.0
                        * found
                            .iter()
                            .map(|c| c.straight_map_difference)
                            .fold(0.0, f64::max)
                        * 1.5,
                ],
                curves: vec![
                    Curve::both("normal", 0, curve(&|c| 100.0 * c.normal_map_difference)),
                    Curve::both("with shear", 1, curve(&|c| 100.0 * c.whole_map_difference)),
                    Curve::both(
                        "with shear, pressure straight down",
                        2,
                        curve(&|c| 100.0 * c.straight_map_difference),
                    ),
                ],
            },
        ],
    )
}
