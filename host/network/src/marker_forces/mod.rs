//! Forces from printed markers: how far each marker has moved in, newtons per taxel out. The taxels are square and lie around the
//! middle of the sensor's view; x runs to the right and y up, as seen from outside.
//!
//! [`MarkerForces::for_sensor`] makes the model that a sensor's description names. `elastic-layer` ([`ElasticLayer`]) inverts the
//! gel's own elasticity and has learnt nothing. Units: mm, N, MPa.

mod elastic_layer;
mod kernel;
mod trained;

use gripline_sensor::Sensor;

pub use self::elastic_layer::{ElasticLayer, LayerSettings};
pub use self::trained::{
    FORCE_OUTPUTS, LEAK, MOTION_INPUTS, MOTION_NODES, MarkerNetwork, MarkerWeights, MotionGrid, mirrored,
};

use crate::constants::TAXELS;
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap};

/// A marker in one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerMotion {
    /// How far it is from where it is at rest, mm.
    pub moved_mm: [f32; 2],
    /// Whether the picture shows it; else its neighbours' motion stands for its own.
    pub is_seen: bool,
}

/// What makes forces of markers.
#[derive(Debug, Clone)]
pub enum MarkerForces {
    /// The inverse of the gel's elasticity.
    ElasticLayer(Box<ElasticLayer>),
}

impl MarkerForces {
    /// The model that the sensor's description names.
    ///
    /// # Errors
    /// [`NetworkError::UnknownForces`] when it names none that is known here.
    pub fn for_sensor(sensor: &Sensor) -> Result<Self, NetworkError> {
        match sensor.forces.weights.as_str() {
            ElasticLayer::NAME => Ok(Self::ElasticLayer(Box::new(ElasticLayer::new(
                &LayerSettings::of(sensor),
            )))),
            other => Err(NetworkError::UnknownForces {
                sensor: sensor.identity(),
                found: other.to_owned(),
            }),
        }
    }

    /// Sets where the markers are at rest, mm from the middle of the taxels: once, before [`Self::infer`], in the order of its
    /// motions.
    pub fn set_rest(&mut self, places_mm: &[[f32; 2]]) {
        match self {
            Self::ElasticLayer(layer) => layer.set_rest(places_mm),
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
        match self {
            Self::ElasticLayer(layer) => layer.infer(motions, touched, newtons),
        }
    }

    /// How the detector should read the maps.
    #[must_use]
    pub const fn calibration(&self) -> Calibration {
        match self {
            Self::ElasticLayer(_) => ElasticLayer::CALIBRATION,
        }
    }

    /// Where the numbers come from, in one line.
    #[must_use]
    pub fn manifest(&self) -> String {
        match self {
            Self::ElasticLayer(layer) => layer.manifest(),
        }
    }

    /// The model's name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::ElasticLayer(_) => ElasticLayer::NAME,
        }
    }
}
