//! What a contact carries, and how much friction it has proven by carrying it. Friction is never known beforehand, but
//! no contact carries more shear than friction times normal force: the largest share ever carried is a lower bound of
//! the friction, and a load that comes on raises it by itself, because the grip follows the load late. Held as if friction
//! were low, a load would be met before it had proven much; so while it comes on a friction is reckoned with that most
//! skins have, until the load rests or the contact slides. Then what was proven counts.
//! Units: force 1/4096 N, ratios 1/10000, time µs. Limits: a friction that falls while something is held is not noticed
//! here.

use gripline_protocol::PER_UNIT;
use gripline_protocol::message::{Configuration, MapSums};

use crate::constants::{
    EXPECTED_FRICTION, LEAD_US, PROOF_NORMAL_MIN, REST_LEAD_US, REST_LOAD_MIN, REST_MAPS, SLIDE_MAPS,
    SLIDE_RATIO_SURE, SLIDE_STICK_RATIO, SLIDE_SURE_MAPS, STALL_RATIO_MIN, STALL_STICK_RATIO,
};
use crate::divide::divide;
use crate::form::Form;
use crate::load::{narrowed, twist};
use crate::sums::{square_root, stick_ratio_below};

/// The load of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Carried {
    /// Shear and torsion as one shear.
    now: i32,
    /// Its growth from map to map, smoothed.
    growth: i32,
    /// Now and [`LEAD_US`] or [`REST_LEAD_US`] further, if it grows; more while it slides.
    ahead: i32,
    /// `ahead` over the normal force, and `now` over it for the last two maps.
    ratio: u16,
    before: [u16; 2],
    /// Friction that was proven since the contact began.
    proven: u16,
    /// Maps in a row that looked like a slide.
    slides: u8,
    /// Maps in a row in which the load hardly grew.
    rests: u8,
    /// The load has come on, and the contact slid, since it began.
    has_rested: bool,
    has_slid: bool,
    /// When the last map came; wraps.
    at_us: u32,
    since_us: u16,
}

impl Carried {
    /// Takes a new map of a contact of that form; `reached` is what the gripper should press with by now. Without contact
    /// all is forgotten: what comes next may be another object.
    pub(crate) fn observe(
        &mut self,
        sums: &MapSums,
        form: &Form,
        reached: i32,
        now_us: u64,
        settings: &Configuration,
    ) {
        if sums.contact == 0 {
            let since_us = self.since(now_us);
            *self = Self {
                at_us: now_us as u32,
                since_us,
                ..Self::default()
            };
            return;
        }
        let now = together(sums, form);
        let since_us = self.since(now_us);
        // Three fifths of the news: a map's shear fluctuates by some percent.
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
        self.ahead = now + self.growing(since_us).max(self.sliding(ratio_now));
        self.ratio = ratio(self.ahead, normal);
        let [older, old] = self.before;
        self.before = [old, ratio_now];
        // Where maps see less than half of what presses, they do not see the same part of the shear.
        if normal >= PROOF_NORMAL_MIN && 2 * normal >= reached {
            // What one of the two maps before carried too: a single map proves nothing.
            let sure = ratio_now.min(older.max(old));
            self.proven = self.proven.max(sure).min(settings.friction_most);
        }
    }

    /// What the load grows by until the gripper follows, at most half of it. Once it has come on, the first 3/128 of it
    /// is a map's fluctuation and no growth.
    fn growing(&self, since_us: u16) -> i32 {
        let (growth, lead_us) = if self.has_rested {
            (self.growth - self.now / 128 * 3, REST_LEAD_US)
        } else {
            (self.growth, LEAD_US)
        };
        let most = u64::from((self.now / 2).cast_unsigned());
        divide(u64::from(growth.max(0).cast_unsigned()) * lead_us, since_us).min(most) as i32
    }

    /// Whether a map is one of a contact that slides: under most of the load that friction was proven by hardly a taxel
    /// sticks; or only some do, and the load over the normal force, which came on for the first time, does so no more.
    fn looks_like_slide(&self, sums: &MapSums, ratio_now: u16) -> bool {
        let at_friction = 8 * u32::from(ratio_now) >= 7 * u32::from(self.proven);
        let [older, _] = self.before;
        // A load that comes slowly, and that the grip follows, looks the same later on.
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

    /// What a contact that slides needs beyond what it shows: sliding carries no more than friction allows. Half of it as
    /// soon as that is sure; else, as one of high friction looks alike while it holds, an eighth more with every map.
    fn sliding(&self, ratio_now: u16) -> i32 {
        if self.slides >= SLIDE_SURE_MAPS && ratio_now <= SLIDE_RATIO_SURE {
            self.now / 2
        } else {
            self.now / 8 * i32::from(self.slides.saturating_sub(SLIDE_MAPS).min(4))
        }
    }

    /// 1 to 65 ms.
    fn since(&self, now_us: u64) -> u16 {
        (now_us as u32)
            .wrapping_sub(self.at_us)
            .clamp(1_000, u16::MAX.into()) as u16
    }

    /// The shear that the grip must hold.
    #[must_use]
    pub const fn shear(&self) -> i32 {
        self.ahead
    }

    /// It over the normal force.
    #[must_use]
    pub const fn ratio(&self) -> u16 {
        self.ratio
    }

    /// Time between the last two maps, at most 65 ms.
    #[must_use]
    pub const fn since_us(&self) -> u16 {
        self.since_us
    }

    /// Whether it needs more grip than another.
    #[must_use]
    pub fn exceeds(&self, other: &Self, settings: &Configuration) -> bool {
        let known = |load: &Self| i64::from(load.friction(settings).max(settings.friction).max(1));
        i64::from(self.ahead) * known(other) > i64::from(other.ahead) * known(self)
    }

    /// Friction to reckon with, besides the detector's: what was proven, and at least what is expected while the load
    /// comes on.
    #[must_use]
    pub fn friction(&self, settings: &Configuration) -> u16 {
        let expected = if self.has_rested || self.has_slid {
            0
        } else {
            EXPECTED_FRICTION.min(settings.friction_most)
        };
        self.proven.max(expected)
    }
}

/// Shear over normal force, at most 65535.
fn ratio(shear: i32, normal: i32) -> u16 {
    let (normal, shift) = narrowed(normal);
    let share = divide(
        (u64::from(shear.max(0).cast_unsigned()) * u64::from(PER_UNIT)) >> shift,
        normal,
    );
    share.min(u16::MAX.into()) as u16
}

/// Shear and torsion about the centre of pressure as one shear: they slide where the sum of their squares is what friction
/// holds, with the torsion over the contact's lever.
fn together(sums: &MapSums, form: &Form) -> i32 {
    let [x, y, _] = sums.force.map(i64::from);
    let square = (x * x + y * y).cast_unsigned() + form.square_of_seen_twist(twist(sums));
    square_root(square.min((1 << 52) - 1)) as i32
}
