//! What each setting may be: by itself, and beside the others.

use core::fmt;

use super::settings::{Configuration, FORCE_MAX};
use super::values::{CONFIGURATION_VALUES, CONTROL_VALUES, FINGERTIP_VALUES, LINE_VALUES};
use crate::constants::{PER_UNIT, SENSORS, SIDE};
use crate::line::LineSettings;

/// A setting out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange {
    /// Index into [`Configuration::FIELDS`].
    pub field: u8,
    /// The value found, in the field's unit.
    pub found: i32,
    /// Minimum value allowed.
    pub min: i32,
    /// Maximum value allowed.
    pub max: i32,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Configuration::FIELDS
            .get(usize::from(self.field))
            .copied()
            .unwrap_or("unknown setting");
        write!(
            f,
            "{name}: found {}, expected {} to {}",
            self.found, self.min, self.max
        )
    }
}

impl core::error::Error for OutOfRange {}

/// Taxels from a map's centre to its edge.
const HALF_SIDE: i32 = SIDE as i32 / 2;
/// Places in [`Values`] of settings that limit others.
mod at {
    pub(super) const SLIP_LEAVE: usize = 5;
    pub(super) const INCIPIENT_THRESHOLD: usize = 6;
    pub(super) const FLOOR: usize = 10;
    pub(super) const CEILING: usize = 11;
    pub(super) const FAIL_SAFE: usize = 12;
    pub(super) const REFLEX_TARGET: usize = 13;
    pub(super) const REFLEX_RATE: usize = 14;
    pub(super) const LINK_LOST_MS: usize = 20;
    pub(super) const LINE: usize = super::CONTROL_VALUES + 1;
    /// The centre of the second fingertip, x; y comes next.
    pub(super) const OTHER_CENTRE: usize =
        super::CONTROL_VALUES + super::LINE_VALUES + super::FINGERTIP_VALUES + 1;
}

const U16: (i32, i32) = (0, u16::MAX as i32);
const I16: (i32, i32) = (i16::MIN as i32, i16::MAX as i32);
const PART: (i32, i32) = (0, PER_UNIT as i32);
/// Limits of a fingertip: a taxel is 0.1 to 10 mm wide, the centre lies anywhere, four quarter turns are none.
const FINGERTIP: [(i32, i32); FINGERTIP_VALUES] = [(100, 10_000), I16, I16, (0, 3)];

/// (min, max) of every value by itself.
static LIMITS: [(i32, i32); CONFIGURATION_VALUES] = {
    let mut limits = [(0, 0); CONFIGURATION_VALUES];
    let control: [(i32, i32); CONTROL_VALUES] = [
        (1, SENSORS as i32),
        (0, 2 * PER_UNIT as i32),
        (0, 2 * PER_UNIT as i32),
        (0, i16::MAX as i32),
        PART,
        PART,
        PART,
        (0, 5_000),
        (0, 5_000),
        (0, 4 * PER_UNIT as i32),
        (0, FORCE_MAX),
        (1, FORCE_MAX),
        (0, FORCE_MAX),
        PART,
        U16,
        (1, U16.1),
        U16,
        U16,
        (1, U16.1),
        (2, U16.1),
        (2, U16.1),
    ];
    let mut place = 0;
    while place < CONTROL_VALUES {
        limits[place] = control[place];
        place += 1;
    }
    limits[place] = (0, 1); // the kind of line; its other limits follow from each other
    place += LINE_VALUES;
    while place < CONFIGURATION_VALUES {
        limits[place] = FINGERTIP[(place - CONTROL_VALUES - LINE_VALUES) % FINGERTIP_VALUES];
        place += 1;
    }
    limits
};

impl Configuration {
    /// Names of the settings, in the order of [`OutOfRange::field`].
    pub const FIELDS: [&'static str; CONFIGURATION_VALUES] = {
        let control: [&str; CONTROL_VALUES] = [
            "sensors",
            "friction",
            "friction_max",
            "contact_min",
            "slip_threshold",
            "slip_leave",
            "incipient_threshold",
            "incipient_horizon_ms",
            "dwell_ms",
            "margin",
            "floor",
            "ceiling",
            "fail_safe",
            "reflex_target",
            "reflex_rate",
            "rise_rate",
            "relax_rate",
            "relax_after_ms",
            "release_rate",
            "stale_ms",
            "link_lost_ms",
        ];
        let fingertips: [&str; FINGERTIP_VALUES * SENSORS] = [
            "fingertips[0].pitch_um",
            "fingertips[0].centre_um[0]",
            "fingertips[0].centre_um[1]",
            "fingertips[0].quarter_turns",
            "fingertips[1].pitch_um",
            "fingertips[1].centre_um[0]",
            "fingertips[1].centre_um[1]",
            "fingertips[1].quarter_turns",
        ];
        let mut names = [""; CONFIGURATION_VALUES];
        let mut place = 0;
        while place < CONFIGURATION_VALUES {
            names[place] = if place < CONTROL_VALUES {
                control[place]
            } else if place == CONTROL_VALUES {
                "line.kind"
            } else if place < CONTROL_VALUES + LINE_VALUES {
                LineSettings::FIELDS[place - CONTROL_VALUES - 1]
            } else {
                fingertips[place - CONTROL_VALUES - LINE_VALUES]
            };
            place += 1;
        }
        names
    };

    /// Checks every setting and every pair that belongs together.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first setting out of its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        self.check_on(&self.line)
    }

    /// The same for settings that come while `in_force` drives the gripper: that line stays until the next start, so
    /// until then it must be able to show the ceiling too.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first setting out of its range.
    #[inline(never)]
    pub fn check_on(&self, in_force: &LineSettings) -> Result<(), OutOfRange> {
        let mut limits = LIMITS;
        let threshold = i32::from(self.slip_threshold);
        limits[at::SLIP_LEAVE].0 = threshold;
        limits[at::INCIPIENT_THRESHOLD].0 = threshold;
        limits[at::REFLEX_TARGET].0 = threshold;
        let [line_min, line_max] = self.line.force_range();
        // A gripper that cannot grip as gently as the floor would squeeze more than was decided, and one that cannot
        // reach the ceiling less.
        limits[at::FLOOR] = (line_min, self.ceiling);
        limits[at::CEILING].1 = line_max.min(in_force.force_range()[1]).clamp(1, FORCE_MAX);
        limits[at::FAIL_SAFE] = (self.floor, self.ceiling);
        // A reflex faster than the line may rise would run ahead of it.
        limits[at::REFLEX_RATE].1 = self.rise_rate.into();
        // A lost link has been silent for longer than stale maps.
        limits[at::LINK_LOST_MS].0 = self.stale_ms.into();
        for (limit, (_, min, max)) in limits[at::LINE..].iter_mut().zip(self.line.ranges(FORCE_MAX)) {
            *limit = (min, max);
        }
        if usize::from(self.sensors) == SENSORS {
            let [one, other] = &self.fingertips;
            // Two maps that share no place, seen along the grip, cannot hold one object.
            let reach = HALF_SIDE * (i32::from(one.pitch_um) + i32::from(other.pitch_um)) - 1;
            let centres = &mut limits[at::OTHER_CENTRE..];
            for (limit, &centre) in centres.iter_mut().zip(&one.centre_um) {
                let centre = i32::from(centre);
                *limit = ((centre - reach).max(limit.0), (centre + reach).min(limit.1));
            }
        }
        for (field, (found, (min, max))) in self.values().into_iter().zip(limits).enumerate() {
            if found < min || found > max {
                return Err(OutOfRange {
                    field: field as u8,
                    found,
                    min,
                    max,
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::super::settings::{FingertipGeometry, newtons};
    use super::*;
    use crate::line::LineKind;

    fn refusal(change: impl FnOnce(&mut Configuration)) -> std::string::String {
        let mut settings = Configuration::DEFAULT;
        change(&mut settings);
        settings
            .check()
            .expect_err("the setting was to be refused")
            .to_string()
    }

    #[test]
    fn the_default_settings_are_in_range() {
        assert_eq!(Configuration::DEFAULT.check(), Ok(()));
    }

    #[test]
    fn a_gripper_on_the_bus_may_be_asked_for_all_it_can_and_the_analog_table_limits_it_no_more() {
        let mut settings = Configuration::DEFAULT;
        settings.line.kind = LineKind::Robotiq2f140;
        (settings.floor, settings.ceiling) = (newtons(10), newtons(125));
        assert_eq!(settings.check(), Ok(()));
        // Until the next start the analog line drives the gripper, which reaches 40 N only.
        let error = settings.check_on(&LineSettings::DEFAULT).unwrap_err();
        assert_eq!(error.to_string(), "ceiling: found 512000, expected 1 to 163840");
        settings.ceiling = newtons(40);
        assert_eq!(settings.check_on(&LineSettings::DEFAULT), Ok(()));
    }

    #[test]
    fn a_fingertip_that_sends_no_maps_may_sit_anywhere() {
        let mut settings = Configuration::DEFAULT;
        settings.fingertips[1].centre_um = [i16::MAX, i16::MIN];
        assert_eq!(settings.check(), Ok(()));
        settings.sensors = 2;
        assert!(settings.check().is_err());
        settings.fingertips[0].centre_um = [i16::MAX, i16::MIN];
        assert_eq!(settings.check(), Ok(()));
    }

    #[test]
    fn settings_are_the_same_after_the_way_through_their_values() {
        let mut settings = Configuration::DEFAULT;
        settings.sensors = 2;
        settings.contact_min = -7;
        settings.fail_safe = i32::MIN;
        settings.link_lost_ms = u16::MAX;
        settings.line.kind = LineKind::Robotiq2f140;
        settings.line.points[2].code = 1_777;
        settings.fingertips[1] = FingertipGeometry {
            pitch_um: 1_500,
            centre_um: [-4, 9],
            quarter_turns: 3,
        };
        assert_eq!(Configuration::from_values(&settings.values()), Some(settings));
        for (place, name) in Configuration::FIELDS.iter().enumerate() {
            let mut values = settings.values();
            values[place] = 1 << 20;
            let fits = name.contains("force") || ["floor", "ceiling", "fail_safe"].contains(name);
            assert_eq!(Configuration::from_values(&values).is_some(), fits, "{name}");
        }
    }

    #[test]
    fn every_setting_has_a_name_of_its_own() {
        let mut names = Configuration::FIELDS;
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(!names[0].is_empty());
    }

    #[test]
    fn a_refusal_names_the_setting_what_was_found_and_what_was_expected() {
        let cases = [
            (refusal(|s| s.sensors = 3), "sensors: found 3, expected 1 to 2"),
            (
                refusal(|s| s.friction = 20_001),
                "friction: found 20001, expected 0 to 20000",
            ),
            (
                refusal(|s| s.contact_min = -1),
                "contact_min: found -1, expected 0 to 32767",
            ),
            (
                refusal(|s| s.slip_leave = 4_999),
                "slip_leave: found 4999, expected 5000 to 10000",
            ),
            (
                refusal(|s| s.floor = s.ceiling + 1),
                "floor: found 122881, expected 0 to 122880",
            ),
            (
                refusal(|s| s.ceiling = s.line.points[4].force + 1),
                "ceiling: found 163841, expected 1 to 163840",
            ),
            (
                refusal(|s| {
                    s.line.kind = LineKind::Robotiq2f140;
                    s.floor = newtons(10);
                    s.ceiling = newtons(125) + 1;
                }),
                "ceiling: found 512001, expected 1 to 512000",
            ),
            (
                refusal(|s| s.line.kind = LineKind::Robotiq2f140),
                "floor: found 4096, expected 40960 to 122880",
            ),
            (
                refusal(|s| {
                    s.sensors = 2;
                    s.fingertips[0].centre_um = [-30_000, 0];
                    s.fingertips[1].centre_um = [2_000, 0];
                }),
                "fingertips[1].centre_um[0]: found 2000, expected -32768 to 1999",
            ),
            (
                refusal(|s| {
                    s.sensors = 2;
                    s.fingertips[1].pitch_um = 800;
                    s.fingertips[1].centre_um[1] = -24_000;
                }),
                "fingertips[1].centre_um[1]: found -24000, expected -23999 to 23999",
            ),
            (
                refusal(|s| s.fail_safe = s.floor - 1),
                "fail_safe: found 4095, expected 4096 to 122880",
            ),
            (
                refusal(|s| s.reflex_rate = s.rise_rate + 1),
                "reflex_rate: found 411, expected 0 to 410",
            ),
            (
                refusal(|s| s.link_lost_ms = s.stale_ms - 1),
                "link_lost_ms: found 99, expected 100 to 65535",
            ),
            (
                refusal(|s| s.line.points[0].code = 204),
                "line.points[0].code: found 204, expected 205 to 4095",
            ),
            (
                refusal(|s| s.line.points[3].code = s.line.points[2].code),
                "line.points[3].code: found 2457, expected 2458 to 4095",
            ),
            (
                refusal(|s| s.fingertips[1].quarter_turns = 4),
                "fingertips[1].quarter_turns: found 4, expected 0 to 3",
            ),
            (
                refusal(|s| s.fingertips[0].pitch_um = 99),
                "fingertips[0].pitch_um: found 99, expected 100 to 10000",
            ),
        ];
        for (found, expected) in cases {
            assert_eq!(found, expected);
        }
    }
}
