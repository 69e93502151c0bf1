//! Shear and normal force of one fingertip over the last slots of time. A slot is the mean of its maps, so that what follows does not depend
//! on how many maps come in a second. Units: force 1/4096 N, shares 1/1024, time µs.

use crate::arithmetic::{change, part};
use crate::constants::{RISES_SHARE, SLOT_US, SUDDEN_SHARE};

/// Slots that are kept.
const SLOTS: usize = 6;
/// A slot ends after so many maps at the latest.
const SLOT_MAPS_MAX: u8 = 16;

/// The last slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Slots {
    /// Means of each slot, newest first.
    pub(super) shear: [i32; SLOTS],
    pub(super) normal: [i32; SLOTS],
    filled: u8,
    /// The slot in progress: sums, maps, time.
    sum: [i32; 2],
    maps: u8,
    slot_us: u32,
}

impl Slots {
    /// The next map begins a slot.
    pub(super) const fn begins(&self) -> bool {
        self.maps == 0
    }

    /// Takes shear and normal force of a map, `since_us` after the map before. Returns the time of the slot that it ends, µs; the first slot
    /// says nothing yet.
    pub(super) fn add(&mut self, shear: i32, normal: i32, since_us: u16) -> Option<u32> {
        self.sum = [self.sum[0] + shear, self.sum[1] + normal];
        self.maps += 1;
        self.slot_us += u32::from(since_us);
        if self.slot_us < SLOT_US && self.maps < SLOT_MAPS_MAX {
            return None;
        }
        let mean = |sum: i32| sum / i32::from(self.maps.max(1));
        let [shear, normal] = self.sum.map(mean);
        let passed_us = self.slot_us;
        (self.sum, self.maps, self.slot_us) = ([0; 2], 0, 0);
        self.shear.copy_within(..SLOTS - 1, 1);
        self.normal.copy_within(..SLOTS - 1, 1);
        (self.shear[0], self.normal[0]) = (shear, normal.max(1));
        self.filled = (self.filled + 1).min(SLOTS as u8);
        (self.filled > 1).then_some(passed_us)
    }

    /// All slots are of this contact.
    pub(super) const fn are_filled(&self) -> bool {
        self.filled == SLOTS as u8
    }

    /// Shear and normal force, means of the two newest slots.
    pub(super) const fn newest(&self) -> [i32; 2] {
        [
            i32::midpoint(self.shear[0], self.shear[1]),
            i32::midpoint(self.normal[0], self.normal[1]),
        ]
    }

    /// Change of shear and normal force over the last four slots, shares in 1/1024.
    pub(super) fn changes(&self) -> [i32; 2] {
        let [shear, normal] = self.newest();
        [
            change(shear, i32::midpoint(self.shear[4], self.shear[5])),
            change(normal, i32::midpoint(self.normal[4], self.normal[5])),
        ]
    }

    /// Whether the normal force has risen over the last two slots.
    pub(super) fn grip_rises(&self) -> bool {
        change(self.normal[0], self.normal[2]) > 2 * RISES_SHARE
    }

    /// Whether the shear has risen by less than a third as much as the normal force over the last two slots.
    pub(super) fn stays_while_the_grip_rises(&self) -> bool {
        let of_shear = change(self.shear[0], self.shear[2]);
        let of_normal = change(self.normal[0], self.normal[2]);
        of_normal > 2 * RISES_SHARE && 3 * of_shear < of_normal
    }

    /// By how much the shear has fallen over the last slots, share of the load in 1/1024.
    pub(super) fn recent_fall(&self, load: i32) -> i32 {
        let [now, recent @ ..] = self.shear;
        let before = recent[..3].iter().copied().max().unwrap_or(now);
        change(before - now + load, load)
    }

    /// Whether at least half of what the shear has fallen by over the last slots was in one of them, and not just noise.
    pub(super) fn have_fallen_suddenly(&self, load: i32) -> bool {
        let fall = self.shear.iter().copied().max().unwrap_or(0) - self.shear[0];
        let steps = self.shear.windows(2).map(|pair| pair[1] - pair[0]);
        let step = steps.max().unwrap_or(0);
        2 * step >= fall && step > part(load, SUDDEN_SHARE)
    }

    /// The newest change of the shear, beside the growth in which it takes part: a load that grows evenly does not fluctuate.
    pub(super) fn fluctuation(&self) -> i32 {
        let steps = self.shear[1..].windows(2).map(|pair| pair[0] - pair[1]);
        let growth = steps.min().unwrap_or(0).max(0);
        let rise = self.shear[0] - self.shear[1];
        if rise > 0 { rise - growth } else { rise }.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_is_the_mean_of_its_maps_and_lasts_as_long_as_they_do() {
        let mut slots = Slots::default();
        let mut ended = 0;
        for map in 0..40 {
            if let Some(passed_us) = slots.add(100 + map % 4, 1_000, 4_000) {
                assert_eq!(passed_us, 16_000);
                ended += 1;
            }
        }
        // Ten slots of four maps, of which the first says nothing.
        assert_eq!((ended, slots.newest()), (9, [101, 1_000]));
        // Maps without a time between them do not wait for ever.
        let ended = (0..SLOT_MAPS_MAX)
            .filter(|_| slots.add(0, 0, 0).is_some())
            .count();
        assert_eq!((ended, slots.normal[0]), (1, 1));
    }

    #[test]
    fn a_load_that_grows_evenly_does_not_fluctuate_and_what_it_grows_by_beyond_that_does() {
        let mut slots = Slots::default();
        let mut see = |shear: i32| {
            slots.add(shear, 1_000, 16_000);
            slots.fluctuation()
        };
        let even = (1..10).map(|slot| see(50 * slot)).last();
        assert_eq!((even, see(450 + 80), see(450 + 60)), (Some(0), 30, 20));
    }
}
