//! The unmodified image on the emulated board, map after map, every instruction priced.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use gripline_emulator::Board;
use gripline_emulator::usb::{Cable, UsbState};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{ForceMap, Health, MapInfo, TaxelForce, encode_map};

use crate::Error;
use crate::bound::Loop;
use crate::cycles::Memory;
use crate::image::Image;
use crate::walk::{Step, Walk};

/// The path's priority as the masks count it.
const PATH_PRIORITY: u32 = 2 << 4;

/// How long the board gets for a map, nanoseconds.
const MAP_NS: u64 = 5_000_000;

/// The functions of which every packet runs one.
const PACKETS: [&str; 4] = ["Program<K>::head", "Program<K>::taxels", TAIL, MESSAGE];
/// The one of a map's last packet.
const TAIL: &str = "Program<K>::tail";
/// The one of messages, which do not go to the line.
const MESSAGE: &str = "Control::message_packet";

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
    packets: BTreeSet<u32>,
    sequence: u32,
    message: u8,
    total: Way,
    /// The path's handler, and the cycles of all but it.
    path: u32,
    below: u64,
    waiting: VecDeque<Way>,
    open: Option<Way>,
    /// From the function of a map's last packet to the line.
    is_tail: bool,
    ways: Vec<Way>,
    masked: u64,
    /// Priorities that the running code was raised to, and when, the outermost first.
    held: Vec<(u32, u64)>,
    priorities: BTreeMap<u32, u32>,
    /// Where `write_line` lies, and whether it runs.
    act: (u32, u32),
    in_act: bool,
    alarm: Option<u64>,
    /// Longest stretch with the path blocked, cycles.
    pub blocking_worst: u64,
    /// Longest stretch with everything but the path blocked, cycles.
    pub section_worst: u64,
    /// Cycles from the timer's interrupt to the tick: least and most.
    pub tick: (u64, u64),
    /// The longest way of any packet that ended a map.
    pub worst: Way,
    /// Instructions of the path by function, since [`Bench::counted`].
    functions: BTreeMap<u32, u64>,
    /// Loops that are watched, by function.
    loops: BTreeMap<u32, Vec<Watched>>,
    /// The slowest peripheral that an instruction accessed.
    accesses: BTreeMap<u32, Memory>,
    /// Cycles by function since a packet landed while none was under way.
    spent: BTreeMap<u32, u64>,
    last_spent: BTreeMap<u32, u64>,
    /// Where the worst way's cycles went.
    pub worst_spent: BTreeMap<u32, u64>,
}

impl<'a> Bench<'a> {
    /// Boots, enumerates, shakes hands, holds.
    ///
    /// # Errors
    /// A board that does not run, an image without the functions looked for.
    pub fn new(image: &'a Image, elf: &[u8]) -> Result<Self, Error> {
        let addresses: Vec<u32> = image.instructions.keys().copied().collect();
        let packets: BTreeSet<u32> = PACKETS
            .iter()
            .filter_map(|name| {
                image
                    .functions_named(name)
                    .find(|one| !one.name.contains("Thunk"))
            })
            .map(|one| one.start)
            .collect();
        if packets.len() != PACKETS.len() {
            return Err(Error::Unexpected {
                expected: format!("the functions {PACKETS:?}"),
                found: format!("{} of them", packets.len()),
            });
        }
        let act = image
            .functions_named(crate::tables::WRITE_LINE)
            .find(|one| !one.name.contains("Thunk"));
        let act = act.map_or((0, 0), |one| (one.start, one.end));
        let mut bench = Self {
            image,
            board: Board::boot_traced(elf, &addresses)?,
            walk: Walk::new(image),
            packets,
            sequence: 0,
            message: 0,
            total: Way::default(),
            path: image
                .functions_named("OTG_FS")
                .find(|one| one.name == "OTG_FS")
                .map_or(0, |one| one.start),
            below: 0,
            waiting: VecDeque::new(),
            open: None,
            is_tail: false,
            ways: Vec::new(),
            masked: 0,
            held: Vec::new(),
            priorities: BTreeMap::new(),
            act,
            in_act: false,
            alarm: None,
            blocking_worst: 0,
            section_worst: 0,
            tick: (u64::MAX, 0),
            worst: Way::default(),
            functions: BTreeMap::new(),
            loops: BTreeMap::new(),
            accesses: BTreeMap::new(),
            spent: BTreeMap::new(),
            last_spent: BTreeMap::new(),
            worst_spent: BTreeMap::new(),
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
        (bench.blocking_worst, bench.section_worst, bench.tick) = (0, 0, (u64::MAX, 0));
        Ok(bench)
    }

    fn say(&mut self, message: &Message) {
        self.message += 1;
        for packet in MessagePackets::new(message, self.message).into_iter().flatten() {
            self.board.usb_send(&packet);
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

    /// Bytes of the stack that were used so far. Its memory lies between these addresses, the higher one first; a board that powers on
    /// has zeros there.
    ///
    /// # Errors
    /// As [`Bench::run`].
    pub fn stack_used(&mut self, (start, end): (u32, u32)) -> Result<u32, Error> {
        let memory = self.board.read_memory(end, start - end)?;
        let untouched = memory.iter().take_while(|byte| **byte == 0).count();
        Ok(start - end - untouched as u32)
    }

    fn step(&mut self, step: &Step<'a>) {
        if step.deliveries > 0 && self.waiting.is_empty() && self.open.is_none() {
            self.spent.clear();
        }
        for _ in 0..step.deliveries {
            self.waiting.push_back(self.total);
        }
        self.total.instructions += 1;
        self.total.cycles += u64::from(step.cycles);
        if step.exception != Some(self.path) {
            self.below += u64::from(step.cycles);
        }
        let address = step.instruction.address;
        if let Some(access) = step.access {
            let slowest = self.accesses.entry(address).or_insert(Memory::Coupled);
            *slowest = (*slowest).max(Memory::of(access));
        }
        let is_blocked = self.held.iter().any(|(priority, _)| *priority <= PATH_PRIORITY);
        let is_tail = self.is_tail;
        if let Some(function) = self.image.function_at(address) {
            if step.exception == Some(self.path) {
                *self.functions.entry(function.start).or_default() += 1;
            }
            for one in self.loops.get_mut(&function.start).into_iter().flatten() {
                let counts = match one.when {
                    When::Tail => is_tail,
                    When::Blocked => is_blocked,
                };
                if address == one.of.header && counts {
                    one.rounds += 1;
                    one.most = one.most.max(one.rounds);
                } else if !one.of.body.contains(&address) {
                    one.rounds = 0;
                }
            }
            *self.spent.entry(function.start).or_default() += u64::from(step.cycles);
            if function.start == address && function.name.contains("TIM5") {
                self.alarm = Some(self.total.cycles);
            }
        }
        if self.packets.contains(&address) {
            let from = self.waiting.pop_front();
            let is_message = self.image.functions[&address].name.contains(MESSAGE);
            self.open = from.filter(|_| !is_message);
            self.is_tail = self.image.functions[&address].name.contains(TAIL);
        }
        // The line is written, or found to show what it must, in `write_line`.
        let is_act = (self.act.0..self.act.1).contains(&address);
        if self.in_act && !is_act {
            self.is_tail = false;
            if let Some(from) = self.open.take() {
                self.last_spent = std::mem::take(&mut self.spent);
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
        // Both masks are raised and lowered in pairs, one inside the other.
        let text = step.instruction.text.as_str();
        if text.starts_with("msr basepri_max") {
            let priority = self.raised_to(address);
            self.held.push((priority, self.below));
        } else if text.starts_with("msr basepri,") {
            self.held.pop();
        }
        let since = |is_it: &dyn Fn(u32) -> bool| {
            let first = self.held.iter().find(|(priority, _)| is_it(*priority));
            first.map_or(0, |(_, from)| self.below - from)
        };
        let (blocked, section) = (since(&|priority| priority <= PATH_PRIORITY), since(&|_| true));
        self.masked = if step.is_masked {
            self.masked + u64::from(step.cycles)
        } else {
            0
        };
        self.blocking_worst = self.blocking_worst.max(blocked).max(self.masked);
        self.section_worst = self.section_worst.max(section);
    }

    /// The priority that an instruction raises the running code to.
    fn raised_to(&mut self, at: u32) -> u32 {
        if let Some(known) = self.priorities.get(&at) {
            return *known;
        }
        let register = self.image.instructions[&at]
            .text
            .rsplit(' ')
            .next()
            .unwrap_or_default();
        let start = format!(" {register},");
        let constant = self
            .image
            .instructions
            .range(..at)
            .rev()
            .take(64)
            .find_map(|(_, one)| one.text.contains(&start).then_some(one.constant)?);
        let priority = constant.map_or(0, |(_, value, _)| value);
        self.priorities.insert(at, priority);
        priority
    }

    /// Sends a map and returns its last packet's way.
    ///
    /// # Errors
    /// The board's; a map that does not reach the line.
    pub fn map(&mut self, map: &ForceMap) -> Result<Way, Error> {
        self.changed(map, |_| {}, |_| {})
    }

    /// Sends a map whose head says something else than the truth.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn map_as(&mut self, map: &ForceMap, change: impl FnOnce(&mut MapInfo)) -> Result<Way, Error> {
        self.changed(map, change, |_| {})
    }

    /// Sends a map whose packets are damaged.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn damaged(&mut self, map: &ForceMap, damage: impl FnOnce(&mut Vec<Vec<u8>>)) -> Result<Way, Error> {
        self.changed(map, |_| {}, damage)
    }

    fn changed(
        &mut self,
        map: &ForceMap,
        change: impl FnOnce(&mut MapInfo),
        damage: impl FnOnce(&mut Vec<Vec<u8>>),
    ) -> Result<Way, Error> {
        self.sequence += 1;
        let mut info = MapInfo {
            sequence: self.sequence,
            capture_us: (self.board.now_ns() / 1_000) as u32,
            ..MapInfo::default()
        };
        change(&mut info);
        let mut packets = Vec::new();
        encode_map(&info, map, |packet| packets.push(packet.to_vec()));
        damage(&mut packets);
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
            self.worst_spent = self.last_spent.clone();
        }
        Ok(way)
    }

    /// Leaves out so many maps.
    pub fn skip(&mut self, maps: u32) {
        self.sequence += maps;
    }

    /// A question on the control endpoint, answered while maps go on.
    pub fn ask(&mut self) {
        self.board.usb_control([0x80, 6, 0, 2, 0, 0, 255, 0], &[]);
    }

    /// Instructions of the path by function, since the last call.
    pub fn counted(&mut self) -> Counted<'a> {
        Counted {
            image: self.image,
            functions: std::mem::take(&mut self.functions),
        }
    }

    /// A command, carried out before the next map.
    ///
    /// # Errors
    /// The board's.
    pub fn command(&mut self, command: Command) -> Result<(), Error> {
        self.send_command(command);
        self.run(MAP_NS)
    }

    /// A command on its way.
    pub fn send_command(&mut self, command: Command) {
        self.say(&Message::Command(command));
    }

    /// Counts the rounds of these loops from now on, `when` they count.
    pub fn watch<'l>(&mut self, loops: impl Iterator<Item = &'l Loop>, when: When) {
        for one in loops {
            let Some(function) = self.image.function_at(one.header) else {
                continue;
            };
            self.loops.entry(function.start).or_default().push(Watched {
                of: one.clone(),
                when,
                rounds: 0,
                most: 0,
            });
        }
    }

    /// What a run showed against the tables of the walk: loops with more rounds, accesses to slower memories.
    #[must_use]
    pub fn broken(&self, memories: &BTreeMap<u32, Memory>) -> Vec<String> {
        let loops = self
            .loops
            .values()
            .flatten()
            .filter(|one| one.most > one.of.rounds);
        let loops = loops.map(|one| {
            format!(
                "{} rounds of a loop, {} allowed: {}",
                one.most, one.of.rounds, one.of.why
            )
        });
        let accesses = self.accesses.iter().filter_map(|(at, memory)| {
            let priced = memories.get(at).filter(|priced| priced.wait() < memory.wait())?;
            Some(format!("access to {memory:?} at {at:#x}, priced as {priced:?}"))
        });
        loops.chain(accesses).collect()
    }
}

/// Instructions by function.
#[derive(Debug)]
pub struct Counted<'a> {
    image: &'a Image,
    functions: BTreeMap<u32, u64>,
}

impl Counted<'_> {
    /// Those in functions whose names contain one of these.
    #[must_use]
    pub fn of(&self, names: &[&str]) -> u64 {
        self.functions
            .iter()
            .filter(|(start, _)| {
                let name = &self.image.functions[start].name;
                names.iter().any(|part| name.contains(part)) && !name.contains("Thunk")
            })
            .map(|(_, count)| count)
            .sum()
    }
}

/// Where the rounds of a loop count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// From a map's last packet to the line.
    Tail,
    /// With the path blocked.
    Blocked,
}

#[derive(Debug)]
struct Watched {
    of: Loop,
    when: When,
    rounds: u32,
    most: u32,
}

/// A map with so many taxels in contact of which so many slip.
#[must_use]
pub fn slipping(contacts: usize, slipping: usize) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    for (number, taxel) in map.taxels.iter_mut().enumerate().take(contacts) {
        *taxel = TaxelForce {
            x: if number < slipping { 900 } else { 100 },
            y: -50,
            z: 1_000,
        };
    }
    map
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
