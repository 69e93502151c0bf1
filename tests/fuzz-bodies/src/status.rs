//! Whatever a microcontroller says, the host's session goes on or ends with an error: no panic, no endless wait.
//! The input is a list of packets, each behind a byte that tells its length; those with a length over 128 are wrapped
//! into a message with a right CRC, so that the fuzzer gets past it.

use gripline_firmware::{Device, Start};
use gripline_link::session::Session;
use gripline_link::{Link, LinkError};
use gripline_protocol::crc::crc32;
use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::packet::{Header, Kind};
use gripline_protocol::{ForceMap, MapInfo, PACKET_MAX};

/// A microcontroller that answers the handshake and then says what the input says.
struct Babbler {
    device: Device,
    now_us: u64,
    said: Vec<Vec<u8>>,
    /// What is said before the handshake.
    early: bool,
}

impl Link for Babbler {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let _ = self.device.packet(packet, self.now_us);
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        self.now_us = until_us;
        if self.early {
            self.said.drain(..).for_each(|packet| received(&packet));
        }
        while let Some(packet) = self.device.next_packet() {
            received(&packet);
        }
        self.said.drain(..).for_each(|packet| received(&packet));
        Ok(())
    }

    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn name(&self) -> String {
        "fuzzer".to_owned()
    }
}

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let Some((&first, mut rest)) = input.split_first() else {
        return;
    };
    let mut said = Vec::new();
    while let Some((&length, after)) = rest.split_first() {
        let (body, after) = after.split_at(usize::from(length & 0x7F).min(after.len()));
        if length < 0x80 {
            said.push(body.to_vec());
        } else {
            said.extend(message_of(body, length));
        }
        rest = after;
    }
    let babbler = Babbler {
        device: Device::new(Start::default()),
        now_us: 0,
        said,
        early: first & 1 == 1,
    };
    let Ok(mut session) = Session::open(Box::new(babbler), Configuration::DEFAULT) else {
        return;
    };
    let _ = session.send_map(&MapInfo::default(), &ForceMap::EMPTY);
    let _ = session.command(Command::ReadStatus);
    for step in 1..4 {
        let _ = session.run_until(session.now_us() + step * 1_000);
    }
    let _ = (
        session.take_refusal(),
        session.status().copied(),
        session.counters(),
    );
}

/// A message with these bytes, in as many packets as it takes.
fn message_of(body: &[u8], id: u8) -> Vec<Vec<u8>> {
    const PAYLOAD: usize = PACKET_MAX - 4;
    let mut body = body.to_vec();
    let room = PAYLOAD - body.len() % PAYLOAD;
    if room < 4 {
        body.resize(body.len() + room, 0);
    }
    let count = (body.len() + 4).div_ceil(PAYLOAD) as u8;
    let header = |index: u8| {
        Header {
            kind: Kind::Message,
            owner: id,
            sequence: count,
            index,
        }
        .to_bytes()
    };
    let mut packets: Vec<Vec<u8>> = (0..count).map(|index| header(index).to_vec()).collect();
    for (packet, payload) in packets.iter_mut().zip(body.chunks(PAYLOAD)) {
        packet.extend_from_slice(payload);
    }
    let crc = crc32(packets.iter().flatten().copied());
    if let Some(last) = packets.last_mut() {
        last.extend(crc.to_le_bytes());
    }
    packets
}
