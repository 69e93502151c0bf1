//! The linear layer of `contact_world` against the large-strain block, for a pressed sphere: at equal
//! depth the force, at equal force everything a sensor or its particles would see. Units: mm, N, MPa.

use std::sync::Arc;

use super::error::{FiniteElementError, checked};
use super::ogden::Ogden;
use super::press::{SpherePress, Surface};
use gripline_simulation::ForceMap;
use gripline_simulation::Gel;
use gripline_simulation::contact_world::{Contact, Drive, GelSurface, Mount, Press, Shape, Truth};
use gripline_simulation::{DisplacementField, LayerKernels, MaterialPoint};

/// Depths at which the particles' displacements are compared, mm.
pub const COMPARED_DEPTHS_MM: [f64; 3] = [1.0, 3.0, 5.0];
/// Displacements are compared within this distance of the middle, mm.
const COMPARED_RADIUS_MM: f64 = 10.0;
/// Distance of the compared points, mm.
const COMPARED_PITCH_MM: f64 = 0.5;
/// Cells of the contact world's grid: its finest.
const CELLS: usize = 160;
/// Load steps of the contact world's press.
const STEPS: u32 = 8;
/// Without friction in both; the contact world wants a number above 0.
const FRICTIONLESS: f64 = 1e-6;
/// So much that all but the rim sticks; the contact world's residual is a share of it.
const STUCK: f64 = 3.0;
/// Shift that measures the drag stiffness, share of the depth.
const DRAG_SHARE: f64 = 0.02;
/// The peak pressure is the mean within this share of the contact radius.
const PEAK_SHARE: f64 = 0.25;

/// A figure of the large-strain block and of the linear layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Both {
    /// Finite elements, large strain.
    pub large_strain: f64,
    /// Contact world, linear.
    pub linear: f64,
}

impl Both {
    /// Large strain over linear.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.large_strain / self.linear
    }
}

/// Displacements at one depth, at equal force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacements {
    /// Depth of the particles, mm.
    pub depth_mm: f64,
    /// Root mean square of the large-strain ones, mm.
    pub rms_mm: f64,
    /// Root mean square of the difference over that of the large-strain ones.
    pub difference: f64,
    /// Factor on the linear ones that fits best.
    pub scale: f64,
    /// Difference that is left with that factor.
    pub difference_scaled: f64,
}

/// One indentation.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Depth of the sphere over the layer's thickness.
    pub indentation: f64,
    /// Depth of the sphere, mm.
    pub depth_mm: f64,
    /// Force at this depth, N.
    pub force_n: Both,
    /// Depth at the large-strain force, mm.
    pub depth_at_force_mm: Both,
    /// Contact radius at the large-strain force (second moment of the pressure), mm.
    pub contact_radius_mm: Both,
    /// Mean pressure within a quarter of the contact radius at the large-strain force, MPa.
    pub peak_pressure_mpa: Both,
    /// Difference of the normal force maps at equal force, L2 over the linear one's.
    pub normal_map_difference: f64,
    /// The same with the shear components.
    pub whole_map_difference: f64,
    /// The same for a linear layer whose pressure acts straight down ([`Contact::vertical_pressure`]).
    pub straight_map_difference: f64,
    /// Displacements at [`COMPARED_DEPTHS_MM`], at equal force.
    pub displacements: [Displacements; 3],
    /// Stiffness against dragging the stuck sphere at equal force, N/mm.
    pub drag_n_per_mm: Both,
    /// Largest penetration left at the contact over the depth.
    pub penetration: f64,
    /// Change of the force from the mesh of half the fineness, share; the error left is about a third of it.
    pub force_mesh_change: Option<f64>,
    /// Change of the drag stiffness from the mesh of half the fineness, share; its error is about as large, since
    /// the rim is known to half an element.
    pub drag_mesh_change: Option<f64>,
    /// Change of the normal map from the mesh of half the fineness, L2 share.
    pub map_mesh_change: Option<f64>,
}

/// What to compare.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// The layer; small strain is the same on both sides.
    pub gel: Gel,
    /// The large-strain side's material.
    pub material: Ogden,
    /// Radius of the sphere, mm.
    pub radius_mm: f64,
    /// What the gel does on the sphere, on both sides.
    pub surface: Surface,
    /// Elements along the middle taxel: 4 in seconds, 8 for figures, or 12 or 16. With 8 and 16 the mesh of half
    /// of it runs too and tells the mesh's error.
    pub fineness: usize,
}

/// Presses to each of `indentations` (share of the thickness, rising) and compares there. `progress` is told
/// the share of the work done and what comes next.
///
/// # Errors
/// A setting outside its range, indentations that do not rise, or a solve that does not settle.
pub fn compare_pressed_sphere(
    setting: &Setting,
    indentations: &[f64],
    progress: &mut dyn FnMut(f64, &str),
) -> Result<Vec<Comparison>, FiniteElementError> {
    let mut before = 0.0;
    for indentation in indentations {
        checked(
            "indentation",
            *indentation,
            "rising, above 0 and below 0.5",
            *indentation > before && *indentation < 0.5,
        )?;
        before = *indentation;
    }
    let Setting {
        gel,
        material,
        radius_mm,
        surface,
        fineness,
    } = *setting;
    let gel_surface = Arc::new(GelSurface::new(&gel, CELLS)?);
    let kernels = Arc::new(LayerKernels::new(&gel));
    let mut press = SpherePress::new(&gel, material, radius_mm, surface, fineness)?;
    let mut coarse = if fineness.is_multiple_of(8) {
        Some(SpherePress::new(
            &gel,
            material,
            radius_mm,
            surface,
            fineness / 2,
        )?)
    } else {
        None
    };
    let mut found = Vec::with_capacity(indentations.len());
    for indentation in indentations {
        let share = press.depth_mm() / (before * gel.thickness_mm);
        progress(
            share,
            &format!("press to {:.0} % of the layer", 100.0 * indentation),
        );
        let depth_mm = indentation * gel.thickness_mm;
        press.press_to(depth_mm)?;
        if let Some(coarse) = &mut coarse {
            coarse.press_to(depth_mm)?;
        }
        found.push(compare(
            &mut press,
            coarse.as_mut(),
            &gel_surface,
            &kernels,
            setting,
        )?);
    }
    progress(1.0, "done");
    Ok(found)
}

fn compare(
    press: &mut SpherePress,
    coarse: Option<&mut SpherePress>,
    gel_surface: &Arc<GelSurface>,
    kernels: &Arc<LayerKernels>,
    setting: &Setting,
) -> Result<Comparison, FiniteElementError> {
    let radius_mm = setting.radius_mm;
    let friction = match setting.surface {
        Surface::Frictionless => FRICTIONLESS,
        Surface::Stuck => STUCK,
    };
    let depth_mm = press.depth_mm();
    let drag_mm = DRAG_SHARE * depth_mm;
    let linear = |friction: f64, target: Press, drag: bool, vertical_pressure: bool| {
        let sphere = Arc::new(Shape::Sphere { radius_mm });
        let mut contact = Contact::new(Arc::clone(gel_surface), sphere, friction, Mount::default())?;
        if vertical_pressure {
            contact = contact.vertical_pressure();
        }
        let drive = Drive {
            press: target,
            at_mm: [0.0; 2],
            turn_rad: 0.0,
            tilt_rad: [0.0; 2],
        };
        contact.go_to(drive, STEPS)?;
        if drag {
            contact.step(Drive {
                at_mm: [drag_mm, 0.0],
                ..drive
            })?;
        }
        Ok::<Truth, FiniteElementError>(contact.truth().clone())
    };
    let force_n = press.force_n();
    let same_depth = linear(friction, Press::Depth(depth_mm), false, false)?;
    let same_force = linear(friction, Press::Force(force_n), false, false)?;
    let stuck = linear(STUCK, Press::Force(force_n), true, false)?;

    let map = press.force_map();
    let wide = |map: &ForceMap| -> Vec<[f64; 3]> { map.iter().map(|taxel| taxel.map(f64::from)).collect() };
    let linear_map = wide(&same_force.force_map());
    let straight_map = wide(&linear(friction, Press::Force(force_n), false, true)?.force_map());
    let drag_n_per_mm = Both {
        large_strain: press.drag_stiffness_n_per_mm()?,
        linear: stuck.force_n()[0] / drag_mm,
    };
    let [force_mesh_change, drag_mesh_change, map_mesh_change] = match coarse {
        Some(coarse) => {
            let drag = coarse.drag_stiffness_n_per_mm()?;
            [
                Some((coarse.force_n() / force_n - 1.0).abs()),
                Some((drag / drag_n_per_mm.large_strain - 1.0).abs()),
                Some(map_difference(&coarse.force_map(), &map, 2..3)),
            ]
        }
        None => [None; 3],
    };
    let radius = Both {
        large_strain: press.contact_radius_mm(),
        linear: contact_radius_mm(&same_force),
    };
    Ok(Comparison {
        indentation: depth_mm / setting.gel.thickness_mm,
        depth_mm,
        force_n: Both {
            large_strain: force_n,
            linear: same_depth.force_n()[2],
        },
        depth_at_force_mm: Both {
            large_strain: depth_mm,
            linear: same_force.pose().depth_mm,
        },
        contact_radius_mm: radius,
        peak_pressure_mpa: Both {
            large_strain: press.pressure_within_mpa(PEAK_SHARE * radius.large_strain),
            linear: pressure_within_mpa(&same_force, PEAK_SHARE * radius.linear),
        },
        normal_map_difference: map_difference(&map, &linear_map, 2..3),
        whole_map_difference: map_difference(&map, &linear_map, 0..3),
        straight_map_difference: map_difference(&map, &straight_map, 0..3),
        displacements: displacements(press, &same_force, kernels),
        drag_n_per_mm,
        penetration: press.penetration_mm() / depth_mm,
        force_mesh_change,
        drag_mesh_change,
        map_mesh_change,
    })
}

/// L2 of the difference over L2 of `reference`, over these components.
fn map_difference(map: &[[f64; 3]], reference: &[[f64; 3]], axes: std::ops::Range<usize>) -> f64 {
    let (mut off, mut size) = (0.0, 0.0);
    for (a, b) in map.iter().zip(reference) {
        for axis in axes.clone() {
            off += (a[axis] - b[axis]).powi(2);
            size += b[axis] * b[axis];
        }
    }
    (off / size).sqrt()
}

/// As [`SpherePress::contact_radius_mm`].
fn contact_radius_mm(truth: &Truth) -> f64 {
    let (mut sum, mut moment) = (0.0, 0.0);
    for (cell, pressure) in truth.pressure_mpa().iter().enumerate() {
        let [x, y] = truth.place_mm(cell);
        sum += pressure;
        moment += pressure * (x * x + y * y);
    }
    (2.5 * moment / sum).sqrt()
}

/// As [`SpherePress::pressure_within_mpa`].
fn pressure_within_mpa(truth: &Truth, radius_mm: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (cell, pressure) in truth.pressure_mpa().iter().enumerate() {
        let [x, y] = truth.place_mm(cell);
        if x * x + y * y <= radius_mm * radius_mm {
            sum += pressure;
            count += 1.0;
        }
    }
    sum / count
}

fn displacements(press: &SpherePress, truth: &Truth, kernels: &Arc<LayerKernels>) -> [Displacements; 3] {
    let mut field = DisplacementField::new(Arc::clone(kernels));
    field.load(truth);
    let steps = (COMPARED_RADIUS_MM / COMPARED_PITCH_MM) as usize;
    COMPARED_DEPTHS_MM.map(|depth_mm| {
        let (mut large, mut small, mut mixed, mut count) = (0.0, 0.0, 0.0, 0.0);
        for row in 0..=steps {
            for column in 0..=steps {
                let [x, y] = [column, row].map(|i| i as f64 * COMPARED_PITCH_MM);
                if x * x + y * y > COMPARED_RADIUS_MM * COMPARED_RADIUS_MM {
                    continue;
                }
                let moved = press.displacement_mm([x, y, depth_mm]);
                let linear = field.at(&MaterialPoint::new([x, y], depth_mm)).map(f64::from);
                count += 1.0;
                for (a, b) in moved.into_iter().zip(linear) {
                    large += a * a;
                    small += b * b;
                    mixed += a * b;
                }
            }
        }
        let scale = mixed / small;
        Displacements {
            depth_mm,
            rms_mm: (large / count).sqrt(),
            difference: ((large - 2.0 * mixed + small) / large).sqrt(),
            scale,
            difference_scaled: ((large - scale * mixed) / large).max(0.0).sqrt(),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_simulation::constants::TAXELS;

    fn setting(radius_mm: f64, surface: Surface) -> Setting {
        let gel = Gel::default();
        Setting {
            gel,
            material: Ogden::of_gel(&gel).unwrap(),
            radius_mm,
            surface,
            fineness: 4,
        }
    }

    #[test]
    fn a_large_sphere_pressed_a_little_finds_the_linear_layer() {
        // Slopes of 5 % at most: what differs is the mesh.
        for surface in [Surface::Frictionless, Surface::Stuck] {
            let found = compare_pressed_sphere(&setting(60.0, surface), &[0.02], &mut |_, _| {}).unwrap();
            let c = &found[0];
            assert!((c.force_n.ratio() - 1.0).abs() < 0.015, "force {:?}", c.force_n);
            assert!(
                (c.contact_radius_mm.ratio() - 1.0).abs() < 0.015,
                "radius {:?}",
                c.contact_radius_mm
            );
            assert!(c.whole_map_difference < 0.04, "map {}", c.whole_map_difference);
            assert!(c.displacements[0].difference < 0.04, "{:?}", c.displacements[0]);
            assert!(
                (c.drag_n_per_mm.ratio() - 1.0).abs() < 0.1,
                "drag {:?}",
                c.drag_n_per_mm
            );
            assert!(c.penetration < 2e-5, "{}", c.penetration);
        }
    }

    #[test]
    fn at_five_percent_of_the_layer_the_linear_one_is_within_five_percent() {
        let found = compare_pressed_sphere(&setting(12.0, Surface::Stuck), &[0.05], &mut |_, _| {}).unwrap();
        let c = &found[0];
        assert!((c.force_n.ratio() - 1.0).abs() < 0.05, "force {:?}", c.force_n);
        assert!(c.normal_map_difference < 0.05, "map {}", c.normal_map_difference);
        assert!(c.displacements[0].difference < 0.05, "{:?}", c.displacements[0]);
    }

    #[test]
    fn the_taxels_carry_the_whole_force_and_the_map_has_the_spheres_symmetry() {
        let Setting {
            gel,
            material,
            radius_mm,
            surface,
            fineness,
        } = setting(12.0, Surface::Frictionless);
        let mut press = SpherePress::new(&gel, material, radius_mm, surface, fineness).unwrap();
        press.press_to(0.6).unwrap();
        let map = press.force_map();
        let sum = |axis: usize| map.iter().map(|taxel| taxel[axis]).sum::<f64>();
        assert!((sum(2) / press.force_n() - 1.0).abs() < 1e-12);
        assert!(sum(0).abs() < 1e-12 && sum(1).abs() < 1e-12);
        for row in 0..TAXELS {
            for column in 0..TAXELS {
                let (here, turned) = (map[row * TAXELS + column], map[column * TAXELS + row]);
                assert!((here[2] - turned[2]).abs() < 1e-6 && (here[0] - turned[1]).abs() < 1e-6);
            }
        }
        // The gel moves away under the sphere and not at all at the base.
        assert!((press.displacement_mm([0.0, 0.0, 0.0])[2] - 0.6).abs() < 1e-4);
        assert!(
            press
                .displacement_mm([0.0, 0.0, 6.0])
                .iter()
                .all(|u| u.abs() < 1e-15)
        );
    }

    #[test]
    fn indentations_that_do_not_rise_and_an_incompressible_gel_are_refused() {
        let setting = setting(12.0, Surface::Frictionless);
        for wrong in [&[0.1, 0.05][..], &[0.0], &[0.6], &[f64::NAN]] {
            assert!(compare_pressed_sphere(&setting, wrong, &mut |_, _| {}).is_err());
        }
        let stiff = Gel {
            poisson: 0.5,
            ..Gel::default()
        };
        assert!(Ogden::of_gel(&stiff).is_err());
    }
}
