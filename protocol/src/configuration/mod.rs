//! Everything that can be set on the microcontroller, and the range of each setting.
//!
//! Units: forces 1/4096 N, ratios and friction 1/10000, times and lengths as named. It travels in
//! the command `Configure` and lies in the microcontroller's flash.

mod ranges;
mod settings;
mod values;

pub use ranges::OutOfRange;
pub use settings::{CONFIGURATION_VERSION, Configuration, FORCE_MAX, FingertipGeometry};
pub use values::{CONFIGURATION_VALUES, Values};
