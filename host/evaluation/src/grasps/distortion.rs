//! How a sensor's forces are off: a gain for each axis, a gel that creeps, hysteresis. Each taxel and axis by itself, from
//! picture to picture. Units: N, s.

use gripline_protocol::SIDE;

/// Newtons per taxel.
pub(super) type Forces = [[f32; 3]; SIDE * SIDE];

/// What is wrong with a sensor's forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    /// What a newton along x, y and z reads.
    pub gain: [f64; 3],
    /// Creep: a force that stays reads by this share more in the end, and `creep_s` is the time constant.
    pub creep: f64,
    /// See there.
    pub creep_s: f64,
    /// Hysteresis: a force that changes its way first has to go twice this share of the largest force so far before its
    /// reading follows.
    pub hysteresis: f64,
}

/// A sensor with a distortion, at work.
pub(super) struct Distorted {
    distortion: Distortion,
    /// What has crept in.
    slow: Forces,
    /// What the hysteresis shows, and the largest force so far.
    shown: Forces,
    max: Forces,
}

impl Distorted {
    pub(super) fn new(distortion: Distortion) -> Self {
        let nothing = [[0.0; 3]; SIDE * SIDE];
        Self {
            distortion,
            slow: nothing,
            shown: nothing,
            max: nothing,
        }
    }

    /// What the sensor makes of `forces`, `step_s` after the picture before.
    pub(super) fn apply(&mut self, forces: &mut Forces, step_s: f64) {
        let Distortion {
            gain,
            creep,
            creep_s,
            hysteresis,
        } = self.distortion;
        let follows = -libm::expm1(-step_s / creep_s) as f32;
        let [gain, creep, hysteresis] = [
            gain.map(|gain| gain as f32),
            [creep as f32; 3],
            [hysteresis as f32; 3],
        ];
        for (taxel, force) in forces.iter_mut().enumerate() {
            for k in 0..3 {
                let slow = &mut self.slow[taxel][k];
                *slow += (force[k] - *slow) * follows;
                let crept = force[k] + creep[k] * *slow;
                let max = &mut self.max[taxel][k];
                *max = max.max(crept.abs());
                let half = hysteresis[k] * *max;
                let shown = &mut self.shown[taxel][k];
                *shown = shown.clamp(crept - half, crept + half);
                force[k] = gain[k] * *shown;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Distortion = Distortion {
        gain: [1.0; 3],
        creep: 0.0,
        creep_s: 1.0,
        hysteresis: 0.0,
    };

    /// What a sensor shows of a force along each axis that takes these values, 10 ms apart.
    fn shown(distortion: Distortion, forces: impl IntoIterator<Item = f32>) -> Vec<[f32; 3]> {
        let mut sensor = Distorted::new(distortion);
        let each = forces.into_iter().map(|force| {
            let mut map = [[force; 3]; SIDE * SIDE];
            sensor.apply(&mut map, 0.01);
            map[17]
        });
        each.collect()
    }

    #[test]
    fn without_any_distortion_forces_stay_as_they_are_bit_for_bit() {
        let forces = [0.3, -0.2, 1.7, 0.0, 0.4];
        for (seen, force) in shown(NONE, forces).into_iter().zip(forces) {
            assert_eq!(seen.map(f32::to_bits), [force.to_bits(); 3]);
        }
    }

    #[test]
    fn every_axis_has_its_own_gain() {
        let distortion = Distortion {
            gain: [0.75, 1.0, 1.25],
            ..NONE
        };
        let found = shown(distortion, [2.0])[0].map(f32::to_bits);
        assert_eq!(found, [1.5_f32, 2.0, 2.5].map(f32::to_bits));
    }

    #[test]
    fn a_force_that_stays_creeps_to_its_share_with_its_time_constant() {
        let distortion = Distortion {
            creep: 0.1,
            creep_s: 0.5,
            ..NONE
        };
        let seen = shown(distortion, std::iter::repeat_n(2.0, 500));
        for (step, [x, ..]) in seen.iter().enumerate() {
            let time = 0.01 * (step + 1) as f64;
            let expected = 2.0 * (1.0 + 0.1 * (1.0 - libm::exp(-time / 0.5)));
            assert!(
                (f64::from(*x) - expected).abs() < 1e-4,
                "{time} s: {x} {expected}"
            );
        }
    }

    #[test]
    fn after_a_turn_the_reading_stays_until_the_force_has_gone_twice_the_hysteresis() {
        let distortion = Distortion {
            hysteresis: 0.05,
            ..NONE
        };
        let seen = shown(distortion, [1.0, 0.95, 0.901, 0.85, 0.5, 0.55, 0.65]);
        let [x, expected] = [
            seen.iter().map(|force| force[0]).collect::<Vec<_>>(),
            vec![0.95, 0.95, 0.95, 0.9, 0.55, 0.55, 0.6],
        ];
        for (found, expected) in x.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-5, "{x:?}");
        }
    }
}
