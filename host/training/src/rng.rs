//! Random numbers for augmentation and shuffling: one seeded stream, the same on every machine.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng as _;

pub(crate) struct Rng(Pcg32);

impl Rng {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg32::new(seed, 0x67_72_69_70))
    }

    /// Uniform in 0..n. The bias of taking the high part of a 32-bit product is below n / 2³².
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.0.next_u32()) * n as u64) >> 32) as usize
    }

    /// Uniform in [low, high).
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.0.next_u32() >> 8) as f32 / (1 << 24) as f32
    }

    pub(crate) fn shuffle(&mut self, order: &mut [usize]) {
        for i in (1..order.len()).rev() {
            order.swap(i, self.below(i + 1));
        }
    }
}
