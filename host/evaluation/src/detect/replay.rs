//! Recorded maps through the microcontroller's whole program, in this process, over the same session as in a run: for
//! the columns that have a memory, slip state and grip-force line. Deterministic: its clock is the recording's.
//! Units: rate in maps per second. Limits: 10 to 1,000 maps a second, because slower maps are stale and faster ones
//! do not fit the link.

use std::ops::RangeInclusive;

use gripline_protocol::message::{Command, Configuration, SlipState};
use gripline_protocol::{ForceMap, Health, MapInfo, PER_UNIT, SensorId};

use crate::detect::judge::{Settings, Verdict};
use crate::error::EvaluationError;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;

/// Slowest and fastest rate of maps, per second.
pub const RATE_HZ: RangeInclusive<f64> = 10.0..=1_000.0;

/// What the controller says after a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// Slip state.
    pub state: SlipState,
    /// How sure the whole detector is that something slips, 1/10000.
    pub slip_evidence: u16,
    /// Grip-force line, 1/4096 N.
    pub line: i32,
}

/// A controller that holds, and is shown one map after the other.
pub struct Replay {
    session: Session,
    start_us: u64,
    rate_hz: f64,
}

/// The controller's settings for a detector: the levels that depend on the threshold keep their distance from it.
#[must_use]
pub fn configuration(settings: &Settings) -> Configuration {
    Configuration {
        friction: settings.friction.per_unit(),
        contact_min: settings.contact_min,
        ..moved_to(&Configuration::DEFAULT, settings.threshold)
    }
}

/// Settings with another threshold on the stick ratio, 1/10000, and the levels that depend on it at the same distance.
#[must_use]
pub fn moved_to(settings: &Configuration, threshold: u16) -> Configuration {
    let moved = |level: u16| (threshold + (level - settings.slip_threshold)).min(PER_UNIT as u16);
    Configuration {
        slip_threshold: threshold,
        slip_leave: moved(settings.slip_leave),
        incipient_threshold: moved(settings.incipient_threshold),
        reflex_target: moved(settings.reflex_target),
        ..*settings
    }
}

impl Replay {
    /// Starts a controller with these settings and tells it to hold.
    ///
    /// # Errors
    /// [`EvaluationError`] when it refuses them.
    pub fn new(settings: &Settings, rate_hz: f64) -> Result<Self, EvaluationError> {
        let mut session = Session::open(Box::new(EmbeddedLink::new()), configuration(settings))?;
        session.command(Command::Hold)?;
        let start_us = session.now_us();
        Ok(Self {
            session,
            start_us,
            rate_hz,
        })
    }

    /// Shows the map of frame number `frame` and returns the controller's answer to it.
    ///
    /// # Errors
    /// [`EvaluationError`] when the controller does not confirm `verdict`.
    pub fn show(
        &mut self,
        frame: u64,
        map: &ForceMap,
        saturated: bool,
        verdict: &Verdict,
    ) -> Result<Answer, EvaluationError> {
        let now_us = self.start_us + (frame as f64 * 1e6 / self.rate_hz).round() as u64;
        self.session.run_until(now_us)?;
        let info = MapInfo {
            sensor: SensorId::FIRST,
            sequence: frame as u32,
            capture_us: now_us as u32,
            health: if saturated {
                Health::SATURATED
            } else {
                Health::GOOD
            },
            ..MapInfo::default()
        };
        self.session.send_map(&info, map)?;
        self.session.run_until(now_us)?;
        match self.session.status() {
            Some(status) if status.sequence == info.sequence && status.sums == verdict.sums => Ok(Answer {
                state: status.state,
                slip_evidence: status.slip_evidence,
                line: status.line,
            }),
            _ => Err(EvaluationError::Disagrees { frame }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_firmware::Friction;

    #[test]
    fn every_threshold_and_friction_gives_settings_that_the_controller_takes() {
        for threshold in 0..=10_000 {
            let settings = Settings {
                friction: Friction::clamped(2 * threshold),
                threshold,
                contact_min: 0,
                scale: 1.0,
            };
            assert_eq!(configuration(&settings).check(), Ok(()), "{threshold}");
        }
    }

    #[test]
    fn the_default_detector_gives_the_default_settings() {
        let settings = Settings {
            friction: Friction::clamped(4_500),
            threshold: 5_000,
            contact_min: 0,
            scale: 1.0,
        };
        assert_eq!(configuration(&settings), Configuration::DEFAULT);
    }
}
