//! The program with both ends of its messages, for hosts: tests, the in-process link, simulators.
//!
//! It makes the same calls as a board's interrupts and tasks, in the same order: the tests run the chip's code. Units: µs since
//! start.

use gripline_protocol::Packet;
use gripline_protocol::packet::Kind;

use super::dispatch::{Action, Program};
use super::learner::Learner;
use super::messages::{MessageReader, MessageWriter};
use super::start::Start;
use crate::link::{LINKS, LinkId};

/// A microcontroller in software.
#[derive(Debug)]
pub struct Device {
    /// The program itself.
    pub program: Program,
    learner: Learner,
    readers: [MessageReader; LINKS],
    writer: MessageWriter,
}

impl Device {
    /// Powers on.
    #[must_use]
    pub fn new(start: Start) -> Self {
        Self {
            program: Program::new(start),
            learner: Learner::default(),
            readers: LinkId::ALL.map(|_| MessageReader::new(*start.line())),
            writer: MessageWriter::default(),
        }
    }

    /// Takes one packet of at most 64 bytes as it arrived at the first link.
    pub fn packet(&mut self, packet: &[u8], now_us: u64) -> Action {
        self.packet_from(LinkId::Usb, packet, now_us)
    }

    /// Takes one packet of at most 64 bytes as it arrived at a link (COBS already decoded).
    pub fn packet_from(&mut self, link: LinkId, packet: &[u8], now_us: u64) -> Action {
        if Kind::of(packet) != Some(Kind::Message) {
            let action = self.program.map_packet(packet, link, now_us);
            if action.decided {
                self.study();
            }
            return action;
        }
        let event = self.readers[link as usize].read(packet);
        self.program.message(&event, link, now_us);
        self.program.unchanged()
    }

    /// Counts a frame that the transport of a link refused (COBS).
    pub fn malformed_frame(&mut self, link: LinkId) {
        self.readers[link as usize].drop_message();
        self.program.refuse_packet(link);
    }

    /// The 1 kHz tick: ages, faults, slew.
    pub fn tick(&mut self, now_us: u64) -> Action {
        self.study();
        self.program.age(now_us);
        self.program.teach_grip();
        self.program.watch_object();
        self.program.advance(now_us)
    }

    /// Learns from new maps.
    fn study(&mut self) {
        let mut lesson = None;
        loop {
            self.program.lesson(&mut lesson);
            let Some(lesson) = &lesson else { return };
            let learnt = self.learner.work(lesson);
            self.program.learn(&learnt);
        }
    }

    /// The next packet for the host.
    pub fn next_packet(&mut self) -> Option<Packet> {
        self.writer.next_packet(|| self.program.poll_message())
    }
}
