//! The force map in the wire's units: 20×20 taxels of (fx, fy, fz) in 1/4096 N, row-major, x to the right and y up
//! as seen from outside the sensor (row 0 is the lowest y), z positive into the surface.
//! Limits: ±8 N a taxel; conversion from newtons saturates and counts, and refuses NaN and infinity.

use core::fmt;

use crate::constants::{BITMAP_BYTES, LSB_PER_NEWTON, SIDE, TAXEL_BYTES, TAXELS};
use crate::rounds::at_most;

/// The force on one taxel, each component in units of 1/4096 N.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TaxelForce {
    /// Shear along the rows (to the right seen from outside).
    pub x: i16,
    /// Shear along the columns (up seen from outside).
    pub y: i16,
    /// Normal force, positive into the surface.
    pub z: i16,
}

impl TaxelForce {
    /// No force at all: such a taxel is not sent.
    pub const ZERO: Self = Self { x: 0, y: 0, z: 0 };

    /// The bytes on the wire: x, y, z, little-endian.
    #[inline]
    #[must_use]
    pub const fn from_le_bytes([x0, x1, y0, y1, z0, z1]: [u8; TAXEL_BYTES]) -> Self {
        Self {
            x: i16::from_le_bytes([x0, x1]),
            y: i16::from_le_bytes([y0, y1]),
            z: i16::from_le_bytes([z0, z1]),
        }
    }

    /// The bytes on the wire: x, y, z, little-endian.
    #[inline]
    #[must_use]
    pub const fn to_le_bytes(self) -> [u8; TAXEL_BYTES] {
        let ([x0, x1], [y0, y1], [z0, z1]) =
            (self.x.to_le_bytes(), self.y.to_le_bytes(), self.z.to_le_bytes());
        [x0, x1, y0, y1, z0, z1]
    }
}

/// Forces on all taxels, row-major.
#[derive(Clone, PartialEq, Eq)]
pub struct ForceMap {
    /// Taxel `row * 20 + column`.
    pub taxels: [TaxelForce; TAXELS],
}

impl fmt::Debug for ForceMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ForceMap")
            .field("active", &self.active().count())
            .finish_non_exhaustive()
    }
}

/// How many of the 1,200 components exceeded ±8 N and were clipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Saturated(pub u16);

/// A force that is NaN or infinite: the whole map is refused.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NotFinite {
    /// Taxel `row * 20 + column`.
    pub taxel: u16,
    /// 0, 1, 2 for x, y, z.
    pub axis: u8,
    /// What was found: NaN or an infinity.
    pub found: f32,
}

impl fmt::Display for NotFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = ["x", "y", "z"][usize::from(self.axis.min(2))];
        let (row, column) = (usize::from(self.taxel) / SIDE, usize::from(self.taxel) % SIDE);
        write!(
            f,
            "force {axis} at row {row}, column {column}: found {}, expected a finite number of newtons",
            self.found
        )
    }
}

impl core::error::Error for NotFinite {}

impl ForceMap {
    /// A map without any force.
    pub const EMPTY: Self = Self {
        taxels: [TaxelForce::ZERO; TAXELS],
    };

    /// Newtons per taxel to wire units, rounded to nearest (ties away from zero).
    ///
    /// # Errors
    /// [`NotFinite`] names the first taxel and axis that is NaN or infinite.
    pub fn quantise(newtons: &[[f32; 3]; TAXELS]) -> Result<(Self, Saturated), NotFinite> {
        let mut map = Self::EMPTY;
        let mut saturated = 0;
        for (taxel, (force, out)) in newtons.iter().zip(&mut map.taxels).enumerate() {
            let mut steps = [0; 3];
            for (axis, (&newton, step)) in force.iter().zip(&mut steps).enumerate() {
                if !newton.is_finite() {
                    return Err(NotFinite {
                        taxel: taxel as u16,
                        axis: axis as u8,
                        found: newton,
                    });
                }
                let (value, clipped) = quantise_component(f64::from(newton));
                *step = value;
                saturated += u16::from(clipped);
            }
            *out = TaxelForce {
                x: steps[0],
                y: steps[1],
                z: steps[2],
            };
        }
        Ok((map, Saturated(saturated)))
    }

    /// Wire units to newtons per taxel; exact, because every step is a power of two.
    #[must_use]
    pub fn dequantise(&self) -> [[f32; 3]; TAXELS] {
        let newton = |step: i16| f32::from(step) / LSB_PER_NEWTON as f32;
        self.taxels
            .map(|force| [newton(force.x), newton(force.y), newton(force.z)])
    }

    /// The taxels with any force; only these are sent.
    #[must_use]
    pub fn active(&self) -> ActiveSet {
        let mut active = ActiveSet::EMPTY;
        for (taxel, force) in self.taxels.iter().enumerate() {
            if *force != TaxelForce::ZERO {
                active.insert(taxel);
            }
        }
        active
    }
}

/// One component in newtons to wire units: (steps, whether it was clipped to ±8 N). `newton` must be finite.
///
/// f64 and a plain comparison keep this free of libm, so that it also builds for the microcontroller.
#[must_use]
pub fn quantise_component(newton: f64) -> (i16, bool) {
    let scaled = newton * f64::from(LSB_PER_NEWTON);
    // `as` truncates towards zero and saturates; the remainder is exact. (Adding half a step first would round too: it carries
    // the number just below a half over.)
    let whole = scaled as i64;
    let rest = scaled - whole as f64;
    let rounded = whole.saturating_add(i64::from(rest >= 0.5) - i64::from(rest <= -0.5));
    let clipped = rounded.clamp(i64::from(i16::MIN), i64::from(i16::MAX));
    (clipped as i16, clipped != rounded)
}

/// The taxels that a map carries, one bit each; taxel 0 is the lowest bit of byte 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActiveSet {
    bytes: [u8; BITMAP_BYTES],
}

impl ActiveSet {
    /// No taxel.
    pub const EMPTY: Self = Self {
        bytes: [0; BITMAP_BYTES],
    };

    /// The bytes on the wire.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; BITMAP_BYTES]) -> Self {
        Self { bytes }
    }

    /// The bytes on the wire.
    #[must_use]
    pub const fn as_bytes(&self) -> &[u8; BITMAP_BYTES] {
        &self.bytes
    }

    /// Adds a taxel; numbers past the last taxel are ignored.
    pub fn insert(&mut self, taxel: usize) {
        if let Some(byte) = self.bytes.get_mut(taxel / 8) {
            *byte |= 1 << (taxel % 8);
        }
    }

    /// Whether the taxel is in the set.
    #[must_use]
    pub fn contains(&self, taxel: usize) -> bool {
        self.bytes
            .get(taxel / 8)
            .is_some_and(|byte| byte >> (taxel % 8) & 1 == 1)
    }

    /// How many taxels are in the set, 0 to 400.
    #[must_use]
    pub fn count(&self) -> u16 {
        self.bytes.iter().map(|byte| byte.count_ones() as u16).sum()
    }

    /// Writes the taxels' places in ascending order and returns their number. The rest of `out` holds any places of the map.
    ///
    /// The receiver does this once per map, so later packets need no bit search. The work is the same for every set: each
    /// step writes four places and keeps those whose bits are set.
    #[inline]
    pub fn places(&self, out: &mut [Place; TAXELS]) -> u16 {
        let mut listed = Listed::default();
        self.list::<BITMAP_BYTES>(&mut listed, out);
        listed.count as u16
    }

    /// The same for the next `BYTES` of the bitmap, each of eight taxels.
    #[inline]
    pub(crate) fn list<const BYTES: usize>(&self, listed: &mut Listed, out: &mut [Place; TAXELS]) {
        let from = usize::from(listed.bytes);
        let rest = self.bytes.get(from..).unwrap_or_default();
        let bytes = rest.get(..BYTES).unwrap_or(rest);
        let (mut count, mut first) = (listed.count, listed.first);
        for &byte in at_most::<BYTES, _>(bytes) {
            for nibble in at_most::<2, _>([byte & 0xF, byte >> 4]) {
                let ([a, b, c, d], more) = NIBBLES[usize::from(nibble & 0xF)];
                // Four more than the bits before always fit.
                if let Some([w, x, y, z]) = out.get_mut(count..count + NIBBLE) {
                    *w = Place(first.0 + a);
                    *x = Place(first.0 + b);
                    *y = Place(first.0 + c);
                    *z = Place(first.0 + d);
                }
                count += more as usize;
                first.0 += NIBBLE as u32;
                // No four bits lie in two rows.
                if first.column() == SIDE as u16 {
                    first = Place::new(0, first.row() + 1);
                }
            }
        }
        *listed = Listed {
            bytes: (from + bytes.len()) as u8,
            count,
            first,
        };
    }
}

/// How far the list of places has come.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Listed {
    /// Bytes of the bitmap.
    bytes: u8,
    /// Taxels in them.
    pub(crate) count: usize,
    /// The first taxel of the next byte.
    first: Place,
}

impl Listed {
    #[inline]
    pub(crate) const fn is_done(&self) -> bool {
        self.bytes as usize >= BITMAP_BYTES
    }
}

/// Bits per step of [`ActiveSet::places`].
const NIBBLE: usize = 4;

/// For every four bits: the columns of the set ones, and their number.
static NIBBLES: [([u32; NIBBLE], u32); 1 << NIBBLE] = {
    let mut nibbles = [([0; NIBBLE], 0); 1 << NIBBLE];
    let mut bits = 0;
    while bits < nibbles.len() {
        let (mut count, mut bit) = (0, 0);
        while bit < NIBBLE as u32 {
            if bits >> bit & 1 == 1 {
                nibbles[bits].0[count] = bit;
                count += 1;
            }
            bit += 1;
        }
        nibbles[bits].1 = count as u32;
        bits += 1;
    }
    nibbles
};

/// A taxel's place: column in the lower half-word, row in the upper one, both from 0. The microcontroller's instructions on
/// pairs of half-words need this layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(transparent)]
pub struct Place(u32);

impl Place {
    /// The place in this column and row.
    #[must_use]
    pub const fn new(column: u16, row: u16) -> Self {
        Self(column as u32 | (row as u32) << 16)
    }

    /// From 0, along x.
    #[must_use]
    pub const fn column(self) -> u16 {
        self.0 as u16
    }

    /// From 0, along y.
    #[must_use]
    pub const fn row(self) -> u16 {
        (self.0 >> 16) as u16
    }

    /// The taxel's number, `row * 20 + column`.
    #[must_use]
    pub const fn taxel(self) -> u16 {
        self.row() * SIDE as u16 + self.column()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn infinity_and_nan_are_refused_and_name_the_taxel() {
        for found in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut newtons = [[0.0; 3]; TAXELS];
            newtons[7 * SIDE + 3][1] = found;
            let error = ForceMap::quantise(&newtons).unwrap_err();
            assert_eq!((error.taxel, error.axis), (143, 1));
            assert!(std::format!("{error}").contains("row 7, column 3"));
        }
    }

    #[test]
    fn forces_beyond_the_range_saturate_and_are_counted() {
        let mut newtons = [[0.0; 3]; TAXELS];
        newtons[0] = [8.0, -8.0, -8.1];
        newtons[399] = [f32::MAX, f32::MIN, 7.9997];
        let (map, saturated) = ForceMap::quantise(&newtons).unwrap();
        // −8 N is exactly the lowest code and so not clipped; +8 N is one above the highest.
        assert_eq!(
            map.taxels[0],
            TaxelForce {
                x: i16::MAX,
                y: i16::MIN,
                z: i16::MIN
            }
        );
        assert_eq!(
            map.taxels[399],
            TaxelForce {
                x: i16::MAX,
                y: i16::MIN,
                z: 32767
            }
        );
        assert_eq!(saturated, Saturated(4));
    }

    #[test]
    fn halves_of_a_step_go_away_from_zero_and_the_numbers_beside_them_to_their_own_side() {
        for whole in (0..=40).chain([16_383, 32_766]) {
            let tie = (f64::from(whole) + 0.5) / 4096.0;
            for (newton, expected) in [
                (tie, whole + 1),
                (tie.next_down(), whole),
                (tie.next_up(), whole + 1),
            ] {
                assert_eq!(i32::from(quantise_component(newton).0), expected, "{newton:e}");
                assert_eq!(i32::from(quantise_component(-newton).0), -expected, "{newton:e}");
            }
        }
    }

    proptest! {
        #[test]
        fn rounding_is_to_the_nearest_step(newton in -7.99f64..7.99) {
            let (steps, clipped) = quantise_component(newton);
            prop_assert!(!clipped);
            prop_assert!((f64::from(steps) - newton * 4096.0).abs() <= 0.5 + 1e-9);
        }

        #[test]
        fn newtons_that_came_from_the_wire_survive_the_round_trip(steps in proptest::collection::vec(any::<[i16; 3]>(), TAXELS)) {
            let mut map = ForceMap::EMPTY;
            for (taxel, [x, y, z]) in map.taxels.iter_mut().zip(steps) {
                *taxel = TaxelForce { x, y, z };
            }
            prop_assert_eq!(ForceMap::quantise(&map.dequantise()).unwrap(), (map, Saturated(0)));
        }

        #[test]
        fn places_list_exactly_the_set(bytes in any::<[[u8; 25]; 2]>()) {
            let mut raw = [0; BITMAP_BYTES];
            raw[..25].copy_from_slice(&bytes[0]);
            raw[25..].copy_from_slice(&bytes[1]);
            let set = ActiveSet::from_bytes(raw);
            let mut places = [Place::default(); TAXELS];
            let count = set.places(&mut places);
            prop_assert_eq!(count, set.count());
            let expected: std::vec::Vec<u16> = (0..TAXELS).filter(|&t| set.contains(t)).map(|t| t as u16).collect();
            let found: std::vec::Vec<u16> = places[..usize::from(count)].iter().map(|place| place.taxel()).collect();
            prop_assert_eq!(found, expected);
            prop_assert!(places.iter().all(|place| usize::from(place.taxel()) < TAXELS));
        }
    }
}
