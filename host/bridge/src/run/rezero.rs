//! New pictures at rest while a run goes on: taken while the gripper is released, compared with the old ones in a thread of their own,
//! and refused where they may show a touch.

use std::sync::Arc;
use std::thread::{self, JoinHandle};

use gripline_control::{Outcome, Why};
use gripline_evaluation::calibration::surface::{Change, Figures, limit};
use gripline_protocol::message::GripMode;
use gripline_simulation::constants::REST_PICTURES;

use super::fingertips::Fingertips;
use super::under_way::Run;
use crate::error::Failure;

/// Pictures that were asked for and do not come within so many of the others are given up.
const FRAMES_MAX: u32 = 600;

/// New pictures at rest of every fingertip.
pub(super) struct Rezero {
    taken: Vec<Vec<Vec<u8>>>,
    frames: u32,
    compared: Option<JoinHandle<Vec<Compared>>>,
}

/// The new pictures of one fingertip, and what they show.
struct Compared {
    pictures: Vec<Vec<u8>>,
    figures: Figures,
    change: Change,
}

impl Rezero {
    pub(super) fn new(fingertips: usize) -> Self {
        Self {
            taken: vec![Vec::new(); fingertips],
            frames: 0,
            compared: None,
        }
    }

    /// Takes the next picture of a fingertip, where it wants one.
    pub(super) fn look(&mut self, sensor: u8, crop: &[u8]) {
        self.frames += 1;
        if let Some(taken) = self.taken.get_mut(usize::from(sensor))
            && taken.len() < usize::from(REST_PICTURES)
            && self.compared.is_none()
        {
            taken.push(crop.to_vec());
        }
    }

    fn is_complete(&self) -> bool {
        self.taken
            .iter()
            .all(|taken| taken.len() == usize::from(REST_PICTURES))
    }
}

/// Why the new pictures are not taken for rest.
fn doubt(figures: &Figures, change: &Change) -> Option<String> {
    if figures.moved_px > limit::STILL_PX {
        return Some(format!(
            "parts of the sensor surface that move by {:.2} pixels",
            figures.moved_px
        ));
    }
    if change.lost > limit::LOST {
        return Some(format!("{:.0} % of the particles missing", 100.0 * change.lost));
    }
    (change.dent_px > limit::STILL_PX).then(|| {
        format!(
            "a part of the sensor surface {:.2} pixels from its place beside the rest",
            change.dent_px
        )
    })
}

impl Run {
    /// Goes on with new rest pictures, where somebody asked for them.
    pub(super) fn look_after_rezero(&mut self, fingertips: &mut Fingertips) -> Result<(), Failure> {
        let is_released = self
            .control
            .session
            .status()
            .is_some_and(|status| status.mode == GripMode::Released);
        let Some(rezero) = self.requests.rezero() else {
            return Ok(());
        };
        let refused = if !is_released {
            Why::Holding
        } else if rezero.frames > FRAMES_MAX {
            Why::NotConfirmed(format!("too few pictures in {FRAMES_MAX} frames"))
        } else if let Some(at_work) = rezero.compared.take_if(|at_work| at_work.is_finished()) {
            // A thread that panicked has said so.
            match at_work.join() {
                Ok(compared) => match self.take_over_rest(fingertips, compared) {
                    Ok(()) => {
                        self.requests.rezeroed(&Outcome::Done);
                        return self.settle_requests();
                    }
                    Err(why) => why,
                },
                Err(_) => Why::NotConfirmed("a failed comparison".to_owned()),
            }
        } else {
            if rezero.is_complete() && rezero.compared.is_none() {
                let (taken, old) = (std::mem::take(&mut rezero.taken), fingertips.rest_means());
                rezero.compared = Some(thread::spawn(move || compare(taken, &old)));
            }
            return Ok(());
        };
        self.requests.rezeroed(&Outcome::Refused(refused));
        self.settle_requests()
    }

    fn take_over_rest(&mut self, fingertips: &mut Fingertips, compared: Vec<Compared>) -> Result<(), Why> {
        let doubts = compared
            .iter()
            .zip(1..)
            .filter_map(|(new, number): (&Compared, u8)| {
                Some(format!(
                    "{} on fingertip {number}",
                    doubt(&new.figures, &new.change)?
                ))
            });
        if let Some(found) = doubts.reduce(|all, next| format!("{all}, {next}")) {
            return Err(Why::Touched(found));
        }
        for (sensor, new) in (0..).zip(compared) {
            if let Some(watch) = self.drift.get_mut(usize::from(sensor)) {
                *watch = super::drift::DriftWatch::new(&new.pictures);
            }
            fingertips.rest_anew(sensor, &new.pictures, &new.figures);
        }
        Ok(())
    }
}

fn compare(taken: Vec<Vec<Vec<u8>>>, old: &[Arc<Vec<u8>>]) -> Vec<Compared> {
    let compared = taken.into_iter().zip(old).map(|(pictures, old)| {
        let figures = Figures::of(&pictures);
        let change = Change::between(old, &figures.mean);
        Compared {
            pictures,
            figures,
            change,
        }
    });
    compared.collect()
}
