//! A pressed sphere pulled sideways against Cattaneo and Mindlin, there and back.

use gripline_simulation::closed_form::{CattaneoMindlin, Hertz};
use gripline_simulation::contact_world::{Mount, production_cells};

use crate::chart::{Chart, Curve, Pictures};
use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::{FRICTION, Paraboloid, World, drive, half_space};

const RADIUS_MM: f64 = 12.0;
const SHARES: [f64; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95];

pub(crate) fn run(world: &World, report: &mut Report, pictures: &Pictures) -> Result<(), Failure> {
    let gel = half_space();
    let (mut stick, mut carried) = (Worst::default(), Worst::default());
    let mut ratios = Vec::new();
    for (i, force_n) in [0.3, 1.0, 3.0, 10.0].into_iter().enumerate() {
        let hertz = Hertz::new(force_n, RADIUS_MM, &gel)?;
        let closed = CattaneoMindlin::new(hertz, FRICTION, &gel)?;
        let cells = production_cells(force_n);
        let mut contact = world
            .contact(&gel, cells, Paraboloid { radius_mm: RADIUS_MM }, Mount::default())?
            .vertical_pressure();
        contact.step(drive(force_n, [0.13, -0.07], 0.0))?;
        let mut dots = Vec::new();
        for share in SHARES {
            let shift = closed.displacement_mm(share * closed.limit_n())?;
            let truth = contact.step(drive(force_n, [0.13 + shift, -0.07], 0.0))?;
            let pull = truth.force_n()[0];
            let at = || format!("Q/μP {share}, {force_n} N, {cells} cells");
            carried.see(100.0 * (pull / closed.limit_n() - share), at);
            let found = truth.stick_ratio().unwrap_or(f64::NAN);
            stick.see(found - closed.stick_ratio(pull.min(closed.limit_n()))?, at);
            dots.push((pull / closed.limit_n(), found));
        }
        ratios.push(Curve::dots(&format!("{force_n} N, {cells} cells"), i, dots));
    }
    report.row(
        "cattaneo_mindlin_stick_ratio",
        "true stick ratio, Q/μP 0.1 … 0.95",
        "Cattaneo–Mindlin, 4 loads, production grid",
        Bound::AtMost(0.03),
        (stick.value, ""),
        &stick.at,
    );
    report.row(
        "cattaneo_mindlin_pull",
        "pull carried at a given shift, share of μP",
        "Cattaneo–Mindlin",
        Bound::AtMost(2.0),
        (carried.value, "%"),
        &carried.at,
    );

    // There, back to the opposite pull, and there again.
    let force_n = 3.0;
    let hertz = Hertz::new(force_n, RADIUS_MM, &gel)?;
    let closed = CattaneoMindlin::new(hertz, FRICTION, &gel)?;
    let mut contact = world
        .contact(
            &gel,
            production_cells(force_n),
            Paraboloid { radius_mm: RADIUS_MM },
            Mount::default(),
        )?
        .vertical_pressure();
    contact.step(drive(force_n, [0.0; 2], 0.0))?;
    let limit = closed.limit_n();
    let peak = 0.8 * limit;
    let top = closed.displacement_mm(peak)?;
    let mut off = Worst::default();
    let (mut found, mut exact) = (vec![(0.0, 0.0)], vec![(0.0, 0.0)]);
    let steps = 20;
    for i in 1..=5 * steps {
        let part = f64::from(i) / f64::from(steps);
        let shift = match part {
            part if part <= 1.0 => part,
            part if part <= 3.0 => 2.0 - part,
            part => part - 4.0,
        } * top;
        let pull = contact.step(drive(force_n, [shift, 0.0], 0.0))?.force_n()[0];
        // The closed form gives the shift of a pull.
        let at_pull = |q: f64| -> Result<f64, Failure> {
            Ok(if part <= 1.0 {
                closed.displacement_mm(q.max(0.0))?
            } else if part <= 3.0 {
                closed.unloading_displacement_mm(peak, q)?
            } else {
                -closed.unloading_displacement_mm(peak, -q)?
            })
        };
        let (mut low, mut high) = (-peak, peak);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if at_pull(middle)? < shift {
                low = middle;
            } else {
                high = middle;
            }
        }
        off.see(100.0 * (pull - low) / limit, || {
            format!("at {:.2} of the loop", part / 5.0)
        });
        found.push((1e3 * shift, pull / limit));
        exact.push((1e3 * shift, low / limit));
    }
    report.row(
        "cattaneo_mindlin_loop",
        "pull on a loop to 0.8 μP, −0.8 μP and back, share of μP",
        "Mindlin and Deresiewicz",
        Bound::AtMost(2.0),
        (off.value, "%"),
        &off.at,
    );
    let dense: Vec<f64> = (0..=200).map(|k| f64::from(k) / 200.0).collect();
    let mut curves = vec![Curve::line(
        "closed form",
        7,
        dense.iter().map(|q| (*q, (1.0 - q).powf(2.0 / 3.0))).collect(),
    )];
    curves.extend(ratios);
    pictures.charts(
        "cattaneo-mindlin",
        &[
            Chart {
                title: "Stick ratio of a pulled sphere: (1 − Q/μP)^(2/3) and cells",
                x: "pull Q/μP",
                y: "share of the contact that sticks",
                x_range: [0.0, 1.0],
                y_range: [0.0, 1.0],
                rising: false,
                curves,
            },
            Chart {
                title: "Pulled there, back and there again (3 N)",
                x: "shift, µm",
                y: "pull Q/μP",
                x_range: [-1e3 * top * 1.1, 1e3 * top * 1.1],
                y_range: [-1.0, 1.0],
                rising: true,
                curves: vec![
                    Curve::line("closed form", 7, exact),
                    Curve::dots("cells", 0, found),
                ],
            },
        ],
    )
}
