//! Checks of the test world that are too heavy for its own crate. [`finite_elements`] is the large-strain reference of
//! the gel; the program `physics` holds the world against closed forms, finite elements, an independent solver and its
//! own conservation laws. Units: mm, N, MPa, N·mm, rad.
#![forbid(unsafe_code)]

pub mod finite_elements;
