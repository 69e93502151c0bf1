//! Both fingers on the object, by either model of the contact. Units as in `world`.

use std::sync::Arc;

use super::brush::BrushSolver;
use super::rigid_body::{Actions, RigidBody};
use super::setting::{ContactModel, GraspScene};
use super::solver::{Ending, GraspSolver, Outcome};
use crate::contact_world::{Contact, GelSurface, HeightMap, Mount, Triple, Truth};
use crate::error::SimulationError;

/// The other finger's view of a patch.
#[derive(Debug)]
struct MirroredPatch(Arc<dyn HeightMap>);

impl HeightMap for MirroredPatch {
    fn height_mm(&self, [x, y]: [f64; 2]) -> f64 {
        self.0.height_mm([-x, y])
    }
}

/// The fingers' contacts.
#[derive(Debug)]
pub(crate) enum Fingers {
    Layer(GraspSolver),
    Brush(Box<BrushSolver>),
}

impl Fingers {
    pub(crate) fn new(scene: &GraspScene, surface: &Arc<GelSurface>) -> Result<Self, SimulationError> {
        let patch = scene.object.patch.height_map();
        let mirrored: Arc<dyn HeightMap> = Arc::new(MirroredPatch(Arc::clone(&patch)));
        let (frictions, laws) = (scene.object.friction, &scene.friction_laws);
        let turn_rad = scene.object.patch_turn_rad;
        match scene.contact {
            ContactModel::Layer => {
                // One contact stands for both fingers if they are mirror images.
                let twins = frictions[0].to_bits() == frictions[1].to_bits() && laws[0] == laws[1];
                let count = if twins { 1 } else { 2 };
                let mut contacts = Vec::with_capacity(2);
                let sides = [patch, mirrored].into_iter().zip(frictions);
                for ((patch, friction), law) in sides.zip(laws).take(count) {
                    let contact = Contact::new(Arc::clone(surface), patch, friction, Mount::default())?;
                    contacts.push(contact.textured(law.texture).ending_with_the_grid());
                }
                Ok(Self::Layer(GraspSolver::new(contacts, turn_rad)))
            }
            ContactModel::Brush => {
                let sides = [
                    (patch, frictions[0], laws[0].texture),
                    (mirrored, frictions[1], laws[1].texture),
                ];
                let (gel, cells) = (*surface.gel(), surface.cells());
                let solver = BrushSolver::new(gel, cells, sides, turn_rad);
                Ok(Self::Brush(Box::new(solver)))
            }
        }
    }

    /// See [`Contact::vertical_pressure`]; a brush has no other.
    pub(crate) fn vertical_pressure(self) -> Self {
        match self {
            Self::Layer(solver) => Self::Layer(solver.vertical_pressure()),
            Self::Brush(solver) => Self::Brush(solver),
        }
    }

    pub(crate) fn truth(&self, finger: usize) -> Truth {
        match self {
            Self::Layer(solver) => solver.truth(finger),
            Self::Brush(solver) => solver.truth(finger).clone(),
        }
    }

    /// By how much the object slid over the gel in the last step, mm: see [`Contact::slip_mm`].
    pub(crate) fn slip_mm(&self, finger: usize) -> Triple {
        match self {
            Self::Layer(solver) => solver.contact(finger).0.slip_mm(),
            Self::Brush(solver) => solver.slip_mm(finger),
        }
    }

    pub(crate) fn gross_slip(&self, finger: usize) -> bool {
        match self {
            Self::Layer(solver) => solver.contact(finger).0.truth().gross_slip(),
            Self::Brush(solver) => solver.truth(finger).gross_slip(),
        }
    }

    pub(crate) fn mean_share(&self, finger: usize) -> f64 {
        match self {
            Self::Layer(solver) => solver.contact(finger).0.mean_share(),
            Self::Brush(solver) => solver.mean_share(finger),
        }
    }

    pub(crate) fn set_friction(&mut self, friction: [f64; 2]) {
        match self {
            Self::Layer(solver) => solver.set_friction(friction),
            Self::Brush(solver) => solver.set_friction(friction),
        }
    }

    pub(crate) fn friction_n(&self, grip_n: f64) -> f64 {
        match self {
            Self::Layer(solver) => solver.friction_n(grip_n),
            Self::Brush(solver) => solver.friction_n(grip_n),
        }
    }

    pub(crate) fn open(&mut self, pose: Triple) {
        match self {
            Self::Layer(solver) => solver.open(pose),
            Self::Brush(solver) => solver.open(pose),
        }
    }

    pub(crate) fn press(&mut self, grip_n: f64, pose: Triple) -> Result<Outcome, SimulationError> {
        match self {
            Self::Layer(solver) => solver.press(grip_n, pose),
            Self::Brush(solver) => solver.press(grip_n, pose),
        }
    }

    pub(crate) fn advance(
        &mut self,
        grip_n: f64,
        body: &RigidBody,
        actions: &Actions,
        reach_mm: f64,
    ) -> Result<Ending, SimulationError> {
        match self {
            Self::Layer(solver) => solver.advance(grip_n, body, actions, reach_mm),
            Self::Brush(solver) => solver.advance(grip_n, body, actions, reach_mm),
        }
    }
}
