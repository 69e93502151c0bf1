//! One recorded map through the microcontroller's own detector: quantise, sums, stick ratio, Coulomb baseline. Pure.
//! Units: newtons in; out in 1/4096 N with conversions to newtons and N·mm; friction and threshold in 1/10000.
//! Limits: ±8 N a taxel, beyond which a component is clipped and counted.

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_protocol::force_map::quantise_component;
use gripline_protocol::message::MapSums;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, PER_UNIT, TaxelForce};

use gripline_recording::maps_file::FrameForces;

/// What decides about a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Friction coefficient of the detector.
    pub friction: Friction,
    /// A frame slips when its stick ratio is below this, 1/10000.
    pub threshold: u16,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N; at least 0.
    pub contact_min: i16,
    /// Newtons per unit of the recording.
    pub scale: f64,
}

impl Settings {
    /// Of friction coefficient 0 to 2, stick ratio 0 to 1 and contact force 0 to 8 N, the first two to the nearest 1/10000.
    #[must_use]
    pub fn of(mu: f64, threshold: f64, contact_min_n: f64, scale: f64) -> Self {
        let per_unit = |value: f64| (value * f64::from(PER_UNIT)).round() as u16;
        Self {
            friction: Friction::clamped(per_unit(mu)),
            threshold: per_unit(threshold),
            // A whole number of steps exceeds this number of steps exactly when it exceeds its floor. At 8 N the cast
            // saturates, and no taxel exceeds it either way.
            contact_min: (contact_min_n * f64::from(LSB_PER_NEWTON)).floor() as i16,
            scale,
        }
    }
}

/// A recorded map in the wire's units.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantised {
    /// The map.
    pub map: ForceMap,
    /// Components that did not fit ±8 N.
    pub saturated: u16,
    /// Greatest magnitude of a component before clipping, newtons.
    pub max_n: f64,
}

/// Finite forces of a recording to wire units, rounded to nearest (ties away from zero).
#[must_use]
pub fn quantise(forces: &FrameForces, scale: f64) -> Quantised {
    let mut quantised = Quantised {
        map: ForceMap::EMPTY,
        saturated: 0,
        max_n: 0.0,
    };
    for (force, out) in forces.iter().zip(&mut quantised.map.taxels) {
        let [x, y, z] = force.map(|component| {
            let newton = component * scale;
            let (steps, clipped) = quantise_component(newton);
            quantised.saturated += u16::from(clipped);
            quantised.max_n = quantised.max_n.max(newton.abs());
            steps
        });
        *out = TaxelForce { x, y, z };
    }
    quantised
}

/// What the detector says about one map, for itself alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Verdict {
    /// Contact, stick, total force, moment.
    pub sums: MapSums,
    /// F_T > μ F_N over the whole map: the Coulomb baseline.
    pub coulomb_slip: bool,
    /// Stick ratio below the threshold, decided exactly; never without contact.
    pub slip: bool,
}

/// The firmware's [`sums_of`], in the widest vectors that it gains from: whole numbers, so the same bits.
#[must_use]
pub fn sums(map: &ForceMap, rule: TaxelRule) -> MapSums {
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "compiled for instruction sets that were checked for")]
    {
        if is_x86_feature_detected!("avx512bw") && is_x86_feature_detected!("avx512dq") {
            // SAFETY: the processor has them; either implies AVX-512F.
            return unsafe { sums_avx512(map, rule) };
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has it.
            return unsafe { sums_avx2(map, rule) };
        }
    }
    sums_of(map, rule)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq")]
fn sums_avx512(map: &ForceMap, rule: TaxelRule) -> MapSums {
    sums_of(map, rule)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn sums_avx2(map: &ForceMap, rule: TaxelRule) -> MapSums {
    sums_of(map, rule)
}

/// Judges one map.
#[must_use]
pub fn judge(map: &ForceMap, settings: &Settings) -> Verdict {
    let rule = TaxelRule {
        friction: settings.friction,
        contact_min: settings.contact_min,
    };
    let sums = sums(map, rule);
    let [x, y, normal] = sums.force;
    Verdict {
        sums,
        coulomb_slip: settings.friction.exceeded_by([x, y], normal),
        slip: stick_ratio_below(&sums, settings.threshold),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_protocol::TAXELS;
    use gripline_protocol::constants::TAXEL_PITCH_MM;
    use gripline_recording::units::{moment_nmm, stick_ratio};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn wide_vectors_give_the_firmwares_sums(
            taxels in proptest::collection::vec(prop_oneof![Just([0; 3]), any::<[i16; 3]>()], TAXELS),
            per_unit in 0..=20_000_u16,
            contact_min in 0..=i16::MAX,
        ) {
            let mut map = ForceMap::EMPTY;
            for (taxel, [x, y, z]) in map.taxels.iter_mut().zip(taxels) {
                *taxel = TaxelForce { x, y, z };
            }
            let rule = TaxelRule { friction: Friction::clamped(per_unit), contact_min };
            prop_assert_eq!(sums(&map, rule), sums_of(&map, rule));
        }

        #[test]
        fn a_float32_recording_in_newtons_becomes_the_wires_nearest_map(
            newtons in proptest::collection::vec(prop::array::uniform3(-9.0f32..9.0), TAXELS),
        ) {
            let newtons: [[f32; 3]; TAXELS] = newtons.try_into().unwrap();
            let (map, saturated) = ForceMap::quantise(&newtons).unwrap();
            let recorded = quantise(&newtons.map(|force| force.map(f64::from)), 1.0);
            prop_assert_eq!((recorded.map, recorded.saturated), (map, saturated.0));
        }
    }

    #[test]
    fn the_moment_of_one_newton_upwards_at_the_right_edge_is_its_lever_in_millimetres() {
        let mut forces = [[0.0; 3]; TAXELS];
        forces[19][1] = 1.0; // row 0, column 19: x = 9.5 pitches of 1.6 mm
        let settings = Settings {
            friction: Friction::clamped(4_500),
            threshold: 5_000,
            contact_min: 0,
            scale: 1.0,
        };
        let verdict = judge(&quantise(&forces, 1.0).map, &settings);
        assert!((moment_nmm(&verdict.sums, TAXEL_PITCH_MM) - 15.2).abs() < 1e-12);
        assert_eq!(stick_ratio(&verdict.sums), None);
    }

    #[test]
    fn forces_that_overflow_by_the_scale_are_clipped_and_counted() {
        let mut forces = [[0.0; 3]; TAXELS];
        forces[0] = [f64::MAX, -f64::MAX, 7.0];
        let quantised = quantise(&forces, 1e10);
        let [x, y, z] = [i16::MAX, i16::MIN, i16::MAX];
        assert_eq!(quantised.map.taxels[0], TaxelForce { x, y, z });
        assert_eq!(quantised.saturated, 3);
    }
}
