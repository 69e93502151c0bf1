//! A load that another finger may have taken over: it suddenly fell in a quiet hold, and stayed there. Units: force 1/4096 N, time µs.

use crate::constants::{FORGETTING_US, FORGOTTEN_PART, MOVED_LOAD_PART, PROVEN_US};

/// The load before it fell, otherwise 0, and the time since then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct MovedLoad {
    from: i32,
    for_us: u32,
}

impl MovedLoad {
    /// A load has fallen from here.
    pub(super) const fn fell(&mut self, from: i32) {
        (self.from, self.for_us) = (from, 0);
    }

    /// The load before it fell; 0 when none has.
    pub(super) const fn from(self) -> i32 {
        self.from
    }

    /// The load that is still to be held.
    pub(super) const fn held(self) -> i32 {
        self.from + self.from / MOVED_LOAD_PART
    }

    /// It is forgotten as proven friction is, and once it is felt again: `felt` is the shear while nothing is under test.
    pub(super) fn forget(&mut self, felt: Option<i32>, passed_us: u32) {
        self.for_us = self.for_us.saturating_add(passed_us);
        if self.for_us > PROVEN_US + FORGETTING_US {
            self.for_us -= FORGETTING_US;
            self.from -= self.from / i32::from(FORGOTTEN_PART);
        }
        if felt.is_some_and(|shear| 16 * shear > 15 * self.from) {
            self.from = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_load_that_moved_is_held_until_it_is_felt_and_forgotten_slowly() {
        let mut moved = MovedLoad::default();
        moved.fell(8_000);
        // Under test nothing is felt.
        moved.forget(None, 16_000);
        moved.forget(Some(7_400), 16_000);
        assert!(moved.from() == 8_000 && moved.held() > 8_000);
        for _ in 0..PROVEN_US / 16_000 + 100 {
            moved.forget(Some(4_000), 16_000);
        }
        assert!((6_000..8_000).contains(&moved.from()), "{moved:?}");
        moved.forget(Some(7_900), 16_000);
        assert_eq!((moved.from(), moved.held()), (0, 0));
    }
}
