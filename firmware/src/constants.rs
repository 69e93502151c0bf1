//! Numbers of the detector, the controller and the safety rules that are not settings: unit, value, reason.

/// Maps in the trend's window: at 60 maps a second 130 ms, about the human reaction time.
pub const TREND_MAPS: usize = 8;
/// Longest time to slip that is reported, ms; a slower fall of the stick ratio is no trend.
pub const TIME_TO_SLIP_MAX_MS: u32 = 10_000;
/// Friction below which the feed-forward stops growing, 1/10000: at 0.05 it already asks for 20 times the shear.
pub const FEED_FORWARD_FRICTION_MIN: u32 = 500;
/// What a refused packet adds to the CRC-storm level; the level falls by 1 each millisecond.
pub const STORM_PER_PACKET: u32 = 10;
/// Level that raises CRC STORM: ten refused packets at once, or more than one in ten milliseconds for long.
pub const STORM_LEVEL: u32 = 100;
/// Highest storm level, so that a storm is over 200 ms after its last refused packet.
pub const STORM_LEVEL_MAX: u32 = 200;
/// Time between two statuses without a map, ms.
pub const STATUS_PERIOD_MS: u32 = 100;
/// Bound from the last packet in the FIFO to the line written, core cycles: 25 µs at 168 MHz.
pub const DECIDE_BUDGET_CYCLES: u32 = 4_200;
