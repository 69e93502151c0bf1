//! Why markers cannot be followed.

/// Why a picture or a sensor cannot be used here.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MarkerError {
    /// The sensor tracks something else.
    #[error(
        "sensor {sensor}: found {found}, expected {expected}: choose a sensor with printed markers, or mend its file (gripline sensor check)"
    )]
    Sensor {
        /// Its identity.
        sensor: String,
        /// What it has.
        found: String,
        /// What it needs.
        expected: &'static str,
    },
    /// The picture has another size than the sensor's crop.
    #[error(
        "picture: found {found} bytes, expected {expected} (red, green, blue of the sensor's crop): scale it to the sensor's capture.size_px"
    )]
    Size {
        /// Bytes that came.
        found: usize,
        /// Bytes of the crop.
        expected: usize,
    },
    /// Too few markers.
    #[error(
        "picture: found {found} markers in a square grid, expected at least {expected} ({pitch_px:.0?} pixels apart): check light, focus and the \
         sensor's markers section, or take a clip of a gel with markers"
    )]
    NoMarkers {
        /// Markers in the largest grid.
        found: usize,
        /// Fewest of the sensor.
        expected: usize,
        /// Least and most pitch, pixels.
        pitch_px: [f64; 2],
    },
}
