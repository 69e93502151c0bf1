//! Names in ROS 2: a namespace, its topics and its frames. Pure.

use gripline_protocol::SensorId;
use std::fmt;
use std::str::FromStr;

/// The longest namespace: topics and the prefixes of DDS fit in 256 letters.
const LENGTH_MAX: usize = 200;

/// A namespace: parts of letters, digits and single underscores that do not begin with a digit, joined by slashes, such as
/// `cell_3/left`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Namespace(String);

/// An invalid name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "found {0}, expected a ROS name such as cell_3/left: parts of letters, digits and single underscores that do not begin with a \
     digit, joined by /"
)]
pub struct BadName(String);

impl Namespace {
    /// The absolute name of a topic or service in it.
    #[must_use]
    pub fn topic(&self, name: &str) -> String {
        format!("/{}/{name}", self.0)
    }

    /// The name of a fingertip's topic.
    #[must_use]
    pub fn fingertip_topic(&self, fingertip: SensorId, name: &str) -> String {
        format!("/{}/fingertip_{fingertip}/{name}", self.0)
    }

    /// The coordinate frame of a fingertip, as tf2 has it: without a slash at its beginning.
    #[must_use]
    pub fn frame_id(&self, fingertip: SensorId) -> String {
        format!("{}/fingertip_{fingertip}", self.0)
    }
}

impl FromStr for Namespace {
    type Err = BadName;

    fn from_str(text: &str) -> Result<Self, BadName> {
        let is_name = |part: &str| {
            part.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
                && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
                && !part.contains("__")
        };
        let relative = text.strip_prefix('/').unwrap_or(text);
        if relative.len() <= LENGTH_MAX && relative.split('/').all(is_name) {
            return Ok(Self(relative.to_owned()));
        }
        Err(BadName(text.escape_debug().take(LENGTH_MAX).collect()))
    }
}

/// Without a slash at its beginning.
impl fmt::Display for Namespace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_ros_allows() {
        for (text, plain) in [
            ("left", "left"),
            ("/cell_3/left", "cell_3/left"),
            ("_a/b1", "_a/b1"),
        ] {
            let name: Namespace = text.parse().unwrap();
            assert_eq!(name.to_string(), plain);
            assert_eq!(name.topic("hold"), format!("/{plain}/hold"));
            assert_eq!(
                name.fingertip_topic(SensorId::SECOND, "slip"),
                format!("/{plain}/fingertip_1/slip")
            );
            assert_eq!(name.frame_id(SensorId::FIRST), format!("{plain}/fingertip_0"));
        }
        let long = "a".repeat(201);
        for text in [
            "", "/", "//a", "a/", "a//b", "3a", "a-b", "a__b", "ä", "a b", "~a", "{a}", &long,
        ] {
            let error = text.parse::<Namespace>().unwrap_err().to_string();
            assert!(error.contains("cell_3/left"), "{error}");
        }
    }
}
