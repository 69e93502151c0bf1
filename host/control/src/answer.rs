//! The outcome of a request.

use std::fmt;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::client::Client;
use crate::request::{Action, Request};

/// Why a request was not executed. Nothing moved because of it, unless its doc says otherwise.
#[derive(Debug, Clone, PartialEq)]
pub enum Why {
    /// Another client owns the gripper.
    WrongOwner(Client),
    /// Latched faults forbid a release: their names.
    Latched(Vec<&'static str>),
    /// The release-inhibit input forbids a release.
    Inhibited,
    /// The device is not connected: the link's reason. Nothing is sent when it is back.
    LinkLost(String),
    /// It was sent repeatedly, but no status confirmed it: what the status shows instead.
    NotConfirmed(String),
    /// The device restarted before it confirmed.
    Restarted,
    /// Only possible while the gripper is released.
    Holding,
    /// Only possible while nothing touches the fingertip: what the pictures show.
    Touched(String),
    /// Faults are still latched because they are still there: their names.
    StillActive(Vec<&'static str>),
    /// A force outside the allowed range, newtons.
    OutOfRange {
        /// The requested force.
        found_n: f64,
        /// The minimum.
        min_n: f64,
        /// The maximum.
        max_n: f64,
    },
    /// The device refused its settings, in its words.
    Refused(String),
    /// A newer request took its place.
    Overtaken,
    /// Pictures from files cannot be taken again.
    NoCamera,
    /// Too many requests wait.
    Busy,
    /// The run is over.
    Ended,
}

impl Why {
    /// Its name, for programs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::WrongOwner(_) => "wrong_owner",
            Self::Latched(_) => "latched",
            Self::Inhibited => "inhibited",
            Self::LinkLost(_) => "link_lost",
            Self::NotConfirmed(_) => "not_confirmed",
            Self::Restarted => "restarted",
            Self::Holding => "holding",
            Self::Touched(_) => "touched",
            Self::StillActive(_) => "still_active",
            Self::OutOfRange { .. } => "out_of_range",
            Self::Refused(_) => "refused",
            Self::Overtaken => "overtaken",
            Self::NoCamera => "no_camera",
            Self::Busy => "busy",
            Self::Ended => "ended",
        }
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::WrongOwner(owner) => write!(
                f,
                "found the gripper owned by {owner}, expected the one who asks: take it over by name (take_over)"
            ),
            Self::Latched(faults) => write!(
                f,
                "found {} latched, expected none for a release: look at it, acknowledge it, release again",
                faults.join(", ")
            ),
            Self::Inhibited => f.write_str(
                "found the release-inhibit input active, expected it inactive: let the robot allow the release",
            ),
            Self::LinkLost(why) => write!(
                f,
                "found the microcontroller away ({why}), expected it there: check cable and power"
            ),
            Self::NotConfirmed(found) => write!(
                f,
                "found {found}, expected the microcontroller's status to show it: see `gripline faults`"
            ),
            Self::Restarted => f.write_str(
                "the microcontroller restarted before it confirmed; not repeated, so that nothing moves by itself: ask again",
            ),
            Self::Holding => f.write_str("found the gripper holding, expected it released"),
            Self::Touched(found) => write!(f, "found {found}, expected an untouched fingertip at rest"),
            Self::StillActive(faults) => write!(
                f,
                "found {} still there, expected its cause removed first; see `gripline faults`",
                faults.join(", ")
            ),
            Self::OutOfRange {
                found_n,
                min_n,
                max_n,
            } => write!(f, "found {found_n} N, expected {min_n:.2} to {max_n:.2} N"),
            Self::Refused(reason) => write!(f, "refused by the microcontroller: {reason}"),
            Self::Overtaken => f.write_str("a newer request took its place"),
            Self::NoCamera => f.write_str(
                "found pictures that are not taken now, expected a camera or the simulated world: files have what they have",
            ),
            Self::Busy => f.write_str("found too many requests waiting, expected fewer: ask again in a moment"),
            Self::Ended => f.write_str("the run is over: start it again"),
        }
    }
}

/// Whether it was executed.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The device confirms it.
    Done,
    /// It does not.
    Refused(Why),
}

/// The answer to a request. As JSON: `client`, `request`, `action`, `outcome` (done or refused), `why` (a name, or null),
/// `message`, `owner` (or null), `took_ms`.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Who asked.
    pub client: Client,
    /// The client's number of the request.
    pub number: u64,
    /// The action.
    pub action: Action,
    /// The outcome.
    pub outcome: Outcome,
    /// Who owns the gripper now.
    pub owner: Option<Client>,
    /// From the request until the answer, milliseconds.
    pub took_ms: f64,
}

impl Answer {
    /// To `request`.
    #[must_use]
    pub fn to(request: &Request, outcome: Outcome, owner: Option<&Client>, took_ms: f64) -> Self {
        Self {
            client: request.client.clone(),
            number: request.number,
            action: request.action,
            outcome,
            owner: owner.cloned(),
            took_ms,
        }
    }

    /// Whether it was carried out.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        matches!(self.outcome, Outcome::Done)
    }

    /// Why it was not.
    #[must_use]
    pub const fn why(&self) -> Option<&Why> {
        match &self.outcome {
            Outcome::Done => None,
            Outcome::Refused(why) => Some(why),
        }
    }
}

impl fmt::Display for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.outcome {
            Outcome::Done => write!(f, "{}: {} done", self.client, self.action),
            Outcome::Refused(why) => write!(f, "{}: {} refused: {why}", self.client, self.action),
        }
    }
}

impl Serialize for Answer {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(8))?;
        map.serialize_entry("client", &self.client)?;
        map.serialize_entry("request", &self.number)?;
        map.serialize_entry("action", &self.action)?;
        map.serialize_entry("outcome", if self.is_done() { "done" } else { "refused" })?;
        map.serialize_entry("why", &self.why().map(Why::name))?;
        map.serialize_entry("message", &self.to_string())?;
        map.serialize_entry("owner", &self.owner)?;
        map.serialize_entry("took_ms", &self.took_ms)?;
        map.end()
    }
}
