//! The test of a suspicion: the grip rises, and what shear and normal force do then says whether the contact slides.
//! Units as in the folder's `mod`.

use gripline_protocol::PER_UNIT;

use super::SlideWitness;
use super::suspicion::{Ending, Suspicion, Test, UNLIMITED};
use super::verdict::Finding;
use crate::arithmetic::{WHOLE, change, divide, part, ratio};
use crate::constants::{
    ASKED_SHARE, BACK_SHARE, DOUBTED_US, FOLLOWED_SLOTS, FRICTION_LOSS_MAX, GONE_LOAD_PART, HUSH_HELD_US,
    HUSH_US, NEWS_SHARE, RISES_SHARE, SHEAR_LEAK_SHARE, SLIDING_FRICTION_MIN, SLOT_US, SUNK_SHARE,
    SWING_LOSS_MAX, SWUNG_8THS, TEST_MARGIN, TEST_US_MAX, UNPROVEN_US_MAX,
};
use crate::learning_settings::LearningSettings;

impl SlideWitness {
    /// Begins a test of a suspicion under this normal force; `friction` is what the grip counts on, `was_calm`: nothing had spoken for a
    /// slide for long.
    pub(super) fn begin_test(
        &mut self,
        normal: i32,
        friction: u16,
        suspicion: Suspicion,
        was_calm: bool,
        settings: LearningSettings,
    ) {
        let now = ratio(self.slots.shear[0], self.slots.normal[0]);
        let counted_on = u64::from(friction.min(self.limit));
        let lower = divide(counted_on * u64::from(FRICTION_LOSS_MAX), PER_UNIT as u16) as u16;
        let is_sudden = self.slots.have_fallen_suddenly(self.load);
        let has_risen = self.slots.grip_rises();
        let test = Test {
            shear: self.slots.shear[0],
            normal,
            for_us: 0,
            limit: self.limit,
            carried: self.carried,
            proven: friction,
            is_first: suspicion == Suspicion::Settled,
            highest: 0,
            is_sudden,
            fell_from: if is_sudden && !has_risen && was_calm {
                self.load
            } else {
                0
            },
            followed: 0,
            stayed: 0,
            is_confirmed: suspicion == Suspicion::Seen,
        };
        self.test = Some(test);
        if suspicion == Suspicion::Seen {
            self.limit = self.limit.min(now).max(1);
            return;
        }
        if !self.may_find(&test) {
            // What has slid is held firmly already.
            return;
        }
        // Raise first and ask later, with less margin until it is known.
        let with_margin = u64::from(now) * u64::from(PER_UNIT + u32::from(settings.margin));
        let unproven = divide(with_margin, TEST_MARGIN).min(UNLIMITED.into()) as u16;
        self.limit = self.limit.min(unproven.max(lower)).max(1);
    }

    /// A slot has passed in a test: shear and normal force now, and how they changed over the last slots, 1/1024.
    pub(super) fn continue_test(
        &mut self,
        mut test: Test,
        [shear, normal]: [i32; 2],
        changes: [i32; 2],
        passed_us: u32,
    ) {
        if test.for_us == 0 && !test.is_confirmed && self.slots.shear[0] < test.shear {
            // The slot before may have begun ahead of the slide.
            (test.shear, test.normal) = (self.slots.shear[0], self.slots.normal[0]);
        }
        test.for_us = test.for_us.saturating_add(passed_us);
        let [shear_rise, normal_rise] = [change(shear, test.shear), change(normal, test.normal)];
        let now = ratio(shear, normal);
        if test.for_us > passed_us {
            // The mean before reaches back to the slot in which the slide began.
            test.highest = test.highest.max(now);
        }
        let is_late = test.for_us > TEST_US_MAX;
        let grows_faster = test.is_first && shear_rise > 2 * normal_rise.max(ASKED_SHARE);
        let ending = if test.is_confirmed {
            self.continue_slide(&mut test, is_late, changes, now)
        } else if self.seen.shows_motion() {
            test.is_confirmed = true;
            test.for_us = 0;
            self.limit = self.limit.min(now).max(1);
            None
        } else if self.seen.shows_rest() {
            Some(Ending::Judged)
        } else if self.grows_alone(changes) || grows_faster {
            // The load has grown. What a first one will be is yet to be tried.
            Some(if test.is_first {
                Ending::Open
            } else {
                Ending::Judged
            })
        } else if normal_rise > ASKED_SHARE {
            self.judge_rise(&mut test, [shear_rise, normal_rise], changes[1], now)
                .or(is_late.then_some(Ending::Judged))
        } else {
            self.wait_for_rise(&test, [shear, normal], changes[1])
                .or(is_late.then_some(Ending::Judged))
        };
        match ending {
            None => self.test = Some(test),
            Some(ending) => self.end_test(&test, [shear, normal], normal_rise, ending),
        }
    }

    /// The grip has risen in a test: whether the shear follows it, since its beginning; `of_normal` is the change of the normal force over
    /// the last slots, `now` what the contact carries, 1/10000.
    fn judge_rise(
        &mut self,
        test: &mut Test,
        [shear_rise, normal_rise]: [i32; 2],
        of_normal: i32,
        now: u16,
    ) -> Option<Ending> {
        let apart = (shear_rise - normal_rise).abs();
        // A slide that a fast gripper stops has no third slot: one in which both rise alike to an eighth counts twice.
        let alike = 8 * apart < normal_rise;
        let follows = 5 * apart < 2 * normal_rise;
        let more = test.followed.saturating_add(1 + u8::from(alike));
        if !follows {
            test.followed = 0;
        } else if of_normal > RISES_SHARE {
            // Only a grip that rises can be followed.
            test.followed = more;
        }
        let stays = 3 * shear_rise < normal_rise;
        test.stayed = if stays { test.stayed + 1 } else { 0 };
        // What slides carries about the same share all the time; a load that swings back carries more, and less again.
        let highest = u32::from(test.highest);
        let swings = SWUNG_8THS * highest > 8 * u32::from(now);
        test.is_confirmed = test.followed >= FOLLOWED_SLOTS
            && self.may_find(test)
            && !swings
            && ratio(test.shear, test.normal) >= self.min_friction();
        if test.is_confirmed {
            self.limit = self.limit.min(ratio(test.shear, test.normal)).max(1);
            self.has_slid = true;
            // From now on: the gripper has yet to follow.
            (test.for_us, test.stayed) = (0, 0);
        }
        // A shear that is small fluctuates more: one slot is no answer.
        let has_stayed = test.stayed >= if test.is_new() { 2 } else { 1 };
        let is_over = has_stayed || normal_rise > 2 * ASKED_SHARE && !follows && !stays;
        is_over.then_some(Ending::Judged)
    }

    /// The grip has not risen yet in a test: what shear and normal force say before, and how long the test waits.
    fn wait_for_rise(&self, test: &Test, [shear, normal]: [i32; 2], of_normal: i32) -> Option<Ending> {
        // By then a gripper with a time constant of 100 ms rises, if it does.
        let has_stopped = test.is_sudden && test.for_us > 8 * SLOT_US && of_normal <= RISES_SHARE;
        if test.for_us > UNPROVEN_US_MAX || has_stopped {
            // The grip has hardly risen, and what suddenly fell may slide: the next test raises it further.
            let may_slide = test.is_sudden && self.has_fallen_by(self.slots.shear[0], NEWS_SHARE / 2);
            return Some(if may_slide { Ending::Open } else { Ending::Judged });
        }
        // A sliding contact cannot carry more for its normal force than when it was suspected.
        let carries = i64::from(shear) * i64::from(test.normal);
        let could = i64::from(self.load - part(self.load, BACK_SHARE)) * i64::from(normal);
        let is_held = !test.is_new()
            && test.for_us > 2 * SLOT_US
            && carries > could
            && self.has_fallen_by(test.shear, SUNK_SHARE);
        is_held.then_some(Ending::Judged)
    }

    /// Goes on with a test that found a slide: lowers the limit towards what the contact carries `now`, 1/10000. `is_late`: it has lasted too
    /// long; then the changes of shear and normal force over the last slots, 1/1024.
    fn continue_slide(
        &mut self,
        test: &mut Test,
        is_late: bool,
        [of_shear, of_normal]: [i32; 2],
        now: u16,
    ) -> Option<Ending> {
        let follows = 20 * of_shear > 7 * of_normal;
        // Shear that stays a little behind comes near to what holds the load, and says less than friction.
        if 5 * of_shear > 4 * of_normal || self.seen.shows_motion() {
            self.limit -= (self.limit - now.min(self.limit)) / 5 * 2;
        }
        // What the shear has confirmed it ends sooner: it stays for two slots in which the grip rises.
        // Motion that the host sees may go on for longer than a test.
        test.stayed = if self.slots.stays_while_the_grip_rises() {
            test.stayed.saturating_add(1)
        } else {
            0
        };
        let has_stayed = test.stayed >= 2 && test.followed >= FOLLOWED_SLOTS;
        let has_settled = test.for_us > 6 * SLOT_US && (of_normal <= RISES_SHARE || !follows);
        let is_over =
            self.seen.shows_rest() || (is_late || has_stayed || has_settled) && !self.seen.shows_motion();
        is_over.then_some(Ending::Judged)
    }

    /// A test is over: shear and normal force now, and by how much that has risen since its beginning, 1/1024.
    fn end_test(&mut self, test: &Test, [shear, normal]: [i32; 2], normal_rise: i32, ending: Ending) {
        let is_open = ending == Ending::Open;
        let has_risen = normal_rise > ASKED_SHARE;
        let mut has_slid = test.is_confirmed;
        if !test.is_confirmed {
            self.limit = test.limit;
            if has_risen && !is_open && !self.seen.shows_rest() {
                has_slid = self.has_come_back(test, shear.max(self.slots.shear[0]));
            }
        }
        let stayed = !has_slid && !is_open && (has_risen || self.seen.shows_rest());
        self.finding = if has_slid {
            Finding::Slid
        } else if is_open {
            Finding::Open
        } else {
            Finding::Held
        };
        if has_slid {
            self.carried = self.carried.min(self.limit);
            // Shear that fell by little falls as low again without a swing. A later slide is not taken back with an earlier one.
            let may_swing =
                test.is_confirmed && !self.is_watched() && self.has_fallen_by(test.shear, NEWS_SHARE);
            self.found = may_swing.then_some(Test { for_us: 0, ..*test });
        }
        let is_gone = GONE_LOAD_PART * shear <= test.fell_from;
        let may_have_moved = test.fell_from > self.moved_load.from() && !is_gone;
        if stayed && may_have_moved && self.has_fallen_by(shear, NEWS_SHARE / 2) {
            self.moved_load.fell(test.fell_from);
        }
        // Shear that stayed while the grip rose is the whole load; otherwise some of it may be hidden.
        self.load = if stayed {
            shear
        } else {
            shear.max(self.load - self.load / 10)
        };
        (self.hush_us, self.held_normal) = if stayed {
            // Shear that stays at the risen grip does not say that a new contact was held before.
            let held_at = if test.is_new() { normal } else { test.normal };
            (HUSH_HELD_US, held_at)
        } else {
            (HUSH_US, 0)
        };
        self.short_us = 0;
        self.fading.restart(shear, normal);
        self.tested = self.tested.max(if is_open { test.shear } else { shear });
        self.untried_us = 0;
        self.test = None;
    }

    /// Takes back a slide that a test found if the shear soon falls as low again under more normal force: a slide would carry more. The
    /// load swings.
    pub(super) fn doubt_slide(&mut self, normal: i32, passed_us: u32) {
        let Some(mut found) = self.found else { return };
        found.for_us += passed_us;
        self.found = (found.for_us < DOUBTED_US).then_some(found);
        let is_low_again = 16 * i64::from(self.slots.shear[0]) < 17 * i64::from(found.shear)
            && 4 * i64::from(normal) > 5 * i64::from(found.normal);
        if !is_low_again || self.test.is_some_and(|test| test.is_confirmed) {
            return;
        }
        self.found = None;
        self.has_slid = found.limit != UNLIMITED;
        self.carried = self.carried.max(found.carried);
        if let Some(test) = &mut self.test {
            test.limit = found.limit;
        } else {
            self.limit = found.limit;
        }
    }

    /// Whether a load that came back while the grip rose had slid for a moment; then it limits friction. Otherwise the load swung.
    pub(super) fn has_come_back(&mut self, test: &Test, latest: i32) -> bool {
        let began_at = ratio(test.shear, test.normal);
        if began_at < self.min_friction() {
            return false;
        }
        if test.is_first {
            let more = change(latest, test.shear.max(self.load));
            let has_slid = more > ASKED_SHARE.max(3 * self.noise());
            if has_slid {
                self.limit = self.limit.min(began_at);
            }
            return has_slid;
        }
        let share = self.short_share();
        let is_back = self.has_fallen_by(test.shear, share)
            && latest > self.load - part(self.load, share / 2)
            && change(latest, test.shear) > share / 2;
        // A map shows some of the normal force as shear, which falls and rises with the grip. At more friction a slide that the grip has
        // almost held falls by no more.
        let leak = part(self.slots.normal[0] - test.normal, SHEAR_LEAK_SHARE);
        let leaks = began_at < 2 * SLIDING_FRICTION_MIN && self.load.min(latest) - test.shear <= leak;
        if !is_back || leaks {
            return false;
        }
        // A slide begins at the same ratio again, soon after the grip has come back.
        let is_again = began_at.abs_diff(self.came_back) < began_at / 25;
        self.came_back = began_at;
        let lower = u64::from(test.proven) * u64::from(SWING_LOSS_MAX);
        let lower = divide(lower, PER_UNIT as u16) as u16;
        let limit = if is_again { began_at } else { began_at.max(lower) };
        let has_slid = is_again || self.has_fallen_by(test.shear, WHOLE / 4);
        if has_slid {
            self.limit = self.limit.min(limit);
        }
        has_slid
    }

    /// Whether a test may lower the limit. After a slide that a test has confirmed only a sudden fall shows that friction has fallen
    /// again: a load that swings falls slowly, and again and again.
    const fn may_find(&self, test: &Test) -> bool {
        !self.has_slid || test.is_sudden
    }

    /// No contact slides at less: friction falls to half by water, and sliding takes two fifths of that, a part of which a slide has already
    /// shown. A contact that has carried more than what maps err by may slide at less.
    pub(super) fn min_friction(&self) -> u16 {
        let lower = if self.carried < SLIDING_FRICTION_MIN {
            SLIDING_FRICTION_MIN
        } else {
            SLIDING_FRICTION_MIN / 3 * 2
        };
        let limit_before = self.test.map_or(self.limit, |test| test.limit);
        lower.max(self.carried / if limit_before == UNLIMITED { 4 } else { 3 })
    }
}
