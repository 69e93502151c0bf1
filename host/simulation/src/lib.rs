//! The test world of Gripline: `contact_world` solves contact with friction of any indenter on the soft skin, `grasp`
//! holds objects between two such fingertips, and [`Fingertip`] pictures the skin's particles as its camera sees
//! them. The closed forms of [`SphereContact`] stay as checks. Units: mm, N, MPa (= N/mm²), N·mm, s. x and y lie in
//! the surface, z points into the skin. Forces are what the object exerts on the skin. Same seed, parameters and
//! calls: same images, bit for bit.
#![forbid(unsafe_code)]

mod camera;
mod camera_fault;
pub mod closed_form;
pub mod constants;
mod contact;
pub mod contact_world;
mod drawing;
mod error;
mod exposure;
mod field;
mod fingertip;
#[cfg(feature = "finite-elements")]
pub mod finite_elements;
mod gel;
pub mod grasp;
mod image;
mod jpeg;
mod lighting;
mod particles;
mod press_world;
mod random;
mod sample;
mod scene;
pub mod scene_file;
mod springs;

pub use camera::Camera;
pub use camera_fault::CameraFault;
pub use contact::{ContactState, ForceMap, Load, SphereContact, SphereParams};
pub use error::SimulationError;
pub use fingertip::{Fingertip, FingertipParams};
pub use gel::Gel;
pub use image::{Image, block_mean_88, crop_of_frame};
pub use lighting::{BrightnessMotion, Lighting};
pub use particles::SeenParticle;
pub use press_world::{PressFrame, PressProblem, PressWorld};
pub use random::Random;
pub use sample::{Costs, Counts, Crops, STRAIN_LIMIT, Sample, SampleGenerator, SampleWorld, Split};
pub use scene::{GripScene, SceneFrame};
