//! Copies the newest map out for the [`Learner`](super::Learner), and the result back.

use gripline_protocol::{Health, SensorId};

use super::dispatch::Program;
use super::learner::{Learnt, Lesson};
use crate::learning_settings::LearningSettings;
use crate::slip::SlipSettings;
use crate::sums::Kernel;

impl<K: Kernel> Program<K> {
    /// The newest map of a fingertip to learn from; one fingertip at a time. Call it before every tick, and before a status about
    /// the map. [`Program::learn`] takes the result of [`Learner::work`](super::Learner::work).
    #[inline(never)]
    pub fn lesson(&self, lesson: &mut Option<Lesson>) {
        let [one, other] = &self.fingertips;
        let (sensor, tip) = if one.is_due {
            (SensorId::FIRST, one)
        } else {
            (SensorId::SECOND, other)
        };
        if !tip.is_due {
            *lesson = None;
            return;
        }
        // Forces that did not fit the wire prove no friction, whatever the gripper's.
        let reached = if tip.health.has(Health::SATURATED) {
            i32::MAX
        } else {
            self.controller.reached().lsb()
        };
        *lesson = Some(Lesson {
            sensor,
            map: tip.map,
            arrived_us: tip.arrived_us,
            capture: tip.capture,
            sums: tip.sums,
            motion: tip.motion,
            reached,
            settings: LearningSettings::of(&self.settings),
            slip_settings: SlipSettings::of(&self.settings),
        });
    }

    /// Takes the result of a lesson. It is dropped if the fingertip has sent a newer map meanwhile, which will be learnt from
    /// instead.
    #[inline(never)]
    pub fn learn(&mut self, learnt: &Learnt) {
        let tip = &mut self.fingertips[learnt.sensor.index()];
        if !tip.is_due || tip.map != learnt.map {
            return;
        }
        tip.is_due = false;
        tip.decision = learnt.decision;
        tip.taught = learnt.taught;
        tip.is_news = true;
        let state = self.state_within(u64::from(self.settings.stale_ms) * 1_000);
        self.controller.judge(state);
    }
}
