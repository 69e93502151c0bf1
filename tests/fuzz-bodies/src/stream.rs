//! Any bytes on the UART, in any pieces: nothing panics, no frame is longer than a packet, and after the next zero a
//! good map is always understood.

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_protocol::{Event, ForceMap, MapInfo, PACKET_MAX, Parser, TaxelForce, encode_map};

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let (mut decoder, mut parser) = (CobsDecoder::new(), Parser::new());
    let mut push = |byte: u8| match decoder.push(byte) {
        Some(Frame::Packet(packet)) => {
            assert!(packet.len() <= PACKET_MAX, "{} bytes in a frame", packet.len());
            matches!(parser.push(packet), Ok(Event::MapEnd { .. }))
        }
        Some(Frame::Malformed) => {
            parser.refuse();
            false
        }
        None => false,
    };
    for &byte in input {
        push(byte);
    }
    push(0);
    let mut map = ForceMap::EMPTY;
    map.taxels[7..29].fill(TaxelForce { x: 0, y: -1, z: 300 });
    let mut frames = Vec::new();
    encode_map(&MapInfo::default(), &map, |packet| {
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        frames.extend_from_slice(&frame[..length]);
    });
    let accepted = frames.iter().filter(|byte| push(**byte)).count();
    assert_eq!(accepted, 1, "a good map after any noise");
}
