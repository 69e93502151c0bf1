//! What is true of a scene, as a table: one row a frame, row n for picture n and map n. Pure.
//! Units: newtons, N·mm, mm. As text, numbers are written so that reading them gives the same f64 again and flags are 0 or 1;
//! `stick_ratio` is empty when nothing touches.

use std::fmt;

use super::moment::Moment;

/// Columns of every scene, before those of the fingers.
const HEAD: [&str; 4] = ["frame", "time_s", "phase", "slip"];
/// Columns of every finger; from the second finger on with `_1` behind them.
const FINGER: [&str; 8] = [
    "fn",
    "fx",
    "fy",
    "mz",
    "stick_ratio",
    "gross_slip",
    "slip_mm",
    "indentation",
];

/// One value of a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A number of the frame.
    Count(usize),
    /// A measure; none where there is nothing to measure.
    Number(Option<f64>),
    /// Yes or no.
    Flag(bool),
    /// A name.
    Text(String),
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(f, "{count}"),
            Self::Number(Some(number)) => write!(f, "{number}"),
            Self::Number(None) => Ok(()),
            Self::Flag(truth) => write!(f, "{}", u8::from(*truth)),
            Self::Text(text) => f.write_str(text),
        }
    }
}

/// The names of the columns; `extra` are those that only this kind of scene has.
#[must_use]
pub fn names(fingers: usize, extra: &[&str]) -> Vec<String> {
    let mut names: Vec<String> = HEAD.map(String::from).to_vec();
    for finger in 0..fingers {
        names.extend(FINGER.map(|name| named(name, finger)));
    }
    names.extend(extra.iter().map(|name| (*name).to_owned()));
    names
}

/// What belongs to the first finger has its plain name, what belongs to another its number behind it.
#[must_use]
pub fn named(name: &str, finger: usize) -> String {
    if finger == 0 {
        name.to_owned()
    } else {
        format!("{name}_{finger}")
    }
}

/// The values of one frame, in the order of [`names`].
#[must_use]
pub fn row(frame: usize, moment: &Moment) -> Vec<Cell> {
    let number = |value| Cell::Number(Some(value));
    let mut cells = vec![
        Cell::Count(frame),
        number(moment.time_s),
        Cell::Text(moment.phase.clone()),
        Cell::Flag(moment.slip),
    ];
    for finger in &moment.fingers {
        let [fx, fy, normal] = finger.force_n();
        cells.extend([
            number(normal),
            number(fx),
            number(fy),
            number(finger.moment_nmm()),
            Cell::Number(finger.stick_ratio),
            Cell::Flag(finger.gross_slip),
            number(finger.slip_mm),
            number(finger.indentation),
        ]);
    }
    cells.extend(moment.extra.iter().map(|value| number(*value)));
    cells
}
