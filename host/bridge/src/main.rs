//! `gripline`: parses the arguments, runs the command, turns its end into an exit code.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use gripline::cli::{Cli, Command};
use gripline::{detect, run};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let ended = match cli.command.unwrap_or_default() {
        Command::Run(args) => run::run(&args),
        Command::Detect(args) => detect::run(&args),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("gripline: {failure}");
            ExitCode::from(failure.kind.exit_code())
        }
    }
}
