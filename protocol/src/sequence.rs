//! Which maps are new. Sequence numbers are u32 and wrap; a map is new when it is less than half the range ahead of the last
//! accepted one. Limits: a sender that restarts from 0 needs a new handshake.

/// What a sequence number means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Order {
    /// New; `lost` maps before it never came.
    New {
        /// Maps between the last accepted one and this one.
        lost: u32,
    },
    /// Seen before, or older than the last accepted one: a doubled, replayed or reordered map.
    Old,
}

/// The last accepted sequence number of one sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceTracker {
    last: Option<u32>,
}

impl SequenceTracker {
    /// Before the first map: any number is new.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None }
    }

    /// Checks a sequence number without accepting it.
    #[must_use]
    pub const fn check(&self, sequence: u32) -> Order {
        match self.last {
            None => Order::New { lost: 0 },
            Some(last) => match sequence.wrapping_sub(last) {
                ahead @ 1..=0x7FFF_FFFF => Order::New { lost: ahead - 1 },
                _ => Order::Old,
            },
        }
    }

    /// Accepts the number as the last one.
    pub const fn accept(&mut self, sequence: u32) {
        self.last = Some(sequence);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_map_is_new_whatever_its_number() {
        assert_eq!(SequenceTracker::new().check(u32::MAX), Order::New { lost: 0 });
    }

    #[test]
    fn the_next_number_is_new_across_the_wrap_and_the_same_one_is_old() {
        let mut tracker = SequenceTracker::new();
        tracker.accept(u32::MAX);
        assert_eq!(tracker.check(0), Order::New { lost: 0 });
        assert_eq!(tracker.check(2), Order::New { lost: 2 });
        assert_eq!(tracker.check(u32::MAX), Order::Old);
        assert_eq!(tracker.check(u32::MAX - 1), Order::Old);
        assert_eq!(tracker.check(0x8000_0000 - 2), Order::New { lost: 0x7FFF_FFFE });
        assert_eq!(tracker.check(0x8000_0000 - 1), Order::Old);
    }
}
