//! The microcontroller's whole program with a host that speaks to it: maps and time in, status out. Units: µs.

use gripline_firmware::{Device, Start};
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets, Status};
use gripline_protocol::{ForceMap, MapInfo, SensorId, encode_map};

/// Where its clocks and numbers begin: before a wrap or far from one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Origin {
    /// The microcontroller's clock, µs.
    pub(crate) now_us: u64,
    /// The host's, µs.
    pub(crate) capture_us: u32,
    /// The first map's number.
    pub(crate) sequence: u32,
}

/// The program and its host.
#[derive(Debug)]
pub(crate) struct Board {
    pub(crate) device: Device,
    origin: Origin,
    /// Since the start.
    pub(crate) passed_us: u64,
    sequence: [u32; 2],
    id: u8,
}

impl Board {
    /// Holding, with these settings.
    pub(crate) fn holding(settings: Configuration, origin: Origin) -> Self {
        let mut board = Self {
            device: Device::new(Start {
                now_us: origin.now_us,
                ..Start::default()
            }),
            origin,
            passed_us: 0,
            sequence: [origin.sequence; 2],
            id: 0,
        };
        board.message(&Message::Hello(Hello::of_this_build(0, 1)));
        board.command(Command::Configure(settings));
        board.command(Command::Hold);
        board
    }

    fn now_us(&self) -> u64 {
        self.origin.now_us.wrapping_add(self.passed_us)
    }

    fn message(&mut self, message: &Message) {
        self.id = self.id.wrapping_add(1);
        // Every message of the protocol fits its packets.
        for packet in MessagePackets::new(message, self.id).into_iter().flatten() {
            self.packet(&packet);
        }
        self.listen();
    }

    pub(crate) fn command(&mut self, command: Command) {
        self.message(&Message::Command(command));
    }

    pub(crate) fn packet(&mut self, packet: &[u8]) {
        let now_us = self.now_us();
        let _ = self.device.packet(packet, now_us);
    }

    fn listen(&mut self) {
        while self.device.program.poll_message().is_some() {}
    }

    /// What the next map's packets are.
    pub(crate) fn packets(&mut self, sensor: SensorId, map: &ForceMap, late_us: u32) -> Vec<Vec<u8>> {
        let number = &mut self.sequence[sensor.index()];
        let info = MapInfo {
            sensor,
            sequence: *number,
            capture_us: self
                .origin
                .capture_us
                .wrapping_add(self.passed_us as u32)
                .wrapping_sub(late_us),
            ..MapInfo::default()
        };
        *number = number.wrapping_add(1);
        let mut packets = Vec::new();
        encode_map(&info, map, |packet| packets.push(packet.to_vec()));
        packets
    }

    /// A map comes now.
    pub(crate) fn map(&mut self, map: &ForceMap) -> Status {
        for packet in self.packets(SensorId::FIRST, map, 0) {
            self.packet(&packet);
        }
        self.listen();
        self.device.program.status()
    }

    /// Time passes in ticks of a millisecond, the last one shorter.
    pub(crate) fn pass_us(&mut self, us: u64) {
        let end = self.passed_us + us;
        while self.passed_us < end {
            let next = (self.passed_us / 1_000 + 1) * 1_000;
            self.passed_us = next.min(end);
            let now_us = self.now_us();
            let _ = self.device.tick(now_us);
        }
        self.listen();
    }
}
