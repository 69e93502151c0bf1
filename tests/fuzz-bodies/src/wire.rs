//! What must hold for any bytes: no panic, and nothing believed that is not consistent. The input
//! is a list of packets, each behind a byte that tells its length.

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_protocol::message::{Message, MessagePackets};
use gripline_protocol::{Event, PACKET_MAX, Parser, TAXELS};

/// Splits the input into packets and pushes them through the parser, directly and over COBS.
/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let mut packets = Vec::new();
    let mut rest = input;
    while let Some((&length, after)) = rest.split_first() {
        let (packet, after) = after.split_at(usize::from(length).min(after.len()));
        // COBS has no frame for an empty packet; the parser alone must refuse it.
        if packet.is_empty() {
            assert!(Parser::new().push(packet).is_err());
        } else {
            packets.push(packet);
        }
        rest = after;
    }
    let direct = events(packets.iter().copied());
    let mut decoded = Vec::new();
    let mut decoder = CobsDecoder::new();
    for packet in packets.iter().filter(|packet| packet.len() <= PACKET_MAX) {
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        for &byte in &frame[..length] {
            match decoder.push(byte) {
                Some(Frame::Packet(packet)) => decoded.push(packet.to_vec()),
                Some(Frame::Malformed) => panic!("a frame of ours was malformed"),
                None => {}
            }
        }
    }
    if packets.iter().all(|packet| packet.len() <= PACKET_MAX) {
        assert_eq!(
            events(decoded.iter().map(Vec::as_slice)),
            direct,
            "COBS changes nothing"
        );
    }
    // The same bytes as a raw stream: any frames in it must be of legal length.
    let mut decoder = CobsDecoder::new();
    for &byte in input {
        if let Some(Frame::Packet(packet)) = decoder.push(byte) {
            assert!(packet.len() <= PACKET_MAX);
        }
    }
}

/// (maps, messages) that were accepted.
fn events<'a>(packets: impl Iterator<Item = &'a [u8]>) -> (u32, Vec<Vec<u8>>) {
    let mut parser = Parser::new();
    let (mut maps, mut messages) = (0, Vec::new());
    // Taxels still to come, and the last one seen.
    let mut open: Option<(u16, Option<u16>)> = None;
    for packet in packets {
        let before = parser.counters();
        let mut take = |forces: gripline_protocol::parser::Forces<'_>| {
            let (left, last) = open.as_mut().expect("forces belong to a map that began");
            for (taxel, _) in forces.iter() {
                assert!(
                    usize::from(taxel) < TAXELS && last.is_none_or(|last| last < taxel),
                    "taxels ascend"
                );
                *last = Some(taxel);
                *left = left.checked_sub(1).expect("no more taxels than were announced");
            }
        };
        match parser.push(packet) {
            Ok(Event::MapStart { active, .. }) => {
                assert!(usize::from(active) <= TAXELS);
                open = Some((active, None));
            }
            Ok(Event::MapForces(forces)) => take(forces),
            Ok(Event::MapEnd { forces, .. }) => {
                take(forces);
                assert_eq!(
                    open.take().map(|(left, _)| left),
                    Some(0),
                    "a whole map has all its taxels"
                );
                maps += 1;
            }
            Ok(Event::Fragment) => {}
            Ok(Event::Message(bytes)) => {
                messages.push(bytes.to_vec());
                if let Ok(message) = Message::from_bytes(bytes) {
                    assert!(
                        MessagePackets::new(&message, 0).is_ok(),
                        "what was read can be written"
                    );
                }
            }
            Err(_) => {
                open = None;
                assert_eq!(
                    parser.counters().refused,
                    before.refused + 1,
                    "every refused packet is counted"
                );
            }
        }
    }
    (maps, messages)
}
