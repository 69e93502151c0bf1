//! The force maps for a calibration, from a recording or a file.

use std::path::Path;

use gripline_protocol::TAXELS;

use crate::error::Error;
use gripline_recording::maps_file::MapsFile;
use gripline_recording::{Completeness, Metadata, Reader};

/// Input of a calibration.
pub(super) struct Maps<T> {
    /// The value computed from each map.
    pub all: Vec<T>,
    /// The device that made them.
    pub device: String,
    /// When a recording's time is zero, nanoseconds since 1970.
    pub start_ns: Option<u64>,
    /// Factors on shear and normal force that a calibration gave the maps.
    pub gain: [f32; 2],
    /// What a recording says of itself.
    pub metadata: Option<Metadata>,
}

/// `of` applied to every map (time in seconds, newtons per taxel). `fingertip`, 1 or 2, selects maps of a recording.
///
/// # Errors
/// [`Error`] when the file cannot be read, or has no map of the fingertip.
pub(super) fn read<T>(
    path: &Path,
    rate_hz: f64,
    fingertip: u8,
    of: impl Fn(f64, &[[f64; 3]; TAXELS]) -> T,
) -> Result<Maps<T>, Error> {
    let (mut all, mut start_ns) = (Vec::new(), None);
    if path.extension().is_some_and(|extension| extension == "mcap") {
        let mut reader = Reader::open(path)?;
        let mut frames = 0;
        while let Some(frame) = reader.next_frame()? {
            frames += 1;
            if frame.status.sensor.number() + 1 == fingertip {
                let since_ns = (frame.status.t_s.max(0.0) * 1e9) as u64;
                start_ns.get_or_insert(frame.at_ns.saturating_sub(since_ns));
                let newtons = frame.map.dequantise().map(|force| force.map(f64::from));
                all.push(of(frame.status.t_s, &newtons));
            }
        }
        if let Completeness::Truncated(why) = reader.completeness() {
            tracing::warn!(
                "{}: a recording cut short after {frames} frames ({why}); these are used",
                path.display()
            );
        }
        if all.is_empty() {
            return Err(Error::usage(format!(
                "--fingertip {fingertip}: found no map of it in {}, expected one of those that the recording has",
                path.display()
            )));
        }
        let device = format!("{} ({})", reader.metadata.network, reader.metadata.mcu);
        return Ok(Maps {
            all,
            device,
            start_ns,
            gain: reader.metadata.calibrations()?[usize::from(fingertip - 1)].gain,
            metadata: Some(reader.metadata),
        });
    }
    let mut maps = MapsFile::open(path)?;
    let mut forces = [[0.0; 3]; TAXELS];
    while maps.read_frame(&mut forces)? {
        all.push(of(all.len() as f64 / rate_hz, &forces));
    }
    Ok(Maps {
        all,
        device: path.display().to_string(),
        start_ns,
        gain: [1.0; 2],
        metadata: None,
    })
}
