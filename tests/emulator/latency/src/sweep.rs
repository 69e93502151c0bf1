//! What the board is put through: every branch, and a map's last packet at every phase of all that may be in its way.
//!
//! Two things block the path at most one after the other: who blocks it lets it run before the next one does. So every phase of each against
//! a map's last packet is enough, and no phase of three things has to be tried. A sweep looks for the task at work with long steps, then goes
//! over those places with steps of 0.15 µs, about 25 cycles. The host pauses before the last packet, so that it meets all that waits for a free bus.
//! Units: nanoseconds of virtual time, cycles.

use gripline_protocol::message::{Command, Configuration};
use gripline_protocol::{Health, SensorId};

use crate::Error;
use crate::measure::{
    Bench, DOUBTFUL, LONGEST_TAIL, Link, STALE_NS, TICK_NS, Transit, even, map_of, slipping, whole,
};
use crate::misuse::misuse;

/// How much is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// A map's last packet at every phase of the tick, and fewer of all else: for every test run.
    Short,
    /// All.
    Full,
}

/// Maps between all kinds of interruption.
const DISTURBED: u64 = 400;
/// Steps of a sweep until the task is at work, and then.
const LONG_NS: u64 = 8_000;
const SHORT_NS: u64 = 150;
/// Steps of a request on the control endpoint, which takes longer.
const ASKED_NS: u64 = 1_000;
/// From before the end of a command over the UART until it has been carried out.
const UART_BEFORE_NS: u64 = 5_000;
const UART_BEHIND_NS: u64 = 45_000;
/// A phase with the tick far away: from the first packet of that map to the last it takes 0.35 ms.
const CALM_NS: u64 = 100_000;
/// The time on the bus of a full packet.
const PACKET_NS: u64 = 52_000;
/// Taxels of a map with the longest last packet in few packets: over the UART each takes 0.7 ms.
const SHORT_MAP: usize = 9;
/// Maps of a stream.
const STREAM: usize = 24;

/// Every branch of a map's end: doubtful, saturated, replayed, from the future, of a finger that is not expected, of two
/// fingers, with a hole before it, damaged; stick, incipient slip, slip, no contact; held, released.
///
/// # Errors
/// The board's.
pub fn branches(bench: &mut Bench<'_>) -> Result<(), Error> {
    for contacts in [0, 9, 59, 400] {
        let map = map_of(contacts, 7);
        bench.map_as(&map, |info| info.health = DOUBTFUL)?;
        bench.map_as(&map, |info| info.health = Health::SATURATED)?;
        bench.map_as(&map, |info| info.sequence = 1)?;
        bench.map_as(&map, |info| {
            info.capture_us = info.capture_us.wrapping_add(60_000_000);
        })?;
        bench.skip(5);
        bench.damaged(&map, |packets| {
            if let Some(byte) = packets.last_mut().and_then(|packet| packet.last_mut()) {
                *byte ^= 1;
            }
        })?;
        bench.damaged(&map, |packets| drop(packets.remove(0)))?;
    }
    let both = Configuration {
        sensors: 2,
        ..Configuration::DEFAULT
    };
    bench.command(Command::Configure(both))?;
    for round in 0..40 {
        bench.map_as(&map_of(59, round), |info| {
            info.sensor = SensorId::ALL[round as usize % 2];
        })?;
    }
    bench.command(Command::Configure(Configuration::DEFAULT))?;
    // A contact that slips ever more: the trend, the reflex, every state.
    for slip in (0..=59).chain((0..59).rev()) {
        bench.map(&slipping(59, slip))?;
    }
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    bench.command(Command::Release)?;
    for round in 0..10 {
        bench.map(&map_of(59, round))?;
    }
    bench.command(Command::Hold)
}

/// Statuses, commands, ticks, log and watchdog at every phase between the packets.
///
/// # Errors
/// The board's.
pub fn disturb(bench: &mut Bench<'_>) -> Result<(), Error> {
    let commands = [
        Command::ReadStatus,
        Command::ReadConfiguration,
        Command::Configure(Configuration::DEFAULT),
        Command::Hold,
    ];
    for round in 0..DISTURBED {
        if round % 3 == 0 {
            bench.send_command(commands[(round / 3) as usize % commands.len()]);
        }
        // Steps that are no part of a millisecond meet the tick at every phase.
        bench.run(round * 37_700 % 1_000_000)?;
        bench.map(&map_of([59, 9, 19, 8][round as usize % 4], round as u32))?;
    }
    Ok(())
}

/// Tries phases with long steps, and those that meet the task again with short ones. Returns the latter.
fn hunt(
    bench: &mut Bench<'_>,
    range_ns: u64,
    mut attempt: impl FnMut(&mut Bench<'_>, u64) -> Result<Transit, Error>,
) -> Result<Vec<u64>, Error> {
    let mut met = Vec::new();
    for phase_ns in (0..range_ns).step_by(LONG_NS as usize) {
        let transit = attempt(bench, phase_ns)?;
        if transit.meets_task || transit.blocked_at != 0 {
            met.push(phase_ns);
        }
    }
    // From the step before the first that met it to the one behind the last.
    let mut phases = Vec::new();
    for phase_ns in met {
        let from_ns = phases
            .last()
            .map_or(0, |last: &u64| last + SHORT_NS)
            .max(phase_ns.saturating_sub(LONG_NS));
        phases.extend((from_ns..phase_ns + LONG_NS).step_by(SHORT_NS as usize));
    }
    for &phase_ns in &phases {
        attempt(bench, phase_ns)?;
    }
    Ok(phases)
}

/// The settings that ship, for so many fingertips.
fn shipped(sensors: u8) -> Configuration {
    Configuration {
        sensors,
        ..Configuration::DEFAULT
    }
}

/// What goes on beside a map and the tick.
#[derive(Debug, Clone, Copy)]
enum Beside {
    Nothing,
    Log,
    Command,
    Usb,
}

/// The last packets of maps of so many contacts at every phase of the tick, beside each of these; beside the first only where little is tried.
fn last_packets(
    bench: &mut Bench<'_>,
    besides: &[Beside],
    contacts: usize,
    sensors: u8,
    length: Length,
) -> Result<(), Error> {
    let tried = if length == Length::Short { 1 } else { besides.len() };
    for beside in &besides[..tried] {
        let mut number = 0;
        hunt(bench, TICK_NS, |bench, phase_ns| {
            number += 1;
            match beside {
                Beside::Nothing => {}
                // A lost map is a fault that comes, and goes with the next map: a line in the log each time.
                Beside::Log => bench.skip(1),
                Beside::Command => bench.send_command(Command::ReadConfiguration),
                Beside::Usb => bench.send_over_usb(&map_of(LONGEST_TAIL, number)),
            }
            bench.last_packet_at(phase_ns, &map_of(contacts, number), |info| {
                info.sensor = SensorId::ALL[number as usize % usize::from(sensors)];
            })
        })?;
    }
    Ok(())
}

/// A map's last packet at every phase of the tick with all that it learns, answers and logs; of a command over the UART; and in
/// streams without a gap, from one fingertip and from two.
///
/// # Errors
/// The board's.
pub fn phases(bench: &mut Bench<'_>, length: Length) -> Result<(), Error> {
    let all = [Beside::Nothing, Beside::Log, Beside::Command];
    for sensors in [1, 2] {
        bench.command(Command::Configure(shipped(sensors)))?;
        last_packets(bench, &all, LONGEST_TAIL, sensors, length)?;
        if length == Length::Short {
            continue;
        }
        // Maps of few packets meet other moments of the tick's work.
        last_packets(bench, &all[..1], SHORT_MAP, sensors, length)?;
        // Around the end of a command over the UART. New settings cut off a map whose sums were begun by the old ones.
        for command in [Command::ReadConfiguration, Command::Configure(shipped(sensors))] {
            let ends_ns = bench.uart_ns(command);
            let from_ns = ends_ns.saturating_sub(PACKET_NS + UART_BEFORE_NS);
            for phase_ns in (from_ns..ends_ns + UART_BEHIND_NS).step_by(SHORT_NS as usize) {
                bench.run_to(CALM_NS)?;
                let packets = bench.packets(&map_of(LONGEST_TAIL, 1), |_| {});
                bench.send_but_last(&packets)?;
                bench.send_over_uart(command);
                bench.run(phase_ns)?;
                let transit = bench.send_last(&packets)?;
                if !matches!(command, Command::Configure(_)) {
                    whole(transit)?;
                }
            }
        }
        for phase_ns in (0..PACKET_NS).step_by(LONG_NS as usize / 4) {
            bench.run_to(phase_ns)?;
            let of = (0..STREAM).map(|number| SensorId::ALL[number % usize::from(sensors)]);
            bench.stream(&map_of(LONGEST_TAIL, phase_ns as u32), of)?;
        }
    }
    bench.command(Command::Configure(Configuration::DEFAULT))
}

/// Maps over the UART: of every number of contacts up to a last packet of each size in the second packet; a last byte at every phase of the tick
/// with all that it learns and logs, and of maps and messages over USB, which do not count meanwhile; maps without a gap; maps that demand more
/// force. Returns those.
///
/// # Errors
/// The board's.
pub fn over_uart(bench: &mut Bench<'_>, length: Length) -> Result<Raises, Error> {
    // The maps over USB become stale first.
    bench.run(STALE_NS)?;
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    bench.link = Link::Uart;
    let most = if length == Length::Short { 20 } else { LONGEST_TAIL };
    for contacts in (0..=most).chain([400]) {
        bench.map(&map_of(contacts, contacts as u32))?;
    }
    let besides = [Beside::Nothing, Beside::Log, Beside::Command, Beside::Usb];
    for sensors in [1, 2] {
        bench.command(Command::Configure(shipped(sensors)))?;
        last_packets(bench, &besides, SHORT_MAP, sensors, length)?;
        // The last byte at every phase of packets over USB: maps, which are refused, and a command.
        let step_ns = if length == Length::Short {
            20 * SHORT_NS
        } else {
            SHORT_NS
        };
        for phase_ns in (0..2 * PACKET_NS).step_by(step_ns as usize) {
            for is_map in [true, false] {
                bench.last_packet_meets(CALM_NS, phase_ns, &map_of(SHORT_MAP, 1), |bench| {
                    if is_map {
                        bench.send_over_usb(&map_of(LONGEST_TAIL, 1));
                    } else {
                        bench.send_command(Command::ReadConfiguration);
                    }
                })?;
            }
        }
        let of = (0..STREAM / 4).map(|number| SensorId::ALL[number % usize::from(sensors)]);
        bench.stream(&map_of(SHORT_MAP, 1), of)?;
    }
    let raises = raises(bench, SHORT_MAP, length)?;
    misuse(bench)?;
    bench.link = Link::Usb;
    bench.run(STALE_NS)?;
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    bench.command(Command::Configure(Configuration::DEFAULT))?;
    Ok(raises)
}

/// Maps that demanded more force.
#[derive(Debug, Clone, Copy, Default)]
pub struct Raises {
    /// How many there were.
    pub asked: u32,
    /// Of these, whose last packet raised the line.
    pub raised: u32,
    /// The longest way of those.
    pub worst: Transit,
}

impl Raises {
    /// Whether there were some, and each raised the line.
    #[must_use]
    pub fn raise_all(&self) -> bool {
        self.asked > 0 && self.raised == self.asked
    }
}

/// Maps that demand more force, with the settings that ship, at phases all over the millisecond and, with short steps, where the task works.
/// They have so many contacts, and go over the link of the bench.
///
/// # Errors
/// The board's.
pub fn raises(bench: &mut Bench<'_>, contacts: usize, length: Length) -> Result<Raises, Error> {
    /// The first load, newtons, times that it grows between two grasps, and how far: the line may stand a newton or a third above what the
    /// load needs, because a slide was tested for, and a map that needs less demands nothing.
    const FIRST_N: f64 = 1.6;
    const STEPS: u32 = 4;
    const GROWTH: f64 = 1.6;
    let mut raises = Raises::default();
    for sensors in [1, 2] {
        bench.command(Command::Configure(shipped(sensors)))?;
        let mut number = 0;
        let met = hunt(bench, TICK_NS, |bench, phase_ns| {
            number = (number + 1) % sensors;
            bench.map_at(phase_ns, &even(contacts, FIRST_N), |info| {
                info.sensor = SensorId::ALL[usize::from(number)];
            })
        })?;
        let everywhere = (0..TICK_NS).step_by(47_000);
        let samples = if length == Length::Short { 8 } else { 40 };
        let near = met.iter().step_by(met.len() / samples + 1).copied();
        // The first grasp ends what the maps of before have left.
        grasp_anew(bench, sensors, contacts, FIRST_N)?;
        let (mut load_n, mut step) = (0.0, STEPS);
        for phase_ns in everywhere.chain(near) {
            if step == STEPS {
                (load_n, step) = (FIRST_N, 0);
                grasp_anew(bench, sensors, contacts, load_n)?;
            }
            step += 1;
            load_n *= GROWTH;
            let sensor = SensorId::ALL[step as usize % usize::from(sensors)];
            let transit = bench.map_at(phase_ns, &even(contacts, load_n), |info| info.sensor = sensor)?;
            raises.asked += 1;
            raises.raised += u32::from(transit.raises);
            if transit.cycles > raises.worst.cycles {
                raises.worst = transit;
            }
            settle(bench, sensors, contacts, load_n)?;
        }
    }
    bench.command(Command::Configure(Configuration::DEFAULT))?;
    Ok(raises)
}

/// Lets go of one object and takes the next one, whose load all fingertips feel.
fn grasp_anew(bench: &mut Bench<'_>, sensors: u8, contacts: usize, load_n: f64) -> Result<(), Error> {
    let quick = Configuration {
        release_rate: u16::MAX,
        ..shipped(sensors)
    };
    for command in [
        Command::Configure(quick),
        Command::Acknowledge { faults: u32::MAX },
        Command::Release,
        Command::Configure(shipped(sensors)),
        Command::Hold,
    ] {
        bench.command(command)?;
    }
    for sensor in SensorId::ALL.into_iter().take(sensors.into()) {
        bench.map_as(&map_of(0, 0), |info| info.sensor = sensor)?;
    }
    for _ in 0..3 {
        settle(bench, sensors, contacts, load_n)?;
    }
    bench.run(10 * TICK_NS)
}

/// Maps of this load from all fingertips, until the line is where they want it.
fn settle(bench: &mut Bench<'_>, sensors: u8, contacts: usize, load_n: f64) -> Result<(), Error> {
    for _ in 0..2 {
        for sensor in SensorId::ALL.into_iter().take(sensors.into()) {
            bench.map_at(CALM_NS, &even(contacts, load_n), |info| info.sensor = sensor)?;
        }
    }
    bench.run(6 * TICK_NS)
}

/// Maps a second.
pub type Rates = [f64; 3];

/// Maps a second that the board takes of streams without a gap: (contacts, fingertips).
///
/// # Errors
/// The board's; a map that is lost.
pub fn rates(bench: &mut Bench<'_>, of: [(usize, u8); 3]) -> Result<Rates, Error> {
    let mut rates = Rates::default();
    for (rate, (contacts, sensors)) in rates.iter_mut().zip(of) {
        bench.command(Command::Configure(shipped(sensors)))?;
        let maps = 2 * STREAM;
        let from = bench.deliveries_ns().len();
        let transits = bench.stream(
            &map_of(contacts, 1),
            (0..maps).map(|number| SensorId::ALL[number % usize::from(sensors)]),
        )?;
        if transits.len() != maps {
            return Err(Error::Unexpected {
                expected: format!("{maps} maps of {contacts} contacts at the line"),
                found: transits.len().to_string(),
            });
        }
        let landed = &bench.deliveries_ns()[from..];
        let [first, .., last] = landed else { continue };
        *rate = maps as f64 * 1e9 / (last - first) as f64;
    }
    bench.command(Command::Configure(Configuration::DEFAULT))?;
    Ok(rates)
}

/// A map's last packet behind a request on the control endpoint, which the HAL's driver takes out of the FIFO: outside of the bound. Returns
/// the worst way, which counts for nothing else.
///
/// # Errors
/// The board's.
pub fn behind_control(bench: &mut Bench<'_>) -> Result<Transit, Error> {
    bench.measure_apart(|bench| {
        for phase_ns in (0..8 * PACKET_NS).step_by(ASKED_NS as usize) {
            bench.run_to(CALM_NS)?;
            bench.map_asking_after(phase_ns, &map_of(LONGEST_TAIL, 1))?;
        }
        Ok(())
    })
}
