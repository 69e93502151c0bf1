//! The flags that stand over the configuration file: one for every key, made from the table of keys.

use std::path::{Path, PathBuf};

use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::keys::{KEYS, Key, Kind};

const FILE: &str = "config";

/// What was given on the command line.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    file: Option<PathBuf>,
    given: Vec<(&'static Key, String)>,
}

impl Overrides {
    /// No flags but this file.
    pub(crate) fn of_file(file: Option<&Path>) -> Self {
        Self {
            file: file.map(Path::to_owned),
            given: Vec::new(),
        }
    }

    /// The file that was asked for.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Keys and texts, unchecked.
    pub(crate) fn given(&self) -> impl Iterator<Item = (&'static Key, &str)> {
        self.given.iter().map(|(key, text)| (*key, text.as_str()))
    }

    #[cfg(test)]
    pub(crate) fn of(given: &[(&str, &str)]) -> Self {
        let key = |name: &str| Key::named(name).unwrap();
        Self {
            file: None,
            given: given
                .iter()
                .map(|(name, text)| (key(name), (*text).to_owned()))
                .collect(),
        }
    }
}

impl Args for Overrides {
    fn augment_args(command: Command) -> Command {
        let file = Arg::new(FILE)
            .long(FILE)
            .value_name("FILE")
            .value_parser(clap::value_parser!(PathBuf))
            .help("Configuration file. By default the one that GRIPLINE_CONFIG names, else gripline/gripline.toml in the \
                   user's configuration folder, else /etc/gripline/gripline.toml, if it is there");
        KEYS.iter().fold(command.arg(file), |command, key| {
            let mut arg = Arg::new(key.name).long(key.flag).help(help_of(key));
            if key.name == "camera.source" {
                arg = arg.visible_alias("camera");
            }
            command.arg(if matches!(key.kind, Kind::Switch) {
                arg.action(ArgAction::SetTrue)
            } else {
                arg.value_name(key.value_name).allow_hyphen_values(true)
            })
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Overrides {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = |key: &'static Key| {
            let text = if matches!(key.kind, Kind::Switch) {
                matches.get_flag(key.name).then(|| "true".to_owned())
            } else {
                matches.get_one::<String>(key.name).cloned()
            };
            text.map(|text| (key, text))
        };
        Ok(Self {
            file: matches.get_one(FILE).cloned(),
            given: KEYS.iter().filter_map(given).collect(),
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// One sentence more than the file has: where else it can be set.
fn help_of(key: &Key) -> String {
    let help = key.help.trim_end_matches('.');
    match key.default {
        Some(default) if !matches!(key.kind, Kind::Switch) => {
            format!("{help} [default: {}]", default.trim_matches('"'))
        }
        _ => help.to_owned(),
    }
}
