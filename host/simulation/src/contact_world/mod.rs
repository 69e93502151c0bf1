//! Contact with friction of any rigid indenter on the gel, along any path of pressing, dragging, twisting and
//! tilting: who touches, who sticks, who slips, and the force map that a perfect sensor would report. Units:
//! mm, N, MPa, N·mm, rad. Limits: linear layer, small strain (see `LARGEST_INDENTATION`),
//! Coulomb friction with a coefficient for each place, quasi-static.
//!
//! From the bottom up: `influence` (one cell's traction to displacement), `convolution` (all cells of a box),
//! `gel_surface` (what contacts share), `window` (the cells that a step solves for), `normal` and `tangential` (the two
//! problems of a step), `stiffness` (how shear grows with motion), `solver` (the step and its history), `truth` (what a step is asked for), `shapes` (indenters), `texture` (friction from place to place),
//! `height_file` (indenters from files).

mod convolution;
mod height_file;
mod influence;
mod normal;
mod shapes;
mod solver;
mod stiffness;
mod surface;
mod tangential;
mod texture;
mod truth;
mod window;

pub(crate) use convolution::Pair;
pub use height_file::HeightFileError;
pub use normal::Press;
pub use shapes::{GridShape, HeightMap, Interpolation, Shape, TRAINING_SHAPES, UNSEEN_SHAPES, WALL_MM};
pub(crate) use solver::Step;
pub use solver::{Contact, Drive, Mount};
pub(crate) use stiffness::{Matrix, Stiffness, Triple, add, dot, solved, sub};
pub use surface::{GelSurface, production_cells};
pub use texture::Texture;
pub use truth::{CellState, Pose, Residuals, Truth};
