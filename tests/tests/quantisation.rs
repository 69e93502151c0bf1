//! What the wire's 1/4096 N costs: the microcontroller's stick ratio on the map that travels against plain f64 on the
//! forces, over closed-form contacts of spheres. Bounds: mean error of the stick ratio at most 0.002, at most one
//! decision in a thousand flips. Rounding to nearest alone misses the second (17 in 10,000); the host rounds so that
//! no taxel's decision changes.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_pipeline::rounding::keep_decisions;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON};
use gripline_simulation::{Gel, Load, SphereContact, SphereParams};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

const FRICTION_PER_UNIT: u16 = 4_500;
const THRESHOLD_PER_UNIT: u16 = 5_000;
/// Contact above this: 1/4096 N times 80.
const CONTACT_MIN: i16 = 80;
const SAMPLES: usize = 10_000;

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

/// Numbers that repeat on every machine.
struct Random(Pcg64Mcg);

impl Random {
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn uniform(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }
}

/// A sphere somewhere on the skin after a random load history.
fn sphere_map(random: &mut Random) -> [[f32; 3]; 400] {
    let gel = Gel::default();
    let radius_mm = random.uniform(4.0, 25.0);
    let friction = random.uniform(0.4, 1.0);
    let deepest_mm = (0.45 * gel.thickness_mm * radius_mm).sqrt();
    let strongest_n = 4.0 * gel.contact_modulus_mpa() * deepest_mm.powi(3) / (3.0 * radius_mm);
    let normal_n = 0.1 * (strongest_n.min(15.0) / 0.1).powf(random.unit());
    let contact_mm = (0.75 * normal_n * radius_mm / gel.contact_modulus_mpa()).cbrt();
    let room_mm = (15.0 - contact_mm).max(5.0);
    let mut contact = SphereContact::new(SphereParams {
        radius_mm,
        friction,
        centre_mm: [
            random.uniform(-room_mm, room_mm),
            random.uniform(-room_mm, room_mm),
        ],
        gel,
    })
    .unwrap();
    // Pull alone, twist alone, both; hardly loaded, anywhere, near slip, in slip.
    let way = random.uniform(0.0, TAU);
    let turn = match random.unit() {
        kind if kind < 0.45 => 0.0,
        kind if kind < 0.65 => FRAC_PI_2,
        _ => random.uniform(0.0, FRAC_PI_2),
    };
    let share = match random.unit() {
        kind if kind < 0.1 => random.uniform(0.0, 0.1),
        kind if kind < 0.7 => random.uniform(0.1, 1.0),
        kind if kind < 0.85 => random.uniform(0.9, 1.0),
        _ => random.uniform(1.02, 1.5),
    };
    let load = |normal_n: f64, share: f64| {
        let limit_n = friction * normal_n;
        let pull_n = share * turn.cos() * limit_n;
        Load {
            normal_n,
            shear_n: [pull_n * way.cos(), pull_n * way.sin()],
            torsion_nmm: 3.0 * PI / 16.0 * limit_n * contact_mm * share * turn.sin(),
        }
    };
    // At once, after a larger or opposite load, with another grip before.
    let kind = random.unit();
    let before_n = if kind < 0.75 {
        normal_n
    } else {
        normal_n * random.uniform(0.5, 1.4)
    };
    contact.step(load(before_n, 0.0)).unwrap();
    if kind > 0.5 {
        contact.step(load(before_n, random.uniform(-0.8, 0.8))).unwrap();
    }
    // A load that the solver does not reach leaves the one before it.
    let _ = contact.step(load(normal_n, share));
    contact.state().force_map()
}

#[test]
fn quantisation_hardly_moves_the_stick_ratio() {
    let rule = TaxelRule {
        friction: Friction::clamped(FRICTION_PER_UNIT),
        contact_min: CONTACT_MIN,
    };
    let (mut error_sum, mut worst, mut flips, mut frames) = (0.0, 0.0_f64, 0, 0);
    let mut random = Random(Pcg64Mcg::new(0x9A47));
    for _ in 0..SAMPLES {
        let forces = sphere_map(&mut random);
        let (contact, stick) = in_f64(&forces);
        let (mut map, saturated) = ForceMap::quantise(&forces).unwrap();
        keep_decisions(forces.iter().map(|force| force.map(f64::from)), rule, &mut map);
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
    assert!(frames > 8_000);
    assert!(mean <= 0.002, "{mean}");
    assert!(flips * 1_000 <= frames, "{flips} of {frames}");
}
