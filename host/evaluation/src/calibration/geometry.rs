//! How a fingertip sits in the gripper, from presses at known marks. Pure. Marks in mm; positions on the sensor surface in
//! taxel pitches from the map's centre, as seen from outside.
//!
//! A mark m and the centre of pressure u of its press satisfy m = c + p·T(u): T rotates by quarter turns (and mirrors for the
//! second fingertip, which faces the first), p is the taxel pitch, c the map's centre. For each of the four rotations p and c
//! follow by least squares; the fit with the smallest residual wins. The residuals of a free rotation and of mirrored marks
//! show what is wrong. Limits: the centre of pressure must be the centre of the press: a ball or a pin, pressed straight.

use gripline_protocol::{SIDE, TAXELS};

/// Minimum number of presses: two more than the unknowns need.
pub const PRESSES_MIN: usize = 4;
/// Minimum normal force of a contact, N.
const NORMAL_MIN_N: f64 = 0.3;
/// Minimum number of maps of a press.
const FRAMES_MIN: usize = 4;
/// Maps count from this share of the press's maximum force: at its start and end the pressure wanders.
const PRESSED: f64 = 0.7;
/// Taxels count from this share of the maximum normal force: below it the network's errors are as large as the force.
const LOADED: f64 = 0.2;
/// Minimum spread of the marks across their best line, standard deviation, mm: marks on a line look the same mirrored.
const BREADTH_MM: f64 = 1.5;
/// Maximum residual of a press, mm: half a taxel.
const REST_MAX_MM: f64 = 0.8;
/// Maximum rotation beyond the quarter turns, degrees.
const OFF_MAX_DEG: f64 = 10.0;
/// Maximum deviation of the taxel pitch from the nominal one, share.
const PITCH_OFF: f64 = 0.2;

/// Where one force map is pressed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// When, s.
    pub t_s: f64,
    /// ΣF_N of the loaded taxels, N.
    pub normal_n: f64,
    /// Centre of pressure of the loaded taxels.
    pub place: [f64; 2],
}

/// A press: one contact from its beginning to its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// Its first frame, s.
    pub from_s: f64,
    /// Its last frame, s.
    pub to_s: f64,
    /// How many frames it has.
    pub frames: usize,
    /// Mean normal force, N.
    pub normal_n: f64,
    /// Mean centre of pressure.
    pub place: [f64; 2],
}

/// How the fingertip sits.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Distance between taxel centres.
    pub pitch_mm: f64,
    /// The map's centre in the gripper's frame.
    pub centre_mm: [f64; 2],
    /// Counter-clockwise.
    pub quarter_turns: u8,
    /// What a free rotation would add, degrees.
    pub off_deg: f64,
    /// Distance of each mark from its fitted press, mm.
    pub rests_mm: Vec<f64>,
}

impl Fit {
    /// Root mean square of the residuals.
    #[must_use]
    pub fn rms_mm(&self) -> f64 {
        let squares = self.rests_mm.iter().map(|rest| rest * rest).sum::<f64>();
        (squares / self.rests_mm.len() as f64).sqrt()
    }

    /// The largest residual.
    pub fn max_mm(&self) -> f64 {
        self.rests_mm.iter().copied().fold(0.0, f64::max)
    }
}

impl Touch {
    /// From a map, newtons per taxel.
    pub fn of(t_s: f64, map: &[[f64; 3]; TAXELS]) -> Self {
        let peak = map.iter().map(|force| force[2]).fold(0.0, f64::max);
        let middle = (SIDE as f64 - 1.0) / 2.0;
        let (mut loaded_n, mut sums) = (0.0, [0.0; 2]);
        for (taxel, force) in map.iter().enumerate() {
            let normal = force[2];
            if normal > 0.0 && normal >= LOADED * peak {
                let place = [taxel % SIDE, taxel / SIDE].map(|at| at as f64 - middle);
                loaded_n += normal;
                sums = [0, 1].map(|axis| sums[axis] + normal * place[axis]);
            }
        }
        Self {
            t_s,
            normal_n: map.iter().map(|force| force[2]).sum(),
            place: if loaded_n > 0.0 {
                sums.map(|sum| sum / loaded_n)
            } else {
                [0.0; 2]
            },
        }
    }
}

/// The presses of a recording, in order of time.
#[must_use]
pub fn presses(touches: &[Touch]) -> Vec<Press> {
    let contacts = touches.split(|touch| touch.normal_n < NORMAL_MIN_N);
    contacts
        .filter_map(|contact| {
            let peak = contact.iter().map(|touch| touch.normal_n).fold(0.0, f64::max);
            let pressed: Vec<&Touch> = contact
                .iter()
                .filter(|touch| touch.normal_n >= PRESSED * peak)
                .collect();
            let count = pressed.len() as f64;
            let mean =
                |of: &dyn Fn(&Touch) -> f64| pressed.iter().map(|touch| of(touch)).sum::<f64>() / count;
            (pressed.len() >= FRAMES_MIN).then(|| Press {
                from_s: contact[0].t_s,
                to_s: contact[contact.len() - 1].t_s,
                frames: pressed.len(),
                normal_n: mean(&|touch| touch.normal_n),
                place: [mean(&|touch| touch.place[0]), mean(&|touch| touch.place[1])],
            })
        })
        .collect()
}

/// A position on the sensor surface in the gripper's frame, before pitch and centre.
fn turned(place: [f64; 2], quarter_turns: u8, mirrored: bool) -> [f64; 2] {
    let [x, y] = (0..quarter_turns).fold(place, |[x, y], _| [-y, x]);
    if mirrored { [-x, y] } else { [x, y] }
}

fn mean(places: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / places.len() as f64)
}

/// Standard deviation across the best line through the places.
fn breadth(places: &[[f64; 2]]) -> f64 {
    let [mx, my] = mean(places);
    let count = places.len() as f64;
    let sum =
        |of: &dyn Fn(f64, f64) -> f64| places.iter().map(|[x, y]| of(x - mx, y - my)).sum::<f64>() / count;
    let (xx, yy, xy) = (sum(&|x, _| x * x), sum(&|_, y| y * y), sum(&|x, y| x * y));
    let min = f64::midpoint(xx, yy) - (((xx - yy) / 2.0).powi(2) + xy * xy).sqrt();
    min.max(0.0).sqrt()
}

/// The best fit over all quarter turns; `None` when the presses lie in one place.
fn best(marks: &[[f64; 2]], places: &[[f64; 2]], mirrored: bool) -> Option<Fit> {
    let centre = mean(marks);
    let of = |quarter_turns: u8| {
        let turned: Vec<[f64; 2]> = places
            .iter()
            .map(|place| turned(*place, quarter_turns, mirrored))
            .collect();
        let middle = mean(&turned);
        let (mut along, mut across, mut square) = (0.0, 0.0, 0.0);
        for (place, mark) in turned.iter().zip(marks) {
            let [px, py] = [0, 1].map(|axis| place[axis] - middle[axis]);
            let [mx, my] = [0, 1].map(|axis| mark[axis] - centre[axis]);
            along += px * mx + py * my;
            across += px * my - py * mx;
            square += px * px + py * py;
        }
        let pitch_mm = along / square;
        let centre_mm = [0, 1].map(|axis| centre[axis] - pitch_mm * middle[axis]);
        let rests_mm = turned.iter().zip(marks).map(|(place, mark)| {
            let [x, y] = [0, 1].map(|axis| centre_mm[axis] + pitch_mm * place[axis] - mark[axis]);
            x.hypot(y)
        });
        (square > 0.0 && pitch_mm > 0.0).then(|| Fit {
            pitch_mm,
            centre_mm,
            quarter_turns,
            off_deg: across.atan2(along).to_degrees(),
            rests_mm: rests_mm.collect(),
        })
    };
    (0..4)
        .filter_map(of)
        .min_by(|one, other| one.rms_mm().total_cmp(&other.rms_mm()))
}

/// How the fingertip sits: `places[k]` was pressed at `marks[k]`. `is_second` is the fingertip that faces the first.
///
/// # Errors
/// What was found, what was expected, and what to do.
pub fn fit(
    marks: &[[f64; 2]],
    places: &[[f64; 2]],
    is_second: bool,
    expected_pitch_mm: f64,
) -> Result<Fit, String> {
    if marks.len() < PRESSES_MIN {
        return Err(format!(
            "found {} marks, expected at least {PRESSES_MIN}: fewer say nothing of their own errors",
            marks.len()
        ));
    }
    if places.len() != marks.len() {
        return Err(format!(
            "found {} presses, expected {}, one for each mark in their order: press each for half a second with 1 N or more, and \
             lift in between",
            places.len(),
            marks.len()
        ));
    }
    let found_breadth = breadth(marks);
    if found_breadth < BREADTH_MM {
        return Err(format!(
            "found marks within {found_breadth:.1} mm of a line, expected at least {BREADTH_MM}: marks on a line look the same \
             mirrored; put some beside it"
        ));
    }
    let in_one_place =
        || "found all presses in one place, expected them as far apart as the marks".to_owned();
    let found = best(marks, places, is_second).ok_or_else(in_one_place)?;
    // Most marks do not fit a mirrored sensor at all.
    if let Some(mirrored) = best(marks, places, !is_second)
        && mirrored.rms_mm() < 0.5 * found.rms_mm()
        && mirrored.max_mm() <= REST_MAX_MM
    {
        return Err(format!(
            "found the marks mirrored ({:.2} mm are left over, {:.2} the other way round), expected them as the fingertip sees \
             them: is it fingertip {}, or was x counted the other way?",
            found.rms_mm(),
            mirrored.rms_mm(),
            if is_second { 1 } else { 2 }
        ));
    }
    if (found.pitch_mm / expected_pitch_mm - 1.0).abs() > PITCH_OFF {
        return Err(format!(
            "found {:.3} mm between taxels, expected {expected_pitch_mm} within {:.0} %: are the marks in millimetres, and were \
             they pressed in this order? For another skin say --pitch-mm",
            found.pitch_mm,
            100.0 * PITCH_OFF
        ));
    }
    if found.off_deg.abs() > OFF_MAX_DEG {
        return Err(format!(
            "found the skin turned by {:.0}° beside its quarter turns, expected at most {OFF_MAX_DEG}: turn it in its mount, or \
             the jig",
            found.off_deg
        ));
    }
    if found.max_mm() > REST_MAX_MM {
        let worst = (0..marks.len())
            .max_by(|&a, &b| found.rests_mm[a].total_cmp(&found.rests_mm[b]))
            .unwrap_or_default();
        let [x, y] = marks[worst];
        return Err(format!(
            "found press {} {:.1} mm from its mark ({x}, {y}), expected at most {REST_MAX_MM}: press straight, in the order of the \
             marks",
            worst + 1,
            found.rests_mm[worst]
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CROSS: [[f64; 2]; 5] = [[0.0, 0.0], [5.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -5.0]];

    /// Where the marks are pressed on a sensor mounted like this, each off by `error`.
    fn places(
        marks: &[[f64; 2]],
        (pitch_mm, centre_mm, quarter_turns): (f64, [f64; 2], u8),
        is_second: bool,
        error: f64,
    ) -> Vec<[f64; 2]> {
        let place = |(number, mark): (usize, &[f64; 2])| {
            let [x, y] = [0, 1].map(|axis| (mark[axis] - centre_mm[axis]) / pitch_mm);
            let x = if is_second { -x } else { x };
            let [x, y] = (0..quarter_turns).fold([x, y], |[x, y], _| [y, -x]);
            [
                x + error * (number as f64).sin(),
                y + error * (2.0 * number as f64).cos(),
            ]
        };
        marks.iter().enumerate().map(place).collect()
    }

    proptest! {
        #[test]
        fn whatever_its_geometry_it_is_found(
            pitch_mm in 1.4..1.8,
            centre_mm in prop::array::uniform2(-8.0..8.0),
            quarter_turns in 0_u8..4,
            is_second in any::<bool>(),
            error in 0.0..0.1,
        ) {
            let places = places(&CROSS, (pitch_mm, centre_mm, quarter_turns), is_second, error);
            let found = fit(&CROSS, &places, is_second, 1.6).unwrap();
            prop_assert_eq!(found.quarter_turns, quarter_turns);
            prop_assert!((found.pitch_mm - pitch_mm).abs() <= 1e-9 + 0.6 * error, "{:?}", found);
            for (found, true_mm) in found.centre_mm.into_iter().zip(centre_mm) {
                prop_assert!((found - true_mm).abs() <= 1e-9 + 6.0 * error, "{} for {}", found, true_mm);
            }
            prop_assert!(found.max_mm() <= 1e-9 + 4.0 * error);
        }
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_to_do() {
        let good = places(&CROSS, (1.6, [1.0, 2.0], 1), false, 0.0);
        let said = |marks: &[[f64; 2]], places: &[[f64; 2]]| fit(marks, places, false, 1.6).unwrap_err();
        assert!(said(&CROSS[..3], &good[..3]).contains("found 3 marks, expected at least 4"));
        assert!(said(&CROSS, &good[..4]).contains("found 4 presses, expected 5"));
        let line = [[0.0, 0.0], [2.0, 2.1], [4.0, 4.0], [6.0, 5.9]];
        assert!(said(&line, &good[..4]).contains("of a line"));
        assert!(said(&CROSS, &[[1.0, 1.0]; 5]).contains("in one place"));
        let half = CROSS.map(|mark| mark.map(|part| part * 0.5));
        assert!(said(&half, &good).contains("are the marks in millimetres"));
        // Marks without mirror symmetry.
        let odd = [[0.0, 0.0], [6.0, 0.0], [0.0, 3.0], [-5.0, 1.0], [2.0, -5.0]];
        let other = places(&odd, (1.6, [0.0, 0.0], 0), true, 0.0);
        assert!(
            said(&odd, &other).contains("is it fingertip 2"),
            "{}",
            said(&odd, &other)
        );
        let mut wrong = good.clone();
        wrong[2][0] += 1.5;
        assert!(
            said(&CROSS, &wrong).contains("found press 3"),
            "{}",
            said(&CROSS, &wrong)
        );
        let (sin, cos) = 20_f64.to_radians().sin_cos();
        let askew: Vec<_> = good
            .iter()
            .map(|[x, y]| [cos * x - sin * y, sin * x + cos * y])
            .collect();
        assert!(
            said(&CROSS, &askew).contains("beside its quarter turns"),
            "{}",
            said(&CROSS, &askew)
        );
    }

    #[test]
    fn presses_are_the_contacts_that_last_and_lie_where_the_force_is() {
        let map = |column: usize, row: usize, force_n: f64| {
            let mut map = [[0.0; 3]; TAXELS];
            map[row * SIDE + column][2] = force_n;
            map[row * SIDE + column + 1][2] = force_n;
            map
        };
        let mut touches = Vec::new();
        for (column, row, force_n, frames) in [
            (9, 9, 0.5, 6),
            (9, 9, 0.0, 2),
            (15, 3, 2.0, 5),
            (0, 0, 0.0, 2),
            // A brief touch.
            (4, 4, 1.0, 3),
        ] {
            for _ in 0..frames {
                touches.push(Touch::of(touches.len() as f64, &map(column, row, force_n)));
            }
        }
        let found = presses(&touches);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].place, found[0].frames), ([0.0, -0.5], 6));
        assert_eq!((found[1].place, found[1].from_s), ([6.0, -6.5], 8.0));
        assert!((found[1].normal_n - 4.0).abs() < 1e-12);
    }
}
