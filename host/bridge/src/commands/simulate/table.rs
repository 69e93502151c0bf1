//! truth.csv: one row a frame, row n for frames/n.png and map n of maps.npy. Pure.
//! Units: newtons, N·mm, mm. Numbers are written so that reading them gives the same f64 again; flags are 0 or 1;
//! `stick_ratio` is empty when nothing touches.

use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_simulation::ForceMap;

use super::play::Moment;

/// Columns of every scene, before those of the fingers.
pub const HEAD: [&str; 4] = ["frame", "time_s", "phase", "slip"];
/// Columns of every finger; from the second finger on with `_1` behind them.
pub const FINGER: [&str; 8] = [
    "fn",
    "fx",
    "fy",
    "mz",
    "stick_ratio",
    "gross_slip",
    "slip_mm",
    "indentation",
];

/// The line with the names of the columns.
pub(super) fn header(fingers: usize, extra: &[&str]) -> String {
    let mut names: Vec<String> = HEAD.map(String::from).to_vec();
    for finger in 0..fingers {
        names.extend(FINGER.map(|name| named(name, finger)));
    }
    names.extend(extra.iter().map(|name| (*name).to_owned()));
    names.join(",") + "\n"
}

/// What belongs to the first finger has its plain name, what belongs to another its number behind it.
pub(super) fn named(name: &str, finger: usize) -> String {
    if finger == 0 {
        name.to_owned()
    } else {
        format!("{name}_{finger}")
    }
}

/// The line of one frame.
pub(super) fn row(frame: usize, moment: &Moment) -> String {
    let flag = |truth: bool| u8::from(truth).to_string();
    let mut cells = vec![
        frame.to_string(),
        moment.time_s.to_string(),
        moment.phase.clone(),
        flag(moment.slip),
    ];
    for finger in &moment.fingers {
        let [fx, fy, normal] = force_n(&finger.forces);
        cells.extend([
            normal.to_string(),
            fx.to_string(),
            fy.to_string(),
            moment_nmm(&finger.forces).to_string(),
            finger
                .stick_ratio
                .map_or_else(String::new, |ratio| ratio.to_string()),
            flag(finger.gross_slip),
            finger.slip_mm.to_string(),
            finger.indentation.to_string(),
        ]);
    }
    cells.extend(moment.extra.iter().map(ToString::to_string));
    cells.join(",") + "\n"
}

/// Sum of a map, N: x, y, z.
pub(super) fn force_n(forces: &ForceMap) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for force in forces {
        for (sum, more) in sum.iter_mut().zip(force) {
            *sum += f64::from(*more);
        }
    }
    sum
}

/// Moment about z at the middle of the map, N·mm, as `gripline detect` computes it.
fn moment_nmm(forces: &ForceMap) -> f64 {
    let at = |i: usize| (i as f64 - 9.5) * TAXEL_PITCH_MM;
    forces
        .iter()
        .enumerate()
        .map(|(taxel, [fx, fy, _])| at(taxel % 20) * f64::from(*fy) - at(taxel / 20) * f64::from(*fx))
        .sum()
}
