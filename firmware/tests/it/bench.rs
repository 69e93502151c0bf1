//! A host at the program's packets.

use gripline_firmware::{Action, Device, GripForce, Start};
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets, Report, Status};
use gripline_protocol::{Event, ForceMap, MapInfo, Parser, encode_map};

/// A host that speaks to the program and keeps what it answers.
pub(crate) struct Bench {
    pub(crate) device: Device,
    pub(crate) now_us: u64,
    pub(crate) sequence: u32,
    id: u8,
    replies: Parser,
    pub(crate) reports: Vec<Report>,
    pub(crate) hellos: Vec<Hello>,
}

impl Bench {
    pub(crate) fn cold() -> Self {
        Self::starting(Start {
            board: 1,
            session: 5,
            ..Start::default()
        })
    }

    pub(crate) fn starting(start: Start) -> Self {
        let device = Device::new(start);
        Self {
            device,
            now_us: start.now_us,
            sequence: 0,
            id: 0,
            replies: Parser::new(),
            reports: Vec::new(),
            hellos: Vec::new(),
        }
    }

    pub(crate) fn holding() -> Self {
        let mut bench = Self::cold();
        bench.message(Message::Hello(Hello::of_this_build(0, 1)));
        bench.command(Command::Configure(Configuration::CAREFUL));
        bench.command(Command::Hold);
        bench.reports.clear();
        bench
    }

    pub(crate) fn listen(&mut self) {
        while let Some(packet) = self.device.next_packet() {
            if let Event::Message(bytes) = self
                .replies
                .push(&packet)
                .expect("the program sends good packets")
            {
                match Message::from_bytes(bytes).expect("the program sends readable messages") {
                    Message::Hello(hello) => self.hellos.push(hello),
                    Message::Report(report) => self.reports.push(report),
                    Message::Bootloader(_) => {}
                    Message::Command(command) => panic!("the program sent a command: {command:?}"),
                }
            }
        }
    }

    pub(crate) fn message(&mut self, message: Message) {
        self.id = self.id.wrapping_add(1);
        for packet in MessagePackets::new(&message, self.id).unwrap() {
            let _ = self.device.packet(&packet, self.now_us);
        }
        self.listen();
    }

    pub(crate) fn command(&mut self, command: Command) {
        self.message(Message::Command(command));
    }

    pub(crate) fn map_with(&mut self, info: MapInfo, map: &ForceMap) -> Vec<Action> {
        let mut actions = Vec::new();
        encode_map(&info, map, |packet| {
            actions.push(self.device.packet(packet, self.now_us));
        });
        self.listen();
        actions
    }

    pub(crate) fn map(&mut self, map: &ForceMap) -> Status {
        self.sequence += 1;
        let info = MapInfo {
            sequence: self.sequence,
            capture_us: self.now_us as u32,
            ..MapInfo::default()
        };
        assert!(
            self.map_with(info, map).last().unwrap().decided,
            "the map was not accepted"
        );
        self.status()
    }

    pub(crate) fn status(&self) -> Status {
        self.reports
            .iter()
            .rev()
            .find_map(|report| {
                if let Report::Status(status) = report {
                    Some(*status)
                } else {
                    None
                }
            })
            .expect("a status was sent")
    }

    pub(crate) fn wait_ms(&mut self, ms: u64) -> GripForce {
        for _ in 0..ms {
            self.now_us += 1_000;
            let _ = self.device.tick(self.now_us);
            self.listen();
        }
        self.device.program.line()
    }

    /// Maps at 60 Hz for a while; returns the last status.
    pub(crate) fn maps_for_ms(&mut self, map: &ForceMap, ms: u64) -> Status {
        let mut status = self.map(map);
        for _ in 0..ms / 16 {
            self.wait_ms(16);
            status = self.map(map);
        }
        status
    }

    pub(crate) fn faults(&self) -> u32 {
        self.device.program.status().faults
    }
}
