//! `gripline config`: shows what is in force, prints the default file, reads and sets the microcontroller's own settings.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use gripline_protocol::message::Configuration;
use toml::Table;

use crate::commands::device::DeviceArgs;
use crate::config::{
    Effective, Overrides, default_file, settings_from_text, settings_text, shown, shown_json,
};
use crate::error::Error;

/// Arguments of `gripline config`.
#[derive(Debug, Clone, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// Print the values in force and where each comes from: default, file, environment or flag.
    Show(ShowArgs),
    /// Print a configuration file with every key explained and commented out.
    Default,
    /// The microcontroller's settings: print them as TOML, or set them from a file and store them in its flash.
    Mcu(McuArgs),
}

#[derive(Debug, Clone, Args)]
struct ShowArgs {
    #[command(flatten)]
    overrides: Overrides,
    /// Print JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Args)]
struct McuArgs {
    #[command(flatten)]
    device: DeviceArgs,
    /// Apply the settings of this TOML file; the gripper must be released, because storing stops the microcontroller.
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Do not store the settings in flash: the next reset undoes them.
    #[arg(long, requires = "write")]
    volatile: bool,
    /// Print JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// [`Error`] when a file or a value is invalid, a link fails, or the microcontroller refuses.
pub fn run(args: &ConfigArgs) -> Result<(), Error> {
    match &args.action {
        Action::Show(args) => {
            let effective = Effective::load(&args.overrides)?;
            // Values that are right one by one may still be wrong together.
            effective.settings()?;
            if args.json {
                println!("{}", shown_json(&effective));
            } else {
                print!("{}", shown(&effective));
            }
        }
        Action::Default => print!("{}", default_file()),
        Action::Mcu(args) => mcu_settings(args)?,
    }
    Ok(())
}

/// Reads, or sets and stores, and prints what is then in force.
fn mcu_settings(args: &McuArgs) -> Result<(), Error> {
    let mut session = args.device.connect()?;
    if let Some(path) = &args.write {
        let settings = read(path, session.settings())?;
        session.configure(settings)?;
        if !args.volatile {
            let writes = session.store()?;
            tracing::info!(
                "stored ({writes} times by now); the kind and the points of the line take effect at the next start"
            );
        }
    }
    let text = settings_text(session.settings());
    if args.json {
        let table: Table = text.parse()?;
        println!("{}", serde_json::to_string(&table)?);
    } else {
        print!("{text}");
    }
    Ok(())
}

/// The settings that `path` makes of `now`, checked.
fn read(path: &Path, now: &Configuration) -> Result<Configuration, Error> {
    let named = |what: String| Error::failed(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path)
        .map_err(|error| named(format!("{error}, expected a TOML file that can be read")))?;
    settings_from_text(&text, now).map_err(named)
}
