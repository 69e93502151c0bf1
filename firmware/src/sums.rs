//! What one force map says: contact, stick, total force, moment, centre of pressure; all at once or packet by packet.
//!
//! Units: forces 1/4096 N; places in half taxel pitches (0.8 mm), odd numbers from −19 to 19 from the map's centre.
//! No branch on the forces, so the work depends on the number of taxels only. No sum can overflow: 400 taxels of 2¹⁵
//! at a distance of at most 19 give |Σ(x fy − y fx)| ≤ 400·38·2¹⁵ < 2³¹.

use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_protocol::message::{Configuration, MapSums};
use gripline_protocol::{ForceMap, PER_UNIT, SIDE, TAXELS, TaxelForce};

use crate::friction::Friction;

/// Half the distance between taxel centres, micrometres.
const HALF_PITCH_UM: i64 = 800;
const _: () = assert!(HALF_PITCH_UM as f64 * 2.0 == TAXEL_PITCH_MM * 1_000.0);

/// What decides about a taxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TaxelRule {
    /// The detector's friction coefficient.
    pub friction: Friction,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N; at least 0.
    pub contact_min: i16,
}

impl TaxelRule {
    /// The rule of settings that [`Configuration::check`] passed; friction beyond its range counts as 2.
    #[must_use]
    pub const fn of(settings: &Configuration) -> Self {
        Self {
            friction: Friction::clamped(settings.friction),
            contact_min: settings.contact_min,
        }
    }

    /// Whether a taxel is in contact, and whether it sticks.
    #[inline]
    #[must_use]
    pub fn decide(self, force: TaxelForce) -> (bool, bool) {
        let (x, y) = (i32::from(force.x), i32::from(force.y));
        // Each square is at most 2³⁰, so the sum fits u32.
        let shear_square = (x * x).cast_unsigned() + (y * y).cast_unsigned();
        let contact = force.z > self.contact_min;
        (
            contact,
            contact & (shear_square <= self.friction.shear_square_bound(force.z)),
        )
    }
}

/// Place of every taxel's centre: (x, y) in half pitches.
static PLACES: [(i16, i16); TAXELS] = {
    let mut places = [(0, 0); TAXELS];
    let mut taxel = 0;
    while taxel < TAXELS {
        places[taxel] = (half_pitches(taxel % SIDE), half_pitches(taxel / SIDE));
        taxel += 1;
    }
    places
};

const fn half_pitches(index: usize) -> i16 {
    2 * index as i16 - (SIDE as i16 - 1)
}

/// Adds taxels to the sums. `taxels` are (number, force); numbers past the map are ignored.
#[inline]
pub fn accumulate(sums: &mut MapSums, taxels: impl Iterator<Item = (u16, TaxelForce)>, rule: TaxelRule) {
    // A local copy, so that the compiler may keep the sums in registers over the loop.
    let mut local = *sums;
    for (taxel, force) in taxels {
        let Some(&(x, y)) = PLACES.get(usize::from(taxel)) else {
            continue;
        };
        let (x, y) = (i32::from(x), i32::from(y));
        let (fx, fy, fz) = (i32::from(force.x), i32::from(force.y), i32::from(force.z));
        let (contact, stick) = rule.decide(force);
        local.contact += u16::from(contact);
        local.stick += u16::from(stick);
        local.force[0] += fx;
        local.force[1] += fy;
        local.force[2] += fz;
        local.moment += x * fy - y * fx;
        local.pressure[0] += x * fz;
        local.pressure[1] += y * fz;
    }
    *sums = local;
}

/// The sums of a whole map.
#[must_use]
pub fn sums_of(map: &ForceMap, rule: TaxelRule) -> MapSums {
    let mut sums = MapSums::default();
    accumulate(&mut sums, (0..).zip(map.taxels.iter().copied()), rule);
    sums
}

/// Stick ratio in 1/10000, rounded down; `None` when nothing is in contact.
///
/// For people and trends. Thresholds are compared exactly by [`stick_ratio_below`].
#[must_use]
pub fn stick_ratio(sums: &MapSums) -> Option<u16> {
    (u32::from(sums.stick) * PER_UNIT)
        .checked_div(u32::from(sums.contact))
        .map(|ratio| ratio as u16)
}

/// Whether stick / contact < threshold (1/10000), exactly; false when nothing is in contact.
#[must_use]
pub const fn stick_ratio_below(sums: &MapSums, threshold: u16) -> bool {
    (sums.stick as u32) * PER_UNIT < threshold as u32 * sums.contact as u32
}

/// F_T of the whole map, 1/4096 N, rounded down.
#[must_use]
pub fn total_shear(sums: &MapSums) -> i32 {
    let [x, y, _] = sums.force;
    let square = u64::from(x.unsigned_abs()).pow(2) + u64::from(y.unsigned_abs()).pow(2);
    // At most √2 · 400 · 2¹⁵ < 2²⁵.
    square.isqrt() as i32
}

/// Centre of pressure Σ(x fz)/Σ fz, Σ(y fz)/Σ fz in micrometres from the map's centre, rounded towards zero; `None`
/// when nothing presses.
#[must_use]
pub fn centre_of_pressure_um(sums: &MapSums) -> Option<[i32; 2]> {
    let normal = i64::from(sums.force[2]);
    // |Σ x fz| < 2²⁸, so the product fits i64; forces that pull as well as push can put the centre anywhere.
    let place = |moment: i32| i32::try_from(i64::from(moment) * HALF_PITCH_UM / normal).ok();
    if normal <= 0 {
        None
    } else {
        Some([place(sums.pressure[0])?, place(sums.pressure[1])?])
    }
}
