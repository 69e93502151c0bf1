//! `gripline detect`: the microcontroller's detector over recorded force maps.
//!
//! [`judge`] is the detector on one map, [`table`] the CSV and the summary, [`replay`] the microcontroller's whole
//! program for `--state` and `--line`;
//! Units: forces newtons in, 1/4096 N inside; moments N·mm about the centre of the 20×20 map.

pub mod judge;
pub mod replay;
pub mod table;
