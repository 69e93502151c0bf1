//! The host's evidence of motion: whether the object moves against the skin, as the camera sees it. It needs no friction.

/// Evidence of motion in a map's head: one byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motion(u8);

impl Motion {
    /// No evidence from the host.
    pub const UNKNOWN: Self = Self(0);
    /// Maximum of [`Motion::evidence`]: the object surely moves. 0: it surely does not.
    pub const EVIDENCE_MAX: u8 = 63;
    /// Maximum of [`Motion::quality`]: the picture shows it clearly. 0: nothing is known.
    pub const QUALITY_MAX: u8 = 3;

    /// Quality from which on a single picture is sufficient.
    const CLEAR: u8 = 2;

    /// Both are limited to their maximum; quality 0 is [`Motion::UNKNOWN`].
    #[must_use]
    pub const fn new(evidence: u8, quality: u8) -> Self {
        let evidence = if evidence > Self::EVIDENCE_MAX {
            Self::EVIDENCE_MAX
        } else {
            evidence
        };
        match quality {
            0 => Self::UNKNOWN,
            1 | 2 => Self(evidence | quality << 6),
            _ => Self(evidence | Self::QUALITY_MAX << 6),
        }
    }

    /// From the byte on the wire.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self::new(bits & Self::EVIDENCE_MAX, bits >> 6)
    }

    /// The byte on the wire: evidence in bits 0–5, quality in bits 6–7.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// How sure the host is that the object moves, 0 to [`Motion::EVIDENCE_MAX`].
    #[must_use]
    pub const fn evidence(self) -> u8 {
        self.0 & Self::EVIDENCE_MAX
    }

    /// The picture shows well that the object moves.
    #[must_use]
    pub const fn shows_motion(self) -> bool {
        self.quality() >= Self::CLEAR && self.evidence() >= Self::EVIDENCE_MAX / 4 * 3
    }

    /// The picture shows well that the object rests on the skin.
    #[must_use]
    pub const fn shows_rest(self) -> bool {
        self.quality() >= Self::CLEAR && self.evidence() <= Self::EVIDENCE_MAX / 4
    }

    /// How well the picture shows it, 0 to [`Motion::QUALITY_MAX`].
    #[must_use]
    pub const fn quality(self) -> u8 {
        self.0 >> 6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_reads_as_itself_but_for_evidence_without_quality() {
        for bits in 0..=u8::MAX {
            let motion = Motion::from_bits(bits);
            let expected = if bits < 64 { 0 } else { bits };
            assert_eq!(motion.bits(), expected);
            assert_eq!(Motion::new(motion.evidence(), motion.quality()), motion);
        }
    }

    #[test]
    fn only_a_clear_picture_shows_motion_or_rest_and_never_both() {
        for bits in 0..=u8::MAX {
            let motion = Motion::from_bits(bits);
            assert!(!(motion.shows_motion() && motion.shows_rest()));
            assert!(motion.quality() >= 2 || !(motion.shows_motion() || motion.shows_rest()));
        }
        assert!(Motion::new(63, 3).shows_motion() && Motion::new(0, 3).shows_rest());
    }

    #[test]
    fn too_much_is_limited_to_the_maximum() {
        assert_eq!(Motion::new(200, 9), Motion::new(63, 3));
        assert_eq!(Motion::new(200, 0), Motion::UNKNOWN);
    }
}
