//! The unmodified image on the emulated board, map after map, every instruction priced.

use std::collections::{BTreeMap, VecDeque};

use gripline_emulator::Board;
use gripline_emulator::usb::{Cable, UsbState};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{ForceMap, Health, MapInfo, TaxelForce, encode_map};

use crate::Error;
use crate::image::Image;
use crate::walk::{Step, Walk};

/// How long the board gets for a map, nanoseconds.
const MAP_NS: u64 = 5_000_000;

/// One packet's way from the FIFO to the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Way {
    /// Instructions, interruptions counted.
    pub instructions: u64,
    /// Cycles at most, interruptions counted.
    pub cycles: u64,
}

/// A board that runs the image under measurement.
#[derive(Debug)]
pub struct Bench<'a> {
    image: &'a Image,
    board: Board,
    walk: Walk<'a>,
    packet: u32,
    sequence: u32,
    message: u8,
    total: Way,
    waiting: VecDeque<Way>,
    open: Option<Way>,
    ways: Vec<Way>,
    masked: u64,
    held_off: Option<u64>,
    /// Where `act` lies, and whether it runs.
    act: (u32, u32),
    in_act: bool,
    alarm: Option<u64>,
    /// Longest stretch with interrupts masked, cycles.
    pub masked_worst: u64,
    /// Longest stretch with the path held off by the tick, cycles.
    pub held_off_worst: u64,
    /// Cycles from the timer's interrupt to the tick: least and most.
    pub tick: (u64, u64),
    /// The longest way of any packet that ended a map.
    pub worst: Way,
    /// Instructions by function since [`Bench::instructions_in`].
    functions: BTreeMap<u32, u64>,
}

impl<'a> Bench<'a> {
    /// Boots, enumerates, shakes hands, holds.
    ///
    /// # Errors
    /// A board that does not run, an image without the functions looked for.
    pub fn new(image: &'a Image, elf: &[u8]) -> Result<Self, Error> {
        let addresses: Vec<u32> = image.instructions.keys().copied().collect();
        let packet = image
            .functions_named("control::Control::packet")
            .find(|one| !one.name.contains("Thunk"));
        let packet = packet.map(|one| one.start).ok_or_else(|| Error::Unexpected {
            expected: "a function Control::packet".to_owned(),
            found: "none".to_owned(),
        })?;
        let act = image
            .functions_named("control::Control::act")
            .find(|one| !one.name.contains("Thunk"));
        let act = act.map_or((0, 0), |one| (one.start, one.end));
        let mut bench = Self {
            image,
            board: Board::boot_traced(elf, &addresses)?,
            walk: Walk::new(image),
            packet,
            sequence: 0,
            message: 0,
            total: Way::default(),
            waiting: VecDeque::new(),
            open: None,
            ways: Vec::new(),
            masked: 0,
            held_off: None,
            act,
            in_act: false,
            alarm: None,
            masked_worst: 0,
            held_off_worst: 0,
            tick: (u64::MAX, 0),
            worst: Way::default(),
            functions: BTreeMap::new(),
        };
        bench.board.usb_cable(Cable::In);
        for _ in 0..1_000 {
            if bench.board.usb_state() == UsbState::Configured {
                break;
            }
            bench.run(1_000_000)?;
        }
        bench.say(&Message::Hello(Hello::of_this_build(0, 1)));
        bench.say(&Message::Command(Command::Hold));
        bench.run(20_000_000)?;
        (bench.masked_worst, bench.held_off_worst, bench.tick) = (0, 0, (u64::MAX, 0));
        Ok(bench)
    }

    fn say(&mut self, message: &Message) {
        self.message += 1;
        let mut bytes = [0; 64];
        if let Ok(mut packets) = MessagePackets::new(message, self.message) {
            while let Some(length) = packets.next_packet(&mut bytes) {
                self.board.usb_send(&bytes[..length]);
            }
        }
    }

    /// Lets time pass and prices what ran.
    ///
    /// # Errors
    /// The board's.
    pub fn run(&mut self, ns: u64) -> Result<(), Error> {
        self.board.run_for(ns)?;
        let trace = self.board.take_trace();
        let mut steps: Vec<Step<'a>> = Vec::new();
        self.walk.take(&trace, |step| steps.push(step));
        for step in steps {
            self.step(&step);
        }
        Ok(())
    }

    fn step(&mut self, step: &Step<'a>) {
        for _ in 0..step.deliveries {
            self.waiting.push_back(self.total);
        }
        self.total.instructions += 1;
        self.total.cycles += u64::from(step.cycles);
        let address = step.instruction.address;
        if let Some(function) = self.image.function_at(address) {
            *self.functions.entry(function.start).or_default() += 1;
            if function.start == address && function.name.contains("TIM5") {
                self.alarm = Some(self.total.cycles);
            }
        }
        if address == self.packet {
            self.open = self.waiting.pop_front();
        }
        // The line is written, or found to show what it must, in `act`.
        let is_act = (self.act.0..self.act.1).contains(&address);
        if self.in_act && !is_act {
            if let Some(from) = self.open.take() {
                self.ways.push(Way {
                    instructions: self.total.instructions - from.instructions,
                    cycles: self.total.cycles - from.cycles,
                });
            } else if let Some(from) = self.alarm.take() {
                let took = self.total.cycles - from;
                self.tick = (self.tick.0.min(took), self.tick.1.max(took));
            }
        }
        self.in_act = is_act;
        if step.is_masked {
            self.masked += u64::from(step.cycles);
            self.masked_worst = self.masked_worst.max(self.masked);
        } else {
            self.masked = 0;
        }
        if let Some(held) = &mut self.held_off {
            *held += u64::from(step.cycles);
            self.held_off_worst = self.held_off_worst.max(*held);
        }
        if step.instruction.text.starts_with("msr basepri") {
            self.held_off = match self.held_off {
                None => Some(0),
                Some(_) => None,
            };
        }
    }

    /// Sends a map and returns its last packet's way.
    ///
    /// # Errors
    /// The board's; a map that does not reach the line.
    pub fn map(
        &mut self,
        map: &ForceMap,
        change: impl FnOnce(&mut MapInfo, &mut Vec<Vec<u8>>),
    ) -> Result<Way, Error> {
        self.sequence += 1;
        let mut info = MapInfo {
            sequence: self.sequence,
            capture_us: (self.board.now_ns() / 1_000) as u32,
            ..MapInfo::default()
        };
        let mut packets = Vec::new();
        change(&mut info, &mut packets);
        packets.clear();
        encode_map(&info, map, |packet| packets.push(packet.to_vec()));
        self.ways.clear();
        for packet in &packets {
            self.board.usb_send(packet);
        }
        self.run(MAP_NS)?;
        let way = self.ways.last().copied().ok_or_else(|| Error::Unexpected {
            expected: "a write to the line for every packet".to_owned(),
            found: "none".to_owned(),
        })?;
        if way.cycles > self.worst.cycles {
            self.worst = way;
        }
        Ok(way)
    }

    /// A question on the control endpoint, answered while maps go on.
    pub fn ask(&mut self) {
        self.board.usb_control([0x80, 6, 0, 2, 0, 0, 255, 0], &[]);
    }

    /// Instructions that ran in functions of this name since the last call.
    pub fn instructions_in(&mut self, names: &[&str]) -> u64 {
        let counted = std::mem::take(&mut self.functions);
        counted
            .iter()
            .filter(|(start, _)| {
                let name = &self.image.functions[start].name;
                names.iter().any(|part| name.contains(part))
            })
            .map(|(_, count)| count)
            .sum()
    }
}

/// A map with so many taxels in contact; `seed` moves places and forces.
#[must_use]
pub fn map_of(contacts: usize, seed: u32) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12_345);
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state
    };
    let mut left = contacts;
    for (place, taxel) in map.taxels.iter_mut().enumerate() {
        if (random() as usize % (400 - place)) < left {
            left -= 1;
            *taxel = TaxelForce {
                x: random() as i16 / 8,
                y: random() as i16 / 8,
                z: (random() as i16 / 4).max(1),
            };
        }
    }
    map
}

/// A flag that makes a map doubtful.
pub const DOUBTFUL: Health = Health::TOO_DARK;
