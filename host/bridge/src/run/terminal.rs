//! Requests from the keys of the terminal view: one client among others, with a key to take the gripper over.

use std::time::{SystemTime, UNIX_EPOCH};

use gripline_control::{Action, Client, Handle, Request};

use crate::error::Error;
use crate::view::Key;

/// Step of the minimum force per key, newtons.
const FLOOR_STEP_N: f64 = 0.5;

/// The person at the terminal.
pub(super) struct Terminal {
    control: Handle,
    client: Client,
    number: u64,
}

impl Terminal {
    /// # Errors
    /// [`Error`] never: the name is a good one.
    pub(super) fn new(control: Handle) -> Result<Self, Error> {
        let started = SystemTime::now().duration_since(UNIX_EPOCH);
        Ok(Self {
            control,
            client: "terminal".parse()?,
            number: started.map_or(0, |time| time.as_nanos() as u64),
        })
    }

    /// Sends the request of a key. The answer goes to the log, which the view shows.
    pub(super) fn ask(&mut self, key: Key) {
        let floor = |step_n: f64| Action::SetFloor {
            newtons: (self.control.status().floor_n + step_n).max(0.0),
        };
        let action = match key {
            Key::Hold => Action::Hold,
            Key::Release => Action::Release,
            Key::Acknowledge => Action::Acknowledge,
            Key::Rezero => Action::Rezero,
            Key::RaiseFloor => floor(FLOOR_STEP_N),
            Key::LowerFloor => floor(-FLOOR_STEP_N),
            Key::TakeOver => Action::TakeOver,
            Key::Yield => Action::Yield,
            Key::Quit => return,
        };
        self.number += 1;
        self.control.tell(&Request {
            client: self.client.clone(),
            number: self.number,
            action,
            take_over: false,
        });
    }
}
