//! What `gripline evaluate grasps` says.

use std::collections::BTreeMap;

use gripline_protocol::PER_UNIT;
use gripline_protocol::message::Configuration;
use serde::Serialize;

use super::super::document::{number, table};
use super::super::metrics::quantile;
use super::super::requirement::{Requirement, requirements_table};
use super::play::Outcome;
use super::policy::{FLOOR_N, Policy};
use crate::arguments::GraspsArgs;

/// A policy's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    grasps: usize,
    drops: usize,
    micro_slip_mm_p50: Option<f64>,
    micro_slip_mm_p99: Option<f64>,
    mean_force_n: f64,
    peak_force_n: f64,
    /// Mean over the grasps of what physics needs.
    mean_need_n: f64,
    median_margin: Option<f64>,
    /// A tenth of the grasps have less, a tenth more.
    margin_p10: Option<f64>,
    margin_p90: Option<f64>,
}

/// Everything.
#[derive(Debug, Serialize)]
pub struct Report {
    grasps: u64,
    seed: u64,
    network: String,
    fixed_force_n: f64,
    policies: BTreeMap<Policy, Figures>,
    /// Of the grasps that were played with pictures too: by the model, and with pictures.
    model_on_subset: Figures,
    pictures_on_subset: Figures,
    /// What is asked for, and what was found.
    bounds: Vec<Requirement>,
    /// Runs without a solution of the contact world, left out.
    pub unsolved: usize,
}

/// The project's bounds on closed loop, of Gripline with its default settings.
fn requirements(gripline: &Figures, fixed: &Figures) -> Vec<Requirement> {
    let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 0);
    let (margin, slid) = (gripline.median_margin, gripline.micro_slip_mm_p99);
    let share = gripline.mean_force_n / fixed.mean_force_n.max(1e-9);
    vec![
        Requirement::new("drops", "0", gripline.drops.to_string(), gripline.drops == 0),
        Requirement::new(
            "median margin over the needed force, %",
            "10 to 40",
            percent(margin),
            margin.is_some_and(|margin| (0.1..=0.4).contains(&margin)),
        ),
        Requirement::new(
            "slid, 99th percentile, mm",
            "≤ 1",
            number(slid, 2),
            slid.is_some_and(|slid| slid <= 1.0),
        ),
        Requirement::new(
            "mean force, % of the fixed force that drops as few",
            "≤ 60",
            percent(Some(share)),
            share <= 0.6,
        ),
    ]
}

impl Figures {
    fn of<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> Self {
        let outcomes: Vec<&Outcome> = outcomes.filter(|outcome| !outcome.unsolved).collect();
        let count = outcomes.len().max(1) as f64;
        let held: Vec<&&Outcome> = outcomes.iter().filter(|outcome| !outcome.dropped).collect();
        let slips: Vec<f64> = held
            .iter()
            .map(|outcome| outcome.micro_slip_mm)
            .filter(|slip| slip.is_finite())
            .collect();
        let margins: Vec<f64> = held.iter().filter_map(|outcome| outcome.margin).collect();
        let mean =
            |value: fn(&Outcome) -> f64| outcomes.iter().map(|outcome| value(outcome)).sum::<f64>() / count;
        Self {
            grasps: outcomes.len(),
            drops: outcomes.len() - held.len(),
            micro_slip_mm_p50: quantile(&slips, 0.5),
            micro_slip_mm_p99: quantile(&slips, 0.99),
            mean_force_n: mean(|outcome| outcome.mean_force_n),
            peak_force_n: mean(|outcome| outcome.peak_force_n),
            mean_need_n: mean(|outcome| outcome.mean_need_n),
            median_margin: quantile(&margins, 0.5),
            margin_p10: quantile(&margins, 0.1),
            margin_p90: quantile(&margins, 0.9),
        }
    }

    fn row(&self, name: &str) -> Vec<String> {
        let percent = |share: Option<f64>| share.map(|share| 100.0 * share);
        vec![
            name.to_owned(),
            format!("{} of {}", self.drops, self.grasps),
            number(self.micro_slip_mm_p50, 2),
            number(self.micro_slip_mm_p99, 2),
            format!("{:.2}", self.mean_force_n),
            format!("{:.2}", self.peak_force_n),
            format!("{:.2}", self.mean_need_n),
            number(percent(self.median_margin), 0),
            format!(
                "{} to {}",
                number(percent(self.margin_p10), 0),
                number(percent(self.margin_p90), 0)
            ),
        ]
    }
}

const COLUMNS: [&str; 9] = [
    "policy",
    "drops",
    "slid, median mm",
    "slid, 99th percentile mm",
    "mean force N",
    "peak force N",
    "needed N",
    "median margin %",
    "80 % of margins %",
];

impl Report {
    /// Of these outcomes; `rendered` are those of Gripline with pictures.
    #[must_use]
    pub fn new(args: &GraspsArgs, fixed_force_n: f64, outcomes: &[Outcome], rendered: &[Outcome]) -> Self {
        let of = |policy: Policy| outcomes.iter().filter(move |outcome| outcome.policy == policy);
        let pictured = |outcome: &&Outcome| rendered.iter().any(|other| other.grasp == outcome.grasp);
        let policies: BTreeMap<Policy, Figures> = Policy::LOOKING
            .into_iter()
            .chain([Policy::Fixed])
            .map(|policy| (policy, Figures::of(of(policy))))
            .collect();
        Self {
            bounds: requirements(&policies[&Policy::Gripline], &policies[&Policy::Fixed]),
            grasps: args.grasps,
            seed: args.seed,
            network: args.network.to_string(),
            fixed_force_n,
            policies,
            model_on_subset: Figures::of(of(Policy::Gripline).filter(pictured)),
            pictures_on_subset: Figures::of(rendered.iter()),
            unsolved: outcomes
                .iter()
                .chain(rendered)
                .filter(|outcome| outcome.unsolved)
                .count(),
        }
    }

    /// The page, with the picture's file if there is one.
    #[must_use]
    pub fn markdown(&self, picture: Option<&str>) -> String {
        let rows: Vec<Vec<String>> = self
            .policies
            .iter()
            .map(|(policy, figures)| figures.row(policy.name()))
            .collect();
        let subset = [
            self.model_on_subset.row("Gripline, model of the chain"),
            self.pictures_on_subset.row("Gripline, rendered pictures"),
        ];
        let shown = picture.map_or_else(String::new, |picture| {
            format!("\n![Mean grip force of every grasp against its margin over what friction needs; crosses are drops]({picture})\n")
        });
        let percent = |settings: Configuration| format!("{} %", u32::from(settings.margin) * 100 / PER_UNIT);
        let [kept, careful] = [Configuration::DEFAULT, Configuration::CAREFUL].map(percent);
        format!(
            "## Closed loop: random grasps\n\n`gripline evaluate grasps --grasps {} --seed {}` (network {}): an object of \
             random mass (its weight alone needs 1 to 6 N), friction (0.5 to 1.0), shape and centre of mass is gripped \
             on a table, its load taken up (1.5 mm in half a second), lifted, disturbed (shake, dash, pull, twist or nothing) and put down; 60 frames a second, 25 ms \
             from picture to gripper, a gripper with 40 ms lag and 60 N/s. The microcontroller's library runs behind its \
             own protocol. The contact world has the training grid (40 cells). Needed is the force at which friction \
             holds the load of a moment, (Q/μN)² + (M/(μN·2/3 a))² = 1; margins are over it, or over the least force of \
             {FLOOR_N} N where it is less. {} runs had no solution and are left out.\n\n{}\n\
             {}\n\
             Gripline has the default settings and knows no object's friction: it learns it. What a contact carries, shear and torsion over normal force, \
             is a lower bound of its friction; a load that comes on raises it by itself, because the grip follows late (80 ms from picture \
             to force), and until it rests or the contact slides a friction of 0.6 is expected. The grip keeps {kept} above what the friction that was proven needs. So margins over what is needed are those {kept} and what \
             was not proven: friction that never had to carry. Margin, look-ahead, rates and what counts as a slide were chosen on grasps of the seeds 9 to 17. \
             Nothing learnt: the detector's friction \
             (the network's calibration) with a margin of {careful} and a reflex. The fixed \
             force of {:.2} N is the lowest of a ladder that drops none of the hardest twentieth of the grasps. \
             The bang-bang rules rise at 40 N/s while their detector (the paper's, at \
             its settings) says slip, and fall by 1 N/s after half a second without.\n{shown}\n\
             What the microcontroller sees comes from a model of pictures and network (true map, blurred and cut, with \
             gains and fluctuation as measured on the tuning data). The same grasps, every 25th, with rendered pictures \
             through the whole chain:\n\n{}",
            self.grasps,
            self.seed,
            self.network,
            self.unsolved,
            table(&COLUMNS, &rows),
            requirements_table(&self.bounds),
            self.fixed_force_n,
            table(&COLUMNS, &subset),
        )
    }
}
