//! The program's dispatch: packets of maps and time in, the line's value out.
//!
//! The work per packet is bounded. Taxels are added as they arrive; after a map's last packet only its own taxels, the CRC
//! and the decision remain. A map whose CRC, order or sequence is wrong changes nothing.
//! Units: forces 1/4096 N, time µs since start (u64: no wrap). No allocation, no panic, no IO.

use core::marker::PhantomData;

use gripline_protocol::message::{
    Configuration, GripMode, MapSums, STAGES, SlipState, Stage, Status, Witnesses,
};
use gripline_protocol::packet::Kind;
use gripline_protocol::rounds::at_most;
use gripline_protocol::sequence::{Order, SequenceTracker};
use gripline_protocol::{Health, MapInfo, Motion, SENSORS, SensorId};

use super::bootloader_request::BootloaderRequest;
use super::learner::Taught;
use super::map_source::MapSource;
use super::object::Object;
use super::outbox::Outbox;
use super::receiver::{Breakage, Receiver};
use super::start::Start;
use crate::arithmetic::divide;
use crate::clock::{DeviceMicros, HostMicros};
use crate::clock_sync::{CaptureTime, ClockSync};
use crate::constants::{DECIDE_BUDGET_CYCLES, FALL_EVIDENCE_MAX, STATUS_PERIOD_MS};
use crate::fault::{Fault, FaultSet};
use crate::grip::{Evidence, GripController, GripForce};
use crate::line::LineHealth;
use crate::link::{LINKS, LinkId};
use crate::safety::Safety;
use crate::slide_witness::{JointTest, Verdict};
use crate::slip::{SlipDecision, first_decision, worse};
use crate::sums::{Kernel, Portable, TaxelRule, stick_ratio_below, total_shear};

/// What to do after a packet of a map or a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "the line must be written"]
pub struct Action {
    /// The force that the line must show now.
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
    pub(super) decision: SlipDecision,
    pub(super) sums: MapSums,
    shear: i32,
    pub(super) taught: Taught,
    pub(super) motion: Motion,
    pub(super) capture: HostMicros,
    /// Good maps so far; wraps.
    pub(super) map: u32,
    /// `taught` does not include the newest map yet.
    pub(super) is_due: bool,
    /// The grip has not taken over `taught` yet.
    pub(super) is_news: bool,
    pub(super) clock: ClockSync,
    /// When its last map would have arrived without delay, or when holding began, µs.
    pub(super) fresh_us: u64,
    /// When its last map arrived, µs.
    pub(super) arrived_us: u64,
    pub(super) health: Health,
}

impl Fingertip {
    /// The host doubts its newest map. A map that was only clipped by the wire's limits is not doubtful.
    fn is_doubtful(&self) -> bool {
        !self.health.without(Health::SATURATED).is_good()
    }

    /// What its newest map says.
    fn evidence(&self, reflex_target: u16) -> Evidence {
        let one_less = MapSums {
            stick: self.sums.stick.saturating_sub(1),
            ..self.sums
        };
        Evidence {
            state: self.decision.state,
            stick_ratio: self.decision.stick_ratio,
            shear: self.shear.max(0),
            has_spare: !self.is_doubtful() && !stick_ratio_below(&one_less, reflex_target),
        }
    }
}

/// The microcontroller's program, about 2 KiB. Hosts drive it through [`Device`](super::Device).
#[derive(Debug)]
pub struct Program<K = Portable> {
    kernel: PhantomData<K>,
    pub(super) start: Start,
    pub(super) settings: Configuration,
    pub(super) rule: TaxelRule,
    pub(super) receivers: [Receiver; LINKS],
    pub(super) fingertips: [Fingertip; SENSORS],
    map_source: MapSource,
    newest: MapInfo,
    /// The fingertip whose load the grip follows.
    neediest: SensorId,
    /// Who takes part in the present test of a slide.
    joint_test: JointTest,
    pub(super) controller: GripController,
    pub(super) safety: Safety,
    pub(super) outbox: Outbox,
    pub(super) object: Object,
    /// The release-inhibit input is active.
    pub(super) is_release_inhibited: bool,
    /// `Store` was requested and is not done yet.
    pub(super) store: bool,
    /// A `Release` was accepted and the line was not told yet.
    pub(super) release: bool,
    pub(super) bootloader: BootloaderRequest,
    /// The session of the host that shook hands and speaks our schema.
    pub(super) host_session: Option<u32>,
    pub(super) now_us: u64,
    pub(super) last_packet_us: u64,
    pub(super) last_status_us: u64,
    maps: u32,
    /// Maps that were old, from the future, or of the link whose maps do not count.
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
        if let Some(fault) = start.reset.fault() {
            safety.set(fault, true);
            safety.set(fault, false); // over, but a person must see it
        }
        safety.set(Fault::SettingsLost, start.stored.lost);
        Self {
            kernel: PhantomData,
            start,
            rule: TaxelRule::of(&settings),
            settings,
            receivers: LinkId::ALL.map(|_| Receiver::new(&settings)),
            fingertips: [Fingertip {
                fresh_us: start.now_us,
                arrived_us: start.now_us,
                ..Fingertip::default()
            }; SENSORS],
            map_source: MapSource::new(),
            newest: MapInfo::default(),
            neediest: SensorId::FIRST,
            joint_test: JointTest::default(),
            controller: GripController::new(start.now_us, start.restored_line),
            safety,
            outbox: Outbox::default(),
            object: Object::default(),
            is_release_inhibited: false,
            store: false,
            release: false,
            bootloader: BootloaderRequest::default(),
            host_session: None,
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

    /// The active faults, for a log of changes.
    #[must_use]
    pub const fn faults(&self) -> FaultSet {
        self.safety.active()
    }

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &Configuration {
        &self.settings
    }

    /// Takes one packet of a link that is no [`Kind::Message`]: the map-to-line path.
    #[inline]
    pub fn map_packet(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        match Kind::of(packet) {
            Some(Kind::MapTail) => self.map_tail(packet, link, now_us),
            Some(Kind::MapTaxels) => self.map_taxels(packet, link, now_us),
            Some(Kind::MapHead) => self.map_head(packet, link, now_us),
            Some(Kind::Message) | None => self.unknown_packet(packet, link, now_us),
        }
    }

    /// [`Self::map_packet`] of a [`Kind::MapTail`]. It moves the line when it completes a map that counts.
    #[inline]
    pub fn map_tail(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        let is_new = self.end_map(packet, link, now_us);
        self.decide(is_new)
    }

    /// The first part of [`Self::map_tail`]: takes the packet. Returns whether it ends a new map, for [`Self::decide`].
    #[inline]
    pub fn end_map(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> bool {
        self.passed_to(now_us);
        self.map_source.is(link) && self.tail(packet, link)
    }

    /// The second part of [`Self::map_tail`]: moves the line, if the map is new.
    #[inline]
    pub fn decide(&mut self, is_new: bool) -> Action {
        if is_new {
            self.action(true)
        } else {
            self.unchanged()
        }
    }

    /// [`Self::map_packet`] of a [`Kind::MapTaxels`]. It does not move the line: only complete maps and the tick do.
    #[inline]
    pub fn map_taxels(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        self.passed_to(now_us);
        if self.map_source.is(link) {
            self.taxels(packet, link);
        }
        self.unchanged()
    }

    /// [`Self::map_packet`] of a [`Kind::MapHead`].
    #[inline]
    pub fn map_head(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        if self.may_begin(link, now_us) {
            self.head(packet, link);
        }
        self.unchanged()
    }

    /// As [`Self::map_head`], for a link that delivers byte by byte: call [`Self::list_places`] with each of the next bytes.
    #[inline]
    pub fn map_begins(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        if self.may_begin(link, now_us) {
            self.begin(packet, link);
        }
        self.unchanged()
    }

    /// Whether a map of this link may begin.
    #[inline]
    fn may_begin(&mut self, link: LinkId, now_us: u64) -> bool {
        let now_us = self.passed_to(now_us);
        if self.map_source.is(link) {
            return true;
        }
        let takes_over = self.map_source.take_over(link, now_us, self.settings.stale_ms);
        if takes_over {
            self.expect_another_host();
        } else {
            self.maps_refused = self.maps_refused.wrapping_add(1);
        }
        takes_over
    }

    /// Another host, or one that restarted, counts its maps, and its time, from anywhere.
    #[cold]
    pub(super) fn expect_another_host(&mut self) {
        for tip in at_most::<SENSORS, _>(&mut self.fingertips) {
            tip.sequence = SequenceTracker::new();
            tip.clock = ClockSync::new();
        }
        self.safety.set(Fault::FutureMap, false);
        self.safety.set(Fault::ReplayedMap, false);
    }

    /// Whether the maps of this link count.
    #[inline]
    #[must_use]
    pub fn counts_maps_of(&self, link: LinkId) -> bool {
        self.map_source.is(link)
    }

    /// A part of the work that [`Self::map_begins`] left.
    #[inline]
    pub fn list_places(&mut self, link: LinkId) {
        let receiver = &mut self.receivers[link as usize];
        if self.map_source.is(link) && receiver.has_places_to_list() {
            receiver.list_places();
        }
    }

    /// [`Self::map_packet`] of a packet without a readable header.
    #[inline]
    pub fn unknown_packet(&mut self, packet: &[u8], link: LinkId, now_us: u64) -> Action {
        self.passed_to(now_us);
        let breakage = self.receivers[link as usize].unknown(packet);
        self.count_breakage(breakage, link);
        self.unchanged()
    }

    /// Counts a refused packet towards a CRC storm of its link.
    pub(super) fn count_breakage(&mut self, breakage: Breakage, link: LinkId) {
        match breakage {
            Breakage::Map => self.safety.map_broken(link),
            Breakage::Packet => self.safety.packet_refused(link),
            Breakage::Counted => {}
        }
    }

    /// The present time. It never goes back: the same time must not count twice as a fall of the line or as age.
    #[inline]
    pub(super) fn passed_to(&mut self, now_us: u64) -> u64 {
        self.now_us = self.now_us.max(now_us);
        self.now_us
    }

    #[inline(never)]
    fn head(&mut self, packet: &[u8], link: LinkId) {
        let begun = self.receivers[link as usize].head(packet, self.rule);
        self.begun(begun, link);
    }

    #[inline(never)]
    fn begin(&mut self, packet: &[u8], link: LinkId) {
        let begun = self.receivers[link as usize].begin(packet, self.rule);
        self.begun(begun, link);
    }

    #[inline]
    fn begun(&mut self, begun: Result<bool, Breakage>, link: LinkId) {
        match begun {
            Ok(cuts_off) => {
                self.last_packet_us = self.now_us;
                if cuts_off {
                    self.safety.map_broken(link);
                }
            }
            Err(breakage) => self.count_breakage(breakage, link),
        }
    }

    #[inline(never)]
    fn taxels(&mut self, packet: &[u8], link: LinkId) {
        match self.receivers[link as usize].taxels::<K>(packet) {
            Ok(()) => self.last_packet_us = self.now_us,
            Err(breakage) => self.count_breakage(breakage, link),
        }
    }

    /// Returns whether the map is new.
    #[inline(never)]
    fn tail(&mut self, packet: &[u8], link: LinkId) -> bool {
        match self.receivers[link as usize].tail::<K>(packet) {
            Ok(info) => {
                // Only what could be read proves that a host is there.
                self.last_packet_us = self.now_us;
                self.map(info, link)
            }
            Err(breakage) => {
                self.count_breakage(breakage, link);
                false
            }
        }
    }

    /// Last part of the 1 kHz tick: the force that the line must show now. A board that lets the path run before it writes the line
    /// writes [`Self::line`], because a map may have moved it meanwhile.
    #[inline]
    pub fn advance(&mut self, now_us: u64) -> Action {
        self.passed_to(now_us);
        self.action(false)
    }

    /// First part of the 1 kHz tick: timeouts, and what forbids a fall. In parts, so that a packet waits for one of them only.
    pub fn age(&mut self, now_us: u64) {
        let now_us = self.passed_to(now_us);
        self.safety.tick();
        let holding = self.controller.mode() == GripMode::Hold;
        let older =
            |since_us: u64, limit_ms: u16| now_us.saturating_sub(since_us) > u64::from(limit_ms) * 1_000;
        let sensors = usize::from(self.settings.sensors);
        let stale = at_most::<SENSORS, _>(self.fingertips.iter().take(sensors))
            .any(|tip| older(tip.fresh_us, self.settings.stale_ms));
        self.safety.set(Fault::StaleMaps, holding && stale);
        self.safety.set(
            Fault::LinkLost,
            holding && older(self.last_packet_us, self.settings.link_lost_ms),
        );
        // The stick ratio is no reason: it is 0 in every firm grip on an object whose friction is well above the detector's.
        let (_, witnesses) = self.slip_evidence();
        let may_slide = witnesses.unrest.max(witnesses.motion) >= FALL_EVIDENCE_MAX;
        self.controller.watch(now_us, may_slide);
        if now_us.saturating_sub(self.last_status_us) >= u64::from(STATUS_PERIOD_MS) * 1_000 {
            self.send_status();
        }
    }

    /// Second part of the tick: the grip takes over what was learnt from new maps, and the elapsed time.
    #[inline(never)]
    pub fn teach_grip(&mut self) {
        let mut is_new = false;
        for tip in at_most::<SENSORS, _>(&mut self.fingertips) {
            is_new |= core::mem::take(&mut tip.is_news);
        }
        if !self.settings.learns() {
            self.controller.learn_nothing();
            return;
        }
        let [one, other] = &self.fingertips;
        // A fingertip that fell silent under load must not squeeze on while the other one sends maps.
        let is_silent = |tip: &Fingertip| {
            self.now_us.saturating_sub(tip.arrived_us) > u64::from(self.settings.stale_ms) * 1_000
        };
        let has_other = self.settings.sensors > 1;
        let are_silent = [is_silent(one), is_silent(other)];
        let other_is_worse = are_silent[0] || other.taught.load.exceeds(&one.taught.load);
        let is_other = has_other && !are_silent[1] && other_is_worse;
        let worst = if is_other { other } else { one };
        self.neediest = if is_other {
            SensorId::SECOND
        } else {
            SensorId::FIRST
        };
        // Without a new map it is not looked at.
        let witness = if has_other && is_new {
            let verdict = |is_silent: bool, tip: &Fingertip| {
                if is_silent {
                    Verdict::SILENT
                } else {
                    tip.taught.verdict
                }
            };
            let verdicts = [verdict(are_silent[0], one), verdict(are_silent[1], other)];
            self.joint_test.join(verdicts)
        } else {
            one.taught.verdict
        };
        self.controller.learn(
            self.now_us,
            is_new.then_some((worst.taught.load, worst.sums.force[2])),
            witness,
            &self.settings,
        );
    }

    /// Whether a *release* was accepted since the last call: then call [`GripLine::release`](crate::line::GripLine::release).
    pub fn take_release(&mut self) -> bool {
        core::mem::take(&mut self.release)
    }

    /// Takes the health of the line. The fault does not latch: a gripper that lost its activation needs a `Release`, which
    /// latched faults forbid.
    pub fn note_line(&mut self, health: LineHealth) {
        let failed = match health {
            LineHealth::Good | LineHealth::ObjectLost => false,
            LineHealth::Starting => self.controller.mode() == GripMode::Hold,
            LineHealth::NoAnswer
            | LineHealth::NotActivated
            | LineHealth::GripperFault
            | LineHealth::NotTaken => true,
        };
        self.object.is_lost_by_gripper = health == LineHealth::ObjectLost;
        self.safety.set(Fault::LineFailed, failed);
    }

    /// Takes the core cycles of a stage. Every status contains the maximum.
    pub fn note_cycles(&mut self, stage: Stage, cycles: u32) {
        let worst = &mut self.worst_cycles[stage as usize];
        *worst = cycles.max(*worst);
    }

    /// Takes the core cycles from the interrupt of a map's last packet to the line that the map led to.
    pub fn note_map_to_line(&mut self, cycles: u32) {
        self.safety
            .set(Fault::DeadlineMissed, cycles > DECIDE_BUDGET_CYCLES);
    }

    /// The status for the host.
    #[must_use]
    pub fn status(&self) -> Status {
        let tip = &self.fingertips[self.newest.sensor.index()];
        let (slip_evidence, witnesses) = self.slip_evidence();
        let [usb, uart] = &self.receivers;
        let [x, y, normal] = tip.sums.force;
        Status {
            uptime_ms: divide(self.now_us, 1_000) as u32,
            sensor: self.newest.sensor,
            sequence: self.newest.sequence,
            sums: tip.sums,
            coulomb_slip: self.rule.friction.exceeded_by([x, y], normal),
            state: self.state(),
            slip_evidence,
            witnesses,
            time_to_slip_ms: tip.decision.time_to_slip_ms,
            mode: self.controller.mode(),
            line: self.line().lsb(),
            faults: self.safety.active().bits(),
            latched: self.safety.latched().bits(),
            maps: self.maps,
            maps_refused: self
                .maps_refused
                .wrapping_add(usb.maps_broken())
                .wrapping_add(uart.maps_broken()),
            packets_refused: usb.refused().wrapping_add(uart.refused()),
            worst_cycles: self.worst_cycles,
        }
    }

    /// [`Program::poll_message`] has something for the host.
    #[must_use]
    pub const fn has_messages(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// The unchanged line.
    pub(super) const fn unchanged(&self) -> Action {
        Action {
            line: self.line(),
            transmit: self.has_messages(),
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
            transmit: self.has_messages(),
            decided,
        }
    }

    /// A map arrived whole. Returns whether it was new.
    fn map(&mut self, info: MapInfo, link: LinkId) -> bool {
        let tip = &mut self.fingertips[info.sensor.index()];
        let Order::New { lost } = tip.sequence.check(info.sequence) else {
            return self.refuse_map(Fault::ReplayedMap);
        };
        let CaptureTime::Late { us: late_us } = tip
            .clock
            .check(HostMicros(info.capture_us), DeviceMicros(self.now_us))
        else {
            return self.refuse_map(Fault::FutureMap);
        };
        tip.sequence.accept(info.sequence);
        self.map_source.keep(self.now_us, self.settings.stale_ms);
        tip.sums = self.receivers[link as usize].partial().finish();
        let shear = total_shear(&tip.sums);
        tip.fresh_us = self.now_us.saturating_sub(late_us.into());
        tip.health = info.health;
        let is_doubtful = tip.is_doubtful();
        if is_doubtful {
            // It ends no contact and teaches nothing; it may only ask for more grip.
            tip.shear = tip.shear.max(shear);
            tip.is_due = false;
        } else {
            tip.shear = shear;
            tip.arrived_us = self.now_us;
            tip.is_due = true;
            tip.map = tip.map.wrapping_add(1);
            tip.motion = info.motion;
            tip.capture = HostMicros(info.capture_us);
            tip.decision = first_decision(tip.decision, &tip.sums, self.settings.slip_threshold);
        }
        let reference = tip.taught.reference;
        self.newest = info;
        self.maps = self.maps.wrapping_add(1);
        self.safety.set(Fault::ReplayedMap, false);
        self.safety.set(Fault::FutureMap, false);
        self.safety.set(Fault::MapsLost, lost > 0);
        let sensors = usize::from(self.settings.sensors);
        // No loop: this is the path to the line.
        let [one, other] = &self.fingertips;
        let health = if sensors > 1 {
            one.health.with(other.health)
        } else {
            one.health
        };
        self.safety
            .set(Fault::SaturatedMap, health.has(Health::SATURATED));
        self.safety
            .set(Fault::UnhealthyMap, !health.without(Health::SATURATED).is_good());
        // A fingertip that fell silent in slip must not squeeze on while the other one sends maps.
        let evidence = self.evidence(u64::from(self.settings.stale_ms) * 1_000);
        if is_doubtful {
            self.controller.observe_doubtful(evidence.shear);
        } else {
            self.controller.observe(evidence, self.now_us);
            if info.sensor.index() < sensors {
                let before = if info.sensor == self.neediest {
                    self.controller.force()
                } else {
                    reference.force()
                };
                self.controller
                    .anticipate(before.saturating_add(reference.more(shear)));
            }
        }
        self.send_status();
        true
    }

    /// Refuses a map with correct packets.
    fn refuse_map(&mut self, fault: Fault) -> bool {
        self.maps_refused = self.maps_refused.wrapping_add(1);
        self.safety.set(fault, true);
        false
    }

    /// The worst of the fingertips' maps within the last `age_us`.
    fn evidence(&self, age_us: u64) -> Evidence {
        let (first, second) = self.recent(age_us);
        let target = self.settings.reflex_target;
        let worst = first.map_or(Evidence::NONE, |tip| tip.evidence(target));
        // No loop: the compiler would put its sums on the stack.
        second.map_or(worst, |tip| worst.with(tip.evidence(target)))
    }

    /// The worst state of the fingertips' maps within the last `age_us`.
    pub(super) fn state_within(&self, age_us: u64) -> SlipState {
        let (first, second) = self.recent(age_us);
        let state = |tip: Option<&Fingertip>| tip.map_or(SlipState::NoContact, |tip| tip.decision.state);
        worse(state(first), state(second))
    }

    /// The fingertips in use whose last good map came within the last `age_us`. By arrival: a late map says less about now, but its
    /// load must still raise the line.
    fn recent(&self, age_us: u64) -> (Option<&Fingertip>, Option<&Fingertip>) {
        let [one, other] = &self.fingertips;
        let since_us = self.now_us.saturating_sub(age_us);
        let is_recent = |tip: &&Fingertip| tip.arrived_us >= since_us;
        (
            Some(one).filter(is_recent),
            Some(other).filter(|tip| self.settings.sensors > 1 && is_recent(tip)),
        )
    }

    /// Whether every fingertip in use brought a good map within the last `age_us`.
    pub(super) fn has_maps_within(&self, age_us: u64) -> bool {
        let (first, second) = self.recent(age_us);
        first.is_some() && (second.is_some() || self.settings.sensors < 2)
    }

    /// The confidence of all fingertips' witnesses together, and of each by itself.
    fn slip_evidence(&self) -> (u16, Witnesses) {
        let [one, other] = &self.fingertips;
        let (one, other) = (&one.taught, &other.taught);
        if self.settings.sensors < 2 {
            return (one.slip_evidence, one.witnesses);
        }
        (
            one.slip_evidence.max(other.slip_evidence),
            one.witnesses.max(other.witnesses),
        )
    }

    pub(super) fn send_status(&mut self) {
        self.outbox.status = true;
        self.last_status_us = self.now_us;
    }

    /// State over all fingertips.
    #[must_use]
    pub fn state(&self) -> SlipState {
        self.state_within(u64::MAX)
    }
}
