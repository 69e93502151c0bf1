//! From stick ratios to a slip state: a threshold with a separate leave threshold, a minimum dwell time, and the trend, because a
//! sudden fall of the stick ratio announces slip. A worse state takes effect at once, a better one only after the dwell time; but
//! when the load falls, everything sticks at once (`load.rs`). After a slide friction is known, and the load is more informative
//! than one map: where half of the contact must slip under it, the state is INCIPIENT before the ratios show it; where half must
//! stick, the state is STICK although they do not.
//!
//! Units: ratios 1/10000, times as named.

use gripline_protocol::message::{Configuration, MapSums, SlipState};

use crate::arithmetic::divide;
use crate::clock::{DeviceMicros, HostMicros};
use crate::constants::{CHANGED_PART, TIME_TO_SLIP_MAX_MS, TREND_MAPS};
use crate::contact_geometry::ContactGeometry;
use crate::load::{Load, LoadHistory};
use crate::sums::{stick_ratio, stick_ratio_below};

/// The detector's decision after a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SlipDecision {
    /// State after this map.
    pub state: SlipState,
    /// Stick ratio of this map; `None` when nothing touches.
    pub stick_ratio: Option<u16>,
    /// Time until the stick ratio reaches the threshold at its present rate.
    pub time_to_slip_ms: Option<u16>,
}

/// The settings of the state machine; units as in [`Configuration`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SlipSettings {
    threshold: u16,
    pub(crate) leave: u16,
    incipient: u16,
    horizon_ms: u16,
    dwell_ms: u16,
}

impl SlipSettings {
    /// Those of the settings in force.
    pub(crate) const fn of(settings: &Configuration) -> Self {
        Self {
            threshold: settings.slip_threshold,
            leave: settings.slip_leave,
            incipient: settings.incipient_threshold,
            horizon_ms: settings.incipient_horizon_ms,
            dwell_ms: settings.dwell_ms,
        }
    }
}

/// The immediate state from one map: a ratio below the threshold is SLIP; otherwise the state stays the same until the load has
/// been evaluated ([`SlipDetector::update`]).
pub(crate) fn first_decision(before: SlipDecision, sums: &MapSums, threshold: u16) -> SlipDecision {
    let ratio = stick_ratio(sums);
    let state = match before.state {
        _ if ratio.is_none() => SlipState::NoContact,
        _ if stick_ratio_below(sums, threshold) => SlipState::Slip,
        SlipState::NoContact => SlipState::Stick,
        state => state,
    };
    SlipDecision {
        state,
        stick_ratio: ratio,
        time_to_slip_ms: before.time_to_slip_ms.filter(|_| ratio.is_some()),
    }
}

/// The slip state machine of one fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SlipDetector {
    state: SlipState,
    /// Last time the state was this bad or worse, µs; wraps.
    last_bad_us: u32,
    trend: Trend,
    loads: LoadHistory,
    geometry: ContactGeometry,
}

impl SlipDetector {
    /// No contact yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: SlipState::NoContact,
            last_bad_us: 0,
            trend: Trend::new(),
            loads: LoadHistory::new(),
            geometry: ContactGeometry::new(),
        }
    }

    /// State after the last map.
    #[must_use]
    pub const fn state(&self) -> SlipState {
        self.state
    }

    /// Takes the sums of a new map: when its picture was taken, and when it arrived.
    pub fn update(
        &mut self,
        sums: &MapSums,
        capture: HostMicros,
        now: DeviceMicros,
        settings: &Configuration,
    ) -> SlipDecision {
        self.decide(sums, capture, now, &SlipSettings::of(settings))
    }

    /// The same with only the settings that it needs.
    pub(crate) fn decide(
        &mut self,
        sums: &MapSums,
        capture: HostMicros,
        now: DeviceMicros,
        settings: &SlipSettings,
    ) -> SlipDecision {
        let Some(ratio) = stick_ratio(sums) else {
            self.state = SlipState::NoContact;
            self.trend.filled = 0;
            self.loads = LoadHistory::new();
            self.geometry = ContactGeometry::new();
            return SlipDecision::default();
        };
        let time_to_slip_ms = self.trend.push(ratio, capture, settings.threshold);
        self.state = self.next_state(sums, time_to_slip_ms, capture, now, settings);
        SlipDecision {
            state: self.state,
            stick_ratio: Some(ratio),
            time_to_slip_ms,
        }
    }

    /// Updates the contact geometry for the next maps. Call it after [`SlipDetector::update`] with the same sums, outside the
    /// map-to-line path.
    pub fn observe(&mut self, sums: &MapSums) {
        if sums.contact > 0 {
            let sticks = severity(self.state) <= severity(SlipState::Stick) && !self.loads.has_slid();
            self.geometry.observe(sums, sticks);
        }
    }

    /// Geometry of the contact, as observed so far.
    pub(crate) const fn geometry(&self) -> &ContactGeometry {
        &self.geometry
    }

    fn next_state(
        &mut self,
        sums: &MapSums,
        time_to_slip_ms: Option<u16>,
        capture: HostMicros,
        arrived: DeviceMicros,
        settings: &SlipSettings,
    ) -> SlipState {
        let load = Load::of(sums, &self.geometry);
        if self.loads.push(&load, capture) {
            if self.state == SlipState::Slip {
                self.loads.note_slid(&load, &self.geometry);
            }
            return SlipState::Stick;
        }
        let soon = time_to_slip_ms.is_some_and(|ms| ms < settings.horizon_ms);
        let slips = stick_ratio_below(sums, settings.threshold)
            || (self.state == SlipState::Slip && stick_ratio_below(sums, settings.leave));
        let by_load = self.loads.is_half_slipping(&load, &self.geometry);
        // Where hardly anything sticks by the ratios, friction has changed since.
        let is_held = severity(self.state) <= severity(SlipState::Stick)
            && by_load == Some(false)
            && !stick_ratio_below(sums, settings.threshold / CHANGED_PART);
        let now = if is_held {
            SlipState::Stick
        } else if slips {
            SlipState::Slip
        } else if soon || by_load == Some(true) || stick_ratio_below(sums, settings.incipient) {
            SlipState::Incipient
        } else {
            SlipState::Stick
        };
        // Wraps after 71 minutes, longer than any dwell.
        let now_us = arrived.0 as u32;
        let rested = now_us.wrapping_sub(self.last_bad_us) >= u32::from(settings.dwell_ms) * 1_000;
        if severity(now) >= severity(self.state) {
            self.last_bad_us = now_us;
            now
        } else if rested {
            now
        } else {
            self.state
        }
    }
}

/// Order of the states from nothing to worst.
#[must_use]
pub const fn severity(state: SlipState) -> u8 {
    match state {
        SlipState::NoContact => 0,
        SlipState::Stick => 1,
        SlipState::Incipient => 2,
        SlipState::Slip => 3,
    }
}

/// The worse of two states.
#[must_use]
pub(crate) const fn worse(one: SlipState, other: SlipState) -> SlipState {
    if severity(other) > severity(one) {
        other
    } else {
        one
    }
}

/// The last stick ratios: the mean of the newer half against that of the older half, which a single flickering taxel
/// hardly moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Trend {
    /// Stick ratios, and when each was captured; the oldest stands at `oldest`.
    ratios: [u16; TREND_MAPS],
    at: [HostMicros; TREND_MAPS],
    filled: u8,
    oldest: u8,
}

impl Trend {
    const fn new() -> Self {
        Self {
            ratios: [0; TREND_MAPS],
            at: [HostMicros(0); TREND_MAPS],
            filled: 0,
            oldest: 0,
        }
    }

    /// Time to the threshold in ms; `None` while the window fills or the ratio does not fall.
    fn push(&mut self, ratio: u16, capture: HostMicros, threshold: u16) -> Option<u16> {
        let at = usize::from(self.oldest) % TREND_MAPS;
        self.ratios[at] = ratio;
        self.at[at] = capture;
        self.oldest = (at as u8 + 1) % TREND_MAPS as u8;
        self.filled = (self.filled + 1).min(TREND_MAPS as u8);
        if usize::from(self.filled) < TREND_MAPS {
            return None;
        }
        let half = |first: usize| {
            let (mut ratios, mut ages_us) = (0_u32, 0_u64);
            for place in 0..TREND_MAPS / 2 {
                let map = (at + 1 + first + place) % TREND_MAPS;
                ratios += u32::from(self.ratios[map]);
                ages_us += u64::from(capture.since(self.at[map]));
            }
            (ratios, ages_us)
        };
        let ((older, older_us), (newer, newer_us)) = (half(0), half(TREND_MAPS / 2));
        // Both sums are over four maps; the fours cancel.
        let fall = older.checked_sub(newer).filter(|fall| *fall > 0)?;
        // Milliseconds come last: at a thousand maps a second they are as long as the steps of the window.
        let span_us = older_us.checked_sub(newer_us).filter(|span| *span > 0)?;
        let left = u64::from(ratio.saturating_sub(threshold));
        // Four ratios of at most 10,000; 10⁴ · 2³⁴ at most.
        let time_ms = divide(divide(left * span_us, fall as u16), 1_000);
        u32::try_from(time_ms)
            .ok()
            .filter(|ms| *ms <= TIME_TO_SLIP_MAX_MS)
            .map(|ms| ms as u16)
    }
}
