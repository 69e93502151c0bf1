//! The values in force and where each comes from: a flag over the environment over the file over the default.
//! Everything is checked before anything starts, and every error is told, not only the first.

use std::fmt;
use std::path::{Path, PathBuf};

use toml::{Table, Value};

use super::keys::{KEYS, Key, MICROCONTROLLER, likely, variable};
use super::mcu;
use super::overrides::Overrides;
use crate::error::Failure;

/// The variable that names the file.
const FILE_VARIABLE: &str = "GRIPLINE_CONFIG";
/// Where a daemon's file lies.
const SYSTEM_FILE: &str = "/etc/gripline/gripline.toml";

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Origin {
    /// Nobody said anything.
    Default,
    /// The configuration file.
    File,
    /// This environment variable.
    Variable(String),
    /// This flag.
    Flag(&'static str),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::File => f.write_str("file"),
            Self::Variable(name) => write!(f, "environment, {name}"),
            Self::Flag(flag) => write!(f, "flag --{flag}"),
        }
    }
}

/// A key with the value in force.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    /// Its full name.
    pub name: String,
    /// `None`: not set.
    pub value: Option<Value>,
    /// Where it comes from.
    pub origin: Origin,
}

/// All values in force.
#[derive(Debug, Clone)]
pub(crate) struct Effective {
    /// The file that was read.
    pub file: Option<PathBuf>,
    /// In the order of [`KEYS`], then those of the microcontroller that are set.
    pub entries: Vec<Entry>,
}

impl Effective {
    /// Joins flags, this process's environment and the file.
    ///
    /// # Errors
    /// [`Failure`] of kind usage that lists everything that is wrong.
    pub(crate) fn load(flags: &Overrides) -> Result<Self, Failure> {
        let environment: Vec<(String, String)> = std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
            .collect();
        let file = find_file(flags.file(), &environment);
        let text = file.as_deref().map(read).transpose()?;
        Self::join(flags, &environment, file.as_deref().zip(text.as_deref())).map_err(|errors| {
            let mut lines = errors.into_iter();
            match (lines.next(), lines.len()) {
                (Some(only), 0) => Failure::usage(only),
                (first, more) => {
                    let all: Vec<_> = first.into_iter().chain(lines).collect();
                    Failure::usage(format!(
                        "{} errors in the configuration\n  {}",
                        more + 1,
                        all.join("\n  ")
                    ))
                }
            }
        })
    }

    /// The same without the outside world. Errors are lines.
    fn join(
        flags: &Overrides,
        environment: &[(String, String)],
        file: Option<(&Path, &str)>,
    ) -> Result<Self, Vec<String>> {
        let mut joined = Self {
            file: file.map(|(path, _)| path.to_owned()),
            entries: KEYS.iter().map(default_of).collect(),
        };
        let mut errors = Vec::new();
        if let Some((path, text)) = file {
            let mut wrong = Vec::new();
            match text.parse::<Table>() {
                Ok(table) => joined.take_file(&table, &mut wrong),
                Err(error) => wrong.push(unreadable(text, &error)),
            }
            errors.extend(
                wrong
                    .into_iter()
                    .map(|error| format!("{}: {error}", path.display())),
            );
        }
        joined.take_environment(environment, &mut errors);
        for (key, text) in flags.given() {
            match key.value_of(text) {
                Ok(value) => joined.set(key.name, value, Origin::Flag(key.flag)),
                Err(error) => errors.push(format!("--{}: {error}", key.flag)),
            }
        }
        if errors.is_empty() {
            Ok(joined)
        } else {
            Err(errors)
        }
    }

    fn take_file(&mut self, table: &Table, errors: &mut Vec<String>) {
        let sections = || KEYS.iter().map(Key::section).chain([MICROCONTROLLER]);
        for (section, value) in table {
            match value {
                Value::Table(values) if section == MICROCONTROLLER => {
                    errors.extend(
                        mcu::errors_in(values)
                            .into_iter()
                            .map(|error| format!("{section}.{error}")),
                    );
                    for (name, value) in values {
                        self.set(&format!("{section}.{name}"), value.clone(), Origin::File);
                    }
                }
                Value::Table(values) if sections().any(|known| known == section) => {
                    for (name, value) in values {
                        let name = format!("{section}.{name}");
                        match Key::named(&name).map(|key| key.check(value)) {
                            Some(Ok(())) => self.set(&name, value.clone(), Origin::File),
                            Some(Err(error)) => errors.push(format!("{name}: {error}")),
                            None => errors.push(unknown(&name, KEYS.iter().map(|key| key.name))),
                        }
                    }
                }
                _ if sections().any(|known| known == section) => {
                    errors.push(format!(
                        "{section}: found {value}, expected a section, [{section}]"
                    ));
                }
                // A key that stands before the first section, or a section that there is not.
                _ => {
                    let inside = KEYS.iter().find(|key| key.own_name() == section);
                    errors.push(match inside {
                        Some(key) => format!(
                            "{section}: no such key here, expected it in section [{}]",
                            key.section()
                        ),
                        None => unknown(section, sections()),
                    });
                }
            }
        }
    }

    fn take_environment(&mut self, environment: &[(String, String)], errors: &mut Vec<String>) {
        for (name, text) in environment {
            let set = if let Some(key) = KEYS.iter().find(|key| key.variable() == *name) {
                key.value_of(text).map(|value| (key.name.to_owned(), value))
            } else if let Some(setting) =
                mcu::plain_names().find(|setting| variable(MICROCONTROLLER, setting) == *name)
            {
                mcu::value_of(setting, text).map(|value| (format!("{MICROCONTROLLER}.{setting}"), value))
            } else if sections_variables().any(|start| name.starts_with(&start)) {
                let known: Vec<_> = KEYS
                    .iter()
                    .map(Key::variable)
                    .chain(mcu::plain_names().map(|setting| variable(MICROCONTROLLER, setting)))
                    .collect();
                errors.push(format!(
                    "environment: {}",
                    unknown(name, known.iter().map(String::as_str))
                ));
                continue;
            } else {
                continue;
            };
            match set {
                Ok((key, value)) => self.set(&key, value, Origin::Variable(name.clone())),
                Err(error) => errors.push(format!("{name}: {error}")),
            }
        }
    }

    fn set(&mut self, name: &str, value: Value, origin: Origin) {
        let entry = Entry {
            name: name.to_owned(),
            value: Some(value),
            origin,
        };
        match self.entries.iter_mut().find(|entry| entry.name == name) {
            Some(place) => *place = entry,
            None => self.entries.push(entry),
        }
    }

    /// The value of a key, when it is set.
    pub(crate) fn value(&self, name: &str) -> Option<&Value> {
        self.entries
            .iter()
            .find(|entry| entry.name == name)?
            .value
            .as_ref()
    }

    /// What is said of the microcontroller's settings.
    pub(crate) fn microcontroller(&self) -> Table {
        let of_it = |entry: &Entry| {
            let (section, name) = entry.name.split_once('.')?;
            let value = entry.value.clone()?;
            (section == MICROCONTROLLER).then(|| (name.to_owned(), value))
        };
        self.entries.iter().filter_map(of_it).collect()
    }
}

fn default_of(key: &Key) -> Entry {
    let value = key.default.and_then(|text| {
        let table: Table = format!("value = {text}").parse().ok()?;
        table.get("value").cloned()
    });
    Entry {
        name: key.name.to_owned(),
        value,
        origin: Origin::Default,
    }
}

/// How the variables of each section begin.
fn sections_variables() -> impl Iterator<Item = String> {
    KEYS.iter()
        .map(Key::section)
        .chain([MICROCONTROLLER])
        .map(|section| variable(section, ""))
}

fn unknown<'a>(found: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    match likely(found, names) {
        Some(meant) => format!("{found}: no such key, did you mean {meant}?"),
        None => format!("{found}: no such key; `gripline config default` prints all there are"),
    }
}

/// A file that is no TOML: what is wrong and in which line.
fn unreadable(text: &str, error: &toml::de::Error) -> String {
    let line = error
        .span()
        .map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
    let place = line.map_or(String::new(), |line| format!("line {line}: "));
    format!("{place}{}, expected TOML", error.message().replace('\n', ", "))
}

/// The file that was asked for, or the first that is there.
fn find_file(asked: Option<&Path>, environment: &[(String, String)]) -> Option<PathBuf> {
    let variable = |name: &str| {
        let value = environment.iter().find(|(known, _)| known == name);
        value
            .map(|(_, value)| value.as_str())
            .filter(|value| !value.is_empty())
    };
    if let Some(path) = asked.or(variable(FILE_VARIABLE).map(Path::new)) {
        return Some(path.to_owned());
    }
    let own = variable("XDG_CONFIG_HOME")
        .map(PathBuf::from)
        .or_else(|| variable("HOME").map(|home| Path::new(home).join(".config")))
        .map(|folder| folder.join("gripline/gripline.toml"));
    own.into_iter()
        .chain([PathBuf::from(SYSTEM_FILE)])
        .find(|path| path.is_file())
}

fn read(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| {
        Failure::usage(format!(
            "{}: {error}, expected a configuration file; `gripline config default` prints one",
            path.display()
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(
        flags: &[(&str, &str)],
        environment: &[(&str, &str)],
        file: &str,
    ) -> Result<Effective, Vec<String>> {
        let own = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        let environment: Vec<_> = environment.iter().map(own).collect();
        Effective::join(
            &Overrides::of(flags),
            &environment,
            Some((Path::new("g.toml"), file)),
        )
    }

    fn origin(effective: &Effective, name: &str) -> String {
        let entry = effective.entries.iter().find(|entry| entry.name == name).unwrap();
        entry.origin.to_string()
    }

    #[test]
    fn a_flag_wins_over_the_environment_over_the_file_over_the_default() {
        let file = "[simulation]\nseed = 2\n[network]\ngate = \"off\"\n[run]\nunpaced = true\n";
        let variables = [
            ("GRIPLINE_SIMULATION_SEED", "3"),
            ("GRIPLINE_NETWORK_GATE", "difference"),
        ];
        let effective = joined(&[("simulation.seed", "4")], &variables, file).unwrap();
        let value = |name| effective.value(name).unwrap().to_string();
        assert_eq!(
            ["simulation.seed", "network.gate", "run.unpaced", "link.mcu"]
                .map(|name| (value(name), origin(&effective, name))),
            [
                ("4", "flag --seed"),
                ("\"difference\"", "environment, GRIPLINE_NETWORK_GATE"),
                ("true", "file"),
                ("\"embedded\"", "default"),
            ]
            .map(|(value, origin)| (value.to_owned(), origin.to_owned()))
        );
        assert_eq!(effective.value("network.weights"), None);
    }

    #[test]
    fn every_error_is_told_with_key_found_and_expected() {
        let file = "gate = \"off\"\n[camera]\nsorce = \"sim\"\nsource = \"webcam\"\n[run]\nseconds = \"long\"\nunpaced = 1\n\
                    [network]\nweights = 7\n[simulation]\nseed = -1\n[recrod]\nfile = \"x\"\n\
                    [microcontroller]\nfrictoin = 0.4\nmargin = \"wide\"\n";
        let variables = [
            ("GRIPLINE_LINK_MCU", "can0"),
            ("GRIPLINE_LINK_MUC", "usb"),
            ("GRIPLINE_IMAGE", "of others"),
        ];
        let errors = joined(&[("network.gate", "maybe")], &variables, file).unwrap_err();
        let expected = [
            "g.toml: gate: no such key here, expected it in section [network]",
            "g.toml: camera.sorce: no such key, did you mean camera.source?",
            "g.toml: camera.source: found webcam, expected sim, /dev/videoN (or v4l2:DEVICE), dir:FOLDER, file:CLIP or mcap:RECORDING",
            "g.toml: run.seconds: found \"long\", expected a number from 0.1 to 1000000000",
            "g.toml: run.unpaced: found 1, expected true or false",
            "g.toml: network.weights: found 7, expected the path of a file",
            "g.toml: simulation.seed: found -1, expected a whole number from 0 to 9223372036854775807",
            "g.toml: recrod: no such key, did you mean record?",
            "g.toml: microcontroller.frictoin: no such setting, did you mean friction?",
            "g.toml: microcontroller.margin: found \"wide\", expected a number",
            "GRIPLINE_LINK_MCU: found can0, expected embedded, emulator, emulator:uart, usb, usb:SERIAL or serial:PORT",
            "environment: GRIPLINE_LINK_MUC: no such key, did you mean GRIPLINE_LINK_MCU?",
            "--gate: found maybe, expected network, difference or off",
        ];
        for line in expected {
            assert!(
                errors.iter().any(|error| error == line),
                "{line} is missing in {errors:#?}"
            );
        }
        assert_eq!(errors.len(), expected.len(), "{errors:#?}");
    }

    #[test]
    fn a_file_that_is_no_toml_is_refused_with_its_line() {
        let errors = joined(&[], &[], "[camera]\nsource = sim\n").unwrap_err();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].starts_with("g.toml: line 2: "), "{errors:?}");
        let errors = joined(&[], &[], "[run]\nunpaced = true\nunpaced = false\n").unwrap_err();
        assert!(errors[0].contains("line 3: duplicate key"), "{errors:?}");
    }

    #[test]
    fn settings_of_the_microcontroller_come_from_file_and_environment() {
        let file = "[microcontroller]\nmargin = 0.3\nfriction = 0.4\nline.kind = \"analog\"\n";
        let effective = joined(&[], &[("GRIPLINE_MICROCONTROLLER_FRICTION", "0.5")], file).unwrap();
        let table = effective.microcontroller();
        assert_eq!(table["friction"], Value::Float(0.5));
        assert_eq!(table["margin"], Value::Float(0.3));
        assert_eq!(table["line"]["kind"].as_str(), Some("analog"));
        assert_eq!(table.len(), 3);
    }

    #[test]
    fn the_file_is_the_one_asked_for_or_the_variables_or_the_users() {
        let folder = tempfile::tempdir().unwrap();
        let users = folder.path().join("gripline/gripline.toml");
        std::fs::create_dir(users.parent().unwrap()).unwrap();
        std::fs::write(&users, "").unwrap();
        let home = ("XDG_CONFIG_HOME".to_owned(), folder.path().display().to_string());
        let named = (FILE_VARIABLE.to_owned(), "named.toml".to_owned());
        let found = |asked: Option<&str>, environment: &[(String, String)]| {
            find_file(asked.map(Path::new), environment)
        };
        let both = [home.clone(), named];
        assert_eq!(found(Some("asked.toml"), &both), Some("asked.toml".into()));
        assert_eq!(found(None, &both), Some("named.toml".into()));
        assert_eq!(found(None, &[home]), Some(users));
    }
}
