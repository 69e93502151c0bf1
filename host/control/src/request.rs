//! The requests, and how they are read from JSON:
//! `{"client": "cell-3", "request": 7, "action": "set_floor", "floor_n": 4.0, "take_over": false}`.

use std::fmt;

use serde::Serialize;
use serde_json::{Map, Value};

use crate::client::{BadClient, Client};

/// The requested action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Close the gripper and hold.
    Hold,
    /// Open the gripper.
    Release,
    /// A person has looked at the latched faults.
    Acknowledge,
    /// Take new rest pictures; only while the gripper is released and nothing touches.
    Rezero,
    /// The minimum force while holding, newtons.
    SetFloor {
        /// Newtons.
        newtons: f64,
    },
    /// Take the ownership of the gripper from any other client.
    TakeOver,
    /// Give up ownership. The gripper stays as it is.
    Yield,
}

impl Action {
    /// Names of the actions, as they are written.
    pub const NAMES: [&str; 7] = [
        "hold",
        "release",
        "acknowledge",
        "rezero",
        "set_floor",
        "take_over",
        "yield",
    ];

    /// Its name, as it is written.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::NAMES[match self {
            Self::Hold => 0,
            Self::Release => 1,
            Self::Acknowledge => 2,
            Self::Rezero => 3,
            Self::SetFloor { .. } => 4,
            Self::TakeOver => 5,
            Self::Yield => 6,
        }]
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SetFloor { newtons } => write!(f, "set_floor {newtons} N"),
            other => f.write_str(other.name()),
        }
    }
}

impl Serialize for Action {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// A request of a client.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The client.
    pub client: Client,
    /// The client's own number of the request, never used twice (begin with a clock's). A repeated number within ten seconds is
    /// answered again but not executed again.
    pub number: u64,
    /// The action.
    pub action: Action,
    /// Take the gripper over from another client.
    pub take_over: bool,
}

/// A request that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadRequest {
    /// Not JSON.
    #[error(
        "request: found no JSON ({0}), expected an object such as {{\"client\":\"cell-3\",\"request\":1,\"action\":\"hold\"}}"
    )]
    NotJson(String),
    /// JSON, but no object.
    #[error(
        "request: found {0}, expected an object such as {{\"client\":\"cell-3\",\"request\":1,\"action\":\"hold\"}}"
    )]
    NotAnObject(&'static str),
    /// A key is missing, or is something else.
    #[error("{key}: found {found}, expected {expected}")]
    Key {
        /// The key.
        key: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// Not a name.
    #[error(transparent)]
    Client(#[from] BadClient),
}

const KEYS: [&str; 5] = ["client", "request", "action", "floor_n", "take_over"];

impl Request {
    /// Reads one from JSON.
    ///
    /// # Errors
    /// [`BadRequest`], which names the key.
    pub fn from_json(text: &[u8]) -> Result<Self, BadRequest> {
        let value = serde_json::from_slice(text).map_err(|error| BadRequest::NotJson(error.to_string()))?;
        let Value::Object(keys) = value else {
            return Err(BadRequest::NotAnObject(kind(&value)));
        };
        if let Some(other) = keys.keys().find(|key| !KEYS.contains(&key.as_str())) {
            return Err(BadRequest::Key {
                key: shortened(other),
                found: "a key that does not exist".to_owned(),
                expected: format!("one of {}", KEYS.join(", ")),
            });
        }
        let client = text_of(&keys, "client", "the name of who asks")?.parse()?;
        let number = match keys.get("request") {
            Some(value) if value.as_u64().is_some() => value.as_u64().unwrap_or_default(),
            other => {
                return Err(wrong(
                    "request",
                    other,
                    "the request's number, a whole number from 0",
                ));
            }
        };
        let take_over = match keys.get("take_over") {
            None => false,
            Some(Value::Bool(take_over)) => *take_over,
            other => return Err(wrong("take_over", other, "true or false")),
        };
        let name = text_of(&keys, "action", "one of the actions")?;
        let action = match (name, keys.get("floor_n")) {
            ("set_floor", Some(value)) if value.as_f64().is_some_and(f64::is_finite) => Action::SetFloor {
                newtons: value.as_f64().unwrap_or_default(),
            },
            ("set_floor", other) => return Err(wrong("floor_n", other, "newtons")),
            (_, Some(_)) => {
                return Err(BadRequest::Key {
                    key: "floor_n".to_owned(),
                    found: format!("it beside action {}", shortened(name)),
                    expected: "it with set_floor only".to_owned(),
                });
            }
            ("hold", None) => Action::Hold,
            ("release", None) => Action::Release,
            ("acknowledge", None) => Action::Acknowledge,
            ("rezero", None) => Action::Rezero,
            ("take_over", None) => Action::TakeOver,
            ("yield", None) => Action::Yield,
            (other, None) => {
                return Err(BadRequest::Key {
                    key: "action".to_owned(),
                    found: shortened(other),
                    expected: format!("one of {}", Action::NAMES.join(", ")),
                });
            }
        };
        Ok(Self {
            client,
            number,
            action,
            take_over,
        })
    }
}

fn text_of<'a>(keys: &'a Map<String, Value>, key: &str, expected: &str) -> Result<&'a str, BadRequest> {
    match keys.get(key) {
        Some(Value::String(text)) => Ok(text),
        other => Err(wrong(key, other, &format!("{expected}, a string"))),
    }
}

fn wrong(key: &str, found: Option<&Value>, expected: &str) -> BadRequest {
    BadRequest::Key {
        key: key.to_owned(),
        found: found.map_or_else(|| "nothing".to_owned(), |value| shortened(&value.to_string())),
        expected: expected.to_owned(),
    }
}

/// Received text may be long, and may contain control characters.
fn shortened(text: &str) -> String {
    let text: String = text.chars().take(64).collect();
    text.escape_default().to_string()
}

const fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}
