//! The shadow check: the host computes the expected answer to every map with the microcontroller's own code, and compares. A
//! difference means a broken wire format, a broken build or broken hardware. Limits: remembers the last 32 maps of each fingertip.

use gripline_firmware::sums::{TaxelRule, sums_of};
use gripline_protocol::message::{MapSums, Status};
use gripline_protocol::{ForceMap, SENSORS, SensorId};

const REMEMBERED: usize = 32;

/// The detector's sums of a map, and the rule that they follow: computed once and shared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judgement {
    /// The detector's rule.
    pub rule: TaxelRule,
    /// Its sums.
    pub sums: MapSums,
}

impl Judgement {
    /// Judges a map.
    #[must_use]
    pub fn of(map: &ForceMap, rule: TaxelRule) -> Self {
        Self {
            rule,
            sums: sums_of(map, rule),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Expected {
    sequence: u32,
    sums: MapSums,
    coulomb_slip: bool,
}

/// The expected answers to maps in transit.
#[derive(Debug)]
pub struct Shadow {
    rule: TaxelRule,
    expected: [[Option<Expected>; REMEMBERED]; SENSORS],
    checked: [u64; SENSORS],
    mismatches: [u64; SENSORS],
}

impl Shadow {
    /// `rule` is that of the microcontroller's configuration.
    #[must_use]
    pub fn new(rule: TaxelRule) -> Self {
        Self {
            rule,
            expected: [[None; REMEMBERED]; SENSORS],
            checked: [0; SENSORS],
            mismatches: [0; SENSORS],
        }
    }

    /// Uses `rule` from now on; maps in transit are forgotten, counters stay.
    pub fn judge_by(&mut self, rule: TaxelRule) {
        *self = Self {
            checked: self.checked,
            mismatches: self.mismatches,
            ..Self::new(rule)
        };
    }

    /// The rule in use.
    #[must_use]
    pub const fn rule(&self) -> TaxelRule {
        self.rule
    }

    /// A map is sent, judged by the rule in use.
    pub fn sent(&mut self, sensor: SensorId, sequence: u32, sums: MapSums) {
        let [x, y, normal] = sums.force;
        let coulomb_slip = self.rule.friction.exceeded_by([x, y], normal);
        self.expected[sensor.index()][sequence as usize % REMEMBERED] = Some(Expected {
            sequence,
            sums,
            coulomb_slip,
        });
    }

    /// An answer came: `Some(true)` when it is right, `None` when it belongs to no map that is remembered.
    pub fn answered(&mut self, status: &Status) -> Option<bool> {
        let sensor = status.sensor.index();
        let expected = self.expected[sensor][status.sequence as usize % REMEMBERED]
            .filter(|map| map.sequence == status.sequence)?;
        let right = (expected.sums, expected.coulomb_slip) == (status.sums, status.coulomb_slip);
        self.checked[sensor] += 1;
        self.mismatches[sensor] += u64::from(!right);
        Some(right)
    }

    /// Answers compared so far.
    #[must_use]
    pub fn checked(&self) -> u64 {
        self.checked.iter().sum()
    }

    /// Answers that were wrong.
    #[must_use]
    pub fn mismatches(&self) -> u64 {
        self.mismatches.iter().sum()
    }

    /// Answers about fingertip `sensor`'s maps that were compared, and how many of them were wrong.
    #[must_use]
    pub const fn of(&self, sensor: SensorId) -> [u64; 2] {
        [self.checked[sensor.index()], self.mismatches[sensor.index()]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_firmware::Friction;
    use gripline_protocol::TaxelForce;

    #[test]
    fn one_taxel_judged_otherwise_is_a_mismatch() {
        let rule = TaxelRule {
            friction: Friction::clamped(4_500),
            contact_min: 0,
        };
        let mut map = ForceMap::EMPTY;
        map.taxels[7] = TaxelForce { x: 9, y: 0, z: 20 };
        let mut shadow = Shadow::new(rule);
        shadow.sent(SensorId::FIRST, 5, sums_of(&map, rule));
        let right = Status {
            sequence: 5,
            sums: sums_of(&map, rule),
            ..Status::default()
        };
        assert_eq!(shadow.answered(&right), Some(true));
        let mut wrong = right;
        wrong.sums.stick = 0;
        assert_eq!(shadow.answered(&wrong), Some(false));
        assert_eq!(shadow.answered(&Status { sequence: 6, ..right }), None);
        assert_eq!((shadow.checked(), shadow.mismatches()), (2, 1));
    }
}
