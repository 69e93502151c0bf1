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

    /// Of a fingertip that has sent no good map for long: it neither goes on with a test nor lets the line fall.
    pub(crate) const SILENT: Self = Self {
        urgency: Urgency::None,
        may_fall: false,
        finding: Finding::Open,
    };

    /// Of two fingertips that hold the same object.
    #[must_use]
    fn with(self, other: Self) -> Self {
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

/// The fingertips that have taken part in the test of late. What another one found before decides nothing about it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct JointTest {
    took_part: [bool; 2],
}

impl JointTest {
    /// The verdict of two fingertips that hold the same object.
    pub(crate) fn join(&mut self, verdicts: [Verdict; 2]) -> Verdict {
        let [one, other] = verdicts;
        let tests = one.tests() || other.tests();
        let of = |took_part: &mut bool, verdict: Verdict| {
            *took_part |= verdict.tests();
            let finding = if *took_part {
                verdict.finding
            } else {
                Finding::Held
            };
            // The findings of a test count once, when it ends.
            *took_part &= tests;
            Verdict { finding, ..verdict }
        };
        let [first, second] = &mut self.took_part;
        of(first, one).with(of(second, other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_fingertip_found_before_a_test_decides_nothing_about_it() {
        let verdict = |urgency: Urgency, finding: Finding| Verdict {
            urgency,
            may_fall: false,
            finding,
        };
        let slid = verdict(Urgency::None, Finding::Slid);
        let tests = verdict(Urgency::Tests, Finding::Held);
        let held = verdict(Urgency::None, Finding::Held);
        let mut joint = JointTest::default();
        assert!(joint.join([tests, slid]).tests());
        assert_eq!(joint.join([held, slid]).finding, Finding::Held);
        // Of those that take part the greater one counts, also when it has ended first.
        assert!(
            joint
                .join([tests, verdict(Urgency::Tests, Finding::Slid)])
                .tests()
        );
        assert!(joint.join([tests, slid]).tests());
        assert_eq!(joint.join([held, slid]).finding, Finding::Slid);
        assert_eq!(joint.join([held, slid]).finding, Finding::Held);
        // One that fell silent has found nothing.
        assert!(joint.join([tests, held]).tests());
        assert_eq!(joint.join([Verdict::SILENT, held]).finding, Finding::Open);
    }
}
