//! The host's side of the protocol over any link: handshake, settings, maps out, statuses in, every answer checked against the
//! shadow. A microcontroller that restarts gets a new handshake and its settings again, but no repeated command. A device that
//! comes back gets a handshake at once. Times in µs since the link was opened.

mod inbox;
mod refusal;
mod state;

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use gripline_firmware::Fault;
use gripline_firmware::sums::TaxelRule;
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets};
use gripline_protocol::{ForceMap, MapInfo, encode_map};

use self::inbox::Inbox;
use self::refusal::reason;
use crate::clock_sync::ClockSync;
use crate::handshake::{Handshake, Next};
use crate::patience::HANDSHAKE_US;
use crate::shadow::{Judgement, Shadow};
use crate::{Link, LinkError};

const HANDSHAKE_RETRY_US: u64 = 200_000;
const HANDSHAKE_STEP_US: u64 = 2_000;

/// A conversation with one microcontroller.
pub struct Session {
    link: Box<dyn Link>,
    inbox: Inbox,
    /// The microcontroller's last handshake.
    firmware: Option<Hello>,
    handshake: Handshake,
    settings: Configuration,
    /// The settings are this host's, to be sent again after a restart.
    are_ours: bool,
    shadow: Shadow,
    /// When the newest status came.
    status_us: u64,
    /// When something was last sent.
    sent_us: u64,
    clocks: ClockSync,
    clock_jumps: u64,
    /// How often the device had gone away at the last handshake.
    losses: u32,
    message_id: u8,
    /// The packets of the current map, concatenated, and their lengths.
    packets: Vec<u8>,
    lengths: Vec<usize>,
}

/// A map that was sent to the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SentMap {
    /// Bytes on the wire, packet headers included.
    pub bytes: usize,
    /// Time for cutting it into packets.
    pub encode_us: f64,
    /// Time until the link had taken the last packet. The in-process microcontroller has then decided.
    pub link_us: f64,
    /// The link did not take all of it: the microcontroller will not answer.
    pub is_lost: bool,
}

impl SentMap {
    /// No map at all.
    pub const NOTHING: Self = Self {
        bytes: 0,
        encode_us: 0.0,
        link_us: 0.0,
        is_lost: false,
    };
}

impl Session {
    /// Does the handshake and sends the settings.
    ///
    /// # Errors
    /// [`LinkError`] when the device does not answer, the schema differs or the settings are refused.
    pub fn open(link: Box<dyn Link>, settings: Configuration) -> Result<Self, LinkError> {
        let mut session = Self::connect(link)?;
        session.configure(settings)?;
        Ok(session)
    }

    /// Does the handshake and reads the settings in force.
    ///
    /// # Errors
    /// [`LinkError`] when the device does not answer or the schema differs.
    pub fn connect(link: Box<dyn Link>) -> Result<Self, LinkError> {
        let settings = Configuration::DEFAULT;
        // Any number that the last session is unlikely to have had.
        let number = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(1, |time| time.subsec_nanos() | 1);
        let mut session = Self {
            link,
            inbox: Inbox::new(),
            firmware: None,
            handshake: Handshake::new(number),
            settings,
            are_ours: false,
            shadow: Shadow::new(TaxelRule::of(&settings)),
            status_us: 0,
            sent_us: 0,
            clocks: ClockSync::default(),
            clock_jumps: 0,
            losses: 0,
            message_id: 0,
            packets: Vec::new(),
            lengths: Vec::new(),
        };
        session.ask(&session.hello(), "the handshake", |inbox| inbox.hello.is_some())?;
        session.meet()?;
        session.ask(
            &Message::Command(Command::ReadConfiguration),
            "the question for its settings",
            |inbox| inbox.configuration.is_some(),
        )?;
        session.take_settings();
        Ok(session)
    }

    fn hello(&self) -> Message {
        Message::Hello(Hello::of_this_build(0, self.handshake.number()))
    }

    /// Takes the microcontroller's half of the handshake, once it came.
    fn meet(&mut self) -> Result<(), LinkError> {
        let Some(hello) = self.inbox.hello.take() else {
            return Ok(());
        };
        hello.check().map_err(|mismatch| LinkError::Schema {
            link: self.link.name(),
            firmware: hello,
            mismatch,
        })?;
        self.firmware = Some(hello);
        if self.handshake.met(hello.session, self.now_us()) {
            self.clocks.forget();
            // What was said of settings was said before it restarted.
            self.inbox.configuration = None;
            self.inbox.settings_refused = false;
        }
        Ok(())
    }

    /// Sends settings, which are then in force.
    ///
    /// # Errors
    /// [`LinkError`] when the device does not answer or the settings are refused.
    pub fn configure(&mut self, settings: Configuration) -> Result<(), LinkError> {
        self.inbox.configuration = None;
        self.inbox.refusal = None;
        self.ask(
            &Message::Command(Command::Configure(settings)),
            "the settings",
            |inbox| inbox.configuration.is_some() || inbox.refusal.is_some(),
        )?;
        self.refused()?;
        if self.inbox.configuration != Some(settings) {
            return Err(LinkError::Refused {
                link: self.link.name(),
                reason: "the microcontroller has others in force than were sent".to_owned(),
            });
        }
        self.take_settings();
        self.are_ours = true;
        Ok(())
    }

    /// Sends settings without waiting for the answer, which [`Self::taken`] returns. Returns whether the link accepted them.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone for good.
    pub fn offer(&mut self, settings: Configuration) -> Result<bool, LinkError> {
        self.inbox.configuration = None;
        self.inbox.settings_refused = false;
        self.command(Command::Configure(settings))
    }

    /// Whether the microcontroller accepted the settings; `None` before its answer.
    pub fn taken(&mut self, settings: &Configuration) -> Option<bool> {
        if self.inbox.configuration == Some(*settings) {
            self.take_settings();
            self.are_ours = true;
            return Some(true);
        }
        self.inbox.settings_refused.then_some(false)
    }

    /// Makes the microcontroller store the settings in force in flash. Returns how often it has stored settings.
    ///
    /// # Errors
    /// [`LinkError`] when the device does not answer, the gripper is not released, or the flash fails.
    pub fn store(&mut self) -> Result<u32, LinkError> {
        self.inbox.stored = None;
        self.inbox.refusal = None;
        // Once: every order is an erasure, during which nothing answers.
        self.command(Command::Store)?;
        if !self.wait_for(HANDSHAKE_US, &|inbox: &Inbox| {
            inbox.stored.is_some() || inbox.refusal.is_some()
        })? {
            return Err(self.no_answer("the order to store"));
        }
        self.refused()?;
        Ok(self.inbox.stored.unwrap_or_default())
    }

    fn refused(&mut self) -> Result<(), LinkError> {
        let Some(refusal) = self.inbox.refusal.take() else {
            return Ok(());
        };
        Err(LinkError::Refused {
            link: self.link.name(),
            reason: reason(refusal),
        })
    }

    /// The settings in force, as reported by the microcontroller.
    fn take_settings(&mut self) {
        if let Some(settings) = self.inbox.configuration {
            self.settings = settings;
            self.shadow.judge_by(TaxelRule::of(&settings));
        }
    }

    /// Repeats a message until `answered`; a booting microcontroller misses the first.
    fn ask(
        &mut self,
        message: &Message,
        question: &'static str,
        answered: impl Fn(&Inbox) -> bool,
    ) -> Result<(), LinkError> {
        let end_us = self.now_us() + HANDSHAKE_US;
        while self.now_us() < end_us {
            self.say(message)?;
            if self.wait_for(HANDSHAKE_RETRY_US, &answered)? {
                return Ok(());
            }
        }
        Err(self.no_answer(question))
    }

    /// Works for this time, or until `answered`.
    fn wait_for(&mut self, us: u64, answered: &impl Fn(&Inbox) -> bool) -> Result<bool, LinkError> {
        let end_us = self.now_us() + us;
        while self.now_us() < end_us {
            self.run_until(self.now_us() + HANDSHAKE_STEP_US)?;
            if answered(&self.inbox) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn no_answer(&self, question: &'static str) -> LinkError {
        LinkError::NoAnswer {
            link: self.link.name(),
            question,
        }
    }

    fn send(&mut self, message: &Message) -> Result<(), LinkError> {
        self.sent_us = self.now_us();
        self.message_id = self.message_id.wrapping_add(1);
        for packet in MessagePackets::new(message, self.message_id)? {
            self.link.send(&packet)?;
        }
        Ok(())
    }

    /// Sends a message that is said again anyway when it is lost.
    fn say(&mut self, message: &Message) -> Result<(), LinkError> {
        match self.send(message) {
            Err(error) if error.is_passing() => Ok(()),
            said => said,
        }
    }

    /// Sends a command; answers are received in [`Self::run_until`]. Returns whether the link accepted it.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone for good.
    pub fn command(&mut self, command: Command) -> Result<bool, LinkError> {
        match self.send(&Message::Command(command)) {
            Err(error) if error.is_passing() => Ok(false),
            sent => sent.map(|()| true),
        }
    }

    /// Sends a map.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone for good; the packets before that were sent.
    pub fn send_map(&mut self, info: &MapInfo, map: &ForceMap) -> Result<SentMap, LinkError> {
        self.send_judged(info, map, &Judgement::of(map, self.shadow.rule()))
    }

    /// Sends a map whose sums are known.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone for good; the packets before that were sent.
    pub fn send_judged(
        &mut self,
        info: &MapInfo,
        map: &ForceMap,
        judgement: &Judgement,
    ) -> Result<SentMap, LinkError> {
        let start = Instant::now();
        self.sent_us = self.now_us();
        self.packets.clear();
        self.lengths.clear();
        encode_map(info, map, |packet| {
            self.packets.extend_from_slice(packet);
            self.lengths.push(packet.len());
        });
        let encoded = Instant::now();
        let mut rest = &self.packets[..];
        let mut is_lost = false;
        for &length in &self.lengths {
            let (packet, after) = rest.split_at(length);
            match self.link.send(packet) {
                // What is missing cannot be made up for: the next map is on its way.
                Err(LinkError::NotTaken { .. }) => {
                    is_lost = true;
                    break;
                }
                sent => sent?,
            }
            rest = after;
        }
        let handed_over = Instant::now();
        if !is_lost {
            // The device may have been given another rule since.
            let rule = self.shadow.rule();
            let sums = if judgement.rule == rule {
                judgement.sums
            } else {
                Judgement::of(map, rule).sums
            };
            self.shadow.sent(info.sensor, info.sequence, sums);
        }
        let us = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e6;
        Ok(SentMap {
            bytes: self.packets.len(),
            encode_us: us(start, encoded),
            link_us: us(encoded, handed_over),
            is_lost,
        })
    }

    /// Lets the link work until `until_us` and checks what came in. A restarted microcontroller gets a new handshake meanwhile:
    /// nothing waits for it.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone for good, or the returning device speaks another schema.
    pub fn run_until(&mut self, until_us: u64) -> Result<(), LinkError> {
        let Self { link, inbox, .. } = self;
        inbox.statuses.clear();
        let packets = inbox.packets;
        link.run_until(until_us, &mut |packet| inbox.packet(packet))?;
        let now_us = self.now_us();
        if self.inbox.packets != packets {
            self.handshake.heard(now_us);
        }
        if !self.inbox.statuses.is_empty() {
            self.status_us = now_us;
        }
        let presence = self.link.presence();
        if presence.losses != self.losses && presence.away.is_none() {
            self.losses = presence.losses;
            self.handshake.link_returned();
        }
        for status in &self.inbox.statuses {
            // Whoever restarted judges by other settings until it has ours.
            if self.handshake.is_sound_after(status) {
                self.shadow.answered(status);
                let is_refusing = status.faults & Fault::FutureMap.bit() != 0;
                let (uptime_ms, clocks) = (status.uptime_ms, &mut self.clocks);
                if clocks.jumped(now_us, uptime_ms)
                    || clocks.is_locked_out(uptime_ms, is_refusing, status.maps)
                {
                    self.clock_jumps += 1;
                    self.handshake.renumber();
                }
            }
        }
        self.renew()
    }

    /// Maintains the handshake: sends what is due, and takes the answers.
    fn renew(&mut self) -> Result<(), LinkError> {
        if std::mem::take(&mut self.inbox.is_stranger) {
            self.handshake.refused();
        }
        if !self.handshake.is_begun() {
            return Ok(());
        }
        self.meet()?;
        if self.handshake.wants_settings() {
            // It may start with a line that forbids them: then what is in force there counts, and the caller sees the
            // refusal.
            self.are_ours &= !self.inbox.settings_refused;
            if let Some(found) = self.inbox.configuration.take()
                && (found == self.settings || !self.are_ours)
            {
                self.inbox.configuration = Some(found);
                self.take_settings();
                self.handshake.settled();
            }
        }
        match self.handshake.next(self.now_us()) {
            None => Ok(()),
            Some(Next::Hello) => {
                self.inbox.hello = None;
                self.say(&self.hello())
            }
            Some(Next::Settings) => {
                self.inbox.configuration = None;
                self.inbox.settings_refused = false;
                self.say(&Message::Command(if self.are_ours {
                    Command::Configure(self.settings)
                } else {
                    Command::ReadConfiguration
                }))
            }
        }
    }

    /// Sends a packet unchanged, right or wrong: for tests of the other end.
    ///
    /// # Errors
    /// [`LinkError`] when the link is gone.
    pub fn send_raw(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        self.link.send(packet)
    }
}
