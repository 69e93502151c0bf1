//! The program's dispatch: packets of maps and time in, the line's value out.
//!
//! The work per packet is bounded. Taxels are added as they arrive; after a map's last packet only its own taxels, the CRC
//! and the decision remain. A map whose CRC, order or sequence is wrong changes nothing.
//! Units: forces 1/4096 N, time µs since start (u64: no wrap). No allocation, no panic, no IO.

use core::marker::PhantomData;

use gripline_protocol::message::{Configuration, GripMode, Hello, MapSums, STAGES, SlipState, Stage, Status};
use gripline_protocol::packet::Kind;
use gripline_protocol::sequence::{Order, SequenceTracker};
use gripline_protocol::{Health, MapInfo, MapParser, SENSORS};

use super::outbox::Outbox;
use super::start::{ResetCause, Start};
use crate::arithmetic::divide;
use crate::clock_sync::{CaptureTime, ClockSync};
use crate::constants::{DECIDE_BUDGET_CYCLES, STATUS_PERIOD_MS};
use crate::fault::{Fault, FaultSet};
use crate::friction_estimator::FrictionEstimator;
use crate::grip::{Evidence, GripController, GripForce};
use crate::line::LineHealth;
use crate::safety::Safety;
use crate::slip::{SlipDecision, SlipDetector, severity};
use crate::sums::{Accumulator, Kernel, Portable, TaxelRule, stick_ratio_below, total_shear};

/// What to do after a packet of a map or a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "the line must be written"]
pub struct Action {
    /// What must be on the line now.
    pub line: GripForce,
    /// [`Program::poll_message`] has something for the host.
    pub transmit: bool,
    /// A map was accepted by this packet.
    pub decided: bool,
}

/// The newest state of one fingertip.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fingertip {
    pub(super) sequence: SequenceTracker,
    slip: SlipDetector,
    decision: SlipDecision,
    sums: MapSums,
    shear: i32,
    friction: FrictionEstimator,
    /// `friction` has not seen the newest map yet.
    is_estimate_due: bool,
    pub(super) clock: ClockSync,
    /// When its last map would have arrived without delay, or when holding began, µs.
    pub(super) fresh_us: u64,
    health: Health,
}

/// The microcontroller's program, about 2 KiB. Hosts drive it through [`Device`](super::Device).
#[derive(Debug)]
pub struct Program<K = Portable> {
    kernel: PhantomData<K>,
    pub(super) start: Start,
    pub(super) settings: Configuration,
    pub(super) rule: TaxelRule,
    pub(super) maps_in: MapParser,
    /// Sums of the map in progress; void until its CRC is known to be right.
    partial: Accumulator,
    pub(super) fingertips: [Fingertip; SENSORS],
    newest: MapInfo,
    pub(super) controller: GripController,
    pub(super) safety: Safety,
    pub(super) outbox: Outbox,
    /// `Store` was requested and is not done yet.
    pub(super) store: bool,
    pub(super) host: Option<Hello>,
    pub(super) now_us: u64,
    pub(super) last_packet_us: u64,
    pub(super) last_status_us: u64,
    maps: u32,
    /// Maps whose packets were right but that were old or from the future.
    maps_refused: u32,
    worst_cycles: [u32; STAGES],
}

impl Program {
    /// [`Program::with_kernel`] with the kernel of every host.
    #[must_use]
    pub fn new(start: Start) -> Self {
        Self::with_kernel(start)
    }
}

impl<K: Kernel> Program<K> {
    /// Starts with the stored settings or the default ones: released, or holding the restored line.
    #[must_use]
    pub fn with_kernel(start: Start) -> Self {
        let settings = start.stored.settings.unwrap_or(Configuration::DEFAULT);
        let mut safety = Safety::new();
        if start.reset != ResetCause::PowerOn {
            safety.set(Fault::WatchdogReset, true);
            safety.set(Fault::WatchdogReset, false); // over, but a person must see it
        }
        safety.set(Fault::SettingsLost, start.stored.lost);
        Self {
            kernel: PhantomData,
            start,
            rule: TaxelRule::of(&settings),
            settings,
            maps_in: MapParser::new(),
            partial: Accumulator::new(TaxelRule::of(&settings)),
            fingertips: [Fingertip {
                fresh_us: start.now_us,
                ..Fingertip::default()
            }; SENSORS],
            newest: MapInfo::default(),
            controller: GripController::new(start.now_us, start.restored_line),
            safety,
            outbox: Outbox::default(),
            store: false,
            host: None,
            now_us: start.now_us,
            last_packet_us: start.now_us,
            last_status_us: start.now_us,
            maps: 0,
            maps_refused: 0,
            worst_cycles: [0; STAGES],
        }
    }

    /// What must be on the line now.
    #[must_use]
    pub const fn line(&self) -> GripForce {
        self.controller.line()
    }

    /// The faults that are active now: for a log of those that came and went.
    #[must_use]
    pub const fn faults(&self) -> FaultSet {
        self.safety.active()
    }

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &Configuration {
        &self.settings
    }

    /// Takes one packet that is no [`Kind::Message`]: the map-to-line path.
    #[inline]
    pub fn map_packet(&mut self, packet: &[u8], now_us: u64) -> Action {
        let now_us = self.passed_to(now_us);
        let read = match Kind::of(packet) {
            Some(Kind::MapTail) => self.tail(packet),
            Some(Kind::MapTaxels) => self.taxels(packet),
            Some(Kind::MapHead) => self.head(packet),
            Some(Kind::Message) | None => {
                self.maps_in.unknown(packet);
                None
            }
        };
        let Some(decided) = read else {
            self.safety.packet_refused();
            return self.action(false);
        };
        // Only what could be read proves that a host is there.
        self.last_packet_us = now_us;
        self.action(decided)
    }

    /// Time now. When the clock goes back for a moment, time stands still: the same time must not count twice as a fall of
    /// the line or as age.
    #[inline]
    pub(super) fn passed_to(&mut self, now_us: u64) -> u64 {
        self.now_us = self.now_us.max(now_us);
        self.now_us
    }

    /// `None` when the packet is refused.
    #[inline(never)]
    fn head(&mut self, packet: &[u8]) -> Option<bool> {
        let abandoned = self.maps_in.head(packet).ok()?;
        self.partial = Accumulator::new(self.rule);
        if abandoned {
            self.safety.packet_refused();
        }
        Some(false)
    }

    /// `None` when the packet is refused.
    #[inline(never)]
    fn taxels(&mut self, packet: &[u8]) -> Option<bool> {
        let forces = self.maps_in.taxels(packet).ok()?;
        K::add(&mut self.partial, forces.places(), forces.bytes());
        Some(false)
    }

    /// Whether the map is new; `None` when the packet is refused.
    #[inline(never)]
    fn tail(&mut self, packet: &[u8]) -> Option<bool> {
        let (info, forces) = self.maps_in.tail(packet).ok()?;
        K::add(&mut self.partial, forces.places(), forces.bytes());
        Some(self.map(info))
    }

    /// Second half of the 1 kHz tick: what must be on the line now.
    #[inline]
    pub fn advance(&mut self, now_us: u64) -> Action {
        self.passed_to(now_us);
        self.action(false)
    }

    /// First half of the 1 kHz tick: what has become too old. In two halves, so that a packet need not wait for both.
    pub fn age(&mut self, now_us: u64) {
        let now_us = self.passed_to(now_us);
        self.safety.tick();
        self.learn();
        let holding = self.controller.mode() == GripMode::Hold;
        let older =
            |since_us: u64, limit_ms: u16| now_us.saturating_sub(since_us) > u64::from(limit_ms) * 1_000;
        let sensors = usize::from(self.settings.sensors);
        let stale = self
            .fingertips
            .iter()
            .take(sensors)
            .any(|tip| older(tip.fresh_us, self.settings.stale_ms));
        self.safety.set(Fault::StaleMaps, holding && stale);
        self.safety.set(
            Fault::LinkLost,
            holding && older(self.last_packet_us, self.settings.link_lost_ms),
        );
        if now_us.saturating_sub(self.last_status_us) >= u64::from(STATUS_PERIOD_MS) * 1_000 {
            self.send_status();
        }
    }

    /// Contact geometry, load and friction follow a tick after the map. They take too long for the map-to-line path, and a
    /// millisecond is short beside a gripper's lag. One fingertip a tick.
    #[inline(never)]
    fn learn(&mut self) {
        let [one, other] = &mut self.fingertips;
        let tip = if one.is_estimate_due { one } else { other };
        let is_new = core::mem::take(&mut tip.is_estimate_due);
        if is_new {
            tip.slip.observe(&tip.sums);
        }
        if !self.settings.learns() {
            return;
        }
        if is_new {
            let reached = self.controller.reached().lsb();
            tip.friction.observe(
                &tip.sums,
                tip.slip.geometry(),
                reached,
                self.now_us,
                &self.settings,
            );
        }
        let [one, other] = &self.fingertips;
        // A fingertip that fell silent under load must not squeeze on while the other one sends maps.
        let silent_us = self.now_us.saturating_sub(other.fresh_us);
        let counts = self.settings.sensors > 1 && silent_us <= u64::from(self.settings.stale_ms) * 1_000;
        let worst = if counts && other.friction.exceeds(&one.friction, &self.settings) {
            other
        } else {
            one
        };
        self.controller.learn(
            self.now_us,
            is_new.then_some((&worst.friction, worst.sums.force[2])),
            &self.settings,
        );
    }

    /// Takes the health of the line. The fault does not latch: a gripper that lost its activation needs a `Release`, which
    /// latched faults forbid.
    pub fn note_line(&mut self, health: LineHealth) {
        let failed = match health {
            LineHealth::Good => false,
            LineHealth::Starting => self.controller.mode() == GripMode::Hold,
            LineHealth::NoAnswer
            | LineHealth::NotActivated
            | LineHealth::GripperFault
            | LineHealth::NotTaken => true,
        };
        self.safety.set(Fault::LineFailed, failed);
    }

    /// Takes the core cycles of a stage. The worst goes out in every status.
    pub fn note_cycles(&mut self, stage: Stage, cycles: u32) {
        let worst = &mut self.worst_cycles[stage as usize];
        *worst = cycles.max(*worst);
        if stage == Stage::Decide {
            self.safety
                .set(Fault::DeadlineMissed, cycles > DECIDE_BUDGET_CYCLES);
        }
    }

    /// The state as it goes to the host.
    #[must_use]
    pub fn status(&self) -> Status {
        let tip = &self.fingertips[usize::from(self.newest.sensor).min(SENSORS - 1)];
        let evidence = self.evidence(u64::MAX);
        let [x, y, normal] = tip.sums.force;
        Status {
            uptime_ms: divide(self.now_us, 1_000) as u32,
            sensor: self.newest.sensor,
            sequence: self.newest.sequence,
            sums: tip.sums,
            coulomb_slip: self.rule.friction.exceeded_by([x, y], normal),
            state: evidence.state,
            time_to_slip_ms: tip.decision.time_to_slip_ms,
            mode: self.controller.mode(),
            line: self.line().lsb(),
            faults: self.safety.active().bits(),
            latched: self.safety.latched().bits(),
            maps: self.maps,
            maps_refused: self
                .maps_in
                .refused()
                .wrapping_add(self.maps_in.abandoned())
                .wrapping_add(self.maps_refused),
            packets_refused: self.maps_in.refused(),
            worst_cycles: self.worst_cycles,
        }
    }

    /// The line as it is, after what moves it no further.
    pub(super) const fn unchanged(&self) -> Action {
        Action {
            line: self.line(),
            transmit: !self.outbox.is_empty(),
            decided: false,
        }
    }

    fn action(&mut self, decided: bool) -> Action {
        let line = self
            .controller
            .advance(self.now_us, self.safety.guard(), &self.settings);
        let holding = self.controller.mode() == GripMode::Hold;
        self.safety.set(
            Fault::LineAtCeiling,
            holding && line.lsb() >= self.settings.ceiling,
        );
        Action {
            line,
            transmit: !self.outbox.is_empty(),
            decided,
        }
    }

    /// A map arrived whole. Returns whether it was new.
    fn map(&mut self, info: MapInfo) -> bool {
        // The parser lets no other sensor through.
        let Some(tip) = self.fingertips.get_mut(usize::from(info.sensor)) else {
            return false;
        };
        let Order::New { lost } = tip.sequence.check(info.sequence) else {
            return self.refuse_map(Fault::ReplayedMap);
        };
        let CaptureTime::Late { us: late_us } = tip.clock.check(info.capture_us, self.now_us) else {
            return self.refuse_map(Fault::FutureMap);
        };
        tip.sequence.accept(info.sequence);
        tip.sums = self.partial.finish();
        tip.shear = total_shear(&tip.sums);
        tip.is_estimate_due = true;
        tip.decision = tip
            .slip
            .update(&tip.sums, info.capture_us, self.now_us, &self.settings);
        tip.fresh_us = self.now_us.saturating_sub(late_us.into());
        tip.health = info.health;
        self.newest = info;
        self.maps = self.maps.wrapping_add(1);
        self.safety.set(Fault::ReplayedMap, false);
        self.safety.set(Fault::FutureMap, false);
        self.safety.set(Fault::MapsLost, lost > 0);
        let sensors = usize::from(self.settings.sensors);
        let health = self
            .fingertips
            .iter()
            .take(sensors)
            .fold(Health::GOOD, |all, tip| all.with(tip.health));
        self.safety
            .set(Fault::SaturatedMap, health.has(Health::SATURATED));
        self.safety
            .set(Fault::UnhealthyMap, !health.without(Health::SATURATED).is_good());
        // A fingertip that fell silent in slip must not squeeze on while the other one sends maps.
        let evidence = self.evidence(u64::from(self.settings.stale_ms) * 1_000);
        self.controller.observe(evidence, self.now_us);
        self.send_status();
        true
    }

    /// Refuses a map whose packets were right.
    fn refuse_map(&mut self, fault: Fault) -> bool {
        self.maps_refused = self.maps_refused.wrapping_add(1);
        self.safety.set(fault, true);
        false
    }

    /// The worst of the fingertips' maps within the last `age_us`.
    fn evidence(&self, age_us: u64) -> Evidence {
        let mut worst = Evidence {
            has_spare: true,
            ..Evidence::default()
        };
        let sensors = usize::from(self.settings.sensors);
        let recent = |tip: &&Fingertip| self.now_us.saturating_sub(tip.fresh_us) <= age_us;
        for tip in self.fingertips.iter().take(sensors).filter(recent) {
            if severity(tip.decision.state) > severity(worst.state) {
                worst.state = tip.decision.state;
            }
            worst.stick_ratio = match (worst.stick_ratio, tip.decision.stick_ratio) {
                (Some(one), Some(other)) => Some(one.min(other)),
                (one, other) => one.or(other),
            };
            worst.shear = worst.shear.max(tip.shear);
            let one_less = MapSums {
                stick: tip.sums.stick.saturating_sub(1),
                ..tip.sums
            };
            worst.has_spare &= !stick_ratio_below(&one_less, self.settings.reflex_target);
        }
        worst
    }

    pub(super) fn send_status(&mut self) {
        self.outbox.status = true;
        self.last_status_us = self.now_us;
    }

    /// State over all fingertips.
    #[must_use]
    pub fn state(&self) -> SlipState {
        self.evidence(u64::MAX).state
    }
}
