//! What the driver's sequence numbers say of pictures that never came: pure.
//! A number counts the pictures of one opening of the camera, modulo 2³².

/// Counts gaps between the sequence numbers of one opening.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sequence {
    last: Option<u32>,
}

/// A leap further than this is a driver that began anew, not pictures that were lost: ten hours at 60 a second.
const NEW_BEGINNING: u32 = 1 << 21;

impl Sequence {
    /// A picture with this number came. Returns how many before it did not.
    pub(crate) const fn came(&mut self, number: u32) -> u64 {
        let missed = match self.last {
            // The same number twice, or one that leads back, is a driver that does not count.
            Some(last) => match number.wrapping_sub(last).wrapping_sub(1) {
                missed if missed < NEW_BEGINNING => missed as u64,
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
    fn a_driver_that_always_says_zero_or_begins_anew_counts_nothing() {
        let mut sequence = Sequence::default();
        assert_eq!([0, 0, 0].map(|number| sequence.came(number)), [0, 0, 0]);
        assert_eq!([7, 0, 1].map(|number| sequence.came(number)), [6, 0, 0]);
    }

    proptest! {
        #[test]
        fn what_came_and_what_was_missed_are_all_there_were(
            first in any::<u32>(),
            kept in prop::collection::vec(any::<bool>(), 1..200),
        ) {
            let mut sequence = Sequence::default();
            let came: Vec<u32> = (0..).zip(&kept).filter(|(_, kept)| **kept).map(|(n, _)| n).collect();
            let missed: u64 = came.iter().map(|n| sequence.came(first.wrapping_add(*n))).sum();
            if let (Some(first), Some(last)) = (came.first(), came.last()) {
                prop_assert_eq!(missed + came.len() as u64, u64::from(last - first + 1));
            }
        }
    }
}
