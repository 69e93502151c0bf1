//! The test world for gels with printed markers, as a sensor's file describes them: contacts on its gel, and where its markers
//! then are in the camera's picture. Units: mm, N, pixels. x runs along columns and y along rows of the crop, from its middle.
//!
//! Contacts are those of [`crate::contact_world`]. It knows one surface, 20×20 taxels of 1.6 mm; a linear layer has no length
//! of its own, so that surface stands for the sensor's taxels in another scale: lengths times `scale`, forces times its square,
//! the same moduli. Markers move as the field inside the gel does at their depth; what moves towards the camera also moves away
//! from the middle of its picture. Limits: those of the contact world; an endless layer instead of the pad's edges.

mod calibration;
mod contacts;
mod picture;
mod unit;

pub use calibration::{BallPress, PressedBall, PrintedBench};
pub use contacts::{PrintedContacts, PrintedSample};
pub use picture::PrintedPicture;
pub use unit::{PrintedUnit, UnitRange};

use std::sync::Arc;

use crate::constants::TAXEL_PITCH_MM;
use crate::contact_world::Truth;
use crate::error::SimulationError;
use crate::field::{DisplacementField, LayerKernels, MaterialPoint};
use crate::force_map::ForceMap;
use crate::gel::Gel;
use crate::sample::GelSurfaces;

/// A gel in the scale of the contact world, with what its contacts share: tenths of a second to make.
#[derive(Debug, Clone)]
pub struct PrintedGel {
    /// The gel in the sensor's own scale.
    gel: Gel,
    /// Lengths of the contact world over the sensor's.
    scale: f64,
    surfaces: GelSurfaces,
    kernels: Arc<LayerKernels>,
}

impl PrintedGel {
    /// `gel` with markers at `depth_mm` under taxels of `taxel_mm`.
    ///
    /// # Errors
    /// A gel constant outside its range.
    pub fn new(gel: &Gel, depth_mm: f64, taxel_mm: f64) -> Result<Self, SimulationError> {
        let scale = TAXEL_PITCH_MM / taxel_mm;
        let scaled = Gel {
            thickness_mm: gel.thickness_mm * scale,
            ..*gel
        };
        Ok(Self {
            gel: *gel,
            scale,
            surfaces: GelSurfaces::new(&scaled)?,
            kernels: Arc::new(LayerKernels::of_plane(&scaled, depth_mm * scale)),
        })
    }

    /// The gel.
    #[must_use]
    pub const fn gel(&self) -> &Gel {
        &self.gel
    }

    fn scaled_gel(&self) -> Gel {
        Gel {
            thickness_mm: self.gel.thickness_mm * self.scale,
            ..self.gel
        }
    }

    /// Newtons per taxel of a solved contact.
    fn forces_n(&self, truth: &Truth) -> ForceMap {
        let newtons = (1.0 / (self.scale * self.scale)) as f32;
        truth.force_map().map(|taxel| taxel.map(|force| force * newtons))
    }

    fn field(&self) -> DisplacementField {
        DisplacementField::new(Arc::clone(&self.kernels))
    }

    /// Displacement of the gel at `at_mm` in the markers' plane (z into the gel), mm.
    fn displacement_mm(&self, field: &DisplacementField, at_mm: [f64; 2]) -> [f64; 3] {
        field
            .at(&MaterialPoint::in_plane(at_mm.map(|mm| mm * self.scale)))
            .map(|mm| f64::from(mm) / self.scale)
    }
}
