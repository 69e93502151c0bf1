//! The sums of one force map: contact, stick, total force, moment, first and second moment of pressure.
//!
//! Units: forces 1/4096 N; places in half taxel pitches, odd numbers from −19 to 19 from the map's centre.
//! No branch on the forces, so the work depends on the number of taxels only. No sum can overflow: 400 taxels of 2¹⁵
//! at a distance of at most 19 give |Σ(x fy − y fx)| ≤ 400·38·2¹⁵ < 2³¹, and (x² + y²)/2 is 133 on average: 400·133·2¹⁵ < 2³¹.

mod accumulator;
mod kernel;
mod ratios;
mod whole_map;

pub use accumulator::{Accumulator, TaxelRule};
pub use kernel::{Kernel, Portable};
pub use ratios::{stick_ratio, stick_ratio_below, total_shear};
pub use whole_map::sums_of;
