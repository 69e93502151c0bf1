//! Pull and torsion together. The tractions that friction allows, |q| ≤ μp, form a convex set, so their loads (F, M
//! about the pressure's centre) do too. It holds pure pull μN in every direction and pure torsion M*, hence the chord
//! between them: |F|/μN + |M|/M* = 1 bounds the load of full slip from below. From above it is bounded by the power
//! that slip can take at most: F·v + Mω ≤ Σ μp |v + ω × r| for every motion; the loads that meet this with
//! equality for some motion are the exact limit surface (Goyal, Ruina and Papadopoulos 1991). M* is the least
//! Σ μp |r − c| over points c.

use std::f64::consts::{PI, TAU};

use gripline_simulation::Gel;
use gripline_simulation::closed_form::Hertz;
use gripline_simulation::contact_world::{Mount, TRAINING_SHAPES, Truth, UNSEEN_SHAPES, production_cells};

use crate::chart::{Chart, Curve, Pictures};
use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::{FRICTION, Paraboloid, World, drive, half_space};

/// Places of the pole of rotation on the x axis, contact radii.
const POLES: [f64; 11] = [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.5, 5.0, 1e6];

/// Friction bounds at places relative to the pressure's centre: [x, y, μ p dA].
type Friction = Vec<[f64; 3]>;

fn friction(truth: &Truth) -> Friction {
    let [x0, y0] = truth.pressure_centre_mm().unwrap_or_default();
    let cell_mm2 = truth.pitch_mm() * truth.pitch_mm();
    truth
        .pressure_mpa()
        .iter()
        .enumerate()
        .filter(|(_, p)| **p > 0.0)
        .map(|(cell, p)| {
            let [x, y] = truth.place_mm(cell);
            [x - x0, y - y0, FRICTION * p * cell_mm2]
        })
        .collect()
}

/// The Hertz dome on a fine polar grid.
fn dome(hertz: &Hertz) -> Friction {
    let (rings, spokes) = (120, 120);
    let a = hertz.radius_mm();
    let mut all = Vec::new();
    for ring in 0..rings {
        // r = a sin t evens out the dome's edge.
        let t = (f64::from(ring) + 0.5) / f64::from(rings) * 0.5 * PI;
        let r = a * t.sin();
        let area = r * a * t.cos() * (0.5 * PI / f64::from(rings)) * (TAU / f64::from(spokes));
        for spoke in 0..spokes {
            let angle = (f64::from(spoke) + 0.5) / f64::from(spokes) * TAU;
            all.push([
                r * angle.cos(),
                r * angle.sin(),
                FRICTION * hertz.pressure_mpa(r) * area,
            ]);
        }
    }
    all
}

/// Σ μp |v + ω × r|: the most power that friction takes at that motion.
fn power(friction: &Friction, [u, v, w]: [f64; 3]) -> f64 {
    friction
        .iter()
        .map(|[x, y, f]| f * f64::hypot(u - w * y, v + w * x))
        .sum()
}

/// Least value over a simplex that walks downhill (Nelder and Mead 1965), from `from` with first steps `size`.
fn min(f: impl Fn([f64; 2]) -> f64, from: [f64; 2], size: f64) -> f64 {
    let mut simplex = [from, [from[0] + size, from[1]], [from[0], from[1] + size]].map(|at| (f(at), at));
    for _ in 0..60 {
        simplex.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [best, good, bad] = simplex;
        let middle = [0, 1].map(|k| 0.5 * (best.1[k] + good.1[k]));
        let try_at = |reach: f64| {
            let at = [0, 1].map(|k| middle[k] + reach * (bad.1[k] - middle[k]));
            (f(at), at)
        };
        let mirrored = try_at(-1.0);
        simplex[2] = if mirrored.0 < best.0 {
            let further = try_at(-2.0);
            if further.0 < mirrored.0 { further } else { mirrored }
        } else if mirrored.0 < good.0 {
            mirrored
        } else {
            let inside = try_at(0.5);
            if inside.0 < bad.0 {
                inside
            } else {
                simplex[1] = try_shrunk(&f, best.1, good.1);
                try_shrunk(&f, best.1, bad.1)
            }
        };
    }
    simplex.into_iter().map(|v| v.0).fold(f64::INFINITY, f64::min)
}

fn try_shrunk(f: &impl Fn([f64; 2]) -> f64, best: [f64; 2], at: [f64; 2]) -> (f64, [f64; 2]) {
    let at = [0, 1].map(|k| 0.5 * (best[k] + at[k]));
    (f(at), at)
}

/// Pure twist that friction holds at most, with no force left over.
fn max_pure_moment(friction: &Friction) -> f64 {
    min(
        |[x0, y0]| {
            friction
                .iter()
                .map(|[x, y, f]| f * f64::hypot(x - x0, y - y0))
                .sum()
        },
        [0.0; 2],
        0.5,
    )
}

/// How far out a load (F, M) lies: its share of the limit surface in its own direction.
fn share(friction: &Friction, [fx, fy, m]: [f64; 3], length_mm: f64) -> f64 {
    // Motions as a direction of three: shift along and across the force, turn times a length.
    let size = f64::hypot(fx, fy);
    let along = if size > 1e-9 {
        [fx / size, fy / size]
    } else {
        [1.0, 0.0]
    };
    let negative = |[a, b]: [f64; 2]| {
        let (s, w, c) = (a.cos() * b.cos(), a.sin(), a.cos() * b.sin());
        let motion = [
            s * along[0] - c * along[1],
            s * along[1] + c * along[0],
            w / length_mm,
        ];
        let taken = power(friction, motion);
        -(fx * motion[0] + fy * motion[1] + m * motion[2]) / taken
    };
    let start = (m / length_mm).atan2(size);
    -min(negative, [start, 0.0], 0.3).min(min(negative, [0.7 * start, 0.2], 0.2))
}

/// Load of a contact: force and moment about the pressure's centre.
fn load(truth: &Truth) -> [f64; 3] {
    let [fx, fy, _] = truth.force_n();
    [
        fx,
        fy,
        truth.torsional_moment_nmm(truth.pressure_centre_mm().unwrap_or_default()),
    ]
}

pub(crate) fn run(world: &World, report: &mut Report, pictures: &Pictures) -> Result<(), Failure> {
    let (gel, force_n, radius_mm) = (half_space(), 3.0, 12.0);
    let hertz = Hertz::new(force_n, radius_mm, &gel)?;
    let a = hertz.radius_mm();
    let dome = dome(&hertz);
    let limit = [FRICTION * force_n, 3.0 * PI / 16.0 * FRICTION * force_n * a];
    let pitch = 32.0 / production_cells(force_n) as f64;
    let (mut chord, mut outer, mut ellipse) = (f64::INFINITY, Worst::default(), Worst::default());
    let mut chord_at = String::new();
    let (mut dots, mut paths) = (Vec::new(), Vec::new());
    // Turn by 1 and shift by this many radii, in steps of at most 0.4 cells.
    for pole in POLES.into_iter().step_by(if world.quick { 5 } else { 1 }) {
        let mut contact = world
            .contact(
                &gel,
                production_cells(force_n),
                Paraboloid { radius_mm },
                Mount::default(),
            )?
            .vertical_pressure();
        contact.step(drive(force_n, [0.0; 2], 0.0))?;
        let turn_step = 0.4 * pitch / (a * f64::max(pole, 1.0));
        let mut path = vec![(0.0, 0.0)];
        let mut slipped = 0;
        for i in 1..=60 {
            let turn = turn_step * f64::from(i);
            let truth = contact.step(drive(force_n, [pole * a * turn, 0.0], turn))?;
            let [fx, fy, m] = load(truth);
            let (f, m) = (f64::hypot(fx, fy) / limit[0], m.abs() / limit[1]);
            path.push((f, m));
            let at = || format!("pole at {pole} a");
            outer.see(100.0 * share(&dome, load(truth), a), at);
            if truth.gross_slip() {
                slipped += 1;
                if slipped < 6 {
                    continue;
                }
                if f + m < chord {
                    chord = f + m;
                    chord_at = at();
                }
                ellipse.see(100.0 * (f64::hypot(f, m) - 1.0), at);
                dots.push((f, m));
                break;
            }
        }
        paths.push(path);
    }
    report.row(
        "limit_surface_chord",
        "sphere pulled and twisted to full slip: F/μN + M/M*",
        "chord of the limit surface, grid tolerance 1 %",
        Bound::AtLeast(0.99),
        (chord, ""),
        &chord_at,
    );
    report.row(
        "limit_surface_exact",
        "the same on every step: share of the limit surface",
        "exact surface of the Hertz dome, grid tolerance 1 %",
        Bound::AtMost(101.0),
        (outer.value, "%"),
        &outer.at,
    );
    report.row(
        "limit_surface_ellipse",
        "the same at full slip: distance to the ellipse",
        "(F/μN)² + (M/M*)² = 1",
        Bound::Reported,
        (ellipse.value, "%"),
        &ellipse.at,
    );
    shapes(world, report)?;

    // The exact curve: loads of rigid slip about a pole.
    let exact = (0..=100)
        .map(|k| f64::from(k) / 100.0 * 0.5 * PI)
        .map(|angle| {
            let (s, w) = (angle.cos(), angle.sin() / a);
            let (mut pull, mut moment) = (0.0, 0.0);
            for [x, y, f] in &dome {
                let (u, v) = (s - w * y, w * x);
                let speed = f64::hypot(u, v).max(1e-12);
                pull += f * u / speed;
                moment += f * (x * v - y * u) / speed;
            }
            (pull / limit[0], moment / limit[1])
        })
        .collect();
    let arc = (0..=100).map(|k| f64::from(k) / 100.0 * 0.5 * PI);
    let mut curves = vec![
        Curve::line("exact", 7, exact),
        Curve::line("chord", 1, vec![(0.0, 1.0), (1.0, 0.0)]),
        Curve::line("ellipse", 2, arc.map(|t| (t.cos(), t.sin())).collect()),
        Curve::dots("full slip, cells", 3, dots),
    ];
    curves.extend(paths.into_iter().map(|path| Curve::line("", 8, path)));
    pictures.charts(
        "limit-surface",
        &[Chart {
            title: "Pull and twist together (sphere, 3 N); thin: paths from rest",
            x: "force F/μN",
            y: "moment M/M*",
            x_range: [0.0, 1.1],
            y_range: [0.0, 1.1],
            rising: false,
            curves,
        }],
    )
}

/// Every shape on the layer, against the limit surface of its own pressure.
fn shapes(world: &World, report: &mut Report) -> Result<(), Failure> {
    let gel = Gel::default();
    let (mut min_chord, mut chord_at) = (f64::INFINITY, String::new());
    let (mut max, mut min_share) = (0.0_f64, (f64::INFINITY, String::new()));
    for shape in TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES) {
        let force_n = 3.0;
        let cells = production_cells(force_n);
        let poles: &[f64] = if world.quick { &[2.0] } else { &[0.0, 2.0, 30.0] };
        for &pole in poles {
            let mut contact = world
                .contact(&gel, cells, shape, Mount::default())?
                .vertical_pressure();
            contact.go(drive(force_n, [0.1, -0.05], 0.0), 6)?;
            let turn_step = 0.3 / f64::max(pole, 4.0);
            let mut slipped = 0;
            for i in 1..=40 {
                let turn = turn_step * f64::from(i);
                let truth = contact.step(drive(force_n, [0.1 + pole * turn, -0.05], turn))?;
                if !truth.gross_slip() {
                    continue;
                }
                slipped += 1;
                if slipped < 8 {
                    continue;
                }
                let friction = friction(truth);
                let (load, torsion) = (load(truth), max_pure_moment(&friction));
                let total: f64 = friction.iter().map(|f| f[2]).sum();
                let found = f64::hypot(load[0], load[1]) / total + load[2].abs() / torsion;
                let at = || format!("{}, pole at {pole} mm", shape.name());
                if found < min_chord {
                    (min_chord, chord_at) = (found, at());
                }
                let share = share(&friction, load, torsion / total);
                max = max.max(share);
                if share < min_share.0 {
                    min_share = (share, at());
                }
                break;
            }
        }
    }
    report.row(
        "limit_surface_shapes_chord",
        "12 shapes on the layer at full slip: F/μN + M/M*",
        "chord of their own pressure's limit surface",
        Bound::AtLeast(0.99),
        (min_chord, ""),
        &chord_at,
    );
    report.row(
        "limit_surface_shapes_exact",
        "the same: largest share of the limit surface",
        "exact surface of their own pressure",
        Bound::AtMost(100.1),
        (100.0 * max, "%"),
        "",
    );
    report.row(
        "limit_surface_shapes_least",
        "the same: smallest share of the limit surface",
        "exact surface of their own pressure",
        Bound::AtLeast(98.0),
        (100.0 * min_share.0, "%"),
        &min_share.1,
    );
    Ok(())
}
