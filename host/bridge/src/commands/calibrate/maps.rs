//! The force maps that a calibration goes by: those of a recording, or of a file.

use std::path::Path;

use gripline_protocol::TAXELS;

use crate::error::Failure;
use gripline_recording::maps_file::MapsFile;
use gripline_recording::{Completeness, Reader};

/// What `of` makes of every map (time in seconds, newtons per taxel), and what the maps are of. Of a recording those of
/// fingertip `fingertip`, 1 or 2.
///
/// # Errors
/// [`Failure`] when the file cannot be read, or has no map of the fingertip.
pub(super) fn read<T>(
    path: &Path,
    rate_hz: f64,
    fingertip: u8,
    of: impl Fn(f64, &[[f64; 3]; TAXELS]) -> T,
) -> Result<(Vec<T>, String), Failure> {
    let mut all = Vec::new();
    if path.extension().is_some_and(|extension| extension == "mcap") {
        let mut reader = Reader::open(path)?;
        let mut frames = 0;
        while let Some(frame) = reader.next_frame()? {
            frames += 1;
            if frame.status.sensor + 1 == fingertip {
                let newtons = frame.map.dequantise().map(|force| force.map(f64::from));
                all.push(of(frame.status.t_s, &newtons));
            }
        }
        if let Completeness::Truncated(why) = reader.completeness() {
            eprintln!(
                "gripline: {}: a recording cut short after {frames} frames ({why}); what is there is used",
                path.display()
            );
        }
        if all.is_empty() {
            return Err(Failure::usage(format!(
                "--fingertip {fingertip}: found no map of it in {}, expected one of those that the recording has",
                path.display()
            )));
        }
        let device = format!("{} ({})", reader.metadata.network, reader.metadata.mcu);
        return Ok((all, device));
    }
    let mut maps = MapsFile::open(path)?;
    let mut forces = [[0.0; 3]; TAXELS];
    while maps.read_frame(&mut forces)? {
        all.push(of(all.len() as f64 / rate_hz, &forces));
    }
    Ok((all, path.display().to_string()))
}
