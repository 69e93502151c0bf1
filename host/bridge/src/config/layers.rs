//! The values in force and where each comes from: a flag over the environment over the file over the default.
//! Everything is checked before anything starts, and every error is reported, not only the first.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

use super::device;
use super::key::{Key, keys, parse, sections, variable};
use super::overrides::Overrides;
use super::settings::{MICROCONTROLLER, Settings};
use crate::error::Error;
use crate::value::nearest;

/// The variable that names the file.
const FILE_VARIABLE: &str = "GRIPLINE_CONFIG";
/// Where a daemon's file lies.
const SYSTEM_FILE: &str = "/etc/gripline/gripline.toml";

/// A key with the value in force.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    /// Its full name.
    pub name: String,
    /// `None`: not set.
    pub value: Option<Value>,
    /// Where it comes from, for people.
    pub origin: String,
}

/// All values in force.
#[derive(Debug, Clone)]
pub(crate) struct Effective {
    /// The file that was read.
    pub file: Option<PathBuf>,
    /// In the order of [`keys`], then those of the microcontroller that are set.
    pub entries: Vec<Entry>,
}

impl Settings {
    /// Reads file, environment and flags.
    ///
    /// # Errors
    /// [`Error`] of kind usage that lists everything that is wrong.
    pub fn load(flags: &Overrides) -> Result<Self, Error> {
        Effective::load(flags)?.settings()
    }
}

impl Effective {
    /// Combines flags, this process's environment and the file.
    ///
    /// # Errors
    /// [`Error`] of kind usage that lists everything that is wrong.
    pub(crate) fn load(flags: &Overrides) -> Result<Self, Error> {
        let environment: Vec<(String, String)> = std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
            .collect();
        let file = find_file(flags.file.as_deref(), &environment);
        let text = file.as_deref().map(read).transpose()?;
        Self::join(flags, &environment, file.as_deref().zip(text.as_deref())).map_err(|errors| {
            Error::usage(match errors.as_slice() {
                [only] => only.clone(),
                all => format!(
                    "{} errors in the configuration\n  {}",
                    all.len(),
                    all.join("\n  ")
                ),
            })
        })
    }

    /// The same without the outside world. Errors are lines.
    fn join(
        flags: &Overrides,
        environment: &[(String, String)],
        file: Option<(&Path, &str)>,
    ) -> Result<Self, Vec<String>> {
        let default = |key: Key| Entry {
            name: key.name().to_owned(),
            value: key.default(),
            origin: "default".to_owned(),
        };
        let mut joined = Self {
            file: file.map(|(path, _)| path.to_owned()),
            entries: keys().map(default).collect(),
        };
        let mut errors = Vec::new();
        if let Some((path, text)) = file {
            let mut wrong = Vec::new();
            match text.parse::<Table>() {
                Ok(table) => joined.take_file(&table, &mut wrong),
                Err(error) => wrong.push(unreadable(text, &error)),
            }
            errors.extend(wrong.iter().map(|error| format!("{}: {error}", path.display())));
        }
        joined.take_environment(environment, &mut errors);
        for (key, text) in &flags.given {
            match key.check_text(text) {
                Ok(()) => joined.set(key.name(), key.value_of(text), format!("flag --{}", key.flag())),
                Err(error) => errors.push(format!("--{}: {error}", key.flag())),
            }
        }
        if errors.is_empty() {
            Ok(joined)
        } else {
            Err(errors)
        }
    }

    fn take_file(&mut self, table: &Table, errors: &mut Vec<String>) {
        for (section, value) in table {
            let values = match value {
                Value::Table(values) if sections().any(|known| known == section) => values,
                _ => {
                    errors.push(misplaced(section, value));
                    continue;
                }
            };
            if section == MICROCONTROLLER {
                let wrong = device::errors_in(values);
                errors.extend(wrong.iter().map(|error| format!("{section}.{error}")));
            }
            for (name, value) in values {
                let name = format!("{section}.{name}");
                let checked = match keys().find(|key| key.name() == name) {
                    Some(key) => key.check(value).map_err(|error| format!("{name}: {error}")),
                    None if section == MICROCONTROLLER => Ok(()),
                    None => Err(unknown(&name, keys().map(Key::name))),
                };
                match checked {
                    Ok(()) => self.set(&name, value.clone(), "file".to_owned()),
                    Err(error) => errors.push(error),
                }
            }
        }
    }

    fn take_environment(&mut self, environment: &[(String, String)], errors: &mut Vec<String>) {
        let settings = || device::plain_names().map(|name| (name, variable(MICROCONTROLLER, name)));
        for (name, text) in environment {
            let origin = format!("environment, {name}");
            let taken = if let Some(key) = keys().find(|key| key.variable() == *name) {
                key.check_text(text)
                    .map(|()| self.set(key.name(), key.value_of(text), origin))
            } else if let Some((setting, _)) = settings().find(|(_, variable)| variable == name) {
                device::value_of(setting, text)
                    .map(|value| self.set(&format!("{MICROCONTROLLER}.{setting}"), value, origin))
            } else {
                if sections().any(|section| name.starts_with(&variable(section, ""))) {
                    let known: Vec<_> = keys()
                        .map(Key::variable)
                        .chain(settings().map(|(_, variable)| variable))
                        .collect();
                    let unknown = unknown(name, known.iter().map(String::as_str));
                    errors.push(format!("environment: {unknown}"));
                }
                Ok(())
            };
            errors.extend(taken.err().map(|error| format!("{name}: {error}")));
        }
    }

    fn set(&mut self, name: &str, value: Value, origin: String) {
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

    /// The values as the rest of the program sees them.
    ///
    /// # Errors
    /// [`Error`] when valid values contradict each other, or a calibration cannot be read.
    pub(crate) fn settings(&self) -> Result<Settings, Error> {
        let flags = keys().zip(&self.entries).filter_map(|(key, entry)| {
            Some(match entry.value.as_ref()? {
                Value::Boolean(is_on) => return is_on.then(|| format!("--{}", key.flag())),
                Value::String(text) => format!("--{}={text}", key.flag()),
                value => format!("--{}={value}", key.flag()),
            })
        });
        parse(flags)
            .map_err(Error::usage)?
            .complete(self.microcontroller())
    }

    /// The configured microcontroller's settings.
    fn microcontroller(&self) -> Table {
        let setting = |entry: &Entry| {
            let (section, name) = entry.name.split_once('.')?;
            (section == MICROCONTROLLER).then_some((name.to_owned(), entry.value.clone()?))
        };
        self.entries.iter().filter_map(setting).collect()
    }
}

/// What is wrong with a name outside every section, or with a section that does not exist.
fn misplaced(name: &str, value: &Value) -> String {
    if sections().any(|known| known == name) {
        return format!("{name}: found {value}, expected a section, [{name}]");
    }
    match keys().find(|key| key.own_name() == name) {
        Some(key) => format!(
            "{name}: no such key here, expected it in section [{}]",
            key.section()
        ),
        None => unknown(name, sections()),
    }
}

fn unknown<'a>(found: &str, names: impl Iterator<Item = &'a str>) -> String {
    match nearest(found, names) {
        Some(meant) => format!("{found}: no such key, did you mean {meant}?"),
        None => format!("{found}: no such key; `gripline config default` prints all there are"),
    }
}

/// A file that is not TOML: what is wrong and in which line.
fn unreadable(text: &str, error: &toml::de::Error) -> String {
    let line = error
        .span()
        .map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
    let place = line.map_or(String::new(), |line| format!("line {line}: "));
    format!("{place}{}, expected TOML", error.message().replace('\n', ", "))
}

/// The requested file, or the first that exists.
fn find_file(asked: Option<&Path>, environment: &[(String, String)]) -> Option<PathBuf> {
    let variable = |name: &str| {
        let value = environment.iter().find(|(known, _)| known == name);
        value
            .map(|(_, value)| Path::new(value))
            .filter(|value| !value.as_os_str().is_empty())
    };
    if let Some(path) = asked.or(variable(FILE_VARIABLE)) {
        return Some(path.to_owned());
    }
    let users = variable("XDG_CONFIG_HOME")
        .map(Path::to_owned)
        .or_else(|| variable("HOME").map(|home| home.join(".config")))
        .map(|folder| folder.join("gripline/gripline.toml"));
    users
        .into_iter()
        .chain([PathBuf::from(SYSTEM_FILE)])
        .find(|path| path.is_file())
}

fn read(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path).map_err(|error| {
        Error::usage(format!(
            "{}: {error}, expected a configuration file; `gripline config default` prints one",
            path.display()
        ))
    })
}

#[cfg(test)]
mod tests;
