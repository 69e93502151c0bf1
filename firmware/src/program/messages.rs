//! Both ends of the messages, outside the map-to-line path: packets to requests, and messages to packets.
//!
//! Parsing a message takes long and needs no program state. Executing it ([`Program::message`]) is short. So a board reads messages
//! in a task while maps go to the line in an interrupt.
//!
//! [`Program::message`]: super::Program::message

use gripline_protocol::message::{
    Bootloader, Command, Hello, LineSettings, Message, MessagePackets, OutOfRange,
};
use gripline_protocol::{MessageParser, Packet};

use crate::sums::TaxelRule;

/// A message from the host, read and checked.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {
    /// Not a message of ours.
    Unreadable,
    /// A report or an answer, which no host sends.
    Report,
    /// The handshake.
    Hello {
        /// Who speaks.
        hello: Hello,
        /// It speaks our schema.
        known: bool,
    },
    /// The request for the bootloader.
    Bootloader,
    /// Settings with one out of range: none of them is applied.
    OutOfRange(OutOfRange),
    /// Any other command.
    Command {
        /// The command.
        command: Command,
        /// The rule per taxel from new settings.
        rule: Option<TaxelRule>,
    },
}

impl Request {
    /// Reads a message. Settings must fit the line in force.
    fn read(message: &[u8], in_force: &LineSettings) -> Self {
        match Message::from_bytes(message) {
            Err(_) => Self::Unreadable,
            Ok(Message::Bootloader(Bootloader::Enter)) => Self::Bootloader,
            Ok(Message::Report(_) | Message::Bootloader(_)) => Self::Report,
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

/// The result of a packet of a message.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MessageEvent {
    /// A fragment; more must follow.
    Fragment,
    /// The last fragment: the message is whole.
    Request(Request),
    /// Not the packet expected next, or a wrong CRC.
    Refused,
}

/// Assembles and parses messages.
#[derive(Debug)]
pub struct MessageReader {
    parser: MessageParser,
    /// The line in force, which new settings must fit.
    line: LineSettings,
}

impl MessageReader {
    /// A reader before its first packet; `line` is [`Start::line`](super::Start::line).
    #[must_use]
    pub const fn new(line: LineSettings) -> Self {
        Self {
            parser: MessageParser::new(),
            line,
        }
    }

    /// Takes a packet of [`Kind::Message`](gripline_protocol::packet::Kind::Message).
    pub fn read(&mut self, packet: &[u8]) -> MessageEvent {
        match self.parser.push(packet) {
            Ok(None) => MessageEvent::Fragment,
            Ok(Some(message)) => MessageEvent::Request(Request::read(message, &self.line)),
            Err(_) => MessageEvent::Refused,
        }
    }

    /// Drops the message in progress, after a frame that the transport refused.
    pub fn drop_message(&mut self) {
        self.parser.drop_message();
    }
}

/// Cuts the program's messages into packets.
#[derive(Debug, Default)]
pub struct MessageWriter {
    sending: Option<MessagePackets>,
    next_id: u8,
}

impl MessageWriter {
    /// The next packet for the host. `poll` is [`Program::poll_message`](super::Program::poll_message): it is called for one
    /// message at a time, when the last one was sent.
    pub fn next_packet(&mut self, mut poll: impl FnMut() -> Option<Message>) -> Option<Packet> {
        loop {
            if let Some(packet) = self.sending.as_mut().and_then(Iterator::next) {
                return Some(packet);
            }
            self.sending = None;
            let message = poll()?;
            self.next_id = self.next_id.wrapping_add(1);
            // Every message fits, as a test shows; one that did not would be left out.
            self.sending = MessagePackets::new(&message, self.next_id).ok();
        }
    }
}
