//! What a contact carries, and how much friction it has proven by carrying it. Friction is never known beforehand, but
//! no contact carries more shear than friction times normal force: the largest share ever carried is a lower bound of
//! the friction, and a load that comes on raises it by itself, because the grip follows the load late.
//! Units: force 1/4096 N, ratios 1/10000, time µs. Limits: torsion counts by the lever of even pressure on a disc;
//! a friction that falls while something is held is not noticed here.

use gripline_protocol::PER_UNIT;
use gripline_protocol::message::{Configuration, MapSums};

use crate::constants::{LEAD_US, PROOF_NORMAL_MIN, SLIDE_MAPS, SLIDE_STICK_RATIO};
use crate::divide::divide;
use crate::load::{narrowed, twist};
use crate::sums::{square_root, stick_ratio_below};

/// The load of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Carried {
    /// Shear and torsion as one shear.
    now: i32,
    /// Its growth from map to map, smoothed.
    growth: i32,
    /// Now and [`LEAD_US`] further, if it grows.
    ahead: i32,
    /// `ahead` over the normal force, and `now` over it for the last two maps.
    ratio: u16,
    before: [u16; 2],
    /// Friction that was proven since the contact began.
    proven: u16,
    /// Maps in a row in which hardly a taxel stuck while the load was what friction was just proven by.
    slides: u8,
    /// When the last map came; wraps.
    at_us: u32,
    since_us: u16,
}

impl Carried {
    /// Takes a new map. Without contact all is forgotten: what comes next may be another object.
    pub fn observe(&mut self, sums: &MapSums, now_us: u64, settings: &Configuration) {
        if sums.contact == 0 {
            let since_us = self.since(now_us);
            *self = Self {
                at_us: now_us as u32,
                since_us,
                ..Self::default()
            };
            return;
        }
        let now = together(sums);
        let since_us = self.since(now_us);
        // Three fifths of the news: a map's shear fluctuates by some percent.
        self.growth += 3 * (now - self.now - self.growth) / 5;
        self.now = now;
        self.at_us = now_us as u32;
        self.since_us = since_us;
        let normal = sums.force[2];
        let ratio_now = ratio(now, normal);
        let at_friction = 16 * u32::from(ratio_now) >= 15 * u32::from(self.proven);
        self.slides = if at_friction && stick_ratio_below(sums, SLIDE_STICK_RATIO) {
            self.slides.saturating_add(1)
        } else {
            0
        };
        let more = if self.slides >= SLIDE_MAPS {
            now / 2
        } else {
            let more = divide(u64::from(self.growth.max(0).cast_unsigned()) * LEAD_US, since_us);
            (more as i32).min(now / 2)
        };
        self.ahead = now + more;
        self.ratio = ratio(self.ahead, normal);
        let [older, old] = self.before;
        self.before = [old, ratio_now];
        if normal >= PROOF_NORMAL_MIN {
            // The middle one of three: a single map proves nothing.
            let sure = older.min(old).max(older.max(old).min(ratio_now));
            self.proven = self.proven.max(sure).min(settings.friction_most);
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

    /// Whether it needs more grip than another; `friction` is the detector's.
    #[must_use]
    pub fn exceeds(&self, other: &Self, friction: u16) -> bool {
        let known = |load: &Self| i64::from(load.proven.max(friction).max(1));
        i64::from(self.ahead) * known(other) > i64::from(other.ahead) * known(self)
    }

    /// Friction that was proven.
    #[must_use]
    pub const fn friction(&self) -> u16 {
        self.proven
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

/// Shear and torsion about the centre of pressure as one shear: where (Q/μN)² + (M/(μN·2/3 a))² = 1 they slide, with
/// the radius a of a disc as large as the contact (n taxels of 4 square half pitches: a² = 4n/π).
fn together(sums: &MapSums) -> i32 {
    let [x, y, _] = sums.force.map(i64::from);
    let moment = u64::from(twist(sums).unsigned_abs().min(1 << 25));
    // 9/4 · π/4 = 1.767 = 905/512.
    let turning = (divide(moment * moment, sums.contact) * 905) >> 9;
    let square = (x * x + y * y).cast_unsigned() + turning;
    square_root(square.min((1 << 52) - 1)) as i32
}
