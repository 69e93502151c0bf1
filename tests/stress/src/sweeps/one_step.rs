//! Every input of many maps, moved by one step of the wire: what decides otherwise, and who is right.

use gripline_protocol::{ForceMap, PER_UNIT, TAXELS, TaxelForce};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde_json::json;

use super::judge::{FRICTION, THRESHOLD, Wrong, quantised, rule};
use crate::contacts::Contact;
use crate::{Effort, Sweep, exact};

/// A kind of map.
type Family = (&'static str, fn(&mut Pcg64Mcg) -> ForceMap);

const FAMILIES: [Family; 5] = [
    ("partial slip, skin 0.5 to 1", |random| {
        contact_map(Contact::random(random))
    }),
    ("half of it sticks", half_stuck),
    ("gross slip, skin 0.6", |random| slipping(random, 0.6)),
    ("gross slip, skin 0.45 as the detector's", |random| {
        slipping(random, 0.45)
    }),
    ("every taxel on the cone", on_the_cone),
];

fn contact_map(contact: Contact) -> ForceMap {
    quantised(&contact.newtons()).0
}

fn slipping(random: &mut Pcg64Mcg, friction: f64) -> ForceMap {
    contact_map(Contact {
        friction,
        share: 1.0,
        ..Contact::random(random)
    })
}

/// Contact and stick of a map.
fn counts(map: &ForceMap, friction: u16, contact_min: i16) -> [i64; 2] {
    let mut counts = [0; 2];
    for force in map.taxels {
        let (contact, stick) = rule(friction, contact_min).decide(force);
        counts[0] += i64::from(contact);
        counts[1] += i64::from(stick);
    }
    counts
}

/// Loaded so that the stick ratio is as near to the threshold as can be.
pub(super) fn half_stuck(random: &mut Pcg64Mcg) -> ForceMap {
    let mut contact = Contact::random(random);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..20 {
        contact.share = f64::midpoint(low, high);
        let [touching, stuck] = counts(&contact_map(contact), FRICTION, 0);
        if 2 * stuck >= touching {
            low = contact.share;
        } else {
            high = contact.share;
        }
    }
    contact_map(contact)
}

/// Whole multiples of (9, 0, 20) and (27, 36, 100): f_T is 0.45 f_z to the last bit.
fn on_the_cone(random: &mut Pcg64Mcg) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for taxel in map.taxels.iter_mut().take(random.random_range(20..TAXELS)) {
        *taxel = if random.random_bool(0.5) {
            let k = random.random_range(1..=1_600_i16);
            TaxelForce {
                x: 9 * k,
                y: 0,
                z: 20 * k,
            }
        } else {
            let k = random.random_range(1..=320_i16);
            TaxelForce {
                x: -27 * k,
                y: 36 * k,
                z: 100 * k,
            }
        };
    }
    map
}

fn slips([contact, stick]: [i64; 2], threshold: u16) -> bool {
    stick * i64::from(PER_UNIT) < i64::from(threshold) * contact
}

/// What moving inputs did.
#[derive(Default)]
struct MovedInputs {
    moved: u64,
    taxels: u64,
    frames: u64,
    /// Frames that turned although more than one taxel lay between them and the threshold.
    far: u64,
    wrong: Wrong,
}

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "one step",
        "Each of the 1,200 components of a map moved up and down by 1/4096 N, one at a time, at μ 0.45 and threshold 0.5: \
         decisions that turn, about the taxel and about the frame. \"Wrong\" is what exact arithmetic decides otherwise.",
        &[
            "maps",
            "count",
            "inputs moved",
            "taxels turn",
            "frames turn",
            "wrong",
            "f32 root",
            "f32 squares",
            "f64 root",
            "f64 squares",
        ],
    );
    let count = effort.of(400, 6);
    let (mut far, mut wrong, mut moved) = (0, Wrong::default(), 0);
    for (stream, (name, make)) in (100..).zip(FAMILIES) {
        let mut random = effort.random(stream);
        let mut found = MovedInputs::default();
        for _ in 0..count {
            one_map(&make(&mut random), &mut found);
        }
        let Wrong { fixed, floats, .. } = found.wrong;
        sweep.row(vec![
            json!(name),
            json!(count),
            json!(found.moved),
            json!(found.taxels),
            json!(found.frames),
            json!(fixed),
            json!(floats[0]),
            json!(floats[1]),
            json!(floats[2]),
            json!(floats[3]),
        ]);
        far += found.far;
        moved += found.moved;
        wrong.add(&found.wrong);
    }
    for (name, change) in [
        ("friction ±0.0001", [1, 0, 0]),
        ("threshold ±0.0001", [0, 1, 0]),
        ("contact threshold +1", [0, 0, 1]),
    ] {
        let (taxels, frames, maps) = settings_moved(effort, count, change);
        sweep.row(vec![
            json!(format!("half of it sticks, {name}")),
            json!(maps),
            json!(2 * maps),
            json!(taxels),
            json!(frames),
            json!(null),
            json!(null),
            json!(null),
            json!(null),
            json!(null),
        ]);
    }
    sweep.none(
        "decisions of the detector that exact arithmetic makes otherwise",
        wrong.fixed,
    );
    sweep.none(
        "frames that one step turned although more than one taxel lay between them and the threshold",
        far,
    );
    sweep.notes.push(format!(
        "Of the same {moved} decisions f32 gets {} wrong as a root and {} as squares, f64 {} and {}; {} of these are about \
         taxels exactly on the cone, most others about those that one step moved off it (last kind).",
        wrong.floats[0], wrong.floats[1], wrong.floats[2], wrong.floats[3], wrong.ties,
    ));
    sweep.notes.push(
        "The fourth row is the trap in the definition: a detector with the skin's own friction sees gross slip exactly on \
         the cone, where half of all single steps decide. Hence μ below the skin's."
            .to_owned(),
    );
    sweep
}

/// Moves every input of a map.
fn one_map(map: &ForceMap, found: &mut MovedInputs) {
    let before = counts(map, FRICTION, 0);
    let was_slip = slips(before, THRESHOLD);
    let distance = (before[1] * i64::from(PER_UNIT) - i64::from(THRESHOLD) * before[0]).abs();
    for force in map.taxels {
        let was = exact::taxel(force, FRICTION, 0);
        for (axis, by) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
            let mut steps = [force.x, force.y, force.z];
            let Some(step) = i16::checked_add(steps[axis], by) else {
                continue;
            };
            steps[axis] = step;
            let [x, y, z] = steps;
            let now = found.wrong.ask(TaxelForce { x, y, z }, FRICTION, 0);
            found.moved += 1;
            found.taxels += u64::from(now != was);
            let after = [
                before[0] + i64::from(now.0) - i64::from(was.0),
                before[1] + i64::from(now.1) - i64::from(was.1),
            ];
            let turned = slips(after, THRESHOLD) != was_slip;
            found.frames += u64::from(turned);
            found.far += u64::from(turned && distance > i64::from(PER_UNIT));
        }
    }
}

/// Taxels and frames that turn when a setting moves: (taxels, frames, maps).
fn settings_moved(
    effort: Effort,
    maps: usize,
    [friction, threshold, contact]: [i16; 3],
) -> (u64, u64, usize) {
    let mut random = effort.random(110);
    let (mut taxels, mut frames) = (0, 0);
    for _ in 0..maps {
        let map = half_stuck(&mut random);
        let was = counts(&map, FRICTION, 0);
        let signs: &[i16] = if contact == 0 { &[-1, 1] } else { &[1] };
        for sign in signs {
            let at = |base: u16, by: i16| base.saturating_add_signed(sign * by);
            let (friction, contact_min) = (at(FRICTION, friction), sign * contact);
            for force in map.taxels {
                let turned = rule(friction, contact_min).decide(force) != rule(FRICTION, 0).decide(force);
                taxels += u64::from(turned);
            }
            let now = counts(&map, friction, contact_min);
            frames += u64::from(slips(now, at(THRESHOLD, threshold)) != slips(was, THRESHOLD));
        }
    }
    (taxels, frames, maps)
}
