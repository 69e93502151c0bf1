//! Manual pages and shell completions, generated from the command line's description.

use std::io::Write as _;
use std::path::PathBuf;

use clap::{Args, Command};
use clap_complete::Shell;

use crate::error::Error;

/// Arguments of `gripline completions`.
#[derive(Debug, Clone, Args)]
pub struct CompletionsArgs {
    /// Which shell, for example `gripline completions bash > ~/.local/share/bash-completion/completions/gripline`.
    shell: Shell,
}

/// Arguments of `gripline man`.
#[derive(Debug, Clone, Args)]
pub struct ManArgs {
    /// Folder for gripline.1 and a page for every command; created when it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the completions of the program.
///
/// # Errors
/// [`Error`] when standard output cannot be written.
pub fn completions(args: &CompletionsArgs, program: &mut Command) -> Result<(), Error> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, program, "gripline", &mut script);
    std::io::stdout()
        .write_all(&script)
        .map_err(|error| Error::failed(format!("standard output: {error}")))
}

/// Writes the pages of the program.
///
/// # Errors
/// [`Error`] that names the folder.
pub fn man(args: &ManArgs, program: Command) -> Result<(), Error> {
    std::fs::create_dir_all(&args.out)
        .and_then(|()| clap_mangen::generate_to(program, &args.out))
        .map_err(|error| {
            let folder = args.out.display();
            Error::failed(format!(
                "{folder}: {error}, expected a folder that can be written"
            ))
        })
}
