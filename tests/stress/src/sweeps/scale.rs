//! The same contacts at forces from far below a step to the end of the range.

use rand::RngExt;
use serde_json::json;

use super::judge::{FRICTION, THRESHOLD, Wrong, floats_decide, quantised};
use crate::contacts::Contact;
use crate::picture::Picture;
use crate::{Effort, Sweep, exact};

/// Greatest normal force of a taxel, newtons.
const LEAST_N: f64 = 1e-4;
const MOST_N: f64 = 7.99;

/// What a scale came to.
#[derive(Default)]
struct At {
    frames: u64,
    ratio_off: f64,
    flips: u64,
    taxels: u64,
    wire: Wrong,
    unrounded: [u64; 4],
}

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "scale",
        "The same contacts in partial slip with the greatest force of a taxel from 0.0001 to 8 N. \"Rounding\" is what 1/4096 N \
         costs: stick ratio and decisions on the nearest map of the wire against exact arithmetic on the f32 newtons \
         themselves. Then who is right about the taxels of the wire, and about the f32 newtons before they are rounded.",
        &[
            "peak N",
            "taxels",
            "rounding: ratio off",
            "rounding: frames turn %",
            "wire wrong",
            "f32 root",
            "f32 squares",
            "f64 root",
            "f64 squares",
            "newtons: f32 root",
            "newtons: f64 root",
        ],
    );
    let (steps, maps) = (effort.of(25, 6), effort.of(400, 12));
    let mut all: Vec<(f64, At)> = Vec::new();
    for step in 0..steps {
        let peak_n = LEAST_N * (MOST_N / LEAST_N).powf(step as f64 / (steps - 1) as f64);
        // The same contacts at every scale.
        let mut random = effort.random(300);
        let mut at = At::default();
        for _ in 0..maps {
            let contact = Contact {
                peak_n,
                share: random.random_range(0.3..1.0),
                ..Contact::random(&mut random)
            };
            one_map(contact, &mut at);
        }
        all.push((peak_n, at));
    }
    let mut wire = Wrong::default();
    for (peak_n, at) in &all {
        let Wrong { fixed, floats, .. } = at.wire;
        sweep.row(vec![
            json!(peak_n),
            json!(at.taxels),
            json!(at.ratio_off / at.frames.max(1) as f64),
            json!(100.0 * at.flips as f64 / at.frames.max(1) as f64),
            json!(fixed),
            json!(floats[0]),
            json!(floats[1]),
            json!(floats[2]),
            json!(floats[3]),
            json!(at.unrounded[0]),
            json!(at.unrounded[2]),
        ]);
        wire.add(&at.wire);
    }
    sweep.none(
        "decisions of the detector that exact arithmetic makes otherwise, at any scale",
        wire.fixed,
    );
    let good = |at: &At| at.ratio_off / at.frames.max(1) as f64 <= 0.002;
    let from = all
        .iter()
        .rposition(|(_, at)| !good(at))
        .map_or(0, |last| last + 1);
    if let Some((peak_n, _)) = all.get(from) {
        sweep.notes.push(format!(
            "Rounding to the nearest step keeps the stick ratio within 0.002 on average from {peak_n:.2} N a taxel on; below, the \
             contact's rim falls under half a step and is no contact any more."
        ));
    }
    let curve = |value: &dyn Fn(&At) -> f64| all.iter().map(|(peak_n, at)| (*peak_n, value(at))).collect();
    sweep.pictures.push(Picture {
        file: "stress-scale.png",
        caption: "What rounding to 1/4096 N costs, by the greatest force of a taxel: mean error of the stick ratio and share of frames that decide otherwise".to_owned(),
        axes: ["greatest normal force of a taxel, N", "share"],
        is_log: [true, true],
        curves: vec![
            ("stick ratio off by, mean".to_owned(), curve(&|at| at.ratio_off / at.frames.max(1) as f64)),
            ("frames that turn".to_owned(), curve(&|at| at.flips as f64 / at.frames.max(1) as f64)),
        ],
    });
    sweep
}

fn one_map(contact: Contact, at: &mut At) {
    let newtons = contact
        .newtons()
        .map(|force| force.map(|newton| f64::from(newton as f32)));
    let (map, _) = quantised(&newtons);
    let mut counts = [[0_u16; 2]; 2];
    for (force, steps) in newtons.into_iter().zip(map.taxels) {
        if force[2] <= 0.0 {
            continue;
        }
        at.taxels += 1;
        let truth = (true, exact::sticks(force, FRICTION));
        let floats = floats_decide(force, FRICTION, 0);
        for (wrong, found) in at.unrounded.iter_mut().zip(floats) {
            *wrong += u64::from(found != truth);
        }
        let found = at.wire.ask(steps, FRICTION, 0);
        for (count, (contact, stick)) in counts.iter_mut().zip([truth, found]) {
            count[0] += u16::from(contact);
            count[1] += u16::from(stick);
        }
    }
    let [[touching, stuck], [seen, held]] = counts;
    if touching == 0 {
        return;
    }
    at.frames += 1;
    let ratio = |contact: u16, stick: u16| {
        if contact == 0 {
            1.0
        } else {
            f64::from(stick) / f64::from(contact)
        }
    };
    at.ratio_off += (ratio(touching, stuck) - ratio(seen, held)).abs();
    at.flips += u64::from(exact::slips(stuck, touching, THRESHOLD) != exact::slips(held, seen, THRESHOLD));
}
