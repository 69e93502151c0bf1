//! How a simulated policy's line goes to the force that it wants: fast up, slowly down, between a floor and a ceiling; and
//! what it expects of a load that rises. Units: N, s.

/// Fastest rise of the line, N/s: the firmware's.
const RISE_N_PER_S: f64 = 100.0;
/// Slowest and proportional fall: 3 N/s, or this share of what is too much each picture.
const FALL_N_PER_S: f64 = 3.0;
const FALL_SHARE: f64 = 0.12;
/// A rising load is expected this much later, when the gripper will have followed, s, and rises no faster, N/s.
const AHEAD_S: f64 = 0.12;
const LOAD_RISE_N_PER_S: f64 = 10.0;

/// A line that follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Follower {
    line_n: f64,
    /// Floor and ceiling.
    within_n: [f64; 2],
}

impl Follower {
    /// At its floor.
    pub(super) const fn new(floor_n: f64, ceiling_n: f64) -> Self {
        Self {
            line_n: floor_n,
            within_n: [floor_n, ceiling_n],
        }
    }

    /// Where it is.
    pub(super) const fn line_n(&self) -> f64 {
        self.line_n
    }

    /// Where it goes in `step_s` on its way to `wanted_n`.
    pub(super) fn follow(&mut self, wanted_n: f64, step_s: f64) -> f64 {
        let fall_n = (FALL_N_PER_S * step_s).max(FALL_SHARE * (self.line_n - wanted_n));
        let up_n = self.line_n + RISE_N_PER_S * step_s;
        self.line_n = wanted_n
            .clamp(self.line_n - fall_n, up_n)
            .clamp(self.within_n[0], self.within_n[1]);
        self.line_n
    }
}

/// A load that was `before_n` a picture ago, as it will be when the gripper has followed.
pub(super) fn rising(load_n: f64, before_n: f64, step_s: f64) -> f64 {
    load_n + AHEAD_S * ((load_n - before_n) / step_s).clamp(0.0, LOAD_RISE_N_PER_S)
}
