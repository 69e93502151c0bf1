//! Fingertips with printed markers (GelSight Mini and its kin): from a colour picture to evidence of slip, without forces and
//! without friction.
//!
//! [`Tracker`] finds the markers with sub-pixel centres and follows each through a clip. [`Finger`] fills them in, subtracts the
//! picture at rest, and compares the imprint with itself some pictures ago, warped by the markers' motion: in the gel's own frame
//! a held object's imprint comes back unchanged however the gel is sheared; one that slides, turns or leaves does not. [`Hold`]
//! makes of all fingers' comparisons one number from 0 to 1 with its quality. Pure; positions are pixels of the crop, pixel
//! (0, 0) is centred on (0.5, 0.5). Limits: a square grid of markers in a plane, crops of multiples of four pixels.
#![forbid(unsafe_code)]

mod blobs;
mod constants;
mod error;
mod evidence;
mod finger;
mod grid;
mod imprint;
mod light;
mod motion;
mod plane;
mod tracker;

pub use constants::LAGS;
pub use error::MarkerError;
pub use evidence::{Comparison, Evidence, Hold};
pub use finger::{Doubt, Finger, Observation, Rest, RestKind};
pub use grid::Node;
pub use imprint::Filled;
pub use tracker::{Marker, Tracker};
