//! Requests to a run: taken between frames, executed, repeated until the microcontroller confirms, and answered. Nothing
//! here waits.

use gripline_control::{Asked, Outcome, StatusReport, Step, Why, names, reported};
use gripline_link::session::Session;
use gripline_pipeline::{Acknowledgement, Acknowledging, Unconfirmed};
use gripline_protocol::message::{Command, Configuration, GripMode, Refusal};
use gripline_protocol::{LSB_PER_NEWTON, SensorId};
use gripline_recording::units::newtons;

use super::drift::DriftWatch;
use super::fingertips::Fingertips;
use super::report::{fault_names, faults_of};
use super::requests::FloorRequest;
use super::rezero::Rezero;
use super::under_way::Run;
use crate::error::Error;

/// Unconfirmed settings are sent again after this, µs.
const OFFER_AGAIN_US: u64 = 10_000;
/// Without a frame the gripper's state is published again after this, µs.
const PUBLISH_AGAIN_US: u64 = 50_000;
/// An unconfirmed request is given up after this, µs.
const GIVE_UP_US: u64 = 2_000_000;

impl Run {
    /// Takes new requests, and continues pending ones.
    pub(super) fn handle_requests(&mut self) -> Result<(), Error> {
        self.withdraw_after_restart()?;
        while let Some(asked) = self.requests.inbox.next() {
            self.begin(asked);
        }
        self.control.ask_for(self.requests.mode())?;
        self.settle_requests()
    }

    /// What was requested before the microcontroller restarted is not requested again: nothing moves by itself because power
    /// came back.
    fn withdraw_after_restart(&mut self) -> Result<(), Error> {
        let restarts = self.control.session.restarts();
        if std::mem::replace(&mut self.restarts, restarts) == restarts {
            return Ok(());
        }
        if self.requests.arbiter.waits_for(Step::Hold) {
            // A status may show it already; otherwise it is refused, also what was asked for in the call that learnt of the restart.
            self.control.look();
            self.settle_mode()?;
            if self.requests.arbiter.waits_for(Step::Hold) {
                self.close(Step::Hold, &Outcome::Refused(Why::Restarted));
            }
        }
        if let Some(mode) = self.requests.mode() {
            tracing::warn!(
                "the microcontroller restarted: {} is not requested again, so that nothing moves by itself",
                mode_name(mode)
            );
        }
        self.requests.withdraw();
        Ok(())
    }

    /// Takes one request at once.
    pub(super) fn take_request(&mut self, asked: Asked) -> Result<(), Error> {
        self.withdraw_after_restart()?;
        self.begin(asked);
        self.handle_requests()
    }

    /// Answers all clients that wait for such a step. The status is updated first, so they need not wait for the next frame.
    fn close(&mut self, step: Step, outcome: &Outcome) {
        self.requests.inbox.publish(|status| self.fill(status));
        self.requests.arbiter.close(step, outcome);
    }

    /// The fields of a status that requests change: owner, modes, and the floor in newtons.
    fn fill(&self, status: &mut StatusReport) {
        let session = &self.control.session;
        status.owner = self.requests.arbiter.owner().cloned();
        status.requested = self.requests.mode().map(mode_name);
        status.mode = session.status().map(|status| mode_name(status.mode));
        status.floor_n = newtons(session.settings().floor);
    }

    fn begin(&mut self, asked: Asked) {
        let Some(step) = self.requests.arbiter.take(asked) else {
            // It was answered at once, and may have another owner.
            return self.requests.inbox.publish(|status| self.fill(status));
        };
        let session = &self.control.session;
        let now_us = session.now_us();
        let refused = match step {
            Step::Hold | Step::Release => {
                let mode = if step == Step::Hold {
                    GripMode::Hold
                } else {
                    GripMode::Released
                };
                self.requests.asked = Some(mode);
                self.control.request_anew();
                return;
            }
            Step::Acknowledge => match session.status().map_or(0, |status| status.latched) {
                0 => return self.close(step, &Outcome::Done),
                latched => {
                    let restarts = session.restarts();
                    self.requests.acknowledging = Some(Acknowledgement::new(latched, now_us, restarts));
                    return;
                }
            },
            Step::SetFloor(newtons) => {
                let now = session.settings();
                let max_n = f64::from(now.ceiling.min(now.fail_safe)) / f64::from(LSB_PER_NEWTON);
                if (0.0..=max_n).contains(&newtons) {
                    let floor = (newtons * f64::from(LSB_PER_NEWTON)).round() as i32;
                    self.requests.floor = Some(FloorRequest {
                        settings: Configuration { floor, ..*now },
                        begun_us: now_us,
                        sent_us: None,
                    });
                    return;
                }
                Why::OutOfRange {
                    found_n: newtons,
                    min_n: 0.0,
                    max_n,
                }
            }
            Step::Rezero if self.requests.fingertips_to_rezero == 0 => Why::NoCamera,
            Step::Rezero if self.mode_in_force() != Some(GripMode::Released) => Why::Holding,
            Step::Rezero => {
                self.requests.rezero = Some(Rezero::new(self.requests.fingertips_to_rezero));
                return;
            }
        };
        self.close(step, &Outcome::Refused(refused));
    }

    /// Answers completed requests.
    pub(super) fn settle_requests(&mut self) -> Result<(), Error> {
        self.take_refusal();
        self.settle_mode()?;
        self.settle_acknowledgement()?;
        self.settle_floor()?;
        for news in self.requests.arbiter.take_news() {
            if news.is_warning {
                tracing::warn!("{}", news.text);
            } else {
                tracing::info!("{}", news.text);
            }
        }
        Ok(())
    }

    fn take_refusal(&mut self) {
        let Some(refusal) = self.control.session.take_refusal() else {
            return;
        };
        self.summary.commands_refused += 1;
        self.summary.last_refusal = Some(format!("{refusal:?}"));
        self.control.refused(refusal);
    }

    fn settle_mode(&mut self) -> Result<(), Error> {
        let is_asked = self.requests.arbiter.waits_for(Step::Hold);
        if let Some(why) = self.control.take_unconfirmed() {
            self.summary.requests_unconfirmed += 1;
            if is_asked {
                // What was refused must not be done later.
                self.requests.asked = None;
                self.control.ask_for(None)?;
                let why = why_not(why, &self.control.session);
                self.close(Step::Hold, &Outcome::Refused(why));
            } else {
                tracing::warn!("{why}");
            }
        } else if is_asked && self.control.is_confirmed() {
            self.close(Step::Hold, &Outcome::Done);
        }
        Ok(())
    }

    fn settle_acknowledgement(&mut self) -> Result<(), Error> {
        let Some(mut asked) = self.requests.acknowledging.take() else {
            return Ok(());
        };
        let session = &mut self.control.session;
        let now_us = session.now_us();
        let step = |asked: &Acknowledgement, session: &Session| {
            let status = (session.status(), session.status_age_us());
            asked.step(now_us, status, session.restarts())
        };
        let mut next = step(&asked, session);
        // One that may have restarted must not take it: what came up with the restart was not looked at.
        if next == Acknowledging::Send && session.is_sound() {
            let faults = asked.faults();
            let was_taken =
                session.command(Command::Acknowledge { faults })? && session.command(Command::ReadStatus)?;
            asked.sent(now_us, was_taken);
            session.run_until(now_us)?;
            next = step(&asked, session);
        }
        let outcome = match next {
            Acknowledging::Send | Acknowledging::Wait => {
                self.requests.acknowledging = Some(asked);
                return Ok(());
            }
            Acknowledging::Done => {
                // Of what was refused meanwhile, a release, the gripper is told again.
                self.control.request_again();
                tracing::info!("acknowledged: {}", names(asked.faults()).join(", "));
                Outcome::Done
            }
            Acknowledging::StillLatched(latched, 0) => Outcome::Refused(Why::StillActive(names(latched))),
            Acknowledging::StillLatched(_, active) => Outcome::Refused(Why::StillActive(names(active))),
            Acknowledging::NoStatus => Outcome::Refused(silent(session)),
            Acknowledging::Restarted => Outcome::Refused(Why::Restarted),
        };
        self.close(Step::Acknowledge, &outcome);
        Ok(())
    }

    fn settle_floor(&mut self) -> Result<(), Error> {
        let Some(mut asked) = self.requests.floor.take() else {
            return Ok(());
        };
        let session = &mut self.control.session;
        let now_us = session.now_us();
        let mut taken = asked.sent_us.and_then(|_| session.taken(&asked.settings));
        let is_due = asked
            .sent_us
            .is_none_or(|sent_us| now_us >= sent_us + OFFER_AGAIN_US);
        if taken.is_none() && is_due {
            if session.offer(asked.settings)? {
                asked.sent_us = Some(now_us);
            }
            session.run_until(now_us)?;
            taken = session.taken(&asked.settings);
        }
        let outcome = match taken {
            Some(true) => {
                self.requests.has_other_settings = true;
                Outcome::Done
            }
            Some(false) => Outcome::Refused(Why::Refused("a setting is out of its range".to_owned())),
            None if now_us >= asked.begun_us + GIVE_UP_US => Outcome::Refused(silent(session)),
            None => {
                self.requests.floor = Some(asked);
                return Ok(());
            }
        };
        self.close(Step::SetFloor(0.0), &outcome);
        Ok(())
    }

    /// Whether other settings came into force since the last call.
    pub(super) const fn settings_changed(&mut self) -> bool {
        std::mem::replace(&mut self.requests.has_other_settings, false)
    }

    /// The gripper's mode: a requested hold counts at once, a release when the microcontroller confirms it.
    pub(super) fn mode_in_force(&self) -> Option<GripMode> {
        match self.requests.mode() {
            Some(GripMode::Hold) => Some(GripMode::Hold),
            Some(GripMode::Released) | None => self.control.session.status().map(|status| status.mode),
        }
    }

    /// Publishes the gripper's state after this many frames.
    pub(super) fn publish_status(&mut self, frames: u64, host_faults: &[&'static str]) {
        let session = &self.control.session;
        self.published_us = session.now_us();
        self.requests.inbox.publish(|status| {
            self.fill(status);
            let newest = session.status();
            let known = newest.copied().unwrap_or_default();
            status.state = known.state.name();
            status.line_n = newtons(known.line);
            status.ceiling_n = newtons(session.settings().ceiling);
            if status.link.is_empty() {
                status.link = session.link_name();
            }
            status.is_connected = session.presence().away.is_none();
            status.status_age_ms = session.status_age_us() as f64 / 1e3;
            status.faults = newest.map_or_else(Vec::new, reported);
            status.host_faults = host_faults.to_vec();
            status.frames = frames;
        });
    }

    /// Publishes the gripper's state where no frame has done so for a while: it goes on changing without pictures.
    pub(super) fn publish_between_frames(&mut self, frames: u64) {
        let session = &self.control.session;
        if session.now_us() < self.published_us + PUBLISH_AGAIN_US {
            return;
        }
        let host_faults = faults_of(session);
        if let Some((live, status)) = self.live.as_ref().zip(session.status()) {
            live.update(
                status.state.name(),
                newtons(status.line),
                &fault_names(status, &host_faults),
            );
        }
        self.publish_status(frames, &host_faults);
    }
}

impl Run {
    /// Advances a re-zero that was requested.
    pub(super) fn advance_rezero(&mut self, fingertips: &mut Fingertips) -> Result<(), Error> {
        let is_released = self.mode_in_force() == Some(GripMode::Released);
        let Some(rezero) = &mut self.requests.rezero else {
            return Ok(());
        };
        let outcome = if is_released {
            match rezero.step(|| fingertips.rest_means()) {
                None => return Ok(()),
                Some(Err(why)) => Outcome::Refused(why),
                Some(Ok(believed)) => {
                    for (sensor, new) in SensorId::ALL.into_iter().zip(believed) {
                        if let Some(watch) = self.drift.get_mut(sensor.index()) {
                            *watch = DriftWatch::new(&new.pictures);
                        }
                        fingertips.rest_anew(sensor, &new.pictures, &new.figures);
                    }
                    Outcome::Done
                }
            }
        } else {
            Outcome::Refused(Why::Holding)
        };
        self.requests.rezero = None;
        self.close(Step::Rezero, &outcome);
        self.settle_requests()
    }
}

const fn mode_name(mode: GripMode) -> &'static str {
    match mode {
        GripMode::Hold => "hold",
        GripMode::Released => "released",
    }
}

fn why_not(why: Unconfirmed, session: &Session) -> Why {
    let latched = || session.status().map_or(0, |status| status.latched);
    match why {
        Unconfirmed::Refused(_, Refusal::Latched) => Why::Latched(names(latched())),
        Unconfirmed::Refused(_, Refusal::Inhibited) => Why::Inhibited,
        Unconfirmed::Refused(_, other) => Why::Refused(format!("{other:?}")),
        Unconfirmed::NotTaken(_) | Unconfirmed::NoStatus(_) => silent(session),
        Unconfirmed::NoEffect(_) => Why::NotConfirmed("statuses that show the other mode".to_owned()),
        Unconfirmed::Restarted(_) => Why::Restarted,
    }
}

/// The microcontroller says nothing.
fn silent(session: &Session) -> Why {
    let away = session.presence().away;
    away.map_or_else(
        || Why::NotConfirmed("no answer of the microcontroller".to_owned()),
        Why::LinkLost,
    )
}
