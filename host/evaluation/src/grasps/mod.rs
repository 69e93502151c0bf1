//! The command `gripline evaluate grasps`: random grasps in closed loop, the microcontroller's library against three
//! simpler rules. [`plan`] says what happens in a grasp, `sensor` what is seen of it, [`policy`] who grips, [`mod@play`] what
//! came of it, [`report`] tells, `picture` draws. Touches files: `--results` keeps every outcome, so that an interrupted
//! run goes on.

mod picture;
pub mod plan;
pub mod play;
pub mod policy;
pub mod report;
mod sensor;

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use gripline_network::Network;
use gripline_simulation::grasp::GraspParts;
use serde::{Deserialize, Serialize};

use self::plan::grasp;
use self::play::{Outcome, play};
use self::policy::Policy;
use self::report::Report;
pub use super::arguments::GraspsArgs;
use super::chain::in_parallel;
use super::document::write_section;
use super::progress::Progress;
use gripline_recording::error::{Completion, Failure};

/// Fixed forces lie on this ladder, N.
const FIXED_STEP_N: f64 = 0.25;
/// The hardest grasps decide how low a fixed force may be: of those that need most, this share is tried.
const HARDEST: f64 = 0.05;
/// The model of the chain is compared with pictures on every so many-th grasp.
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
type Work<'a> = dyn Fn(&'static str, &[Job]) -> Result<Vec<Outcome>, Failure> + 'a;

/// A line of the results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Line {
    seed: u64,
    weights: String,
    fixed_n: f64,
    rendered: bool,
    outcome: Outcome,
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
    seed: u64,
    weights: String,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the network, a world or a file fails; of kind loss when grasps had no solution.
pub fn run(args: &GraspsArgs) -> Result<Completion, Failure> {
    let network = Network::embedded(args.network).map_err(Failure::failed)?;
    let parts = GraspParts::new(&grasp(args.seed, 0).scene).map_err(Failure::failed)?;
    let results = Results::open(args, &network)?;
    let work = |name: &'static str, jobs: &[Job]| -> Result<Vec<Outcome>, Failure> {
        let progress = Progress::new(name, jobs.len());
        let outcomes = in_parallel(jobs, args.threads.into(), |job| {
            let outcome = results.get(job, || {
                let plan = grasp(args.seed, job.grasp);
                play(&plan, job.policy, job.fixed_n, &network, &parts, job.rendered)
            });
            progress.step();
            outcome
        });
        progress.finish();
        outcomes.into_iter().collect()
    };
    let jobs: Vec<Job> = (0..args.grasps)
        .flat_map(|grasp| Policy::LOOKING.map(|policy| (grasp, policy)))
        .map(|(grasp, policy)| job(grasp, policy))
        .collect();
    let mut outcomes = work("grasps", &jobs)?;
    let fixed_n = fixed_force(&outcomes, &work)?;
    let under_fixed: Vec<Job> = (0..args.grasps)
        .map(|grasp| Job {
            fixed_n,
            ..job(grasp, Policy::Fixed)
        })
        .collect();
    outcomes.extend(work("grasps with the fixed force", &under_fixed)?);
    let pictured: Vec<Job> = (0..args.grasps)
        .step_by(RENDERED_EVERY)
        .map(|grasp| Job {
            rendered: true,
            ..job(grasp, Policy::Gripline)
        })
        .collect();
    let rendered = work("grasps with pictures", &pictured)?;
    let report = Report::new(args, fixed_n, &outcomes, &rendered);
    let text = if args.json {
        serde_json::to_string(&report).map_err(Failure::failed)? + "\n"
    } else {
        report.markdown(None)
    };
    io::stdout().write_all(text.as_bytes()).map_err(Failure::failed)?;
    if let Some(path) = &args.out {
        let picture = "grasps.png";
        picture::draw(&path.with_file_name(picture), &outcomes, fixed_n)?;
        write_section(path, "gripline evaluate grasps", &report.markdown(Some(picture)))?;
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

/// The lowest force of the ladder under which none of the hardest grasps is dropped.
fn fixed_force(outcomes: &[Outcome], work: &Work<'_>) -> Result<f64, Failure> {
    let mut hardest: Vec<&Outcome> = outcomes
        .iter()
        .filter(|outcome| outcome.policy == Policy::Gripline && !outcome.unsolved)
        .collect();
    hardest.sort_by(|a, b| b.peak_need_n.total_cmp(&a.peak_need_n));
    let count = ((hardest.len() as f64 * HARDEST).ceil() as usize).max(1);
    hardest.truncate(count);
    let most_n = hardest.first().map_or(0.0, |outcome| outcome.peak_need_n);
    // What the hardest needs at its worst moment surely holds; below, a moment's slip may stop again.
    let mut step = (1.5 * most_n / FIXED_STEP_N).ceil().max(1.0);
    let mut lowest_n = step * FIXED_STEP_N;
    while step >= 1.0 {
        let fixed_n = step * FIXED_STEP_N;
        let jobs: Vec<Job> = hardest
            .iter()
            .map(|outcome| Job {
                fixed_n,
                ..job(outcome.grasp, Policy::Fixed)
            })
            .collect();
        if work("grasps with a fixed force", &jobs)?
            .iter()
            .any(|outcome| outcome.dropped)
        {
            break;
        }
        lowest_n = fixed_n;
        step -= (0.1 * step).ceil();
    }
    Ok(lowest_n)
}

impl Results {
    fn open(args: &GraspsArgs, network: &Network) -> Result<Self, Failure> {
        let weights = format!(
            "{:016x}",
            crc::Crc::<u64>::new(&crc::CRC_64_XZ).checksum(network.manifest().as_bytes())
        );
        let mut results = Self {
            known: Vec::new(),
            file: None,
            seed: args.seed,
            weights,
        };
        if let Some(path) = &args.results {
            results.known = known(path, results.seed, &results.weights)?;
            let file = OpenOptions::new().create(true).append(true).open(path);
            results.file = Some(Mutex::new(
                file.map_err(|error| unusable(path, &error.to_string()))?,
            ));
        }
        Ok(results)
    }

    /// The outcome that is there, or a new one, which is kept.
    fn get(&self, job: &Job, play: impl FnOnce() -> Result<Outcome, Failure>) -> Result<Outcome, Failure> {
        if let Some(line) = self.known.iter().find(|line| line.is_of(job)) {
            return Ok(line.outcome.clone());
        }
        let outcome = play()?;
        if let Some(file) = &self.file {
            let line = Line {
                seed: self.seed,
                weights: self.weights.clone(),
                fixed_n: job.fixed_n,
                rendered: job.rendered,
                outcome: outcome.clone(),
            };
            let text = serde_json::to_string(&line).map_err(Failure::failed)? + "\n";
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            file.write_all(text.as_bytes()).map_err(Failure::failed)?;
        }
        Ok(outcome)
    }
}

fn unusable(path: &Path, found: &str) -> Failure {
    Failure::failed(format!(
        "--results {}: found {found}, expected a file of outcomes or none: choose another file",
        path.display()
    ))
}

/// The outcomes of this seed and these weights in the file; a last line that was cut off is made again.
fn known(path: &Path, seed: u64, weights: &str) -> Result<Vec<Line>, Failure> {
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
        if line.seed == seed && line.weights == weights {
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
            seed: 1,
            weights: "w".to_owned(),
        };
        let results = open(Vec::new());
        for grasp in 0..2 {
            let job = job(grasp, Policy::Coulomb);
            results.get(&job, || Ok(outcome(grasp, Policy::Coulomb))).unwrap();
        }
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 5]).unwrap();
        let results = open(known(&path, 1, "w").unwrap());
        assert_eq!(results.known.len(), 1);
        let never = || panic!("it is known");
        assert_eq!(
            results.get(&job(0, Policy::Coulomb), never).unwrap(),
            outcome(0, Policy::Coulomb)
        );
        assert!(known(&path, 2, "w").unwrap().is_empty());
        fs::write(&path, "{}\n").unwrap();
        assert!(known(&path, 1, "w").unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn the_fixed_force_is_the_lowest_of_its_ladder_that_drops_nothing() {
        let outcomes = vec![outcome(0, Policy::Gripline)];
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
        // The ladder begins at 1.5 × 1.5 N, rounded up.
        assert!((fixed_force(&outcomes, &drops_below(1.1)).unwrap() - 1.25).abs() < 1e-9);
        assert!((fixed_force(&outcomes, &drops_below(0.0)).unwrap() - 0.25).abs() < 1e-9);
    }
}
