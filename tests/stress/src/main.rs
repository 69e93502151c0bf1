//! `cargo xtask stress [--json] [--seed N] [--quick] [--docs]`: runs the sweeps and prints their tables; exit code 1 when a bound
//! is missed, 2 for wrong usage. `--docs` writes the page docs/stress.md and its pictures.
#![forbid(unsafe_code)]

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use gripline_stress::report::Check;
use gripline_stress::{Effort, Sweep, picture};
use serde_json::{Value, json};

const USAGE: &str = "cargo xtask stress [--json] [--seed N] [--quick] [--docs]";
/// Of every random number, if nobody says otherwise.
const SEED: u64 = 1;

struct Arguments {
    effort: Effort,
    json: bool,
    docs: bool,
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(why) => {
            eprintln!("stress: {why}, expected {USAGE}");
            return ExitCode::from(2);
        }
    };
    let started = Instant::now();
    let sweeps = gripline_stress::run(arguments.effort, |name| eprintln!("{name} ..."));
    if arguments.json {
        let all: Vec<Value> = sweeps.iter().map(Sweep::json).collect();
        let holds = sweeps.iter().all(Sweep::holds);
        println!(
            "{}",
            json!({"seed": arguments.effort.seed, "quick": arguments.effort.is_quick, "holds": holds, "sweeps": all})
        );
    } else {
        for sweep in &sweeps {
            print!("{}", sweep.text());
        }
        println!(
            "\n{} in {:.0} s",
            verdict(&sweeps),
            started.elapsed().as_secs_f64()
        );
    }
    if arguments.docs
        && let Err(error) = write_docs(arguments.effort, &sweeps)
    {
        eprintln!("stress: docs/stress.md and its pictures cannot be written: {error}");
        return ExitCode::FAILURE;
    }
    if sweeps.iter().all(Sweep::holds) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments {
        effort: Effort {
            seed: SEED,
            is_quick: false,
        },
        json: false,
        docs: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--json" => found.json = true,
            "--quick" => found.effort.is_quick = true,
            "--docs" => found.docs = true,
            "--seed" => {
                let number = words.next().unwrap_or_default();
                found.effort.seed = number
                    .parse()
                    .map_err(|_| format!("--seed: found `{number}`, expected a whole number"))?;
            }
            unknown => return Err(format!("found `{unknown}`")),
        }
    }
    Ok(found)
}

fn verdict(sweeps: &[Sweep]) -> String {
    let checks: Vec<&Check> = sweeps.iter().flat_map(|sweep| &sweep.checks).collect();
    let held = checks.iter().filter(|check| check.holds()).count();
    format!(
        "{held} of {} bounds held in {} sweeps",
        checks.len(),
        sweeps.len()
    )
}

fn write_docs(effort: Effort, sweeps: &[Sweep]) -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let mut page = String::from(
        "# Numerical stability\n\nWritten by `cargo xtask stress --docs`; do not edit. The detector decides in whole numbers, \
         so exact arithmetic (integers of any length) must agree with it everywhere; beside it the same detector in f32 and \
         f64, as a root (the paper's √(fx²+fy²) ≤ μ fz) and as squares. A smaller run of the same sweeps is part of \
         `cargo xtask test`, with overflow checks on. How good the decisions are is [the evidence](evidence.md)'s matter; this \
         page asks whether arithmetic spoils them.\n\n",
    );
    let _ = writeln!(
        page,
        "Seed {}, {}: {}.\n",
        effort.seed,
        if effort.is_quick { "quick run" } else { "full run" },
        verdict(sweeps)
    );
    let _ = writeln!(page, "| sweep | bounds | verdict |\n|---|---|---|");
    for sweep in sweeps {
        let held = if sweep.holds() { "held" } else { "MISSED" };
        let _ = writeln!(page, "| {} | {} | {held} |", sweep.name, sweep.checks.len());
    }
    for sweep in sweeps {
        page.push_str(&sweep.markdown());
        for picture in &sweep.pictures {
            picture::draw(picture, &folder)?;
        }
    }
    std::fs::write(folder.join("stress.md"), page)?;
    Ok(())
}
