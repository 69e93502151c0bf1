//! `gripline`: parses the arguments, runs the command, turns its end into an exit code.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use gripline::commands::cli::{Cli, Command};
use gripline::commands::{calibrate, detect, doctor, evaluate, faults, infer, plot, replay, shell, simulate};
use gripline::error::Kind;
use gripline::{config, log, run};

fn main() -> ExitCode {
    let cli = match Cli::from_arguments(std::env::args_os()) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            eprintln!("gripline: {}", one_line(&error.to_string()));
            return ExitCode::from(Kind::Usage.exit_code());
        }
        // `--help` and `--version` come this way too.
        Err(text) => text.exit(),
    };
    if let Err(failure) = log::start(cli.log_level()) {
        eprintln!("gripline: {failure}");
        return ExitCode::from(failure.kind.exit_code());
    }
    let ended = match cli.command {
        Command::Run(args) => run::run(&args),
        Command::Infer(args) => infer::run(&args),
        Command::Detect(args) => detect::run(&args),
        Command::Config(args) => config::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Export(args) => gripline_recording::export(&args),
        Command::Plot(args) => plot::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Faults(args) => faults::run(&args),
        Command::Completions(args) => shell::completions(&args),
        Command::Man(args) => shell::man(&args),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            tracing::error!("{failure}");
            ExitCode::from(failure.kind.exit_code())
        }
    }
}

/// The parser's message without its heading, usage and hints: what was found and what was expected.
fn one_line(message: &str) -> String {
    let told = message
        .lines()
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let told: Vec<_> = told.map(str::trim).filter(|line| !line.is_empty()).collect();
    told.join(" ").trim_start_matches("error: ").to_owned()
}
