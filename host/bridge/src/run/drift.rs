//! Whether the untouched fingertip still looks as at the start: camera or gel may have moved, lamps dimmed, a dent may remain.
//! Compared once a minute while the gripper is released and nothing touches, in the background. A run only warns: new rest
//! pictures are taken when it starts, or on request. Times in seconds of the pictures' clock. Limit: a drift so large that the gate
//! sees a touch is not compared.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};

use gripline_evaluation::calibration::surface::{Change, limit, mean};
use gripline_network::scene::GateDecision;
use gripline_pipeline::control_loop::Late;
use gripline_protocol::message::GripMode;

use super::background;

/// Untouched time before a check.
const UNTOUCHED_S: f64 = 2.0;
/// Time between checks, and between warnings.
const COMPARE_PERIOD_S: f64 = 60.0;
const WARN_S: f64 = 600.0;
/// Pictures of a check.
const PICTURES: usize = 16;

/// Monitors one fingertip.
#[derive(Debug)]
pub(super) struct DriftWatch {
    rest: Arc<Vec<u8>>,
    untouched_since_s: Option<f64>,
    compared_s: f64,
    warned_s: f64,
    seen: Vec<Vec<u8>>,
    at_work: Option<Receiver<Change>>,
}

impl DriftWatch {
    /// One per fingertip, if its pictures are a camera's.
    pub(super) fn of_cameras(are_live: bool, rests: Vec<Vec<Vec<u8>>>) -> Vec<Self> {
        let live = rests.into_iter().filter(|_| are_live);
        live.map(|rest| Self::new(&rest)).collect()
    }

    /// For a fingertip with these rest pictures.
    pub(super) fn new(rest: &[Vec<u8>]) -> Self {
        Self {
            rest: Arc::new(mean(rest)),
            untouched_since_s: None,
            compared_s: 0.0,
            warned_s: f64::NEG_INFINITY,
            seen: Vec::new(),
            at_work: None,
        }
    }

    /// Takes the next picture, and whether it is untouched. Returns a warning.
    pub(super) fn observe(&mut self, t_s: f64, is_untouched: bool, crop: &[u8]) -> Option<String> {
        let compared = self.at_work.as_ref().map(Receiver::try_recv);
        if let Some(compared @ (Ok(_) | Err(TryRecvError::Disconnected))) = compared {
            self.at_work = None;
            // A comparison that panicked has said so.
            let warning = compared.ok().and_then(|change| warning(&change));
            if warning.is_some() && t_s - self.warned_s >= WARN_S {
                self.warned_s = t_s;
                return warning;
            }
        }
        if !is_untouched {
            self.untouched_since_s = None;
            self.seen.clear();
            return None;
        }
        let since_s = *self.untouched_since_s.get_or_insert(t_s);
        let is_due = t_s - since_s >= UNTOUCHED_S && t_s - self.compared_s >= COMPARE_PERIOD_S;
        if is_due && self.at_work.is_none() {
            self.seen.push(crop.to_vec());
            if self.seen.len() == PICTURES {
                self.compared_s = t_s;
                let (rest, seen) = (Arc::clone(&self.rest), std::mem::take(&mut self.seen));
                self.at_work = Some(background::compute(move || Change::between(&rest, &mean(&seen))));
            }
        }
        None
    }
}

/// Whether a frame shows the fingertip at rest. `mode` is what the microcontroller said last.
pub(super) fn is_at_rest(gate: GateDecision, late: Option<Late>, mode: Option<GripMode>) -> bool {
    gate == GateDecision::NoContact && late.is_none() && mode == Some(GripMode::Released)
}

/// The effect of a change on the maps; `None` if it is harmless.
fn warning(change: &Change) -> Option<String> {
    let light = change.light - 1.0;
    let found = if change.lost > limit::LOST {
        format!(
            "found {:.0} % of the particles gone, expected at most {:.0} %: clean or uncover the sensor surface",
            100.0 * change.lost,
            100.0 * limit::LOST
        )
    } else if change.drift_px > limit::DRIFT_PX {
        format!(
            "found it {:.2} pixels from its place, expected at most {}: fasten camera and gel",
            change.drift_px,
            limit::DRIFT_PX
        )
    } else if change.dent_px > limit::STILL_PX {
        format!(
            "found a part of it {:.2} pixels from its place, expected at most {}: let the gel settle",
            change.dent_px,
            limit::STILL_PX
        )
    } else if light.abs() > limit::LIGHT[0] {
        format!(
            "found {:+.0} % of light, expected at most {:.0} % more or less: set lamps and exposure as they were",
            100.0 * light,
            100.0 * limit::LIGHT[0]
        )
    } else {
        return None;
    };
    Some(format!(
        "the untouched fingertip has changed since the run began: {found}; then release, let nothing touch it, and start the run again"
    ))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use gripline_simulation::GripScene;

    use super::*;

    fn rest(seed: u64) -> Vec<Vec<u8>> {
        let mut scene = GripScene::new(seed);
        (0..PICTURES).map(|_| scene.rest_image().pixels).collect()
    }

    /// Moved to the right by a pixel.
    fn moved(crop: &[u8]) -> Vec<u8> {
        let mut moved = crop.to_vec();
        moved.rotate_right(1);
        moved
    }

    /// All warnings of this many seconds at 10 pictures a second.
    fn warnings(
        watch: &mut DriftWatch,
        seconds: u32,
        picture: impl Fn(usize) -> (bool, Vec<u8>),
    ) -> Vec<String> {
        let mut all = Vec::new();
        for frame in 0..seconds as usize * 10 {
            let (is_untouched, crop) = picture(frame);
            all.extend(watch.observe(frame as f64 / 10.0, is_untouched, &crop));
            if let Some(work) = watch.at_work.take() {
                // Arrives before the next picture.
                let (sender, arrived) = sync_channel(1);
                sender.send(work.recv().unwrap()).unwrap();
                watch.at_work = Some(arrived);
            }
        }
        all
    }

    #[test]
    fn a_camera_that_moved_is_reported_once_in_ten_minutes_and_one_that_did_not_never() {
        let rest = rest(1);
        let same = warnings(&mut DriftWatch::new(&rest), 130, |frame| {
            (true, rest[frame % PICTURES].clone())
        });
        assert!(same.is_empty(), "{same:?}");
        let found = warnings(&mut DriftWatch::new(&rest), 200, |frame| {
            (true, moved(&rest[frame % PICTURES]))
        });
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].contains("pixels from its place") && found[0].contains("fasten"),
            "{found:?}"
        );
    }

    #[test]
    fn only_a_picture_in_time_that_shows_nothing_while_the_gripper_is_released_is_at_rest() {
        let released = Some(GripMode::Released);
        assert!(is_at_rest(GateDecision::NoContact, None, released));
        // A light grip may be too faint for the gate.
        assert!(!is_at_rest(GateDecision::NoContact, None, Some(GripMode::Hold)));
        assert!(!is_at_rest(GateDecision::NoContact, None, None));
        assert!(!is_at_rest(
            GateDecision::NoContact,
            Some(Late::Picture),
            released
        ));
        assert!(!is_at_rest(GateDecision::Unchanged, None, released));
    }

    #[test]
    fn while_something_touches_nobody_looks() {
        let rest = rest(1);
        let found = warnings(&mut DriftWatch::new(&rest), 130, |frame| {
            (frame % 15 > 0, moved(&rest[frame % PICTURES]))
        });
        assert!(found.is_empty(), "{found:?}");
    }
}
