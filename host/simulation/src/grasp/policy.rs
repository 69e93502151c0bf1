//! Who decides on the grip force: any detector and controller behind one trait, and two policies for
//! comparison. Units: N, s.

use super::frame::GraspFrame;
use super::world::GraspWorld;
use crate::error::SimulationError;
use crate::image::Image;

/// Something that sets the grip-force line once per frame.
pub trait GripPolicy {
    /// The line for the next frame, N, 0 or above.
    fn line_n(&mut self, now: &mut GraspView) -> f64;
}

/// What a policy may look at. Pictures cost time and are made only when asked for; the truth is there for
/// oracles and for the record.
#[derive(Debug)]
pub struct GraspView<'a> {
    pub(super) world: &'a mut GraspWorld,
}

impl GraspWorld {
    /// Runs for `duration_s` at `dt_s` per frame with the line that `policy` asks for; `each` sees every frame and
    /// may end the run by returning false.
    ///
    /// # Errors
    /// Those of [`Self::step`].
    pub fn run(
        &mut self,
        policy: &mut dyn GripPolicy,
        dt_s: f64,
        duration_s: f64,
        mut each: impl FnMut(&GraspFrame) -> bool,
    ) -> Result<(), SimulationError> {
        let frames = (duration_s / dt_s).round() as usize;
        for _ in 0..frames {
            let line_n = policy.line_n(&mut GraspView { world: self });
            if !each(self.step(dt_s, line_n)?) {
                break;
            }
        }
        Ok(())
    }
}

impl GraspView<'_> {
    /// Time since the scene began, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.world.frame().time_s
    }

    /// What the fingers press with now, N.
    #[must_use]
    pub fn grip_n(&self) -> f64 {
        self.world.frame().grip_n
    }

    /// The camera's crop of a finger, with fresh noise: ask once per frame.
    ///
    /// # Errors
    /// Parameters that the fingertip refuses.
    ///
    /// # Panics
    /// When `finger` is not 0 or 1.
    pub fn render(&mut self, finger: usize, out: &mut Image) -> Result<(), SimulationError> {
        self.world.render(finger, out)
    }

    /// All that is true.
    #[must_use]
    pub fn truth(&self) -> &GraspFrame {
        self.world.frame()
    }
}

/// The same force always.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedForce(pub f64);

impl GripPolicy for FixedForce {
    fn line_n(&mut self, _: &mut GraspView) -> f64 {
        self.0
    }
}

/// Knows the truth: what friction needs for the shear that it feels now, with a margin, and more while the
/// contact sticks too little. It does not know what comes next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oracle {
    /// True friction, the smaller of both fingers'.
    pub friction: f64,
    /// Share of force above the least one.
    pub margin: f64,
    /// Least line, N.
    pub floor_n: f64,
    /// Stick ratio under which it grips harder.
    pub stick_ratio: f64,
    /// How much harder then, N per frame.
    pub step_n: f64,
    reflex_n: f64,
}

impl Oracle {
    /// With a margin of 40 % and a reflex of 0.3 N per frame below a stick ratio of 0.6.
    #[must_use]
    pub fn new(friction: f64, floor_n: f64) -> Self {
        Self {
            friction,
            margin: 0.4,
            floor_n,
            stick_ratio: 0.6,
            step_n: 0.3,
            reflex_n: 0.0,
        }
    }
}

impl GripPolicy for Oracle {
    fn line_n(&mut self, now: &mut GraspView) -> f64 {
        let fingers = &now.truth().fingers;
        if !fingers.iter().any(|finger| finger.touching) {
            self.reflex_n = 0.0;
            return self.floor_n;
        }
        let mut needed = 0.0_f64;
        for finger in fingers {
            let [fx, fy, _] = finger.force_n;
            needed = needed.max(fx.hypot(fy) / self.friction * (1.0 + self.margin));
            if finger.stick_ratio.is_some_and(|ratio| ratio < self.stick_ratio) {
                self.reflex_n += self.step_n;
            }
        }
        (needed + self.reflex_n).max(self.floor_n)
    }
}
