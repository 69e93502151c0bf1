//! The force model of a fingertip: the force network for particles, or a marker model, by the sensor's description. Used by runs
//! and replays.

use std::path::Path;

use gripline_firmware::sums::TaxelRule;
use gripline_markers::RestKind;
use gripline_network::marker_forces::MarkerForces;
use gripline_network::scene::GateKind;
use gripline_network::{Calibration, Network};
use gripline_pipeline::markers::{self, MarkerRest, MarkerStage};
use gripline_pipeline::pipeline::{self, Pipeline};
use gripline_protocol::SENSORS;
use gripline_protocol::message::FingertipGeometry;
use gripline_recording::{CROP_SIDE, CalibratedView, FingertipCalibration, Image, Metadata};
use gripline_sensor::{MarkerKind, SHIPPED, Sensor};

use crate::calibration;
use crate::config::Settings;
use crate::error::Error;

/// A sensor and its force model.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    /// The description.
    pub sensor: Sensor,
    /// Its text, for recordings; empty for the default.
    text: String,
    reader: Reader,
}

#[derive(Debug, Clone)]
enum Reader {
    Particles {
        network: Box<Network>,
        /// Of each fingertip.
        calibrations: [FingertipCalibration; SENSORS],
    },
    /// One per fingertip: each has its own gel and camera.
    Markers(Box<[MarkerReader; SENSORS]>),
}

/// The marker model of one fingertip.
#[derive(Debug, Clone)]
struct MarkerReader {
    /// The description with the calibrated field and lens of this camera.
    sensor: Sensor,
    /// With this gel's gains.
    forces: MarkerForces,
    calibration: FingertipCalibration,
}

/// A fingertip's pictures while nothing touches it.
#[derive(Debug, Clone)]
pub(crate) enum AtRest {
    /// 440×440 grey levels each, at least one.
    Particles(Vec<Vec<u8>>),
    /// The reference for the untouched gel.
    Markers(MarkerRest),
}

impl Model {
    /// The model named by the settings.
    ///
    /// # Errors
    /// [`Error`] when description or weights cannot be used, or do not belong together.
    pub(crate) fn of(wanted: &Settings) -> Result<Self, Error> {
        let text = Sensor::text_of(&wanted.sensor)?;
        let sensor = Sensor::from_toml(&wanted.sensor, &text)?;
        let (reader, text) = match sensor.markers.kind {
            MarkerKind::Volume => {
                known_particles(&sensor)?;
                let network = Box::new(wanted.network()?);
                let of = |calibration: &Option<calibration::Calibration>| {
                    gain_of(&sensor, calibration.as_ref(), || network_named(&network))
                        .map(FingertipCalibration::of_gain)
                };
                let calibrations = [of(&wanted.calibration)?, of(&wanted.second_calibration)?];
                (
                    Reader::Particles {
                        network,
                        calibrations,
                    },
                    String::new(),
                )
            }
            MarkerKind::Plane => {
                let of = |calibration: &Option<calibration::Calibration>| {
                    let view = match calibration {
                        None => None,
                        Some(found) => view_of(&sensor, found)?,
                    };
                    let folder = wanted.sensor.parent();
                    let reader = MarkerReader::new(&sensor, wanted.weights.as_deref(), folder, view)?;
                    let gain = gain_of(&sensor, calibration.as_ref(), || forces_named(&reader.forces))?;
                    Ok::<_, Error>(reader.with_gain(gain))
                };
                let readers = [of(&wanted.calibration)?, of(&wanted.second_calibration)?];
                (Reader::Markers(Box::new(readers)), text)
            }
        };
        let has_gel = |calibration: &Option<calibration::Calibration>| {
            calibration.as_ref().is_some_and(|found| found.gel.is_some())
        };
        let is_one_known = has_gel(&wanted.calibration) != has_gel(&wanted.second_calibration);
        if wanted.second_source.is_some() && is_one_known {
            tracing::warn!(
                "one fingertip's gel is calibrated and the other's is not, expected both: the other's forces are those of a \
                 gel as described; name its calibration with --calibration or --second-calibration"
            );
        }
        Ok(Self { sensor, text, reader })
    }

    /// The model of a recording with printed markers; `None` for particles.
    ///
    /// # Errors
    /// [`Error`] when the description in it cannot be used, or the weights are another sensor's.
    pub(crate) fn recorded(metadata: &Metadata, weights: Option<&Path>) -> Result<Option<Self>, Error> {
        if metadata.sensor_file.is_empty() {
            return Ok(None);
        }
        let sensor = Sensor::from_toml(Path::new(&metadata.sensor), &metadata.sensor_file)?;
        let [first, second] = metadata.calibrations()?.map(|calibration| {
            let reader = MarkerReader::new(&sensor, weights, None, calibration.view)?;
            Ok::<_, Error>(reader.with_gain(calibration.gain))
        });
        Ok(Some(Self {
            text: metadata.sensor_file.clone(),
            reader: Reader::Markers(Box::new([first?, second?])),
            sensor,
        }))
    }

    /// The force network of a sensor with particles, without the fingertips' gains.
    pub(crate) fn network(&self) -> Option<&Network> {
        match &self.reader {
            Reader::Particles { network, .. } => Some(network),
            Reader::Markers(_) => None,
        }
    }

    /// Whether the sensor has printed markers, and colour pictures.
    pub(crate) const fn has_markers(&self) -> bool {
        matches!(self.reader, Reader::Markers(_))
    }

    /// The detector's calibration for its maps.
    pub(crate) fn calibration(&self) -> Calibration {
        match &self.reader {
            Reader::Particles { network, .. } => network.calibration(),
            Reader::Markers(readers) => readers[0].forces.calibration(),
        }
    }

    /// Side of a taxel in a fingertip's geometry.
    pub(crate) fn sized(&self, geometry: FingertipGeometry) -> FingertipGeometry {
        FingertipGeometry {
            pitch_um: (1e3 * self.sensor.taxels.pitch_mm).round() as u16,
            ..geometry
        }
    }

    /// The pipeline for a fingertip, 0 for the first.
    ///
    /// # Errors
    /// [`Error`] when the rest shows no markers, or a touch.
    pub(crate) fn pipeline(
        &self,
        fingertip: usize,
        rest: &AtRest,
        gate: GateKind,
        rule: TaxelRule,
    ) -> Result<Pipeline, Error> {
        match (&self.reader, rest) {
            (Reader::Particles { .. }, AtRest::Particles(crops)) => self
                .particle_pipeline(fingertip, crops, gate, rule)
                .ok_or_else(|| self.of_another_kind()),
            (Reader::Markers(readers), AtRest::Markers(rest)) => {
                let MarkerReader { sensor, forces, .. } = &readers[fingertip % SENSORS];
                let stage = MarkerStage::new(sensor, forces.clone(), rest, gate)?;
                let touched = stage.touched_at_rest().len();
                if touched > 0 {
                    tracing::warn!(
                        "{}: {touched} of {} pictures show a contact or a motion and are left out",
                        rest.named,
                        rest.pictures.len()
                    );
                }
                Ok(Pipeline::of_markers(stage, rule))
            }
            _ => Err(self.of_another_kind()),
        }
    }

    /// The pipeline for a fingertip with particles, from 440×440 grey levels at rest; `None` when the sensor has markers.
    pub(crate) fn particle_pipeline(
        &self,
        fingertip: usize,
        rest: &[Vec<u8>],
        gate: GateKind,
        rule: TaxelRule,
    ) -> Option<Pipeline> {
        let Reader::Particles {
            network,
            calibrations,
        } = &self.reader
        else {
            return None;
        };
        let gain = calibrations[fingertip % SENSORS].gain;
        let network = network.as_ref().clone().with_gain(gain);
        Some(Pipeline::new(network, rest, gate, rule))
    }

    fn of_another_kind(&self) -> Error {
        Error::failed(format!(
            "sensor {}: found the rest pictures of another kind of sensor",
            self.sensor.identity()
        ))
    }

    /// Model, origin and fingerprint of its weights, for recordings.
    pub(crate) fn named(&self, rest: &AtRest) -> [String; 3] {
        match (&self.reader, rest) {
            (Reader::Particles { network, .. }, AtRest::Particles(crops)) => [
                network.architecture().to_string(),
                network.manifest().to_owned(),
                crops
                    .first()
                    .map_or_else(String::new, |crop| pipeline::fingerprint(network, crop)),
            ],
            (Reader::Particles { network, .. }, AtRest::Markers(_)) => [
                network.architecture().to_string(),
                network.manifest().to_owned(),
                String::new(),
            ],
            // Without gains, which stand beside it.
            (Reader::Markers(readers), _) => {
                let forces = readers[0].forces.clone().with_gain([1.0; 2]);
                [
                    forces.name().to_owned(),
                    forces.manifest(),
                    markers::fingerprint(&forces),
                ]
            }
        }
    }

    /// The calibrated values of each fingertip, for recordings.
    pub(crate) fn calibrations(&self) -> [FingertipCalibration; SENSORS] {
        match &self.reader {
            Reader::Particles { calibrations, .. } => *calibrations,
            Reader::Markers(readers) => readers.each_ref().map(|reader| reader.calibration),
        }
    }

    /// The description for recordings: identity, and the text where it is not the default's.
    pub(crate) fn described(&self) -> [String; 2] {
        [self.sensor.identity(), self.text.clone()]
    }

    /// A crop as a picture of a recording.
    pub(crate) fn image(&self, crop: Vec<u8>) -> Image {
        if !self.has_markers() {
            return Image::grey(CROP_SIDE, crop);
        }
        let [_, _, width, height] = self.sensor.capture.crop_px;
        Image {
            width,
            height,
            pixels: crop,
        }
    }

    /// Refuses a recording of another sensor by name.
    ///
    /// # Errors
    /// [`Error`] that names both.
    pub(crate) fn accepts(&self, metadata: &Metadata, file: &Path) -> Result<(), Error> {
        accepts(&self.sensor, metadata, file)
    }
}

/// Refuses a recording of another sensor than this one.
///
/// # Errors
/// [`Error`] that names both.
pub(crate) fn accepts(sensor: &Sensor, metadata: &Metadata, file: &Path) -> Result<(), Error> {
    // Older recordings name none, and are of the default one.
    let default = Sensor::default_one()?.identity();
    let recorded = if metadata.sensor.is_empty() {
        &default
    } else {
        &metadata.sensor
    };
    if *recorded == sensor.identity() {
        return Ok(());
    }
    Err(Error::failed(format!(
        "{}: found a recording of sensor {recorded}, expected one of {}: name its description with --sensor",
        file.display(),
        sensor.identity()
    )))
}

impl AtRest {
    /// Its pictures.
    pub(crate) fn pictures(&self) -> &[Vec<u8>] {
        match self {
            Self::Particles(crops) => crops,
            Self::Markers(rest) => &rest.pictures,
        }
    }

    /// Its source, for recordings; empty for particles, whose rest is always pictures.
    pub(crate) fn kind(&self) -> Option<RestKind> {
        match self {
            Self::Particles(_) => None,
            Self::Markers(rest) => Some(rest.kind),
        }
    }
}

/// A force network's name and the checksum of its weights.
pub(crate) fn network_named(network: &Network) -> String {
    format!("{} {}", network.architecture(), network.checksum())
}

/// A force model's name and fingerprint.
pub(crate) fn forces_named(forces: &MarkerForces) -> String {
    format!("{} {}", forces.name(), markers::fingerprint(forces))
}

/// The error for a calibration of another sensor.
fn of_another(calibration: &calibration::Calibration, section: &str, found: &str, sensor: &Sensor) -> Error {
    Error::usage(format!(
        "{}: {section}.sensor: found {found}, expected {}: name this sensor's calibration, or the other description with --sensor",
        calibration.path.display(),
        sensor.identity()
    ))
}

impl MarkerReader {
    /// For a camera with the calibrated `view`, if any; weights as named, else those of the description.
    fn new(
        sensor: &Sensor,
        weights: Option<&Path>,
        folder: Option<&Path>,
        view: Option<CalibratedView>,
    ) -> Result<Self, Error> {
        let mut sensor = sensor.clone();
        if let Some(view) = view {
            sensor.see_as(view.field_mm, view.distortion_per_mm2);
        }
        let forces = match weights {
            Some(file) => MarkerForces::from_file(file, &sensor)?,
            None => MarkerForces::for_sensor(&sensor, folder)?,
        };
        Ok(Self {
            sensor,
            forces,
            calibration: FingertipCalibration {
                view,
                ..FingertipCalibration::NONE
            },
        })
    }

    /// With these factors on shear and normal force.
    fn with_gain(mut self, gain: [f32; 2]) -> Self {
        self.calibration.gain = gain;
        self.forces = self.forces.with_gain(gain);
        self
    }
}

/// The view of this sensor's camera in a calibration.
fn view_of(sensor: &Sensor, calibration: &calibration::Calibration) -> Result<Option<CalibratedView>, Error> {
    let Some(camera) = &calibration.camera else {
        return Ok(None);
    };
    if camera.sensor != sensor.identity() {
        return Err(of_another(calibration, "camera", &camera.sensor, sensor));
    }
    Ok(Some(CalibratedView {
        field_mm: camera.field_mm,
        distortion_per_mm2: camera.distortion_per_mm2,
    }))
}

/// The gains on shear and normal force that the calibration of this sensor's gel found for these weights; 1 without one.
fn gain_of(
    sensor: &Sensor,
    calibration: Option<&calibration::Calibration>,
    named: impl FnOnce() -> String,
) -> Result<[f32; 2], Error> {
    let Some((calibration, gel)) = calibration.and_then(|all| all.gel.as_ref().map(|gel| (all, gel))) else {
        return Ok([1.0; 2]);
    };
    if gel.sensor != sensor.identity() {
        return Err(of_another(calibration, "gel", &gel.sensor, sensor));
    }
    let named = named();
    if gel.model != named {
        return Err(Error::usage(format!(
            "{}: gel.model: found {}, expected {named}: these gains are of other weights; run `gripline calibrate gel` again with \
             maps of the ones in use",
            calibration.path.display(),
            gel.model
        )));
    }
    Ok([gel.shear_gain as f32, gel.normal_gain as f32])
}

/// The gains on shear and normal force that a calibration of the shipped fingertip with particles has for this network.
///
/// # Errors
/// [`Error`] that names the file: no gel in it, or that of another sensor or of other weights.
pub(crate) fn particle_gain(
    calibration: &calibration::Calibration,
    network: &Network,
) -> Result<[f32; 2], Error> {
    if calibration.gel.is_none() {
        return Err(Error::usage(format!(
            "{}: found no section gel, expected the gains that `gripline calibrate gel` writes",
            calibration.path.display()
        )));
    }
    gain_of(&Sensor::default_one()?, Some(calibration), || {
        network_named(network)
    })
}

/// The shipped weights support one fingertip with particles.
fn known_particles(sensor: &Sensor) -> Result<(), Error> {
    if *sensor == Sensor::default_one()? {
        return Ok(());
    }
    Err(Error::failed(format!(
        "sensor {}: found other particles than those of {}, expected these: the force network knows no others; train one \
         (docs/own-sensor.md)",
        sensor.identity(),
        SHIPPED[0].0
    )))
}
