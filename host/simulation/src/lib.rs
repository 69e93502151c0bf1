//! The test world of Gripline: `contact_world` solves contact with friction of any indenter on the soft gel, `grasp`
//! holds objects between two such fingertips, and [`Fingertip`] pictures the gel's particles as its camera sees
//! them; [`closed_form`] holds the textbook solutions that check both. Units: mm, N, MPa (= N/mm²), N·mm, s. x and y lie in
//! the surface, z points into the gel. Forces are what the object exerts on the gel. Same seed, parameters and
//! calls: same images, bit for bit.
#![forbid(unsafe_code)]

mod camera;
mod camera_fault;
pub mod closed_form;
pub mod constants;
pub mod contact_world;
mod drawing;
mod error;
mod exposure;
mod field;
mod fingertip;
mod force_map;
mod gel;
pub mod grasp;
mod image;
mod jpeg;
mod lighting;
mod particles;
mod press_world;
pub mod printed;
mod random;
mod sample;
mod scene;
pub mod scene_file;

pub use camera::Camera;
pub use camera_fault::CameraFault;
pub use error::SimulationError;
pub use field::{DisplacementField, LayerKernels, MaterialPoint};
pub use fingertip::{Fingertip, FingertipParams};
pub use force_map::{ForceMap, Load};
pub use gel::Gel;
pub use image::{Image, block_mean_88, crop_of_frame};
pub use lighting::{BrightnessMotion, Lighting};
pub use particles::SeenParticle;
pub use press_world::{PressFrame, PressProblem, PressWorld};
pub use random::Random;
pub use sample::{Costs, Counts, Crops, STRAIN_LIMIT, Sample, SampleGenerator, SampleWorld, Split};
pub use scene::{GripScene, SceneFrame};
