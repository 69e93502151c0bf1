//! Everything that can be set on the microcontroller, and what each setting may be: by itself and beside the others.
//! Units: forces 1/4096 N, ratios and friction 1/10000, times and lengths as named. It travels in
//! [`crate::message::Command::Configure`] and lies in the microcontroller's flash.

use core::fmt;

use postcard_schema::Schema;
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::ser::{Serialize, SerializeTuple, Serializer};

use crate::constants::{LSB_PER_NEWTON, PER_UNIT, SENSORS, SIDE};
use crate::line::{LineKind, LinePoint, LineSettings};

/// Version of [`Configuration`]'s layout as it lies in flash; raised with every change of it or of its parts.
pub const CONFIGURATION_VERSION: u16 = 2;

/// A setting out of its range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, Schema)]
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

/// How a fingertip sits in the gripper: what makes newton-millimetres and millimetres in the gripper's frame of a map's
/// sums. Stick ratio, shear and so the grip do not depend on it. The gripper's frame has its z into the first
/// fingertip's skin; the second fingertip faces the first, so its frame is that one seen from the other side (x and z
/// reversed) before it is turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FingertipGeometry {
    /// Distance between taxel centres, µm.
    pub pitch_um: u16,
    /// The map's centre from the gripper's axis, x and y of the gripper's frame, µm.
    pub centre_um: [i16; 2],
    /// Quarter turns from the gripper's x (for the second fingertip its reverse) to the map's x, anticlockwise as seen
    /// from outside the fingertip.
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

/// Everything that can be set on the microcontroller. On the wire and in flash it is the list of its
/// [`values`](Self::values), which takes the chip a loop where a derived form takes kilobytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Configuration {
    /// Fingertips that must send maps: 1 or 2.
    pub sensors: u8,
    /// Friction coefficient of the detector, 1/10000: must lie below the skin's true one.
    pub friction: u16,
    /// Friction coefficient that a contact may prove at most by what it carries, 1/10000; the grip then follows the
    /// proven friction instead of the detector's. Not above `friction`: nothing is learnt.
    pub friction_most: u16,
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
    /// Least time in SLIP and INCIPIENT unless the load falls, ms.
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
    /// How fast the reflex adds grip when nothing sticks, 1/4096 N per ms; 0: no reflex.
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
pub const FORCE_MAX: i32 = newtons(125);

const CONTROL_VALUES: usize = 21;
/// The kind of line, then what [`LineSettings::FIELDS`] names.
const LINE_VALUES: usize = 1 + LineSettings::FIELDS.len();
const FINGERTIP_VALUES: usize = 4;
/// Taxels from a map's centre to its edge.
const HALF_SIDE: i32 = SIDE as i32 / 2;
/// How many numbers the settings are.
pub const CONFIGURATION_VALUES: usize = CONTROL_VALUES + LINE_VALUES + FINGERTIP_VALUES * SENSORS;

/// Every value of every setting as a number, in the order of [`Configuration::FIELDS`].
pub type Values = [i32; CONFIGURATION_VALUES];

/// Places in [`Values`] of settings that limit others.
mod at {
    pub(super) const SLIP_LEAVE: usize = 5;
    pub(super) const INCIPIENT_THRESHOLD: usize = 6;
    pub(super) const FLOOR: usize = 10;
    pub(super) const CEILING: usize = 11;
    pub(super) const TIGHTEN: usize = 12;
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

/// (least, most) of every value by itself.
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
            "friction_most",
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

    /// The paper's detector (μ 0.45, threshold 0.5), and a grip that learns the object's friction from what it carries.
    pub const DEFAULT: Self = Self {
        friction_most: 10_000,
        margin: 3_000,
        reflex_rate: 0,
        relax_rate: 12 * 4_096, // 12 N/s
        relax_after_ms: 50,
        ..Self::CAREFUL
    };

    /// A grip that learns nothing: by the detector's friction alone, with a reflex, and slow to let go.
    pub const CAREFUL: Self = Self {
        sensors: 1,
        friction: 4_500,
        friction_most: 0,
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

    /// Whether the grip follows the friction that a contact has proven.
    #[must_use]
    pub const fn learns(&self) -> bool {
        self.friction_most > self.friction
    }

    /// The settings as a list of numbers.
    #[must_use]
    #[inline(never)]
    pub fn values(&self) -> Values {
        let mut values = [0; CONFIGURATION_VALUES];
        let (control, rest) = values.split_at_mut(CONTROL_VALUES);
        control.copy_from_slice(&[
            self.sensors.into(),
            self.friction.into(),
            self.friction_most.into(),
            self.contact_min.into(),
            self.slip_threshold.into(),
            self.slip_leave.into(),
            self.incipient_threshold.into(),
            self.incipient_horizon_ms.into(),
            self.dwell_ms.into(),
            self.margin.into(),
            self.floor,
            self.ceiling,
            self.tighten,
            self.reflex_target.into(),
            self.reflex_rate.into(),
            self.rise_rate.into(),
            self.relax_rate.into(),
            self.relax_after_ms.into(),
            self.release_rate.into(),
            self.stale_ms.into(),
            self.link_lost_ms.into(),
        ]);
        let (line, fingertips) = rest.split_at_mut(LINE_VALUES);
        line[0] = self.line.kind as i32;
        for (pair, point) in line[1..].chunks_exact_mut(2).zip(&self.line.points) {
            pair[0] = point.force;
            pair[1] = point.code.into();
        }
        for (part, tip) in fingertips
            .chunks_exact_mut(FINGERTIP_VALUES)
            .zip(&self.fingertips)
        {
            let [x, y] = tip.centre_um;
            part.copy_from_slice(&[tip.pitch_um.into(), x.into(), y.into(), tip.quarter_turns.into()]);
        }
        values
    }

    /// The settings that a list of numbers stands for; `None` when one does not fit its place at all.
    #[must_use]
    #[inline(never)]
    pub fn from_values(values: &Values) -> Option<Self> {
        let (control, rest) = values.split_at(CONTROL_VALUES);
        let (line, tips) = rest.split_at(LINE_VALUES);
        let mut settings = Self {
            sensors: control[0] as u8,
            friction: control[1] as u16,
            friction_most: control[2] as u16,
            contact_min: control[3] as i16,
            slip_threshold: control[4] as u16,
            slip_leave: control[5] as u16,
            incipient_threshold: control[6] as u16,
            incipient_horizon_ms: control[7] as u16,
            dwell_ms: control[8] as u16,
            margin: control[9] as u16,
            floor: control[10],
            ceiling: control[11],
            tighten: control[12],
            reflex_target: control[13] as u16,
            reflex_rate: control[14] as u16,
            rise_rate: control[15] as u16,
            relax_rate: control[16] as u16,
            relax_after_ms: control[17] as u16,
            release_rate: control[18] as u16,
            stale_ms: control[19] as u16,
            link_lost_ms: control[20] as u16,
            ..Self::DEFAULT
        };
        if line[0] == LineKind::Robotiq2f140 as i32 {
            settings.line.kind = LineKind::Robotiq2f140;
        }
        for (point, pair) in settings.line.points.iter_mut().zip(line[1..].chunks_exact(2)) {
            *point = LinePoint {
                force: pair[0],
                code: pair[1] as u16,
            };
        }
        for (tip, part) in settings
            .fingertips
            .iter_mut()
            .zip(tips.chunks_exact(FINGERTIP_VALUES))
        {
            *tip = FingertipGeometry {
                pitch_um: part[0] as u16,
                centre_um: [part[1] as i16, part[2] as i16],
                quarter_turns: part[3] as u8,
            };
        }
        // What was cut off above shows here.
        (settings.values() == *values).then_some(settings)
    }

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
        let [least, most] = self.line.force_range();
        // A gripper that cannot grip as gently as the floor would squeeze more than was decided, and one that cannot
        // reach the ceiling less.
        limits[at::FLOOR] = (least, self.ceiling);
        limits[at::CEILING].1 = most.min(in_force.force_range()[1]).clamp(1, FORCE_MAX);
        limits[at::TIGHTEN] = (self.floor, self.ceiling);
        // A reflex faster than the line may rise would run ahead of it.
        limits[at::REFLEX_RATE].1 = self.rise_rate.into();
        // Who is lost has been silent for longer than stale.
        limits[at::LINK_LOST_MS].0 = self.stale_ms.into();
        for (limit, (_, least, most)) in limits[at::LINE..].iter_mut().zip(self.line.ranges(FORCE_MAX)) {
            *limit = (least, most);
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
        for (field, (found, (least, most))) in self.values().into_iter().zip(limits).enumerate() {
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
}

impl Serialize for Configuration {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_tuple(CONFIGURATION_VALUES)?;
        for value in &self.values() {
            list.serialize_element(value)?;
        }
        list.end()
    }
}

impl<'de> Deserialize<'de> for Configuration {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_tuple(CONFIGURATION_VALUES, ValuesVisitor)
    }
}

struct ValuesVisitor;

impl<'de> Visitor<'de> for ValuesVisitor {
    type Value = Configuration;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the values of the settings")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Configuration, A::Error> {
        let mut values = [0; CONFIGURATION_VALUES];
        for (place, value) in values.iter_mut().enumerate() {
            *value = list
                .next_element()?
                .ok_or_else(|| de::Error::invalid_length(place, &self))?;
        }
        Configuration::from_values(&values).ok_or_else(|| de::Error::custom("a value that fits no setting"))
    }
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
        settings.tighten = i32::MIN;
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
            let fits = name.contains("force") || ["floor", "ceiling", "tighten"].contains(name);
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
