//! The microcontroller's program: packets and time in, the line's value and packets for the host out.
//!
//! Work per packet is bounded: taxels are added as they land, so after a map's last packet only its own taxels, the
//! CRC and the decision remain. A map whose CRC, order or sequence is wrong changes nothing.
//! Units: forces 1/4096 N, time in µs since start (u64: no wrap). No allocation, no panic, no IO.

use core::marker::PhantomData;

use gripline_protocol::message::{
    Command, Configuration, GripMode, Hello, LineSettings, MapSums, Message, MessagePackets, OutOfRange,
    Refusal, Report, Revision, STAGES, SlipState, Stage, Status,
};
use gripline_protocol::packet::Kind;
use gripline_protocol::sequence::{Order, SequenceWatch};
use gripline_protocol::{Health, MapInfo, PACKET_MAX, Parser, SENSORS};

use crate::carry::Carried;
use crate::clock::{CaptureClock, CaptureTime};
use crate::constants::{DECIDE_BUDGET_CYCLES, STATUS_PERIOD_MS};
use crate::divide::divide;
use crate::grip::{Evidence, GripController, GripForce};
use crate::line::LineHealth;
use crate::safety::{Fault, Safety};
use crate::slip::{Judgement, SlipDetector, severity};
use crate::storage::Stored;
use crate::sums::{Accumulator, Kernel, Portable, TaxelRule, stick_ratio_below, total_shear};

/// Why the controller started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// Power came on, or somebody reset it: the reset pin, a debug probe.
    #[default]
    PowerOn,
    /// The program hung.
    Watchdog,
    /// The program panicked, or ran into a fault of the core.
    Software,
}

/// What the controller knows when it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// Time now, µs.
    pub now_us: u64,
    /// Why it started.
    pub reset: ResetCause,
    /// The line's value before a reset, from memory that survives it.
    pub restored_line: Option<GripForce>,
    /// The settings that lay in flash.
    pub stored: Stored,
    /// Number of the board, for the handshake.
    pub board: u8,
    /// The commit that the image was built from, for the handshake.
    pub revision: Option<Revision>,
    /// A number that differs from start to start, for the handshake.
    pub session: u32,
}

impl Start {
    /// The line's settings are taken at the start.
    fn line_in_force(&self) -> &LineSettings {
        match &self.stored.settings {
            Some(settings) => &settings.line,
            None => &LineSettings::DEFAULT,
        }
    }
}

/// What to do after a packet or a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use = "the line must be written"]
pub struct Action {
    /// What must be on the line now.
    pub line: GripForce,
    /// [`Mcu::poll_transmit`] has something for the host.
    pub transmit: bool,
    /// A map was accepted by this packet.
    pub decided: bool,
}

/// A message from the host, read and checked. Reading takes long and touches nothing, doing it ([`Mcu::request`]) takes
/// little: so a board can read while maps go to the line.
#[derive(Debug, Clone, Copy)]
pub enum Request {
    /// No message of ours.
    Unreadable,
    /// A report, which a host would not send.
    Report,
    /// The handshake.
    Hello {
        /// Who speaks.
        hello: Hello,
        /// It speaks our schema.
        known: bool,
    },
    /// A setting that is not in range, so that none of them counts.
    OutOfRange(OutOfRange),
    /// Anything else that a host may want.
    Command {
        /// What.
        command: Command,
        /// What new settings make of a taxel.
        rule: Option<TaxelRule>,
    },
}

impl Request {
    /// What a message says; settings must fit the line that is in force.
    #[must_use]
    pub fn read(message: &[u8], in_force: &LineSettings) -> Self {
        match Message::from_bytes(message) {
            Err(_) => Self::Unreadable,
            Ok(Message::Report(_)) => Self::Report,
            Ok(Message::Hello(hello)) => Self::Hello {
                hello,
                known: hello.check().is_ok(),
            },
            Ok(Message::Command(command)) => {
                let rule = match &command {
                    Command::Configure(settings) => match settings.check_on(in_force) {
                        Ok(()) => Some(TaxelRule::of(settings)),
                        Err(error) => return Self::OutOfRange(error),
                    },
                    _ => None,
                };
                Self::Command { command, rule }
            }
        }
    }
}

/// One fingertip: what it said last.
#[derive(Debug, Clone, Copy, Default)]
struct Fingertip {
    sequence: SequenceWatch,
    slip: SlipDetector,
    judgement: Judgement,
    sums: MapSums,
    shear: i32,
    load: Carried,
    /// Its newest map is not in `load` yet.
    is_load_due: bool,
    clock: CaptureClock,
    /// When its last map would have come had it been prompt, or holding began, µs.
    fresh_us: u64,
    health: Health,
}

/// What waits to be sent. Only the newest of each kind: the host always wants the present.
#[derive(Debug, Default)]
struct Outbox {
    hello: bool,
    status: bool,
    configuration: bool,
    stored: Option<u32>,
    refusal: Option<Refusal>,
    sending: Option<MessagePackets>,
    next_id: u8,
}

impl Outbox {
    fn is_empty(&self) -> bool {
        !(self.hello || self.status || self.configuration)
            && self.stored.is_none()
            && self.refusal.is_none()
            && self.sending.is_none()
    }
}

/// The whole program. About 2 KiB.
#[derive(Debug)]
pub struct Mcu<K = Portable> {
    kernel: PhantomData<K>,
    start: Start,
    settings: Configuration,
    rule: TaxelRule,
    parser: Parser,
    /// Sums of the map under way; void until its CRC is known to be right.
    partial: Accumulator,
    fingertips: [Fingertip; SENSORS],
    newest: MapInfo,
    controller: GripController,
    safety: Safety,
    outbox: Outbox,
    /// `Store` was asked for and not carried out yet.
    store: bool,
    host: Option<Hello>,
    now_us: u64,
    last_packet_us: u64,
    last_status_us: u64,
    maps: u32,
    /// Maps whose packets were right but which were old or from the future.
    maps_refused: u32,
    worst_cycles: [u32; STAGES],
}

impl Mcu {
    /// [`Mcu::with_kernel`] with the kernel of every host.
    #[must_use]
    pub fn new(start: Start) -> Self {
        Self::with_kernel(start)
    }
}

impl<K: Kernel> Mcu<K> {
    /// Starts with the stored settings or the default ones: released, or holding the restored line.
    #[must_use]
    pub fn with_kernel(start: Start) -> Self {
        let settings = start.stored.settings.unwrap_or(Configuration::DEFAULT);
        let mut safety = Safety::new();
        if start.reset != ResetCause::PowerOn {
            safety.set(Fault::WatchdogReset, true);
            safety.set(Fault::WatchdogReset, false); // over, but a person must know
        }
        safety.set(Fault::SettingsLost, start.stored.lost);
        Self {
            kernel: PhantomData,
            start,
            rule: TaxelRule::of(&settings),
            settings,
            parser: Parser::new(),
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

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &Configuration {
        &self.settings
    }

    /// Takes one packet of at most 64 bytes as it landed (COBS already undone).
    ///
    /// A board that has something more urgent to do than messages takes their packets apart itself (`MessageParser`,
    /// [`Request::read`]) and tells what came of it: [`Mcu::fragment`], [`Mcu::request`], [`Mcu::malformed_frame`].
    pub fn packet(&mut self, packet: &[u8], now_us: u64) -> Action {
        if Kind::of(packet) != Some(Kind::Message) {
            return self.map_packet(packet, now_us);
        }
        let now_us = self.passed_to(now_us);
        let request = match self.parser.fragment(packet) {
            Ok(None) => None,
            Ok(Some(message)) => Some(Request::read(message, self.start.line_in_force())),
            Err(_) => {
                self.safety.packet_refused();
                return self.action(false);
            }
        };
        match request {
            None => self.fragment(now_us),
            Some(request) => self.request(&request, now_us),
        }
        self.action(false)
    }

    /// Takes one packet that is no [`Kind::Message`]: the way from map to line.
    #[inline]
    pub fn map_packet(&mut self, packet: &[u8], now_us: u64) -> Action {
        let now_us = self.passed_to(now_us);
        let read = match Kind::of(packet) {
            Some(Kind::MapTail) => self.tail(packet),
            Some(Kind::MapTaxels) => self.taxels(packet),
            Some(Kind::MapHead) => self.head(packet),
            Some(Kind::Message) | None => {
                self.parser.unknown(packet);
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

    /// Time now. A clock that goes back for a moment stands still: what it takes back must not count twice, as a fall of
    /// the line or as age.
    #[inline]
    fn passed_to(&mut self, now_us: u64) -> u64 {
        self.now_us = self.now_us.max(now_us);
        self.now_us
    }

    /// `None` when the packet is refused.
    #[inline(never)]
    fn head(&mut self, packet: &[u8]) -> Option<bool> {
        let abandoned = self.parser.head(packet).ok()?;
        self.partial = Accumulator::new(self.rule);
        if abandoned {
            self.safety.packet_refused();
        }
        Some(false)
    }

    /// `None` when the packet is refused.
    #[inline(never)]
    fn taxels(&mut self, packet: &[u8]) -> Option<bool> {
        let forces = self.parser.taxels(packet).ok()?;
        K::add(&mut self.partial, forces.places(), forces.bytes());
        Some(false)
    }

    /// Whether the map is new; `None` when the packet is refused.
    #[inline(never)]
    fn tail(&mut self, packet: &[u8]) -> Option<bool> {
        let (info, forces) = self.parser.tail(packet).ok()?;
        K::add(&mut self.partial, forces.places(), forces.bytes());
        Some(self.map(info))
    }

    /// A part of a message came, and is kept until the rest has come.
    pub fn fragment(&mut self, now_us: u64) {
        let now_us = self.passed_to(now_us);
        self.last_packet_us = now_us;
    }

    /// Does what a message asks for. The line follows with the next packet or tick.
    pub fn request(&mut self, request: &Request, now_us: u64) {
        let now_us = self.passed_to(now_us);
        if matches!(request, Request::Unreadable) {
            self.safety.set(Fault::UnreadableMessage, true);
            return self.refuse(Refusal::Unreadable);
        }
        self.safety.set(Fault::UnreadableMessage, false);
        match request {
            Request::Hello { hello, known } => self.hello(hello, *known),
            // Nothing a host would send.
            Request::Report | Request::Unreadable => self.refuse(Refusal::Unreadable),
            _ if self.host.is_none() => self.refuse(Refusal::NoHandshake),
            Request::OutOfRange(error) => {
                self.safety.set(Fault::OutOfRange, true);
                self.refuse(Refusal::OutOfRange(*error));
            }
            Request::Command { command, rule } => self.command(command, *rule),
        }
        self.last_packet_us = now_us;
    }

    /// The transport itself refused a frame (COBS), or a part of a message was not the one that had to come.
    pub fn malformed_frame(&mut self) {
        self.parser.refuse();
        self.safety.packet_refused();
    }

    /// The 1 kHz tick: ages, faults, slew.
    pub fn tick(&mut self, now_us: u64) -> Action {
        self.age(now_us);
        self.advance(now_us)
    }

    /// The second half of [`Mcu::tick`]: what must be on the line now.
    #[inline]
    pub fn advance(&mut self, now_us: u64) -> Action {
        self.passed_to(now_us);
        self.action(false)
    }

    /// The first half of [`Mcu::tick`]: what has become too old. A board that must not be held up for long may let a
    /// packet in between the halves.
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

    /// What a map says of form, load and friction comes a tick later than the map: it is too long for the way from map to
    /// line, and a millisecond is nothing beside a gripper's lag. One fingertip a tick.
    #[inline(never)]
    fn learn(&mut self) {
        let [one, other] = &mut self.fingertips;
        let tip = if one.is_load_due { one } else { other };
        let is_new = core::mem::take(&mut tip.is_load_due);
        if is_new {
            tip.slip.observe(&tip.sums);
        }
        if !self.settings.learns() {
            return;
        }
        if is_new {
            let reached = self.controller.reached().lsb();
            tip.load
                .observe(&tip.sums, tip.slip.form(), reached, self.now_us, &self.settings);
        }
        let [one, other] = &self.fingertips;
        // A fingertip that fell silent under load must not squeeze on while the other one speaks.
        let silent_us = self.now_us.saturating_sub(other.fresh_us);
        let counts = self.settings.sensors > 1 && silent_us <= u64::from(self.settings.stale_ms) * 1_000;
        let worst = if counts && other.load.exceeds(&one.load, &self.settings) {
            other
        } else {
            one
        };
        self.controller.learn(
            self.now_us,
            is_new.then_some((&worst.load, worst.sums.force[2])),
            &self.settings,
        );
    }

    /// How the line is doing. Not latched: a gripper that lost its activation needs a `Release`, which latched faults
    /// forbid.
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

    /// A stage took so many core cycles; the worst goes out in every status.
    pub fn note_cycles(&mut self, stage: Stage, cycles: u32) {
        let worst = &mut self.worst_cycles[stage as usize];
        *worst = cycles.max(*worst);
        if stage == Stage::Decide {
            self.safety
                .set(Fault::DeadlineMissed, cycles > DECIDE_BUDGET_CYCLES);
        }
    }

    /// The next message for the host, or `None`: for a board that makes packets of it where time does not matter.
    pub fn poll_message(&mut self) -> Option<Message> {
        self.next_message()
    }

    /// The next packet for the host and its length, or `None`.
    pub fn poll_transmit(&mut self, packet: &mut [u8; PACKET_MAX]) -> Option<usize> {
        loop {
            if let Some(sending) = &mut self.outbox.sending {
                if let Some(length) = sending.next_packet(packet) {
                    return Some(length);
                }
                self.outbox.sending = None;
            }
            let message = self.next_message()?;
            self.outbox.next_id = self.outbox.next_id.wrapping_add(1);
            // Every message fits, as a test shows; one that did not would be left out.
            self.outbox.sending = MessagePackets::new(&message, self.outbox.next_id).ok();
        }
    }

    /// The state as it goes to the host.
    #[must_use]
    pub fn status(&self) -> Status {
        let tip = &self.fingertips[usize::from(self.newest.sensor).min(SENSORS - 1)];
        let counters = self.parser.counters();
        let evidence = self.evidence(u64::MAX);
        let [x, y, normal] = tip.sums.force;
        Status {
            uptime_ms: divide(self.now_us, 1_000) as u32,
            sensor: self.newest.sensor,
            sequence: self.newest.sequence,
            sums: tip.sums,
            coulomb_slip: self.rule.friction.exceeded_by([x, y], normal),
            state: evidence.state,
            time_to_slip_ms: tip.judgement.time_to_slip_ms,
            mode: self.controller.mode(),
            line: self.line().lsb(),
            faults: self.safety.active(),
            latched: self.safety.latched(),
            maps: self.maps,
            maps_refused: counters
                .refused
                .wrapping_add(counters.abandoned)
                .wrapping_add(self.maps_refused),
            packets_refused: counters.refused,
            worst_cycles: self.worst_cycles,
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
        let Order::New { lost } = tip.sequence.judge(info.sequence) else {
            return self.refuse_map(Fault::ReplayedMap);
        };
        let CaptureTime::Late { us: late_us } = tip.clock.judge(info.capture_us, self.now_us) else {
            return self.refuse_map(Fault::FutureMap);
        };
        tip.sequence.accept(info.sequence);
        tip.sums = self.partial.finish();
        tip.shear = total_shear(&tip.sums);
        tip.is_load_due = true;
        tip.judgement = tip
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
        // A fingertip that fell silent in slip must not squeeze on while the other one speaks.
        let evidence = self.evidence(u64::from(self.settings.stale_ms) * 1_000);
        self.controller.observe(evidence, self.now_us);
        self.send_status();
        true
    }

    /// A map whose packets were right and which is refused all the same.
    fn refuse_map(&mut self, fault: Fault) -> bool {
        self.maps_refused = self.maps_refused.wrapping_add(1);
        self.safety.set(fault, true);
        false
    }

    /// The worst of what the fingertips said within the last `age_us`.
    fn evidence(&self, age_us: u64) -> Evidence {
        let mut worst = Evidence {
            has_spare: true,
            ..Evidence::default()
        };
        let sensors = usize::from(self.settings.sensors);
        let recent = |tip: &&Fingertip| self.now_us.saturating_sub(tip.fresh_us) <= age_us;
        for tip in self.fingertips.iter().take(sensors).filter(recent) {
            if severity(tip.judgement.state) > severity(worst.state) {
                worst.state = tip.judgement.state;
            }
            worst.stick_ratio = match (worst.stick_ratio, tip.judgement.stick_ratio) {
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

    /// Answers in any case, so that a host with another schema can name both versions.
    fn hello(&mut self, hello: &Hello, known: bool) {
        self.outbox.hello = true;
        self.safety.set(Fault::SchemaMismatch, !known);
        let restarted = self.host.is_none_or(|host| host.session != hello.session);
        self.host = known.then_some(*hello);
        if known && restarted {
            // A host that restarts counts its maps, and its time, from anywhere.
            for tip in &mut self.fingertips {
                tip.sequence = SequenceWatch::new();
                tip.clock = CaptureClock::new();
            }
            self.safety.set(Fault::FutureMap, false);
            self.safety.set(Fault::ReplayedMap, false);
        }
    }

    fn command(&mut self, command: &Command, rule: Option<TaxelRule>) {
        match command {
            Command::Configure(settings) => {
                self.safety.set(Fault::OutOfRange, false);
                self.safety.set(Fault::SettingsLost, false);
                self.settings = *settings;
                // There is one, as the settings are in range.
                self.rule = rule.unwrap_or(self.rule);
                // Sums under way were made by the old rule.
                self.parser.drop_map();
                self.outbox.configuration = true;
            }
            Command::ReadConfiguration => self.outbox.configuration = true,
            Command::Store if self.may_store() => self.store = true,
            Command::Store => self.refuse(Refusal::Holding),
            Command::Hold => {
                self.controller.set_mode(GripMode::Hold);
                for tip in &mut self.fingertips {
                    tip.fresh_us = self.now_us;
                }
            }
            Command::Release if self.safety.latched() != 0 => self.refuse(Refusal::Latched),
            Command::Release => self.controller.set_mode(GripMode::Released),
            Command::Acknowledge { faults } => self.safety.acknowledge(*faults),
            Command::ReadStatus => self.send_status(),
        }
    }

    /// Nothing can be in the gripper: writing the flash stops the processor.
    fn may_store(&self) -> bool {
        self.controller.mode() == GripMode::Released && self.line() == GripForce::ZERO
    }

    /// The settings that now have to be written to flash, once per `Store`; asked for between two ticks, off the way
    /// from map to line. What came of it goes to [`Self::stored`].
    pub fn take_store(&mut self) -> Option<Configuration> {
        if !core::mem::take(&mut self.store) {
            return None;
        }
        if !self.may_store() {
            self.refuse(Refusal::Holding);
            return None;
        }
        Some(self.settings)
    }

    /// The settings lie in flash, written so many times since the chip was new; or they do not.
    pub fn stored(&mut self, writes: Option<u32>) {
        match writes {
            Some(writes) => self.outbox.stored = Some(writes),
            None => self.refuse(Refusal::FlashFailed),
        }
    }

    fn refuse(&mut self, refusal: Refusal) {
        self.outbox.refusal = Some(refusal);
    }

    fn send_status(&mut self) {
        self.outbox.status = true;
        self.last_status_us = self.now_us;
    }

    fn next_message(&mut self) -> Option<Message> {
        if core::mem::take(&mut self.outbox.hello) {
            return Some(Message::Hello(Hello {
                revision: self.start.revision,
                ..Hello::of_this_build(self.start.board, self.start.session)
            }));
        }
        if let Some(refusal) = self.outbox.refusal.take() {
            return Some(Message::Report(Report::Refused(refusal)));
        }
        if core::mem::take(&mut self.outbox.configuration) {
            return Some(Message::Report(Report::Configuration(self.settings)));
        }
        if let Some(writes) = self.outbox.stored.take() {
            return Some(Message::Report(Report::Stored { writes }));
        }
        if core::mem::take(&mut self.outbox.status) {
            return Some(Message::Report(Report::Status(self.status())));
        }
        None
    }

    /// State over all fingertips.
    #[must_use]
    pub fn state(&self) -> SlipState {
        self.evidence(u64::MAX).state
    }
}
