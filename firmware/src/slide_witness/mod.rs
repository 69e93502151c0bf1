//! Whether the contact of one fingertip slides, found without knowing its friction: a load that is held does not change when the
//! grip changes, a load that slides changes with it.
//!
//! The witness remembers the load. It suspects a slide when the shear falls below that, sinks while the grip sinks, or settles
//! for the first time below the detector's friction. A suspicion is a test: the grip rises, and while the shear rises with
//! it, the contact slides, and shear over normal force is its friction. Shear that stays is held: the test has passed. Until a test of a
//! contact that never carried more than the detector's friction, and again when its load has grown by a quarter, the line does not fall.
//!
//! Where the host sees the object, no test is needed: motion is a slide at once, and rest ends every suspicion ([`Motion`]).
//!
//! A load that suddenly falls in a quiet hold and stays there may have moved to another finger that nobody feels: it is still to be held, until
//! it is felt again, and forgotten as slowly as proven friction.
//!
//! Units: force 1/4096 N, ratios 1/10000, shares 1/1024, time µs. The laws follow an own study of a thousand simulated grasps.
//! Limits: a slide that keeps the shear as it was (friction that falls by less than the margin) shows only when the grip falls.
//! One below [`SLIDING_FRICTION_MIN`](crate::constants::SLIDING_FRICTION_MIN) or a quarter of what the contact carried is never believed. A load that grows evenly with the
//! grip of a test is taken for a slide, and held too firmly, unless it soon falls as low again under more force; one that grows while the
//! grip stays is not. After a slide, friction that falls further is found only where the shear falls suddenly, or by what holds it: the limit
//! and its margin.
//!
//! | file | what |
//! |---|---|
//! | `slots` | shear and normal force over the last slots of time |
//! | `mod` | what is remembered, and what speaks for a slide |
//! | `suspicion`, `slide_test` | a test: what it has seen, and its laws |
//! | `fading`, `moved_load` | friction that falls slowly; a load that another finger may have taken over |
//! | `verdict` | what the grip is told |

mod fading;
mod moved_load;
mod slide_test;
mod slots;
mod suspicion;
#[cfg(test)]
mod tests;
mod verdict;

use gripline_protocol::message::MapSums;
use gripline_protocol::{Motion, PER_UNIT};

use self::fading::{Fading, sink_together};
use self::moved_load::MovedLoad;
use self::slots::Slots;
use self::suspicion::{Suspicion, Test, UNLIMITED};
pub(crate) use self::verdict::JointTest;
pub use self::verdict::{Finding, Urgency, Verdict};
use crate::arithmetic::{change, divide, part, ratio};
use crate::constants::{
    CALM_US, COME_BACK_US, DROP_SHARE, FAST_SLIDE_SHARE, GROWN_SHARE, NEWS_SHARE, NOISE_MAX,
    QUIET_DROP_SHARE, RECENT_FALL_SHARE, RISES_SHARE, SETTLED_US, SHEAR_ERROR_PART, SHORT_SHARE_MAX,
    SHORT_SHARE_MIN, SHORT_US, SINK_SHARE, SLIDING_RATIO_MIN, STALLED_US, SUDDEN_DROP_SHARE, UNTRIED_US,
    WATCHED_US, WHOLE_STICK_RATIO, WITNESSED_LOAD_MIN,
};
use crate::learning_settings::LearningSettings;
use crate::sums::stick_ratio_below;

/// The witness of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SlideWitness {
    slots: Slots,
    /// The load to hold: the highest of late, slowly forgotten.
    load: i32,
    /// Mean change of the shear from slot to slot beside its growth, share of the load in 16ths.
    noise_16ths: i32,
    /// Friction is no more than this, since a slide.
    limit: u16,
    /// A test has found a slide by the shear since the contact began, and it was not taken back.
    has_slid: bool,
    /// Time since something last spoke for a slide, and since the shear fell short of the load.
    calm_us: u32,
    short_us: u32,
    /// No new test for so long, from this normal force on.
    hush_us: u32,
    held_normal: i32,
    test: Option<Test>,
    /// The last test, if it found a slide that may be taken back; `for_us` is the time since its end.
    found: Option<Test>,
    finding: Finding,
    is_short: bool,
    /// The ratio at which the last test of late began whose load came back, 0 when there is none.
    came_back: u16,
    fading: Fading,
    /// The highest ratio carried since the contact began or a slide was found.
    carried: u16,
    /// The highest load since the contact began, the time since it last grew, and the load at which that was last tested.
    peak: i32,
    settled_us: u32,
    /// Time since the ratio last grew.
    stalled_us: u32,
    tested: i32,
    /// How long no test has tried what the contact carries.
    untried_us: u32,
    /// By the detector's friction the contact sticks, in the newest map.
    sticks: bool,
    /// What the host saw in the slot in progress, or in the last one.
    seen: Motion,
    /// How long it still counts that the host has seen the object.
    watched_us: u32,
    moved_load: MovedLoad,
}

impl Default for SlideWitness {
    fn default() -> Self {
        Self {
            slots: Slots::default(),
            load: 0,
            noise_16ths: 0,
            limit: UNLIMITED,
            has_slid: false,
            calm_us: 0,
            short_us: 0,
            hush_us: 0,
            held_normal: 0,
            test: None,
            found: None,
            finding: Finding::Held,
            is_short: false,
            came_back: 0,
            fading: Fading::default(),
            carried: 0,
            peak: 0,
            settled_us: 0,
            stalled_us: 0,
            tested: 0,
            untried_us: 0,
            sticks: true,
            seen: Motion::UNKNOWN,
            watched_us: 0,
            moved_load: MovedLoad::default(),
        }
    }
}

impl SlideWitness {
    /// Takes a map's load and sums, `since_us` after the map before. `friction` is the friction that the grip counts on.
    pub(crate) fn observe(
        &mut self,
        load: i32,
        sums: &MapSums,
        since_us: u16,
        seen: Motion,
        friction: u16,
        settings: LearningSettings,
    ) {
        // Above 70 maps a second a slot has several: motion in any of them counts, rest only in all.
        let is_worse = seen.shows_motion() || !self.seen.shows_motion() && !seen.shows_rest();
        if self.slots.begins() || is_worse {
            self.seen = seen;
        }
        self.sticks = !stick_ratio_below(sums, WHOLE_STICK_RATIO);
        if let Some(passed_us) = self.slots.add(load, sums.force[2], since_us) {
            self.step(passed_us, friction, settings);
        }
    }

    /// After the contact has ended, which ends a test without a finding.
    pub(crate) fn without_contact(&self) -> Self {
        Self {
            finding: if self.test.is_some() {
                Finding::Open
            } else {
                Finding::Held
            },
            ..Self::default()
        }
    }

    /// This time, µs, passed without a map, beyond what the slots take.
    pub(crate) fn miss(&mut self, passed_us: u32) {
        self.watched_us = self.watched_us.saturating_sub(passed_us);
    }

    /// A slot has passed.
    fn step(&mut self, passed_us: u32, friction: u16, settings: LearningSettings) {
        let [shear, normal] = self.slots.newest();
        self.hush_us = self.hush_us.saturating_sub(passed_us);
        self.watched_us = if self.seen.shows_motion() || self.seen.shows_rest() {
            WATCHED_US
        } else {
            self.watched_us.saturating_sub(passed_us)
        };
        self.doubt_slide(normal, passed_us);
        let felt = self.test.is_none().then_some(shear);
        self.moved_load.forget(felt, passed_us);
        let changes = self.slots.changes();
        if let Some(test) = self.test {
            self.continue_test(test, [shear, normal], changes, passed_us);
        } else {
            let suspicion = self.suspicion([shear, normal], changes, passed_us, settings.friction);
            let suspects = suspicion != Suspicion::None;
            let was_calm = self.calm_us > COME_BACK_US;
            self.calm_us = if suspects {
                0
            } else {
                self.calm_us.saturating_add(passed_us)
            };
            if suspects && !self.is_hushed(suspicion, normal) {
                if suspicion == Suspicion::Settled {
                    self.tested = shear;
                }
                self.begin_test(normal, friction, suspicion, was_calm, settings);
            } else {
                self.remember(shear, normal);
            }
        }
        let needed =
            u64::from(self.load.max(0).cast_unsigned()) * u64::from(PER_UNIT + u32::from(settings.margin));
        let held = u64::from(normal.max(0).cast_unsigned()) * u64::from(self.limit);
        self.is_short = held < needed;
    }

    /// Whether a suspicion is no news: what a test found held is held at that normal force. More load, and shear that falls far, are news.
    fn is_hushed(&self, suspicion: Suspicion, normal: i32) -> bool {
        suspicion == Suspicion::Falling
            && !self.has_fallen_by(self.slots.shear[0], NEWS_SHARE)
            && self.hush_us > 0
            && normal >= self.held_normal
    }

    /// Whether a shear is less than the load by more than this share, in 1/1024.
    const fn has_fallen_by(&self, shear: i32, share: i32) -> bool {
        shear < self.load - part(self.load, share)
    }

    /// What speaks for a slide.
    fn suspicion(
        &mut self,
        [shear, normal]: [i32; 2],
        changes: [i32; 2],
        passed_us: u32,
        detector: u16,
    ) -> Suspicion {
        if shear - self.peak > self.peak / 50 {
            self.settled_us = 0;
        } else {
            self.settled_us = self.settled_us.saturating_add(passed_us);
        }
        self.peak = self.peak.max(shear);
        let now = ratio(shear, normal);
        self.stalled_us = if now > self.carried.saturating_add(self.carried / 32) {
            0
        } else {
            self.stalled_us.saturating_add(passed_us)
        };
        self.carried = self.carried.max(now);
        // A smaller share of the normal force cannot be tested. As the line falls, the share grows. What has been tested once slides only
        // while all taxels stick by the detector's friction.
        let is_untried = self.load >= WITNESSED_LOAD_MIN
            && now >= SLIDING_RATIO_MIN
            && self.carried < detector
            && (self.tested == 0 || self.sticks && 5 * self.tested < 4 * self.load);
        self.untried_us = if is_untried {
            self.untried_us.saturating_add(passed_us)
        } else {
            0
        };
        if self.seen.shows_motion() && self.load >= WITNESSED_LOAD_MIN {
            return Suspicion::Seen;
        }
        if self.load < WITNESSED_LOAD_MIN || now < SLIDING_RATIO_MIN {
            return Suspicion::None;
        }
        let below = |value: i32, share: i32, error_part: i32| {
            // What a map makes of a shear errs by a part of the normal force, too.
            value < self.load - part(self.load, share).max(normal / error_part)
        };
        let noise = 3 * self.noise();
        let has_fallen = self.slots.recent_fall(self.load) > RECENT_FALL_SHARE;
        let sudden = SUDDEN_DROP_SHARE.max(noise + noise / 2);
        // In a quiet hold less of a fall is clear.
        let quiet = (QUIET_DROP_SHARE + noise).min(DROP_SHARE);
        let drops = has_fallen
            && (below(shear, quiet.max(noise), SHEAR_ERROR_PART)
                || below(self.slots.shear[0], sudden, SHEAR_ERROR_PART));
        self.short_us = if below(shear, self.short_share(), 2 * SHEAR_ERROR_PART) {
            self.short_us.saturating_add(passed_us)
        } else {
            0
        };
        let sinks = self.slots.are_filled()
            && sink_together(changes, SINK_SHARE)
            && below(shear, noise / 2, 2 * SHEAR_ERROR_PART);
        let fades = self.fading.fades(shear, normal);
        if self.seen.shows_rest() {
            return Suspicion::None;
        }
        // All taxels of such a load stick by the detector's friction, also while they slide.
        // A load far below what the contact has carried, or below what a slide left of its friction, slides only after a fall; one
        // that stays while the grip sinks is held.
        // What slides stays near the most that it carried, and does not grow alone. A load that has grown by an eighth since its test is then
        // tested again.
        let has_stalled = self.limit == UNLIMITED
            && self.stalled_us > STALLED_US
            && 8 * u32::from(now) > 7 * u32::from(self.carried);
        let has_settled = self.settled_us > SETTLED_US && 4 * shear > 5 * self.tested;
        let is_low = (has_settled || has_stalled && 8 * shear > 9 * self.tested)
            && now < detector
            && self.sticks
            && 5 * u32::from(now) > 3 * u32::from(self.carried)
            && (self.limit == UNLIMITED || 10 * u32::from(now) > 9 * u32::from(self.limit))
            && !stays_while_the_grip_sinks(changes)
            && !self.grows_alone(changes);
        let is_overdue = self.untried_us > UNTRIED_US && self.settled_us > SETTLED_US;
        if drops || sinks || fades || self.short_us >= SHORT_US {
            Suspicion::Falling
        } else if is_low || is_overdue {
            Suspicion::Settled
        } else {
            Suspicion::None
        }
    }

    /// Whether the shear has risen while the normal force stayed as it was. What slides carries no more for the same normal force.
    fn grows_alone(&self, [of_shear, of_normal]: [i32; 2]) -> bool {
        of_normal <= RISES_SHARE && of_shear > GROWN_SHARE.max(3 * self.noise())
    }

    /// Mean change of the shear from slot to slot beside its growth, share of the load in 1/1024.
    const fn noise(&self) -> i32 {
        self.noise_16ths / 16
    }

    /// By how much the shear may lie below the load for long: its noise, and a little.
    fn short_share(&self) -> i32 {
        (SHORT_SHARE_MIN + self.noise()).min(SHORT_SHARE_MAX)
    }

    /// Nothing slides: what is carried is the load, and slowly forgotten.
    fn remember(&mut self, shear: i32, normal: i32) {
        let shift = if self.hush_us > 0 { 8 } else { 32 };
        let faded = self.load + (shear - self.load) / shift;
        // A load that swings is remembered by its peaks.
        self.load = faded.max(shear - shear / 32);
        let step = change(self.load + self.slots.fluctuation(), self.load).clamp(0, NOISE_MAX);
        self.noise_16ths += 2 * step - self.noise_16ths / 8;
        if self.calm_us > COME_BACK_US {
            self.came_back = 0;
        }
        // What a slide showed lasts as long as the contact, unless that carries more.
        if self.limit != UNLIMITED && self.calm_us > CALM_US {
            self.limit = self.limit.max(ratio(shear, normal)).min(UNLIMITED - 1);
        }
    }

    /// The most that friction can be, since a slide; more than any friction when none was seen.
    pub(crate) fn limit(&self) -> u16 {
        if self.limit == UNLIMITED || self.is_watched() || self.test.is_some_and(|test| !test.is_confirmed) {
            return self.limit;
        }
        divide(
            u64::from(self.limit) * u64::from(FAST_SLIDE_SHARE),
            PER_UNIT as u16,
        ) as u16
    }

    /// The host has seen the object of late, and will see it move.
    pub(crate) const fn is_watched(&self) -> bool {
        self.watched_us > 0
    }

    /// The load to hold while a slide, or another finger, may hide some of it; 0 otherwise.
    pub(crate) fn hidden_load(&self) -> i32 {
        let of_slide = if self.test.is_some() || self.is_below() && !self.seen.shows_rest() {
            self.load
        } else {
            0
        };
        let of_another = if self.is_watched() {
            0
        } else {
            self.moved_load.held()
        };
        of_slide.max(of_another)
    }

    /// Whether the shear lies below the remembered load.
    fn is_below(&self) -> bool {
        self.slots.shear[0] + self.slots.shear[1] < 2 * (self.load - part(self.load, self.short_share()))
    }

    /// What this witness demands of the line.
    pub(crate) fn verdict(&self) -> Verdict {
        let is_calm = self.load < WITNESSED_LOAD_MIN
            || self.seen.shows_rest()
            || (self.calm_us >= CALM_US && !self.is_below());
        let urgency = match self.test {
            None => Urgency::None,
            Some(test) if test.is_confirmed => Urgency::Follows,
            Some(test) if self.is_short && (test.is_sudden || test.is_first) => Urgency::SuddenlyShort,
            Some(_) if self.is_short => Urgency::Short,
            Some(_) => Urgency::Tests,
        };
        Verdict {
            urgency,
            may_fall: self.test.is_none()
                && is_calm
                && !self.seen.shows_motion()
                && (self.seen.shows_rest() || self.untried_us == 0),
            finding: self.finding,
        }
    }
}

/// Whether the shear has sunk by less than half as much as the normal force.
const fn stays_while_the_grip_sinks([of_shear, of_normal]: [i32; 2]) -> bool {
    of_normal < -RISES_SHARE && 2 * of_shear > of_normal
}
