//! Whether the microcontroller still knows this host, and what to send when it does not: it may restart at any moment (watchdog,
//! panic, power), and then knows neither host nor settings. No IO. Times in µs of the session's clock.
//!
//! Signs of a restart: a status (the time since start falls, WATCHDOG RESET is latched again), a refused command, silence, or a
//! link that is back. Each of them only makes the host repeat the handshake, which changes nothing for a microcontroller that still
//! knows it; the session number in its answer decides.

use gripline_firmware::Fault;
use gripline_protocol::message::Status;

/// How long the microcontroller may be silent: it sends a status every 100 ms.
const SILENCE_US: u64 = 500_000;
/// How long an answer may take until the request is repeated.
const RETRY_US: u64 = 200_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Not met yet.
    New,
    /// Met, and the settings are known.
    Sound,
    /// It may have restarted.
    Doubted,
    /// It restarted, and needs our settings.
    Unsettled,
}

/// What to send now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Next {
    /// The handshake.
    Hello,
    /// The settings, or the request for them.
    Settings,
}

/// The known state of the microcontroller.
#[derive(Debug)]
pub(crate) struct Handshake {
    /// This host's own number.
    number: u32,
    state: State,
    /// The number of the microcontroller's start.
    start: Option<u32>,
    uptime_ms: u32,
    latched: u32,
    heard_us: u64,
    asked_us: Option<u64>,
    restarts: u32,
    /// It restarted, and has not confirmed our settings since.
    lacks_settings: bool,
}

impl Handshake {
    /// No device has answered yet.
    pub(crate) const fn new(number: u32) -> Self {
        Self {
            number,
            state: State::New,
            start: None,
            uptime_ms: 0,
            latched: 0,
            heard_us: 0,
            asked_us: None,
            restarts: 0,
            lacks_settings: false,
        }
    }

    pub(crate) const fn number(&self) -> u32 {
        self.number
    }

    pub(crate) const fn restarts(&self) -> u32 {
        self.restarts
    }

    pub(crate) const fn is_begun(&self) -> bool {
        !matches!(self.state, State::New)
    }

    pub(crate) const fn is_sound(&self) -> bool {
        matches!(self.state, State::Sound)
    }

    pub(crate) const fn wants_settings(&self) -> bool {
        matches!(self.state, State::Unsettled)
    }

    /// Its half of the handshake came, with its session number. Returns whether it restarted.
    pub(crate) fn met(&mut self, start: u32, now_us: u64) -> bool {
        self.heard(now_us);
        self.asked_us = None;
        let restarted = self.start.is_some_and(|before| before != start);
        self.start = Some(start);
        self.restarts += u32::from(restarted);
        self.lacks_settings |= restarted;
        self.state = if self.lacks_settings {
            State::Unsettled
        } else {
            State::Sound
        };
        restarted
    }

    /// Its settings are known and correct.
    pub(crate) const fn settled(&mut self) {
        self.state = State::Sound;
        self.lacks_settings = false;
        self.asked_us = None;
    }

    /// Something came from it.
    pub(crate) const fn heard(&mut self, now_us: u64) {
        self.heard_us = now_us;
    }

    /// It may no longer know this host.
    pub(crate) const fn doubt(&mut self) {
        if self.is_sound() {
            self.state = State::Doubted;
        }
    }

    /// It refused a command because it does not know this host: it restarted, even where it still lacks settings.
    pub(crate) const fn refused(&mut self) {
        if self.is_begun() {
            self.state = State::Doubted;
        }
    }

    /// This host's clock jumped: treat it like a restarted host.
    pub(crate) const fn renumber(&mut self) {
        self.number = self.number.wrapping_add(2);
        self.link_returned();
    }

    /// The link is back: the device gets a handshake at once.
    pub(crate) const fn link_returned(&mut self) {
        self.doubt();
        self.asked_us = None;
    }

    /// Takes a status; returns whether its sender knows this host and its settings.
    pub(crate) fn is_sound_after(&mut self, status: &Status) -> bool {
        let anew = status.latched & !self.latched & Fault::WatchdogReset.bit() != 0;
        let fell = (status.uptime_ms.wrapping_sub(self.uptime_ms)).cast_signed() < 0;
        (self.uptime_ms, self.latched) = (status.uptime_ms, status.latched);
        if fell || anew {
            self.doubt();
        }
        self.is_sound()
    }

    /// What to send at `now_us`; counts as sent.
    pub(crate) fn next(&mut self, now_us: u64) -> Option<Next> {
        if now_us > self.heard_us + SILENCE_US {
            self.doubt();
        }
        let next = match self.state {
            State::New | State::Sound => return None,
            State::Doubted => Next::Hello,
            State::Unsettled => Next::Settings,
        };
        if self.asked_us.is_some_and(|asked_us| now_us < asked_us + RETRY_US) {
            return None;
        }
        self.asked_us = Some(now_us);
        Some(next)
    }
}
