//! The checks of `gripline doctor` for a fingertip with printed markers: compares its pictures with its description. Touches the
//! source.

use std::time::Instant;

use gripline_firmware::sums::TaxelRule;
use gripline_markers::Finger;
use gripline_network::scene::GateKind;
use gripline_pipeline::settings_of;
use gripline_sensor::Sensor;

use super::judge::{self, Finding, Look};
use super::{Doctor, TIMED, WARM_UP};
use crate::config::Settings;
use crate::error::Error;
use crate::marker_rest;
use crate::model::{AtRest, Model};
use crate::source::{Frames, Opened, Source, SourceSettings, Taken};

/// Maximum number of pictures taken from a source.
const LOOKED: usize = TIMED + WARM_UP;
/// How often a camera may deliver nothing.
const PATIENCE: usize = 40;

impl Doctor {
    /// Camera, size, light, markers, rest, forces and latency of a fingertip.
    pub(super) fn markers(&mut self, settings: &Settings, model: &Model, fingertip: usize, source: &Source) {
        let wanted = SourceSettings {
            colour: Some(model.sensor.capture),
            ..settings.source_settings(fingertip)
        };
        let opened = match source.open(&wanted) {
            Ok(opened) => opened,
            Err(failure) => {
                let fix = "do what it says, or choose another source";
                return self.report(Finding::fail("camera", failure, "pictures", fix));
            }
        };
        self.report(Finding::ok("camera", &opened.description, "pictures"));
        let of = (&model.sensor, fingertip);
        let rest = match marker_rest::of(settings.rest.as_ref(), source, &opened.pictures, of) {
            Ok(rest) => AtRest::Markers(rest),
            Err(failure) => {
                let fix = "name frames or pictures in which nothing touches the gel";
                return self.report(Finding::fail("rest", failure, "pictures at rest", fix));
            }
        };
        let (pictures, came_s, size_px) = match take(opened) {
            Ok(taken) => taken,
            Err(failure) => {
                let fix = "check cable, format and light";
                return self.report(Finding::fail("camera", failure, "pictures", fix));
            }
        };
        if came_s.len() > 1 {
            self.report(judge::frame_rate(&came_s, model.sensor.capture.rate_hz));
        }
        match look(&model.sensor, &pictures, size_px) {
            Ok(look) => judge::markers(&model.sensor, &look)
                .into_iter()
                .for_each(|finding| self.report(finding)),
            Err(failure) => {
                let fix = "light and focus; the sensor's capture and markers sections (`gripline sensor check FILE --draw`)";
                return self.report(Finding::fail("markers", failure, "a square grid of markers", fix));
            }
        }
        match times_ms(model, fingertip, &rest, &pictures) {
            Ok(mut times) => self.report(judge::marker_latency(&mut times, model.sensor.capture.rate_hz)),
            Err(failure) => {
                let fix = "take the rest anew, with nothing on the gel";
                self.report(Finding::fail("rest", failure, "an untouched gel", fix));
            }
        }
        let [name, manifest, _] = model.named(&rest);
        let found = format!("{name}: {manifest}");
        self.report(Finding::ok(
            "forces",
            found,
            format!("a model of {}", model.sensor.identity()),
        ));
    }
}

/// Pictures, arrival times of a camera's (s), and the source's size.
type Pictures = (Vec<Vec<u8>>, Vec<f64>, Option<[usize; 2]>);

fn take(mut opened: Opened) -> Result<Pictures, Error> {
    let size_px = match &opened.pictures {
        Frames::Colour(frames) => frames.size_px(),
        _ => None,
    };
    let is_live = opened.pictures.is_live();
    let (mut pictures, mut came_s, mut nothing) = (Vec::new(), Vec::new(), 0);
    let start = Instant::now();
    while pictures.len() < LOOKED && nothing < PATIENCE {
        match opened.pictures.next(0.0, gripline_capture::POLL)? {
            Taken::Picture(picture) => {
                if is_live {
                    came_s.push(picture.taken.saturating_duration_since(start).as_secs_f64());
                }
                pictures.push(picture.crop);
            }
            Taken::NotYet => nothing += 1,
            Taken::End => break,
        }
    }
    if pictures.is_empty() {
        return Err(Error::failed("no picture came"));
    }
    Ok((pictures, came_s, size_px))
}

fn look(sensor: &Sensor, pictures: &[Vec<u8>], size_px: Option<[usize; 2]>) -> Result<Look, Error> {
    let mut finger = Finger::new(sensor)?;
    let mut lost_share = 0.0_f32;
    let mut level = None;
    for picture in pictures {
        let seen = finger.see(picture)?;
        lost_share = lost_share.max(seen.lost_share);
        level.get_or_insert(f64::from(seen.filled.mean_level()));
    }
    Ok(Look {
        size_px,
        level: level.unwrap_or_default(),
        markers: finger.tracker().markers().len(),
        pitch_px: finger.tracker().pitch_px().map_or(0.0, f64::from),
        lost_share: f64::from(lost_share),
    })
}

/// How long each picture takes to become a map and evidence, the first ones left out.
fn times_ms(model: &Model, fingertip: usize, rest: &AtRest, pictures: &[Vec<u8>]) -> Result<Vec<f64>, Error> {
    let rule = TaxelRule::of(&settings_of(model.calibration()));
    let mut pipeline = model.pipeline(fingertip, rest, GateKind::Off, rule)?;
    let mut times = Vec::with_capacity(pictures.len());
    for picture in pictures {
        let start = Instant::now();
        pipeline.process(picture)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(times.split_off(WARM_UP.min(times.len() / 2)))
}
