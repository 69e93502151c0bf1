//! A rival: an online particle filter on friction. Ours, from the idea of arXiv 2602.02026; nothing of its code or figures is
//! used. Particles are frictions; a contact that sticks says "at least F_T/F_N", one that slides says "about F_T/F_N"; the
//! demand takes a low quantile. Whether it slides follows from the map's change at constant load. Units: N, s.

use gripline_protocol::{ForceMap, LSB_PER_NEWTON};
use gripline_simulation::Random;

use super::follower::{Follower, rising};

/// Purpose of the filter's random numbers.
const FILTER: u64 = 75;
const PARTICLES: usize = 256;
/// Frictions that are possible before anything is known.
const PRIOR: [f64; 2] = [0.15, 1.2];
/// From map to map a friction wanders by this share, and this share of the particles begins again.
const WANDERS: f64 = 0.01;
const ANEW: f64 = 0.005;
/// How sharp "at least F_T/F_N" and "about F_T/F_N" are, shares of the friction.
const STICK_SPREAD: f64 = 0.05;
const SLIDE_SPREAD: f64 = 0.12;
/// Probability of the contrary.
const DOUBT: f64 = 0.02;
/// Σ|map − map three maps ago| / F_N, less the change of the whole forces, from which a contact is said to slide.
const CHANGE: f64 = 0.12;
const MAPS_AGO: usize = 3;
/// Which quantile of the frictions the demand takes, and what it keeps above.
const QUANTILE: f64 = 0.1;
const MARGIN: f64 = 0.3;
/// What a newton of normal force reads is learnt against the line's own force: so much from map to map, within this
/// range; the gripper is expected to lag by this, s.
const GAIN_LEARNT: f64 = 0.04;
const GAIN: [f64; 2] = [0.7, 1.45];
const LAG_S: f64 = 0.09;
/// Least normal force that says anything, N.
const TOUCH_N: f64 = 0.2;

/// The filter at work.
pub(super) struct ParticleFilter {
    random: Random,
    particles: Vec<f64>,
    weights: Vec<f64>,
    /// The last maps, newest last.
    maps: Vec<ForceMap>,
    line: Follower,
    before_n: f64,
    /// The gripper's expected force, N, and what a newton that is read is of it.
    expected_n: f64,
    gain: f64,
}

impl ParticleFilter {
    pub(super) fn new(line: Follower, seed: u64) -> Self {
        let mut random = Random::new(seed, FILTER);
        let particles = (0..PARTICLES)
            .map(|_| random.uniform(PRIOR[0], PRIOR[1]))
            .collect();
        Self {
            random,
            particles,
            weights: vec![1.0 / PARTICLES as f64; PARTICLES],
            maps: Vec::new(),
            line,
            before_n: 0.0,
            expected_n: 0.0,
            gain: 1.0,
        }
    }

    /// The line after a good map, `step_s` after the map before.
    pub(super) fn line_n(&mut self, map: &ForceMap, step_s: f64) -> f64 {
        let [x, y, normal_n] = total_n(map);
        let shear_n = x.hypot(y);
        let slides = self.changes(map, normal_n) > CHANGE;
        self.maps.push(map.clone());
        if self.maps.len() > MAPS_AGO {
            self.maps.remove(0);
        }
        self.expected_n += (self.line.line_n() - self.expected_n) * (step_s / LAG_S).min(1.0);
        if normal_n > TOUCH_N {
            self.gain += GAIN_LEARNT * (self.expected_n / normal_n - self.gain);
            self.gain = self.gain.clamp(GAIN[0], GAIN[1]);
            self.learn(shear_n / normal_n, slides);
        }
        let load_n = rising(shear_n, self.before_n, step_s);
        self.before_n = shear_n;
        let wanted_n = (1.0 + MARGIN) * self.gain * load_n / self.quantile(QUANTILE);
        // While it slides the line does not fall.
        let wanted_n = if slides {
            wanted_n.max(self.line.line_n())
        } else {
            wanted_n
        };
        self.line.follow(wanted_n, step_s)
    }

    /// Where the line is: what stays when no good map comes.
    pub(super) fn stays_n(&self) -> f64 {
        self.line.line_n()
    }

    /// Change of the map beyond that of the whole forces, over the normal force.
    fn changes(&self, map: &ForceMap, normal_n: f64) -> f64 {
        let Some(before) = self.maps.first().filter(|_| self.maps.len() == MAPS_AGO) else {
            return 0.0;
        };
        let mut sum = 0_u64;
        for (now, then) in map.taxels.iter().zip(&before.taxels) {
            sum += u64::from(now.x.abs_diff(then.x))
                + u64::from(now.y.abs_diff(then.y))
                + u64::from(now.z.abs_diff(then.z));
        }
        let whole: f64 = total_n(map)
            .iter()
            .zip(total_n(before))
            .map(|(now, then)| (now - then).abs())
            .sum();
        (sum as f64 / f64::from(LSB_PER_NEWTON) - whole) / normal_n.max(TOUCH_N)
    }

    /// Weighs the particles by what a contact with this ratio does, and draws them again where few are left.
    fn learn(&mut self, ratio: f64, slides: bool) {
        for (friction, weight) in self.particles.iter_mut().zip(&mut self.weights) {
            if self.random.unit() < ANEW {
                *friction = self.random.uniform(PRIOR[0], PRIOR[1]);
            }
            let wander = WANDERS * (2.0 * self.random.unit() - 1.0);
            *friction = (*friction * (1.0 + wander)).clamp(PRIOR[0], PRIOR[1]);
            let likely = if slides {
                libm::exp(-0.5 * ((ratio - *friction) / (SLIDE_SPREAD * *friction)).powi(2))
            } else {
                1.0 / (1.0 + libm::exp((ratio - *friction) / (STICK_SPREAD * *friction)))
            };
            *weight *= DOUBT + (1.0 - DOUBT) * likely;
        }
        let sum: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|weight| *weight /= sum);
        let effective = 1.0 / self.weights.iter().map(|weight| weight * weight).sum::<f64>();
        if effective < 0.5 * PARTICLES as f64 {
            self.resample();
        }
    }

    /// Systematic resampling.
    fn resample(&mut self) {
        let step = 1.0 / PARTICLES as f64;
        let first = self.random.unit() * step;
        let (mut at, mut reached) = (0, self.weights[0]);
        let drawn: Vec<f64> = (0..PARTICLES)
            .map(|i| {
                while reached < first + i as f64 * step && at + 1 < PARTICLES {
                    at += 1;
                    reached += self.weights[at];
                }
                self.particles[at]
            })
            .collect();
        self.particles = drawn;
        self.weights.fill(step);
    }

    /// The friction below which this share of the weight lies.
    fn quantile(&self, share: f64) -> f64 {
        let mut order: Vec<(f64, f64)> = self
            .particles
            .iter()
            .copied()
            .zip(self.weights.iter().copied())
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut reached = 0.0;
        for (friction, weight) in &order {
            reached += weight;
            if reached >= share {
                return *friction;
            }
        }
        order.last().map_or(PRIOR[0], |(friction, _)| *friction)
    }
}

/// Sums of a map's forces, N.
fn total_n(map: &ForceMap) -> [f64; 3] {
    let mut sums = [0_i64; 3];
    for taxel in &map.taxels {
        for (sum, part) in sums.iter_mut().zip([taxel.x, taxel.y, taxel.z]) {
            *sum += i64::from(part);
        }
    }
    sums.map(|sum| sum as f64 / f64::from(LSB_PER_NEWTON))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filter() -> ParticleFilter {
        ParticleFilter::new(Follower::new(1.0, 30.0), 3)
    }

    #[test]
    fn a_contact_that_sticks_raises_the_lower_end_of_friction_and_one_that_slides_finds_it() {
        let mut filter = filter();
        let before = filter.quantile(0.1);
        for _ in 0..60 {
            filter.learn(0.5, false);
        }
        let sticks = filter.quantile(0.1);
        assert!(before < 0.35 && sticks > 0.45, "{before} {sticks}");
        assert!(filter.quantile(0.9) > 0.9, "nothing says that it is not more");
        for _ in 0..20 {
            filter.learn(0.7, true);
        }
        let [low, high] = [0.2, 0.8].map(|share| filter.quantile(share));
        assert!(low > 0.6 && high < 0.8, "{low} {high}");
    }

    #[test]
    fn a_friction_that_dropped_is_found_again() {
        let mut filter = filter();
        for ratio in [0.8, 0.3] {
            for _ in 0..40 {
                filter.learn(ratio, true);
            }
            let middle = filter.quantile(0.5);
            assert!((middle - ratio).abs() < 0.1, "{ratio}: {middle}");
        }
    }
}
