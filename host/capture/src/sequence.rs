//! Counts the pictures that a driver numbered and never delivered: pure.
//! The number counts the pictures since the camera was opened, modulo 2³².

/// Counts the gaps in a camera's sequence numbers.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sequence {
    last: Option<u32>,
}

/// A larger gap means that the driver started over, not that pictures were lost: ten hours at 60 a second.
const RESTART_GAP: u32 = 1 << 21;

impl Sequence {
    /// Takes the number of a picture that arrived. Returns how many before it are missing.
    pub(crate) const fn next(&mut self, number: u32) -> u64 {
        let missed = match self.last {
            // A number that repeats or goes back is of a driver that does not count.
            Some(last) => match number.wrapping_sub(last).wrapping_sub(1) {
                missed if missed < RESTART_GAP => missed as u64,
                _ => 0,
            },
            None => 0,
        };
        self.last = Some(number);
        missed
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_driver_that_always_says_zero_or_starts_over_loses_nothing() {
        let mut sequence = Sequence::default();
        assert_eq!([0, 0, 0].map(|number| sequence.next(number)), [0, 0, 0]);
        assert_eq!([7, 0, 1].map(|number| sequence.next(number)), [6, 0, 0]);
    }

    proptest! {
        #[test]
        fn received_and_missed_pictures_add_up_to_all(
            first in any::<u32>(),
            kept in prop::collection::vec(any::<bool>(), 1..200),
        ) {
            let mut sequence = Sequence::default();
            let came: Vec<u32> = (0..).zip(&kept).filter(|(_, kept)| **kept).map(|(n, _)| n).collect();
            let missed: u64 = came.iter().map(|n| sequence.next(first.wrapping_add(*n))).sum();
            if let (Some(first), Some(last)) = (came.first(), came.last()) {
                prop_assert_eq!(missed + came.len() as u64, u64::from(last - first + 1));
            }
        }
    }
}
