//! From slip state to grip force: feed-forward F_T/μ·(1+margin), a reflex that grows while the stick ratio is below its
//! target, slew limits, floor and ceiling. The line rises fast. It falls on command (`Release`), or relaxes at `relax_rate`
//! once the contact has stuck for `relax_after_ms`; a fault forbids relaxing.
//!
//! A map that demands more force raises the line at once, before friction and load are looked at: `GripController::anticipate`.
//! Units: force 1/4096 N, time µs. Limits: force up to 125 N; steps of 1/1000 of the unit, so slow rates do not stall, and all of
//! it fits 32 bits. The line may rise by a millisecond's worth at once; over any longer time it keeps its rate.

use gripline_protocol::PER_UNIT;
use gripline_protocol::configuration::FORCE_MAX;
use gripline_protocol::message::{Configuration, GripMode, SlipState};

use crate::arithmetic::{divide, divide_48};
use crate::constants::{
    FEED_FORWARD_FRICTION_MIN, GRIPPER_LAG_SHIFT, SCALE_ERROR_PART, SEEK_MAX, SEEK_RATE, SHORT_RISE_8THS,
    SLOW_RELAX_RATE, TEST_RISE_MIN, TEST_RISE_PART,
};
use crate::friction_estimator::LoadEstimate;
use crate::slide_witness::{Finding, Urgency, Verdict};
use crate::slip::worse;

/// A grip force, 1/4096 N; never negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GripForce(i32);

impl GripForce {
    /// No force: the gripper opens.
    pub const ZERO: Self = Self(0);

    /// From wire units; negative values become zero.
    #[must_use]
    pub const fn from_lsb(lsb: i32) -> Self {
        Self(if lsb < 0 { 0 } else { lsb })
    }

    /// In wire units.
    #[must_use]
    pub const fn lsb(self) -> i32 {
        self.0
    }
}

/// What safety demands of the line beyond the controller's own demand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Guard {
    /// Nothing.
    #[default]
    Free,
    /// The line must not fall.
    Hold,
    /// The line must not fall, and rises to the fail-safe force.
    FailSafe,
}

/// The newest maps of all fingertips together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Evidence {
    /// Worst state.
    pub state: SlipState,
    /// Lowest stick ratio, 1/10000; `None` without contact.
    pub stick_ratio: Option<u16>,
    /// Greatest total shear, 1/4096 N.
    pub shear: i32,
    /// With one more slipping taxel per fingertip, the stick ratio would still reach the reflex's target.
    pub has_spare: bool,
}

impl Evidence {
    /// Without any map.
    pub(crate) const NONE: Self = Self {
        state: SlipState::NoContact,
        stick_ratio: None,
        shear: 0,
        has_spare: true,
    };

    /// The worst of this and another fingertip's.
    pub(crate) fn with(self, other: Self) -> Self {
        Self {
            state: worse(self.state, other.state),
            stick_ratio: match (self.stick_ratio, other.stick_ratio) {
                (Some(one), Some(other)) => Some(one.min(other)),
                (one, other) => one.or(other),
            },
            shear: self.shear.max(other.shear),
            has_spare: self.has_spare & other.has_spare,
        }
    }
}

/// State of a controller that learns friction, updated outside the map-to-line path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Learnt {
    /// The shear to hold, 1/4096 N, and the proven or typical friction, 1/10000.
    shear: i32,
    friction: u16,
    /// The force that both need, with the margin, 1/4096 N.
    force: i32,
    /// Fastest fall of the line, 1/4096 N per second.
    fall_rate: u16,
    /// What the slide witnesses say; the line before their test, the least during it, and how far a test of a shear that falls little by
    /// little goes ahead of the gripper, 1/4096 N.
    witness: Verdict,
    before_test: i32,
    test_min: i32,
    short_max: i32,
    /// After a test the line goes back to where it was before, or, after a slide, to what the friction found needs. After one that a
    /// growing load ended it relaxes.
    goes_back: bool,
    /// Since a fault last forbade it, the line could have relaxed: what tests add does not add up.
    could_relax: bool,
    /// Line while the grip closes on an object that it hardly feels.
    sought_milli: i32,
    /// The force that the gripper should have reached, and when that was computed; wraps.
    reached_milli: i32,
    at_us: u32,
}

/// The grip controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GripController {
    mode: GripMode,
    /// The line and the reflex, in 1/1000 of 1/4096 N.
    line_milli: i32,
    reflex_milli: i32,
    /// How far the line may rise at once, in 1/1000 of 1/4096 N.
    rise_milli: i32,
    learnt: Learnt,
    /// The force that maps need which were not learnt from yet, 1/4096 N; 0 when there are none.
    anticipated: i32,
    evidence: Evidence,
    /// When the evidence came, µs.
    observed_us: u64,
    /// The least while settings hold that would loosen a running grip, in 1/1000 of 1/4096 N.
    kept_milli: i32,
    /// How long the contact has stuck above the relaxing level, µs.
    stuck_us: u64,
    /// The newest maps allow that the line falls; so does what was learnt.
    may_fall: bool,
    may_relax: bool,
    last_us: u64,
}

const MILLI: i32 = 1_000;
/// Time that the line may be late with a rise and catch up at once, µs: until the next tick it could not have moved either.
const RISE_US: u64 = 1_000;
/// Longest time that counts for one relaxing step, and longest time without a map after which the line still falls by plan, µs: a frame
/// at 50 Hz; steps come every millisecond.
const FALL_US_MAX: u64 = 20_000;
/// More than any line, in 1/1000 of 1/4096 N; twice of it fits 32 bits.
const MILLI_MAX: i32 = (1 << 30) - 1;

impl GripController {
    /// Released and open, or holding the line from before a reset, limited to what any gripper has.
    #[must_use]
    pub const fn new(now_us: u64, restored: Option<GripForce>) -> Self {
        let (mode, line) = match restored {
            // The memory may hold anything; a line that wraps would let go.
            Some(line) if line.0 > FORCE_MAX => (GripMode::Hold, FORCE_MAX),
            Some(line) if line.0 > 0 => (GripMode::Hold, line.0),
            _ => (GripMode::Released, 0),
        };
        Self {
            mode,
            line_milli: line * MILLI,
            reflex_milli: 0,
            rise_milli: 0,
            learnt: Learnt {
                shear: 0,
                friction: 0,
                force: 0,
                fall_rate: 0,
                witness: Verdict::NONE,
                before_test: 0,
                test_min: 0,
                short_max: 0,
                goes_back: false,
                could_relax: true,
                sought_milli: 0,
                reached_milli: line * MILLI,
                at_us: now_us as u32,
            },
            anticipated: 0,
            evidence: Evidence {
                state: SlipState::NoContact,
                stick_ratio: None,
                shear: 0,
                has_spare: false,
            },
            observed_us: now_us,
            kept_milli: 0,
            stuck_us: 0,
            may_fall: false,
            may_relax: false,
            last_us: now_us,
        }
    }

    /// What the gripper is told to do.
    #[must_use]
    pub const fn mode(&self) -> GripMode {
        self.mode
    }

    /// Holds or releases from now on.
    pub fn set_mode(&mut self, mode: GripMode) {
        self.mode = mode;
        self.stuck_us = 0;
        self.kept_milli = 0;
        if mode == GripMode::Released {
            self.reflex_milli = 0;
            self.learnt.goes_back = false;
            self.learnt.could_relax = true;
        }
    }

    /// Settings come that would loosen the grip: a running hold keeps its line until it is released.
    pub(crate) fn keep_line(&mut self) {
        if self.mode == GripMode::Hold {
            self.kept_milli = self.kept_milli.max(self.line_milli);
        }
    }

    /// By the maps of late nothing is touched: what will be held next is unknown.
    pub(crate) const fn forget_load(&mut self) {
        self.evidence = Evidence::NONE;
        self.anticipated = 0;
        self.learnt.shear = 0;
        self.learnt.force = 0;
        self.learnt.sought_milli = 0;
        self.learnt.witness = Verdict::NONE;
    }

    /// Whether the newest maps allow that the line falls: what no new map has seen may slide, what left the skin, and what a witness sees
    /// that needs no learning, `may_slide`.
    pub(crate) fn watch(&mut self, now_us: u64, may_slide: bool) {
        let is_recent = now_us.saturating_sub(self.observed_us) <= FALL_US_MAX;
        self.may_fall = is_recent && self.evidence.stick_ratio.is_some() && !may_slide;
        if may_slide {
            self.stuck_us = 0;
        }
        if self.evidence.stick_ratio.is_none() {
            // What a test found is of the contact that ended; the next one may be of another friction.
            self.learnt.goes_back = false;
        }
    }

    /// Time passes in a controller that does not learn.
    pub(crate) const fn learn_nothing(&mut self) {
        self.may_relax = true;
    }

    /// What must be on the line.
    #[must_use]
    pub const fn line(&self) -> GripForce {
        // 0 to 125 N by the checks of the settings.
        GripForce::from_lsb((self.line_milli.cast_unsigned() / MILLI.cast_unsigned()) as i32)
    }

    /// The force that the gripper should have reached by now, in a controller that learns.
    pub(crate) const fn reached(&self) -> GripForce {
        GripForce::from_lsb(self.learnt.reached_milli / MILLI)
    }

    /// Takes the newest maps. Evidence older than `stale_ms` no longer moves the reflex: a contact that slipped then may hold
    /// by now, and would be squeezed up to the ceiling.
    pub const fn observe(&mut self, evidence: Evidence, now_us: u64) {
        self.evidence = evidence;
        self.observed_us = now_us;
        self.may_fall &= evidence.stick_ratio.is_some();
    }

    /// Takes what the load on the contact says of the newest maps' state.
    pub(crate) const fn judge(&mut self, state: SlipState) {
        self.evidence.state = state;
    }

    /// Takes the shear of maps of which one is doubtful: it may only raise the line.
    pub(crate) fn observe_doubtful(&mut self, shear: i32) {
        self.evidence.shear = self.evidence.shear.max(shear);
    }

    /// The feed-forward of a controller that learns, 1/4096 N.
    pub(crate) const fn force(&self) -> i32 {
        self.learnt.force
    }

    /// A map came that by its shear needs this force, 1/4096 N: a controller that learns does not wait until it has learnt from it.
    pub(crate) fn anticipate(&mut self, needed: i32) {
        let force = self.learnt.force;
        let needed = force + followed(force, needed - force);
        self.anticipated = self.anticipated.max(needed);
    }

    /// Time passes in a controller that learns: the gripper follows its line. `load` is a new map's load, of the fingertip
    /// that needs the most grip, with its normal force.
    #[expect(clippy::inline_always, reason = "called once; a call of its own costs flash")]
    #[inline(always)]
    pub(crate) fn learn(
        &mut self,
        now_us: u64,
        load: Option<(LoadEstimate, i32)>,
        witness: Verdict,
        settings: &Configuration,
    ) {
        let passed_us = (now_us as u32).wrapping_sub(self.learnt.at_us);
        self.learnt.at_us = now_us as u32;
        // Both at most 125 N, so what is between them fits.
        self.learnt.reached_milli += lagged(self.line_milli - self.learnt.reached_milli, passed_us);
        let Some((load, normal)) = load else {
            // The margin may be another one.
            self.learnt.force = force_for(self.learnt.shear, self.learnt.friction, settings);
            return;
        };
        let line = self.line().lsb();
        if witness.tests() && !self.learnt.witness.tests() {
            if !self.learnt.goes_back {
                self.learnt.before_test = line;
            }
            let rise = (self.learnt.before_test / TEST_RISE_PART).max(TEST_RISE_MIN);
            self.learnt.test_min = self.learnt.before_test + rise;
            self.learnt.short_max = line + SHORT_RISE_8THS * line / 8;
        }
        if witness.tests() != self.learnt.witness.tests() {
            self.learnt.goes_back = !witness.tests();
            if !witness.tests() {
                self.learnt.before_test = self.after_test(witness.finding, line, settings);
            }
        }
        self.learnt.witness = witness;
        self.may_relax = witness.may_fall;
        self.learnt.friction = load.friction;
        let wanted = if witness.tests() {
            // The maps lag behind the gripper, which a test moves: what was felt before still holds.
            load.shear.max(self.learnt.shear)
        } else {
            felt(&load, self.learnt.reached_milli, self.line_milli)
        };
        self.learnt.shear += followed(self.learnt.shear, wanted - self.learnt.shear);
        self.learnt.force = force_for(self.learnt.shear, self.learnt.friction, settings);
        self.anticipated = 0;
        if !witness.may_fall || self.learnt.force > line + line / 16 {
            self.stuck_us = 0;
        }
        // A light touch may be too small to see, or to show its load.
        let half = settings.floor / 2;
        let has_closed = 8 * i64::from(self.learnt.reached_milli) > 7 * i64::from(self.line_milli);
        if self.mode == GripMode::Released || normal > half + half / 4 {
            self.learnt.sought_milli = 0;
        } else if normal < half && has_closed {
            let max = (settings.floor + settings.floor.min(SEEK_MAX)).min(settings.ceiling) * MILLI;
            let step = SEEK_RATE * i32::from(load.since_us);
            self.learnt.sought_milli = (self.line_milli + step).min(max);
        }
        // 95 % a second, at most what is set.
        self.learnt.fall_rate = (line - line / 16).clamp(0, settings.relax_rate.into()) as u16;
    }

    /// The line to go back to after a test, 1/4096 N; a grip that is set to relax slowly keeps what a test added, and relaxes.
    fn after_test(&self, finding: Finding, line: i32, settings: &Configuration) -> i32 {
        let stays = finding == Finding::Open || settings.relax_rate < SLOW_RELAX_RATE;
        match finding {
            Finding::Slid => 0,
            // Where a fault forbids the line to fall, one test after the other must not add up.
            Finding::Open | Finding::Held if stays && self.learnt.could_relax => line,
            Finding::Open | Finding::Held => self.learnt.before_test,
        }
    }

    /// Feed-forward: the force that friction needs for the present shear, and the margin, 1/4096 N.
    fn feed_forward(&self, settings: &Configuration) -> i32 {
        if settings.learns() {
            self.learnt.force.max(self.anticipated)
        } else {
            force_for(self.evidence.shear, settings.friction, settings)
        }
    }

    /// Moves the line to `now_us` and returns it.
    pub fn advance(&mut self, now_us: u64, guard: Guard, settings: &Configuration) -> GripForce {
        // A gap of more than a second is a hang, not a reason to jump.
        let passed_us = now_us.saturating_sub(self.last_us).min(1_000_000);
        self.last_us = now_us;
        let rise = grown(settings.rise_rate, passed_us.max(RISE_US));
        self.rise_milli = (self.rise_milli + grown(settings.rise_rate, passed_us)).min(rise);
        if self.mode == GripMode::Released {
            self.line_milli = (self.line_milli - grown(settings.release_rate, passed_us)).max(0);
            return self.line();
        }
        let (floor, ceiling) = (settings.floor * MILLI, settings.ceiling * MILLI);
        let feed_forward = self.feed_forward(settings).min(settings.ceiling) * MILLI;

        let relaxing = self.update_reflex(passed_us, guard, settings);
        self.learnt.could_relax = guard == Guard::Free && (self.learnt.could_relax || relaxing);
        // Anti-windup: the reflex never asks for more than the ceiling leaves.
        // (`clamp` would panic on settings that cross, which `Configuration::check` refuses.)
        self.reflex_milli = self.reflex_milli.min(ceiling - feed_forward).max(0);
        let mut demand = (feed_forward + self.reflex_milli).max(floor).min(ceiling);
        if guard == Guard::FailSafe {
            demand = demand.max(settings.fail_safe * MILLI);
        }
        let mut relax_rate = settings.relax_rate;
        if settings.learns() {
            // At most twice the floor, and the ceiling of that time.
            demand = demand.max(self.learnt.sought_milli);
            relax_rate = self.learnt.fall_rate;
            if self.learnt.witness.tests() {
                let lower = match self.learnt.witness.urgency {
                    // Ahead of the gripper's lag; more where the shear that follows hides the load.
                    Urgency::Follows => 2 * demand,
                    Urgency::SuddenlyShort => demand + demand / 4,
                    Urgency::Short => (demand + demand / 4).min(self.learnt.short_max * MILLI),
                    Urgency::Tests | Urgency::None => 0,
                };
                let lower = lower.max(self.learnt.test_min * MILLI);
                demand = demand.max(lower.min(ceiling));
            }
        }
        demand = demand.max(self.kept_milli);
        let before_test = self.learnt.before_test * MILLI;
        let goes_back = settings.learns() && guard == Guard::Free && self.learnt.goes_back && self.may_fall;
        if demand > self.line_milli {
            let rise = (demand - self.line_milli).min(self.rise_milli);
            self.rise_milli -= rise;
            self.line_milli += rise;
        } else if goes_back {
            // What a test added: all of it, or, after a slide, what the friction found does not need.
            let step = grown(settings.release_rate, passed_us.min(FALL_US_MAX));
            // The line may meanwhile have been released.
            let back = demand.max(before_test).min(self.line_milli);
            self.line_milli = back.max(self.line_milli - step);
            self.learnt.goes_back = self.line_milli > back;
        } else if relaxing {
            // A clock that jumps for one reading must not make the line jump down.
            let passed_us = passed_us.min(FALL_US_MAX) as u32;
            // The rate is per second.
            let step = u32::from(relax_rate) * passed_us / 1_000;
            self.line_milli = demand.max(self.line_milli - step.cast_signed());
        }
        self.line()
    }

    /// Grows the reflex while the stick ratio is below its target, and shrinks it once the contact has stuck long enough.
    /// Returns whether the line may relax.
    fn update_reflex(&mut self, passed_us: u64, guard: Guard, settings: &Configuration) -> bool {
        let stale = self.last_us.saturating_sub(self.observed_us) > u64::from(settings.stale_ms) * 1_000;
        let Some(ratio) = self.evidence.stick_ratio.filter(|_| !stale) else {
            self.stuck_us = 0;
            return false;
        };
        let missing = settings.reflex_target.saturating_sub(ratio);
        let slips = self.evidence.state == SlipState::Slip;
        if settings.reflex_rate > 0 && (slips || missing > 0) {
            self.stuck_us = 0;
            let share = if slips { settings.reflex_target } else { missing };
            // At most 2¹⁶ · 10⁶ · 10⁴.
            let product = u64::from(settings.reflex_rate) * passed_us * u64::from(share);
            let step = divide(product, settings.reflex_target.max(1)).min(MILLI_MAX as u64);
            self.reflex_milli += step as i32;
            return false;
        }
        // Between target and incipient threshold nothing moves: a dead band against limit cycles. With few taxels no stick
        // ratio may lie in the band; then nothing moves at the first ratio above it.
        // A contact with proven friction is held by that, whatever share of it sticks.
        let sticks = settings.learns()
            || self.evidence.state == SlipState::Stick
                && ratio >= settings.incipient_threshold
                && self.evidence.has_spare;
        self.stuck_us = if sticks && guard == Guard::Free {
            self.stuck_us.saturating_add(passed_us)
        } else {
            0
        };
        let relaxing = settings.relax_rate > 0
            && self.may_fall
            && self.may_relax
            && self.stuck_us > u64::from(settings.relax_after_ms) * 1_000;
        if relaxing && self.reflex_milli > 0 {
            // The rate is per second.
            let step = divide_48(u64::from(settings.relax_rate) * passed_us, 1_000) as i32;
            self.reflex_milli -= step.min(self.reflex_milli);
        }
        relaxing
    }
}

/// Whether new settings would loosen a grip that the old ones hold.
pub(crate) const fn loosens(old: &Configuration, new: &Configuration) -> bool {
    new.sensors < old.sensors
        || new.friction > old.friction
        || new.friction_max > old.friction_max
        || old.learns() && !new.learns()
        || new.slip_threshold < old.slip_threshold
        || new.slip_leave < old.slip_leave
        || new.incipient_threshold < old.incipient_threshold
        || new.incipient_horizon_ms < old.incipient_horizon_ms
        || new.dwell_ms < old.dwell_ms
        || new.contact_min > old.contact_min
        || new.margin < old.margin
        || new.floor < old.floor
        || new.ceiling < old.ceiling
        || new.fail_safe < old.fail_safe
        || new.reflex_target < old.reflex_target
        || new.reflex_rate < old.reflex_rate
        || new.rise_rate < old.rise_rate
        || new.relax_rate > old.relax_rate
        || new.relax_after_ms < old.relax_after_ms
        || new.release_rate > old.release_rate
}

/// How far the gripper moves towards `distance` in that time.
fn lagged(distance: i32, passed_us: u32) -> i32 {
    let passed_us = passed_us.min(1 << GRIPPER_LAG_SHIFT);
    ((i64::from(distance) * i64::from(passed_us)) >> GRIPPER_LAG_SHIFT) as i32
}

/// What a rate of 1/4096 N per ms makes in that time, in 1/1000 of 1/4096 N.
fn grown(rate: u16, passed_us: u64) -> i32 {
    (u64::from(rate) * passed_us).min(MILLI_MAX as u64) as i32
}

/// How much of an increase counts at once. A small one may be fluctuation: it is followed slowly.
fn followed(before: i32, more: i32) -> i32 {
    let is_little = more > 0 && more <= before / 16;
    if is_little { more / 4 } else { more }
}

/// The force that friction needs for a shear, and the margin, 1/4096 N.
pub(crate) fn force_for(shear: i32, friction: u16, settings: &Configuration) -> i32 {
    let friction = u32::from(friction).max(FEED_FORWARD_FRICTION_MIN);
    let share = PER_UNIT + u32::from(settings.margin);
    // At most 2²⁶ · 5·10⁴ / 500.
    let product = u64::from(shear.max(0).cast_unsigned()) * u64::from(share);
    divide_48(product, friction as u16).min(i32::MAX as u64) as i32
}

/// The shear to hold. Maps miss part of a light touch, of shear and normal force alike. So scale the shear by the gripper's
/// force over the map's normal force, by at most one half more. Maps that show too much of both are scaled back while the gripper has
/// reached its line and the host sees the object: should the gripper hold more than its line says, motion will show.
fn felt(load: &LoadEstimate, reached_milli: i32, line_milli: i32) -> i32 {
    let seen = load.shear;
    let reached = reached_milli.max(0) as u32 / MILLI as u32;
    let felt = divide(u64::from(reached) * u64::from(load.ratio), PER_UNIT as u16);
    let has_reached = reached_milli > line_milli - line_milli / 32;
    let lower = if load.is_watched && has_reached {
        seen - seen / SCALE_ERROR_PART
    } else {
        seen
    };
    (felt.min(i32::MAX as u64) as i32).min(seen + seen / 2).max(lower)
}

#[cfg(test)]
mod tests {
    use gripline_protocol::LSB_PER_NEWTON;

    use super::*;

    /// The lines, in newtons, at the end of a test of a slide, 100 ms later, and at the end of another one after that: it found `finding`,
    /// under `guard`.
    fn after_a_test(finding: Finding, guard: Guard, settings: &Configuration) -> [f32; 3] {
        let mut grip = GripController::new(0, None);
        grip.set_mode(GripMode::Hold);
        let mut now_us = 0;
        let mut wait = |grip: &mut GripController, slots: u32, urgency: Urgency, guard: Guard| {
            let witness = Verdict {
                urgency,
                may_fall: urgency == Urgency::None,
                finding,
            };
            let load = LoadEstimate {
                shear: 200,
                ratio: 1_000,
                friction: 7_000,
                since_us: 20_000,
                is_watched: false,
            };
            for _ in 0..slots {
                let evidence = Evidence {
                    state: SlipState::Stick,
                    stick_ratio: Some(10_000),
                    shear: load.shear,
                    has_spare: true,
                };
                grip.observe(evidence, now_us);
                grip.learn(now_us, Some((load, 4_000)), witness, settings);
                grip.watch(now_us, false);
                for _ in 0..20 {
                    now_us += 1_000;
                    grip.advance(now_us, guard, settings);
                }
            }
            grip.line().lsb() as f32 / f32::from(LSB_PER_NEWTON as u16)
        };
        wait(&mut grip, 20, Urgency::None, Guard::Free);
        let risen = wait(&mut grip, 10, Urgency::Tests, guard);
        wait(&mut grip, 1, Urgency::None, Guard::Free);
        let later = wait(&mut grip, 4, Urgency::None, Guard::Free);
        [risen, later, wait(&mut grip, 10, Urgency::Tests, guard)]
    }

    #[test]
    fn after_a_test_that_a_growing_load_ended_the_grip_stays_risen_unless_a_fault_forbade_to_relax() {
        let settings = Configuration::DEFAULT;
        let [risen, later, _] = after_a_test(Finding::Held, Guard::Free, &settings);
        assert!(risen > 1.9 && later < 1.1, "held: {risen} N, then {later} N");
        let [risen, later, _] = after_a_test(Finding::Open, Guard::Free, &settings);
        assert!(risen > 1.9 && later > 1.7, "open: {risen} N, then {later} N");
        let [risen, later, _] = after_a_test(Finding::Open, Guard::Hold, &settings);
        assert!(risen > 1.9 && later < 1.1, "fault: {risen} N, then {later} N");
    }

    #[test]
    fn a_grip_that_relaxes_slowly_keeps_what_a_test_added() {
        for (relax_rate, lower) in [(410, 1.95), (0, 1.99)] {
            let settings = Configuration {
                relax_rate,
                ..Configuration::DEFAULT
            };
            let [risen, later, again] = after_a_test(Finding::Held, Guard::Free, &settings);
            assert!(
                risen > 1.99 && later > lower,
                "{relax_rate}: {risen} N, then {later} N"
            );
            // What it keeps does not hide the next test.
            assert!(
                again > 1.2 * risen,
                "{relax_rate}: {risen} N, then {again} N in the next test"
            );
        }
    }

    #[test]
    fn settings_with_which_the_line_may_relax_sooner_loosen_the_grip() {
        let old = Configuration::CAREFUL;
        let sooner: [fn(&mut Configuration); 5] = [
            |new| new.slip_threshold -= 1,
            |new| new.slip_leave -= 1,
            |new| new.incipient_threshold -= 1,
            |new| new.incipient_horizon_ms -= 1,
            |new| new.dwell_ms -= 1,
        ];
        for change in sooner {
            let mut new = old;
            change(&mut new);
            assert!(loosens(&old, &new) && !loosens(&new, &old), "{new:?}");
        }
    }

    #[test]
    fn a_line_that_may_relax_at_once_does_not_fall_while_a_witness_forbids_it() {
        let settings = Configuration {
            relax_after_ms: 0,
            ..Configuration::DEFAULT
        };
        let mut grip = GripController::new(0, None);
        grip.set_mode(GripMode::Hold);
        let mut now_us = 0;
        let mut wait = |grip: &mut GripController, shear: i32, may_fall: bool| {
            for _ in 0..10 {
                let load = LoadEstimate {
                    shear,
                    ratio: 1_000,
                    friction: 7_000,
                    since_us: 20_000,
                    is_watched: false,
                };
                let witness = Verdict {
                    may_fall,
                    ..Verdict::NONE
                };
                let evidence = Evidence {
                    state: SlipState::Stick,
                    stick_ratio: Some(10_000),
                    shear,
                    has_spare: true,
                };
                grip.observe(evidence, now_us);
                grip.learn(now_us, Some((load, 4_000)), witness, &settings);
                grip.watch(now_us, false);
                for _ in 0..20 {
                    now_us += 1_000;
                    grip.advance(now_us, Guard::Free, &settings);
                }
            }
            grip.line().lsb()
        };
        let risen = wait(&mut grip, 4_000, true);
        assert!(wait(&mut grip, 200, false) >= risen);
        assert!(wait(&mut grip, 200, true) < risen);
    }
}
