//! What a map teaches: slip state, contact geometry, load, friction, whether it slides, and the evidence of slip. It takes longer than the
//! map-to-line path may be blocked. So the map's sums are copied out, worked on with the path free, and the result is copied back, unless
//! a newer map came meanwhile. What was learnt before lies with the worker and is never copied.

use gripline_protocol::message::{MapSums, Witnesses};
use gripline_protocol::{Motion, SENSORS};

use super::dispatch::Program;
use crate::friction_estimator::{FrictionEstimator, LoadEstimate};
use crate::learning_settings::LearningSettings;
use crate::slide_witness::Verdict;
use crate::slip::{SlipDecision, SlipDetector, SlipSettings};
use crate::slip_evidence::SlipEvidence;
use crate::sums::Kernel;

/// The newest map of a fingertip.
#[derive(Debug, Clone, Copy)]
pub struct Lesson {
    sensor: usize,
    /// Number of the map.
    map: u32,
    arrived_us: u64,
    capture_us: u32,
    sums: MapSums,
    motion: Motion,
    /// The force that the gripper should have reached.
    reached: i32,
    settings: LearningSettings,
    slip_settings: SlipSettings,
}

/// What came of a lesson.
#[derive(Debug, Clone, Copy)]
pub struct Learnt {
    sensor: usize,
    map: u32,
    decision: SlipDecision,
    taught: Taught,
}

/// What the maps of a fingertip have taught, as far as grip and status need it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taught {
    pub(super) load: LoadEstimate,
    pub(super) verdict: Verdict,
    pub(super) slip_evidence: u16,
    pub(super) witnesses: Witnesses,
}

impl Default for Taught {
    fn default() -> Self {
        Self {
            load: LoadEstimate::default(),
            verdict: Verdict::NONE,
            slip_evidence: 0,
            witnesses: Witnesses::default(),
        }
    }
}

/// Works on lessons, with the path free. Keeps what the maps before have taught.
#[derive(Debug, Default)]
pub struct Learner {
    slip: [SlipDetector; SENSORS],
    friction: [FrictionEstimator; SENSORS],
    evidence: [SlipEvidence; SENSORS],
}

impl Learner {
    /// Works on a lesson.
    #[must_use]
    pub fn work(&mut self, lesson: &Lesson) -> Learnt {
        let Lesson { sums, settings, .. } = lesson;
        let sensor = lesson.sensor % SENSORS;
        let (friction, evidence) = (&mut self.friction[sensor], &mut self.evidence[sensor]);
        let slip = &mut self.slip[sensor];
        let decision = slip.decide(sums, lesson.capture_us, lesson.arrived_us, &lesson.slip_settings);
        slip.observe(sums);
        if settings.learns() {
            friction.observe(sums, slip.geometry(), lesson.reached, lesson.arrived_us, settings);
            if sums.contact > 0 {
                friction.ask_witness(sums.force[2], lesson.motion, settings);
            }
        }
        let verdict = friction.witness();
        evidence.observe(
            sums,
            decision,
            (lesson.motion, verdict.urgency),
            lesson.capture_us,
            lesson.slip_settings.leave,
        );
        Learnt {
            sensor,
            map: lesson.map,
            decision,
            taught: Taught {
                load: friction.estimate(settings),
                verdict,
                slip_evidence: evidence.joined(),
                witnesses: evidence.witnesses(),
            },
        }
    }
}

impl<K: Kernel> Program<K> {
    /// What the newest map of a fingertip has to teach; one fingertip at a time. To be asked for before every tick, and before a status
    /// is to tell of the map. [`Program::learn`] takes what [`Learner::work`] makes of it.
    #[inline(never)]
    pub fn lesson(&self, lesson: &mut Option<Lesson>) {
        let [one, other] = &self.fingertips;
        let (sensor, tip) = if one.is_due { (0, one) } else { (1, other) };
        if !tip.is_due {
            *lesson = None;
            return;
        }
        *lesson = Some(Lesson {
            sensor,
            map: tip.map,
            arrived_us: tip.arrived_us,
            capture_us: tip.capture_us,
            sums: tip.sums,
            motion: tip.motion,
            reached: self.controller.reached().lsb(),
            settings: LearningSettings::of(&self.settings),
            slip_settings: SlipSettings::of(&self.settings),
        });
    }

    /// Takes what a lesson came to. One whose fingertip has sent a newer map meanwhile is left: that map teaches the same.
    #[inline(never)]
    pub fn learn(&mut self, learnt: &Learnt) {
        let tip = &mut self.fingertips[learnt.sensor % SENSORS];
        if !tip.is_due || tip.map != learnt.map {
            return;
        }
        tip.is_due = false;
        tip.decision = learnt.decision;
        tip.taught = learnt.taught;
        tip.is_news = true;
        let state = self.evidence(u64::from(self.settings.stale_ms) * 1_000).state;
        self.controller.judge(state);
    }
}
