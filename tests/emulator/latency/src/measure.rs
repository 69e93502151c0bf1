//! The unmodified image on the emulated board, map after map, every instruction priced.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use gripline_emulator::usb::{Cable, UsbState};
use gripline_emulator::{Board, Disturbance};
use gripline_protocol::cobs::{FRAME_MAX, encode_packet};
use gripline_protocol::constants::{LSB_PER_NEWTON, TAXELS_PER_PACKET};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{ForceMap, Health, MapInfo, SensorId, TaxelForce, encode_map};

use crate::Error;
use crate::bound::Loop;
use crate::cycles::{ENTRY, Memory};
use crate::image::{Flow, Function, Image, Masking};
use crate::walk::{Step, Walk};

/// The path's priority as the masks count it.
const PATH_PRIORITY: u32 = 2 << 4;

/// How long the board gets for a map, nanoseconds.
const MAP_NS: u64 = 5_000_000;
/// The same in a sweep: 59 taxels take 0.4 ms on the bus, then comes a tick.
pub const SWEPT_MAP_NS: u64 = 2_000_000;
/// Taxels of a map with the longest last packet, nine of them.
pub const LONGEST_TAIL: usize = 59;
/// Longer than maps are fresh.
pub const STALE_NS: u64 = 120 * TICK_NS;
/// The tick, nanoseconds.
pub const TICK_NS: u64 = 1_000_000;
/// A byte of the UART, ten bits of 921,600 a second.
const UART_BYTE_NS: u64 = 10_851;
/// Time for the first packets of a map, and until messages find the bus free; also that for a last packet.
const PAUSE_NS: u64 = 900_000;
/// From a map's last packet to a write that belongs to it, nanoseconds.
const WRITE_NS: u64 = 40_000;
/// The DAC's holding register of the line (RM0090, DAC_DHR12R1).
const DAC: u32 = 0x4000_7408;
/// The data register of the UART (RM0090, USART1_DR).
pub(crate) const UART_DATA: u32 = 0x4001_1004;
/// The task's interrupt: the tick, and all that the task works on.
const TASK: &str = "UART5";

/// The functions of which every packet of a map runs one.
const PACKETS: [&str; 3] = ["Program<K>::head", "Program<K>::taxels", TAIL];
/// The one of a map's last packet.
const TAIL: &str = "Program<K>::tail";

/// One packet's way from the FIFO to the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Transit {
    /// Instructions, interruptions counted.
    pub instructions: u64,
    /// Cycles at most, interruptions counted.
    pub cycles: u64,
    /// Of these, until the path's interrupt was entered: the way into it, and what blocked it.
    pub waited: u64,
    /// The instruction that blocked the path as the packet landed; 0 when nothing did.
    pub blocked_at: u32,
    /// The task `control` was at work as the packet landed.
    pub meets_task: bool,
    /// It wrote the DAC.
    pub writes: bool,
    /// The line is higher than before it.
    pub raises: bool,
    /// What it came over.
    pub link: Link,
}

/// How maps go to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Link {
    /// USB: the last word of a packet in the FIFO.
    #[default]
    Usb,
    /// The UART: a map's last byte.
    Uart,
}

/// A stretch with the path blocked, as runs met it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Met {
    /// Its longest time, cycles.
    pub cycles: u64,
    /// The longest that a map's last packet waited for it, cycles.
    pub waited: u64,
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
    total: Transit,
    /// The handlers of the USB core and of the UART, and the cycles of all but them.
    path: u32,
    uart: u32,
    below: u64,
    /// How maps go to the board.
    pub link: Link,
    /// The byte in the UART's receiver, and the one that was last read from there.
    byte_landed: Option<(Transit, u32, bool)>,
    byte: Option<(Transit, u32, bool)>,
    waiting: VecDeque<Transit>,
    open: Option<Transit>,
    /// From the function of a map's last packet to the line.
    is_tail: bool,
    transits: Vec<Transit>,
    masked: u64,
    /// Priorities that the running code was raised to, when, and by which instruction, the outermost first.
    held: Vec<(u32, u64, u32)>,
    /// The stretches that blocked the path, by the instruction that they begin with.
    pub met: BTreeMap<u32, Met>,
    /// The newest packet's: whether the path was blocked as it landed, and whether the task ran.
    landed: VecDeque<(u32, bool)>,
    task: u32,
    /// When each of the path's handlers was entered.
    entered: u64,
    uart_entered: u64,
    /// Virtual time since power-on, nanoseconds.
    now_ns: u64,
    priorities: BTreeMap<u32, u32>,
    /// Where `write_line` lies, and whether the last instruction was its return.
    act: (u32, u32),
    is_written: bool,
    /// The last instruction was the path's interrupt's.
    in_path: bool,
    /// The timer's interrupt, and when it was entered.
    alarm_handler: u32,
    alarm: Option<u64>,
    /// Longest stretch with the path blocked, cycles.
    pub blocking_worst: u64,
    /// Longest stretch with everything but the path blocked, cycles.
    pub section_worst: u64,
    /// Cycles from the timer's interrupt to the tick: least and most.
    pub tick: (u64, u64),
    /// The longest way of any packet that ended a map, by link.
    pub worst: [Transit; 2],
    /// The longest ways by the number of taxels in the last packet, by link.
    pub worst_by_tail: [[Transit; TAXELS_PER_PACKET]; 2],
    /// Instructions of the path by function (its place in the image), since [`Bench::counted`].
    functions: Vec<u64>,
    /// Loops that are watched, by function.
    loops: Vec<Vec<Watched>>,
    /// The slowest peripheral that an instruction accessed.
    accesses: BTreeMap<u32, Memory>,
    /// Whether an instruction that moves data ran, by its place in the image.
    has_moved: Vec<bool>,
    /// Cycles by function since a packet landed while none was under way.
    spent: Vec<u64>,
    /// Where the worst ways' cycles went, by function.
    pub worst_spent: [Vec<u64>; 2],
    /// The steps of a run, kept for their memory.
    steps: Vec<Step<'a>>,
}

impl<'a> Bench<'a> {
    /// Boots, enumerates, shakes hands, holds.
    ///
    /// # Errors
    /// A board that does not run, an image without the functions looked for.
    pub fn new(image: &'a Image, elf: &[u8]) -> Result<Self, Error> {
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
        let start_of = |name: &str| {
            let found = image.functions.values().find(|one| one.name == name);
            found.map(|one| one.start).ok_or_else(|| Error::Unexpected {
                expected: format!("the function {name}"),
                found: "none".to_owned(),
            })
        };
        let mut bench = Self {
            image,
            board: Board::boot_traced(elf, &image.entries())?,
            walk: Walk::new(image),
            packets,
            sequence: 0,
            message: 0,
            total: Transit::default(),
            path: start_of("OTG_FS")?,
            uart: start_of("USART1")?,
            below: 0,
            link: Link::Usb,
            byte_landed: None,
            byte: None,
            waiting: VecDeque::new(),
            open: None,
            is_tail: false,
            transits: Vec::new(),
            masked: 0,
            held: Vec::new(),
            met: BTreeMap::new(),
            landed: VecDeque::new(),
            task: start_of(TASK)?,
            entered: 0,
            uart_entered: 0,
            now_ns: 0,
            priorities: BTreeMap::new(),
            act,
            is_written: false,
            in_path: false,
            alarm_handler: start_of("TIM5")?,
            alarm: None,
            blocking_worst: 0,
            section_worst: 0,
            tick: (u64::MAX, 0),
            worst: Default::default(),
            worst_by_tail: Default::default(),
            functions: vec![0; image.functions.len()],
            loops: vec![Vec::new(); image.functions.len()],
            accesses: BTreeMap::new(),
            has_moved: vec![false; image.instructions.len()],
            spent: vec![0; image.functions.len()],
            worst_spent: Default::default(),
            steps: Vec::new(),
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
        for packet in packets_of(message, self.message) {
            self.board.usb_send(&packet);
        }
    }

    /// Lets time pass and prices what ran.
    ///
    /// # Errors
    /// The board's.
    pub fn run(&mut self, ns: u64) -> Result<(), Error> {
        self.board.run_for(ns)?;
        self.now_ns += ns;
        let trace = self.board.take_trace();
        let mut steps = std::mem::take(&mut self.steps);
        steps.clear();
        self.walk.take(&trace, |step| steps.push(step))?;
        for step in &steps {
            self.step(step);
        }
        self.steps = steps;
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

    /// Adds what another board of the same image met. Its loops have to be the same.
    pub fn join(&mut self, other: &Self) {
        for link in [Link::Usb, Link::Uart].map(|link| link as usize) {
            if other.worst[link].cycles > self.worst[link].cycles {
                self.worst[link] = other.worst[link];
                self.worst_spent[link].clone_from(&other.worst_spent[link]);
            }
            for (mine, its) in self.worst_by_tail[link]
                .iter_mut()
                .zip(&other.worst_by_tail[link])
            {
                if its.cycles > mine.cycles {
                    *mine = *its;
                }
            }
        }
        for (at, its) in &other.met {
            let mine = self.met.entry(*at).or_default();
            mine.cycles = mine.cycles.max(its.cycles);
            mine.waited = mine.waited.max(its.waited);
        }
        self.blocking_worst = self.blocking_worst.max(other.blocking_worst);
        self.section_worst = self.section_worst.max(other.section_worst);
        self.tick = (self.tick.0.min(other.tick.0), self.tick.1.max(other.tick.1));
        for (at, its) in &other.accesses {
            let mine = self.accesses.entry(*at).or_insert(*its);
            *mine = (*mine).max(*its);
        }
        for (mine, its) in self.has_moved.iter_mut().zip(&other.has_moved) {
            *mine |= *its;
        }
        let its = other.loops.iter().flatten();
        for (mine, its) in self.loops.iter_mut().flatten().zip(its) {
            mine.most = mine.most.max(its.most);
        }
    }

    fn step(&mut self, step: &Step<'a>) {
        let address = step.instruction.address;
        self.note_landed(step);
        self.total.instructions += 1;
        self.total.cycles += u64::from(step.cycles);
        if !self.is_path(step) {
            self.below += u64::from(step.cycles);
        } else if address == self.path {
            self.entered = self.total.cycles - u64::from(step.cycles);
        } else if address == self.uart {
            self.uart_entered = self.total.cycles - u64::from(step.cycles);
        }
        // Its handler may be entered to send a byte, and read one that lands meanwhile.
        if step.access == Some(UART_DATA) && step.instruction.name == "ldr" {
            self.byte = self.byte_landed.take();
        }
        if step.instruction.data.transfers > 0 {
            self.has_moved[step.instruction.number] = true;
        }
        if let Some(access) = step.access {
            let slowest = self.accesses.entry(address).or_insert(Memory::Coupled);
            *slowest = (*slowest).max(Memory::of(access));
        }
        self.count(step);
        self.note_way(step);
        self.note_masks(step);
    }

    /// Whether a handler of the path runs.
    fn is_path(&self, step: &Step<'a>) -> bool {
        step.exception == Some(self.path) || step.exception == Some(self.uart)
    }

    /// Packets landed in the FIFO, bytes in the receiver.
    fn note_landed(&mut self, step: &Step<'a>) {
        let address = step.instruction.address;
        if step.deliveries > 0 && self.waiting.is_empty() && self.open.is_none() {
            self.spent.fill(0);
        }
        // The interrupt is left, or entered again: what it was entered for and no function took is a message, which waits for the task.
        if self.in_path && (step.exception != Some(self.path) || address == self.path) {
            let entered = self.entered;
            while self.waiting.front().is_some_and(|from| from.cycles <= entered) {
                self.waiting.pop_front();
                self.landed.pop_front();
            }
        }
        self.in_path = step.exception == Some(self.path);
        let blocked_at = self.held.iter().find(|(priority, ..)| *priority <= PATH_PRIORITY);
        let blocked_at = blocked_at.map_or(0, |(.., at)| *at);
        let meets_task = step.exception == Some(self.task);
        if step.uart_bytes > 0 && self.byte_landed.is_none() {
            if self.waiting.is_empty() && self.open.is_none() {
                self.spent.fill(0);
            }
            let entry = if address == self.uart { u64::from(ENTRY) } else { 0 };
            let transit = Transit {
                cycles: self.total.cycles - entry,
                link: Link::Uart,
                ..self.total
            };
            self.byte_landed = Some((transit, blocked_at, meets_task));
        }
        for _ in 0..step.deliveries {
            // A core that slept entered the interrupt with the packet: that belongs to its way.
            let entry = if address == self.path { u64::from(ENTRY) } else { 0 };
            self.waiting.push_back(Transit {
                cycles: self.total.cycles - entry,
                ..self.total
            });
            self.landed.push_back((blocked_at, meets_task));
        }
    }

    /// Counts by function, and rounds of loops.
    fn count(&mut self, step: &Step<'a>) {
        let is_blocked = self.held.iter().any(|(priority, ..)| *priority <= PATH_PRIORITY);
        let (address, is_tail) = (step.instruction.address, self.is_tail);
        let Some(function) = step.instruction.function else {
            return;
        };
        if self.is_path(step) {
            self.functions[function] += 1;
        }
        for one in &mut self.loops[function] {
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
        self.spent[function] += u64::from(step.cycles);
        if address == self.alarm_handler {
            self.alarm = Some(self.total.cycles);
        }
    }

    /// A packet of a map begins its way, or ends it.
    fn note_way(&mut self, step: &Step<'a>) {
        let address = step.instruction.address;
        if self.packets.contains(&address) {
            self.is_tail = self.image.functions[&address].name.contains(TAIL);
            let (from, entered) = if step.exception == Some(self.uart) {
                (self.byte.take(), self.uart_entered)
            } else {
                let (blocked_at, meets_task) = self.landed.pop_front().unwrap_or_default();
                let from = self.waiting.pop_front();
                (from.map(|from| (from, blocked_at, meets_task)), self.entered)
            };
            let from = from.filter(|_| self.is_tail);
            self.open = from.map(|(from, blocked_at, meets_task)| Transit {
                blocked_at,
                meets_task,
                waited: entered.saturating_sub(from.cycles),
                ..from
            });
        }
        if step.access == Some(DAC)
            && let Some(open) = &mut self.open
        {
            open.writes = true;
        }
        // The line is written, or found to show what it must, in `write_line`.
        if std::mem::take(&mut self.is_written) {
            self.is_tail = false;
            if let Some(from) = self.open.take() {
                let transit = Transit {
                    instructions: self.total.instructions - from.instructions,
                    cycles: self.total.cycles - from.cycles,
                    ..from
                };
                let link = transit.link as usize;
                if transit.cycles > self.worst[link].cycles {
                    self.worst[link] = transit;
                    self.worst_spent[link].clone_from(&self.spent);
                }
                self.spent.fill(0);
                if from.blocked_at != 0 {
                    let met = self.met.entry(from.blocked_at).or_default();
                    met.waited = met.waited.max(from.waited);
                }
                self.transits.push(transit);
            } else if let Some(from) = self.alarm.take() {
                let took = self.total.cycles - from;
                self.tick = (self.tick.0.min(took), self.tick.1.max(took));
            }
        }
        // A last packet that ends no map that counts writes no line.
        let its_interrupt = self.open.map(|open| match open.link {
            Link::Usb => self.path,
            Link::Uart => self.uart,
        });
        if its_interrupt.is_some() && step.exception != its_interrupt {
            self.open = None;
            self.is_tail = false;
        }
        let is_act = (self.act.0..self.act.1).contains(&address);
        self.is_written = is_act && step.instruction.flow == Flow::Return;
    }

    /// Who blocks the path, and for how long.
    fn note_masks(&mut self, step: &Step<'a>) {
        // Both masks are raised and lowered in pairs, one inside the other.
        let (masking, address) = (step.instruction.masking, step.instruction.address);
        if masking == Masking::Raises {
            let priority = self.raised_to(address);
            self.held.push((priority, self.below, address));
        } else if masking == Masking::Restores
            && let Some((priority, from, at)) = self.held.pop()
            && priority <= PATH_PRIORITY
        {
            // The way into an interrupt that waited belongs to that.
            let entry = if step.enters { u64::from(ENTRY) } else { 0 };
            let met = self.met.entry(at).or_default();
            met.cycles = met.cycles.max(self.below - from - entry);
        }
        let since = |is_it: &dyn Fn(u32) -> bool| {
            let first = self.held.iter().find(|(priority, ..)| is_it(*priority));
            first.map_or(0, |(_, from, _)| self.below - from)
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
    pub fn map(&mut self, map: &ForceMap) -> Result<Transit, Error> {
        whole(self.changed(map, MAP_NS, |_| {}, |_| {})?)
    }

    /// Sends a map so many nanoseconds after a tick's millisecond began.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn map_at(
        &mut self,
        phase_ns: u64,
        map: &ForceMap,
        change: impl FnOnce(&mut MapInfo),
    ) -> Result<Transit, Error> {
        self.run_to(phase_ns)?;
        whole(self.changed(map, SWEPT_MAP_NS, change, |_| {})?)
    }

    /// Lets time pass until so many nanoseconds after a tick's millisecond began.
    ///
    /// # Errors
    /// The board's.
    pub fn run_to(&mut self, phase_ns: u64) -> Result<(), Error> {
        let phase_ns = phase_ns % TICK_NS;
        self.run((TICK_NS + phase_ns - self.now_ns % TICK_NS) % TICK_NS)
    }

    /// Sends a map whose head says something else than the truth. No way when it counts for nothing.
    ///
    /// # Errors
    /// The board's.
    pub fn map_as(
        &mut self,
        map: &ForceMap,
        change: impl FnOnce(&mut MapInfo),
    ) -> Result<Option<Transit>, Error> {
        self.changed(map, MAP_NS, change, |_| {})
    }

    /// Sends a map whose packets are damaged. No way, because it counts for nothing.
    ///
    /// # Errors
    /// The board's.
    pub fn damaged(
        &mut self,
        map: &ForceMap,
        damage: impl FnOnce(&mut Vec<Vec<u8>>),
    ) -> Result<Option<Transit>, Error> {
        self.changed(map, MAP_NS, |_| {}, damage)
    }

    /// Sends packets that end no map that counts.
    ///
    /// # Errors
    /// The board's.
    pub fn raw(&mut self, packets: &[Vec<u8>]) -> Result<(), Error> {
        self.delivered(packets, MAP_NS).map(drop)
    }

    /// Sends bytes over the UART that are no frames.
    ///
    /// # Errors
    /// The board's.
    pub fn raw_bytes_over_uart(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.board.uart_send(bytes);
        self.run(bytes.len() as u64 * UART_BYTE_NS + MAP_NS)
    }

    /// Says something over a link, in packets that `damage` has changed.
    ///
    /// # Errors
    /// The board's.
    pub fn say_over(
        &mut self,
        link: Link,
        message: &Message,
        damage: impl FnOnce(&mut Vec<Vec<u8>>),
    ) -> Result<(), Error> {
        self.message += 1;
        let mut packets: Vec<Vec<u8>> = packets_of(message, self.message);
        damage(&mut packets);
        let maps = std::mem::replace(&mut self.link, link);
        let said = self.raw(&packets);
        self.link = maps;
        said
    }

    /// What happens to the board from the next run on.
    pub fn disturb(&mut self, disturbance: Disturbance) {
        self.board.disturb(disturbance);
    }

    /// Sends maps of these sensors back to back, as fast as the bus takes them. Returns their ways.
    ///
    /// # Errors
    /// The board's.
    pub fn stream(
        &mut self,
        map: &ForceMap,
        sensors: impl Iterator<Item = SensorId>,
    ) -> Result<Vec<Transit>, Error> {
        self.transits.clear();
        let mut lasts_ns = 0;
        for sensor in sensors {
            let packets = self.packets(map, |info| info.sensor = sensor);
            lasts_ns += self.send(&packets);
        }
        self.run(lasts_ns)?;
        while self.board.usb_waiting() > 0 {
            self.run(TICK_NS / 4)?;
        }
        self.run(TICK_NS)?;
        let transits = std::mem::take(&mut self.transits);
        for transit in &transits {
            self.note(map, *transit);
        }
        Ok(transits)
    }

    fn changed(
        &mut self,
        map: &ForceMap,
        ns: u64,
        change: impl FnOnce(&mut MapInfo),
        damage: impl FnOnce(&mut Vec<Vec<u8>>),
    ) -> Result<Option<Transit>, Error> {
        let mut packets = self.packets(map, change);
        damage(&mut packets);
        let transit = self.delivered(&packets, ns)?;
        if let Some(transit) = transit {
            self.note(map, transit);
        }
        Ok(transit)
    }

    /// A map whose host pauses before the last packet, which it sends so many nanoseconds after a tick's millisecond began; over the UART,
    /// its last byte lands then.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn last_packet_at(
        &mut self,
        phase_ns: u64,
        map: &ForceMap,
        change: impl FnOnce(&mut MapInfo),
    ) -> Result<Transit, Error> {
        let packets = self.packets(map, change);
        self.send_but_last(&packets)?;
        let lasts_ns = match self.link {
            Link::Usb => 0,
            Link::Uart => packets
                .last()
                .map_or(0, |packet| line_ns(std::slice::from_ref(packet))),
        };
        self.run_to(phase_ns + TICK_NS - lasts_ns % TICK_NS)?;
        let transit = whole(self.send_last(&packets)?)?;
        self.note(map, transit);
        Ok(transit)
    }

    /// Sends all packets of a map but the last one, and waits until messages find the bus free.
    ///
    /// # Errors
    /// The board's.
    pub fn send_but_last(&mut self, packets: &[Vec<u8>]) -> Result<(), Error> {
        let first = packets.split_last().map_or(packets, |(_, first)| first);
        let lasts_ns = self.send(first);
        self.run(PAUSE_NS + lasts_ns)
    }

    /// Sends the last one. No way when the map counts for nothing.
    ///
    /// # Errors
    /// The board's.
    pub fn send_last(&mut self, packets: &[Vec<u8>]) -> Result<Option<Transit>, Error> {
        let last = packets.last().map(std::slice::from_ref);
        self.delivered(last.unwrap_or_default(), PAUSE_NS)
    }

    /// Puts packets on the link of maps. Returns how long they take on the UART's line.
    fn send(&mut self, packets: &[Vec<u8>]) -> u64 {
        match self.link {
            Link::Usb => {
                for packet in packets {
                    self.board.usb_send(packet);
                }
                0
            }
            Link::Uart => {
                self.board.uart_send(&framed(packets));
                line_ns(packets)
            }
        }
    }

    /// Sends packets, of which the last one ends a map. Returns its way, if the map counts.
    fn delivered(&mut self, packets: &[Vec<u8>], ns: u64) -> Result<Option<Transit>, Error> {
        self.transits.clear();
        let (before, written) = (self.board.dac_code(1), self.board.dac_writes().len());
        let lasts_ns = self.send(packets);
        let landed_ns = self.now_ns + lasts_ns;
        self.run(ns + lasts_ns)?;
        let Some(mut transit) = self.transits.last().copied() else {
            return Ok(None);
        };
        // What the DAC showed right after the last packet.
        let landed_ns = match self.link {
            Link::Usb => self.board.usb_deliveries_ns().last().copied().unwrap_or_default(),
            Link::Uart => landed_ns,
        };
        let shown = self.board.dac_writes()[written..]
            .iter()
            .rfind(|write| write.at_ns <= landed_ns + WRITE_NS)
            .map(|write| write.code);
        transit.raises = transit.writes && shown > before;
        Ok(Some(transit))
    }

    /// As [`Bench::map`], with a question on the control endpoint so many nanoseconds after its first packet.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn map_asking_after(&mut self, ns: u64, map: &ForceMap) -> Result<Transit, Error> {
        self.transits.clear();
        for packet in self.packets(map, |_| {}) {
            self.board.usb_send(&packet);
        }
        self.run(ns)?;
        self.ask();
        self.run(SWEPT_MAP_NS)?;
        Ok(self.transits.last().copied().unwrap_or_default())
    }

    /// Measures what counts for nothing else; returns its worst way.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn measure_apart(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<(), Error>,
    ) -> Result<Transit, Error> {
        let kept = (self.worst, self.worst_spent.clone(), self.worst_by_tail);
        let times = (self.blocking_worst, self.section_worst, self.tick);
        self.worst = Default::default();
        work(self)?;
        let [worst, _] = self.worst;
        (self.worst, self.worst_spent, self.worst_by_tail) = kept;
        (self.blocking_worst, self.section_worst, self.tick) = times;
        Ok(worst)
    }

    /// Cycles of a byte on the UART's line, as the firmware set the port up: ten bits of so many clocks of 84 MHz (RM0090, section 30.3.4).
    ///
    /// # Errors
    /// The board's.
    pub fn uart_byte_cycles(&mut self) -> Result<u64, Error> {
        const USART1_BRR: u32 = 0x4001_1008;
        const CYCLES_PER_CLOCK: u64 = 2;
        const BITS: u64 = 10;
        let bytes = self.board.read_memory(USART1_BRR, 2)?;
        let clocks = bytes
            .iter()
            .rev()
            .fold(0, |all, byte| all << 8 | u64::from(*byte));
        Ok(BITS * clocks * CYCLES_PER_CLOCK)
    }

    /// When bulk packets landed in the FIFO, nanoseconds since power-on.
    #[must_use]
    pub fn deliveries_ns(&self) -> &[u64] {
        self.board.usb_deliveries_ns()
    }

    /// Instructions whose accesses a run met.
    #[must_use]
    pub fn accessed(&self) -> BTreeSet<u32> {
        let moved = self.image.instructions.keys().zip(&self.has_moved);
        moved.filter(|(_, moved)| **moved).map(|(at, _)| *at).collect()
    }

    /// The packets of a new map.
    pub fn packets(&mut self, map: &ForceMap, change: impl FnOnce(&mut MapInfo)) -> Vec<Vec<u8>> {
        self.sequence += 1;
        let mut info = MapInfo {
            sequence: self.sequence,
            capture_us: (self.board.now_ns() / 1_000) as u32,
            ..MapInfo::default()
        };
        change(&mut info);
        let mut packets = Vec::new();
        encode_map(&info, map, |packet| packets.push(packet.to_vec()));
        packets
    }

    /// Keeps the worst way of a map with such a last packet.
    fn note(&mut self, map: &ForceMap, transit: Transit) {
        let of_link = &mut self.worst_by_tail[transit.link as usize];
        let of_tail = &mut of_link[usize::from(map.active().count()) % TAXELS_PER_PACKET];
        if transit.cycles > of_tail.cycles {
            *of_tail = transit;
        }
    }

    /// A command over the UART.
    pub fn send_over_uart(&mut self, command: Command) {
        self.message += 1;
        self.board.uart_send(&frames(command, self.message));
    }

    /// A map over USB on its way.
    pub fn send_over_usb(&mut self, map: &ForceMap) {
        for packet in self.packets(map, |_| {}) {
            self.board.usb_send(&packet);
        }
    }

    /// A map whose last packet comes so many nanoseconds after `meet`, which happens at that phase of a tick's millisecond.
    ///
    /// # Errors
    /// As [`Bench::map`].
    pub fn last_packet_meets(
        &mut self,
        phase_ns: u64,
        after_ns: u64,
        map: &ForceMap,
        meet: impl FnOnce(&mut Self),
    ) -> Result<Transit, Error> {
        let packets = self.packets(map, |_| {});
        self.send_but_last(&packets)?;
        let lasts_ns = packets
            .last()
            .map_or(0, |packet| line_ns(std::slice::from_ref(packet)));
        self.run_to(phase_ns)?;
        self.transits.clear();
        let last = packets.last().map(std::slice::from_ref).unwrap_or_default();
        let line_ns = self.send(last);
        self.run(lasts_ns.saturating_sub(after_ns))?;
        meet(self);
        self.run(line_ns + PAUSE_NS)?;
        let transit = whole(self.transits.last().copied())?;
        self.note(map, transit);
        Ok(transit)
    }

    /// How long its bytes take, nanoseconds.
    #[must_use]
    pub fn uart_ns(&self, command: Command) -> u64 {
        frames(command, 0).len() as u64 * UART_BYTE_NS
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
            functions: std::mem::replace(&mut self.functions, vec![0; self.image.functions.len()]),
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
            let header = self.image.instructions.get(&one.header);
            let Some(function) = header.and_then(|header| header.function) else {
                continue;
            };
            self.loops[function].push(Watched {
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
        let loops = self.loops.iter().flatten().filter(|one| one.most > one.of.rounds);
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
    functions: Vec<u64>,
}

impl Counted<'_> {
    /// Those in functions whose names contain one of these.
    #[must_use]
    pub fn of(&self, names: &[&str]) -> u64 {
        let functions = self.image.functions.values().zip(&self.functions);
        functions
            .filter(|(Function { name, .. }, _)| {
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

#[derive(Debug, Clone)]
struct Watched {
    of: Loop,
    when: When,
    rounds: u32,
    most: u32,
}

/// The way of a map that has to count.
///
/// # Errors
/// There is none.
pub fn whole(transit: Option<Transit>) -> Result<Transit, Error> {
    transit.ok_or_else(|| Error::Unexpected {
        expected: "a write to the line for every map".to_owned(),
        found: "none".to_owned(),
    })
}

/// A command's bytes on the UART's line.
fn frames(command: Command, id: u8) -> Vec<u8> {
    framed(&packets_of(&Message::Command(command), id))
}

/// A message's packets.
fn packets_of(message: &Message, id: u8) -> Vec<Vec<u8>> {
    let packets = MessagePackets::new(message, id).into_iter().flatten();
    packets.map(|packet| packet.to_vec()).collect()
}

/// Packets as they are on the UART's line.
fn framed(packets: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for packet in packets {
        let mut frame = [0; FRAME_MAX];
        let length = encode_packet(packet, &mut frame);
        bytes.extend(&frame[..length]);
    }
    bytes
}

/// How long they take there, nanoseconds.
fn line_ns(packets: &[Vec<u8>]) -> u64 {
    framed(packets).len() as u64 * UART_BYTE_NS
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

/// A map with so many taxels in contact that share this shear, newtons, and five times as much normal force.
#[must_use]
pub fn even(contacts: usize, shear_n: f64) -> ForceMap {
    let mut map = ForceMap::EMPTY;
    let shear = shear_n * f64::from(LSB_PER_NEWTON) / contacts as f64;
    map.taxels[..contacts].fill(TaxelForce {
        x: shear.round() as i16,
        y: 0,
        z: (5.0 * shear).round() as i16,
    });
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
