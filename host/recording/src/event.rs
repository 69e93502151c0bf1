//! Events of a recording: changes of state, faults and losses, as foxglove.Log messages. Pure.

use foxglove::messages::Log;
use foxglove::messages::log::Level;
use gripline_protocol::SensorId;

use crate::telemetry::FrameReport;
use crate::topics::{encoded, timestamp};

/// An event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Event {
    /// How bad it is.
    pub level: Level,
    /// What happened.
    pub message: String,
}

impl Event {
    /// For information.
    pub(crate) fn info(message: impl Into<String>) -> Self {
        Self {
            level: Level::Info,
            message: message.into(),
        }
    }

    /// Needs attention.
    pub(crate) fn warning(message: impl Into<String>) -> Self {
        Self {
            level: Level::Warning,
            message: message.into(),
        }
    }

    /// The body of its message.
    pub(crate) fn bytes(&self, ns: u64) -> Vec<u8> {
        encoded(&Log {
            timestamp: Some(timestamp(ns)),
            level: self.level as i32,
            message: self.message.clone(),
            name: "gripline".to_owned(),
            file: String::new(),
            line: 0,
        })
    }
}

/// What changed from one frame to the next: of the gripper since the last one, of the picture since the fingertip's last.
pub(crate) fn events_between(
    (last, last_of_it): (Option<&FrameReport>, Option<&FrameReport>),
    now: &FrameReport,
) -> Vec<Event> {
    let none = Vec::new();
    let (faults, state) = last.map_or((&none, "NO_CONTACT"), |last| (&last.faults, last.state));
    let health = last_of_it.map_or(&none, |last| &last.health);
    let mut events = Vec::new();
    if now.state != state {
        let text = format!("{state} to {}", now.state);
        events.push(if now.state == "SLIP" {
            Event::warning(text)
        } else {
            Event::info(text)
        });
    }
    let appeared = |now: &[&'static str], before: &[&'static str], what: &str| -> Vec<Event> {
        let new = now.iter().filter(|name| !before.contains(name));
        new.map(|name| Event::warning(format!("{what} {name}"))).collect()
    };
    events.extend(appeared(&now.faults, faults, "fault"));
    let picture = if now.sensor == SensorId::FIRST {
        "picture"
    } else {
        "second fingertip's picture"
    };
    events.extend(appeared(&now.health, health, picture));
    let gone = faults.iter().filter(|name| !now.faults.contains(name));
    events.extend(gone.map(|name| Event::info(format!("fault {name} is gone"))));
    events
}
