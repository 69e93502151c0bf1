//! What holds for a whole recording: the metadata of the channel `/status`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What holds for a whole recording.
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
    /// Checksum of its output for a test picture, which tells weights apart.
    pub fingerprint: String,
    /// Weights file, empty for the built-in ones.
    pub weights_file: String,
    /// Vector instructions that the network used.
    pub instructions: String,
    /// Scene gate.
    pub gate: String,
    /// Frames a second.
    pub frames_per_second: String,
    /// Identity of the fingertip's description; older recordings have none, and are of the one that is the default.
    #[serde(default)]
    pub sensor: String,
    /// The description itself, where it is not the default.
    #[serde(default)]
    pub sensor_file: String,
    /// What stood for the untouched gel of printed markers: own pictures, other pictures, the regular grid.
    #[serde(default)]
    pub rest: String,
    /// The microcontroller's settings, as `gripline config mcu` prints them.
    pub settings: String,
}

impl Metadata {
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
