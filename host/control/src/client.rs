//! The name of a client.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

/// The longest name.
const LENGTH_MAX: usize = 64;

/// A client's name: 1 to 64 of the letters a–z and A–Z, digits and `. _ : / @ -`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(transparent)]
pub struct Client(String);

/// A name that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("client: found {found}, expected 1 to {LENGTH_MAX} letters, digits or . _ : / @ -")]
pub struct BadClient {
    found: String,
}

impl Client {
    /// The name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0
    }
}

impl FromStr for Client {
    type Err = BadClient;

    fn from_str(text: &str) -> Result<Self, BadClient> {
        let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || b"._:/@-".contains(&byte);
        if (1..=LENGTH_MAX).contains(&text.len()) && text.bytes().all(is_letter) {
            return Ok(Self(text.to_owned()));
        }
        Err(BadClient {
            // What was sent may be long, and may move a terminal's cursor.
            found: format!("{:?}", text.chars().take(LENGTH_MAX).collect::<String>()),
        })
    }
}

impl fmt::Display for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
