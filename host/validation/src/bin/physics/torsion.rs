//! A pressed contact twisted about its normal against Lubkin's relation and the moments of full slip.

use std::f64::consts::PI;

use gripline_simulation::closed_form::{Hertz, Torsion};
use gripline_simulation::contact_world::{HeightMap, Mount, WALL_MM, production_cells};

use crate::chart::{Chart, Curve, Pictures};
use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::{FRICTION, Paraboloid, World, drive, half_space};

const RADIUS_MM: f64 = 12.0;

/// The end of a rod, shaped as the half-space sinks under even pressure on a disc: w(0) − w(r) with w(r) =
/// (4 p a / π E*) E(r/a) (Johnson 3.29a), so that the pressure under it is even.
#[derive(Debug, Clone, Copy)]
struct EvenPress {
    radius_mm: f64,
    /// p / E*.
    pressure: f64,
}

/// Complete elliptic integral of the second kind of modulus k (midpoint rule of a periodic integrand).
fn elliptic_e(k: f64) -> f64 {
    let steps = 64;
    let sum: f64 = (0..steps)
        .map(|i| (f64::from(i) + 0.5) / f64::from(steps) * 0.5 * PI)
        .map(|t| (1.0 - (k * t.sin()).powi(2)).max(0.0).sqrt())
        .sum();
    sum * 0.5 * PI / f64::from(steps)
}

impl HeightMap for EvenPress {
    fn height_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let r = f64::hypot(x, y) / self.radius_mm;
        if r > 1.0 {
            return WALL_MM;
        }
        4.0 * self.pressure * self.radius_mm / PI * (0.5 * PI - elliptic_e(r))
    }
}

pub(crate) fn run(world: &World, report: &mut Report, pictures: &Pictures) -> Result<(), Failure> {
    let gel = half_space();
    let (mut moment, mut stick, mut full) = (Worst::default(), Worst::default(), Worst::default());
    let (mut curve, mut dots) = (Vec::new(), Vec::new());
    for (case, force_n) in [1.0, 3.0, 10.0].into_iter().enumerate() {
        let drawn = case == 1;
        let hertz = Hertz::new(force_n, RADIUS_MM, &gel)?;
        let a = hertz.radius_mm();
        let closed = Torsion::new(hertz, FRICTION, &gel)?;
        let cells = production_cells(force_n);
        let mut contact = world
            .contact(&gel, cells, Paraboloid { radius_mm: RADIUS_MM }, Mount::default())?
            .vertical_pressure();
        contact.step(drive(force_n, [0.0; 2], 0.0))?;
        let mut last = 0.0;
        for share in [0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2] {
            let turn = closed.rotation_rad(share * a);
            let truth = contact.go(drive(force_n, [0.0; 2], turn), 2)?;
            let found = truth.torsional_moment_nmm([0.0; 2]);
            let at = || format!("c/a {share}, {force_n} N, {cells} cells");
            moment.see(100.0 * (found / closed.moment_nmm(share * a) - 1.0), at);
            stick.see(truth.stick_ratio().unwrap_or(f64::NAN) - share * share, at);
            last = turn;
            if drawn {
                dots.push((turn, found / closed.limit_nmm()));
            }
        }
        if drawn {
            curve = (1..=100)
                .map(|k| 1.0 - 0.9 * f64::from(k) / 100.0)
                .map(|c| {
                    (
                        closed.rotation_rad(c * a),
                        closed.moment_nmm(c * a) / closed.limit_nmm(),
                    )
                })
                .collect();
        }
        // On, in steps of less than a cell at the rim, until all slips.
        let step = 0.8 * 32.0 / cells as f64 / a;
        let mut turn = last;
        let mut truth = contact.truth();
        while !truth.gross_slip() && turn < 20.0 {
            turn += step;
            truth = contact.step(drive(force_n, [0.0; 2], turn))?;
        }
        for _ in 0..8 {
            turn += step;
            truth = contact.step(drive(force_n, [0.0; 2], turn))?;
        }
        full.see(
            100.0 * (truth.torsional_moment_nmm([0.0; 2]) / closed.limit_nmm() - 1.0),
            || format!("{force_n} N, {cells} cells"),
        );
    }
    let lubkin = "Lubkin, 3 loads, production grid";
    report.row(
        "torsion_moment_twist",
        "moment at a given rotation, stick radius 0.95 … 0.2 a",
        lubkin,
        Bound::AtMost(5.0),
        (moment.value, "%"),
        &moment.at,
    );
    report.row(
        "torsion_stick_ratio",
        "true stick ratio at a given rotation",
        lubkin,
        Bound::Reported,
        (stick.value, ""),
        &stick.at,
    );
    report.row(
        "torsion_full_hertz",
        "moment at full slip, Hertz pressure",
        "(3π/16) μPa",
        Bound::AtMost(3.0),
        (full.value, "%"),
        &full.at,
    );

    let mut even = Worst::default();
    let mut spread = 0.0_f64;
    for (radius_mm, force_n) in [(4.0, 3.0), (6.0, 5.0), (8.0, 5.0)] {
        let pressure = force_n / (PI * radius_mm * radius_mm);
        let indenter = EvenPress {
            radius_mm,
            pressure: pressure / gel.contact_modulus_mpa(),
        };
        let mut contact = world
            .contact(&gel, production_cells(force_n), indenter, Mount::default())?
            .vertical_pressure();
        contact.step(drive(force_n, [0.0; 2], 0.0))?;
        let step = 0.8 * 32.0 / production_cells(force_n) as f64 / radius_mm;
        for i in 1..=40 {
            contact.step(drive(force_n, [0.0; 2], step * f64::from(i)))?;
            if contact.truth().gross_slip() && i > 12 {
                break;
            }
        }
        let truth = contact.truth();
        let limit = 2.0 / 3.0 * FRICTION * force_n * radius_mm;
        even.see(
            100.0 * (truth.torsional_moment_nmm([0.0; 2]) / limit - 1.0),
            || format!("{force_n} N, a {radius_mm} mm"),
        );
        for (cell, p) in truth.pressure_mpa().iter().enumerate() {
            let [x, y] = truth.place_mm(cell);
            if f64::hypot(x, y) < 0.8 * radius_mm {
                spread = spread.max((p / pressure - 1.0).abs());
            }
        }
    }
    report.row(
        "torsion_full_uniform",
        "moment at full slip, even pressure",
        "(2/3) μPa, 3 radii",
        Bound::AtMost(3.0),
        (even.value, "%"),
        &format!(
            "{}; pressure even to {:.1} % inside 0.8 a",
            even.at,
            100.0 * spread
        ),
    );
    let to = dots.last().map_or(1.0, |d| d.0) * 1.05;
    pictures.charts(
        "torsion",
        &[Chart {
            title: "A twisted sphere: Lubkin's relation and cells (3 N)",
            x: "twist, rad",
            y: "moment over (3π/16) μPa",
            x_range: [0.0, to],
            y_range: [0.0, 1.05],
            rising: true,
            curves: vec![
                Curve::line("closed form", 7, curve),
                Curve::dots("cells", 0, dots),
            ],
        }],
    )
}
