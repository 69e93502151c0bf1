//! Metadata of a whole recording, stored in the channel `/status`.

use std::collections::BTreeMap;

use gripline_protocol::SENSORS;
use serde::{Deserialize, Serialize};

use crate::error::RecordingError;

/// Metadata of a whole recording.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Metadata {
    /// Version of this program.
    pub gripline: String,
    /// The link and the device on it.
    pub mcu: String,
    /// The firmware.
    pub firmware: String,
    /// The network's architecture.
    pub network: String,
    /// Origin of its weights.
    pub weights: String,
    /// Checksum of its output for a test picture: a fingerprint of the weights.
    pub fingerprint: String,
    /// Weights file, empty for the built-in ones.
    pub weights_file: String,
    /// Vector instructions that the network used.
    pub instructions: String,
    /// Scene gate.
    pub gate: String,
    /// Frames a second.
    pub frames_per_second: String,
    /// Identity of the fingertip's description; older recordings have none and are of the default one.
    #[serde(default)]
    pub sensor: String,
    /// The description itself, if it is not the default.
    #[serde(default)]
    pub sensor_file: String,
    /// The reference for the untouched gel with printed markers: own pictures, other pictures, the regular grid.
    #[serde(default)]
    pub rest: String,
    /// Calibrated values of each fingertip, JSON; empty without calibration.
    #[serde(default)]
    pub calibration: String,
    /// The microcontroller's settings, as `gripline config mcu` prints them.
    pub settings: String,
}

/// The calibrated values of a fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FingertipCalibration {
    /// The camera's view; `None`: as described, and always with particles.
    pub view: Option<CalibratedView>,
    /// Factors on shear and normal force.
    pub gain: [f32; 2],
}

/// A camera's view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CalibratedView {
    /// Width and height of the whole crop, mm.
    pub field_mm: [f64; 2],
    /// Distortion of the lens, per mm² from the middle.
    pub distortion_per_mm2: f64,
}

impl FingertipCalibration {
    /// Nothing was calibrated.
    pub const NONE: Self = Self {
        view: None,
        gain: [1.0; 2],
    };

    /// Only gains.
    #[must_use]
    pub const fn of_gain(gain: [f32; 2]) -> Self {
        Self { view: None, gain }
    }
}

impl Metadata {
    /// Sets the calibrated values of each fingertip.
    pub fn set_calibrations(&mut self, of: [FingertipCalibration; SENSORS]) {
        let is_any = of
            .iter()
            .any(|calibration| *calibration != FingertipCalibration::NONE);
        self.calibration = if is_any {
            serde_json::to_string(&of).unwrap_or_default()
        } else {
            String::new()
        };
    }

    /// The calibrated values of each fingertip; empty in recordings without them.
    ///
    /// # Errors
    /// [`RecordingError::Calibration`] when it cannot be read: without it the maps would differ.
    pub fn calibrations(&self) -> Result<[FingertipCalibration; SENSORS], RecordingError> {
        if self.calibration.is_empty() {
            return Ok([FingertipCalibration::NONE; SENSORS]);
        }
        serde_json::from_str(&self.calibration).map_err(|error| RecordingError::Calibration {
            found: error.to_string(),
        })
    }

    /// As a channel's metadata.
    pub fn to_map(&self) -> BTreeMap<String, String> {
        let value = serde_json::to_value(self).and_then(serde_json::from_value);
        value.unwrap_or_default()
    }

    /// From a channel's metadata; `None` when it is not from this program.
    pub fn from_map(map: &BTreeMap<String, String>) -> Option<Self> {
        serde_json::to_value(map).and_then(serde_json::from_value).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calibrations_of_both_fingertips_read_back_and_old_recordings_have_none() {
        let mut metadata = Metadata::default();
        assert_eq!(
            metadata.calibrations().unwrap(),
            [FingertipCalibration::NONE; SENSORS]
        );
        metadata.set_calibrations([FingertipCalibration::NONE; SENSORS]);
        assert_eq!(metadata.calibration, "");
        let of = [
            FingertipCalibration {
                view: Some(CalibratedView {
                    field_mm: [18.1, 13.9],
                    distortion_per_mm2: 1e-4,
                }),
                gain: [0.61, 0.58],
            },
            FingertipCalibration::NONE,
        ];
        metadata.set_calibrations(of);
        assert_eq!(metadata.calibrations().unwrap(), of);
        // Damaged, they are not taken for none.
        metadata.calibration.pop();
        let refused = metadata.calibrations().unwrap_err().to_string();
        assert!(refused.contains("record it again"), "{refused}");
    }

    #[test]
    fn metadata_reads_back_from_a_channel() {
        let metadata = Metadata {
            gate: "network".to_owned(),
            settings: "friction = 0.4\n".to_owned(),
            ..Metadata::default()
        };
        assert_eq!(Metadata::from_map(&metadata.to_map()), Some(metadata));
        assert_eq!(Metadata::from_map(&BTreeMap::new()), None);
    }
}
