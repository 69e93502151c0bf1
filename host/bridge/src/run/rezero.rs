//! New pictures at rest while a run goes on: taken while the gripper is released, compared with the old ones in the background,
//! and refused where they may show a touch.

use gripline_protocol::SensorId;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};

use gripline_control::Why;
use gripline_evaluation::calibration::surface::{Change, Figures, limit};
use gripline_simulation::constants::REST_PICTURES;

use super::background;
use crate::rest::unfit;

/// A re-zero without its pictures after this many frames is given up.
const FRAMES_MAX: u32 = 600;

/// New pictures at rest of every fingertip.
pub(super) struct Rezero {
    taken: Vec<Vec<Vec<u8>>>,
    frames: u32,
    compared: Option<Receiver<Vec<Compared>>>,
}

/// The new pictures of one fingertip, and what they show.
pub(super) struct Compared {
    pub pictures: Vec<Vec<u8>>,
    pub figures: Figures,
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

    /// Takes the next picture of a fingertip, if more are needed.
    pub(super) fn observe(&mut self, sensor: SensorId, crop: &[u8]) {
        self.frames += 1;
        if let Some(taken) = self.taken.get_mut(sensor.index())
            && taken.len() < usize::from(REST_PICTURES)
            && self.compared.is_none()
        {
            taken.push(crop.to_vec());
        }
    }

    /// Continues; returns the result once it is known. `old` is the mean rest picture of each fingertip.
    pub(super) fn step(
        &mut self,
        old: impl FnOnce() -> Vec<Arc<Vec<u8>>>,
    ) -> Option<Result<Vec<Compared>, Why>> {
        match self.compared.as_ref().map(Receiver::try_recv) {
            None | Some(Err(TryRecvError::Empty)) => {}
            Some(Ok(compared)) => return Some(believed(compared)),
            // A comparison that panicked has said so.
            Some(Err(TryRecvError::Disconnected)) => {
                return Some(Err(Why::NotConfirmed("a failed comparison".to_owned())));
            }
        }
        if self.frames > FRAMES_MAX {
            return Some(Err(Why::NotConfirmed(format!(
                "too few pictures in {FRAMES_MAX} frames"
            ))));
        }
        if self.is_complete() && self.compared.is_none() {
            let (taken, old) = (std::mem::take(&mut self.taken), old());
            self.compared = Some(background::compute(move || compare(taken, &old)));
        }
        None
    }

    fn is_complete(&self) -> bool {
        self.taken
            .iter()
            .all(|taken| taken.len() == usize::from(REST_PICTURES))
    }
}

/// Why the new pictures are refused.
fn doubt(figures: &Figures, change: &Change) -> Option<String> {
    if let Some(unfit) = unfit(figures).into_iter().next() {
        return Some(unfit.found);
    }
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

/// The pictures, if none may show a touch.
fn believed(compared: Vec<Compared>) -> Result<Vec<Compared>, Why> {
    let doubts = compared
        .iter()
        .zip(1..)
        .filter_map(|(new, number): (&Compared, u8)| {
            Some(format!(
                "{} on fingertip {number}",
                doubt(&new.figures, &new.change)?
            ))
        });
    match doubts.reduce(|all, next| format!("{all}, {next}")) {
        Some(found) => Err(Why::Touched(found)),
        None => Ok(compared),
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

#[cfg(test)]
mod tests {
    use gripline_evaluation::calibration::surface::mean;
    use gripline_simulation::GripScene;

    use super::*;

    #[test]
    fn pictures_of_which_some_are_too_dark_to_show_a_touch_are_refused() {
        let mut scene = GripScene::new(80);
        let good: Vec<Vec<u8>> = (0..REST_PICTURES).map(|_| scene.rest_image().pixels).collect();
        let old = Arc::new(mean(&good));
        let outcome = |pictures: &[Vec<u8>]| {
            let mut rezero = Rezero::new(1);
            for picture in pictures {
                rezero.observe(SensorId::FIRST, picture);
            }
            loop {
                if let Some(outcome) = rezero.step(|| vec![Arc::clone(&old)]) {
                    return outcome.map(drop);
                }
                std::thread::yield_now();
            }
        };
        assert_eq!(outcome(&good), Ok(()));
        let mut dark_first = good.clone();
        dark_first[..4].fill(vec![0; good[0].len()]);
        let Err(Why::Touched(found)) = outcome(&dark_first) else {
            panic!("dark pictures show no touch");
        };
        assert!(found.contains("a mean level of 0"), "{found}");
    }
}
