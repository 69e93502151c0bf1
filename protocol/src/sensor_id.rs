//! The number of a fingertip.

use core::fmt;

use postcard_schema::{Schema, schema::NamedType};
use serde::{Deserialize, Serialize};

use crate::constants::SENSORS;

/// A fingertip of a microcontroller. On the wire and in recordings it is the number 0 or 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(into = "u8", try_from = "u8")]
#[repr(u8)]
pub enum SensorId {
    /// The only fingertip, or the first of two.
    #[default]
    First = 0,
    /// The second of two; it faces the first.
    Second = 1,
}

impl SensorId {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; SENSORS] = [Self::First, Self::Second];

    /// Its number, from 0.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Its place in an array of [`SENSORS`] entries.
    #[inline]
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// No fingertip has this number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UnknownSensor {
    /// The number found.
    pub found: u8,
}

impl fmt::Display for UnknownSensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "sensor {}, expected 0 to {}", self.found, SENSORS - 1)
    }
}

impl core::error::Error for UnknownSensor {}

impl TryFrom<u8> for SensorId {
    type Error = UnknownSensor;

    #[inline]
    fn try_from(number: u8) -> Result<Self, UnknownSensor> {
        match number {
            0 => Ok(Self::First),
            1 => Ok(Self::Second),
            found => Err(UnknownSensor { found }),
        }
    }
}

impl From<SensorId> for u8 {
    fn from(sensor: SensorId) -> Self {
        sensor.number()
    }
}

impl fmt::Display for SensorId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.number().fmt(f)
    }
}

impl Schema for SensorId {
    const SCHEMA: &'static NamedType = u8::SCHEMA;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_is_one_byte_on_the_wire_and_an_unknown_one_is_refused() {
        for (number, sensor) in (0_u8..).zip(SensorId::ALL) {
            let mut bytes = [0xFF];
            assert_eq!(postcard::to_slice(&sensor, &mut bytes), Ok(&mut [number][..]));
            assert_eq!(postcard::from_bytes(&[number]), Ok(sensor));
            assert_eq!((sensor.number(), sensor.index()), (number, number.into()));
        }
        assert!(postcard::from_bytes::<SensorId>(&[2]).is_err());
        assert_eq!(SensorId::try_from(2), Err(UnknownSensor { found: 2 }));
        assert_eq!(SensorId::SCHEMA, u8::SCHEMA);
    }
}
