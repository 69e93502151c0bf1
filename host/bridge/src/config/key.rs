//! The keys of the configuration as clap describes the fields of [`Settings`]: names, defaults, help, checks.
//!
//! A value of the file or the environment is read by the parser of its flag, so there is one check per key.

use std::any::TypeId;
use std::error::Error as _;
use std::sync::LazyLock;

use clap::{Arg, ArgAction, Args, Command, FromArgMatches, value_parser};
use toml::Value;

use super::settings::{MICROCONTROLLER, Settings};

/// Every key, in the file's order, as clap describes it.
static COMMAND: LazyLock<Command> =
    LazyLock::new(|| Settings::augment_args(Command::new("gripline").no_binary_name(true)));

pub(super) fn keys() -> impl Iterator<Item = Key> {
    COMMAND.get_arguments().map(Key)
}

/// Every section, in the file's order.
pub(super) fn sections() -> impl Iterator<Item = &'static str> {
    keys().map(Key::section).chain([MICROCONTROLLER])
}

/// A key of the configuration: a field of [`Settings`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Key(&'static Arg);

/// Type of a key's value in the file.
#[derive(PartialEq)]
enum Kind {
    Text,
    Number,
    Switch,
}

/// Types of fields that are numbers in the file.
const NUMBERS: [fn() -> TypeId; 5] = [
    TypeId::of::<f64>,
    TypeId::of::<i64>,
    TypeId::of::<u16>,
    TypeId::of::<u64>,
    TypeId::of::<usize>,
];

impl Key {
    /// Section and name, joined by a point.
    pub(super) fn name(self) -> &'static str {
        self.0.get_id().as_str()
    }

    pub(super) fn section(self) -> &'static str {
        self.name().split_once('.').map_or("", |(section, _)| section)
    }

    /// Its name within the section.
    pub(super) fn own_name(self) -> &'static str {
        self.name().split_once('.').map_or("", |(_, name)| name)
    }

    pub(super) fn flag(self) -> &'static str {
        self.0.get_long().unwrap_or_default()
    }

    pub(super) fn variable(self) -> String {
        variable(self.section(), self.own_name())
    }

    /// Its flag for the command line of a program: unchecked, because it is checked with the file and the environment.
    pub(super) fn unchecked_flag(self) -> Arg {
        match self.kind() {
            Kind::Switch => self.0.clone(),
            _ => self
                .0
                .clone()
                .value_parser(value_parser!(String))
                .allow_hyphen_values(true),
        }
    }

    /// Its help, and an example in TOML when it has no default.
    pub(super) fn help(self) -> (String, Option<String>) {
        let help = self.0.get_help().map(ToString::to_string).unwrap_or_default();
        match help.split_once(" Example: ") {
            Some((help, example)) => (help.to_owned(), Some(example.to_owned())),
            None => (help + ".", None),
        }
    }

    /// The default.
    pub(super) fn default(self) -> Option<Value> {
        let text = self.0.get_default_values().first().and_then(|text| text.to_str());
        match self.kind() {
            Kind::Switch => Some(Value::Boolean(false)),
            _ => text.map(|text| self.value_of(text)),
        }
    }

    pub(super) fn is_switch(self) -> bool {
        self.kind() == Kind::Switch
    }

    fn kind(self) -> Kind {
        let parsed = self.0.get_value_parser().type_id();
        if matches!(self.0.get_action(), ArgAction::SetTrue) {
            Kind::Switch
        } else if NUMBERS.iter().any(|number| parsed == number()) {
            Kind::Number
        } else {
            Kind::Text
        }
    }

    /// The value that a flag or a variable gives, which have text only; unchecked.
    pub(super) fn value_of(self, text: &str) -> Value {
        let value = match self.kind() {
            Kind::Text => None,
            Kind::Number => {
                let whole = text.parse().map(Value::Integer);
                whole.or_else(|_| text.parse().map(Value::Float)).ok()
            }
            Kind::Switch => text.parse().map(Value::Boolean).ok(),
        };
        value.unwrap_or_else(|| Value::String(text.to_owned()))
    }

    /// Checks a value from a flag or a variable.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub(super) fn check_text(self, text: &str) -> Result<(), String> {
        if self.kind() == Kind::Switch {
            return match text {
                "true" | "false" => Ok(()),
                _ => Err(format!("found {text}, expected true or false")),
            };
        }
        let parsed = COMMAND
            .clone()
            .try_get_matches_from([format!("--{}={text}", self.flag())]);
        parsed.map(drop).map_err(|error| match error.source() {
            Some(why) => why.to_string(),
            None => format!("found {text:?}, expected a value"),
        })
    }

    /// Checks a value from the file.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub(super) fn check(self, value: &Value) -> Result<(), String> {
        match (self.kind(), value) {
            (Kind::Text, Value::String(text)) => self.check_text(text),
            (Kind::Text, _) => Err(format!("found {value}, expected a text in quotes")),
            // A text in quotes is no number, and the error shows the quotes.
            _ => self.check_text(&value.to_string()),
        }
    }
}

/// The environment variable of a key.
pub(super) fn variable(section: &str, name: &str) -> String {
    format!("GRIPLINE_{section}_{name}").to_uppercase()
}

/// The settings from flags with checked values.
///
/// # Errors
/// clap's error, for unchecked values.
pub(super) fn parse(flags: impl Iterator<Item = String>) -> Result<Settings, clap::Error> {
    let matches = COMMAND.clone().try_get_matches_from(flags)?;
    Settings::from_arg_matches(&matches)
}
