//! Properties of the wire: every map and message survives, every disturbed packet is noticed, nothing is believed
//! that was not sent, and the next good map is accepted.

use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_protocol::message::{
    Bootloader, Command, Configuration, GripMode, Hello, MapSums, Message, MessageError, MessagePackets,
    OutOfRange, Refusal, Report, Revision, SCHEMA_HASH, SCHEMA_VERSION, SlipState, Status, Witnesses,
};
use gripline_protocol::sensor_id::UnknownSensor;
use gripline_protocol::{
    Event, ForceMap, Health, MapInfo, MapParser, Motion, PACKET_MAX, PacketError, Parser, SENSORS, SensorId,
    TAXELS, TaxelForce, encode_map, map_bytes,
};
use proptest::prelude::*;

fn any_map() -> impl Strategy<Value = ForceMap> {
    let force = (any::<i16>(), any::<i16>(), any::<i16>());
    // Density first, so that empty, sparse and dense maps all come up.
    (0.0..=1.0_f64).prop_flat_map(move |density| {
        proptest::collection::vec(proptest::option::weighted(density, force), TAXELS).prop_map(|taxels| {
            let mut map = ForceMap::EMPTY;
            for (taxel, (x, y, z)) in map
                .taxels
                .iter_mut()
                .zip(taxels.into_iter().map(Option::unwrap_or_default))
            {
                *taxel = TaxelForce { x, y, z };
            }
            map
        })
    })
}

fn any_sensor() -> impl Strategy<Value = SensorId> + Clone {
    (0..SENSORS).prop_map(|place| SensorId::ALL[place])
}

fn any_info() -> impl Strategy<Value = MapInfo> {
    (any_sensor(), any::<u32>(), any::<u32>(), 0..128_u8, any::<u8>()).prop_map(
        |(sensor, sequence, capture_us, health, motion)| MapInfo {
            sensor,
            sequence,
            capture_us,
            health: Health::from_bits(health),
            motion: Motion::from_bits(motion),
        },
    )
}

fn packets(info: &MapInfo, map: &ForceMap) -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    encode_map(info, map, |packet| out.push(packet.to_vec()));
    out
}

/// A receiver as simple as can be: what it took for whole maps, and how often it noticed something.
#[derive(Default)]
struct Receiver {
    parser: Parser,
    partial: Option<ForceMap>,
    maps: Vec<(MapInfo, ForceMap)>,
    messages: Vec<Vec<u8>>,
    noticed: u32,
}

impl Receiver {
    fn push(&mut self, packet: &[u8]) {
        let add = |map: &mut ForceMap, forces: gripline_protocol::parser::Forces<'_>| {
            for (taxel, force) in forces.iter() {
                map.taxels[usize::from(taxel)] = force;
            }
        };
        match self.parser.push(packet) {
            Ok(Event::MapStart { abandoned, .. }) => {
                self.noticed += u32::from(abandoned);
                self.partial = Some(ForceMap::EMPTY);
            }
            Ok(Event::MapForces(forces)) => {
                add(self.partial.as_mut().expect("a map begins with its head"), forces);
            }
            Ok(Event::MapEnd { info, forces }) => {
                let mut map = self.partial.take().expect("a map begins with its head");
                add(&mut map, forces);
                self.maps.push((info, map));
            }
            Ok(Event::Fragment) => {}
            Ok(Event::Message(bytes)) => self.messages.push(bytes.to_vec()),
            Err(_) => {
                self.noticed += 1;
                self.partial = None;
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn every_map_survives_the_round_trip(info in any_info(), map in any_map()) {
        let packets = packets(&info, &map);
        prop_assert_eq!(packets.iter().map(Vec::len).sum::<usize>(), map_bytes(usize::from(map.active().count())));
        prop_assert!(packets.iter().all(|packet| packet.len() <= PACKET_MAX));
        let mut receiver = Receiver::default();
        for packet in &packets {
            receiver.push(packet);
        }
        prop_assert_eq!(receiver.noticed, 0);
        prop_assert_eq!(receiver.maps, vec![(info, map)]);
    }

    #[test]
    fn every_map_survives_cobs_in_pieces_after_noise(info in any_info(), map in any_map(), noise in proptest::collection::vec(any::<u8>(), 0..200)) {
        let mut stream = noise;
        stream.push(0);
        let mut frame = [0; FRAME_MAX];
        for packet in packets(&info, &map) {
            let length = encode_packet(&packet, &mut frame);
            stream.extend_from_slice(&frame[..length]);
        }
        let mut decoder = CobsDecoder::new();
        let mut receiver = Receiver::default();
        for byte in stream {
            match decoder.push(byte) {
                Some(Frame::Packet(packet)) => receiver.push(packet),
                Some(Frame::Malformed) => receiver.parser.refuse(),
                None => {}
            }
        }
        prop_assert_eq!(receiver.maps, vec![(info, map)]);
    }

    /// A head that is worked on in nine pieces leads to the same map as one that is worked on at once; one piece less, and the next packet is
    /// refused.
    #[test]
    fn a_head_in_nine_pieces_is_as_good_as_one_at_once(info in any_info(), map in any_map()) {
        let packets = packets(&info, &map);
        let (head, rest) = packets.split_first().unwrap();
        let (last, middle) = rest.split_last().unwrap();
        let (mut whole, mut pieces, mut short) = (MapParser::new(), MapParser::new(), MapParser::new());
        prop_assert_eq!(whole.head(head), Ok(false));
        prop_assert_eq!(pieces.begin(head), Ok(false));
        prop_assert_eq!(short.begin(head), Ok(false));
        for piece in 0..9 {
            prop_assert!(pieces.has_places_to_list());
            pieces.list_places();
            if piece < 8 {
                short.list_places();
            }
        }
        prop_assert!(!pieces.has_places_to_list());
        for packet in middle {
            let [of_whole, of_pieces] = [&mut whole, &mut pieces]
                .map(|parser| parser.taxels(packet).unwrap().iter().collect::<Vec<_>>());
            prop_assert_eq!(of_whole, of_pieces);
        }
        let [of_whole, of_pieces] = [&mut whole, &mut pieces].map(|parser| {
            let (info, forces) = parser.tail(last).unwrap();
            (info, forces.iter().collect::<Vec<_>>())
        });
        prop_assert_eq!(&of_whole, &of_pieces);
        prop_assert_eq!(of_whole.0, info);
        let refused = match middle.first() {
            Some(packet) => short.taxels(packet).is_err(),
            None => short.tail(last).is_err(),
        };
        prop_assert!(refused);
    }

    /// Blocks of any length, short ones and zeros often: what `cobs` decodes at once, this decodes byte by byte.
    #[test]
    fn frames_are_decoded_as_by_another_implementation(
        bytes in proptest::collection::vec(prop_oneof![0..4_u8, 60..70_u8, any::<u8>()], 0..400),
    ) {
        let mut decoder = CobsDecoder::new();
        let mut frame = Vec::new();
        for byte in bytes {
            let found = decoder.push(byte);
            if byte != 0 {
                frame.push(byte);
                prop_assert_eq!(found, None);
                continue;
            }
            let mut whole = [0; 400];
            match cobs::decode(&frame, &mut whole) {
                _ if frame.is_empty() => prop_assert_eq!(found, None),
                Ok(length) if length <= PACKET_MAX => {
                    prop_assert_eq!(found, Some(Frame::Packet(&whole[..length])));
                    prop_assert_eq!(decoder.packet(), &whole[..length]);
                }
                _ => prop_assert_eq!(found, Some(Frame::Malformed)),
            }
            frame.clear();
        }
    }

    #[test]
    fn any_bytes_are_parsed_without_panic(inputs in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..80), 0..40)) {
        let mut receiver = Receiver::default();
        let mut decoder = CobsDecoder::new();
        for input in &inputs {
            receiver.push(input);
            for &byte in input {
                if let Some(Frame::Packet(packet)) = decoder.push(byte) {
                    prop_assert!(packet.len() <= PACKET_MAX);
                }
            }
        }
        // A random CRC-32 is right once in four thousand million times.
        prop_assert!(receiver.maps.is_empty() && receiver.messages.is_empty());
        prop_assert_eq!(receiver.parser.counters().maps, 0);
    }

    /// Bytes that look like packets reach much deeper than random ones.
    #[test]
    fn any_bytes_behind_a_plausible_header_are_parsed_without_panic(
        inputs in proptest::collection::vec((0..4_u8, 0..2_u8, any::<u8>(), 0..42_u8, proptest::collection::vec(any::<u8>(), 0..61)), 0..60),
    ) {
        let mut receiver = Receiver::default();
        for (kind, owner, sequence, index, payload) in inputs {
            let mut packet = vec![1 << 4 | kind, owner, sequence, index];
            packet.extend(payload);
            receiver.push(&packet);
        }
        prop_assert!(receiver.maps.is_empty());
    }

    #[test]
    fn one_disturbed_packet_is_noticed_and_the_next_map_is_accepted(
        maps in proptest::collection::vec(any_map(), 3),
        sequence in any::<u32>(),
        place in any::<prop::sample::Index>(),
        disturbance in disturbance(),
    ) {
        let infos: Vec<_> = (0..3_u32).map(|n| MapInfo { sequence: sequence.wrapping_add(n), ..MapInfo::default() }).collect();
        let sent: Vec<_> = infos.iter().copied().zip(maps.iter().cloned()).collect();
        let trains: Vec<_> = sent.iter().map(|(info, map)| packets(info, map)).collect();
        // The disturbance hits the middle map; the third tells whether the receiver found its place again.
        let middle = trains[1].len();
        let at = trains[0].len() + place.index(middle);
        let mut stream: Vec<_> = trains.concat();
        disturbance.apply(&mut stream, at);
        if stream == trains.concat() { return Ok(()); } // swapped with an identical packet

        let mut receiver = Receiver::default();
        for packet in &stream {
            receiver.push(packet);
        }
        prop_assert!(receiver.noticed > 0, "{disturbance:?} at packet {at} went unnoticed");
        for received in &receiver.maps {
            prop_assert!(sent.contains(received), "a map was accepted that was never sent");
        }
        prop_assert_eq!(&receiver.maps[0], &sent[0]);
        if !disturbance.reaches_the_next_map(at, trains[0].len() + middle) {
            prop_assert_eq!(receiver.maps.last(), sent.last());
        }
    }

    #[test]
    fn every_status_survives_the_round_trip(status in any_status(), id in any::<u8>()) {
        let message = Message::Report(Report::Status(status));
        prop_assert_eq!(through_the_wire(&message, id), Ok(message));
    }

    #[test]
    fn one_wrong_bit_in_a_message_is_noticed(status in any_status(), bit in any::<prop::sample::Index>()) {
        let message = Message::Report(Report::Status(status));
        let mut stream = message_packets(&message, 7);
        let bits = stream.iter().map(|packet| packet.len() * 8).sum();
        let mut place = bit.index(bits);
        for packet in &mut stream {
            if place < packet.len() * 8 {
                packet[place / 8] ^= 1 << (place % 8);
                break;
            }
            place -= packet.len() * 8;
        }
        let mut receiver = Receiver::default();
        for packet in &stream {
            receiver.push(packet);
        }
        prop_assert!(receiver.messages.is_empty());
        // A wrong number of fragments is only seen when the next message begins.
        for packet in &message_packets(&message, 8) {
            receiver.push(packet);
        }
        let counters = receiver.parser.counters();
        prop_assert!(counters.refused + counters.abandoned > 0);
        prop_assert_eq!(receiver.messages.len(), 1);
    }

    #[test]
    fn any_message_bytes_are_read_without_panic(bytes in proptest::collection::vec(any::<u8>(), 0..240), class in 0..4_u8) {
        let _ = Message::from_bytes(&bytes);
        let mut framed = SCHEMA_VERSION.to_le_bytes().to_vec();
        framed.push(class);
        framed.extend(bytes);
        let _ = Message::from_bytes(&framed);
    }
}

#[derive(Debug, Clone)]
enum Disturbance {
    Bit(prop::sample::Index),
    Byte(prop::sample::Index, u8),
    Cut(prop::sample::Index),
    Lost,
    Doubled,
    SwappedWithNext,
}

fn disturbance() -> impl Strategy<Value = Disturbance> {
    prop_oneof![
        any::<prop::sample::Index>().prop_map(Disturbance::Bit),
        (any::<prop::sample::Index>(), 1..=255_u8).prop_map(|(place, by)| Disturbance::Byte(place, by)),
        any::<prop::sample::Index>().prop_map(Disturbance::Cut),
        Just(Disturbance::Lost),
        Just(Disturbance::Doubled),
        Just(Disturbance::SwappedWithNext),
    ]
}

impl Disturbance {
    fn apply(&self, stream: &mut Vec<Vec<u8>>, at: usize) {
        match self {
            Self::Bit(place) => {
                let bit = place.index(stream[at].len() * 8);
                stream[at][bit / 8] ^= 1 << (bit % 8);
            }
            Self::Byte(place, by) => {
                let byte = place.index(stream[at].len());
                stream[at][byte] ^= by;
            }
            Self::Cut(place) => {
                let length = place.index(stream[at].len());
                stream[at].truncate(length);
            }
            Self::Lost => drop(stream.remove(at)),
            Self::Doubled => stream.insert(at, stream[at].clone()),
            Self::SwappedWithNext => stream.swap(at, at + 1),
        }
    }

    /// Only a swap across the border between two maps touches a packet of the next map.
    fn reaches_the_next_map(&self, at: usize, next_map: usize) -> bool {
        matches!(self, Self::SwappedWithNext) && at + 1 == next_map
    }
}

fn any_status() -> impl Strategy<Value = Status> {
    let sums = (
        any::<u16>(),
        any::<u16>(),
        any::<[i32; 3]>(),
        any::<i32>(),
        any::<[i32; 2]>(),
        any::<i32>(),
    )
        .prop_map(
            |(contact, stick, force, moment, first_moment, second_moment)| MapSums {
                contact,
                stick,
                force,
                moment,
                first_moment,
                second_moment,
            },
        );
    let state = prop_oneof![
        Just(SlipState::NoContact),
        Just(SlipState::Stick),
        Just(SlipState::Incipient),
        Just(SlipState::Slip)
    ];
    let mode = prop_oneof![Just(GripMode::Released), Just(GripMode::Hold)];
    (
        sums,
        state,
        mode,
        any::<Option<u16>>(),
        any::<[u32; 7]>(),
        any::<i32>(),
        any::<[u32; 4]>(),
        (any_sensor(), any::<bool>(), any::<[u16; 5]>()),
    )
        .prop_map(
            |(
                sums,
                state,
                mode,
                time_to_slip_ms,
                numbers,
                line,
                worst_cycles,
                (sensor, coulomb_slip, evidence),
            )| {
                let [slip_evidence, stick_ratio, unrest, shear_follows, motion] = evidence;
                let [
                    uptime_ms,
                    sequence,
                    faults,
                    latched,
                    maps,
                    maps_refused,
                    packets_refused,
                ] = numbers;
                Status {
                    uptime_ms,
                    sensor,
                    sequence,
                    sums,
                    coulomb_slip,
                    state,
                    slip_evidence,
                    witnesses: Witnesses {
                        stick_ratio,
                        unrest,
                        shear_follows,
                        motion,
                    },
                    time_to_slip_ms,
                    mode,
                    line,
                    faults,
                    latched,
                    maps,
                    maps_refused,
                    packets_refused,
                    worst_cycles,
                }
            },
        )
}

fn message_packets(message: &Message, id: u8) -> Vec<Vec<u8>> {
    let packets = MessagePackets::new(message, id).expect("every message fits");
    packets.map(|packet| packet.to_vec()).collect()
}

fn through_the_wire(message: &Message, id: u8) -> Result<Message, MessageError> {
    let mut receiver = Receiver::default();
    for packet in &message_packets(message, id) {
        receiver.push(packet);
    }
    assert_eq!((receiver.noticed, receiver.messages.len()), (0, 1));
    Message::from_bytes(&receiver.messages[0])
}

#[test]
fn commands_answers_and_handshake_survive_the_round_trip() {
    let refusal = OutOfRange {
        field: 1,
        found: 20_001,
        min: 0,
        max: 20_000,
    };
    let built_from = |dirty| Hello {
        revision: Some(Revision {
            commit: 0x1a2b_3c4d,
            dirty,
        }),
        ..Hello::of_this_build(1, 7)
    };
    let messages = [
        Message::Hello(Hello::of_this_build(3, 0xDEAD_BEEF)),
        Message::Hello(built_from(false)),
        Message::Hello(built_from(true)),
        Message::Command(Command::Configure(Configuration::DEFAULT)),
        Message::Command(Command::ReadConfiguration),
        Message::Command(Command::Hold),
        Message::Command(Command::Release),
        Message::Command(Command::Acknowledge { faults: u32::MAX }),
        Message::Command(Command::ReadStatus),
        Message::Report(Report::Configuration(Configuration::DEFAULT)),
        Message::Report(Report::Refused(Refusal::OutOfRange(refusal))),
        Message::Report(Report::Refused(Refusal::Unreadable)),
        Message::Report(Report::Refused(Refusal::NoHandshake)),
        Message::Report(Report::Refused(Refusal::Latched)),
        Message::Report(Report::Refused(Refusal::Inhibited)),
    ];
    for message in messages {
        assert_eq!(through_the_wire(&message, 1), Ok(message));
    }
}

/// Whatever changes, these bytes stay where they are: any two builds can still tell each other who they are.
#[test]
fn the_handshake_is_laid_out_as_it_always_was_and_tells_its_commit_behind_that() {
    let hello = Hello {
        schema_version: 0x0201,
        schema_hash: 0x0605_0403,
        build: [7, 8, 9],
        board: 2,
        session: 0x0E0D_0C0B,
        revision: Some(Revision {
            commit: 0x1a2b_3c4d,
            dirty: true,
        }),
    };
    let body = [1, 2, 3, 4, 5, 6, 7, 8, 9, 2, 0x0B, 0x0C, 0x0D, 0x0E];
    let bytes = [&[0, 0, 0], &body[..], &[3, 0], &[0x4d, 0x3c, 0x2b, 0x1a]].concat();
    assert_eq!(Message::from_bytes(&bytes), Ok(Message::Hello(hello)));
    assert_eq!(
        hello.to_string(),
        "7.8.9 (1a2b3c4d, changed since) on stm32f427vi"
    );
    // What was said before there was a commit to tell.
    let old = Hello {
        revision: None,
        ..hello
    };
    let bytes = [&[0, 0, 0], &body[..], &[0, 0]].concat();
    assert_eq!(Message::from_bytes(&bytes), Ok(Message::Hello(old)));
    assert_eq!(old.to_string(), "7.8.9 on stm32f427vi");
    // Cut off anywhere it is no handshake.
    let whole = [&[0, 0, 0], &body[..], &[1, 0], &[1, 2, 3, 4]].concat();
    for length in 0..whole.len() {
        assert_eq!(
            Message::from_bytes(&whole[..length]),
            Err(MessageError::Body),
            "{length}"
        );
    }
}

/// Whatever changes, these bytes stay where they are: any host can update firmware of any schema.
#[test]
fn the_way_into_the_bootloader_is_laid_out_as_it_always_was_and_read_whatever_the_schema() {
    for (code, expected) in [
        (0, Bootloader::Enter),
        (1, Bootloader::Entering),
        (2, Bootloader::Holding),
    ] {
        let bytes = [&[0xFE, 0xCA, 3][..], b"BOOT", &[code]].concat();
        assert_eq!(Message::from_bytes(&bytes), Ok(Message::Bootloader(expected)));
        let message = Message::Bootloader(expected);
        assert_eq!(through_the_wire(&message, 1), Ok(message));
    }
    for broken in [&b"BOOT"[..], b"BOOT\x03", b"BOOS\x00", b""] {
        let bytes = [&[0, 0, 3], broken].concat();
        assert_eq!(Message::from_bytes(&bytes), Err(MessageError::Body), "{broken:?}");
    }
}

/// Whatever changes, a host can read which board and schema an image is for.
#[test]
fn the_identity_of_an_image_is_a_mark_and_the_handshake() {
    let hello = Hello {
        revision: Some(Revision {
            commit: 0x1a2b_3c4d,
            dirty: false,
        }),
        ..Hello::of_this_build(2, 0)
    };
    let block = hello.to_image();
    assert_eq!((&block[..8], block.len()), (&b"GRIPLINE"[..], 28));
    assert_eq!(block[8..10], SCHEMA_VERSION.to_le_bytes());
    assert_eq!(block[10..14], SCHEMA_HASH.to_le_bytes());
    assert_eq!(block[17], 2);
    assert_eq!(block[24..28], [0x4d, 0x3c, 0x2b, 0x1a]);
    assert_eq!(Hello::from_image(&block), Some(hello));
    assert_eq!(Hello::from_image(&block[1..]), None);
    assert_eq!(Hello::from_image(&[0xFF; 28]), None);
    let unknown = Hello::of_this_build(1, 0);
    assert_eq!(Hello::from_image(&unknown.to_image()), Some(unknown));
}

#[test]
fn wire_sizes_keep_the_promised_bounds() {
    let mut map = ForceMap {
        taxels: [TaxelForce {
            x: i16::MIN,
            y: i16::MAX,
            z: -1,
        }; TAXELS],
    };
    let bytes = |map: &ForceMap| {
        packets(&MapInfo::default(), map)
            .iter()
            .map(Vec::len)
            .sum::<usize>()
    };
    assert_eq!(bytes(&map), 2_632); // bound: 2,720
    map.taxels[100..].fill(TaxelForce::ZERO);
    assert_eq!(bytes(&map), 712); // bound: 740
    assert_eq!(bytes(&ForceMap::EMPTY), 72);
}

#[test]
fn another_schema_is_refused_and_both_versions_are_named() {
    let mut bytes = (SCHEMA_VERSION + 1).to_le_bytes().to_vec();
    bytes.extend([1, 2]);
    let error = Message::from_bytes(&bytes).unwrap_err();
    assert_eq!(
        error,
        MessageError::Schema {
            found: SCHEMA_VERSION + 1
        }
    );

    let mut hello = Hello::of_this_build(1, 0);
    assert_eq!(hello.check(), Ok(()));
    hello.schema_hash ^= 1;
    hello.schema_version = 7;
    let text = hello.check().unwrap_err().to_string();
    assert!(
        text.contains("schema 7 (") && text.contains(&format!("schema {SCHEMA_VERSION} ({SCHEMA_HASH:08x})")),
        "{text}"
    );
}

#[test]
fn another_wire_version_is_refused() {
    let mut packet = packets(&MapInfo::default(), &ForceMap::EMPTY)[0].clone();
    packet[0] = 0x10;
    assert_eq!(
        Parser::new().push(&packet).unwrap_err(),
        PacketError::Version { found: 0x10 }
    );
}

#[test]
fn a_sensor_that_does_not_exist_is_refused() {
    let mut packet = packets(&MapInfo::default(), &ForceMap::EMPTY)[0].clone();
    packet[1] = 2;
    assert_eq!(
        Parser::new().push(&packet).unwrap_err(),
        PacketError::Sensor(UnknownSensor { found: 2 })
    );
}

/// The layout itself: another program that speaks it must not break when this code is rewritten.
#[test]
fn the_wire_format_is_what_the_golden_bytes_say() {
    let mut map = ForceMap::EMPTY;
    map.taxels[0] = TaxelForce {
        x: 1,
        y: -2,
        z: 0x0304,
    };
    map.taxels[399] = TaxelForce {
        x: i16::MIN,
        y: 0,
        z: i16::MAX,
    };
    let info = MapInfo {
        sensor: SensorId::SECOND,
        sequence: 0x0A0B_0C0D,
        capture_us: 0x1122_3344,
        health: Health::TOO_BRIGHT,
        motion: Motion::new(42, 2),
    };
    let sent = packets(&info, &map);
    assert_eq!(sent.len(), 2);
    assert_eq!(
        sent[0][..14],
        [
            0x20, 1, 0x0D, 0, 0x0C, 0x0B, 0x0A, 0xAA, 0x44, 0x33, 0x22, 0x11, 0x02, 0x04
        ]
    );
    assert_eq!(sent[0][14], 1);
    assert_eq!(sent[0][63], 0x80);
    assert!(sent[0][15..63].iter().all(|&byte| byte == 0));
    let taxels = [1, 0, 0xFE, 0xFF, 4, 3, 0, 0x80, 0, 0, 0xFF, 0x7F];
    assert_eq!(sent[1][..16], [&[0x22, 1, 0x0D, 1][..], &taxels].concat());
    let golden_crc = crc32_bit_by_bit(&[&sent[0][..], &sent[1][..16]].concat());
    assert_eq!(sent[1][16..], golden_crc.to_le_bytes());
}

/// The CRC-32 of zip and Ethernet, from its definition.
fn crc32_bit_by_bit(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xEDB8_8320
            } else {
                crc >> 1
            };
        }
    }
    !crc
}

#[test]
fn settings_out_of_range_are_named() {
    assert_eq!(Configuration::DEFAULT.check(), Ok(()));
    let wrong = Configuration {
        friction: 20_001,
        ..Configuration::DEFAULT
    };
    assert_eq!(
        wrong.check().unwrap_err().to_string(),
        "friction: found 20001, expected 0 to 20000"
    );
    let crossed = Configuration {
        slip_leave: 4_999,
        ..Configuration::DEFAULT
    };
    assert_eq!(
        crossed.check().unwrap_err().to_string(),
        "slip_leave: found 4999, expected 5000 to 10000"
    );
}
