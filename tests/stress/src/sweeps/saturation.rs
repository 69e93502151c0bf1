//! Forces beyond ±8 N: what clipping does to a taxel's decision, and whether it is always reported.

use gripline_protocol::{ForceMap, TAXELS};
use rand::RngExt;
use serde_json::json;

use super::judge::rule;
use crate::{Effort, Sweep, exact};

/// Largest force over the end of the range.
const BEYOND: [f64; 6] = [0.5, 0.99, 1.01, 1.5, 4.0, 100.0];
const FRICTIONS: [u16; 6] = [1_000, 4_500, 9_999, 10_000, 14_142, 20_000];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "saturation",
        "Random forces on all taxels with components up to so many times 8 N. A clipped taxel may be taken for slipping, which \
         tightens; to be taken for sticking needs μ of 1 and more, because a clipped shear is at least as large as any normal \
         force. Every clipped map must say so: the microcontroller then holds.",
        &[
            "largest / 8 N",
            "taxels",
            "clipped components",
            "maps clipped",
            "maps that say so",
            "sticks → slips",
            "slips → sticks, μ < 1",
            "slips → sticks, μ ≥ 1",
            "sign lost",
        ],
    );
    let maps = effort.of(600, 12);
    let (mut misreported, mut unsafe_below, mut signs) = (0, 0, 0);
    for (stream, beyond) in (500..).zip(BEYOND) {
        let mut random = effort.random(stream);
        let mut counts = [0_u64; 8];
        for _ in 0..maps {
            let mut newtons = [[0.0_f32; 3]; TAXELS];
            for force in &mut newtons {
                *force = core::array::from_fn(|_| (8.0 * beyond * random.random_range(-1.0..1.0)) as f32);
                force[2] = force[2].abs();
            }
            // No NaN and no infinity, so it is not refused.
            let Ok((map, saturated)) = ForceMap::quantise(&newtons) else {
                misreported += 1;
                continue;
            };
            let clipped = newtons
                .iter()
                .flatten()
                .filter(|newton| exact::quantised(f64::from(**newton)).1)
                .count();
            counts[0] += TAXELS as u64;
            counts[1] += clipped as u64;
            counts[2] += u64::from(clipped > 0);
            counts[3] += u64::from(usize::from(saturated.0) == clipped && clipped > 0);
            for (force, taxel) in newtons.iter().zip(map.taxels) {
                counts[7] += u64::from(
                    force
                        .iter()
                        .zip([taxel.x, taxel.y, taxel.z])
                        .any(|(newton, step)| newton * f32::from(step) < 0.0),
                );
                let is_clipped = force.iter().any(|newton| exact::quantised(f64::from(*newton)).1);
                if !is_clipped {
                    continue;
                }
                for friction in FRICTIONS {
                    let truth = exact::sticks(force.map(f64::from), friction);
                    let (contact, found) = rule(friction, 0).decide(taxel);
                    counts[4] += u64::from(contact && truth && !found);
                    counts[if friction < 10_000 { 5 } else { 6 }] += u64::from(!truth && found);
                }
            }
        }
        misreported += counts[2] - counts[3];
        unsafe_below += counts[5];
        signs += counts[7];
        let mut row = vec![json!(beyond)];
        row.extend(counts.iter().map(|count| json!(count)));
        sweep.row(row);
    }
    sweep.none(
        "maps whose number of clipped components is reported wrongly",
        misreported,
    );
    sweep.none(
        "clipped taxels that slip and are taken for sticking, μ below 1",
        unsafe_below,
    );
    sweep.none("components whose sign turned", signs);
    sweep
}
