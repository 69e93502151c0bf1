//! Random numbers with a stable stream: PCG64 MCG, and our own ways from bits to numbers.

use std::f64::consts::TAU;

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// A seeded stream; the same seed and purpose give the same numbers everywhere.
#[derive(Debug, Clone)]
pub struct Random(Pcg64Mcg);

impl Random {
    /// The stream of `seed` for one `purpose`, so that what one part draws does not shift another's numbers.
    #[must_use]
    pub fn new(seed: u64, purpose: u64) -> Self {
        let mut random = Self(Pcg64Mcg::new(
            (u128::from(seed) << 64) | u128::from(purpose.wrapping_mul(2) | 1),
        ));
        // A multiplicative generator needs a few turns before close seeds are far apart.
        for _ in 0..8 {
            random.bits();
        }
        random
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [from, to).
    pub fn uniform(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }

    /// Uniform in the logarithm between two positive bounds.
    pub fn log_uniform(&mut self, from: f64, to: f64) -> f64 {
        libm::exp(self.uniform(libm::log(from), libm::log(to)))
    }

    /// Uniform in 0..n. The bias of taking the high part of a product is below n / 2⁶⁴.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.bits()) * n as u128) >> 64) as usize
    }

    /// A direction in the plane.
    pub fn direction(&mut self) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.uniform(0.0, TAU));
        [cos, sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_uniform_and_differ_by_seed_and_purpose() {
        let mut random = Random::new(3, 1);
        let draws: Vec<f64> = (0..20_000).map(|_| random.unit()).collect();
        let mean = draws.iter().sum::<f64>() / 20_000.0;
        let spread = draws.iter().map(|v| (v - 0.5).powi(2)).sum::<f64>() / 20_000.0;
        assert!((mean - 0.5).abs() < 0.01 && (spread - 1.0 / 12.0).abs() < 0.003);
        let first: Vec<u64> = [(3, 1), (3, 2), (4, 1)]
            .map(|(s, p)| Random::new(s, p).bits())
            .to_vec();
        assert!(first[0] != first[1] && first[0] != first[2] && first[1] != first[2]);
    }
}
