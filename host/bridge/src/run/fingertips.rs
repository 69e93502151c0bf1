//! The fingertips of a run, one or two: the source and the pipeline of each, and whose picture is next.

use std::sync::Arc;

use gripline_evaluation::calibration::surface::{Figures, mean};
use gripline_firmware::sums::TaxelRule;
use gripline_network::scene::GateKind;
use gripline_protocol::SensorId;
use gripline_protocol::message::GripMode;
use gripline_simulation::constants::REST_PICTURES;

use crate::calibration::Calibration;
use crate::config::Settings;
use crate::error::Error;
use crate::marker_rest;
use crate::model::{AtRest, Model};
use crate::rest::{self, Store};
use crate::source::{Frames, Opened, Picture, SourceSettings, Taken, open_both};
use gripline_capture::{Counts, POLL};
use gripline_link::session::Session;
use gripline_pipeline::pipeline::Pipeline;

/// How long to wait for a status, µs: the microcontroller sends ten a second.
const STATUS_US: u64 = 250_000;

/// A fingertip whose source is open and which was looked at while nothing touched it.
pub(super) struct Open {
    /// Where pictures come from.
    source: Frames,
    /// What was seen, or stands for it.
    pub rest: AtRest,
    /// Where rest pictures of this camera are kept.
    store: Option<Store>,
}

impl Open {
    /// Its rest pictures of particles.
    pub(super) fn particles(&self) -> Option<Vec<Vec<u8>>> {
        match &self.rest {
            AtRest::Particles(crops) => Some(crops.clone()),
            AtRest::Markers(_) => None,
        }
    }
}

/// Opens the source of each fingertip.
///
/// # Errors
/// [`Error`] that says what was found and what to do.
pub(super) fn open(wanted: &Settings, model: &Model) -> Result<Vec<Opened>, Error> {
    let settings = SourceSettings {
        colour: model.has_markers().then_some(model.sensor.capture),
        ..wanted.source_settings(0)
    };
    let opened = match &wanted.second_source {
        None => vec![wanted.source.open(&settings)?],
        Some(second) => open_both([&wanted.source, second], &settings)?.into(),
    };
    for opened in &opened {
        if let Frames::Recording(frames) = &opened.pictures {
            model.accepts(frames.metadata(), frames.path())?;
        }
    }
    Ok(opened)
}

/// The rest pictures of each fingertip: those of its calibration, else taken now.
///
/// # Errors
/// [`Error`] when a camera sends nothing good, or its pictures may show a touch.
pub(super) fn at_rest(
    opened: Vec<Opened>,
    wanted: &Settings,
    model: &Model,
    session: &mut Session,
) -> Result<Vec<Open>, Error> {
    if model.has_markers() {
        return markers_at_rest(opened, wanted, model, session);
    }
    let calibrations = [&wanted.calibration, &wanted.second_calibration];
    let sources = [Some(&wanted.source), wanted.second_source.as_ref()];
    let mut looked = Vec::with_capacity(opened.len());
    for (place, mut opened) in opened.into_iter().enumerate() {
        let calibration = calibrations[place].as_ref();
        let calibrated = calibration.map(Calibration::rest_pictures).transpose()?;
        let store = match &opened.pictures {
            Frames::Camera(camera) => {
                let source = sources[place].map_or_else(String::new, ToString::to_string);
                Store::of(&source, camera.name(), place)
            }
            _ => None,
        };
        let rest = match (calibrated.flatten(), &opened.pictures) {
            (Some(rest), _) => rest,
            (None, Frames::Camera(_)) => {
                let is_holding = is_holding(session)?;
                rest::at_start(
                    opened.rest(REST_PICTURES.into())?.crops,
                    store.as_ref(),
                    is_holding,
                )?
            }
            // Files say which picture is at rest, and the simulated world is.
            (None, _) => opened.rest(REST_PICTURES.into())?.crops,
        };
        looked.push(Open {
            source: opened.pictures,
            rest: AtRest::Particles(rest),
            store,
        });
    }
    Ok(looked)
}

/// The same of printed markers.
fn markers_at_rest(
    opened: Vec<Opened>,
    wanted: &Settings,
    model: &Model,
    session: &mut Session,
) -> Result<Vec<Open>, Error> {
    let are_live = opened.iter().any(|opened| opened.pictures.is_live());
    if are_live && wanted.rest.is_none() && is_holding(session)? {
        return Err(Error::failed(
            "found a gripper that holds, expected a released one: what it holds would count as no contact. Let go (`gripline faults \
             --acknowledge --release`) and start again, or name pictures of the untouched gel with --rest",
        ));
    }
    let sources = [Some(&wanted.source), wanted.second_source.as_ref()];
    let looked = opened.into_iter().zip(sources.into_iter().flatten()).enumerate();
    looked
        .map(|(fingertip, (opened, source))| {
            let of = (&model.sensor, fingertip);
            let rest = marker_rest::of(wanted.rest.as_ref(), source, &opened.pictures, of)?;
            Ok(Open {
                source: opened.pictures,
                rest: AtRest::Markers(rest),
                store: None,
            })
        })
        .collect()
}

/// Whether the gripper holds, as far as the microcontroller says: one that says nothing may.
fn is_holding(session: &mut Session) -> Result<bool, Error> {
    session.run_until(session.now_us() + STATUS_US)?;
    let status = session.status();
    Ok(status.is_none_or(|status| status.mode == GripMode::Hold && status.line > 0))
}

/// A fingertip at work.
struct Fingertip {
    source: Frames,
    pipeline: Pipeline,
    /// Mean of the rest pictures of particles.
    rest: Arc<Vec<u8>>,
    store: Option<Store>,
}

/// All of them; at least one.
pub(super) struct Fingertips {
    all: Vec<Fingertip>,
    /// Whose turn it is.
    next: usize,
    model: Model,
    gate: GateKind,
    rule: TaxelRule,
}

/// The result of polling the fingertips.
pub(super) enum Polled {
    /// A picture of this one.
    Picture(SensorId, Picture),
    /// None yet.
    NotYet,
    /// One source has ended.
    End,
}

impl Fingertips {
    /// Each with the model, its own rest pictures, and its own gate.
    ///
    /// # Errors
    /// [`Error`] when a rest of printed markers shows none, or a touch.
    pub(super) fn new(
        opened: Vec<Open>,
        model: &Model,
        wanted: &Settings,
        rule: TaxelRule,
    ) -> Result<Self, Error> {
        let at_work = |(place, open): (usize, Open)| {
            Ok::<_, Error>(Fingertip {
                pipeline: model.pipeline(place, &open.rest, wanted.gate, rule)?,
                rest: Arc::new(open.particles().map_or_else(Vec::new, |crops| mean(&crops))),
                source: open.source,
                store: open.store,
            })
        };
        Ok(Self {
            all: opened
                .into_iter()
                .enumerate()
                .map(at_work)
                .collect::<Result<_, _>>()?,
            next: 0,
            model: model.clone(),
            gate: wanted.gate,
            rule,
        })
    }

    /// The next picture of any of them, in turn; a camera without a new picture is skipped.
    ///
    /// # Errors
    /// [`Error`] when there can be no more.
    pub(super) fn next(&mut self, line_n: f64) -> Result<Polled, Error> {
        let count = self.all.len();
        for _ in 0..count {
            let place = self.next;
            self.next = (place + 1) % count;
            match self.all[place].source.next(line_n, POLL / count as u32)? {
                Taken::Picture(picture) => return Ok(Polled::Picture(SensorId::ALL[place], picture)),
                Taken::NotYet => {}
                Taken::End => return Ok(Polled::End),
            }
        }
        Ok(Polled::NotYet)
    }

    /// The pipeline of this fingertip.
    pub(super) fn pipeline(&mut self, sensor: SensorId) -> &mut Pipeline {
        &mut self.all[sensor.index()].pipeline
    }

    /// Mean of each one's rest pictures.
    pub(super) fn rest_means(&self) -> Vec<Arc<Vec<u8>>> {
        self.all.iter().map(|tip| Arc::clone(&tip.rest)).collect()
    }

    /// Sets new rest pictures of this fingertip; a camera's are stored for the next start.
    pub(super) fn rest_anew(&mut self, sensor: SensorId, rest: &[Vec<u8>], figures: &Figures) {
        let index = sensor.index();
        let Some(pipeline) = self.model.particle_pipeline(index, rest, self.gate, self.rule) else {
            return;
        };
        let tip = &mut self.all[index];
        tip.pipeline = pipeline;
        tip.rest = Arc::new(mean(rest));
        if let Some(store) = &tip.store {
            store.keep(rest, figures);
        }
    }

    /// How many can take new rest pictures: all or none.
    pub(super) fn to_rezero(&self) -> usize {
        if !self.model.has_markers() && (self.are_live() || self.are_simulated()) {
            self.all.len()
        } else {
            0
        }
    }

    /// Whether the pictures come from a camera, at its own rate.
    pub(super) fn are_live(&self) -> bool {
        self.all.iter().any(|tip| tip.source.is_live())
    }

    /// Whether they are simulated.
    pub(super) fn are_simulated(&self) -> bool {
        self.all.iter().any(|tip| tip.source.is_simulated())
    }

    /// Counts of each one's pictures so far.
    pub(super) fn counts(&self) -> Vec<Option<Counts>> {
        self.all.iter().map(|tip| tip.source.counts()).collect()
    }
}
