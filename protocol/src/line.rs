//! Settings of the grip-force line: which one it is, and what its voltage means.
//! Units: force 1/4096 N, codes of a 12-bit DAC. Limits: five points; between them the line is straight.

use postcard_schema::Schema;

use crate::constants::LSB_PER_NEWTON;

/// Which line drives the gripper. The analog line always shows the force too, so one can watch it beside a bus gripper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LineKind {
    /// A voltage with a live zero, for grippers with an analog force input.
    #[default]
    Analog,
    /// A Robotiq 2F-140 over Modbus RTU on RS-485.
    Robotiq2f140,
}

/// A calibration point: the gripper grips with this force at this code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinePoint {
    /// Grip force, 1/4096 N.
    pub force: i32,
    /// DAC code.
    pub code: u16,
}

/// Points of the calibration table.
pub const LINE_POINTS: usize = 5;
/// Minimum code for no force, 5 % of the scale: a lower one looks like a broken wire.
pub const LIVE_ZERO_MIN: u16 = 205;
/// Minimum and maximum grip force of a Robotiq 2F-140, newtons (its manual, section 6, specifications).
pub const ROBOTIQ_FORCE_N: [i32; 2] = [10, 125];
/// How many numbers the line's settings are: its kind, then what [`LineSettings::FIELDS`] names.
pub const LINE_VALUES: usize = 1 + LineSettings::FIELDS.len();
/// Largest code of a 12-bit DAC.
pub const DAC_CODE_MAX: u16 = 4_095;

/// The line's settings. They take effect at the microcontroller's start only, and only when nothing is held then: with an object in
/// the gripper, the same force must not become another voltage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineSettings {
    /// Which line.
    pub kind: LineKind,
    /// The calibration table, ascending; the first point is 0 N, the last one full scale.
    pub points: [LinePoint; LINE_POINTS],
}

impl LineSettings {
    /// Names of what [`Self::ranges`] checks, in its order.
    pub const FIELDS: [&'static str; 2 * LINE_POINTS] = [
        "line.points[0].force",
        "line.points[0].code",
        "line.points[1].force",
        "line.points[1].code",
        "line.points[2].force",
        "line.points[2].code",
        "line.points[3].force",
        "line.points[3].code",
        "line.points[4].force",
        "line.points[4].code",
    ];

    /// 2 to 10 V after the op-amp (codes 819 to 4095) for 0 to 40 N, in a straight line.
    pub const DEFAULT: Self = {
        const fn point(quarter: i32) -> LinePoint {
            LinePoint {
                force: 10 * quarter * LSB_PER_NEWTON,
                code: 819 * (1 + quarter as u16),
            }
        }
        Self {
            kind: LineKind::Analog,
            points: [point(0), point(1), point(2), point(3), point(4)],
        }
    };

    /// The settings as a list of numbers.
    #[must_use]
    pub fn values(&self) -> [i32; LINE_VALUES] {
        let mut values = [0; LINE_VALUES];
        let [kind, table @ ..] = &mut values;
        *kind = self.kind as i32;
        for (pair, point) in table.chunks_exact_mut(2).zip(&self.points) {
            pair[0] = point.force;
            pair[1] = point.code.into();
        }
        values
    }

    /// The settings that a list of numbers stands for. One that does not fit its place is cut off: compare [`Self::values`].
    #[must_use]
    pub fn from_values(values: &[i32; LINE_VALUES]) -> Self {
        let [kind, table @ ..] = values;
        let mut line = Self::DEFAULT;
        if *kind == LineKind::Robotiq2f140 as i32 {
            line.kind = LineKind::Robotiq2f140;
        }
        for (point, pair) in line.points.iter_mut().zip(table.chunks_exact(2)) {
            *point = LinePoint {
                force: pair[0],
                code: pair[1] as u16,
            };
        }
        line
    }

    /// Minimum and maximum force of the line, 1/4096 N. Below the minimum there is only 0.
    #[must_use]
    pub const fn force_range(&self) -> [i32; 2] {
        match self.kind {
            LineKind::Analog => [0, self.points[LINE_POINTS - 1].force],
            LineKind::Robotiq2f140 => {
                let [min, max] = ROBOTIQ_FORCE_N;
                [min * LSB_PER_NEWTON, max * LSB_PER_NEWTON]
            }
        }
    }

    /// (found, min, max) of every setting. The table starts at 0 N with a live zero and rises from point to point, so more
    /// force is never a lower code.
    #[must_use]
    pub fn ranges(&self, force_max: i32) -> [(i32, i32, i32); 2 * LINE_POINTS] {
        let code_max = i32::from(DAC_CODE_MAX);
        let mut ranges = [(0, 0, 0); 2 * LINE_POINTS];
        let mut min = (0, i32::from(LIVE_ZERO_MIN));
        for (place, point) in ranges.chunks_exact_mut(2).zip(&self.points) {
            let max = if min.0 == 0 { 0 } else { force_max };
            place[0] = (point.force, min.0, max);
            place[1] = (point.code.into(), min.1, code_max);
            min = (point.force.saturating_add(1), i32::from(point.code) + 1);
        }
        ranges
    }
}

impl Default for LineSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORCE_MAX: i32 = 125 * LSB_PER_NEWTON;

    fn wrong(settings: &LineSettings) -> Option<&'static str> {
        let ranges = settings.ranges(FORCE_MAX);
        let place = ranges
            .iter()
            .position(|(found, min, max)| found < min || found > max);
        place.map(|place| LineSettings::FIELDS[place])
    }

    #[test]
    fn the_default_is_a_straight_line_with_a_live_zero_and_in_range() {
        assert_eq!(wrong(&LineSettings::DEFAULT), None);
        assert_eq!(LineSettings::DEFAULT.points[0], LinePoint { force: 0, code: 819 });
        let full = LineSettings::DEFAULT.points[LINE_POINTS - 1];
        assert_eq!((full.force, full.code), (40 * LSB_PER_NEWTON, DAC_CODE_MAX));
    }

    #[test]
    fn the_force_range_is_that_of_the_line_which_is_chosen() {
        let mut line = LineSettings::DEFAULT;
        assert_eq!(line.force_range(), [0, 40 * LSB_PER_NEWTON]);
        line.kind = LineKind::Robotiq2f140;
        assert_eq!(line.force_range(), [10 * LSB_PER_NEWTON, FORCE_MAX]);
    }

    #[test]
    fn a_table_that_does_not_rise_or_has_no_live_zero_is_named() {
        let with = |change: fn(&mut LineSettings)| {
            let mut settings = LineSettings::DEFAULT;
            change(&mut settings);
            wrong(&settings)
        };
        assert_eq!(
            with(|line| line.points[0].force = 1),
            Some("line.points[0].force")
        );
        assert_eq!(
            with(|line| line.points[0].code = 204),
            Some("line.points[0].code")
        );
        assert_eq!(
            with(|line| line.points[2].force = 10 * LSB_PER_NEWTON),
            Some("line.points[2].force")
        );
        assert_eq!(
            with(|line| line.points[2].code = 1_638),
            Some("line.points[2].code")
        );
        assert_eq!(
            with(|line| line.points[4].code = 4_096),
            Some("line.points[4].code")
        );
        assert_eq!(
            with(|line| line.points[4].force = FORCE_MAX + 1),
            Some("line.points[4].force")
        );
        assert_eq!(
            with(|line| line.points[3].force = i32::MAX),
            Some("line.points[3].force")
        );
    }
}
