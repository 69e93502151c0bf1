//! What a camera shows of a plane of dots whose distance is known: pixels per millimetre, and how the lens bends. Pure.
//!
//! A dot at q mm from the optical axis (y up) shows at c + s·q·(1 + k|q|²) pixels; c is the crop's middle. Scale s, bend k, turn and
//! offset of the grid follow by Gauss–Newton from the straight fit. Limits: a plane square to the axis; one scale along x and y; the
//! axis in the crop's middle; one term of distortion.

/// Minimum number of dots: four times the unknowns.
pub const DOTS_MIN: usize = 20;
/// Gauss–Newton rounds.
const ROUNDS: usize = 20;
/// Largest residual, root mean square, pixels: more means that the dots are no even grid.
pub const RESIDUAL_MAX_PX: f64 = 1.0;

/// A dot: its column and row in the grid (rows run down), and where it shows, pixels of the crop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Column, row.
    pub node: [i32; 2],
    /// From the crop's upper left corner, px.
    pub at_px: [f64; 2],
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFit {
    /// Pixels of the crop per millimetre, in the middle.
    pub px_per_mm: f64,
    /// Standard error of it.
    pub px_per_mm_error: f64,
    /// Bend, per mm².
    pub distortion_per_mm2: f64,
    /// Standard error of it.
    pub distortion_error: f64,
    /// Turn of the grid, rad.
    pub turn_rad: f64,
    /// Root mean square of the residuals, px.
    pub residual_px: f64,
    /// Dots that were used.
    pub dots: usize,
}

/// Scale, turn, offset x and y in mm, bend.
type Unknowns = [f64; 5];

fn shown([scale, turn, x0, y0, bend]: Unknowns, node: [i32; 2], pitch_mm: f64) -> [f64; 2] {
    let (sin, cos) = turn.sin_cos();
    let [u, v] = node.map(|at| f64::from(at) * pitch_mm);
    let [x, y] = [cos * u - sin * v + x0, sin * u + cos * v + y0];
    let stretch = scale * (1.0 + bend * (x * x + y * y));
    [stretch * x, stretch * y]
}

/// Fits a crop of `size_px` to dots `pitch_mm` apart.
///
/// # Errors
/// Says what was found and expected when there are too few dots, or they are no even grid.
pub fn fit(dots: &[Dot], pitch_mm: f64, size_px: [usize; 2]) -> Result<CameraFit, String> {
    if dots.len() < DOTS_MIN {
        return Err(format!(
            "found {} dots in a grid, expected at least {DOTS_MIN}",
            dots.len()
        ));
    }
    let middle = size_px.map(|side| 0.5 * side as f64);
    // Both y down: rows and pixels.
    let seen: Vec<[f64; 2]> = dots
        .iter()
        .map(|dot| [0, 1].map(|axis| dot.at_px[axis] - middle[axis]))
        .collect();
    let mut unknowns = straight(dots, &seen, pitch_mm);
    let residuals = |unknowns: Unknowns| -> Vec<f64> {
        dots.iter()
            .zip(&seen)
            .flat_map(|(dot, seen)| {
                let shown = shown(unknowns, dot.node, pitch_mm);
                [seen[0] - shown[0], seen[1] - shown[1]]
            })
            .collect()
    };
    let mut normal = [[0.0; 5]; 5];
    for _ in 0..ROUNDS {
        let now = residuals(unknowns);
        let slopes: Vec<Vec<f64>> = (0..5)
            .map(|unknown| {
                let step = 1e-6 * [1.0, 0.1, 1.0, 1.0, 1e-2][unknown];
                let mut moved = unknowns;
                moved[unknown] += step;
                let there = residuals(moved);
                now.iter()
                    .zip(&there)
                    .map(|(now, there)| (now - there) / step)
                    .collect()
            })
            .collect();
        let mut right = [0.0; 5];
        for row in 0..5 {
            right[row] = slopes[row].iter().zip(&now).map(|(a, b)| a * b).sum();
            for column in 0..5 {
                normal[row][column] = slopes[row].iter().zip(&slopes[column]).map(|(a, b)| a * b).sum();
            }
        }
        let step = solved(normal, right);
        unknowns = [0, 1, 2, 3, 4].map(|at| unknowns[at] + step[at]);
    }
    let squares: f64 = residuals(unknowns).iter().map(|r| r * r).sum();
    let residual_px = (squares / dots.len() as f64).sqrt();
    if residual_px.is_nan() || residual_px > RESIDUAL_MAX_PX {
        return Err(format!(
            "the dots lie {residual_px:.2} pixels from an even grid, expected at most {RESIDUAL_MAX_PX}: is the plate flat against \
             the gel, and are all dots equally far apart?"
        ));
    }
    let variance = squares / (2 * dots.len() - 5) as f64;
    let error = |at: usize| {
        let mut unit = [0.0; 5];
        unit[at] = 1.0;
        (variance * solved(normal, unit)[at]).max(0.0).sqrt()
    };
    Ok(CameraFit {
        px_per_mm: unknowns[0],
        px_per_mm_error: error(0),
        distortion_per_mm2: unknowns[4],
        distortion_error: error(4),
        turn_rad: unknowns[1],
        residual_px,
        dots: dots.len(),
    })
}

/// Scale, turn and offset without a bend.
fn straight(dots: &[Dot], seen: &[[f64; 2]], pitch_mm: f64) -> Unknowns {
    let count = dots.len() as f64;
    let mean = |of: &dyn Fn(usize) -> f64| (0..dots.len()).map(of).sum::<f64>() / count;
    let node = |at: usize, axis: usize| f64::from(dots[at].node[axis]) * pitch_mm;
    let [mu, mv] = [0, 1].map(|axis| mean(&|at| node(at, axis)));
    let [mx, my] = [0, 1].map(|axis| mean(&|at| seen[at][axis]));
    let (mut along, mut across, mut squares) = (0.0, 0.0, 0.0);
    for (at, seen) in seen.iter().enumerate() {
        let [u, v] = [node(at, 0) - mu, node(at, 1) - mv];
        let [x, y] = [seen[0] - mx, seen[1] - my];
        along += u * x + v * y;
        across += u * y - v * x;
        squares += u * u + v * v;
    }
    let scale = along.hypot(across) / squares.max(1e-12);
    let turn = across.atan2(along);
    let (sin, cos) = turn.sin_cos();
    [
        scale,
        turn,
        mx / scale - (cos * mu - sin * mv),
        my / scale - (sin * mu + cos * mv),
        0.0,
    ]
}

/// Gaussian elimination with pivoting.
fn solved(mut m: [[f64; 5]; 5], mut right: [f64; 5]) -> [f64; 5] {
    for column in 0..5 {
        let pivot = (column..5).max_by(|&a, &b| m[a][column].abs().total_cmp(&m[b][column].abs()));
        let pivot = pivot.unwrap_or(column);
        m.swap(column, pivot);
        right.swap(column, pivot);
        for row in 0..5 {
            if row != column {
                let factor = m[row][column] / m[column][column];
                let upper = m[column];
                for (value, above) in m[row].iter_mut().zip(upper).skip(column) {
                    *value -= factor * above;
                }
                right[row] -= factor * right[column];
            }
        }
    }
    [0, 1, 2, 3, 4].map(|row| right[row] / m[row][row])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dots(truth: Unknowns, noise: f64) -> Vec<Dot> {
        let mut dots = Vec::new();
        for row in -3..=3 {
            for column in -5..=4 {
                let [x, y] = shown(truth, [column, row], 1.9);
                let wrong = |k: i32| noise * f64::from((column * 7 + row * 13 + k) % 5 - 2) / 2.0;
                dots.push(Dot {
                    node: [column, row],
                    at_px: [160.0 + x + wrong(0), 120.0 + y + wrong(3)],
                });
            }
        }
        dots
    }

    #[test]
    fn scale_and_bend_are_found_with_their_errors() {
        let truth = [15.3, 0.02, 0.4, -0.3, 6e-4];
        let found = fit(&dots(truth, 0.05), 1.9, [320, 240]).unwrap();
        assert!(
            (found.px_per_mm - 15.3).abs() < 0.02 && found.px_per_mm_error < 0.02,
            "{found:?}"
        );
        assert!((found.distortion_per_mm2 - 6e-4).abs() < 5e-5, "{found:?}");
        assert!(found.residual_px < 0.1);
    }

    #[test]
    fn dots_that_are_no_grid_and_too_few_are_refused() {
        let truth = [15.3, 0.02, 0.4, -0.3, 0.0];
        let mut wrong = dots(truth, 0.0);
        for (at, dot) in wrong.iter_mut().enumerate() {
            dot.at_px[0] += 4.0 * ((at * 37 % 11) as f64 / 11.0 - 0.5);
        }
        assert!(fit(&wrong, 1.9, [320, 240]).unwrap_err().contains("even grid"));
        assert!(
            fit(&wrong[..9], 1.9, [320, 240])
                .unwrap_err()
                .contains("found 9 dots")
        );
    }
}
