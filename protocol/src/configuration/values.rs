//! The settings as a list of numbers: their form on the wire and in flash.

use core::fmt;

use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::ser::{Serialize, SerializeTuple, Serializer};

use super::settings::{Configuration, FingertipGeometry};
use crate::constants::SENSORS;
use crate::line::LineSettings;

pub(super) const CONTROL_VALUES: usize = 21;
pub(super) use crate::line::LINE_VALUES;
pub(super) const FINGERTIP_VALUES: usize = 4;
/// How many numbers the settings are.
pub const CONFIGURATION_VALUES: usize = CONTROL_VALUES + LINE_VALUES + FINGERTIP_VALUES * SENSORS;

/// Every value of every setting as a number, in the order of [`Configuration::FIELDS`].
pub type Values = [i32; CONFIGURATION_VALUES];

impl Configuration {
    /// The settings as a list of numbers.
    #[must_use]
    #[inline(never)]
    pub fn values(&self) -> Values {
        let mut values = [0; CONFIGURATION_VALUES];
        let (control, rest) = values.split_at_mut(CONTROL_VALUES);
        control.copy_from_slice(&[
            self.sensors.into(),
            self.friction.into(),
            self.friction_max.into(),
            self.contact_min.into(),
            self.slip_threshold.into(),
            self.slip_leave.into(),
            self.incipient_threshold.into(),
            self.incipient_horizon_ms.into(),
            self.dwell_ms.into(),
            self.margin.into(),
            self.floor,
            self.ceiling,
            self.fail_safe,
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
        line.copy_from_slice(&self.line.values());
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
        let (line, tips) = rest.split_first_chunk()?;
        let mut settings = Self {
            sensors: control[0] as u8,
            friction: control[1] as u16,
            friction_max: control[2] as u16,
            contact_min: control[3] as i16,
            slip_threshold: control[4] as u16,
            slip_leave: control[5] as u16,
            incipient_threshold: control[6] as u16,
            incipient_horizon_ms: control[7] as u16,
            dwell_ms: control[8] as u16,
            margin: control[9] as u16,
            floor: control[10],
            ceiling: control[11],
            fail_safe: control[12],
            reflex_target: control[13] as u16,
            reflex_rate: control[14] as u16,
            rise_rate: control[15] as u16,
            relax_rate: control[16] as u16,
            relax_after_ms: control[17] as u16,
            release_rate: control[18] as u16,
            stale_ms: control[19] as u16,
            link_lost_ms: control[20] as u16,
            line: LineSettings::from_values(line),
            ..Self::DEFAULT
        };
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
