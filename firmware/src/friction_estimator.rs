//! The friction that a contact has proven by the load it carried. No contact carries more shear than friction times normal force,
//! so the largest share so far is a lower limit of the friction. A growing load raises it, because the grip follows late. A grip
//! for low friction would grip so hard that the load proves little. So the estimator assumes typical friction until the load
//! settles or the contact slides; from then on the proven friction counts.
//!
//! Proven friction may become outdated: a [slide](crate::slide_witness) limits it, also below the detector's friction. Friction that falls slowly
//! slides only when nothing is left of the margin, and then far. So what was proven is proven for then: after [`PROVEN_US`] a part of it is
//! forgotten, and the grip becomes firmer, until the load proves it again.
//!
//! Units: force 1/4096 N, ratios 1/10000, time µs.

use gripline_protocol::message::MapSums;
use gripline_protocol::{Motion, PER_UNIT};

use crate::arithmetic::{divide, ratio, square_root};
use crate::constants::{
    EXPECTED_FRICTION, FIRST_LOAD_STICK_RATIO, FORGETTING_US, FORGOTTEN_PART, LEAD_US, PROOF_NORMAL_MIN,
    PROVEN_US, REMEMBERED_SHARE, REST_LEAD_US, REST_LOAD_MIN, REST_MAPS, SLIDE_MAPS, SLIDE_RATIO_SURE,
    SLIDE_STICK_RATIO, SLIDE_SURE_MAPS, STALL_RATIO_MIN, STALL_STICK_RATIO,
};
use crate::contact_geometry::ContactGeometry;
use crate::learning_settings::LearningSettings;
use crate::load::torsional_moment;
use crate::slide_witness::{SlideWitness, Verdict};
use crate::sums::stick_ratio_below;

/// The load that the grip must hold at one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct LoadEstimate {
    /// The shear to hold, 1/4096 N, and the same over the normal force, 1/10000.
    pub(crate) shear: i32,
    pub(crate) ratio: u16,
    /// Friction that the grip may count on, 1/10000.
    pub(crate) friction: u16,
    /// Time between the last two maps, µs, at most 65 ms.
    pub(crate) since_us: u16,
    /// The host has seen the object of late, and will see it move.
    pub(crate) is_watched: bool,
}

impl LoadEstimate {
    /// Whether this fingertip needs more grip than the other.
    pub(crate) fn exceeds(&self, other: &Self) -> bool {
        let known = |load: &Self| i64::from(load.friction.max(1));
        i64::from(self.shear) * known(other) > i64::from(other.shear) * known(self)
    }
}

/// The load on one fingertip and the friction it has proven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct FrictionEstimator {
    /// Load: shear and torsional moment as one shear.
    now: i32,
    /// Growth of the load from map to map, smoothed.
    growth: i32,
    /// Load expected [`LEAD_US`] or [`REST_LEAD_US`] ahead; more while the contact slides, and at least the remembered load.
    ahead: i32,
    /// `ahead` over the normal force; `before`: `now` over it in the last two maps.
    ratio: u16,
    before: [u16; 2],
    /// Friction proven since the contact began: what of it is not forgotten, the most, and the time since it was proven.
    proven: u16,
    most_proven: u16,
    proven_for_us: u32,
    /// Maps in a row that looked like a slide.
    slides: u8,
    /// Maps in a row in which the load hardly grew.
    rests: u8,
    /// Since the contact began: the load has settled; the contact has slid.
    has_rested: bool,
    has_slid: bool,
    /// The first load has not settled, and fewer taxels stick than [`FIRST_LOAD_STICK_RATIO`].
    may_slide: bool,
    /// Whether it slides, whatever the friction.
    slide: SlideWitness,
    /// When the last map came; wraps.
    at_us: u32,
    since_us: u16,
}

impl FrictionEstimator {
    /// Takes a new map of a contact with this geometry. `reached` is the force that the gripper should have reached by now.
    /// Without contact it forgets everything: the next object may be another one.
    pub(crate) fn observe(
        &mut self,
        sums: &MapSums,
        geometry: &ContactGeometry,
        reached: i32,
        now_us: u64,
        settings: LearningSettings,
    ) {
        let passed_us = (now_us as u32).wrapping_sub(self.at_us);
        let since_us = passed_us.clamp(1_000, u16::MAX.into()) as u16;
        if sums.contact == 0 {
            *self = Self {
                at_us: now_us as u32,
                since_us,
                slide: self.slide.without_contact(),
                ..Self::default()
            };
            return;
        }
        let now = load_of(sums, geometry);
        // Three fifths of the change: a map's shear fluctuates by some percent.
        self.growth += 3 * (now - self.now - self.growth) / 5;
        self.now = now;
        self.at_us = now_us as u32;
        self.since_us = since_us;
        let normal = sums.force[2];
        let ratio_now = ratio(now, normal);
        self.slides = if self.looks_like_slide(sums, ratio_now) {
            self.slides.saturating_add(1)
        } else {
            0
        };
        self.rests = if now > REST_LOAD_MIN && 16 * self.growth < now {
            self.rests.saturating_add(1)
        } else {
            0
        };
        self.has_rested |= self.rests >= REST_MAPS;
        self.has_slid |= self.slides >= SLIDE_MAPS;
        self.may_slide = !self.has_rested
            && ratio_now > STALL_RATIO_MIN
            && stick_ratio_below(sums, FIRST_LOAD_STICK_RATIO);
        self.ahead = now + self.growing(since_us).max(self.sliding(ratio_now));
        self.ratio = ratio(self.ahead, normal);
        let [older, old] = self.before;
        self.before = [old, ratio_now];
        // Maps that see less than half of the normal force see another part of the shear.
        if normal >= PROOF_NORMAL_MIN && 2 * normal >= reached {
            // One of the two previous maps must agree: a single map proves nothing.
            let sure = ratio_now.min(older.max(old));
            if sure >= self.proven {
                (self.proven, self.proven_for_us) = (sure, 0);
            }
            self.most_proven = self.most_proven.max(sure).min(settings.friction_max);
            self.proven = self.proven.min(settings.friction_max);
        }
        self.slide.miss(passed_us - u32::from(since_us).min(passed_us));
        self.forget(passed_us);
    }

    /// Forgets a part of the proven friction, which may have fallen since. Where the host sees the object, a slide shows at once.
    fn forget(&mut self, passed_us: u32) {
        if self.slide.is_watched() {
            return;
        }
        // After a time without maps it takes some maps until all of it is forgotten.
        self.proven_for_us = self.proven_for_us.saturating_add(passed_us);
        if self.proven_for_us > PROVEN_US + FORGETTING_US {
            self.proven_for_us -= FORGETTING_US;
            let remembered = u64::from(self.most_proven) * u64::from(REMEMBERED_SHARE);
            let remembered = divide(remembered, PER_UNIT as u16) as u16;
            self.proven = remembered.max(self.proven - self.proven / FORGOTTEN_PART);
        }
    }

    /// Asks the slide witness about the map that [`FrictionEstimator::observe`] took. `seen` is the host's evidence of motion in
    /// it.
    pub(crate) fn ask_witness(&mut self, sums: &MapSums, seen: Motion, settings: LearningSettings) {
        let friction = self.proven.max(settings.friction);
        self.slide
            .observe(self.now, sums, self.since_us, seen, friction, settings);
        self.ahead = self.ahead.max(self.slide.hidden_load());
        self.ratio = ratio(self.ahead, sums.force[2]);
    }

    /// Growth of the load until the gripper follows, at most half of the load. Once the load has settled, the first 3/128
    /// count as fluctuation.
    fn growing(&self, since_us: u16) -> i32 {
        let (growth, lead_us) = if self.has_rested {
            (self.growth - self.now / 128 * 3, REST_LEAD_US)
        } else {
            (self.growth, LEAD_US)
        };
        let max = u64::from((self.now / 2).cast_unsigned());
        divide(u64::from(growth.max(0).cast_unsigned()) * lead_us, since_us).min(max) as i32
    }

    /// Whether a map looks like sliding. The load is near the one that proved the friction, and hardly a taxel sticks. Or, at
    /// the first load, few taxels stick and the load over the normal force has stopped growing.
    fn looks_like_slide(&self, sums: &MapSums, ratio_now: u16) -> bool {
        let at_friction = 8 * u32::from(ratio_now) >= 7 * u32::from(self.most_proven);
        let [older, _] = self.before;
        // Only at the first load: later, a slow load that the grip follows looks the same.
        let stalls = !self.has_rested
            && older > 0
            && ratio_now > STALL_RATIO_MIN
            && 16 * u32::from(ratio_now) < 17 * u32::from(older);
        let stick_ratio = if stalls {
            STALL_STICK_RATIO
        } else {
            SLIDE_STICK_RATIO
        };
        at_friction && stick_ratio_below(sums, stick_ratio)
    }

    /// The hidden load of a sliding contact: while it slides it carries no more than friction allows. Half of the visible load when
    /// sliding is sure. Otherwise an eighth more per map, because high friction looks the same while it holds.
    fn sliding(&self, ratio_now: u16) -> i32 {
        if self.slides >= SLIDE_SURE_MAPS && ratio_now <= SLIDE_RATIO_SURE {
            self.now / 2
        } else {
            self.now / 8 * i32::from(self.slides.saturating_sub(SLIDE_MAPS).min(4))
        }
    }

    /// The verdict of its slide witness. A first load that slides looks like one that grows no more: the line does not fall while it may.
    pub(crate) fn witness(&self) -> Verdict {
        let verdict = self.slide.verdict();
        Verdict {
            may_fall: verdict.may_fall && !self.may_slide,
            ..verdict
        }
    }

    /// The load that the grip must hold.
    pub(crate) fn estimate(&self, settings: LearningSettings) -> LoadEstimate {
        LoadEstimate {
            shear: self.ahead,
            ratio: self.ratio,
            friction: self.friction(settings),
            since_us: self.since_us,
            is_watched: self.slide.is_watched(),
        }
    }

    /// Friction for the feed-forward, 1/10000: what was proven, at least the detector's, and typical friction until the load
    /// settles; limited by the last slide.
    fn friction(&self, settings: LearningSettings) -> u16 {
        let expected = if self.has_rested || self.has_slid {
            0
        } else {
            EXPECTED_FRICTION.min(settings.friction_max)
        };
        self.proven
            .max(expected)
            .max(settings.friction)
            .min(self.slide.limit())
    }
}

/// Shear and torsional moment as one shear: the root of the sum of their squares, the moment over the contact's lever.
fn load_of(sums: &MapSums, geometry: &ContactGeometry) -> i32 {
    let [x, y, _] = sums.force.map(i64::from);
    let square = (x * x + y * y).cast_unsigned() + geometry.square_of_seen_moment(torsional_moment(sums));
    square_root(square.min((1 << 52) - 1)) as i32
}

#[cfg(test)]
mod tests {
    use gripline_protocol::message::Configuration;

    use super::*;

    /// Whether the line may fall after maps of a first load: the share of the normal force that it is, map by map, and how many of ten
    /// taxels stick.
    fn may_fall(shares: &[f64], stick: u16) -> bool {
        let settings = LearningSettings::of(&Configuration::DEFAULT);
        let geometry = ContactGeometry::default();
        let mut estimator = FrictionEstimator::default();
        let normal = 4_096;
        let mut now_us = 0;
        // A touch without a load, for longer than any suspicion lasts.
        for share in [0.0; 60].iter().chain(shares) {
            let load = (share * f64::from(normal)) as i32;
            let sums = MapSums {
                contact: 10,
                stick: if load > 0 { stick } else { 10 },
                force: [load, 0, normal],
                ..MapSums::default()
            };
            estimator.observe(&sums, &geometry, normal, now_us, settings);
            estimator.ask_witness(&sums, Motion::UNKNOWN, settings);
            now_us += 16_667;
        }
        estimator.witness().may_fall
    }

    /// The friction that a quiet contact counts on, each second, 1/10000: it carries 0.75 of its normal force for half a second, then `share`.
    fn friction_by_second(share: f64, seen: Motion, maps_per_second: u64) -> [u16; 30] {
        let settings = LearningSettings::of(&Configuration::DEFAULT);
        let geometry = ContactGeometry::default();
        let mut estimator = FrictionEstimator::default();
        let normal = 8_192;
        let mut frictions = [0; 30];
        for map in 0..maps_per_second * 30 {
            let now_us = map * 1_000_000 / maps_per_second;
            let carried = if now_us < 500_000 { 0.75 } else { share };
            let sums = MapSums {
                contact: 20,
                stick: 12,
                force: [(carried * f64::from(normal)) as i32, 0, normal],
                ..MapSums::default()
            };
            estimator.observe(&sums, &geometry, normal, now_us, settings);
            estimator.ask_witness(&sums, seen, settings);
            frictions[(map / maps_per_second) as usize] = estimator.estimate(settings).friction;
        }
        frictions
    }

    #[test]
    fn proven_friction_counts_for_four_seconds_and_then_a_fifth_of_it_is_forgotten_at_two_percent_a_second() {
        for maps_per_second in [20, 60, 1_000] {
            let frictions = friction_by_second(0.58, Motion::UNKNOWN, maps_per_second);
            assert_eq!(frictions[1..4], [7_500; 3], "{maps_per_second} Hz");
            let at_10_s = 0.98_f64.powf(5.5) * 7_500.0;
            assert!(
                (f64::from(frictions[9]) - at_10_s).abs() < 60.0,
                "{maps_per_second} Hz: {frictions:?}"
            );
            assert!(frictions[1..].is_sorted_by(|before, after| before >= after));
            assert_eq!(frictions[29], 6_000, "{maps_per_second} Hz");
        }
    }

    #[test]
    fn friction_that_the_load_proves_again_and_again_is_not_forgotten() {
        assert_eq!(friction_by_second(0.75, Motion::UNKNOWN, 60), [7_500; 30]);
        // A load that grew since: that is what it proves.
        assert_eq!(friction_by_second(0.7, Motion::UNKNOWN, 60)[29], 6_999);
    }

    #[test]
    fn nothing_is_forgotten_while_the_host_sees_the_object() {
        assert_eq!(
            friction_by_second(0.58, Motion::new(0, Motion::QUALITY_MAX), 60),
            [7_500; 30]
        );
    }

    #[test]
    fn time_without_a_map_counts_for_forgetting() {
        let settings = LearningSettings::of(&Configuration::DEFAULT);
        let geometry = ContactGeometry::default();
        let mut estimator = FrictionEstimator::default();
        let normal = 8_192;
        let mut see = |from_ms: u32, to_ms: u32, share: f64, seen: Motion| {
            for ms in (from_ms..to_ms).step_by(16) {
                let sums = MapSums {
                    contact: 20,
                    stick: 12,
                    force: [(share * f64::from(normal)) as i32, 0, normal],
                    ..MapSums::default()
                };
                estimator.observe(&sums, &geometry, normal, u64::from(ms) * 1_000, settings);
                estimator.ask_witness(&sums, seen, settings);
            }
            (estimator.proven, estimator.slide.is_watched())
        };
        see(0, 500, 0.75, Motion::UNKNOWN);
        assert_eq!(see(500, 1_000, 0.58, Motion::UNKNOWN), (7_500, false));
        let (proven, _) = see(11_000, 11_500, 0.58, Motion::UNKNOWN);
        assert!(proven < 7_000, "{proven}");
        // So does the host's last view of the object.
        assert_eq!(see(11_500, 11_600, 0.58, Motion::new(0, 3)), (proven, true));
        let (_, is_watched) = see(13_000, 13_032, 0.58, Motion::UNKNOWN);
        assert!(!is_watched);
    }

    #[test]
    fn a_first_load_of_which_few_taxels_stick_lets_the_line_not_fall_before_it_has_settled() {
        let grows = [0.2, 0.4, 0.55, 0.65, 0.73];
        assert!(!may_fall(&grows, 3), "it may slide already");
        assert!(may_fall(&grows, 6), "most of it sticks");
        let mut settled = [0.73; 25];
        settled[..5].copy_from_slice(&grows);
        assert!(may_fall(&settled, 3), "it has settled");
    }
}
