//! Forces from printed markers: how far each marker has moved in, newtons per taxel out. The taxels are square and lie around the
//! middle of the sensor's view; x runs to the right and y up, as seen from outside.
//!
//! [`MarkerForces::for_sensor`] makes the model that a sensor's description names. `elastic-layer` ([`ElasticLayer`]) inverts the
//! gel's own elasticity and has learnt nothing; a weights file holds a small network that the sensor's world has trained
//! ([`MarkerNetwork`]). A calibration's gains come last. Units: mm, N, MPa.

mod elastic_layer;
mod kernel;
mod motion;
mod trained;

use std::path::Path;

use gripline_sensor::Sensor;

pub use self::elastic_layer::{ElasticLayer, LayerSettings};
pub use self::motion::MarkerMotion;
pub use self::trained::{
    FORCE_OUTPUTS, HELD_OUT_MAX, LEAK, MOTION_INPUTS, MOTION_NODES, MarkerNetwork, MarkerWeights, MotionGrid,
    PULL, mirrored,
};

use crate::constants::TAXELS;
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap, scale_forces};
use crate::weights::{self, PARTICLE_FINGERTIP};

/// The weights that are built in, by the name that a description calls them.
const SHIPPED: [(&str, &[u8]); 1] = [(
    "gelsight-mini.safetensors",
    include_bytes!("../../weights/gelsight-mini.safetensors"),
)];

/// What makes forces of markers.
#[derive(Debug, Clone)]
pub struct MarkerForces {
    model: Model,
    /// Factors on shear and normal force, from a calibration of the very gel.
    gain: [f32; 2],
}

#[derive(Debug, Clone)]
enum Model {
    /// The inverse of the gel's elasticity.
    ElasticLayer(Box<ElasticLayer>),
    /// A network that the sensor's world has trained.
    Trained(Box<MarkerNetwork>),
}

impl MarkerWeights {
    /// Those that the sensor's description names: a file in `folder`, where the description lies, else a shipped one.
    ///
    /// # Errors
    /// [`NetworkError`] when it names no weights file, or one that cannot be used.
    pub fn for_sensor(sensor: &Sensor, folder: Option<&Path>) -> Result<Self, NetworkError> {
        let named = sensor.forces.weights.as_str();
        if Path::new(named)
            .extension()
            .is_none_or(|ending| ending != "safetensors")
        {
            return Err(NetworkError::UnknownForces {
                sensor: sensor.identity(),
                found: named.to_owned(),
            });
        }
        let file = folder.unwrap_or(Path::new("")).join(named);
        match SHIPPED.iter().find(|(name, _)| *name == named) {
            Some((name, bytes)) if !file.exists() => {
                Self::from_bytes(bytes, sensor).map_err(|problem| problem.in_weights(name))
            }
            _ => Self::from_file(&file, sensor),
        }
    }

    /// A weights file for this sensor.
    ///
    /// # Errors
    /// [`NetworkError`] when it cannot be read, is of another sensor, or holds no model of markers.
    pub fn from_file(path: &Path, sensor: &Sensor) -> Result<Self, NetworkError> {
        weights::read(path)
            .and_then(|bytes| Self::from_bytes(&bytes, sensor))
            .map_err(|problem| problem.in_weights(&path.display()))
    }

    fn from_bytes(bytes: &[u8], sensor: &Sensor) -> Result<Self, NetworkError> {
        let metadata = weights::metadata_of(bytes)?;
        // Weights that name no sensor are the particle fingertip's.
        let found = metadata.get("sensor").map_or(PARTICLE_FINGERTIP, String::as_str);
        if found != sensor.identity() {
            return Err(NetworkError::OtherSensor {
                found: found.to_owned(),
                expected: sensor.identity(),
            });
        }
        Self::parse(bytes)
    }
}

impl From<ElasticLayer> for MarkerForces {
    fn from(layer: ElasticLayer) -> Self {
        Self {
            model: Model::ElasticLayer(Box::new(layer)),
            gain: [1.0; 2],
        }
    }
}

impl From<MarkerNetwork> for MarkerForces {
    fn from(network: MarkerNetwork) -> Self {
        Self {
            model: Model::Trained(Box::new(network)),
            gain: [1.0; 2],
        }
    }
}

impl MarkerForces {
    /// The model that the sensor's description names; a weights file is looked for in `folder`, where the description lies, and
    /// among the shipped ones.
    ///
    /// # Errors
    /// [`NetworkError`] when it names none that is known, or weights that cannot be used.
    pub fn for_sensor(sensor: &Sensor, folder: Option<&Path>) -> Result<Self, NetworkError> {
        if sensor.forces.weights == ElasticLayer::NAME {
            return Ok(ElasticLayer::new(&LayerSettings::of(sensor)).into());
        }
        let weights = MarkerWeights::for_sensor(sensor, folder)?;
        Ok(MarkerNetwork::new(&weights)?.into())
    }

    /// A weights file for this sensor.
    ///
    /// # Errors
    /// [`NetworkError`] when it cannot be read, is of another sensor, or holds no model of markers.
    pub fn from_file(path: &Path, sensor: &Sensor) -> Result<Self, NetworkError> {
        let weights = MarkerWeights::from_file(path, sensor)?;
        Ok(MarkerNetwork::new(&weights)?.into())
    }

    /// The same with other factors on shear and normal force: a calibration's.
    #[must_use]
    pub fn with_gain(self, gain: [f32; 2]) -> Self {
        Self { gain, ..self }
    }

    /// Sets where the markers are at rest, mm from the middle of the taxels: once, before [`Self::infer`], in the order of its
    /// motions.
    pub fn set_rest(&mut self, places_mm: &[[f32; 2]]) {
        match &mut self.model {
            Model::ElasticLayer(layer) => layer.set_rest(places_mm),
            Model::Trained(network) => network.set_rest(places_mm),
        }
    }

    /// The forces that moved the markers. `touched` says which taxels the imprint shows in contact, where that is known.
    ///
    /// # Panics
    /// When there are not as many motions as places at rest.
    pub fn infer(
        &mut self,
        motions: &[MarkerMotion],
        touched: Option<&[bool; TAXELS]>,
        newtons: &mut ForceMap,
    ) {
        match &mut self.model {
            Model::ElasticLayer(layer) => layer.infer(motions, touched, newtons),
            Model::Trained(network) => network.infer(motions, newtons),
        }
        scale_forces(newtons, self.gain);
    }

    /// How the detector should read the maps.
    #[must_use]
    pub const fn calibration(&self) -> Calibration {
        match &self.model {
            Model::ElasticLayer(_) => ElasticLayer::CALIBRATION,
            Model::Trained(network) => network.calibration(),
        }
    }

    /// Where the numbers come from, in one line.
    #[must_use]
    pub fn manifest(&self) -> String {
        match &self.model {
            Model::ElasticLayer(layer) => layer.manifest(),
            Model::Trained(network) => network.manifest().to_owned(),
        }
    }

    /// The model's name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match &self.model {
            Model::ElasticLayer(_) => ElasticLayer::NAME,
            Model::Trained(_) => trained::ARCHITECTURE,
        }
    }
}
