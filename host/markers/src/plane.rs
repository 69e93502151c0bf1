//! One channel of a picture, and what is done to whole ones: means, closing, blur. Pure; units: grey levels, pixels.

/// A channel, row-major, the top row first.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Plane {
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            values: vec![0.0; width * height],
        }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    pub(crate) fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..][..self.width]
    }

    /// The value at a place between pixels, those beyond the border as on it; pixel (0, 0) is centred on (0, 0).
    pub(crate) fn between(&self, x: f32, y: f32) -> f32 {
        let x = x.clamp(0.0, (self.width - 1) as f32);
        let y = y.clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (u, v) = (x - left as f32, y - top as f32);
        let above = self.at(left, top) * (1.0 - u) + self.at(right, top) * u;
        let below = self.at(left, bottom) * (1.0 - u) + self.at(right, bottom) * u;
        above * (1.0 - v) + below * v
    }
}

/// Room for [`close`] and [`blur`], kept from picture to picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scratch {
    line: Vec<f32>,
    rows: Plane,
    turned: Plane,
}

/// Closes dark things narrower than `side` pixels (odd) over: the largest value of every window, then the smallest of those.
pub(crate) fn close(from: &Plane, side: usize, scratch: &mut Scratch, to: &mut Plane) {
    let Scratch { line, rows, turned } = scratch;
    // Plain comparisons: f32::max looks for numbers that are none, which costs the vector instructions.
    extreme(
        from,
        side,
        |a, b| if a > b { a } else { b },
        line,
        rows,
        turned,
        to,
    );
    let largest = to.clone();
    extreme(
        &largest,
        side,
        |a, b| if a < b { a } else { b },
        line,
        rows,
        turned,
        to,
    );
}

/// The extreme value of every square window, cut at the border.
fn extreme(
    from: &Plane,
    side: usize,
    pick: impl Fn(f32, f32) -> f32 + Copy,
    line: &mut Vec<f32>,
    rows: &mut Plane,
    turned: &mut Plane,
    to: &mut Plane,
) {
    along_rows(from, side, pick, line, rows);
    turn(rows, turned);
    along_rows(turned, side, pick, line, rows);
    turn(rows, to);
}

/// The rows of one plane with those of another, which takes its size.
fn rows_of_both<'a>(from: &'a Plane, to: &'a mut Plane) -> impl Iterator<Item = (&'a [f32], &'a mut [f32])> {
    to.width = from.width;
    to.height = from.height;
    to.values.resize(from.values.len(), 0.0);
    let rows = to.values.chunks_exact_mut(from.width);
    from.values.chunks_exact(from.width).zip(rows)
}

fn along_rows(
    from: &Plane,
    side: usize,
    pick: impl Fn(f32, f32) -> f32 + Copy,
    line: &mut Vec<f32>,
    to: &mut Plane,
) {
    let half = side / 2;
    for (row, out) in rows_of_both(from, to) {
        // Values at the border repeat beyond it: they are in every window there anyway.
        line.clear();
        line.extend(std::iter::repeat_n(row[0], half));
        line.extend_from_slice(row);
        line.extend(std::iter::repeat_n(row[row.len() - 1], half));
        // Windows of doubling width, as far as they fit; then two of them cover the window.
        let mut width = 1;
        while 2 * width <= side {
            for at in 0..line.len() - width {
                line[at] = pick(line[at], line[at + width]);
            }
            width *= 2;
        }
        let rest = side - width;
        for (at, out) in out.iter_mut().enumerate() {
            *out = pick(line[at], line[at + rest]);
        }
    }
}

fn turn(from: &Plane, to: &mut Plane) {
    to.width = from.height;
    to.height = from.width;
    to.values.resize(from.values.len(), 0.0);
    for y in 0..from.height {
        for (x, value) in from.row(y).iter().enumerate() {
            to.values[x * from.height + y] = *value;
        }
    }
}

/// Weighted means along rows, then columns, with `taps` from the middle outwards; beyond the border is nothing.
pub(crate) fn blur(from: &Plane, taps: &[f32], scratch: &mut Scratch, to: &mut Plane) {
    let Scratch { rows, turned, .. } = scratch;
    blur_rows(from, taps, rows);
    turn(rows, turned);
    blur_rows(turned, taps, rows);
    turn(rows, to);
}

fn blur_rows(from: &Plane, taps: &[f32], to: &mut Plane) {
    for (row, out) in rows_of_both(from, to) {
        for (out, value) in out.iter_mut().zip(row) {
            *out = taps[0] * value;
        }
        for (distance, tap) in taps.iter().enumerate().skip(1) {
            if distance >= row.len() {
                break;
            }
            for (out, value) in out.iter_mut().zip(&row[distance..]) {
                *out += tap * value;
            }
            for (out, value) in out[distance..].iter_mut().zip(row) {
                *out += tap * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Plane {
        let mut plane = Plane::new(width, height);
        for y in 0..height {
            for x in 0..width {
                plane.values[y * width + x] = value(x, y);
            }
        }
        plane
    }

    #[test]
    fn closing_is_the_smallest_of_the_largest_values_of_windows() {
        let from = plane(23, 17, |x, y| {
            ((x * 7 + y * 13) % 11) as f32 + ((x / 5 + y / 4) % 3) as f32
        });
        for side in [1, 3, 5, 7, 9, 13] {
            let half = side / 2;
            let window = |plane: &Plane, x: usize, y: usize, pick: fn(f32, f32) -> f32| {
                let mut values = Vec::new();
                for v in y.saturating_sub(half)..=(y + half).min(plane.height - 1) {
                    for u in x.saturating_sub(half)..=(x + half).min(plane.width - 1) {
                        values.push(plane.at(u, v));
                    }
                }
                values.into_iter().reduce(pick).unwrap()
            };
            let largest = plane(23, 17, |x, y| window(&from, x, y, f32::max));
            let expected = plane(23, 17, |x, y| window(&largest, x, y, f32::min));
            let mut found = Plane::new(23, 17);
            close(&from, side, &mut Scratch::default(), &mut found);
            assert_eq!(found, expected, "side {side}");
        }
    }

    #[test]
    fn a_place_between_pixels_has_the_value_of_the_plane_through_them() {
        let slope = plane(9, 7, |x, y| 2.0 * x as f32 + 3.0 * y as f32);
        assert!((slope.between(2.25, 3.5) - 15.0).abs() < 1e-5);
        assert!((slope.between(-4.0, 3.0) - 9.0).abs() < 1e-5);
        assert!((slope.between(100.0, 100.0) - 34.0).abs() < 1e-5);
    }

    #[test]
    fn a_blurred_point_has_the_product_of_the_taps() {
        let point = plane(9, 9, |x, y| f32::from(u8::from(x == 4 && y == 4)));
        let mut found = Plane::new(9, 9);
        blur(&point, &[0.5, 0.25], &mut Scratch::default(), &mut found);
        assert_eq!(
            (found.at(4, 4), found.at(3, 4), found.at(3, 5)),
            (0.25, 0.125, 0.0625)
        );
    }
}
