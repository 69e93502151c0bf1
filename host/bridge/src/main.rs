//! `gripline`: parses the arguments, runs the command, turns its result into an exit code.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::CommandFactory as _;
use gripline::commands::cli::{Cli, Command};
use gripline::commands::{
    calibrate, config, detect, doctor, evaluate, export, faults, flash, infer, plot, replay, sensor, setup,
    shell, simulate,
};
use gripline::error::{Completion, Error};
use gripline::{log, run};

fn main() -> ExitCode {
    let cli = match Cli::from_arguments(std::env::args_os()) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            eprintln!("gripline: {}", one_line(&error.to_string()));
            return ExitCode::from(Error::USAGE);
        }
        // `--help` and `--version` come this way too.
        Err(text) => text.exit(),
    };
    if let Err(failure) = log::start(cli.log_level()) {
        eprintln!("gripline: {failure}");
        return ExitCode::from(failure.exit_code());
    }
    match run_command(cli.command) {
        Ok(completion) => {
            if let Completion::WithLoss(losses) = &completion {
                tracing::error!("{losses}");
            }
            ExitCode::from(completion.exit_code())
        }
        Err(failure) => {
            tracing::error!("{failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run_command(command: Command) -> Result<Completion, Error> {
    match command {
        Command::Run(args) => return run::run(&args),
        Command::Infer(args) => return infer::run(&args),
        Command::Evaluate(args) => return evaluate::run(&args),
        Command::Simulate(args) => return simulate::run(&args),
        Command::Replay(args) => return replay::run(&args),
        Command::Export(args) => return export::run(&args),
        Command::Plot(args) => return plot::run(&args),
        Command::Setup(args) => return setup::run(&args),
        Command::Doctor(args) => return doctor::run(&args),
        Command::Detect(args) => detect::run(&args)?,
        Command::Config(args) => config::run(&args)?,
        Command::Calibrate(args) => calibrate::run(&args)?,
        Command::Faults(args) => faults::run(&args)?,
        Command::Flash(args) => flash::run(&args)?,
        Command::Sensor(args) => sensor::run(&args)?,
        Command::Completions(args) => shell::completions(&args, &mut Cli::command())?,
        Command::Man(args) => shell::man(&args, Cli::command())?,
    }
    Ok(Completion::Whole)
}

/// The parser's message without its heading, usage and hints: what was found and what was expected.
fn one_line(message: &str) -> String {
    let lines = message
        .lines()
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let lines: Vec<_> = lines.map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join(" ").trim_start_matches("error: ").to_owned()
}
