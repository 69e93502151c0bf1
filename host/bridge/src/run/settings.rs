//! The settings of a run: its network, the microcontroller's settings after network and calibrations, and the metadata of a
//! recording.

use gripline_network::InstructionSet;
use gripline_protocol::message::{Configuration, FingertipGeometry};
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT, SENSORS};

use super::requests::Unasked;
use crate::calibration::{Calibration, with_points};
use crate::config::{Settings, settings_text};
use crate::error::Error;
use crate::model::{AtRest, Model};
use crate::source::Source;
use gripline_link::Target;
use gripline_link::session::Session;
use gripline_pipeline::SCENE_INITIAL_GRIP_N;
use gripline_recording::Metadata;

/// What may move the gripper without a request: only `--hold`, and a script if no real gripper can move.
pub(super) const fn unasked(wanted: &Settings) -> Unasked {
    let is_real = matches!(wanted.mcu, Target::Serial(_) | Target::Usb(_));
    let has_script = matches!(wanted.source, Source::Simulated | Source::Recording(_));
    Unasked {
        hold: wanted.hold,
        script: has_script && (wanted.hold || !is_real),
    }
}

/// Every fingertip that the microcontroller waits for must have a source, or its maps would be stale from the start.
pub(super) fn as_many_fingertips(
    wanted: &Settings,
    settings: &Configuration,
    sources: usize,
) -> Result<(), Error> {
    if usize::from(settings.sensors) == sources {
        return Ok(());
    }
    let second = wanted
        .second_source
        .as_ref()
        .map_or("none".to_owned(), Source::to_string);
    Err(Error::usage(format!(
        "microcontroller.sensors: found {} with camera.second_source {second}, expected {sources}: leave it out, a run sets it to \
         the number of its sources",
        settings.sensors
    )))
}

/// The detector's friction from the calibrations; the lower one of two fingertips, so that neither is overestimated.
pub(super) fn calibrated_friction(wanted: &Settings) -> Option<u16> {
    let of = |calibration: &Option<Calibration>| Some(calibration.as_ref()?.friction.as_ref()?.detector);
    let both = [&wanted.calibration, &wanted.second_calibration];
    let min = both.into_iter().filter_map(of).min_by(f64::total_cmp)?;
    Some((min * f64::from(PER_UNIT)).floor() as u16)
}

/// The geometry of the fingertips from the calibrations, else the microcontroller's.
pub(super) fn calibrated_fingertips(wanted: &Settings, now: &Configuration) -> [FingertipGeometry; SENSORS] {
    let mut fingertips = now.fingertips;
    let both = [&wanted.calibration, &wanted.second_calibration];
    for (fingertip, calibration) in fingertips.iter_mut().zip(both) {
        if let Some(geometry) = calibration.as_ref().and_then(|found| found.geometry.as_ref()) {
            *fingertip = geometry.setting();
        }
    }
    fingertips
}

/// The minimum force while holding, 1/4096 N: the microcontroller's own. Only the object of the simulated scene needs another,
/// unless the user has chosen one.
pub(super) fn floor(source: &Source, now: &Configuration) -> i32 {
    let is_scene = matches!(source, Source::Simulated);
    if is_scene && now.floor == Configuration::DEFAULT.floor {
        let scene = (SCENE_INITIAL_GRIP_N * f64::from(LSB_PER_NEWTON)) as i32;
        return scene.min(now.fail_safe);
    }
    now.floor
}

/// Warns when the microcontroller's table of the line is not the calibrated one: only a stored one is used.
pub(super) fn tell_of_another_line(wanted: &Settings, settings: &Configuration) {
    let Some(calibration) = &wanted.calibration else {
        return;
    };
    if let Some(line) = &calibration.line
        && with_points(settings, &line.points).line.points != settings.line.points
    {
        tracing::warn!(
            "the microcontroller's line.points are not those of {}, expected the same: store them with `gripline \
             calibrate line --store`, or as [line] points of `gripline config mcu --write`",
            calibration.path.display()
        );
    }
}

/// The metadata of a recording.
pub(super) fn about(
    wanted: &Settings,
    model: &Model,
    session: &Session,
    (rest, frames_per_second): (&AtRest, f64),
) -> Metadata {
    let [network, weights, fingerprint] = model.named(rest);
    let [sensor, sensor_file] = model.described();
    let mut about = Metadata {
        gripline: env!("CARGO_PKG_VERSION").to_owned(),
        mcu: session.link_name(),
        firmware: session.firmware().map_or(String::new(), ToString::to_string),
        network,
        weights,
        weights_file: wanted
            .weights
            .as_deref()
            .map_or(String::new(), |path| path.display().to_string()),
        fingerprint,
        instructions: wanted
            .instructions
            .unwrap_or_else(InstructionSet::widest)
            .to_string(),
        gate: wanted.gate.to_string(),
        frames_per_second: frames_per_second.to_string(),
        sensor,
        sensor_file,
        rest: rest.kind().map_or_else(String::new, |kind| kind.to_string()),
        settings: settings_text(session.settings()),
        calibration: String::new(),
    };
    about.set_calibrations(model.calibrations());
    about
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_that_the_device_stored_is_kept_and_only_the_simulated_scene_sets_another() {
        let stored = Configuration {
            floor: 4 * LSB_PER_NEWTON,
            ..Configuration::DEFAULT
        };
        let camera = Source::Camera("/dev/video0".into());
        let recording = Source::Recording("run.mcap".into());
        for source in [&Source::Simulated, &camera, &recording] {
            assert_eq!(floor(source, &stored), stored.floor, "{source}");
        }
        for source in [&camera, &recording] {
            assert_eq!(
                floor(source, &Configuration::DEFAULT),
                Configuration::DEFAULT.floor,
                "{source}"
            );
        }
        let scene = floor(&Source::Simulated, &Configuration::DEFAULT);
        assert_eq!(scene, 5 * LSB_PER_NEWTON / 2);
    }
}
