//! Everything that can be set on the microcontroller, and what each setting may be: by itself and beside the others.
//! Units: forces 1/4096 N, ratios and friction 1/10000, times and lengths as named. It travels in
//! [`crate::message::Command::Configure`] and lies in the microcontroller's flash.

use core::fmt;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::constants::{LSB_PER_NEWTON, PER_UNIT, SENSORS};
use crate::line::{LINE_POINTS, LineSettings};

/// Version of [`Configuration`]'s layout as it lies in flash; raised with every change of it or of its parts.
pub const CONFIGURATION_VERSION: u16 = 1;

/// A setting out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange {
    /// Index into [`Configuration::FIELDS`].
    pub field: u8,
    /// The value found, in the field's unit.
    pub found: i32,
    /// Least value allowed.
    pub least: i32,
    /// Greatest value allowed.
    pub most: i32,
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
            self.found, self.least, self.most
        )
    }
}

impl core::error::Error for OutOfRange {}

/// How a fingertip sits in the gripper. The detector needs none of it; the host turns moments and places into the
/// gripper's frame with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FingertipGeometry {
    /// Distance between taxel centres, µm.
    pub pitch_um: u16,
    /// The map's centre from the gripper's axis, x and y, µm.
    pub centre_um: [i16; 2],
    /// Quarter turns from the gripper's x to the map's x, anticlockwise as seen from outside the fingertip.
    pub quarter_turns: u8,
}

impl FingertipGeometry {
    /// 1.6 mm between taxels, on the axis, not turned.
    pub const DEFAULT: Self = Self {
        pitch_um: 1_600,
        centre_um: [0, 0],
        quarter_turns: 0,
    };
}

impl Default for FingertipGeometry {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Everything that can be set on the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Configuration {
    /// Fingertips that must send maps: 1 or 2.
    pub sensors: u8,
    /// Friction coefficient of the detector, 1/10000: must lie below the skin's true one.
    pub friction: u16,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N.
    pub contact_min: i16,
    /// Stick ratio below which the state is SLIP, 1/10000.
    pub slip_threshold: u16,
    /// Stick ratio at and above which SLIP may end, 1/10000.
    pub slip_leave: u16,
    /// Stick ratio below which the state is INCIPIENT, 1/10000.
    pub incipient_threshold: u16,
    /// Time-to-slip estimate below which the state is INCIPIENT, ms.
    pub incipient_horizon_ms: u16,
    /// Least time in SLIP and INCIPIENT, ms.
    pub dwell_ms: u16,
    /// Grip above what friction needs, 1/10000 of it; people keep 10–40 %.
    pub margin: u16,
    /// Least grip force while holding, 1/4096 N.
    pub floor: i32,
    /// Greatest grip force, 1/4096 N.
    pub ceiling: i32,
    /// Grip force that a lost host or a hung task leads to, unless it is higher already, 1/4096 N.
    pub tighten: i32,
    /// Stick ratio that the reflex keeps the contact above, 1/10000.
    pub reflex_target: u16,
    /// How fast the reflex adds grip when nothing sticks, 1/4096 N per ms.
    pub reflex_rate: u16,
    /// Fastest rise of the line, 1/4096 N per ms.
    pub rise_rate: u16,
    /// Fall of the line while relaxing by plan, 1/4096 N per second; 0 never relaxes.
    pub relax_rate: u16,
    /// How long the contact must stick before the line relaxes, ms.
    pub relax_after_ms: u16,
    /// Fall of the line after `Release`, 1/4096 N per ms.
    pub release_rate: u16,
    /// Age of the newest map that raises STALE MAPS, ms.
    pub stale_ms: u16,
    /// Silence on the link that raises LINK LOST, ms.
    pub link_lost_ms: u16,
    /// The grip-force line. Taken at the microcontroller's start, so stored first: under way the same force must not
    /// become another voltage.
    pub line: LineSettings,
    /// How each fingertip sits in the gripper.
    pub fingertips: [FingertipGeometry; SENSORS],
}

const fn newtons(value: i32) -> i32 {
    value * LSB_PER_NEWTON
}

/// The strongest gripper that is supported, 1/4096 N.
const FORCE_MAX: i32 = newtons(125);

/// Settings that are numbers of the controller, of the line, and of one fingertip.
const CONTROL_FIELDS: usize = 20;
const LINE_FIELDS: usize = LineSettings::FIELDS.len();
const FINGERTIP_FIELDS: usize = 4;
const FIELD_COUNT: usize = CONTROL_FIELDS + LINE_FIELDS + FINGERTIP_FIELDS * SENSORS;

/// (found, least, most).
type Range = (i32, i32, i32);

impl Configuration {
    /// Names of the settings, in the order of [`OutOfRange::field`].
    pub const FIELDS: [&'static str; FIELD_COUNT] = {
        let control: [&str; CONTROL_FIELDS] = [
            "sensors",
            "friction",
            "contact_min",
            "slip_threshold",
            "slip_leave",
            "incipient_threshold",
            "incipient_horizon_ms",
            "dwell_ms",
            "margin",
            "floor",
            "ceiling",
            "tighten",
            "reflex_target",
            "reflex_rate",
            "rise_rate",
            "relax_rate",
            "relax_after_ms",
            "release_rate",
            "stale_ms",
            "link_lost_ms",
        ];
        let fingertips: [&str; FINGERTIP_FIELDS * SENSORS] = [
            "fingertips[0].pitch_um",
            "fingertips[0].centre_um[0]",
            "fingertips[0].centre_um[1]",
            "fingertips[0].quarter_turns",
            "fingertips[1].pitch_um",
            "fingertips[1].centre_um[0]",
            "fingertips[1].centre_um[1]",
            "fingertips[1].quarter_turns",
        ];
        let mut names = [""; FIELD_COUNT];
        let mut place = 0;
        while place < FIELD_COUNT {
            names[place] = if place < CONTROL_FIELDS {
                control[place]
            } else if place < CONTROL_FIELDS + LINE_FIELDS {
                LineSettings::FIELDS[place - CONTROL_FIELDS]
            } else {
                fingertips[place - CONTROL_FIELDS - LINE_FIELDS]
            };
            place += 1;
        }
        names
    };

    /// The paper's detector (μ 0.45, threshold 0.5) and a careful gripper.
    pub const DEFAULT: Self = Self {
        sensors: 1,
        friction: 4_500,
        contact_min: 0,
        slip_threshold: 5_000,
        slip_leave: 6_000,
        incipient_threshold: 6_500,
        incipient_horizon_ms: 100,
        dwell_ms: 50,
        margin: 4_000,
        floor: newtons(1),
        ceiling: newtons(30),
        tighten: newtons(10),
        reflex_target: 5_500,
        reflex_rate: 164,  // 40 N/s
        rise_rate: 410,    // 100 N/s
        relax_rate: 4_096, // 1 N/s
        relax_after_ms: 500,
        release_rate: 82, // 20 N/s
        stale_ms: 100,
        link_lost_ms: 500,
        line: LineSettings::DEFAULT,
        fingertips: [FingertipGeometry::DEFAULT; SENSORS],
    };

    /// Checks every setting and every pair that belongs together.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first setting out of its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let line = self.line.ranges(FORCE_MAX);
        let [first, second] = self.fingertips.map(fingertip_ranges);
        let parts: [&[Range]; 4] = [&self.control_ranges(), &line, &first, &second];
        for (field, &(found, least, most)) in parts.into_iter().flatten().enumerate() {
            if found < least || found > most {
                return Err(OutOfRange {
                    field: field as u8,
                    found,
                    least,
                    most,
                });
            }
        }
        Ok(())
    }

    fn control_ranges(&self) -> [Range; CONTROL_FIELDS] {
        let one = PER_UNIT as i32;
        let full_scale = self.line.points[LINE_POINTS - 1].force;
        [
            (self.sensors.into(), 1, SENSORS as i32),
            (self.friction.into(), 0, 2 * one),
            (self.contact_min.into(), 0, i32::from(i16::MAX)),
            (self.slip_threshold.into(), 0, one),
            (self.slip_leave.into(), self.slip_threshold.into(), one),
            (self.incipient_threshold.into(), self.slip_threshold.into(), one),
            (self.incipient_horizon_ms.into(), 0, 5_000),
            (self.dwell_ms.into(), 0, 5_000),
            (self.margin.into(), 0, 4 * one),
            (self.floor, 0, self.ceiling),
            // A line that cannot show the ceiling would grip with less than was decided.
            (self.ceiling, 1, full_scale.clamp(1, FORCE_MAX)),
            (self.tighten, self.floor, self.ceiling),
            (self.reflex_target.into(), self.slip_threshold.into(), one),
            // A reflex faster than the line may rise would run ahead of it.
            (self.reflex_rate.into(), 0, self.rise_rate.into()),
            (self.rise_rate.into(), 1, i32::from(u16::MAX)),
            (self.relax_rate.into(), 0, i32::from(u16::MAX)),
            (self.relax_after_ms.into(), 0, i32::from(u16::MAX)),
            (self.release_rate.into(), 1, i32::from(u16::MAX)),
            (self.stale_ms.into(), 2, i32::from(u16::MAX)),
            // Who is lost has been silent for longer than stale.
            (
                self.link_lost_ms.into(),
                self.stale_ms.into(),
                i32::from(u16::MAX),
            ),
        ]
    }
}

/// A taxel is 0.1 to 10 mm wide; the map's centre lies anywhere that fits; four quarter turns are none.
fn fingertip_ranges(tip: FingertipGeometry) -> [Range; FINGERTIP_FIELDS] {
    let anywhere = (i32::from(i16::MIN), i32::from(i16::MAX));
    let [x, y] = tip.centre_um.map(i32::from);
    [
        (tip.pitch_um.into(), 100, 10_000),
        (x, anywhere.0, anywhere.1),
        (y, anywhere.0, anywhere.1),
        (tip.quarter_turns.into(), 0, 3),
    ]
}

impl Default for Configuration {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

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
                refusal(|s| s.tighten = s.floor - 1),
                "tighten: found 4095, expected 4096 to 122880",
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
