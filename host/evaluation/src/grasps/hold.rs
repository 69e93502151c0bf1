//! What a hold came to: where the line stands at its end, and how often it rose. Pure: from a grasp's moments to figures.
//! Units: s, N, mm.

use serde::{Deserialize, Serialize};

use super::policy::FLOOR_N;
use super::slides::Moment;

/// What is averaged at the end of the hold, and over what the line's rise is measured, s.
const END_S: f64 = 1.0;
const RISE_S: f64 = 0.1;
/// Share of the line that counts as a rise.
const RISE_SHARE: f64 = 0.1;

/// A hold to its end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Hold {
    /// Mean line and mean need of the last second, N; a need below the gripper's least force counts as that.
    pub line_n: f64,
    /// See there.
    pub needed_n: f64,
    /// Highest line, N.
    pub peak_line_n: f64,
    /// How often the line rose by more than a tenth within a tenth of a second, per minute.
    pub rises_per_minute: f64,
    /// Distance slid, mm.
    pub slip_mm: f64,
}

impl Hold {
    /// Of a hold between two times; none when the moments end before it.
    pub(super) fn of(moments: &[Moment], [from_s, to_s]: [f64; 2]) -> Option<Self> {
        let from = moments.partition_point(|moment| moment.time_s < from_s);
        let to = moments.partition_point(|moment| moment.time_s < to_s);
        let hold = &moments[from..to];
        let (first, last) = (hold.first()?, hold.last()?);
        if to == moments.len() {
            return None;
        }
        let end = &hold[hold.partition_point(|moment| moment.time_s < to_s - END_S)..];
        let mean = |value: fn(&Moment) -> f64| end.iter().map(value).sum::<f64>() / end.len() as f64;
        Some(Self {
            line_n: mean(|moment| moment.line_n),
            needed_n: mean(|moment| moment.needed_n.max(FLOOR_N)),
            peak_line_n: hold.iter().map(|moment| moment.line_n).fold(0.0, f64::max),
            rises_per_minute: 60.0 * f64::from(rises(hold)) / (to_s - from_s),
            slip_mm: last.slip_mm - first.slip_mm,
        })
    }
}

/// How often the line rises.
fn rises(hold: &[Moment]) -> u32 {
    let (mut count, mut rose) = (0, false);
    let mut before = 0;
    for now in hold {
        while hold[before].time_s < now.time_s - RISE_S {
            before += 1;
        }
        let rises = now.line_n > (1.0 + RISE_SHARE) * hold[before].line_n;
        count += u32::from(rises && !rose);
        rose = rises;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(lines: &[f64]) -> Vec<Moment> {
        let each = lines.iter().enumerate().map(|(i, &line_n)| Moment {
            time_s: 0.02 * i as f64,
            line_n,
            slid_s: None,
            slip_mm: 0.001 * i as f64,
            needed_n: if i < 100 { 2.0 } else { 0.3 },
        });
        each.collect()
    }

    #[test]
    fn a_hold_counts_its_rises_and_ends_where_its_last_second_stood() {
        // Between 1 and 5 s: two rises within 40 ms each, a slow one, and a fall.
        let mut lines = [3.0; 300];
        lines[80..100].fill(4.0);
        lines[120..].fill(3.5);
        for (i, line) in lines[140..].iter_mut().enumerate() {
            *line = 3.5 + (0.001 * i as f64).min(0.05);
        }
        lines[270..].fill(9.0);
        let hold = Hold::of(&moments(&lines), [1.0, 5.0]).unwrap();
        assert!((hold.rises_per_minute - 30.0).abs() < 1e-9, "{hold:?}");
        assert!((hold.line_n - 3.55).abs() < 0.01 && (hold.peak_line_n - 4.0).abs() < 1e-9);
        // No gripper holds with 0.3 N.
        assert!((hold.needed_n - FLOOR_N).abs() < 1e-9);
        assert!((hold.slip_mm - 0.199).abs() < 1e-9);
    }

    #[test]
    fn what_is_lost_before_its_end_is_no_hold() {
        assert_eq!(Hold::of(&moments(&[3.0; 240]), [1.0, 5.0]), None);
        assert_eq!(Hold::of(&[], [1.0, 5.0]), None);
    }
}
