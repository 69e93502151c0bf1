//! Handles messages: handshake and commands.

use gripline_protocol::SENSORS;
use gripline_protocol::message::{Command, GripMode, Hello, Message, Refusal, Report, SlipState};
use gripline_protocol::rounds::at_most;

use super::dispatch::Program;
use super::messages::{MessageEvent, Request};
use super::object::Object;
use super::outbox::Due;
use crate::fault::{Fault, FaultSet};
use crate::grip::loosens;
use crate::link::LinkId;
use crate::sums::{Kernel, TaxelRule};

impl<K: Kernel> Program<K> {
    /// Takes a message from [`MessageReader::read`](super::MessageReader::read). The line changes with the next packet of a map or
    /// the next tick.
    pub fn message(&mut self, event: &MessageEvent, link: LinkId, now_us: u64) {
        match event {
            MessageEvent::Fragment => self.last_packet_us = self.passed_to(now_us),
            MessageEvent::Request(request) => self.request(request, now_us),
            MessageEvent::Refused => self.refuse_packet(link),
        }
    }

    /// Counts a packet that was refused before it came here: a malformed COBS frame, a fragment out of order.
    pub fn refuse_packet(&mut self, link: LinkId) {
        let breakage = self.receivers[link as usize].refuse();
        self.count_breakage(breakage, link);
    }

    fn request(&mut self, request: &Request, now_us: u64) {
        let now_us = self.passed_to(now_us);
        if matches!(request, Request::Unreadable) {
            self.safety.set(Fault::UnreadableMessage, true);
            return self.refuse(Refusal::Unreadable);
        }
        self.safety.set(Fault::UnreadableMessage, false);
        match request {
            Request::Hello { hello, known } => self.hello(hello, *known),
            Request::Bootloader => self.ask_for_bootloader(),
            // No host sends a report.
            Request::Report | Request::Unreadable => self.refuse(Refusal::Unreadable),
            _ if self.host_session.is_none() => self.refuse(Refusal::NoHandshake),
            Request::OutOfRange(error) => {
                self.safety.set(Fault::OutOfRange, true);
                self.refuse(Refusal::OutOfRange(*error));
            }
            Request::Command { command, rule } => self.command(command, *rule),
        }
        self.last_packet_us = now_us;
    }

    /// The next message for the host.
    pub fn poll_message(&mut self) -> Option<Message> {
        if let Some(answer) = self.bootloader.answer.take() {
            return Some(Message::Bootloader(answer));
        }
        Some(match self.outbox.next()? {
            Due::Hello => Message::Hello(Hello {
                revision: self.start.revision,
                ..Hello::of_this_build(self.start.board, self.start.session)
            }),
            Due::Refused(refusal) => Message::Report(Report::Refused(refusal)),
            Due::Configuration => Message::Report(Report::Configuration(self.settings)),
            Due::Stored { writes } => Message::Report(Report::Stored { writes }),
            Due::Status => Message::Report(Report::Status(self.status())),
        })
    }

    /// Always answers, so that a host with another schema can report both versions.
    fn hello(&mut self, hello: &Hello, known: bool) {
        self.outbox.hello = true;
        self.safety.set(Fault::SchemaMismatch, !known);
        let restarted = self.host_session != Some(hello.session);
        self.host_session = known.then_some(hello.session);
        if known && restarted {
            self.expect_another_host();
        }
    }

    fn command(&mut self, command: &Command, rule: Option<TaxelRule>) {
        match command {
            Command::Configure(settings) => {
                self.safety.set(Fault::OutOfRange, false);
                self.safety.set(Fault::SettingsLost, false);
                if loosens(&self.settings, settings) {
                    self.controller.keep_line();
                }
                self.settings.take_over(settings);
                // There is one, as the settings are in range.
                self.rule = rule.unwrap_or(self.rule);
                // Sums under way were made by the old rule.
                let [usb, uart] = &mut self.receivers;
                usb.drop_map();
                uart.drop_map();
                self.outbox.configuration = true;
            }
            Command::ReadConfiguration => self.outbox.configuration = true,
            Command::Store if self.is_empty_handed() => self.store = true,
            Command::Store => self.refuse(Refusal::Holding),
            // Said again it changes nothing: it must not make old maps look new.
            Command::Hold if self.controller.mode() == GripMode::Hold => {}
            Command::Hold => {
                if self.state_within(u64::from(self.settings.stale_ms) * 1_000) == SlipState::NoContact {
                    self.controller.forget_load();
                }
                self.controller.set_mode(GripMode::Hold);
                for tip in at_most::<SENSORS, _>(&mut self.fingertips) {
                    tip.fresh_us = self.now_us;
                }
            }
            Command::Release if !self.safety.latched().is_empty() => self.refuse(Refusal::Latched),
            Command::Release if self.is_release_inhibited => self.refuse(Refusal::Inhibited),
            Command::Release => {
                self.controller.set_mode(GripMode::Released);
                self.object = Object::default();
                self.release = true;
            }
            Command::Acknowledge { faults } => self.safety.acknowledge(FaultSet::from_bits(*faults)),
            Command::ReadStatus => self.send_status(),
        }
    }

    pub(super) fn refuse(&mut self, refusal: Refusal) {
        self.outbox.refusal = Some(refusal);
    }
}
