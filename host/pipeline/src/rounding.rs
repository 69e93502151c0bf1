//! Forces to wire units such that no decision changes on the way: where rounding to nearest would move a taxel over
//! the contact threshold or across the friction cone, the nearest neighbour that stays on its side travels instead.
//! Pure. Units: newtons in, 1/4096 N out. Limits: a component is then off by up to one step instead of half a step;
//! `detect` rounds recordings to nearest, as anyone would who checks it.

use gripline_firmware::sums::TaxelRule;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, PER_UNIT, TaxelForce};

/// Mends the taxels of `map`, which holds `newtons` rounded to nearest, about which the detector would decide
/// differently than about the forces themselves (in f64). Clipped components are left alone.
pub fn keep_decisions(newtons: impl Iterator<Item = [f64; 3]>, rule: TaxelRule, map: &mut ForceMap) {
    for (force, out) in newtons.zip(&mut map.taxels) {
        // What the wire holds exactly the detector decides exactly, ties on the cone included; f64 would not.
        let steps = force.map(|newton| newton * f64::from(LSB_PER_NEWTON));
        if steps.iter().all(|step| step.fract() == 0.0) {
            continue;
        }
        let wanted = decision(force, rule);
        if rule.decide(*out) != wanted {
            *out = nearest(force, |taxel| rule.decide(taxel) == wanted).unwrap_or(*out);
        }
    }
}

/// Whether a taxel is in contact, and whether it sticks.
fn decision([x, y, z]: [f64; 3], rule: TaxelRule) -> (bool, bool) {
    let friction = f64::from(rule.friction.per_unit()) / f64::from(PER_UNIT);
    let contact = z * f64::from(LSB_PER_NEWTON) > f64::from(rule.contact_min);
    (contact, contact && x * x + y * y <= friction * friction * z * z)
}

/// Of the eight points of the wire's grid around `newtons`, the nearest one that is wanted.
fn nearest(newtons: [f64; 3], wanted: impl Fn(TaxelForce) -> bool) -> Option<TaxelForce> {
    let steps = newtons.map(|newton| newton * f64::from(LSB_PER_NEWTON));
    let corners = (0..8_u8).map(|corner| {
        let [x, y, z] = [0, 1, 2].map(|axis| steps[axis].floor() + f64::from(corner >> axis & 1));
        let apart = (x - steps[0]).powi(2) + (y - steps[1]).powi(2) + (z - steps[2]).powi(2);
        // The casts saturate: a corner beyond the range is the range's end.
        let [x, y, z] = [x as i16, y as i16, z as i16];
        (apart, TaxelForce { x, y, z })
    });
    corners
        .filter(|(_, taxel)| wanted(*taxel))
        .min_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, taxel)| taxel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_firmware::Friction;
    use gripline_protocol::TAXELS;
    use proptest::prelude::*;

    /// Forces near the cone and near the threshold, where rounding decides.
    fn near_a_border() -> impl Strategy<Value = [f64; 3]> {
        (
            0.0..2.0_f64,
            0.0..std::f64::consts::TAU,
            -2e-4..2e-4_f64,
            any::<bool>(),
        )
            .prop_map(|(z, way, off, touching)| {
                let z = if touching { z } else { 0.02 + off };
                let shear = 0.4225 * z + off;
                [shear * way.cos(), shear * way.sin(), z]
            })
    }

    proptest! {
        #[test]
        fn decisions_are_those_of_the_forces_and_no_component_is_a_step_off(
            newtons in proptest::collection::vec(near_a_border(), TAXELS),
            friction in prop_oneof![Just(4_225_u16), 1_000..10_000_u16],
            contact_min in prop_oneof![Just(82_i16), 0..200_i16],
        ) {
            let rule = TaxelRule { friction: Friction::clamped(friction), contact_min };
            let rounded: Vec<[f32; 3]> = newtons.iter().map(|force| force.map(|v| v as f32)).collect();
            let rounded: [[f32; 3]; TAXELS] = rounded.try_into().unwrap();
            let exact = rounded.map(|force| force.map(f64::from));
            let (mut map, _) = ForceMap::quantise(&rounded).unwrap();
            let plain = map.clone();
            keep_decisions(exact.iter().copied(), rule, &mut map);
            for ((force, taxel), plain) in exact.iter().zip(map.taxels).zip(plain.taxels) {
                let off = [taxel.x, taxel.y, taxel.z].iter().zip(force).map(|(step, newton)| {
                    (f64::from(*step) - newton * 4_096.0).abs()
                }).fold(0.0, f64::max);
                prop_assert!(off <= 1.0, "{force:?} {taxel:?}");
                // Within a step of the contact threshold no neighbour may be both in contact and slipping.
                if rule.decide(taxel) != decision(*force, rule) {
                    prop_assert!(taxel == plain && force[2] * 4_096.0 < f64::from(contact_min) + 1.0, "{force:?}");
                } else if rule.decide(plain) == decision(*force, rule) {
                    prop_assert!(taxel == plain);
                }
            }
        }
    }
}
