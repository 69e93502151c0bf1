//! What speaks for a slide, and what a test of it has seen so far. Units: force 1/4096 N, ratios of shear to normal force and frictions
//! 1/10000, time µs.

/// No limit of the friction is known.
pub(super) const UNLIMITED: u16 = u16::MAX;

/// What speaks for a slide.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Suspicion {
    None,
    /// The shear has fallen, suddenly or with the grip.
    Falling,
    /// It has settled below the detector's friction.
    Settled,
    /// The host sees the object move.
    Seen,
}

/// A suspicion under test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Test {
    /// Shear and normal force when it began.
    pub(super) shear: i32,
    pub(super) normal: i32,
    /// Since it began.
    pub(super) for_us: u32,
    /// The limit before it, and the highest ratio carried.
    pub(super) limit: u16,
    pub(super) carried: u16,
    /// Friction that the contact has proven, which such a slide would not take away without being confirmed.
    pub(super) proven: u16,
    /// It is about a load that had settled.
    pub(super) is_first: bool,
    /// The most that the contact has carried since, shear over normal force, 1/10000.
    pub(super) highest: u16,
    /// The shear had fallen suddenly when it began.
    pub(super) is_sudden: bool,
    /// The load if it had done so in a quiet hold, under a grip that had not risen, otherwise 0: another finger may have taken over a part.
    pub(super) fell_from: i32,
    /// Slots in a row in which the shear has risen as much as the normal force.
    pub(super) followed: u8,
    /// Slots in a row in which the shear has hardly risen.
    pub(super) stayed: u8,
    /// It did so for long enough: the contact slides.
    pub(super) is_confirmed: bool,
}

impl Test {
    /// It is about a load that had settled on a contact that has never slid.
    pub(super) const fn is_new(&self) -> bool {
        self.is_first && self.limit == UNLIMITED
    }
}

/// How a test ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// It says whether the contact slid.
    Judged,
    /// It says nothing: the load has grown, or the grip has not.
    Open,
}
