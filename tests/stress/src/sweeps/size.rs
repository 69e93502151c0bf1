//! Contacts of one taxel to all four hundred: every stick ratio that there is, and how touchy a frame's decision is.

use gripline_firmware::sums::{stick_ratio, stick_ratio_below};
use gripline_protocol::message::MapSums;
use gripline_protocol::{PER_UNIT, TAXELS, TaxelForce};
use serde_json::json;

use super::judge::{FRICTION, THRESHOLD, Wrong, quantised, rule};
use crate::contacts;
use crate::picture::Picture;
use crate::{Effort, Sweep, exact};

/// Rows of the table: sizes up to these.
const SIZES: [u16; 8] = [1, 2, 5, 10, 25, 100, 250, 400];

pub(crate) fn sweep(effort: Effort) -> Sweep {
    let mut sweep = Sweep::new(
        "size of the contact",
        "Every number of taxels in contact from 1 to 400 with every number that sticks, asked at the thresholds beside that \
         stick ratio: the comparison without a division, a quotient in f32 and f64, and stick < threshold · contact in f64. \
         Then random contacts of that size near the cone, one step on one component: share of the frames that turn.",
        &[
            "taxels up to",
            "ratios",
            "thresholds asked",
            "wrong",
            "f32 quotient",
            "f64 quotient",
            "f64 product",
            "steps tried",
            "frames turn %",
            "taxels wrong",
        ],
    );
    let mut min = 1;
    let mut wrong = 0;
    let mut taxels_wrong = 0;
    let mut curve = Vec::new();
    for max in SIZES {
        let asked = (min..=max).fold(Asked::default(), Asked::every_ratio);
        let (tried, turned, taxels) = touchy(effort, max, &mut curve, min);
        sweep.row(vec![
            json!(max),
            json!(asked.ratios),
            json!(asked.thresholds),
            json!(asked.wrong),
            json!(asked.single),
            json!(asked.double),
            json!(asked.product),
            json!(tried),
            json!(100.0 * turned as f64 / tried.max(1) as f64),
            json!(taxels),
        ]);
        wrong += asked.wrong;
        taxels_wrong += taxels;
        min = max + 1;
    }
    sweep.none(
        "frame decisions that exact arithmetic makes otherwise, over all ratios and thresholds",
        wrong,
    );
    sweep.none("taxels decided otherwise in contacts of any size", taxels_wrong);
    sweep.notes.push(
        "A quotient in f32 or f64 is right here: two different ratios of at most 400 taxels to 1/10000 are always further apart \
         than its rounding. The product is not: 0.0001 steps are no binary fractions."
            .to_owned(),
    );
    sweep.pictures.push(Picture {
        file: "stress-size.png",
        caption: "How often one step of 1/4096 N on one component turns the decision about a frame, by the number of taxels in contact (forces of 0.02 to 0.1 N near the cone)".to_owned(),
        axes: ["taxels in contact", "share of single steps that turn the frame"],
        is_log: [true, true],
        curves: vec![("0.1 N a taxel at most".to_owned(), curve)],
    });
    sweep
}

/// Every ratio of a number of taxels.
#[derive(Default)]
struct Asked {
    ratios: u64,
    thresholds: u64,
    wrong: u64,
    single: u64,
    double: u64,
    product: u64,
}

impl Asked {
    fn every_ratio(mut self, contact: u16) -> Self {
        for stick in 0..=contact {
            let sums = MapSums {
                contact,
                stick,
                ..MapSums::default()
            };
            self.ratios += 1;
            // Rounded down, so the thresholds beside the ratio are this one and the next.
            let at = u32::from(stick) * PER_UNIT / u32::from(contact);
            self.wrong += u64::from(stick_ratio(&sums).map(u32::from) != Some(at));
            for threshold in at.saturating_sub(1)..=(at + 2).min(PER_UNIT) {
                let threshold = threshold as u16;
                let right = exact::slips(stick, contact, threshold);
                let level = f64::from(threshold) / f64::from(PER_UNIT);
                self.thresholds += 1;
                self.wrong += u64::from(stick_ratio_below(&sums, threshold) != right);
                let single = f32::from(stick) / f32::from(contact) < f32::from(threshold) / PER_UNIT as f32;
                self.single += u64::from(single != right);
                self.double += u64::from((f64::from(stick) / f64::from(contact) < level) != right);
                self.product += u64::from((f64::from(stick) < level * f64::from(contact)) != right);
            }
        }
        self
    }
}

/// Single steps over random contacts: (tried, frames turned, taxels wrong).
fn touchy(effort: Effort, max: u16, curve: &mut Vec<(f64, f64)>, min: u16) -> (u64, u64, u64) {
    let mut random = effort.random(400 + u64::from(max));
    let mut all = [0_u64; 3];
    let sizes: Vec<u16> = if effort.is_quick {
        vec![max]
    } else {
        (min..=max).step_by(usize::from(max / 25).max(1)).collect()
    };
    for size in sizes {
        let (mut tried, mut turned) = (0_u64, 0_u64);
        let mut wrong = Wrong::default();
        for _ in 0..effort.of(200, 10) {
            let (map, _) = quantised(&contacts::of_size(size.into(), 0.1, 0.45, &mut random));
            let mut counts = [0_u16; 2];
            for force in map.taxels {
                let (contact, stick) = wrong.ask(force, FRICTION, 0);
                counts[0] += u16::from(contact);
                counts[1] += u16::from(stick);
            }
            let was = exact::slips(counts[1], counts[0], THRESHOLD);
            for force in map.taxels.iter().filter(|force| **force != TaxelForce::ZERO) {
                let (contact, stick) = rule(FRICTION, 0).decide(*force);
                for (axis, by) in (0..3).flat_map(|axis| [(axis, -1_i16), (axis, 1)]) {
                    let mut steps = [force.x, force.y, force.z];
                    steps[axis] = steps[axis].saturating_add(by);
                    let [x, y, z] = steps;
                    let (touches, sticks) = rule(FRICTION, 0).decide(TaxelForce { x, y, z });
                    let after = [
                        counts[0] + u16::from(touches) - u16::from(contact),
                        counts[1] + u16::from(sticks) - u16::from(stick),
                    ];
                    tried += 1;
                    turned += u64::from(exact::slips(after[1], after[0], THRESHOLD) != was);
                }
            }
        }
        if usize::from(size) <= TAXELS && tried > 0 {
            curve.push((f64::from(size), turned as f64 / tried as f64));
        }
        for (sum, part) in all.iter_mut().zip([tried, turned, wrong.fixed]) {
            *sum += part;
        }
    }
    let [tried, turned, wrong] = all;
    (tried, turned, wrong)
}
