//! When an object slides in the grip and what the line does then. Pure: from a grasp's moments to figures. Units: s, mm, N.

/// A frame: the line that was set at its start, and the sliding in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// When the picture was taken and the line set.
    pub(super) time_s: f64,
    pub(super) line_n: f64,
    /// First beginning and last end of sliding in the frame.
    pub(super) slid_s: Option<[f64; 2]>,
    /// Distance slid since the start, at the frame's end.
    pub(super) slip_mm: f64,
    /// The force that friction needs then, N.
    pub(super) needed_n: f64,
}

/// What the line did while the object slid.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Slides {
    /// Slides.
    pub(super) count: u32,
    /// Maps at which the line fell later than [`LATE_S`] after the beginning of a slide that still went on.
    pub(super) late_falls: u32,
    /// From the beginning of a slide, with a line that did not rise, to a line that rises, ms; [`NEVER_MS`] of a slide
    /// of more than [`NOTABLE_MM`] that no rise answered.
    pub(super) rises_ms: Vec<f64>,
    /// Those of slides that began in the hold.
    pub(super) rises_in_hold_ms: Vec<f64>,
}

/// A rest that ends a slide, s.
const REST_S: f64 = 0.05;
/// A fall of the line later than this is late, s.
const LATE_S: f64 = 0.042;
/// What counts as fall and rise of the line from map to map, N.
const FALL_N: f64 = 3e-4;
const RISE_N: f64 = 1e-3;
/// A slide that was never answered, ms.
pub(super) const NEVER_MS: f64 = 9_900.0;
/// A shorter slide may go unanswered, mm.
const NOTABLE_MM: f64 = 0.5;

/// The slides that begin between two times, in moments of a grasp whose line acts `dead_s` after its picture; from
/// `hold_s` on the object is held.
pub(super) fn slides(moments: &[Moment], dead_s: f64, [from_s, to_s]: [f64; 2], hold_s: f64) -> Slides {
    let mut result = Slides::default();
    let mut at = 0;
    while at < moments.len() {
        let Some([began_s, mut ended_s]) = moments[at].slid_s else {
            at += 1;
            continue;
        };
        let first = at;
        at += 1;
        let mut last = first;
        while let Some(next) = moments.get(at) {
            match next.slid_s {
                Some([again_s, end_s]) if again_s - ended_s <= REST_S => (ended_s, last) = (end_s, at),
                Some(_) => break,
                None if next.time_s - ended_s > REST_S => break,
                None => {}
            }
            at += 1;
        }
        if (from_s..to_s).contains(&began_s) {
            let slide = Slide {
                began_s,
                ended_s,
                first,
                last,
            };
            slide.add_to(&mut result, moments, dead_s, hold_s);
        }
    }
    result
}

/// A slide: its times, and the moments of its beginning and end.
struct Slide {
    began_s: f64,
    ended_s: f64,
    first: usize,
    last: usize,
}

impl Slide {
    fn add_to(&self, result: &mut Slides, moments: &[Moment], dead_s: f64, hold_s: f64) {
        result.count += 1;
        let slid_at = |time_s: f64| {
            moments[self.first..=self.last]
                .iter()
                .filter_map(|moment| moment.slid_s)
                .any(|[from, to]| (from..=to).contains(&time_s))
        };
        let mut rises_before = false;
        let mut rise_ms = None;
        for pair in moments.windows(2) {
            let (acts_s, change_n) = (pair[1].time_s + dead_s, pair[1].line_n - pair[0].line_n);
            if acts_s <= self.began_s {
                rises_before = change_n > RISE_N;
                continue;
            }
            if acts_s > self.ended_s + REST_S {
                break;
            }
            if change_n < -FALL_N && acts_s - self.began_s > LATE_S && slid_at(acts_s) {
                result.late_falls += 1;
            }
            if change_n > RISE_N && rise_ms.is_none() {
                rise_ms = Some(1e3 * (acts_s - self.began_s));
            }
        }
        if rises_before {
            return;
        }
        let before_mm = self
            .first
            .checked_sub(1)
            .map_or(0.0, |before| moments[before].slip_mm);
        let notable = moments[self.last].slip_mm - before_mm > NOTABLE_MM;
        if let Some(rise_ms) = rise_ms.or(notable.then_some(NEVER_MS)) {
            result.rises_ms.push(rise_ms);
            if self.began_s >= hold_s {
                result.rises_in_hold_ms.push(rise_ms);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_S: f64 = 0.01;

    /// Moments with these lines that slide in the frames of `sliding` and go 0.2 mm in each.
    fn moments(lines: &[f64], sliding: std::ops::Range<usize>) -> Vec<Moment> {
        let mut slip_mm = 0.0;
        let each = lines.iter().enumerate().map(|(i, &line_n)| {
            let time_s = FRAME_S * i as f64;
            let slides = sliding.contains(&i);
            slip_mm += if slides { 0.2 } else { 0.0 };
            Moment {
                time_s,
                line_n,
                slid_s: slides.then_some([time_s, time_s + FRAME_S]),
                slip_mm,
                needed_n: 1.0,
            }
        });
        each.collect()
    }

    const ALL: [f64; 2] = [0.0, 10.0];

    #[test]
    fn a_rise_counts_from_the_beginning_of_the_slide_to_where_it_acts() {
        let mut lines = [2.0; 40];
        lines[14..].fill(3.0);
        // It slides from 0.1 s on; the line set at 0.14 s acts at 0.165 s.
        let found = slides(&moments(&lines, 10..20), 0.025, ALL, 0.0);
        assert_eq!((found.count, found.late_falls), (1, 0));
        assert_eq!(found.rises_ms.len(), 1);
        assert!((found.rises_ms[0] - 65.0).abs() < 1e-9, "{found:?}");
        assert_eq!(found.rises_in_hold_ms, found.rises_ms);
        // Before the hold it counts once.
        let found = slides(&moments(&lines, 10..20), 0.025, ALL, 0.11);
        assert!(found.rises_in_hold_ms.is_empty() && found.rises_ms.len() == 1);
        assert_eq!(slides(&moments(&lines, 10..20), 0.025, [0.2, 1.0], 0.0).count, 0);
    }

    #[test]
    fn a_slide_that_nothing_answers_is_never_answered_and_a_short_one_is_forgiven() {
        let lines = [2.0; 40];
        assert_eq!(
            slides(&moments(&lines, 10..20), 0.025, ALL, 0.0).rises_ms,
            [NEVER_MS]
        );
        let short = slides(&moments(&lines, 10..12), 0.025, ALL, 0.0);
        assert!(short.rises_ms.is_empty() && short.count == 1);
    }

    #[test]
    fn a_line_that_rises_already_is_not_asked_again() {
        let lines: Vec<f64> = (0..40).map(|i| 2.0 + 0.1 * f64::from(i)).collect();
        let found = slides(&moments(&lines, 10..20), 0.025, ALL, 0.0);
        assert!(found.rises_ms.is_empty() && found.count == 1);
    }

    #[test]
    fn falls_count_only_late_and_while_it_slides() {
        // Falls act from 0.095 s on, 10 ms apart; the slide is from 0.1 to 0.2 s; from 0.142 s on they are late.
        let lines: Vec<f64> = (0..40)
            .map(|i| if i < 7 { 5.0 } else { 5.0 - 0.1 * f64::from(i - 6) })
            .collect();
        let found = slides(&moments(&lines, 10..20), 0.025, ALL, 0.0);
        // Those at 0.145, 0.155, 0.165, 0.175, 0.185, 0.195 s.
        assert_eq!(found.late_falls, 6);
        assert_eq!(slides(&moments(&lines, 10..14), 0.025, ALL, 0.0).late_falls, 0);
    }

    #[test]
    fn slides_with_a_short_rest_between_are_one() {
        let mut both = moments(&[2.0; 40], 10..12);
        let later = moments(&[2.0; 40], 15..18);
        for (moment, other) in both.iter_mut().zip(later) {
            moment.slid_s = moment.slid_s.or(other.slid_s);
            moment.slip_mm += other.slip_mm;
        }
        let found = slides(&both, 0.025, ALL, 0.0);
        assert_eq!((found.count, found.rises_ms.len()), (1, 1));
    }
}
