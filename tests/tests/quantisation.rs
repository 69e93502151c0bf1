//! What the wire's 1/4096 N costs: the microcontroller's stick ratio on the quantised map against plain f64 on the
//! unquantised one, over contacts of the simulated world. DESIGN.md's bounds: mean error of the stick ratio at most
//! 0.002, at most one decision in a thousand flips.

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON};
use gripline_simulation::SampleGenerator;

const FRICTION_PER_UNIT: u16 = 4_500;
const THRESHOLD_PER_UNIT: u16 = 5_000;
/// Contact above this: 1/4096 N times 80.
const CONTACT_MIN: i16 = 80;
const SAMPLES: usize = 4_000;

/// (contact, stick) on the forces as they are.
fn in_f64(forces: &[[f32; 3]; 400]) -> (u32, u32) {
    let friction = f64::from(FRICTION_PER_UNIT) / 1e4;
    let contact_min_n = f64::from(CONTACT_MIN) / f64::from(LSB_PER_NEWTON);
    let (mut contact, mut stick) = (0, 0);
    for &[x, y, z] in forces {
        let (x, y, z) = (f64::from(x), f64::from(y), f64::from(z));
        if z > contact_min_n {
            contact += 1;
            stick += u32::from(x.hypot(y) <= friction * z);
        }
    }
    (contact, stick)
}

#[test]
fn quantisation_hardly_moves_the_stick_ratio() {
    let rule = TaxelRule {
        friction: Friction::clamped(FRICTION_PER_UNIT),
        contact_min: CONTACT_MIN,
    };
    let (mut error_sum, mut worst, mut flips, mut frames) = (0.0, 0.0_f64, 0, 0);
    for sample in SampleGenerator::new(0x9A47_0000_0000).take(SAMPLES) {
        let (contact, stick) = in_f64(&sample.forces);
        let (map, saturated) = ForceMap::quantise(&sample.forces).unwrap();
        assert_eq!(saturated.0, 0);
        let sums = sums_of(&map, rule);
        if contact == 0 || sums.contact == 0 {
            continue;
        }
        let truth = f64::from(stick) / f64::from(contact);
        let found = f64::from(sums.stick) / f64::from(sums.contact);
        error_sum += (truth - found).abs();
        worst = worst.max((truth - found).abs());
        flips += u32::from(
            (truth < f64::from(THRESHOLD_PER_UNIT) / 1e4) != stick_ratio_below(&sums, THRESHOLD_PER_UNIT),
        );
        frames += 1;
    }
    let mean = error_sum / f64::from(frames);
    println!(
        "{frames} frames: stick ratio off by {mean:.5} on average, {worst:.4} at most; {flips} decisions flip"
    );
    assert!(frames > 3_000);
    assert!(mean <= 0.002, "{mean}");
    assert!(flips * 1_000 <= frames, "{flips} of {frames}");
}
