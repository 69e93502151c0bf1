//! The command `gripline evaluate grasps`: random grasps in closed loop, the microcontroller's library against
//! simpler rules, a particle filter and an oracle. [`plan`] says what a grasp is, [`nominal`] and [`adverse`] draw them;
//! `sensor`, `distortion`, `motion` and `pictures` say what is seen of it, [`policy`] who grips (`follower`, `oracle` and
//! `particle_filter` are parts of it), [`mod@play`] what came of it, `slides` when it slid, `hold` what a long hold came to,
//! [`report`] tells, `picture` draws. Touches files: `--results` keeps every outcome, so that an interrupted run goes on.

pub mod adverse;
mod distortion;
mod follower;
mod hold;
mod motion;
pub mod nominal;
mod oracle;
mod particle_filter;
mod picture;
mod pictures;
pub mod plan;
pub mod play;
pub mod policy;
pub mod report;
mod sensor;
mod slides;

use std::env;
use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use gripline_network::Network;
use gripline_simulation::grasp::GraspParts;
use serde::{Deserialize, Serialize};

use self::plan::GraspPlan;
use self::play::{Outcome, play};
use self::policy::{Policy, ceiling_n};
use self::report::Report;
pub use super::arguments::{GelModel, GraspsArgs, World};
use super::chain::in_parallel;
use super::document::write_section;
use super::progress::Progress;
use crate::error::EvaluationError;
use gripline_recording::error::Completion;

/// Fixed forces are multiples of this, N.
const FIXED_STEP_N: f64 = 0.25;
/// The hardest grasps decide how low a fixed force may be: of those that need most, this share is tried.
const HARDEST: f64 = 0.05;
/// The model of the chain is compared with pictures on every n-th grasp.
const RENDERED_EVERY: usize = 25;

/// What is played: a grasp under a policy, by the model or with pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Job {
    grasp: u64,
    policy: Policy,
    fixed_n: f64,
    rendered: bool,
}

/// Plays jobs; the name is for the progress.
type Work<'a> = dyn Fn(&'static str, &[Job]) -> Result<Vec<Outcome>, EvaluationError> + 'a;

/// A line of the results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Line {
    world: World,
    #[serde(default)]
    contact: GelModel,
    seed: u64,
    weights: String,
    /// The program that played it: laws and physics are part of it.
    #[serde(default)]
    program: String,
    fixed_n: f64,
    rendered: bool,
    #[serde(default)]
    hold_s: u32,
    #[serde(default = "whole")]
    fade_percent: u8,
    outcome: Outcome,
}

/// Friction as it is.
const fn whole() -> u8 {
    100
}

impl Line {
    fn is_of(&self, job: &Job) -> bool {
        let same_force = (self.fixed_n - job.fixed_n).abs() < 1e-9;
        same_force
            && self.rendered == job.rendered
            && self.outcome.grasp == job.grasp
            && self.outcome.policy == job.policy
    }
}

/// Outcomes that are there, and the file that more go into.
struct Results {
    known: Vec<Line>,
    file: Option<Mutex<fs::File>>,
    world: World,
    contact: GelModel,
    seed: u64,
    hold_s: u32,
    fade_percent: u8,
    weights: String,
    program: String,
}

/// Grasp number `number` of a world.
#[must_use]
pub fn grasp(world: World, seed: u64, number: u64) -> GraspPlan {
    match world {
        World::Nominal => nominal::grasp(seed, number),
        World::Adverse => adverse::grasp(seed, number),
    }
}

/// Runs the command.
///
/// # Errors
/// [`EvaluationError`] when the network, a world or a file fails; of kind loss when grasps had no solution.
pub fn run(args: &GraspsArgs) -> Result<Completion, EvaluationError> {
    let chosen = |policy: Policy| args.policies.contains(&policy);
    if chosen(Policy::Fixed) && !(chosen(Policy::Gripline) && chosen(Policy::Oracle)) {
        return Err(EvaluationError::Policies);
    }
    let network = Network::embedded(args.network)?;
    let parts = GraspParts::new(&grasp(args.world, args.seed, 0).scene)?;
    let results = Results::open(args, &network)?;
    let work = |name: &'static str, jobs: &[Job]| -> Result<Vec<Outcome>, EvaluationError> {
        let progress = Progress::new(name, jobs.len());
        let outcomes = in_parallel(jobs, args.threads.into(), |job| {
            let outcome = results.get(job, || {
                let hold_s = args.hold.into();
                let mut plan = grasp(args.world, args.seed, job.grasp)
                    .held_longer(hold_s)
                    .fading(hold_s, f64::from(args.fade) / 100.0);
                plan.scene.contact = args.contact.model();
                play(&plan, job.policy, job.fixed_n, &network, &parts, job.rendered)
            });
            progress.step();
            outcome
        });
        progress.finish();
        outcomes.into_iter().collect()
    };
    let jobs: Vec<Job> = (0..args.grasps)
        .flat_map(|grasp| Policy::LOOKING.map(|policy| job(grasp, policy)))
        .filter(|job| chosen(job.policy))
        .collect();
    let mut outcomes = work("grasps", &jobs)?;
    let mut fixed_n = None;
    if chosen(Policy::Fixed) {
        let min_n = fixed_force(&outcomes, &work)?;
        let under_fixed: Vec<Job> = (0..args.grasps).map(|grasp| fixed(grasp, min_n)).collect();
        outcomes.extend(work("grasps with the fixed force", &under_fixed)?);
        fixed_n = Some(min_n);
    }
    let lost: Vec<Job> = outcomes
        .iter()
        .filter(|outcome| outcome.policy == Policy::GriplineSecure && outcome.dropped)
        .map(|outcome| fixed(outcome.grasp, ceiling_n()))
        .collect();
    let at_ceiling = work("grasps at the ceiling", &lost)?;
    let pictures = chosen(Policy::Gripline);
    let pictured: Vec<Job> = (0..if pictures { args.grasps } else { 0 })
        .step_by(RENDERED_EVERY)
        .map(|grasp| Job {
            rendered: true,
            ..job(grasp, Policy::Gripline)
        })
        .collect();
    let rendered = work("grasps with pictures", &pictured)?;
    let report = Report::new(args, fixed_n, &outcomes, &rendered, &at_ceiling);
    let text = if args.json {
        serde_json::to_string(&report)? + "\n"
    } else {
        report.markdown(None)
    };
    io::stdout().write_all(text.as_bytes())?;
    if let Some(path) = &args.plot {
        picture::draw_drops(path, &report.points())?;
    }
    if let Some(path) = &args.out {
        let (picture, section) = match (args.world, args.contact) {
            (World::Nominal, GelModel::Layer) => ("grasps.png", "gripline evaluate grasps"),
            (World::Adverse, GelModel::Layer) => {
                ("grasps-adverse.png", "gripline evaluate grasps --world adverse")
            }
            (World::Nominal, GelModel::Brush) => {
                ("grasps-brush.png", "gripline evaluate grasps --contact brush")
            }
            (World::Adverse, GelModel::Brush) => (
                "grasps-adverse-brush.png",
                "gripline evaluate grasps --world adverse --contact brush",
            ),
        };
        picture::draw(&path.with_file_name(picture), &outcomes, fixed_n)?;
        write_section(path, section, &report.markdown(Some(picture)))?;
    }
    match report.unsolved {
        0 => Ok(Completion::Whole),
        unsolved => Ok(Completion::WithLoss(format!(
            "done with loss: {unsolved} runs had no solution in the contact world and are left out"
        ))),
    }
}

fn job(grasp: u64, policy: Policy) -> Job {
    Job {
        grasp,
        policy,
        fixed_n: 0.0,
        rendered: false,
    }
}

fn fixed(grasp: u64, fixed_n: f64) -> Job {
    Job {
        fixed_n,
        ..job(grasp, Policy::Fixed)
    }
}

/// The lowest multiple of [`FIXED_STEP_N`] under which no more grasps are dropped than under Gripline. Only the hardest are tried,
/// by what the oracle's runs needed: those hold to the end.
fn fixed_force(outcomes: &[Outcome], work: &Work<'_>) -> Result<f64, EvaluationError> {
    let of = |policy: Policy| {
        outcomes
            .iter()
            .filter(move |outcome| outcome.policy == policy && !outcome.unsolved)
    };
    let allowed = of(Policy::Gripline).filter(|outcome| outcome.dropped).count();
    let mut hardest: Vec<&Outcome> = of(Policy::Oracle).collect();
    hardest.sort_by(|a, b| b.peak_need_n.total_cmp(&a.peak_need_n));
    // Twice the drops, so that there are grasps that the force may still hold.
    let count = ((hardest.len() as f64 * HARDEST).ceil() as usize)
        .max(2 * allowed)
        .max(1);
    hardest.truncate(count);
    let max_n = hardest.first().map_or(0.0, |outcome| outcome.peak_need_n);
    // What the hardest needs at its worst moment surely holds; below, a moment's slip may stop again. No force drops all.
    let mut holds = ((1.5 * max_n).min(ceiling_n()) / FIXED_STEP_N).ceil().max(1.0) as u32;
    let mut drops = 0;
    while holds - drops > 1 {
        let middle = u32::midpoint(holds, drops);
        let fixed_n = f64::from(middle) * FIXED_STEP_N;
        let jobs: Vec<Job> = hardest
            .iter()
            .map(|outcome| fixed(outcome.grasp, fixed_n))
            .collect();
        let played = work("grasps with a fixed force", &jobs)?;
        if played.iter().filter(|outcome| outcome.dropped).count() > allowed {
            drops = middle;
        } else {
            holds = middle;
        }
    }
    Ok(f64::from(holds) * FIXED_STEP_N)
}

impl Results {
    fn open(args: &GraspsArgs, network: &Network) -> Result<Self, EvaluationError> {
        let weights = fingerprint(network.manifest().as_bytes());
        let mut results = Self {
            known: Vec::new(),
            file: None,
            world: args.world,
            contact: args.contact,
            seed: args.seed,
            hold_s: args.hold,
            fade_percent: args.fade,
            weights,
            program: String::new(),
        };
        if let Some(path) = &args.results {
            results.program = fingerprint(&fs::read(env::current_exe()?)?);
            results.known = known(path, &results)?;
            let file = OpenOptions::new().create(true).append(true).open(path);
            results.file = Some(Mutex::new(
                file.map_err(|error| unusable(path, &error.to_string()))?,
            ));
        }
        Ok(results)
    }

    /// Whether a line is of this world, gel, seed, hold, friction, these weights and this program.
    fn takes(&self, line: &Line) -> bool {
        (line.world, line.contact, line.seed) == (self.world, self.contact, self.seed)
            && (line.hold_s, line.fade_percent) == (self.hold_s, self.fade_percent)
            && (&line.weights, &line.program) == (&self.weights, &self.program)
    }

    /// The outcome that is there, or a new one, which is kept.
    fn get(
        &self,
        job: &Job,
        play: impl FnOnce() -> Result<Outcome, EvaluationError>,
    ) -> Result<Outcome, EvaluationError> {
        if let Some(line) = self.known.iter().find(|line| line.is_of(job)) {
            return Ok(line.outcome.clone());
        }
        let outcome = play()?;
        if let Some(file) = &self.file {
            let line = Line {
                world: self.world,
                contact: self.contact,
                seed: self.seed,
                weights: self.weights.clone(),
                program: self.program.clone(),
                fixed_n: job.fixed_n,
                rendered: job.rendered,
                hold_s: self.hold_s,
                fade_percent: self.fade_percent,
                outcome: outcome.clone(),
            };
            let text = serde_json::to_string(&line)? + "\n";
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            file.write_all(text.as_bytes())?;
        }
        Ok(outcome)
    }
}

fn fingerprint(bytes: &[u8]) -> String {
    format!("{:016x}", crc::Crc::<u64>::new(&crc::CRC_64_XZ).checksum(bytes))
}

fn unusable(path: &Path, found: &str) -> EvaluationError {
    EvaluationError::File {
        file: format!("--results {}", path.display()),
        found: format!("found {found}"),
        expected: "a file of outcomes or none: choose another file",
    }
}

/// The outcomes in the file that are of this command; a last line that was cut off is made again.
fn known(path: &Path, results: &Results) -> Result<Vec<Line>, EvaluationError> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(unusable(path, &error.to_string())),
    };
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    if whole < text.len() {
        fs::write(path, &text[..whole]).map_err(|error| unusable(path, &error.to_string()))?;
    }
    let mut lines = Vec::new();
    for (number, line) in text[..whole].lines().enumerate() {
        let line: Line = serde_json::from_str(line)
            .map_err(|error| unusable(path, &format!("line {} that is none ({error})", number + 1)))?;
        if results.takes(&line) {
            lines.push(line);
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(grasp: u64, policy: Policy) -> Outcome {
        Outcome {
            policy,
            grasp,
            disturbance: "none".to_owned(),
            dropped: false,
            unsolved: false,
            micro_slip_mm: 0.1,
            mean_force_n: 2.0,
            peak_force_n: 3.0,
            mean_need_n: 1.0,
            peak_need_n: 1.5,
            margin: Some(1.0),
            slides: 0,
            late_falls: 0,
            rises_ms: Vec::new(),
            rises_in_hold_ms: Vec::new(),
            hold: None,
        }
    }

    #[test]
    fn outcomes_that_are_there_are_not_played_again_and_half_a_line_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.jsonl");
        let open = |known: Vec<Line>| Results {
            known,
            file: Some(Mutex::new(
                OpenOptions::new().create(true).append(true).open(&path).unwrap(),
            )),
            world: World::Nominal,
            contact: GelModel::Layer,
            seed: 1,
            hold_s: 0,
            fade_percent: 100,
            weights: "w".to_owned(),
            program: "p".to_owned(),
        };
        let results = open(Vec::new());
        for grasp in 0..2 {
            let job = job(grasp, Policy::Coulomb);
            results.get(&job, || Ok(outcome(grasp, Policy::Coulomb))).unwrap();
        }
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 5]).unwrap();
        let results = open(known(&path, &results).unwrap());
        assert_eq!(results.known.len(), 1);
        let never = || panic!("it is known");
        assert_eq!(
            results.get(&job(0, Policy::Coulomb), never).unwrap(),
            outcome(0, Policy::Coulomb)
        );
        for other in [
            Results {
                world: World::Adverse,
                ..open(Vec::new())
            },
            Results {
                seed: 2,
                ..open(Vec::new())
            },
            Results {
                hold_s: 60,
                ..open(Vec::new())
            },
            Results {
                fade_percent: 65,
                ..open(Vec::new())
            },
            Results {
                program: "another build".to_owned(),
                ..open(Vec::new())
            },
        ] {
            assert!(known(&path, &other).unwrap().is_empty());
        }
        fs::write(&path, "{}\n").unwrap();
        let error = known(&path, &results).unwrap_err();
        assert!(error.to_string().contains("line 1"));
    }

    #[test]
    fn a_fixed_force_without_what_it_is_chosen_by_is_refused_by_name() {
        use clap::Parser;
        #[derive(Parser)]
        struct Command {
            #[command(flatten)]
            args: GraspsArgs,
        }
        for policies in ["fixed", "gripline,fixed", "oracle,fixed"] {
            let command = Command::parse_from(["grasps", "--grasps", "1", "--policies", policies]);
            let error = run(&command.args).unwrap_err().to_string();
            assert!(error.contains("--policies"), "{policies}: {error}");
        }
    }

    #[test]
    fn the_fixed_force_is_the_lowest_of_its_steps_that_drops_nothing() {
        let outcomes = vec![outcome(0, Policy::Gripline), outcome(0, Policy::Oracle)];
        let drops_below = |limit_n: f64| {
            move |_: &'static str, jobs: &[Job]| {
                Ok(jobs
                    .iter()
                    .map(|job| Outcome {
                        dropped: job.fixed_n < limit_n,
                        ..outcome(job.grasp, Policy::Fixed)
                    })
                    .collect())
            }
        };
        // The search begins at 1.5 × 1.5 N, rounded up.
        assert!((fixed_force(&outcomes, &drops_below(1.1)).unwrap() - 1.25).abs() < 1e-9);
        assert!((fixed_force(&outcomes, &drops_below(0.0)).unwrap() - 0.25).abs() < 1e-9);
        let mut hard = outcomes;
        for outcome in &mut hard {
            outcome.peak_need_n = 10.0;
        }
        assert!((fixed_force(&hard, &drops_below(9.1)).unwrap() - 9.25).abs() < 1e-9);
    }
}
