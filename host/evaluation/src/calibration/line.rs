//! Fits the table of the grip-force line to measured forces. Pure. Newtons, codes of the 12-bit DAC.
//!
//! Least squares of a piecewise linear function, force over code, with four pieces and evenly spaced corners; the first corner
//! then moves along its piece to the code of 0 N, where the microcontroller's table begins.
//! Limits: it must rise everywhere; a dead zone below the first force is fitted only as far as it was measured.

use gripline_protocol::line::{DAC_CODE_MAX, LINE_POINTS, LIVE_ZERO_MIN};

use serde::{Deserialize, Serialize};

/// A point of the grip-force line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Grip force, newtons.
    pub force_n: f64,
    /// Code of the DAC.
    pub code: u16,
}

/// Minimum number of measurements: twice the table's points.
pub const MEASURED_MIN: usize = 2 * LINE_POINTS;

/// A force measured at a code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Code of the DAC.
    pub code: u16,
    /// Measured force, newtons.
    pub force_n: f64,
}

/// The table and how well it fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The table.
    pub points: [Point; LINE_POINTS],
    /// Root mean square of the residuals.
    pub rms_n: f64,
    /// Largest residual.
    pub max_n: f64,
}

/// Fits the table.
///
/// # Errors
/// What was found, expected, and what to do.
pub fn fit(measured: &[Measured]) -> Result<Fit, String> {
    check(measured)?;
    let codes = measured.iter().map(|one| f64::from(one.code));
    let (min_code, max_code) = codes.fold((f64::MAX, 0.0_f64), |(min_code, max_code), code| {
        (min_code.min(code), max_code.max(code))
    });
    let step = (max_code - min_code) / (LINE_POINTS - 1) as f64;
    let hats = |code: f64| -> [f64; LINE_POINTS] {
        std::array::from_fn(|place| (1.0 - ((code - min_code) / step - place as f64).abs()).max(0.0))
    };
    let mut system = [[0.0; LINE_POINTS + 1]; LINE_POINTS];
    for one in measured {
        let hats = hats(one.code.into());
        for (row, a) in system.iter_mut().zip(hats) {
            for (sum, b) in row.iter_mut().zip(hats) {
                *sum += a * b;
            }
            row[LINE_POINTS] += a * one.force_n;
        }
    }
    let forces = solve(system).ok_or_else(|| {
        format!("found codes that leave a quarter of the way from {min_code} to {max_code} empty, expected them spread evenly")
    })?;
    if let Some(place) = forces.windows(2).position(|pair| pair[1] <= pair[0]) {
        let code = |place: usize| (min_code + step * place as f64).round();
        return Err(format!(
            "found {:.2} N at code {} and {:.2} N at code {}, expected the force to rise with the code: measure these again",
            forces[place],
            code(place),
            forces[place + 1],
            code(place + 1)
        ));
    }
    let residuals = measured.iter().map(|one| {
        let fitted: f64 = hats(one.code.into())
            .iter()
            .zip(forces)
            .map(|(hat, force)| hat * force)
            .sum();
        fitted - one.force_n
    });
    let (squares, max_n) = residuals.fold((0.0, 0.0_f64), |(sum, max), r| (sum + r * r, max.max(r.abs())));
    // Extend the first piece to where the force is 0.
    let zero = min_code - forces[0] * step / (forces[1] - forces[0]);
    if !(f64::from(LIVE_ZERO_MIN)..min_code + step).contains(&zero) {
        return Err(format!(
            "found no force at code {zero:.0}, expected that from {LIVE_ZERO_MIN} (less cannot be told from a broken wire) to \
             {:.0}: measure nearer to 0 N, or change the gain or offset of the amplifier",
            min_code + step
        ));
    }
    let points = std::array::from_fn(|place| {
        if place == 0 {
            Point {
                force_n: 0.0,
                code: zero.round() as u16,
            }
        } else {
            let code = (min_code + step * place as f64).round() as u16;
            // The wire's steps are 1/4096 N; more digits mean nothing.
            Point {
                force_n: (forces[place] * 1e4).round() / 1e4,
                code,
            }
        }
    });
    Ok(Fit {
        points,
        rms_n: (squares / measured.len() as f64).sqrt(),
        max_n,
    })
}

fn check(measured: &[Measured]) -> Result<(), String> {
    let mut codes: Vec<u16> = measured.iter().map(|one| one.code).collect();
    codes.sort_unstable();
    codes.dedup();
    if measured.len() < MEASURED_MIN || codes.len() < LINE_POINTS {
        return Err(format!(
            "found {} forces at {} codes, expected at least {MEASURED_MIN} at {LINE_POINTS} or more",
            measured.len(),
            codes.len()
        ));
    }
    for one in measured {
        if !(LIVE_ZERO_MIN..=DAC_CODE_MAX).contains(&one.code) {
            return Err(format!(
                "found code {}, expected one from {LIVE_ZERO_MIN} to {DAC_CODE_MAX}",
                one.code
            ));
        }
        if !(-1.0..=125.0).contains(&one.force_n) {
            return Err(format!(
                "found {} N at code {}, expected a force from 0 to 125 N",
                one.force_n, one.code
            ));
        }
    }
    Ok(())
}

/// Gauss–Jordan with pivoting; `None` when a point has no measurement near it.
fn solve(mut m: [[f64; LINE_POINTS + 1]; LINE_POINTS]) -> Option<[f64; LINE_POINTS]> {
    for column in 0..LINE_POINTS {
        let pivot =
            (column..LINE_POINTS).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()))?;
        m.swap(column, pivot);
        let upper = m[column];
        if upper[column].abs() < 1e-6 {
            return None;
        }
        for (row, values) in m.iter_mut().enumerate() {
            if row != column {
                let factor = values[column] / upper[column];
                for (value, above) in values.iter_mut().zip(upper).skip(column) {
                    *value -= factor * above;
                }
            }
        }
    }
    Some(std::array::from_fn(|row| m[row][LINE_POINTS] / m[row][row]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn measured(force_n: impl Fn(f64) -> f64, codes: impl Iterator<Item = u16>) -> Vec<Measured> {
        codes
            .map(|code| Measured {
                code,
                force_n: force_n(code.into()),
            })
            .collect()
    }

    proptest! {
        #[test]
        fn a_straight_line_comes_back_as_it_is(zero in 300.0..1_500.0_f64, newtons_per_code in 0.002..0.02_f64) {
            let codes = (0..12).map(|step| (zero + 50.0 + (3_900.0 - zero) / 11.0 * f64::from(step)) as u16);
            let line = |code: f64| (code - zero) * newtons_per_code;
            let fit = fit(&measured(line, codes)).unwrap();
            prop_assert!(fit.max_n < 1e-6);
            prop_assert!((f64::from(fit.points[0].code) - zero).abs() < 0.51);
            for point in &fit.points[1..] {
                // Codes are whole numbers.
                prop_assert!((point.force_n - line(point.code.into())).abs() < 0.51 * newtons_per_code + 1e-4);
            }
        }
    }

    #[test]
    fn a_bent_line_with_noise_is_met_and_the_residual_is_the_noise() {
        let bent = |code: f64| 40.0 * ((code - 700.0) / 3_300.0).powf(1.2);
        let noise = |k: u16| 0.05 * (f64::from(u32::from(k) * 7_919 % 21) - 10.0) / 10.0;
        let codes = || (0..60).map(|step| 800 + step * 55);
        let mut all = measured(bent, codes());
        for one in &mut all {
            one.force_n += noise(one.code);
        }
        let fit = fit(&all).unwrap();
        // Four pieces leave 0.1 N of this curve.
        assert!(fit.rms_n < 0.12 && fit.max_n < 0.35, "{fit:?}");
        assert!(
            fit.points
                .windows(2)
                .all(|pair| pair[1].force_n > pair[0].force_n)
        );
        assert!(
            fit.points[0].force_n.abs() < 1e-12 && fit.points[0].code < 800,
            "{fit:?}"
        );
    }

    #[test]
    fn what_cannot_be_a_line_is_refused_with_what_to_do() {
        let said = |all: &[Measured]| fit(all).unwrap_err();
        let few = measured(|code| code / 100.0, (1_000..1_800).step_by(200));
        assert!(
            said(&few).starts_with("found 4 forces at 4 codes, expected at least 10"),
            "{}",
            said(&few)
        );
        let falls = measured(
            |code| 20.0 - (code - 2_000.0).abs() / 100.0,
            (1_000..4_000).step_by(100),
        );
        assert!(
            said(&falls).contains("expected the force to rise"),
            "{}",
            said(&falls)
        );
        let gap = measured(
            |code| code / 100.0 - 9.0,
            (1_000..1_020).step_by(2).chain([2_400, 4_000]),
        );
        assert!(said(&gap).contains("spread evenly"), "{}", said(&gap));
        let no_zero = measured(|code| 10.0 + code / 1_000.0, (1_000..4_000).step_by(100));
        assert!(said(&no_zero).contains("broken wire"), "{}", said(&no_zero));
        let mut wrong = measured(|code| code / 100.0, (1_000..4_000).step_by(100));
        wrong[3].code = 4_096;
        assert!(said(&wrong).contains("found code 4096"), "{}", said(&wrong));
        wrong[3] = Measured {
            code: 1_300,
            force_n: f64::NAN,
        };
        assert!(
            said(&wrong).contains("found NaN N at code 1300"),
            "{}",
            said(&wrong)
        );
    }
}
