//! preview.png: what a scene looks like at one glance. Columns are the rest and a few frames; rows the camera's
//! picture, its difference from rest, the true force map, and what sticks and slips. Pure.

use super::canvas::{Canvas, Grey, LETTER, SLIP, STICK, TEXT, ramp};
use gripline_evaluation::play::{FingerMoment, Moment};

/// Frames that a sheet shows at most.
pub(super) const MOST: usize = 6;
/// Between the pictures, pixels.
const GAP: usize = 8;
/// Lines of text above a column.
const HEAD: usize = 4 * (LETTER + 3) + GAP;
/// How much a difference is amplified.
const DIFFERENCE: i32 = 3;
const SIDE: usize = Grey::SIDE;

/// One column of the sheet.
#[derive(Debug, Clone)]
pub(super) struct Column {
    pub(super) picture: Grey,
    pub(super) moment: Moment,
}

/// Largest normal and tangential force on a taxel, N; never 0.
pub(super) fn full_scale<'a>(fingers: impl Iterator<Item = &'a FingerMoment>) -> [f64; 2] {
    let mut full = [1e-6_f64; 2];
    for force in fingers.flat_map(|finger| finger.forces) {
        let [x, y, z] = force.map(f64::from);
        full = [full[0].max(z), full[1].max(x.hypot(y))];
    }
    full
}

/// Draws the sheet of one finger.
pub(super) fn draw(title: &str, rest: &Grey, columns: &[Column], finger: usize) -> Canvas {
    let width = GAP + (columns.len() + 1) * (SIDE + GAP);
    let mut canvas = Canvas::new(width, HEAD + 4 * (SIDE + GAP));
    let full = full_scale(columns.iter().map(|column| &column.moment.fingers[finger]));
    let row = |row: usize| HEAD + row * (SIDE + GAP);
    let line = |line: usize| GAP / 2 + line * (LETTER + 3);

    canvas.text([GAP, line(0)], title, TEXT);
    canvas.text([GAP, line(3)], "at rest", TEXT);
    canvas.grey([GAP, row(0)], rest, |pixel| rest.levels[pixel]);
    canvas.text([GAP, row(1)], "difference from rest, x 3", TEXT);
    canvas.text([GAP, row(2)], "normal force per taxel", TEXT);
    for x in 0..SIDE {
        let colour = ramp(x as f64 / SIDE as f64);
        canvas.fill([GAP + x, row(2) + 14], [1, 12], colour);
    }
    canvas.text([GAP, row(2) + 30], "0", TEXT);
    let max = format!("{:.3} N", full[0]);
    canvas.text([GAP + SIDE - max.len() * LETTER, row(2) + 30], &max, TEXT);
    canvas.text([GAP, row(2) + 50], "lines: shear, longest", TEXT);
    canvas.text(
        [GAP, row(2) + 62],
        &format!("{:.3} N, foot on taxel", full[1]),
        TEXT,
    );
    for (at, colour, text) in [(0, STICK, "sticks"), (16, SLIP, "slips")] {
        canvas.fill([GAP, row(3) + at], [LETTER, LETTER], colour);
        canvas.text([GAP + 2 * LETTER, row(3) + at], text, TEXT);
    }
    for (place, column) in columns.iter().enumerate() {
        let x = GAP + (place + 1) * (SIDE + GAP);
        let (moment, state) = (&column.moment, &column.moment.fingers[finger]);
        let [fx, fy, normal] = state.force_n();
        let ratio = state
            .stick_ratio
            .map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
        let label = if moment.slip { "  SLIP" } else { "" };
        canvas.text(
            [x, line(1)],
            &format!("{:.3} s  {}", moment.time_s, moment.phase),
            TEXT,
        );
        canvas.text(
            [x, line(2)],
            &format!("FN {normal:.2} N  FT {:.2} N", fx.hypot(fy)),
            TEXT,
        );
        canvas.text([x, line(3)], &format!("stick ratio {ratio}{label}"), TEXT);
        let picture = &column.picture;
        canvas.grey([x, row(0)], picture, |pixel| picture.levels[pixel]);
        canvas.grey([x, row(1)], picture, |pixel| {
            let change = i32::from(picture.levels[pixel]) - i32::from(rest.levels[pixel]);
            (128 + DIFFERENCE * change).clamp(0, 255) as u8
        });
        canvas.forces([x, row(2)], SIDE, &state.forces, full);
        canvas.states([x, row(3)], SIDE, &state.states);
    }
    canvas
}
