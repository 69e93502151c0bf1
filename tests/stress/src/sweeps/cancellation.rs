//! Sums whose terms cancel: shear under a torsional moment, moments of couples, a residue of one step among forces of 8 N.

use gripline_firmware::Friction;
use gripline_firmware::sums::{sums_of, total_shear};
use gripline_protocol::constants::TAXEL_PITCH_MM;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, TAXELS, TaxelForce};
use num_bigint::BigInt;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::judge::{FRICTION, quantised, rule};
use crate::contacts::Contact;
use crate::floating::{Form, double, single};
use crate::{Effort, Sweep, exact};

type Family = (&'static str, fn(&mut Pcg64Mcg) -> ForceMap);

const FAMILIES: [Family; 5] = [
    ("pull", |random| contact(random, 0.0)),
    ("torsional moment alone", |random| contact(random, 1.0)),
    ("8 N against 8 N, one step left", against),
    ("every component at random", |random| {
        let mut map = ForceMap::EMPTY;
        map.taxels.fill_with(|| TaxelForce {
            x: random.random(),
            y: random.random(),
            z: random.random(),
        });
        map
    }),
    ("F_T = μ F_N to the last step", on_the_cone),
];

fn contact(random: &mut Pcg64Mcg, torsion_share: f64) -> ForceMap {
    let contact = Contact {
        torsion_share,
        ..Contact::random(random)
    };
    quantised(&contact.newtons()).0
}

/// Opposite forces on opposite taxels, and one step somewhere.
fn against(random: &mut Pcg64Mcg) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for taxel in 0..TAXELS / 2 {
        let x = random.random_range(-32_767..=32_767);
        let y = random.random_range(-32_767..=32_767);
        map.taxels[taxel] = TaxelForce { x, y, z: 1 };
        map.taxels[TAXELS - 1 - taxel] = TaxelForce { x: -x, y: -y, z: 1 };
    }
    map.taxels[random.random_range(0..TAXELS)].x += 1;
    map
}

/// Shear and normal sums in the ratio 9 to 20, on taxels that are not.
fn on_the_cone(random: &mut Pcg64Mcg) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for pair in map.taxels.chunks_exact_mut(2).take(random.random_range(1..=200)) {
        let k = random.random_range(1..=700_i16);
        let off = random.random_range(-500..=500_i16);
        pair[0] = TaxelForce {
            x: 9 * k + off,
            y: off,
            z: 20 * k,
        };
        pair[1] = TaxelForce {
            x: 9 * k - off,
            y: -off,
            z: 20 * k,
        };
    }
    map
}

/// Worst of many maps.
#[derive(Default)]
struct Worst {
    sums: u64,
    coulomb: [u64; 3],
    moment_nmm: f64,
    force_n: [f64; 2],
    moment_off_nmm: [f64; 2],
    shear: u64,
}

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "cancellation",
        "Total shear, moment and centre of pressure where terms of up to 8 N cancel: errors of the sums against exact \
         arithmetic, largest over the maps, and the Coulomb baseline F_T > μ F_N on the whole map.",
        &[
            "maps",
            "count",
            "largest |M| N·mm",
            "sums wrong",
            "f32 F off N",
            "f64 F off N",
            "f32 M off N·mm",
            "f64 M off N·mm",
            "Coulomb wrong",
            "f32 Coulomb",
            "f64 Coulomb",
        ],
    );
    let count = effort.of(4_000, 40);
    let (mut sums, mut coulomb, mut shear) = (0, 0, 0);
    for (stream, (name, make)) in (700..).zip(FAMILIES) {
        let mut random = effort.random(stream);
        let mut worst = Worst::default();
        for _ in 0..count {
            one_map(&make(&mut random), &mut worst);
        }
        sweep.row(vec![
            json!(name),
            json!(count),
            json!(worst.moment_nmm),
            json!(worst.sums),
            json!(worst.force_n[0]),
            json!(worst.force_n[1]),
            json!(worst.moment_off_nmm[0]),
            json!(worst.moment_off_nmm[1]),
            json!(worst.coulomb[0]),
            json!(worst.coulomb[1]),
            json!(worst.coulomb[2]),
        ]);
        sums += worst.sums;
        coulomb += worst.coulomb[0];
        shear += worst.shear;
    }
    sweep.none("maps with a sum that exact arithmetic makes otherwise", sums);
    sweep.none("Coulomb decisions that exact arithmetic makes otherwise", coulomb);
    sweep.none(
        "total shears F_T that are not the exact root, rounded down",
        shear,
    );
    sweep.notes.push(
        "f32 sums forces of the wire exactly too: 400 of them fit its 24 bits. Its moment does not, because 1.6 mm is no \
         binary fraction."
            .to_owned(),
    );
    sweep
}

fn float(value: &BigInt) -> f64 {
    // Sums are below 2³¹, so exact.
    i64::try_from(value).map_or(f64::NAN, |value| value as f64)
}

fn one_map(map: &ForceMap, worst: &mut Worst) {
    let right = exact::map(&map.taxels, FRICTION, 0);
    let found = sums_of(map, rule(FRICTION, 0));
    let same = found.force.map(BigInt::from) == right.force
        && right.moment == found.moment.into()
        && found.first_moment.map(BigInt::from) == right.first_moment
        && right.second_moment == found.second_moment.into()
        && (found.contact, found.stick) == (right.contact, right.stick);
    worst.sums += u64::from(!same);
    let says = exact::coulomb(&right.force, FRICTION);
    let [x, y, normal] = found.force;
    worst.coulomb[0] += u64::from(Friction::clamped(FRICTION).exceeded_by([x, y], normal) != says);

    let steps = f64::from(LSB_PER_NEWTON);
    let force_n = right.force.each_ref().map(|sum| float(sum) / steps);
    let moment_nmm = float(&right.moment) * TAXEL_PITCH_MM / 2.0 / steps;
    worst.moment_nmm = worst.moment_nmm.max(moment_nmm.abs());
    let shear = found.force.map(i64::from);
    let square = BigInt::from(shear[0]).pow(2) + BigInt::from(shear[1]).pow(2);
    let root = total_shear(&found);
    let is_floor = BigInt::from(root).pow(2) <= square && BigInt::from(root + 1).pow(2) > square;
    worst.shear += u64::from(!is_floor);

    let single = single::sums_of(
        &single::newtons(map),
        single::Rule {
            friction: 0.45,
            contact_min_n: 0.0,
            form: Form::Root,
        },
    );
    let double = double::sums_of(
        &double::newtons(map),
        double::Rule {
            friction: 0.45,
            contact_min_n: 0.0,
            form: Form::Root,
        },
    );
    let forces = [single.force_n.map(f64::from), double.force_n];
    let moments = [f64::from(single.moment_nmm), double.moment_nmm];
    for k in 0..2 {
        let off = (0..3)
            .map(|axis| (forces[k][axis] - force_n[axis]).abs())
            .fold(0.0, f64::max);
        worst.force_n[k] = worst.force_n[k].max(off);
        worst.moment_off_nmm[k] = worst.moment_off_nmm[k].max((moments[k] - moment_nmm).abs());
    }
    let [x, y, z] = single.force_n;
    worst.coulomb[1] += u64::from(((x * x + y * y).sqrt() > 0.45 * z) != says);
    let [x, y, z] = double.force_n;
    worst.coulomb[2] += u64::from(((x * x + y * y).sqrt() > 0.45 * z) != says);
}
