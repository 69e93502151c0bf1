//! The square grid that markers are printed in: pitch, which marker is which, where each would be at rest. Pure; pixels.

use crate::constants::NODE_REACH;

/// Fits of the regular grid, each with the weights of the one before.
const FITS: usize = 12;
/// Below this distance from the regular grid a marker weighs no more, pixels.
const NEAR_PX: f64 = 0.2;

/// A marker's place in the printed grid; (0, 0) is any one of them, columns run along x and rows along y within 45°.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Node {
    /// Column.
    pub column: i32,
    /// Row.
    pub row: i32,
}

impl Node {
    fn beside(self, [column, row]: [i32; 2]) -> Self {
        Self {
            column: self.column + column,
            row: self.row + row,
        }
    }
}

/// Markers that were found in a grid.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    /// Distance of neighbours, pixels.
    pub(crate) pitch: f32,
    /// Node and index of the point that is it, every node once.
    pub(crate) members: Vec<(Node, usize)>,
}

pub(crate) fn distance([x, y]: [f32; 2], [u, v]: [f32; 2]) -> f32 {
    ((x - u).powi(2) + (y - v).powi(2)).sqrt()
}

/// The middle value; of an even number the upper one. Zero of none.
pub(crate) fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

impl Grid {
    /// The largest grid among points whose pitch lies in `pitch_px`; `None` where there is none.
    pub(crate) fn find(points: &[[f32; 2]], pitch_px: [f32; 2]) -> Option<Self> {
        let (pitch, along) = pitch_and_direction(points, pitch_px)?;
        let mut taken = vec![false; points.len()];
        let mut largest = Vec::new();
        for start in 0..points.len() {
            if !taken[start] {
                let members = grow(points, start, pitch, along, &mut taken);
                if members.len() > largest.len() {
                    largest = members;
                }
            }
        }
        let mut grid = Self {
            pitch,
            members: largest,
        };
        grid.adopt(points);
        Some(grid)
    }

    /// Adds points that a gap parts from the grid, where its own lines lead to them.
    fn adopt(&mut self, points: &[[f32; 2]]) {
        let Some(regular) = self.regular(points) else {
            return;
        };
        for (index, point) in points.iter().enumerate() {
            if self.members.iter().any(|(_, member)| *member == index) {
                continue;
            }
            let node = regular.node(*point);
            let is_near = distance(regular.at(node), *point) < NODE_REACH * self.pitch;
            if is_near && self.members.iter().all(|(other, _)| *other != node) {
                self.members.push((node, index));
            }
        }
    }

    /// The regular grid that lies closest to most members: an affine map of nodes with the least sum of distances, so that a
    /// contact which moved a minority counts for little.
    pub(crate) fn regular(&self, points: &[[f32; 2]]) -> Option<Regular> {
        let mut pairs: Vec<(Node, [f32; 2], f64)> = self
            .members
            .iter()
            .map(|(node, index)| (*node, points[*index], 1.0))
            .collect();
        let mut regular = Regular::fit(&pairs)?;
        for _ in 0..FITS {
            for (node, point, weight) in &mut pairs {
                *weight = 1.0 / f64::from(distance(regular.at(*node), *point)).max(NEAR_PX);
            }
            regular = Regular::fit(&pairs)?;
        }
        Some(regular)
    }
}

/// Pitch, and the unit vector along the rows.
fn pitch_and_direction(points: &[[f32; 2]], pitch_px: [f32; 2]) -> Option<(f32, [f32; 2])> {
    let mut nearest: Vec<f32> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let others = points.iter().enumerate().filter(|(other, _)| *other != index);
        let near = others
            .map(|(_, other)| distance(*point, *other))
            .filter(|far| *far >= 0.7 * pitch_px[0])
            .fold(f32::INFINITY, f32::min);
        if near <= 1.15 * pitch_px[1] {
            nearest.push(near);
        }
    }
    if nearest.len() < 4 {
        return None;
    }
    let pitch = median(&mut nearest);
    // Directions of neighbours repeat every quarter turn: four times the angle is one direction.
    let (mut sine, mut cosine, mut lengths) = (0.0, 0.0, Vec::new());
    for (index, [x, y]) in points.iter().enumerate() {
        for [u, v] in &points[..index] {
            let length = distance([*x, *y], [*u, *v]);
            if (length - pitch).abs() < 0.2 * pitch {
                let angle = 4.0 * (y - v).atan2(x - u);
                sine += angle.sin();
                cosine += angle.cos();
                lengths.push(length);
            }
        }
    }
    let angle = sine.atan2(cosine) / 4.0;
    Some((median(&mut lengths), [angle.cos(), angle.sin()]))
}

/// The members that can be reached from `start`, from neighbour to neighbour.
fn grow(
    points: &[[f32; 2]],
    start: usize,
    pitch: f32,
    along: [f32; 2],
    taken: &mut [bool],
) -> Vec<(Node, usize)> {
    const SIDES: [[i32; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];
    taken[start] = true;
    let mut members = vec![(Node { column: 0, row: 0 }, start)];
    let mut next = 0;
    while next < members.len() {
        let (node, index) = members[next];
        next += 1;
        for side in SIDES {
            let neighbour = node.beside(side);
            let find = |node: Node| {
                members
                    .iter()
                    .find(|(member, _)| *member == node)
                    .map(|(_, index)| points[*index])
            };
            if find(neighbour).is_some() {
                continue;
            }
            let [x, y] = points[index];
            // The step that led here from the opposite side, where it is known: grids are bent by lens and contact.
            let step = find(node.beside(side.map(|part| -part))).map_or_else(
                || {
                    let [column, row] = side.map(|part| part as f32);
                    [
                        pitch * (column * along[0] - row * along[1]),
                        pitch * (column * along[1] + row * along[0]),
                    ]
                },
                |[u, v]| [x - u, y - v],
            );
            let expected = [x + step[0], y + step[1]];
            let near = (0..points.len())
                .filter(|index| !taken[*index])
                .map(|index| (distance(points[index], expected), index))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((far, index)) = near
                && far < NODE_REACH * pitch
            {
                taken[index] = true;
                members.push((neighbour, index));
            }
        }
    }
    members
}

/// A regular grid: where each node is, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Regular {
    origin: [f32; 2],
    column: [f32; 2],
    row: [f32; 2],
}

impl Regular {
    /// The affine map with the least weighted squares; `None` for fewer than four nodes, or nodes on one line.
    fn fit(pairs: &[(Node, [f32; 2], f64)]) -> Option<Self> {
        if pairs.len() < 4 {
            return None;
        }
        let weights: f64 = pairs.iter().map(|(.., weight)| weight).sum();
        let mean = |value: &dyn Fn(Node, [f32; 2]) -> f64| {
            let sum: f64 = pairs
                .iter()
                .map(|(node, point, weight)| weight * value(*node, *point))
                .sum();
            sum / weights
        };
        let c = mean(&|node, _| f64::from(node.column));
        let r = mean(&|node, _| f64::from(node.row));
        let centre = [0, 1].map(|axis: usize| mean(&|_, point| f64::from(point[axis])));
        let cc = mean(&|node, _| (f64::from(node.column) - c).powi(2));
        let cr = mean(&|node, _| (f64::from(node.column) - c) * (f64::from(node.row) - r));
        let rr = mean(&|node, _| (f64::from(node.row) - r).powi(2));
        let determinant = cc * rr - cr * cr;
        if determinant < 1e-6 {
            return None;
        }
        let [column, row] = [
            [0, 1].map(|axis: usize| {
                mean(&|node, point| (f64::from(node.column) - c) * f64::from(point[axis]))
            }),
            [0, 1].map(|axis: usize| mean(&|node, point| (f64::from(node.row) - r) * f64::from(point[axis]))),
        ];
        let along = |axis: usize| (rr * column[axis] - cr * row[axis]) / determinant;
        let down = |axis: usize| (cc * row[axis] - cr * column[axis]) / determinant;
        Some(Self {
            origin: [0, 1].map(|axis| (centre[axis] - c * along(axis) - r * down(axis)) as f32),
            column: [0, 1].map(|axis| along(axis) as f32),
            row: [0, 1].map(|axis| down(axis) as f32),
        })
    }

    /// Where a node is.
    pub(crate) fn at(&self, node: Node) -> [f32; 2] {
        let (column, row) = (node.column as f32, node.row as f32);
        [0, 1].map(|axis| self.origin[axis] + column * self.column[axis] + row * self.row[axis])
    }

    /// The node nearest to a place.
    fn node(&self, point: [f32; 2]) -> Node {
        let [x, y] = [0, 1].map(|axis| point[axis] - self.origin[axis]);
        let determinant = self.column[0] * self.row[1] - self.column[1] * self.row[0];
        Node {
            column: ((x * self.row[1] - y * self.row[0]) / determinant).round() as i32,
            row: ((self.column[0] * y - self.column[1] * x) / determinant).round() as i32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of 9×7 points, turned by a few degrees.
    fn points() -> Vec<[f32; 2]> {
        let mut points = Vec::new();
        for row in 0..7 {
            for column in 0..9 {
                let (column, row) = (column as f32, row as f32);
                points.push([20.0 + 31.7 * column - 1.5 * row, 18.0 + 1.5 * column + 31.7 * row]);
            }
        }
        points
    }

    #[test]
    fn a_turned_grid_with_gaps_and_dirt_is_found_with_every_marker_at_its_node() {
        let mut points = points();
        // A damaged gel: a column gap of two, single ones missing, two specks of dirt.
        for gone in [40, 22, 21, 3] {
            points.remove(gone);
        }
        points.push([52.0, 33.0]);
        points.push([150.0, 100.0]);
        let grid = Grid::find(&points, [26.0, 50.0]).unwrap();
        assert!((grid.pitch - 31.74).abs() < 0.1, "{}", grid.pitch);
        assert_eq!(grid.members.len(), 59);
        let regular = grid.regular(&points).unwrap();
        for (node, index) in &grid.members {
            assert!(*index < 59, "dirt is a member");
            assert!(distance(regular.at(*node), points[*index]) < 0.01);
        }
    }

    #[test]
    fn the_diagonal_of_a_narrow_grid_is_not_taken_for_the_pitch_of_a_wide_one() {
        // The diagonal, 44.8 pixels, is a pitch that the range allows.
        let grid = Grid::find(&points(), [26.0, 50.0]).unwrap();
        assert!(grid.pitch < 33.0);
    }

    #[test]
    fn the_regular_grid_stays_where_a_contact_moved_a_third_of_the_markers() {
        let straight = points();
        let mut pressed = straight.clone();
        for point in &mut pressed {
            let near = (1.0 - distance(*point, [140.0, 100.0]) / 90.0).max(0.0);
            point[0] += 9.0 * near;
        }
        let grid = Grid::find(&pressed, [26.0, 50.0]).unwrap();
        let regular = grid.regular(&pressed).unwrap();
        for (node, index) in &grid.members {
            let off = distance(regular.at(*node), straight[*index]);
            assert!(off < 0.5, "{node:?} {off}");
        }
    }

    #[test]
    fn points_without_a_grid_have_none() {
        assert_eq!(Grid::find(&[], [26.0, 50.0]), None);
        assert_eq!(Grid::find(&[[1.0, 1.0], [200.0, 100.0]], [26.0, 50.0]), None);
    }
}
