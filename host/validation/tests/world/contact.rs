//! The contact solver against closed forms and conservation laws.

use std::f64::consts::PI;
use std::sync::Arc;

use gripline_simulation::closed_form::{CattaneoMindlin, Hertz, Torsion};
use gripline_simulation::contact_world::{
    Contact, Drive, GelSurface, HeightMap, Mount, Press, Shape, TRAINING_SHAPES, Truth, UNSEEN_SHAPES,
    WALL_MM,
};
use gripline_simulation::{ForceMap, Gel, Random, SimulationError};

use crate::difference;

const FRICTION: f64 = 0.65;
const RADIUS_MM: f64 = 12.0;

/// The parabola of Hertz's theory.
#[derive(Debug)]
struct Paraboloid;

impl HeightMap for Paraboloid {
    fn height_mm(&self, at: [f64; 2]) -> f64 {
        (at[0] * at[0] + at[1] * at[1]) / (2.0 * RADIUS_MM)
    }
}

/// A flat face with a sharp edge.
#[derive(Debug)]
struct Punch;

impl HeightMap for Punch {
    fn height_mm(&self, at: [f64; 2]) -> f64 {
        if at[0].hypot(at[1]) < 6.0 { 0.0 } else { WALL_MM }
    }
}

/// No coupling (ν = ½) and no base: what the closed forms assume.
fn half_space() -> Gel {
    Gel {
        thickness_mm: 1e9,
        poisson: 0.5,
        ..Gel::default()
    }
}

fn contact(gel: &Gel, cells: usize, indenter: impl HeightMap + 'static, mount: Mount) -> Contact {
    let surface = Arc::new(GelSurface::new(gel, cells).unwrap());
    Contact::new(surface, Arc::new(indenter), FRICTION, mount).unwrap()
}

fn pressed(cells: usize, force_n: f64) -> (Contact, Hertz) {
    let gel = half_space();
    let mut contact = contact(&gel, cells, Paraboloid, Mount::default()).vertical_pressure();
    contact.step(drive(force_n, [0.0; 2], 0.0)).unwrap();
    (contact, Hertz::new(force_n, RADIUS_MM, &gel).unwrap())
}

fn drive(force_n: f64, at_mm: [f64; 2], turn_rad: f64) -> Drive {
    Drive {
        press: Press::Force(force_n),
        at_mm,
        turn_rad,
        tilt_rad: [0.0; 2],
    }
}

/// Friction's share of the force along x and y, N.
fn friction_n(truth: &Truth) -> [f64; 2] {
    let area = truth.pitch_mm() * truth.pitch_mm();
    (0..truth.states().len()).fold([0.0; 2], |[x, y], cell| {
        let [qx, qy] = truth.friction_mpa(cell);
        [x + qx * area, y + qy * area]
    })
}

fn sums(map: &ForceMap) -> [f64; 3] {
    map.iter().fold([0.0; 3], |sum, taxel| {
        std::array::from_fn(|k| sum[k] + f64::from(taxel[k]))
    })
}

#[test]
fn a_pressed_parabola_is_hertz() {
    for force in [1.0, 5.0] {
        let (contact, hertz) = pressed(80, force);
        let truth = contact.truth();
        // ⟨r²⟩ over the pressure is 2a²/5, and does not step with the cells.
        let mut spread = 0.0;
        let mut worst = 0.0_f64;
        for (cell, p) in truth.pressure_mpa().iter().enumerate() {
            let r = f64::hypot(truth.place_mm(cell)[0], truth.place_mm(cell)[1]);
            spread += p * r * r * 0.16;
            if r < 0.9 * hertz.radius_mm() {
                worst = worst.max((p - hertz.pressure_mpa(r)).abs() / hertz.peak_pressure_mpa());
            }
        }
        let radius = (2.5 * spread / force).sqrt() / hertz.radius_mm();
        let area = (truth.area_mm2() / PI).sqrt() / hertz.radius_mm();
        let peak = truth.pressure_mpa().iter().copied().fold(0.0, f64::max) / hertz.peak_pressure_mpa();
        let depth = truth.pose().depth_mm / hertz.approach_mm();
        println!(
            "Hertz {force} N: radius {radius:.4} (by counted cells {area:.4}), peak {peak:.4}, depth {depth:.4} \
             of the closed form; pressure within {worst:.4} of the peak"
        );
        assert!((radius - 1.0).abs() < 0.01 && (area - 1.0).abs() < 0.05);
        assert!((peak - 1.0).abs() < 0.01 && (depth - 1.0).abs() < 0.005 && worst < 0.02);
        // Depth control meets the same state.
        let mut by_depth = self::contact(&half_space(), 80, Paraboloid, Mount::default()).vertical_pressure();
        let press = Press::Depth(truth.pose().depth_mm);
        let again = by_depth
            .step(Drive {
                press,
                ..drive(0.0, [0.0; 2], 0.0)
            })
            .unwrap();
        assert!((again.force_n()[2] / force - 1.0).abs() < 1e-3);
    }
}

#[test]
fn a_growing_pull_is_cattaneo_mindlin() {
    let force = 3.0;
    let (mut contact, hertz) = pressed(80, force);
    let closed = CattaneoMindlin::new(hertz, FRICTION, &half_space()).unwrap();
    for share in [0.1, 0.3, 0.5, 0.646, 0.8, 0.9, 0.95] {
        let pull = share * closed.limit_n();
        let shift = closed.displacement_mm(pull).unwrap();
        let truth = contact.step(drive(force, [shift, 0.0], 0.0)).unwrap();
        let found = truth.force_n()[0] / closed.limit_n();
        let ratio = truth.stick_ratio().unwrap();
        let exact = closed.stick_ratio(pull).unwrap();
        let [mut worst, mut across] = [0.0_f64; 2];
        for cell in 0..truth.states().len() {
            let [x, y] = truth.place_mm(cell);
            // The footprint slid a little by now.
            let r = f64::hypot(x - truth.footprint_mm()[0], y);
            if r < 0.9 * hertz.radius_mm() {
                let [qx, qy] = truth.shear_mpa(cell);
                let error = (qx - closed.traction_mpa(pull, r).unwrap()).abs();
                worst = worst.max(error / (FRICTION * hertz.peak_pressure_mpa()));
                across = across.max(qy.abs() / (FRICTION * hertz.peak_pressure_mpa()));
            }
        }
        println!(
            "Cattaneo–Mindlin Q/μP {share}: {found:.4}; stick ratio {ratio:.4}, closed {exact:.4}; traction within \
             {worst:.3} μp0, across {across:.3}"
        );
        assert!((found - share).abs() < 0.005);
        assert!((ratio - exact).abs() < 0.03);
        assert!(worst < 0.08 && !truth.gross_slip());
    }
}

#[test]
fn grip_and_pull_that_grow_in_proportion_never_slip_and_shear_in_proportion_to_pressure() {
    // Exact for any Hertz contact (Mindlin and Deresiewicz): q(r) = (Q/P) p(r) while Q/P < μ.
    let mut contact = contact(&half_space(), 80, Paraboloid, Mount::default()).vertical_pressure();
    let share = 0.4;
    for i in 1..=48 {
        let force = 0.0625 * f64::from(i);
        contact
            .pull(Press::Force(force), [0.0; 2], [share * force, 0.0, 0.0])
            .unwrap();
    }
    let truth = contact.truth();
    let (mut off, mut all) = (0.0, 0.0);
    for (cell, p) in truth.pressure_mpa().iter().enumerate() {
        off += (truth.shear_mpa(cell)[0] - share * p).powi(2);
        all += (share * p).powi(2);
    }
    let (ratio, off) = (truth.stick_ratio().unwrap(), (off / all).sqrt());
    println!("grip and pull in proportion: stick ratio {ratio:.3}, shear within {off:.4} of (Q/P) p");
    assert!(ratio > 0.95 && off < 0.06, "{ratio} {off}");
}

#[test]
fn more_grip_under_the_same_pull_sticks_again() {
    let mut contact = contact(&half_space(), 80, Paraboloid, Mount::default()).vertical_pressure();
    contact.step(drive(2.0, [0.0; 2], 0.0)).unwrap();
    let mut ratio = |force: f64| {
        let truth = contact.pull(Press::Force(force), [0.0; 2], [1.1, 0.0, 0.0]);
        truth.unwrap().stick_ratio().unwrap()
    };
    let [before, after] = [2.0, 2.5].map(&mut ratio);
    println!("stick ratio under 1.1 N: {before:.3} at 2 N, {after:.3} at 2.5 N");
    assert!(before < 0.4 && after > 0.95, "{before} {after}");
}

#[test]
fn a_cycle_of_pulls_loses_the_closed_forms_energy() {
    let force = 3.0;
    let (mut contact, hertz) = pressed(80, force);
    let closed = CattaneoMindlin::new(hertz, FRICTION, &half_space()).unwrap();
    let peak = 0.8 * closed.limit_n();
    let top = closed.displacement_mm(peak).unwrap();
    let steps = 20;
    let mut loss = 0.0;
    let mut worst = 0.0_f64;
    let mut last: Option<[f64; 2]> = None;
    // Up, then once around between −top and top.
    let turn = |i: i32| (1.0 - f64::from(i) / f64::from(steps) * 2.0) * top;
    contact.step(drive(force, [top, 0.0], 0.0)).unwrap();
    for i in 0..=2 * steps {
        let shift = if i <= steps { turn(i) } else { -turn(i - steps) };
        let pull = contact.step(drive(force, [shift, 0.0], 0.0)).unwrap().force_n()[0];
        // Where the closed form is on the way back at this shift.
        if i <= steps {
            let (mut low, mut high) = (-peak, peak);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if closed.unloading_displacement_mm(peak, middle).unwrap() < shift {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            worst = worst.max((pull - low).abs() / closed.limit_n());
        }
        if let Some([shift_before, pull_before]) = last {
            loss += 0.5 * (pull + pull_before) * (shift - shift_before);
        }
        last = Some([shift, pull]);
    }
    let exact = closed.cycle_loss_nmm(peak).unwrap();
    println!(
        "unloading: within {worst:.4} μP; energy of a cycle {:.4} of the closed form",
        loss / exact
    );
    assert!(worst < 0.01);
    // The trapezoid rule over 40 chords of a curved loop takes part of this.
    assert!((loss / exact - 1.0).abs() < 0.04);
}

#[test]
fn a_growing_twist_is_lubkins_and_ends_at_three_pi_over_sixteen() {
    let force = 3.0;
    let (mut contact, hertz) = pressed(80, force);
    let a = hertz.radius_mm();
    let closed = Torsion::new(hertz, FRICTION, &half_space()).unwrap();
    for stick in [0.95, 0.85, 0.7, 0.5, 0.3] {
        let turn = closed.rotation_rad(stick * a);
        let truth = contact.step(drive(force, [0.0; 2], turn)).unwrap();
        let moment = truth.torsional_moment_nmm([0.0; 2]) / closed.moment_nmm(stick * a);
        let ratio = truth.stick_ratio().unwrap();
        println!(
            "torsion c/a {stick}: moment {moment:.4} of Lubkin's; stick ratio {ratio:.4}, closed {:.4}",
            stick * stick
        );
        assert!((moment - 1.0).abs() < 0.02 && (ratio - stick * stick).abs() < 0.05);
    }
    let full = contact.step(drive(force, [0.0; 2], 20.0)).unwrap();
    let moment = full.torsional_moment_nmm([0.0; 2]) / closed.limit_nmm();
    println!("torsion, full slip: {moment:.4} of (3π/16) μPa");
    assert!((moment - 1.0).abs() < 0.01 && full.gross_slip());
}

#[test]
fn full_slip_of_a_flat_face_is_two_thirds_of_force_times_radius() {
    // (2/3) μPa needs even pressure, which a face far wider than the layer is thick has, except for its edge.
    // What holds for any pressure: full spin carries μ Σ p r.
    let mut contact = contact(
        &Gel::default(),
        40,
        Shape::Disc {
            radius_mm: 5.0,
            edge_mm: 1.0,
        },
        Mount::default(),
    );
    contact.step(drive(5.0, [0.0; 2], 0.0)).unwrap();
    for i in 1..=8 {
        contact.step(drive(5.0, [0.0; 2], 0.5 * f64::from(i))).unwrap();
    }
    let truth = contact.truth();
    let bound: f64 = (0..1600)
        .map(|cell| {
            let [x, y] = truth.place_mm(cell);
            FRICTION * truth.pressure_mpa()[cell] * x.hypot(y) * 0.64
        })
        .sum();
    let share = truth.torsional_moment_nmm([0.0; 2]) / bound;
    println!("torsion of a flat face, full slip: {share:.4} of μ Σ p r");
    assert!((share - 1.0).abs() < 0.01 && truth.gross_slip());
}

#[test]
fn sliding_and_spinning_together_lie_on_the_limit_surface() {
    // Steady slip about a pole at distance d: q = μp against the slip there, integrated over the Hertz dome.
    // Slip is the indenter's own only where the gel under it hardly strains: little friction.
    let (force, friction) = (3.0, 0.02);
    for pole in [0.3, 0.8, 2.0] {
        let hertz = Hertz::new(force, RADIUS_MM, &half_space()).unwrap();
        let surface = Arc::new(GelSurface::new(&half_space(), 80).unwrap());
        let mut contact = Contact::new(surface, Arc::new(Paraboloid), friction, Mount::default())
            .unwrap()
            .vertical_pressure();
        let a = hertz.radius_mm();
        let (mut pull, mut moment) = (0.0, 0.0);
        let steps = 200;
        for i in 0..steps {
            for j in 0..steps {
                let at = |k: i32| (f64::from(k) + 0.5) / f64::from(steps) * 2.0 * a - a;
                let (x, y) = (at(i), at(j));
                let cell = (2.0 * a / f64::from(steps)).powi(2);
                let q = friction * hertz.pressure_mpa(x.hypot(y)) * cell;
                // Slip velocity (−y + d, x) for turn rate 1 and shift d along x.
                let (u, v) = (pole * a - y, x);
                pull += q * u / u.hypot(v);
                moment += q * (x * v - y * u) / u.hypot(v);
            }
        }
        // Far beyond the elastic shift.
        for i in 0..=20 {
            let turn = 0.04 * f64::from(i) / pole.max(0.5);
            contact.step(drive(force, [pole * a * turn, 0.0], turn)).unwrap();
        }
        let truth = contact.truth();
        let limit = [friction * force, 3.0 * PI / 16.0 * friction * force * a];
        let found = [
            truth.force_n()[0].hypot(truth.force_n()[1]) / limit[0],
            truth.torsional_moment_nmm(truth.footprint_mm()) / limit[1],
        ];
        let exact = [pull / limit[0], moment / limit[1]];
        println!(
            "limit surface, pole at {pole} a: force and moment {:.4} {:.4}, rigid slip {:.4} {:.4}; sum of squares {:.3}",
            found[0],
            found[1],
            exact[0],
            exact[1],
            found[0].powi(2) + found[1].powi(2)
        );
        for k in 0..2 {
            assert!((found[k] - exact[k]).abs() < 0.01);
        }
        assert!(found[0] + found[1] > 1.0 && found[0] < 1.001 && found[1] < 1.02 && truth.gross_slip());
    }
}

#[test]
fn a_long_drag_slides_at_the_friction_limit_and_the_footprint_goes_along() {
    let mut contact = contact(
        &Gel::default(),
        40,
        Shape::Sphere { radius_mm: 12.0 },
        Mount::default(),
    );
    let mut onset = None;
    for i in 0..=40 {
        let x = 0.1 * f64::from(i);
        let truth = contact.step(drive(2.0, [x, 0.0], 0.0)).unwrap();
        if truth.gross_slip() {
            onset.get_or_insert(x);
        }
    }
    let truth = contact.truth();
    let [_, _, fz] = truth.force_n();
    let [fx, fy] = friction_n(truth);
    let onset = onset.unwrap();
    println!(
        "drag of 4 mm: gross slip from {onset:.1} mm, F/μP {:.5}, footprint at {:.3} mm, slid {:.3} mm",
        fx.hypot(fy) / (FRICTION * fz),
        truth.footprint_mm()[0],
        truth.slip_distance_mm(),
    );
    assert!((fx / (FRICTION * fz) - 1.0).abs() < 1e-3 && fy.abs() < 1e-3);
    assert!(onset > 0.2 && truth.stick_ratio() == Some(0.0));
    // All motion past the elastic shift is slip. Counted point by point it is the footprint's way except for the strain
    // of the gel that passes under.
    let slid = truth.slip_distance_mm();
    assert!(slid > 4.0 - onset - 0.2 && slid < 4.0 && (truth.footprint_mm()[0] / slid - 1.0).abs() < 0.03);
}

#[test]
fn pressure_leans_along_the_indenters_normal() {
    // A tilted face without friction pushes sideways by force × slope.
    let tilt = [0.05, -0.02];
    let surface = Arc::new(GelSurface::new(&Gel::default(), 80).unwrap());
    let slick = |indenter: Arc<dyn HeightMap>| {
        Contact::new(Arc::clone(&surface), indenter, 1e-6, Mount::default()).unwrap()
    };
    let mut tilted = slick(Arc::new(Punch));
    let press = Drive {
        tilt_rad: tilt,
        ..drive(2.0, [0.0; 2], 0.0)
    };
    let [fx, fy, fz] = tilted.go_to(press, 8).unwrap().force_n();
    println!("tilted face: sideways {:.4} {:.4} of the force", fx / fz, fy / fz);
    assert!((fx / fz + tilt[0]).abs() < 1e-3 && (fy / fz + tilt[1]).abs() < 1e-3);
    // A sphere: p r / R outward, cell by cell.
    let mut sphere = slick(Arc::new(Shape::Sphere { radius_mm: RADIUS_MM }));
    let truth = sphere.go_to(drive(2.0, [0.0; 2], 0.0), 8).unwrap();
    let [mut off, mut all] = [0.0; 2];
    for (cell, p) in truth.pressure_mpa().iter().enumerate() {
        let ([x, y], [qx, qy]) = (truth.place_mm(cell), truth.shear_mpa(cell));
        if *p == 0.0 {
            continue;
        }
        let root = (RADIUS_MM * RADIUS_MM - x * x - y * y).sqrt();
        off += (qx - p * x / root).hypot(qy - p * y / root);
        all += p * x.hypot(y) / root;
    }
    println!("sphere: sideways pressure within {:.1e} of p∇h", off / all);
    assert!(off / all < 1e-2);
}

#[test]
fn a_pull_by_load_goes_where_a_drag_that_carries_it_went() {
    let contact = || {
        let ellipsoid = TRAINING_SHAPES[2];
        let mut contact = contact(&Gel::default(), 80, ellipsoid, Mount::default());
        contact.go_to(drive(2.0, [0.4, -0.2], 0.0), 8).unwrap();
        contact
    };
    let (mut dragged, mut pulled) = (contact(), contact());
    for i in 1..=6 {
        let part = f64::from(i) / 6.0;
        let truth = dragged
            .step(drive(2.0, [0.4 + 0.3 * part, -0.2 + 0.1 * part], 0.04 * part))
            .unwrap();
        let [x, y, _] = truth.force_n();
        let load = [x, y, truth.torsional_moment_nmm(truth.footprint_mm())];
        let (pose, map) = (truth.pose(), truth.force_map());
        let found = pulled.pull(Press::Force(2.0), [0.0; 2], load).unwrap();
        let off = difference(&found.force_map(), &map);
        let way = f64::hypot(
            found.pose().at_mm[0] - pose.at_mm[0],
            found.pose().at_mm[1] - pose.at_mm[1],
        );
        let carried = found.force_n();
        println!("pull {x:.3} {y:.3} N: place off by {way:.1e} mm, map by {off:.1e}");
        assert!(
            (carried[0] - x).abs() < 1e-3 * FRICTION * 2.0 && (carried[1] - y).abs() < 1e-3 * FRICTION * 2.0
        );
        assert!(way < 0.01 && off < 0.01 && (found.pose().turn_rad - pose.turn_rad).abs() < 0.002);
    }
    // More than friction holds: named, and nothing has changed.
    let before = pulled.truth().force_map();
    let error = pulled
        .pull(Press::Force(2.0), [0.0; 2], [1.5, 0.0, 0.0])
        .unwrap_err();
    assert!(error.to_string().contains("slides the indenter away"), "{error}");
    assert_eq!(pulled.truth().force_map(), before);
    assert!(
        pulled
            .pull(Press::Force(2.0), [0.0; 2], [f64::NAN, 0.0, 0.0])
            .is_err()
    );
}

#[test]
fn a_path_in_few_steps_ends_where_the_path_in_many_ends() {
    let run = |steps: u32| {
        let mut contact = contact(
            &Gel::default(),
            80,
            Shape::Sphere { radius_mm: 12.0 },
            Mount::default(),
        );
        contact.go_to(drive(2.0, [-3.0, 0.0], 0.0), 8).unwrap();
        contact.go_to(drive(2.0, [3.0, 1.0], 0.3), steps).unwrap();
        (contact.truth().force_map(), contact.truth().footprint_mm())
    };
    let (many, [x, y]) = run(120);
    for steps in [8, 16, 30, 60] {
        let (map, at) = run(steps);
        let off_mm = f64::hypot(at[0] - x, at[1] - y);
        let off = difference(&map, &many);
        println!("path of 6 mm in {steps} steps instead of 120: map {off:.4}, footprint {off_mm:.4} mm");
        assert!(off < 0.01 && off_mm < 0.02);
    }
}

#[test]
fn a_mount_that_gives_way_holds_what_the_skin_takes() {
    let mount = Mount {
        shift_mm_per_n: 1.5,
        turn_rad_per_nmm: 0.05,
    };
    let mut contact = contact(&Gel::default(), 40, Shape::Sphere { radius_mm: 10.0 }, mount);
    for i in 0..=30 {
        let part = f64::from(i) / 30.0;
        let order = drive(2.0, [4.0 * part, -part], 0.1 * part);
        let truth = contact.step(order).unwrap();
        let force = truth.force_n();
        let spring = [0, 1].map(|k| (order.at_mm[k] - truth.pose().at_mm[k]) / mount.shift_mm_per_n);
        let map = sums(&truth.force_map());
        // What the spring gives, the tractions and the taxels hold: Newton's third law at every step.
        for k in 0..2 {
            assert!((spring[k] - force[k]).abs() < 1e-9 && (map[k] - force[k]).abs() < 1e-5);
        }
        assert!((map[2] - 2.0).abs() < 1e-3);
        let [fx, fy] = friction_n(truth);
        assert!(fx.hypot(fy) <= FRICTION * force[2] * (1.0 + 1e-9));
    }
    assert!(contact.truth().gross_slip());
}

#[test]
fn the_same_path_turned_by_a_right_angle_gives_the_turned_map() {
    let run = |sin: f64, cos: f64| {
        let block = Shape::Block {
            sides_mm: [4.0, 4.0],
            edge_mm: 2.0,
        };
        let mut contact = contact(&Gel::default(), 40, block, Mount::default());
        for i in 0..=5 {
            let part = 0.2 * f64::from(i);
            let [x, y] = [1.3 + 0.6 * part, -0.7 - 0.2 * part];
            let tilt = [0.03 * part, 0.0];
            contact
                .step(Drive {
                    press: Press::Force(3.0),
                    at_mm: [cos * x - sin * y, sin * x + cos * y],
                    turn_rad: 0.1 * part,
                    tilt_rad: [cos * tilt[0], sin * tilt[0]],
                })
                .unwrap();
        }
        contact.truth().force_map()
    };
    let (vertical_pressure, turned) = (run(0.0, 1.0), run(1.0, 0.0));
    let mut expected = [[0.0; 3]; 400];
    for row in 0..20 {
        for column in 0..20 {
            let [x, y, z] = vertical_pressure[row * 20 + column];
            expected[column * 20 + 19 - row] = [-y, x, z];
        }
    }
    let off = difference(&turned, &expected);
    println!("right-angle symmetry: {off:.1e}");
    assert!(off < 1e-3);
}

#[test]
fn pressure_and_shear_are_coupled_as_the_layer_demands() {
    let shear_share = |gel: &Gel| {
        let sphere = Shape::Sphere { radius_mm: 12.0 };
        let mut contact = contact(gel, 40, sphere, Mount::default()).vertical_pressure();
        for i in 1..=5 {
            contact.step(drive(f64::from(i), [0.0; 2], 0.0)).unwrap();
        }
        let map = contact.truth().force_map();
        let sum = |pick: &dyn Fn(&[f32; 3]) -> f32| map.iter().map(|t| f64::from(pick(t))).sum::<f64>();
        let outward: f64 = map
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let [x, y] = [(i % 20) as f64 - 9.5, (i / 20) as f64 - 9.5];
                (x * f64::from(t[0]) + y * f64::from(t[1])) / x.hypot(y)
            })
            .sum();
        let norm = (sum(&|t| t[0] * t[0] + t[1] * t[1]) / sum(&|t| t[2] * t[2])).sqrt();
        (norm, outward / sum(&|t| t[2]))
    };
    let (none, _) = shear_share(&half_space());
    let (layer, outward) = shear_share(&Gel::default());
    let (compressible, inward) = shear_share(&Gel {
        poisson: 0.3,
        ..half_space()
    });
    println!(
        "coupling, pressed to 5 N: shear over pressure {none:.1e} (half-space ν ½), {layer:.3} (layer, radial \
         {outward:+.3}), {compressible:.3} (half-space ν 0.3, radial {inward:+.3})"
    );
    assert!(none < 1e-6 && layer > 0.02 && compressible > 0.02);
    // The nearly incompressible layer flows outward and is held back by friction, so the object pulls it
    // inward; the compressible half-space moves inward and is held outward.
    assert!(outward < 0.0 && inward > 0.0);
}

#[test]
fn a_punch_that_cannot_slip_is_stiffer_by_mossakovskiis_factor() {
    // P bonded over P frictionless = (1−ν) ln(3−4ν) / (1−2ν) (Johnson, ch. 3.7): coupling both ways.
    for poisson in [0.1, 0.3] {
        let gel = Gel {
            poisson,
            ..half_space()
        };
        let stiffening = |cells: usize| {
            let surface = Arc::new(GelSurface::new(&gel, cells).unwrap());
            let force = |friction: f64| {
                let mut contact =
                    Contact::new(Arc::clone(&surface), Arc::new(Punch), friction, Mount::default()).unwrap();
                let order = Drive {
                    press: Press::Depth(0.1),
                    ..drive(0.0, [0.0; 2], 0.0)
                };
                contact.step(order).unwrap().force_n()[2]
            };
            force(2.0) / force(1e-6) - 1.0
        };
        let exact = (1.0 - poisson) * (3.0 - 4.0 * poisson).ln() / (1.0 - 2.0 * poisson) - 1.0;
        let [coarse, fine] = [40, 120].map(|cells| stiffening(cells) / exact);
        println!(
            "bonded punch, ν {poisson}: stiffening {coarse:.3} of the closed form on 40 cells, {fine:.3} on 120"
        );
        // The edge's singularity wants cells: the error falls with their size.
        assert!((fine - 1.0).abs() < 0.03 && (fine - 1.0).abs() < 0.5 * (coarse - 1.0).abs());
    }
}

#[test]
fn under_a_wide_face_a_thin_layer_answers_as_a_column() {
    // Confined compression p = Mδ/h with M = 2G(1−ν)/(1−2ν), plain shear q = Gu/h.
    let gel = Gel {
        thickness_mm: 1.0,
        poisson: 0.3,
        ..Gel::default()
    };
    let surface = Arc::new(GelSurface::new(&gel, 80).unwrap());
    let mut contact = Contact::new(surface, Arc::new(Punch), 2.0, Mount::default()).unwrap();
    let (depth, shift) = (0.05, 0.04);
    let order = |x: f64| Drive {
        press: Press::Depth(depth),
        ..drive(0.0, [x, 0.0], 0.0)
    };
    contact.step(order(0.0)).unwrap();
    let truth = contact.step(order(shift)).unwrap();
    let middle = 40 * 80 + 40;
    let modulus = 2.0 * gel.shear_modulus_mpa() * 0.7 / 0.4;
    let pressure = truth.pressure_mpa()[middle] / (modulus * depth);
    let shear = truth.shear_mpa(middle)[0] / (gel.shear_modulus_mpa() * shift);
    println!("thin layer under a wide face: pressure {pressure:.4}, shear {shear:.4} of the column's");
    assert!((pressure - 1.0).abs() < 0.01 && (shear - 1.0).abs() < 0.01);
}

#[test]
fn pressing_in_eight_steps_is_close_to_pressing_in_many() {
    for shape in [TRAINING_SHAPES[0], TRAINING_SHAPES[4], UNSEEN_SHAPES[4]] {
        let map = |steps: u32| {
            let mut contact = contact(&Gel::default(), 40, shape, Mount::default());
            contact
                .go_to(drive(5.0, [0.3, -0.1], 0.0), steps)
                .unwrap()
                .force_map()
        };
        let many = map(64);
        let off = [1, 8, 16].map(|steps| difference(&map(steps), &many));
        println!(
            "pressing {} in 1, 8, 16 steps: map within {off:.4?} of 64",
            shape.name()
        );
        assert!(off[1] < 0.01 && off[0] > 2.0 * off[1]);
    }
}

#[test]
fn the_production_grid_is_close_to_one_twice_as_fine() {
    for (force, [bound_coarse, bound_fine]) in [(0.3, [0.1, 0.03]), (1.0, [0.04, 0.015]), (5.0, [0.03, 0.01])]
    {
        let run = |cells: usize| {
            let sphere = Shape::Sphere { radius_mm: 12.0 };
            let mut contact = contact(&Gel::default(), cells, sphere, Mount::default());
            contact.go_to(drive(force, [0.25, -0.1], 0.0), 4).unwrap();
            let pulled = contact.go_to(drive(force, [0.57, -0.1], 0.0), 4).unwrap();
            (pulled.force_map(), pulled.stick_ratio().unwrap())
        };
        let [coarse, fine, finest] = [40, 80, 160].map(run);
        let off = [difference(&coarse.0, &fine.0), difference(&fine.0, &finest.0)];
        println!(
            "grid, {force} N: map on 40 cells within {:.2} % of 80, on 80 within {:.2} % of 160; stick ratios \
             {:.3}, {:.3}, {:.3}",
            100.0 * off[0],
            100.0 * off[1],
            coarse.1,
            fine.1,
            finest.1
        );
        assert!(off[0] < bound_coarse && off[1] < bound_fine && (fine.1 - finest.1).abs() < 0.03);
    }
}

#[test]
fn the_number_of_steps_on_a_path_hardly_matters() {
    for shape in [TRAINING_SHAPES[0], TRAINING_SHAPES[4], UNSEEN_SHAPES[3]] {
        let map = |steps: u32| {
            let mut contact = contact(&Gel::default(), 40, shape, Mount::default());
            // Pressed, then dragged and twisted into partial slip, then halfway back.
            contact.step(drive(3.0, [0.2, -0.1], 0.0)).unwrap();
            for i in 1..=2 * steps {
                let part = f64::from(i) / f64::from(steps);
                let pull = if part <= 1.0 { part } else { 1.5 - 0.5 * part };
                contact
                    .step(drive(3.0, [0.2 + 0.5 * pull, -0.1], 0.03 * pull))
                    .unwrap();
            }
            contact.truth().force_map()
        };
        let (few, some, many) = (map(3), map(8), map(64));
        let [few, some] = [difference(&few, &many), difference(&some, &many)];
        println!(
            "steps, {}: map with 3 a stroke within {:.2} %, with 8 within {:.2} % of 64",
            shape.name(),
            100.0 * few,
            100.0 * some
        );
        assert!(some < 0.02);
    }
}

#[test]
fn every_shape_meets_load_friction_and_complementarity() {
    let surface = Arc::new(GelSurface::new(&Gel::default(), 40).unwrap());
    for shape in TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES) {
        let mut contact =
            Contact::new(Arc::clone(&surface), Arc::new(shape), FRICTION, Mount::default()).unwrap();
        let mut worst = [0.0_f64; 2];
        for i in 0..12 {
            let part = f64::from(i) / 12.0;
            let force = 0.5 + 3.0 * part;
            let truth = contact
                .step(Drive {
                    press: Press::Force(force),
                    at_mm: [0.5 + 1.2 * part, -0.3 - 0.5 * part * part],
                    turn_rad: 0.3 + 0.1 * (4.0 * part).sin(),
                    tilt_rad: [0.02 * part, -0.01],
                })
                .unwrap_or_else(|e| panic!("{}: {e}", shape.name()));
            assert!(
                (sums(&truth.force_map())[2] / force - 1.0).abs() < 1e-3,
                "{}",
                shape.name()
            );
            worst[0] = worst[0].max(truth.residuals().gap);
            worst[1] = worst[1].max(truth.residuals().friction);
            for cell in 0..1600 {
                let [qx, qy] = truth.friction_mpa(cell);
                let p = truth.pressure_mpa()[cell];
                assert!(p >= 0.0 && qx.hypot(qy) <= FRICTION * p * (1.0 + 1e-9));
            }
        }
        println!(
            "{}: residuals up to {:.1e} gap, {:.1e} friction",
            shape.name(),
            worst[0],
            worst[1]
        );
        assert!(worst[0] <= 1e-4 && worst[1] <= 1e-4);
    }
}

#[test]
fn a_step_that_changes_nothing_changes_nothing() {
    // After a step whose box grew: the history must know what lay outside the old box.
    let mut contact = contact(
        &Gel::default(),
        40,
        Shape::Sphere { radius_mm: 12.0 },
        Mount::default(),
    );
    contact.step(drive(0.3, [0.0; 2], 0.0)).unwrap();
    contact.step(drive(0.3, [0.1, 0.0], 0.0)).unwrap();
    let grown = drive(6.0, [0.3, 0.1], 0.02);
    let first = contact.step(grown).unwrap().force_map();
    let again = contact.step(grown).unwrap().force_map();
    let off = difference(&again, &first);
    println!("a repeated step changes the map by {off:.1e}");
    assert!(off < 2e-3);
}

#[test]
fn tilt_moves_the_pressure_to_the_lowered_side() {
    let mut contact = contact(&Gel::default(), 40, TRAINING_SHAPES[4], Mount::default());
    let mut last = -1.0;
    for i in 0..5 {
        let truth = contact
            .step(Drive {
                tilt_rad: [0.02 * f64::from(i), 0.0],
                ..drive(3.0, [0.0; 2], 0.0)
            })
            .unwrap();
        let [centre, _] = truth.pressure_centre_mm().unwrap();
        assert!(centre > last && (i > 0 || centre.abs() < 1e-3), "{centre} mm");
        last = centre.max(0.01);
    }
}

#[test]
fn lifting_off_forgets_and_touching_again_starts_anew() {
    let mut contact = contact(
        &Gel::default(),
        40,
        Shape::Sphere { radius_mm: 8.0 },
        Mount::default(),
    );
    let fresh = contact.step(drive(1.0, [1.0, 0.0], 0.0)).unwrap().force_map();
    contact.step(drive(1.0, [1.5, 0.0], 0.0)).unwrap();
    let lifted = contact.step(drive(0.0, [1.5, 0.0], 0.0)).unwrap();
    assert!(!lifted.in_contact() && lifted.stick_ratio().is_none() && !lifted.gross_slip());
    assert!(lifted.force_map().iter().flatten().all(|v| *v == 0.0));
    let above = Drive {
        press: Press::Depth(-0.5),
        ..drive(0.0, [1.0, 0.0], 0.0)
    };
    assert!(!contact.step(above).unwrap().in_contact());
    let again = contact.step(drive(1.0, [1.0, 0.0], 0.0)).unwrap().force_map();
    assert!(difference(&again, &fresh) < 1e-6);
}

#[test]
fn contact_beyond_the_surface_and_bad_numbers_are_refused_and_change_nothing() {
    let mut contact = contact(
        &Gel::default(),
        40,
        Shape::Sphere { radius_mm: 12.0 },
        Mount::default(),
    );
    contact.step(drive(1.0, [10.0, 0.0], 0.0)).unwrap();
    let before = contact.truth().force_map();
    let error = contact.step(drive(15.0, [10.0, 0.0], 0.0)).unwrap_err();
    assert!(matches!(error, SimulationError::OffSurface { .. }), "{error}");
    assert!(error.to_string().contains("reaches the edge"), "{error}");
    assert!(contact.step(drive(f64::NAN, [0.0; 2], 0.0)).is_err());
    assert!(contact.step(drive(-1.0, [0.0; 2], 0.0)).is_err());
    assert!(contact.step(drive(1.0, [f64::INFINITY, 0.0], 0.0)).is_err());
    assert!(difference(&contact.truth().force_map(), &before) < 1e-12);
    assert!(GelSurface::new(&Gel::default(), 50).is_err() && GelSurface::new(&Gel::default(), 0).is_err());
    let surface = Arc::new(GelSurface::new(&Gel::default(), 40).unwrap());
    assert!(Contact::new(surface, Arc::new(Paraboloid), 0.0, Mount::default()).is_err());
}

#[test]
fn random_paths_on_random_gels_always_solve() {
    let mut random = Random::new(7, 99);
    let (mut steps, mut off, mut rounds) = (0, 0, 0);
    for (poisson, thickness_mm) in [(0.3, 3.0), (0.45, 10.0), (0.49, 6.0), (0.5, 3.0), (0.5, 6.0)] {
        let gel = Gel {
            thickness_mm,
            poisson,
            ..Gel::default()
        };
        let surface = Arc::new(GelSurface::new(&gel, 40).unwrap());
        for shape in TRAINING_SHAPES.into_iter().chain(UNSEEN_SHAPES) {
            let friction = random.uniform(0.2, 1.2);
            let mount = Mount {
                shift_mm_per_n: random.uniform(-1.0, 1.0).max(0.0),
                turn_rad_per_nmm: random.uniform(-0.05, 0.05).max(0.0),
            };
            let mut contact = Contact::new(Arc::clone(&surface), Arc::new(shape), friction, mount).unwrap();
            let mut at_mm = [random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)];
            let mut turn_rad = random.uniform(-3.0, 3.0);
            let mut force = random.log_uniform(0.1, 5.0);
            for _ in 0..8 {
                at_mm = at_mm.map(|at| at + random.uniform(-1.5, 1.5));
                turn_rad += random.uniform(-0.2, 0.2);
                force = (force * random.log_uniform(0.1, 8.0)).clamp(0.01, 8.0);
                steps += 1;
                let order = Drive {
                    press: Press::Force(force),
                    at_mm,
                    turn_rad,
                    tilt_rad: [random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05)],
                };
                match contact.step(order) {
                    Ok(truth) => rounds = rounds.max(truth.residuals().rounds),
                    Err(SimulationError::OffSurface { .. }) => off += 1,
                    Err(error) => panic!("{} on ν {poisson}, {thickness_mm} mm: {error}", shape.name()),
                }
            }
        }
    }
    println!("random paths: {steps} steps solved in at most {rounds} rounds, {off} refused at the edge");
    assert!(off < steps / 10);
}
