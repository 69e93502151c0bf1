//! The state of a session: microcontroller, settings, newest status and line, link.

use gripline_protocol::message::{Configuration, Hello, Refusal, Status};
use gripline_protocol::parser::Counters;
use gripline_protocol::{LSB_PER_NEWTON, SensorId};

use super::Session;
use crate::Presence;
use crate::error::flashing;
use crate::shadow::Shadow;

impl Session {
    /// The present time on the clock of capture times.
    #[must_use]
    pub fn capture_us(&self) -> u32 {
        self.link.now_us() as u32
    }

    /// Time of the microcontroller's clock on this link, µs; capture times are its low 32 bits.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.link.now_us()
    }

    /// Whether time passes without [`Session::run_until`].
    #[must_use]
    pub fn is_real_time(&self) -> bool {
        self.link.is_real_time()
    }

    /// The settings that the microcontroller confirmed.
    #[must_use]
    pub const fn settings(&self) -> &Configuration {
        &self.settings
    }

    /// The microcontroller's handshake.
    #[must_use]
    pub const fn firmware(&self) -> Option<&Hello> {
        self.firmware.as_ref()
    }

    /// How often the microcontroller restarted since the session began.
    #[must_use]
    pub const fn restarts(&self) -> u32 {
        self.handshake.restarts()
    }

    /// How often this host's clock jumped against the microcontroller's, or the first map was so late that all others seemed to be
    /// from the future; it then got a new handshake.
    #[must_use]
    pub const fn clock_jumps(&self) -> u64 {
        self.clock_jumps
    }

    /// Whether the microcontroller knows this host and has its settings; not so for a moment after it restarted.
    #[must_use]
    pub const fn is_sound(&self) -> bool {
        self.handshake.is_sound()
    }

    /// The newest status.
    #[must_use]
    pub fn status(&self) -> Option<&Status> {
        self.inbox.latest.as_ref()
    }

    /// The newest status as one about this fingertip's newest map: the fields about the map are from this fingertip's last status,
    /// the rest is current. `None` before the first such status.
    #[must_use]
    pub fn status_of(&self, sensor: SensorId) -> Option<Status> {
        let spoken = self.inbox.of_fingertips[sensor.index()]?;
        let newest = self.status()?;
        Some(Status {
            sensor,
            sequence: spoken.sequence,
            sums: spoken.sums,
            coulomb_slip: spoken.coulomb_slip,
            time_to_slip_ms: spoken.time_to_slip_ms,
            ..*newest
        })
    }

    /// How long ago it came, µs.
    #[must_use]
    pub fn status_age_us(&self) -> u64 {
        self.now_us().saturating_sub(self.status_us)
    }

    /// When something was last sent, whether the link accepted it or not.
    #[must_use]
    pub const fn sent_us(&self) -> u64 {
        self.sent_us
    }

    /// Whether the device is connected, and what was lost.
    #[must_use]
    pub fn presence(&self) -> Presence {
        self.link.presence()
    }

    /// A warning for firmware of another version than this host's that speaks the same messages; `None` for the same version.
    #[must_use]
    pub fn other_version(&self) -> Option<String> {
        let firmware = self.firmware.as_ref()?;
        let ours = Hello::of_this_build(0, 0).build;
        (firmware.build != ours).then(|| {
            format!(
                "{}: found firmware {firmware}, expected {}.{}.{}: they understand each other, so the run goes on; \
                 `{}` makes both the same",
                self.link.name(),
                ours[0],
                ours[1],
                ours[2],
                flashing(firmware)
            )
        })
    }

    /// The last refused command, once.
    pub fn take_refusal(&mut self) -> Option<Refusal> {
        self.inbox.refusal.take()
    }

    /// The comparison of the microcontroller's answers with our own.
    #[must_use]
    pub const fn shadow(&self) -> &Shadow {
        &self.shadow
    }

    /// Counters of the link's receiving end.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.inbox.parser.counters()
    }

    /// The grip-force line, N: at this moment if the link knows it, else from the last status.
    #[must_use]
    pub fn line_n(&self) -> f64 {
        let reported = || self.status().map_or(0, |status| status.line);
        newtons(self.link.line().unwrap_or_else(reported))
    }

    /// The code on the DAC of the grip-force line, if the link knows it.
    #[must_use]
    pub fn line_code(&self) -> Option<u16> {
        self.link.line_code()
    }

    /// What the link is, for people.
    #[must_use]
    pub fn link_name(&self) -> String {
        self.link.name()
    }
}

/// 1/4096 N to newtons, exact.
fn newtons(lsb: i32) -> f64 {
    f64::from(lsb) / f64::from(LSB_PER_NEWTON)
}
