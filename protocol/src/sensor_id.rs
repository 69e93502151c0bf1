//! The number of a fingertip.

use core::fmt;

use postcard_schema::{Schema, schema::NamedType};
use serde::{Deserialize, Serialize};

use crate::constants::SENSORS;

/// A fingertip of a microcontroller: its number, 0 or 1, on the wire and in recordings too.
// An enum would be a niche for the parser's options, which costs a map's head nine instructions for each byte of its bitmap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(into = "u8", try_from = "u8")]
pub struct SensorId(u8);

impl SensorId {
    /// The only fingertip, or the first of two.
    pub const FIRST: Self = Self(0);
    /// The second of two; it faces the first.
    pub const SECOND: Self = Self(1);
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; SENSORS] = [Self::FIRST, Self::SECOND];

    /// Its number, from 0.
    #[inline]
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }

    /// Its place in an array of [`SENSORS`] entries.
    #[inline]
    #[must_use]
    pub const fn index(self) -> usize {
        // Never more than the number; it spares the check of the array's bounds.
        (self.0 % SENSORS as u8) as usize
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
        if usize::from(number) < SENSORS {
            Ok(Self(number))
        } else {
            Err(UnknownSensor { found: number })
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
