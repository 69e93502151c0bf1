//! `cargo xtask bench`: run time against error, for the whole chain and for each stage. Detector: f64, f32, fixed dense, sparse and
//! packet by packet, NumPy beside them. Chain: networks, scene gates, wire. And what skipping saves and changes, scene by scene.
//!
//! `gripline-bench [--json] [--frames N] [--rounds N] [--seed N] [--instructions SET] [--plot FILE] [--numpy FOLDER]`; exit code 1 when a bound is
//! missed, 2 for wrong usage. All contestants take turns, so that what else the machine does falls on all of them.
#![forbid(unsafe_code)]

mod chain;
mod detectors;
mod failure;
mod numpy;
mod plot;
mod report;
mod rule;
mod scenes;

use std::path::PathBuf;
use std::process::ExitCode;

use detectors::Maps;
use failure::Failure;
use gripline_network::InstructionSet;
use numpy::Numpy;
use report::Report;

const USAGE: &str =
    "--json, --frames N (60 and more), --rounds N, --seed N, --instructions SET, --plot FILE, --numpy FOLDER";

struct Arguments {
    json: bool,
    frames: usize,
    rounds: usize,
    seed: u64,
    /// What the ways are computed with, but those that show the others.
    instructions: InstructionSet,
    plot: Option<PathBuf>,
    /// Where the Python package lies.
    numpy: Option<PathBuf>,
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(why) => {
            eprintln!("bench: {why}, expected {USAGE}");
            return ExitCode::from(2);
        }
    };
    match run(&arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(failure) => {
            eprintln!("bench: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments {
        json: false,
        frames: 240,
        rounds: 31,
        seed: 1,
        instructions: InstructionSet::widest(),
        plot: None,
        numpy: None,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word}: found nothing after it"));
        let number = |text: String, min: u64| {
            let number = text.parse().ok().filter(|number| *number >= min);
            number.ok_or(format!(
                "{word}: found `{text}` instead of a number from {min} on"
            ))
        };
        match word.as_str() {
            "--json" => found.json = true,
            "--frames" => found.frames = number(value()?, 60)? as usize,
            "--rounds" => found.rounds = number(value()?, 1)? as usize,
            "--seed" => found.seed = number(value()?, 0)?,
            "--instructions" => {
                let set = value()?
                    .parse::<InstructionSet>()
                    .and_then(InstructionSet::checked);
                found.instructions = set.map_err(|error| error.to_string())?;
            }
            "--plot" => found.plot = Some(value()?.into()),
            "--numpy" => found.numpy = Some(value()?.into()),
            unknown => return Err(format!("found `{unknown}`")),
        }
    }
    Ok(found)
}

/// Whether every bound held.
fn run(arguments: &Arguments) -> Result<bool, Failure> {
    eprintln!("{} frames each of six played scenes ...", arguments.frames);
    let scenes = scenes::play(arguments.frames, arguments.seed)?;
    let chain = chain::measure(&scenes, arguments.instructions, |scene| {
        eprintln!("whole chain: {scene} ...");
    })?;

    // The detector's maps: the true forces of the scenes with contact, then the same with all 400 taxels in contact.
    let (mut newtons, mut begins) = (Vec::new(), Vec::new());
    for scene in scenes.iter().filter(|scene| scene.kind != scenes::Kind::Idle) {
        begins.push(newtons.len());
        newtons.extend(scene.frames.iter().map(|frame| frame.forces));
    }
    let mut dense = newtons.clone();
    for force in dense.iter_mut().flatten() {
        force[2] += 0.03;
    }
    let mut stages = Vec::new();
    for (name, newtons) in [
        ("maps of the scenes", newtons),
        ("all 400 taxels in contact", dense),
    ] {
        eprintln!("detector: {name} ...");
        let mut numpy = match &arguments.numpy {
            Some(folder) => Some(Numpy::start(folder, &newtons)?),
            None => None,
        };
        let maps = Maps::new(newtons, begins.clone())?;
        let rows = detectors::measure(&maps, arguments.rounds, &mut numpy)?;
        stages.push(report::Stage {
            name,
            maps: maps.len(),
            mean_active: maps.mean_active(),
            numpy: numpy.map(|numpy| numpy.version.clone()),
            rows,
        });
    }
    let report = Report {
        instructions: arguments.instructions,
        stages,
        chain,
    };
    if arguments.json {
        println!("{}", report.json());
    } else {
        print!("{}", report.text());
    }
    if let Some(path) = &arguments.plot {
        plot::draw(path, &report.detector_points(), &report.chain_points())?;
        eprintln!("plot: {}", path.display());
    }
    Ok(report.measures().iter().all(report::Measure::held))
}
