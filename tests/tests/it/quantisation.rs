//! What the wire's 1/4096 N costs: the microcontroller's stick ratio on the map that travels against plain f64 on the
//! forces, over closed-form contacts of spheres. Bounds: mean error of the stick ratio at most 0.002, at most three
//! decisions in a thousand flip. Forces are rounded to nearest.

use std::f64::consts::{FRAC_PI_2, TAU};

use gripline_firmware::Friction;
use gripline_firmware::sums::{TaxelRule, stick_ratio_below, sums_of};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON};
use gripline_simulation::Gel;
use gripline_simulation::closed_form::{CattaneoMindlin, Hertz, Torsion, cell_sums};
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

/// Radii at which a closed form's traction is tabulated, from the middle to the rim.
const RADII: usize = 64;
/// Moments, from none to full slip, at which Lubkin's is.
const MOMENTS: usize = 50;
/// Traction over μp at each radius.
type Profile = [f64; RADII + 1];

fn radius(i: usize) -> f64 {
    (i as f64 / RADII as f64).min(0.9999)
}

/// A twisted sphere's tractions over the moment; they are alike for every sphere, load and friction.
fn twisted_profiles() -> Vec<Profile> {
    let gel = Gel::default();
    let hertz = Hertz::new(1.0, 10.0, &gel).unwrap();
    let torsion = Torsion::new(hertz, 1.0, &gel).unwrap();
    let a = hertz.radius_mm();
    (0..=MOMENTS)
        .map(|k| {
            let moment_nmm = k as f64 / MOMENTS as f64 * torsion.limit_nmm();
            let stick_mm = torsion.stick_radius_mm(moment_nmm).unwrap();
            std::array::from_fn(|i| {
                let r = a * radius(i);
                torsion.traction_mpa(stick_mm, r) / hertz.pressure_mpa(r)
            })
        })
        .collect()
}

/// A sphere somewhere on the skin, pulled, pulled back or twisted: Hertz, Cattaneo and Mindlin, Lubkin.
fn sphere_map(random: &mut Random, twisted: &[Profile]) -> [[f32; 3]; 400] {
    let gel = Gel::default();
    let radius_mm = random.uniform(4.0, 25.0);
    let friction = random.uniform(0.4, 1.0);
    let deepest_mm = (0.45 * gel.thickness_mm * radius_mm).sqrt();
    let strongest_n = 4.0 * gel.contact_modulus_mpa() * deepest_mm.powi(3) / (3.0 * radius_mm);
    let normal_n = 0.1 * (strongest_n.min(15.0) / 0.1).powf(random.unit());
    let hertz = Hertz::new(normal_n, radius_mm, &gel).unwrap();
    let a = hertz.radius_mm();
    let room_mm = (15.0 - a).max(5.0);
    let centre_mm = [
        random.uniform(-room_mm, room_mm),
        random.uniform(-room_mm, room_mm),
    ];
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
        _ => 1.0,
    };
    let pull = CattaneoMindlin::new(hertz, friction, &gel).unwrap();
    let peak_n = share * turn.cos() * pull.limit_n();
    // Half of them at the first pull, half on the way back from it.
    let back_n = if random.unit() < 0.5 {
        peak_n
    } else {
        peak_n * random.uniform(-1.0, 1.0)
    };
    let twisted = &twisted[(share * turn.sin() * MOMENTS as f64).round() as usize];
    // Pull and twist as shares of the pressure, over the radius.
    let table: Vec<[f64; 2]> = (0..=RADII)
        .map(|i| {
            let r = a * radius(i);
            let pulled = pull.unloading_traction_mpa(peak_n, back_n, r).unwrap();
            [pulled / hertz.pressure_mpa(r), friction * twisted[i]]
        })
        .collect();
    let sums = cell_sums(1.6, 20, 6, |[x, y]| {
        let [x, y] = [x - centre_mm[0], y - centre_mm[1]];
        let r = x.hypot(y);
        if r >= a {
            return [0.0; 3];
        }
        let place = r / a * RADII as f64;
        let (ring, part) = (place as usize, place.fract());
        let [pulled, twisted] = [0, 1].map(|k| table[ring][k] + part * (table[ring + 1][k] - table[ring][k]));
        let [cos, sin] = if r > 0.0 { [x / r, y / r] } else { [1.0, 0.0] };
        let q = [
            pulled * way.cos() - twisted * sin,
            pulled * way.sin() + twisted * cos,
        ];
        // Both together stay inside the friction cone.
        let p = hertz.pressure_mpa(r);
        let scale = p * (friction / q[0].hypot(q[1])).min(1.0);
        [q[0] * scale, q[1] * scale, p]
    });
    sums.try_into().expect("20 x 20 taxels")
}

#[test]
fn quantisation_hardly_moves_the_stick_ratio() {
    let rule = TaxelRule {
        friction: Friction::clamped(FRICTION_PER_UNIT),
        contact_min: CONTACT_MIN,
    };
    let (mut error_sum, mut worst, mut flips, mut frames) = (0.0, 0.0_f64, 0, 0);
    let mut random = Random(Pcg64Mcg::new(0x9A47));
    let twisted = twisted_profiles();
    for _ in 0..SAMPLES {
        let forces = sphere_map(&mut random, &twisted);
        let (contact, stick) = in_f64(&forces);
        let (map, saturated) = ForceMap::quantise(&forces).unwrap();
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
    assert!(flips * 1_000 <= 3 * frames, "{flips} of {frames}");
}
