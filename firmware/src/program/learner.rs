//! Learns from a map: slip state, contact geometry, load, friction, whether it slides, and the evidence of slip. This takes longer
//! than the map-to-line path may be blocked. So the map's sums are copied out, processed while the path is free, and the result is
//! copied back, unless a newer map came meanwhile. The learner keeps the state of earlier maps and never copies it.

use gripline_protocol::message::{MapSums, Witnesses};
use gripline_protocol::{Motion, PER_UNIT, SENSORS, SensorId};

use crate::clock::{DeviceMicros, HostMicros};
use crate::constants::FEED_FORWARD_FRICTION_MIN;
use crate::friction_estimator::{FrictionEstimator, LoadEstimate};
use crate::learning_settings::LearningSettings;
use crate::slide_witness::Verdict;
use crate::slip::{SlipDecision, SlipDetector, SlipSettings};
use crate::slip_evidence::SlipEvidence;
use crate::sums::total_shear;

/// The newest map of a fingertip.
#[derive(Debug, Clone, Copy)]
pub struct Lesson {
    pub(super) sensor: SensorId,
    /// Number of the map.
    pub(super) map: u32,
    pub(super) arrived_us: u64,
    pub(super) capture: HostMicros,
    pub(super) sums: MapSums,
    pub(super) motion: Motion,
    /// The force that the gripper should have reached; a map that sees less than half of it proves no friction.
    pub(super) reached: i32,
    pub(super) settings: LearningSettings,
    pub(super) slip_settings: SlipSettings,
}

/// The result of a lesson.
#[derive(Debug, Clone, Copy)]
pub struct Learnt {
    pub(super) sensor: SensorId,
    pub(super) map: u32,
    pub(super) decision: SlipDecision,
    pub(super) taught: Taught,
}

/// The results from a fingertip's maps that grip and status need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taught {
    pub(super) load: LoadEstimate,
    pub(super) reference: Reference,
    pub(super) verdict: Verdict,
    pub(super) slip_evidence: u16,
    pub(super) witnesses: Witnesses,
}

impl Default for Taught {
    fn default() -> Self {
        Self {
            load: LoadEstimate::default(),
            reference: Reference::default(),
            verdict: Verdict::NONE,
            slip_evidence: 0,
            witnesses: Witnesses::default(),
        }
    }
}

/// The reference for the next map before anything is learnt from it: more shear needs more force.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Reference {
    /// The shear in the map, and the force that its load needs, 1/4096 N.
    shear: i32,
    force: i32,
    /// Force for more shear, 2⁻¹⁶.
    slope: u32,
}

impl Reference {
    /// From a map with this load. It divides here, so that the map-to-line path need not.
    fn of(sums: &MapSums, load: &LoadEstimate, settings: LearningSettings) -> Self {
        let share = PER_UNIT + u32::from(settings.margin);
        let friction = u32::from(load.friction).max(FEED_FORWARD_FRICTION_MIN);
        // The margin is at most 4, so that the share fits 16 bits.
        let slope = (share.min(u16::MAX.into()) << 16) / friction;
        Self {
            shear: total_shear(sums),
            force: scaled(load.shear, slope),
            slope,
        }
    }

    /// The force that its load needs, 1/4096 N.
    pub(super) const fn force(&self) -> i32 {
        self.force
    }

    /// The additional force for this shear, 1/4096 N; 0 for less shear.
    #[inline]
    pub(super) fn more(&self, shear: i32) -> i32 {
        scaled(shear - self.shear, self.slope)
    }
}

/// A shear, at most 2²⁶, times a slope.
#[inline]
fn scaled(shear: i32, slope: u32) -> i32 {
    let product = u64::from(shear.max(0).cast_unsigned()) * u64::from(slope);
    (product >> 16).min(i32::MAX as u64) as i32
}

/// Processes lessons while the path is free. Keeps the state of earlier maps.
#[derive(Debug, Default)]
pub struct Learner {
    slip: [SlipDetector; SENSORS],
    friction: [FrictionEstimator; SENSORS],
    evidence: [SlipEvidence; SENSORS],
}

impl Learner {
    /// Processes a lesson.
    #[must_use]
    pub fn work(&mut self, lesson: &Lesson) -> Learnt {
        let Lesson { sums, settings, .. } = lesson;
        let settings = *settings;
        let at = lesson.sensor.index();
        let (friction, evidence) = (&mut self.friction[at], &mut self.evidence[at]);
        let slip = &mut self.slip[at];
        let decision = slip.decide(
            sums,
            lesson.capture,
            DeviceMicros(lesson.arrived_us),
            &lesson.slip_settings,
        );
        slip.observe(sums);
        if settings.learns() {
            friction.observe(sums, slip.geometry(), lesson.reached, lesson.arrived_us, settings);
            if sums.contact > 0 {
                friction.ask_witness(sums, lesson.motion, settings);
            }
        }
        let load = friction.estimate(settings);
        let verdict = friction.witness();
        evidence.observe(
            sums,
            decision,
            (lesson.motion, verdict.urgency),
            lesson.capture,
            lesson.slip_settings.leave,
        );
        Learnt {
            sensor: lesson.sensor,
            map: lesson.map,
            decision,
            taught: Taught {
                load,
                reference: Reference::of(sums, &load, settings),
                verdict,
                slip_evidence: evidence.joined(),
                witnesses: evidence.witnesses(),
            },
        }
    }
}
