//! What the figure of a recording shows, without drawing it. Pure. Seconds, newtons, ratios.

use gripline_recording::RecordedStatus;

/// What the traces show of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Moment {
    /// Since the start.
    pub t_s: f64,
    /// The detector's; `None` when nothing touches.
    pub stick_ratio: Option<f64>,
    /// The world's, where it is known.
    pub true_stick_ratio: Option<f64>,
    /// The detector: stick ratio below its threshold.
    pub slip: bool,
    /// The baseline F_T > μ F_N.
    pub coulomb_slip: bool,
    /// The world: the whole contact slides. `None` without ground truth.
    pub true_slip: Option<bool>,
    /// Total normal force.
    pub normal_n: f64,
    /// Total shear.
    pub shear_n: f64,
    /// Grip-force line.
    pub line_n: f64,
    /// Part of the scene's script.
    pub phase: String,
}

impl Moment {
    /// From a recorded frame.
    pub(super) fn of(status: &RecordedStatus, threshold: f64) -> Self {
        let truth = status.truth.as_ref();
        Self {
            t_s: status.t_s,
            stick_ratio: status.stick_ratio,
            true_stick_ratio: truth.and_then(|truth| truth.stick_ratio),
            slip: status.stick_ratio.is_some_and(|ratio| ratio < threshold),
            coulomb_slip: status.coulomb_slip,
            true_slip: truth.map(|truth| truth.gross_slip),
            normal_n: status.normal_n,
            shear_n: status.shear_n,
            line_n: status.line_n,
            phase: truth.map_or(String::new(), |truth| truth.phase.clone()),
        }
    }
}

/// A force map beside the traces.
#[derive(Debug, Clone)]
pub(super) struct ForceMapAt {
    /// Index among the moments.
    pub moment: usize,
    /// Newtons, row-major, row 0 lowest.
    pub map: [[f32; 3]; 400],
}

/// The data of the figure.
#[derive(Debug, Clone)]
pub(super) struct Traces {
    /// Slip threshold of the stick ratio.
    pub threshold: f64,
    /// The detector's friction coefficient.
    pub friction: f64,
    /// A taxel is in contact above this normal force.
    pub contact_min_n: f64,
    /// Frame by frame.
    pub moments: Vec<Moment>,
    /// In the order of time.
    pub maps: Vec<ForceMapAt>,
}

impl Traces {
    /// The moment nearest to a time.
    pub(super) fn nearest(&self, t_s: f64) -> usize {
        let places = 0..self.moments.len();
        let apart = |place: &usize| (self.moments[*place].t_s - t_s).abs();
        places.min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0)
    }

    /// Up to `count` moments: splits the frames in contact into as many equal parts and takes the lowest stick ratio of each.
    pub(super) fn lowest_stick_ratios(&self, count: usize) -> Vec<usize> {
        let touched: Vec<(usize, f64)> = self
            .moments
            .iter()
            .enumerate()
            .filter_map(|(place, moment)| Some((place, moment.stick_ratio?)))
            .collect();
        if touched.is_empty() {
            return Vec::new();
        }
        touched
            .chunks(touched.len().div_ceil(count))
            .filter_map(|part| part.iter().min_by(|a, b| a.1.total_cmp(&b.1)))
            .map(|(place, _)| *place)
            .collect()
    }

    /// Runs of moments at which `what` is there, as points of a line.
    pub(super) fn lines(&self, what: impl Fn(&Moment) -> Option<f64>) -> Vec<Vec<(f64, f64)>> {
        let mut lines = vec![Vec::new()];
        for moment in &self.moments {
            match (what(moment), lines.last_mut()) {
                (Some(value), Some(line)) => line.push((moment.t_s, value)),
                _ => lines.push(Vec::new()),
            }
        }
        lines.retain(|line| !line.is_empty());
        lines
    }

    /// Spans of time in which `what` holds, each up to the frame after it.
    pub(super) fn spans(&self, what: impl Fn(&Moment) -> bool) -> Vec<(f64, f64)> {
        let mut spans: Vec<(f64, f64)> = Vec::new();
        let mut open = false;
        for moment in &self.moments {
            match (what(moment), open) {
                (true, false) => spans.push((moment.t_s, moment.t_s)),
                (_, true) => {
                    if let Some(span) = spans.last_mut() {
                        span.1 = moment.t_s;
                    }
                }
                (false, false) => {}
            }
            open = what(moment);
        }
        spans
    }

    /// Where a new part of the script begins.
    pub(super) fn phases(&self) -> Vec<(f64, &str)> {
        let mut phases: Vec<(f64, &str)> = Vec::new();
        for moment in &self.moments {
            if phases.last().is_none_or(|(_, phase)| *phase != moment.phase) {
                phases.push((moment.t_s, &moment.phase));
            }
        }
        phases
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(ratios: &[Option<f64>]) -> Traces {
        let moment = |(place, ratio): (usize, &Option<f64>)| Moment {
            t_s: place as f64,
            stick_ratio: *ratio,
            true_stick_ratio: None,
            slip: ratio.is_some_and(|ratio| ratio < 0.5),
            coulomb_slip: false,
            true_slip: None,
            normal_n: 0.0,
            shear_n: 0.0,
            line_n: 0.0,
            phase: if place < 3 { "hold" } else { "pull" }.to_owned(),
        };
        Traces {
            threshold: 0.5,
            friction: 0.45,
            contact_min_n: 0.0,
            moments: ratios.iter().enumerate().map(moment).collect(),
            maps: Vec::new(),
        }
    }

    #[test]
    fn a_line_is_broken_where_nothing_touches() {
        let series = series(&[None, Some(1.0), Some(0.4), None, None, Some(0.9)]);
        let lines = series.lines(|moment| moment.stick_ratio);
        assert_eq!(lines, [vec![(1.0, 1.0), (2.0, 0.4)], vec![(5.0, 0.9)]]);
        assert_eq!(series.phases(), [(0.0, "hold"), (3.0, "pull")]);
    }

    #[test]
    fn a_span_reaches_to_the_frame_after_it() {
        let series = series(&[Some(0.4), Some(0.3), Some(0.9), None, Some(0.2)]);
        assert_eq!(series.spans(|moment| moment.slip), [(0.0, 2.0), (4.0, 4.0)]);
        assert_eq!(series.spans(|_| false), []);
    }

    #[test]
    fn the_maps_are_those_of_least_stick_ratio_spread_over_the_contact() {
        let ratios = [0.9, 0.2, 0.8, 0.7, 0.6, 0.95, 1.0, 0.99];
        let mut all: Vec<Option<f64>> = ratios.iter().copied().map(Some).collect();
        all.insert(0, None);
        assert_eq!(series(&all).lowest_stick_ratios(4), [2, 4, 5, 8]);
        assert_eq!(series(&all).lowest_stick_ratios(2), [2, 5]);
        assert_eq!(series(&[None, None]).lowest_stick_ratios(4), [0; 0]);
        assert_eq!(series(&all).nearest(3.4), 3);
    }
}
