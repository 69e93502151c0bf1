//! What the board is put through beyond what a host of ours sends: packets that cannot be read, maps damaged at every place, messages that are
//! refused, the other link, faults of the board. So that runs meet accesses that only these do; every path and blocking stretch is measured as
//! always.

use gripline_emulator::{Disturbance, LineWiring};
use gripline_protocol::Health;
use gripline_protocol::message::{Bootloader, Command, Configuration, Hello, Message};

use crate::Error;
use crate::measure::{Bench, LONGEST_TAIL, Link, STALE_NS, map_of, slipping};

/// Taxels of a map of four packets.
const CONTACTS: usize = 25;
/// Longer than any message.
const OVERLONG_BYTES: usize = 400;
/// Until a quick release has the line at 0 N and settings may go to flash.
const RELEASED_NS: u64 = 400_000_000;

/// All of it over the link of the bench, which is left with the settings that ship, holding. Its maps count for nothing but their ways.
///
/// # Errors
/// The board's.
pub fn misuse(bench: &mut Bench<'_>) -> Result<(), Error> {
    packets(bench)?;
    messages(bench)?;
    settings(bench)?;
    other_link(bench)?;
    board(bench)?;
    for command in [
        Command::Configure(Configuration::DEFAULT),
        Command::Acknowledge { faults: u32::MAX },
        Command::Hold,
    ] {
        bench.command(command)?;
    }
    Ok(())
}

/// No header, no map, a map with a damaged byte at every fourth place, with a packet twice or out of order; a storm of them.
fn packets(bench: &mut Bench<'_>) -> Result<(), Error> {
    let map = map_of(CONTACTS, 3);
    let whole = bench.packets(&map, |_| {});
    for length in [1, 3, 4, 20, 64] {
        for first in [0xFF].into_iter().chain(whole.iter().map(|packet| packet[0])) {
            let mut packet = vec![0xA5; length];
            packet[0] = first;
            bench.raw(&[packet])?;
        }
        bench.map(&map)?;
    }
    for which in 0..whole.len() {
        for at in (0..whole[which].len()).step_by(4) {
            bench.damaged(&map, |packets| packets[which][at] ^= 0x5A)?;
        }
        bench.damaged(&map, |packets| drop(packets.remove(which)))?;
        bench.damaged(&map, |packets| packets.insert(which, packets[which].clone()))?;
        bench.damaged(&map, |packets| packets[which].truncate(10))?;
        bench.damaged(&map, |packets| packets.swap(0, which))?;
    }
    bench.raw_bytes_over_uart(&[0x55; OVERLONG_BYTES])?;
    bench.raw_bytes_over_uart(&[0, 9, 1, 0, 255, 3, 0, 0])?;
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    bench.map(&map)?;
    Ok(())
}

/// Messages that are refused, or answered with a refusal: of another schema, another host, cut short, out of place.
fn messages(bench: &mut Bench<'_>) -> Result<(), Error> {
    let ours = Hello::of_this_build(0, 1);
    let out_of_range = Configuration {
        sensors: 9,
        ..Configuration::DEFAULT
    };
    let said = [
        Message::Bootloader(Bootloader::Enter),
        Message::Bootloader(Bootloader::Entering),
        Message::Command(Command::Store),
        Message::Command(Command::Configure(out_of_range)),
        Message::Hello(Hello {
            schema_hash: !ours.schema_hash,
            ..ours
        }),
        Message::Command(Command::ReadStatus),
        Message::Hello(Hello { session: 2, ..ours }),
        Message::Hello(ours),
        Message::Command(Command::Release),
        Message::Command(Command::Hold),
    ];
    for over in [Link::Usb, Link::Uart] {
        for message in &said {
            bench.say_over(over, message, |_| {})?;
            bench.say_over(over, message, |packets| packets[0].truncate(9))?;
            bench.say_over(over, message, |packets| packets[0][3] ^= 1)?;
            bench.say_over(over, message, |packets| {
                if let Some(byte) = packets.last_mut().and_then(|packet| packet.last_mut()) {
                    *byte ^= 1;
                }
            })?;
            bench.map_as(&map_of(CONTACTS, 1), |_| {})?;
        }
        bench.command(Command::Acknowledge { faults: u32::MAX })?;
    }
    Ok(())
}

/// Maps under the settings that learn nothing: the reflex, the trend, the feed-forward by the detector's friction.
fn settings(bench: &mut Bench<'_>) -> Result<(), Error> {
    bench.command(Command::Configure(Configuration::CAREFUL))?;
    for slip in (0..=LONGEST_TAIL)
        .step_by(3)
        .chain((0..LONGEST_TAIL).rev().step_by(3))
    {
        bench.map_as(&slipping(LONGEST_TAIL, slip), |_| {})?;
    }
    bench.map_as(&slipping(LONGEST_TAIL, 9), |info| info.health = Health::SATURATED)?;
    bench.command(Command::Configure(Configuration::DEFAULT))
}

/// Packets over the other link: of maps, damaged ones, unreadable ones; its maps once those of this one are stale, and back.
fn other_link(bench: &mut Bench<'_>) -> Result<(), Error> {
    let this = bench.link;
    let other = match this {
        Link::Usb => Link::Uart,
        Link::Uart => Link::Usb,
    };
    let map = map_of(CONTACTS, 5);
    bench.map_as(&map, |_| {})?;
    bench.link = other;
    for number in 0..3 {
        bench.map_as(&map, |_| {})?;
        bench.damaged(&map, |packets| packets[number][5] ^= 1)?;
        bench.raw(&[vec![0xFF; 20]])?;
    }
    bench.run(STALE_NS)?;
    for _ in 0..3 {
        bench.map_as(&map, |_| {})?;
    }
    bench.run(STALE_NS)?;
    bench.link = this;
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    for _ in 0..3 {
        bench.map_as(&map, |_| {})?;
    }
    Ok(())
}

/// Supply, line, the robot's input; held and released, and asked for what needs an empty hand.
fn board(bench: &mut Bench<'_>) -> Result<(), Error> {
    let map = map_of(CONTACTS, 6);
    let disturbances = [
        Disturbance::Supply(2_900),
        Disturbance::Supply(3_300),
        Disturbance::Line(LineWiring::Shorted),
        Disturbance::Line(LineWiring::Sound),
        Disturbance::ReleaseInhibit(true),
        Disturbance::ReleaseInhibit(false),
        Disturbance::BrownOutLevel(3),
        Disturbance::BrownOutLevel(0),
    ];
    for disturbance in disturbances {
        bench.disturb(disturbance);
        for command in [Command::Release, Command::Hold] {
            bench.command(command)?;
            for _ in 0..10 {
                bench.map_as(&map, |_| {})?;
            }
        }
        bench.command(Command::Acknowledge { faults: u32::MAX })?;
    }
    // The object is gone while it is held.
    for contacts in [0, CONTACTS, 0] {
        for _ in 0..40 {
            bench.map_as(&map_of(contacts, 6), |_| {})?;
        }
    }
    let quick = Configuration {
        release_rate: u16::MAX,
        ..Configuration::DEFAULT
    };
    for command in [
        Command::Configure(quick),
        Command::Acknowledge { faults: u32::MAX },
        Command::Release,
    ] {
        bench.command(command)?;
    }
    bench.run(RELEASED_NS)?;
    // While settings go to flash, no map counts: outside of the bound.
    bench.measure_apart(|bench| bench.command(Command::Store))?;
    Ok(())
}
