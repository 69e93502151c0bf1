//! The configuration's flags: one per key, and `--config`.

use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, value_parser};

use super::key::{Key, keys};

const FILE_FLAG: &str = "config";

/// What was given on the command line: unchecked, because it is checked with the file and the environment.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    pub(super) file: Option<PathBuf>,
    pub(super) given: Vec<(Key, String)>,
}

impl Overrides {
    /// No flags but this file.
    pub(crate) fn of_file(file: Option<&Path>) -> Self {
        Self {
            file: file.map(Path::to_owned),
            given: Vec::new(),
        }
    }
}

impl Args for Overrides {
    fn augment_args(command: Command) -> Command {
        let file = Arg::new(FILE_FLAG)
            .long(FILE_FLAG)
            .value_name("FILE")
            .value_parser(value_parser!(PathBuf))
            .help(
                "Configuration file. By default the one that GRIPLINE_CONFIG names, else gripline/gripline.toml in the user's \
                 configuration folder, else /etc/gripline/gripline.toml, if it exists",
            );
        command.arg(file).args(keys().map(Key::unchecked_flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Overrides {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = |key: Key| {
            if matches.value_source(key.name()) != Some(ValueSource::CommandLine) {
                return None;
            }
            let text = if key.is_switch() {
                "true"
            } else {
                matches.get_one::<String>(key.name())?.as_str()
            };
            Some((key, text.to_owned()))
        };
        Ok(Self {
            file: matches.get_one(FILE_FLAG).cloned(),
            given: keys().filter_map(given).collect(),
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
