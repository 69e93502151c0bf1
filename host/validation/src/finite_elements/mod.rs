//! A static large-strain reference of the soft layer under a sphere, to tell by how much the linear layer of
//! `contact_world` is wrong as the indentation grows: second-order Ogden rubber (`ogden`), mean-dilatation
//! hexahedra (`element`) on a graded quarter block (`mesh`), Newton with a sparse Cholesky (`sparse`, `rigid_body`),
//! contact without friction or stuck (`press`), and the comparison itself (`comparison`). Units: mm, N, MPa. Slow on purpose:
//! seconds per figure; nothing in the world calls it.

mod body;
mod comparison;
mod element;
mod error;
mod mesh;
mod ogden;
mod press;
mod sparse;

pub use comparison::{Both, COMPARED_DEPTHS_MM, Comparison, Displacements, Setting, compare_pressed_sphere};
pub use error::FiniteElementError;
pub use ogden::Ogden;
pub use press::{SpherePress, Surface};
