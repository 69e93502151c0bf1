//! From comparisons to one number: how sure it is that something slips, and how much that number is worth. Pure.

use std::collections::VecDeque;

use crate::constants::{ENERGY_PICTURES, LAGS, NOISE_ENERGY, SCORE_PICTURES};
use crate::grid::median;

/// A finger's imprint beside the one of some pictures ago, carried along with the gel. Energies are squared grey levels per pixel
/// of the imprint, channels added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Product of the two and energy of the earlier one, for each lag of [`LAGS`] that reaches back to a picture.
    pub earlier: [Option<[f32; 2]>; LAGS.len()],
    /// Energy of the imprint now.
    pub energy: f32,
    /// What the comparison is worth, 0 to 1: markers seen, picture in order, rest known.
    pub quality: f32,
}

/// What a hold's imprints say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// How little of the earlier imprint has come back, 0 (all of it) to 1 (nothing): something slips, turns or leaves.
    pub slip: f32,
    /// Share of the strongest imprint of this hold that is gone, 0 to 1.
    pub loss: f32,
    /// Energy of all fingers' imprints now, squared grey levels per pixel.
    pub energy: f32,
    /// What `slip` is worth, 0 to 1: the least of the fingers' qualities, and how far the strongest imprint of this hold stood
    /// above noise. Near 0 nothing was ever held and `slip` says nothing.
    pub quality: f32,
}

/// All fingers of one gripper through one hold. Lags by about a picture: medians over the newest three.
#[derive(Debug, Clone, Default)]
pub struct Hold {
    scores: VecDeque<f32>,
    energies: VecDeque<f32>,
    strongest: f32,
}

impl Hold {
    /// Takes what every finger saw at one moment; `None` while there is nothing to compare with.
    pub fn step(&mut self, fingers: &[Comparison]) -> Option<Evidence> {
        let noise = NOISE_ENERGY * fingers.len() as f32;
        let energy: f32 = fingers.iter().map(|finger| finger.energy).sum();
        let scores: Vec<f32> = (0..LAGS.len())
            .filter_map(|lag| {
                let (mut product, mut earlier) = (0.0, 0.0);
                for finger in fingers {
                    let [with, alone] = finger.earlier[lag]?;
                    product += with;
                    earlier += alone;
                }
                Some(1.0 - product / ((earlier + noise) * (energy + noise)).sqrt())
            })
            .collect();
        if scores.is_empty() || fingers.is_empty() {
            return None;
        }
        let score = scores.iter().sum::<f32>() / scores.len() as f32;
        let slip = newest(&mut self.scores, score, SCORE_PICTURES);
        let energy = newest(&mut self.energies, energy, ENERGY_PICTURES);
        self.strongest = self.strongest.max(energy);
        let worst = fingers.iter().map(|finger| finger.quality).fold(1.0, f32::min);
        Some(Evidence {
            slip: slip.clamp(0.0, 1.0),
            loss: (1.0 - energy / self.strongest.max(noise)).clamp(0.0, 1.0),
            energy,
            quality: worst * self.strongest / (self.strongest + noise),
        })
    }
}

/// The median of the newest values, this one among them.
fn newest(values: &mut VecDeque<f32>, value: f32, max: usize) -> f32 {
    if values.len() == max {
        values.pop_front();
    }
    values.push_back(value);
    let mut sorted: Vec<f32> = values.iter().copied().collect();
    median(&mut sorted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(product: f32, earlier: f32, energy: f32) -> Comparison {
        Comparison {
            earlier: [Some([product, earlier]), None],
            energy,
            quality: 1.0,
        }
    }

    #[test]
    fn what_comes_back_whole_is_no_evidence_and_what_has_nothing_in_common_is_full_evidence() {
        let mut hold = Hold::default();
        let held = hold.step(&[seen(400.0, 400.0, 400.0); 2]).unwrap();
        assert!(held.slip < 0.02 && held.quality > 0.95, "{held:?}");
        for _ in 0..3 {
            hold.step(&[seen(0.0, 400.0, 400.0); 2]).unwrap();
        }
        let slipped = hold.step(&[seen(0.0, 400.0, 400.0); 2]).unwrap();
        assert!(slipped.slip > 0.99 && slipped.loss < 0.01, "{slipped:?}");
    }

    #[test]
    fn an_imprint_that_leaves_is_lost_and_an_empty_hand_has_no_quality() {
        let mut hold = Hold::default();
        for _ in 0..5 {
            hold.step(&[seen(400.0, 400.0, 400.0)]).unwrap();
        }
        let mut gone = None;
        for _ in 0..5 {
            gone = hold.step(&[seen(0.5, 1.0, 1.0)]);
        }
        let gone = gone.unwrap();
        assert!(
            gone.loss > 0.99 && gone.slip > 0.8 && gone.quality > 0.9,
            "{gone:?}"
        );
        let empty = Hold::default().step(&[seen(0.1, 0.2, 0.2)]).unwrap();
        assert!(empty.quality < 0.1, "{empty:?}");
    }

    #[test]
    fn without_an_earlier_picture_of_every_finger_there_is_no_evidence() {
        let first = Comparison {
            earlier: [None, None],
            energy: 1.0,
            quality: 1.0,
        };
        assert_eq!(Hold::default().step(&[first, seen(1.0, 1.0, 1.0)]), None);
        assert_eq!(Hold::default().step(&[]), None);
    }
}
