//! Places for labels beside points, so that none covers another label or a point. Pixels. Pure.

/// A rectangle of the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rect {
    pub left: i32,
    pub top: i32,
    right: i32,
    bottom: i32,
}

impl Rect {
    pub(crate) const fn new([left, top]: [i32; 2], [right, bottom]: [i32; 2]) -> Self {
        Self {
            left,
            top,
            right,
            bottom,
        }
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn is_within(&self, other: &Self) -> bool {
        self.left >= other.left
            && self.top >= other.top
            && self.right <= other.right
            && self.bottom <= other.bottom
    }

    fn contains(&self, (x, y): (i32, i32)) -> bool {
        (self.left..self.right).contains(&x) && (self.top..self.bottom).contains(&y)
    }

    /// The point of the rectangle that is nearest to another point.
    pub(crate) fn nearest(&self, (x, y): (i32, i32)) -> (i32, i32) {
        (x.clamp(self.left, self.right), y.clamp(self.top, self.bottom))
    }
}

/// Radius of a point's mark with a little air.
const POINT: i32 = 7;
/// Between two tries.
const STEP: i32 = 4;
/// The farthest try.
const FARTHEST: i32 = 240;

/// A place of its size for the label of each point: the nearest that covers no point, no label and no line from a point to
/// its label, and to which a line leads that crosses no label. Where nothing is free, lines may cross labels.
pub(crate) fn place(points: &[(i32, i32)], sizes: &[[i32; 2]], within: Rect) -> Vec<Rect> {
    let marks = points
        .iter()
        .map(|&(x, y)| Rect::new([x - POINT, y - POINT], [x + POINT, y + POINT]));
    let mut taken: Vec<Rect> = marks.collect();
    let mut lines: Vec<(i32, i32)> = Vec::new();
    let mut places = vec![within; points.len()];
    // From the right, so that labels of a dense row rise to the left.
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|number| -points[*number].0);
    for number in order {
        let (point, size) = (points[number], sizes[number]);
        let find = |may_cross: bool| {
            (0..FARTHEST)
                .step_by(STEP as usize)
                .flat_map(|far| around(point, size, far))
                .find(|label| {
                    let is_free =
                        label.is_within(&within) && !taken.iter().any(|other| other.overlaps(label));
                    let is_crossed = || {
                        lines.iter().any(|at| label.contains(*at))
                            || leader(point, label)
                                .any(|at| taken[points.len()..].iter().any(|other| other.contains(at)))
                    };
                    is_free && (may_cross || !is_crossed())
                })
        };
        let label = find(false).or_else(|| find(true));
        let label = label.unwrap_or_else(|| around(point, size, 0)[0]);
        taken.push(label);
        lines.extend(leader(point, &label));
        places[number] = label;
    }
    places
}

/// Candidates at a distance: right, above, below, left, and the corners.
fn around((x, y): (i32, i32), [width, height]: [i32; 2], far: i32) -> [Rect; 8] {
    let gap = POINT + 2 + far;
    let (right, left, centre) = (x + gap, x - gap - width, x - width / 2);
    let (above, below, middle) = (y - gap - height, y + gap, y - height / 2);
    // Text beside the point's column leaves the column free for other lines.
    let (after, before) = (x + 4, x - 4 - width);
    [
        (right, middle),
        (centre, above),
        (centre, below),
        (left, middle),
        (after, above),
        (after, below),
        (before, above),
        (before, below),
    ]
    .map(|(left, top)| Rect::new([left, top], [left + width, top + height]))
}

/// Pixels of the line from a point to its label.
fn leader((x, y): (i32, i32), label: &Rect) -> impl Iterator<Item = (i32, i32)> + use<> {
    let (to_x, to_y) = label.nearest((x, y));
    let steps = (to_x - x).abs().max((to_y - y).abs()).max(1);
    (0..steps).map(move |step| (x + (to_x - x) * step / steps, y + (to_y - y) * step / steps))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_points_in_one_place_do_not_overlap_and_stay_inside() {
        let within = Rect::new([0, 0], [600, 400]);
        let points = [(590, 390), (300, 390), (298, 390), (300, 390), (5, 395), (8, 395)];
        let labels = place(&points, &[[120, 13]; 6], within);
        for (number, label) in labels.iter().enumerate() {
            assert!(label.is_within(&within), "{label:?}");
            assert!(
                !labels[..number].iter().any(|other| other.overlaps(label)),
                "{label:?}"
            );
        }
    }
}
