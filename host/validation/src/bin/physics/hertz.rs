//! Pressed spheres against Hertz, and thick layers against the half-space. The contact radius comes from the
//! pressure's second moment, a² = 5/2 ⟨r²⟩, and the peak from the line p² = p0² (1 − r²/a²): neither steps with
//! the cells, as counted cells and the largest cell do.

use gripline_simulation::Gel;
use gripline_simulation::closed_form::Hertz;
use gripline_simulation::contact_world::{Mount, Truth, production_cells};

use crate::chart::{Chart, Curve, Pictures};
use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::{Paraboloid, World, drive, half_space};

/// Contact radius and peak pressure of a round contact.
fn measured(truth: &Truth) -> [f64; 2] {
    let [x0, y0] = truth.pressure_centre_mm().unwrap_or_default();
    let cells = || {
        truth
            .pressure_mpa()
            .iter()
            .enumerate()
            .filter(|(_, p)| **p > 0.0)
            .map(|(cell, p)| {
                let [x, y] = truth.place_mm(cell);
                (p, (x - x0).powi(2) + (y - y0).powi(2))
            })
    };
    let sum: f64 = cells().map(|(p, _)| p).sum();
    let radius = (2.5 * cells().map(|(p, r2)| p * r2).sum::<f64>() / sum).sqrt();
    // Least squares of p² over r² inside 0.8 a.
    let inner: Vec<[f64; 2]> = cells()
        .filter(|(_, r2)| *r2 < 0.64 * radius * radius)
        .map(|(p, r2)| [r2, p * p])
        .collect();
    let count = inner.len() as f64;
    let mean = |k: usize| inner.iter().map(|v| v[k]).sum::<f64>() / count;
    let [mx, my] = [mean(0), mean(1)];
    let slope = inner.iter().map(|v| (v[0] - mx) * (v[1] - my)).sum::<f64>()
        / inner.iter().map(|v| (v[0] - mx).powi(2)).sum::<f64>();
    [radius, (my - slope * mx).sqrt()]
}

pub(crate) fn run(world: &World, report: &mut Report, pictures: &Pictures) -> Result<(), Failure> {
    let gel = half_space();
    let (mut radius, mut peak, mut depth, mut counted) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    let mut profiles = Vec::new();
    for radius_mm in [6.0, 12.0, 25.0] {
        for force_n in [0.3, 1.0, 3.0, 10.0] {
            let closed = Hertz::new(force_n, radius_mm, &gel)?;
            let mut contact = world
                .contact(
                    &gel,
                    production_cells(force_n),
                    Paraboloid { radius_mm },
                    Mount::default(),
                )?
                .vertical_pressure();
            let truth = contact.step(drive(force_n, [0.13, -0.07], 0.0))?;
            let [a, p0] = measured(truth);
            let at = || format!("{force_n} N, R {radius_mm} mm");
            radius.see(100.0 * (a / closed.radius_mm() - 1.0), at);
            peak.see(100.0 * (p0 / closed.peak_pressure_mpa() - 1.0), at);
            depth.see(100.0 * (truth.pose().depth_mm / closed.approach_mm() - 1.0), at);
            let by_cells = (truth.area_mm2() / std::f64::consts::PI).sqrt();
            counted.see(100.0 * (by_cells / closed.radius_mm() - 1.0), at);
            if radius_mm > 6.0 && radius_mm < 25.0 {
                profiles.push((force_n, closed, truth.clone()));
            }
        }
    }
    let against = "Hertz, 12 loads and radii, production grid";
    report.row(
        "hertz_radius",
        "contact radius",
        against,
        Bound::AtMost(2.0),
        (radius.value, "%"),
        &radius.at,
    );
    report.row(
        "hertz_peak",
        "peak pressure",
        against,
        Bound::AtMost(2.0),
        (peak.value, "%"),
        &peak.at,
    );
    report.row(
        "hertz_depth",
        "approach",
        against,
        Bound::AtMost(2.0),
        (depth.value, "%"),
        &depth.at,
    );
    report.row(
        "hertz_counted_radius",
        "contact radius by counted cells",
        against,
        Bound::Reported,
        (counted.value, "%"),
        &counted.at,
    );

    // A thicker and thicker layer.
    let (force_n, radius_mm) = (3.0, 12.0);
    let closed = Hertz::new(force_n, radius_mm, &gel)?;
    let mut curves = [vec![], vec![], vec![]];
    let mut thickest = 0.0_f64;
    for ratio in [1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 200.0] {
        let layer = Gel {
            thickness_mm: ratio * closed.radius_mm(),
            ..gel
        };
        let cells = production_cells(force_n);
        let mut contact = world
            .contact(&layer, cells, Paraboloid { radius_mm }, Mount::default())?
            .vertical_pressure();
        let truth = contact.step(drive(force_n, [0.13, -0.07], 0.0))?;
        let [a, p0] = measured(truth);
        let found = [
            a / closed.radius_mm(),
            p0 / closed.peak_pressure_mpa(),
            truth.pose().depth_mm / closed.approach_mm(),
        ];
        for (curve, share) in curves.iter_mut().zip(found) {
            curve.push((f64::log10(ratio), share));
        }
        thickest = found
            .iter()
            .fold(0.0, |worst, share| f64::max(worst, 100.0 * (share - 1.0).abs()));
    }
    report.row(
        "half_space_limit",
        "radius, peak, approach on a layer of 200 contact radii",
        "Hertz (half-space)",
        Bound::AtMost(2.0),
        (thickest, "%"),
        "3 N, R 12 mm",
    );

    let mut lines = Vec::new();
    for (i, (force_n, closed, truth)) in profiles.iter().enumerate() {
        let reach = closed.radius_mm() * 1.15;
        let dense = (0..=200).map(|k| f64::from(k) / 200.0 * reach);
        lines.push(Curve::line(
            "",
            i,
            dense.map(|r| (r, 1e3 * closed.pressure_mpa(r))).collect(),
        ));
        let [x0, y0] = [0.13, -0.07];
        let dots = truth
            .pressure_mpa()
            .iter()
            .enumerate()
            .filter(|(_, p)| **p > 0.0)
            .map(|(cell, p)| {
                let [x, y] = truth.place_mm(cell);
                (f64::hypot(x - x0, y - y0), 1e3 * p)
            });
        lines.push(Curve::dots(&format!("{force_n} N"), i, dots.collect()));
    }
    pictures.charts(
        "hertz",
        &[
            Chart {
                title: "Pressure under a 12 mm sphere: Hertz (lines), cells (dots)",
                x: "distance from the middle, mm",
                y: "pressure, kPa",
                x_range: [0.0, 6.5],
                y_range: [0.0, 170.0],
                rising: false,
                curves: lines,
            },
            Chart {
                title: "A thick layer becomes a half-space (3 N, R 12 mm, ν ½)",
                x: "log10 of layer thickness over Hertz radius",
                y: "share of Hertz",
                x_range: [0.0, 2.4],
                y_range: [0.0, 2.0],
                rising: true,
                curves: ["radius", "peak pressure", "approach"]
                    .into_iter()
                    .zip(curves)
                    .enumerate()
                    .map(|(i, (name, points))| Curve::both(name, i, points))
                    .collect(),
            },
        ],
    )
}
