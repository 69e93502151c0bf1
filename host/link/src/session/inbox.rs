//! Received messages of the microcontroller, by kind.

use gripline_protocol::message::{Configuration, Hello, Message, Refusal, Report, Status};
use gripline_protocol::{Event, Parser, SENSORS};

/// What came in.
pub(super) struct Inbox {
    pub(super) parser: Parser,
    pub(super) hello: Option<Hello>,
    pub(super) configuration: Option<Configuration>,
    /// How often settings were stored, from the answer to `Store`.
    pub(super) stored: Option<u32>,
    pub(super) refusal: Option<Refusal>,
    /// Commands were refused because it does not know this host; settings, because they are out of range.
    pub(super) is_stranger: bool,
    pub(super) settings_refused: bool,
    /// Every status since the last look, newest last.
    pub(super) statuses: Vec<Status>,
    pub(super) latest: Option<Status>,
    /// The newest of each fingertip.
    pub(super) of_fingertips: [Option<Status>; SENSORS],
    pub(super) unreadable: u64,
    /// Packets of any kind.
    pub(super) packets: u64,
}

impl Inbox {
    /// Nothing has come yet.
    pub(super) fn new() -> Self {
        Self {
            parser: Parser::new(),
            hello: None,
            configuration: None,
            stored: None,
            refusal: None,
            is_stranger: false,
            settings_refused: false,
            statuses: Vec::new(),
            latest: None,
            of_fingertips: [None; SENSORS],
            unreadable: 0,
            packets: 0,
        }
    }

    pub(super) fn packet(&mut self, packet: &[u8]) {
        self.packets += 1;
        let Ok(Event::Message(bytes)) = self.parser.push(packet) else {
            // Refused packets are in the parser's counters; nothing else is expected from a microcontroller.
            return;
        };
        match Message::from_bytes(bytes) {
            Ok(Message::Hello(hello)) => self.hello = Some(hello),
            Ok(Message::Report(Report::Status(status))) => {
                self.statuses.push(status);
                self.latest = Some(status);
                self.of_fingertips[status.sensor.index()] = Some(status);
            }
            Ok(Message::Report(Report::Configuration(settings))) => self.configuration = Some(settings),
            Ok(Message::Report(Report::Stored { writes })) => self.stored = Some(writes),
            Ok(Message::Report(Report::Refused(refusal))) => {
                self.refusal = Some(refusal);
                self.is_stranger |= refusal == Refusal::NoHandshake;
                self.settings_refused |= matches!(refusal, Refusal::OutOfRange(_));
            }
            // Nobody in a session asks for the bootloader.
            Ok(Message::Command(_) | Message::Bootloader(_)) | Err(_) => self.unreadable += 1,
        }
    }
}
