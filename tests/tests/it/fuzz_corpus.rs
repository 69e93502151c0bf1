//! The fuzz corpora and a bounded number of mutations of them, in every test run. The seeds of `wire` are written by the
//! last test here: `GRIPLINE_BLESS=1 cargo test -p gripline-tests --test it fuzz_corpus::`; the others are
//! what the fuzzer found (`cargo xtask fuzz`).

use std::fs;
use std::path::{Path, PathBuf};

use gripline_fuzz_bodies::{commands, http, modbus, settings, status, stream, wire};
use gripline_protocol::message::{Command, Configuration, Hello, Message, MessagePackets, Report, Status};
use gripline_protocol::{ForceMap, MapInfo, TAXELS, TaxelForce, encode_map};

fn folder(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/corpus")
        .join(target)
}

/// The corpus, and so many mutations of it: the same in every run.
fn check(target: &str, body: impl Fn(&[u8]), mutations: usize) {
    let mut paths: Vec<_> = fs::read_dir(folder(target))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    assert!(paths.len() >= 12, "only {} seeds of {target}", paths.len());
    let seeds: Vec<_> = paths.iter().map(|path| fs::read(path).unwrap()).collect();
    for seed in &seeds {
        body(seed);
    }
    // xorshift64
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below.max(1) as u64) as usize
    };
    for _ in 0..mutations {
        let mut input = seeds[random(seeds.len())].clone();
        for _ in 0..=random(4) {
            let at = random(input.len());
            match random(5) {
                0 if !input.is_empty() => input[at] ^= 1 << random(8),
                1 if !input.is_empty() => input[at] = random(256) as u8,
                2 => input.truncate(at),
                3 => input.insert(at.min(input.len()), random(256) as u8),
                _ => {
                    let other = &seeds[random(seeds.len())];
                    let from = random(other.len());
                    input.extend_from_slice(&other[from..(from + random(130)).min(other.len())]);
                }
            }
        }
        body(&input);
    }
}

#[test]
fn map_packets_hold() {
    check("wire", wire::check, 200_000);
}

#[test]
fn the_uart_stream_holds() {
    check("stream", stream::check, 50_000);
}

#[test]
fn commands_settings_and_maps_in_any_order_hold() {
    check("commands", commands::check, 3_000);
}

#[test]
fn settings_in_flash_hold() {
    check("settings", settings::check, 100_000);
}

#[test]
fn what_the_host_hears_holds() {
    check("status", status::check, 5_000);
}

#[test]
fn the_gripper_on_the_bus_holds() {
    check("modbus", modbus::check, 50_000);
}

#[test]
fn requests_over_http_hold() {
    check("http", http::check, 100_000);
}

fn listed(packets: &[Vec<u8>]) -> Vec<u8> {
    packets
        .iter()
        .flat_map(|packet| [&[packet.len() as u8][..], packet].concat())
        .collect()
}

fn map_packets(active: usize, sequence: u32) -> Vec<Vec<u8>> {
    let mut map = ForceMap::EMPTY;
    map.taxels[..active].fill(TaxelForce {
        x: -300,
        y: 20,
        z: 900,
    });
    let mut packets = Vec::new();
    encode_map(
        &MapInfo {
            sequence,
            ..MapInfo::default()
        },
        &map,
        |packet| packets.push(packet.to_vec()),
    );
    packets
}

fn message_packets(message: &Message) -> Vec<Vec<u8>> {
    let packets = MessagePackets::new(message, 1).unwrap();
    packets.map(|packet| packet.to_vec()).collect()
}

#[test]
fn the_seeds_are_what_the_encoders_write() {
    let mut doubled = map_packets(25, 3);
    doubled.insert(2, doubled[1].clone());
    let mut lost = map_packets(45, 4);
    lost.remove(2);
    let mut torn = map_packets(10, 5);
    torn[1].truncate(33);
    let seeds = [
        ("map_empty", map_packets(0, 1)),
        ("map_9", map_packets(9, u32::MAX)),
        ("map_10", map_packets(10, 2)),
        ("map_100", map_packets(100, 3)),
        ("map_dense", map_packets(TAXELS, 4)),
        ("maps_two", [map_packets(13, 7), map_packets(13, 8)].concat()),
        ("map_doubled_packet", doubled),
        ("map_lost_packet", lost),
        ("map_torn_packet", torn),
        (
            "hello",
            message_packets(&Message::Hello(Hello::of_this_build(1, 2))),
        ),
        (
            "configure",
            message_packets(&Message::Command(Command::Configure(Configuration::DEFAULT))),
        ),
        (
            "acknowledge",
            message_packets(&Message::Command(Command::Acknowledge { faults: 12 })),
        ),
        (
            "status",
            message_packets(&Message::Report(Report::Status(Status {
                line: -1,
                latched: 7,
                ..Status::default()
            }))),
        ),
        (
            "message_in_a_map",
            [
                &map_packets(25, 9)[..2],
                &message_packets(&Message::Command(Command::Hold)),
                &map_packets(25, 9)[2..],
            ]
            .concat(),
        ),
    ];
    for (name, packets) in seeds {
        let path = folder("wire").join(name);
        if std::env::var_os("GRIPLINE_BLESS").is_some() {
            fs::write(&path, listed(&packets)).unwrap();
        }
        assert_eq!(
            fs::read(&path).unwrap(),
            listed(&packets),
            "{name}: run with GRIPLINE_BLESS=1 after a wire change"
        );
    }
}
