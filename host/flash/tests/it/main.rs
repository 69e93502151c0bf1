//! Images of every kind, and updates of a modelled bootloader: whole ones, and ones that fail at every point.

mod image;
mod model;
mod update;
