//! What the witnesses tell the grip.

/// How urgently the line must rise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Urgency {
    /// No suspicion is under test.
    None,
    /// One is: the line must be higher than before it.
    Tests,
    /// The normal force is less than the load would need if the suspicion is right. The shear falls little by little, as that of a load does
    /// that recedes.
    Short,
    /// The same; the shear fell suddenly, or is a first load's.
    SuddenlyShort,
    /// The shear follows the grip: the contact slides, and hides how great the load is.
    Follows,
}

/// What the last test found; of two fingertips, the greater one counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Finding {
    /// No slide.
    Held,
    /// Nothing: the load grew, or the grip did not.
    Open,
    /// A slide, or a load that came back.
    Slid,
}

/// What the witnesses of all fingertips demand of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Verdict {
    /// How urgently the line must rise.
    pub urgency: Urgency,
    /// Nothing speaks against a fall of the line.
    pub may_fall: bool,
    /// What the last test found.
    pub finding: Finding,
}

impl Verdict {
    /// Before the first map.
    pub(crate) const NONE: Self = Self {
        urgency: Urgency::None,
        may_fall: true,
        finding: Finding::Held,
    };

    /// Of two fingertips that hold the same object.
    #[must_use]
    pub(crate) fn with(self, other: Self) -> Self {
        Self {
            urgency: self.urgency.max(other.urgency),
            may_fall: self.may_fall && other.may_fall,
            finding: self.finding.max(other.finding),
        }
    }

    /// A suspicion is under test.
    #[must_use]
    pub(crate) fn tests(self) -> bool {
        self.urgency > Urgency::None
    }
}
