//! Everything that `cargo xtask latency` prints, and what of it the design bounds.

use std::fmt::Write as _;
use std::path::Path;

use gripline_protocol::Health;
use gripline_protocol::message::{Command, Configuration};

use crate::bound::{Stretch, Walk, short};
use crate::cycles::ENTRY;
use crate::image::{Function, Image, read};
use crate::measure::{Bench, DOUBTFUL, Way, When, map_of};
use crate::source::Sources;
use crate::stack::{FRAME_BYTES, Stack};
use crate::tables::{KERNEL, LEFT_OUT, LOOPS, Left, RELEASED, WRITE_LINE};
use crate::{Error, twin};

/// Cycles from a map's last packet to the line (DESIGN.md: 25 µs at 168 MHz).
const PATH_CYCLES: u64 = 4_200;
/// Cycles at most that anything blocks that path.
const BLOCKING_CYCLES: u64 = 1_000;
/// Instructions for a dense map, and for a taxel of it.
const DENSE_INSTRUCTIONS: u64 = 10_000;
const TAXEL_INSTRUCTIONS: f64 = 24.0;
/// Bytes of flash and of RAM.
const FLASH_BYTES: u32 = 128 * 1024;
const RAM_BYTES: u32 = 64 * 1024;
/// The priority of the path's interrupt as the masks count it (`priority::PATH`).
const PATH_PRIORITY: u32 = 2 << 4;
/// Cycles that the shortest last packet takes at least from when it is asked for: the host may be at its token's end, then
/// come two bit times, SYNC, PID, eight bytes, CRC and EOP, 100 bits of 12 MHz (USB 2.0 sections 7.1.18 and 8.3).
const LAST_PACKET_CYCLES: u64 = 100 * 14;
/// The register of the USB core (RM0090, OTG_FS_DOEPCTL1) whose write asks for the next packet.
const NEXT_PACKET: u32 = 0x5000_0B20;
/// Where flash and SRAM begin.
const FLASH_START: u32 = 0x0800_0000;
const RAM_START: u32 = 0x1000_0000;
/// Parts that cost less are not told.
const PART_CYCLES: u64 = 100;
/// Maps between all kinds of interruption.
const DISTURBED: u64 = 400;

/// Phases of the tick at which a map's last packet lands, and the tick, nanoseconds.
const SWEPT: u64 = 250;
const TICK_NS: u64 = 1_000_000;

/// The figures.
#[derive(Debug)]
pub struct Report {
    /// Of the path alone, from its interrupt to the line.
    pub path_cycles: u64,
    /// What the path and what blocks it are made of: functions with all that they call, the longest first.
    pub parts: [Vec<(String, u64)>; 2],
    /// Of the path's interrupt to its return, what it does after the line included.
    pub interrupt_cycles: u64,
    /// Of a full packet's interrupt, from when it asks for the next one; a map's last packet may land before it is done with.
    pub taxels_cycles: u64,
    /// Of the longest stretch that blocks the path.
    pub blocking: Stretch,
    /// All such stretches, the longest first.
    pub stretches: Vec<Stretch>,
    /// Bytes of stack of the path, the frame of its exception included.
    pub stack_worst_bytes: u32,
    /// The stack of all contexts, and what the run took of it.
    pub stack: Stack,
    /// Bytes of it that the run took.
    pub stack_measured_bytes: u32,
    /// What the walks left out, and why.
    pub left: Vec<String>,
    /// What stands against the bound.
    pub findings: Vec<String>,
    /// The worst way while nothing else ran.
    pub quiet: Way,
    /// The worst way of all.
    pub worst: Way,
    /// Longest stretch with the path blocked, measured.
    pub blocking_worst: u64,
    /// Longest stretch with everything but the path blocked, measured.
    pub section_worst: u64,
    /// Timer to tick, least and most.
    pub tick: (u64, u64),
    /// Instructions of the kernel over a dense map, and of the head packet's.
    pub dense: u64,
    /// Instructions for the head of a dense map: its places.
    pub head: u64,
    /// Instructions of the f32 twin over a dense map.
    pub twin: u64,
    /// What the image takes.
    pub flash_bytes: u32,
    /// What the image takes.
    pub ram_bytes: u32,
}

impl Report {
    /// Walks, runs, counts.
    ///
    /// # Errors
    /// Files that cannot be read, a board that does not run.
    pub fn make(image_path: &Path, twin_path: &Path) -> Result<Self, Error> {
        let elf = read(image_path)?;
        let image = Image::read(&elf)?;
        let sources = Sources::read(image_path)?;
        let start = function_of(&image, "OTG_FS")?;
        let write = function_of(&image, WRITE_LINE)?;
        let mut path = Walk::new(&image, &sources, Left::Tail).ending_with(&write);
        let bound = path.function(&start);
        let mut whole = Walk::new(&image, &sources, Left::Tail);
        let interrupt = whole.function(&start);
        let mut full = Walk::new(&image, &sources, Left::Taxels);
        let taxels_cycles = full.after_store(&start, NEXT_PACKET)?;
        let mut blocked = Walk::new(&image, &sources, Left::Blocked);
        let mut stretches = blocked.blocking_stretches(PATH_PRIORITY);
        // What can block the path to a line that grips.
        let (released, gripping): (Vec<Stretch>, Vec<Stretch>) = stretches
            .drain(..)
            .partition(|stretch| RELEASED.iter().any(|(part, _)| stretch.name.contains(part)));
        let blocking = gripping.first().cloned().ok_or_else(|| Error::Unexpected {
            expected: "a stretch that blocks the path".to_owned(),
            found: "none".to_owned(),
        })?;

        let mut findings: Vec<String> = [&path, &whole, &full, &blocked]
            .iter()
            .flat_map(|walk| &walk.findings)
            .cloned()
            .collect();
        let mut left: Vec<String> = path.left.iter().chain(&blocked.left).cloned().collect();
        left.extend(released.iter().filter_map(|stretch| {
            let (_, why) = RELEASED.iter().find(|(part, _)| stretch.name.contains(part))?;
            Some(format!("{}: {} cycles, {why}", stretch.name, stretch.cycles))
        }));
        left.sort();
        left.dedup();

        let mut bench = Bench::new(&image, &elf)?;
        bench.watch(path.loops.values(), When::Tail);
        bench.watch(blocked.loops.values(), When::Blocked);
        bench.map(&map_of(400, 1))?;
        drop(bench.counted());
        bench.map(&map_of(400, 2))?;
        let counted = bench.counted();
        let dense = counted.of(KERNEL);
        let head = counted.of(&["Program<K>::head"]);
        for contacts in 0..=400 {
            bench.map(&map_of(contacts, contacts as u32))?;
        }
        let quiet = bench.worst;
        branches(&mut bench)?;
        disturb(&mut bench)?;
        sweep(&mut bench)?;
        findings.extend(bench.broken(&path.memories));
        let stack = Stack::of(&image, &sources, &elf)?;
        let stack_measured_bytes = bench.stack_used(stack.memory)?;
        findings.extend(in_flash(&image, &path));
        for (part, _, _) in LEFT_OUT {
            if image.functions_named(part).next().is_none() {
                findings.push(format!("the tables leave out {part}, which is not in the image"));
            }
        }
        for (pattern, ..) in LOOPS.iter().filter(|(pattern, ..)| !pattern.contains(" @ ")) {
            let is_met = |walk: &Walk<'_>| walk.loops.values().any(|one| one.pattern == *pattern);
            if !is_met(&path) && !is_met(&blocked) {
                findings.push(format!("the tables bound a loop `{pattern}`, which no walk met"));
            }
        }
        Ok(Self {
            taxels_cycles,
            parts: [&path, &blocked].map(|walk| parts(&image, walk)),
            path_cycles: bound.cycles + u64::from(ENTRY),
            blocking,
            stretches: gripping,
            interrupt_cycles: interrupt.cycles + u64::from(ENTRY),
            stack_worst_bytes: interrupt.stack + FRAME_BYTES,
            stack,
            stack_measured_bytes,
            left,
            findings,
            quiet,
            worst: bench.worst,
            blocking_worst: bench.blocking_worst,
            section_worst: bench.section_worst,
            tick: bench.tick,
            dense,
            head,
            twin: twin::instructions(twin_path)?,
            flash_bytes: image.flash_bytes,
            ram_bytes: image.ram_bytes,
        })
    }

    /// Cycles at most from a map's last packet in the FIFO to the line.
    #[must_use]
    pub fn bound_cycles(&self) -> u64 {
        self.path_cycles + self.blocking_cycles()
    }

    /// Cycles at most that the path waits: for the longest stretch that blocks it, or for the rest of a full packet.
    fn blocking_cycles(&self) -> u64 {
        let rest = self.taxels_cycles.saturating_sub(LAST_PACKET_CYCLES);
        self.blocking.cycles.max(rest)
    }

    fn per_taxel(&self) -> f64 {
        self.dense as f64 / 400.0
    }

    fn jitter(&self) -> u64 {
        self.tick.1.saturating_sub(self.tick.0)
    }

    /// What of the design does not hold.
    #[must_use]
    pub fn failures(&self) -> Vec<String> {
        let mut failures: Vec<String> = Vec::new();
        let mut check = |holds: bool, what: &str, found: String, bound: String| {
            if !holds {
                failures.push(format!("{what}: found {found}, expected {bound}"));
            }
        };
        let worst = self.worst.cycles;
        check(
            worst <= PATH_CYCLES,
            "packet to line, cycles",
            worst.to_string(),
            format!("at most {PATH_CYCLES}"),
        );
        check(
            worst <= self.bound_cycles(),
            "packet to line, cycles",
            worst.to_string(),
            format!("at most the static bound of {}", self.bound_cycles()),
        );
        check(
            self.bound_cycles() <= PATH_CYCLES,
            "packet to line, static bound, cycles",
            self.bound_cycles().to_string(),
            format!("at most {PATH_CYCLES}"),
        );
        check(
            self.blocking_cycles() <= BLOCKING_CYCLES,
            "longest stretch that blocks the path, cycles",
            self.blocking_cycles().to_string(),
            format!("at most {BLOCKING_CYCLES}"),
        );
        check(
            self.dense <= DENSE_INSTRUCTIONS,
            "dense map, instructions",
            self.dense.to_string(),
            format!("at most {DENSE_INSTRUCTIONS}"),
        );
        check(
            self.per_taxel() <= TAXEL_INSTRUCTIONS,
            "instructions a taxel",
            format!("{:.2}", self.per_taxel()),
            format!("at most {TAXEL_INSTRUCTIONS}"),
        );
        check(
            self.dense < self.twin,
            "dense map, instructions",
            self.dense.to_string(),
            format!("fewer than the f32 twin's {}", self.twin),
        );
        check(
            self.flash_bytes <= FLASH_BYTES,
            "flash, bytes",
            self.flash_bytes.to_string(),
            format!("at most {FLASH_BYTES}"),
        );
        check(
            self.ram_bytes <= RAM_BYTES,
            "ram, bytes",
            self.ram_bytes.to_string(),
            format!("at most {RAM_BYTES}"),
        );
        failures.extend(self.stack.failures(self.stack_measured_bytes));
        failures.extend(
            self.findings
                .iter()
                .map(|finding| format!("against the static bound: {finding}")),
        );
        failures
    }

    /// For programs.
    #[must_use]
    pub fn json(&self) -> String {
        format!(
            "{{\"bound_cycles\": {}, \"measured_worst_cycles\": {}, \"masked_worst_cycles\": {}, \"jitter_cycles\": {}, \
             \"instructions_per_taxel\": {:.2}, \"dense_map_instructions\": {}, \"f32_dense_map_instructions\": {}, \
             \"flash_bytes\": {}, \"ram_bytes\": {}, \"stack_worst_bytes\": {}, \"path_cycles\": {}, \
             \"blocking_cycles\": {}, \"measured_quiet_cycles\": {}, \"section_worst_cycles\": {}, \
             \"head_instructions\": {}, \"stack_bound_bytes\": {}, \"stack_room_bytes\": {}, \
             \"stack_measured_bytes\": {}, \"findings\": {:?}}}\n",
            self.bound_cycles(),
            self.worst.cycles,
            self.blocking_worst,
            self.jitter(),
            self.per_taxel(),
            self.dense,
            self.twin,
            self.flash_bytes,
            self.ram_bytes,
            self.stack_worst_bytes,
            self.path_cycles,
            self.blocking_cycles(),
            self.quiet.cycles,
            self.section_worst,
            self.head,
            self.stack.bound,
            self.stack.room(),
            self.stack_measured_bytes,
            self.findings,
        )
    }

    /// For people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<58} {value}");
        };
        line("map's last packet in the FIFO to the line, cycles", String::new());
        line(
            "  measured, nothing else to do",
            format!("{} ({} instructions)", self.quiet.cycles, self.quiet.instructions),
        );
        line(
            "  measured, under every interruption found",
            format!("{} (bound of the design {PATH_CYCLES})", self.worst.cycles),
        );
        line("  static bound", self.bound_cycles().to_string());
        line("    of which the path itself", self.path_cycles.to_string());
        line(
            "      and the rest of its interrupt",
            (self.interrupt_cycles - self.path_cycles).to_string(),
        );
        line(
            "    of which blocked by",
            format!("{} {}", self.blocking.cycles, self.blocking.name),
        );
        line(
            "    or the rest of a full packet",
            format!(
                "{} from when the next is asked for",
                self.taxels_cycles.saturating_sub(LAST_PACKET_CYCLES)
            ),
        );
        for stretch in self.stretches.iter().skip(1).take(3) {
            line("      next", format!("{} {}", stretch.cycles, stretch.name));
        }
        for (whose, parts) in ["of the path", "of what blocks it"].into_iter().zip(&self.parts) {
            for (name, cycles) in parts {
                line(whose, format!("{cycles} {name}, with what it calls"));
            }
        }
        line("blocking time, measured, cycles", self.blocking_worst.to_string());
        line(
            "all but the path blocked, measured, cycles",
            self.section_worst.to_string(),
        );
        line(
            "timer to the tick's line, cycles",
            format!("{} to {}, jitter {}", self.tick.0, self.tick.1, self.jitter()),
        );
        line(
            "dense map, instructions",
            format!(
                "{} ({:.2} a taxel), f32 twin {}",
                self.dense,
                self.per_taxel(),
                self.twin
            ),
        );
        line("  and its head: header, CRC, places", self.head.to_string());
        line(
            "image, bytes",
            format!(
                "flash {} ram {} stack of the path {}",
                self.flash_bytes, self.ram_bytes, self.stack_worst_bytes
            ),
        );
        line(
            "stack, all contexts nested, bytes",
            format!(
                "{} of {}, measured {}",
                self.stack.bound,
                self.stack.room(),
                self.stack_measured_bytes
            ),
        );
        for context in &self.stack.contexts {
            let priority = context.priority.map(|priority| format!(", priority {priority}"));
            line(
                "  of which",
                format!("{} {}{}", context.bytes, context.name, priority.unwrap_or_default()),
            );
        }
        for left in &self.left {
            line("left out", left.clone());
        }
        for finding in &self.findings {
            line("stands against the bound", finding.clone());
        }
        text
    }
}

/// The function whose name ends so.
fn function_of(image: &Image, name: &str) -> Result<Function, Error> {
    let found = image
        .functions_named(name)
        .find(|function| function.name.ends_with(name) && !function.name.contains("Thunk"));
    found.cloned().ok_or_else(|| Error::Unexpected {
        expected: format!("the function {name}"),
        found: "none".to_owned(),
    })
}

/// Functions of the path that run from flash, where wait states would move its time.
fn in_flash(image: &Image, path: &Walk<'_>) -> Vec<String> {
    let functions = path.known.keys().filter_map(|at| image.functions.get(at));
    functions
        .filter(|function| function.start >= FLASH_START && function.start < RAM_START)
        .map(|function| {
            format!(
                "{} of the path lies in flash at {:#x}, expected SRAM: name it in firmware/mcu/hot.x",
                short(&function.name),
                function.start
            )
        })
        .collect()
}

/// The functions of a walk that cost most, with all that they call.
fn parts(image: &Image, walk: &Walk<'_>) -> Vec<(String, u64)> {
    let mut parts: Vec<(String, u64)> = walk
        .known
        .iter()
        .filter(|(_, bound)| bound.cycles >= PART_CYCLES)
        .filter_map(|(at, bound)| Some((short(&image.functions.get(at)?.name).to_owned(), bound.cycles)))
        .collect();
    parts.sort_by_key(|(_, cycles)| std::cmp::Reverse(*cycles));
    parts
}

/// Every branch of a map's end: doubtful, saturated, replayed, from the future, of a finger that is not expected, of two
/// fingers, with a hole before it, damaged; stick, incipient slip, slip, no contact; held, released.
fn branches(bench: &mut Bench<'_>) -> Result<(), Error> {
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
        bench.map_as(&map_of(59, round), |info| info.sensor = (round % 2) as u8)?;
    }
    bench.command(Command::Configure(Configuration::DEFAULT))?;
    // A contact that slips ever more: the trend, the reflex, every state.
    for slipping in (0..=59).chain((0..59).rev()) {
        bench.map(&crate::measure::slipping(59, slipping))?;
    }
    bench.command(Command::Acknowledge { faults: u32::MAX })?;
    bench.command(Command::Release)?;
    for round in 0..10 {
        bench.map(&map_of(59, round))?;
    }
    bench.command(Command::Hold)
}

/// The map with the longest tail at every phase of the tick, of what maps teach in it, and of its statuses; one fingertip, then both.
fn sweep(bench: &mut Bench<'_>) -> Result<(), Error> {
    for sensors in [1, 2] {
        bench.command(Command::Configure(Configuration {
            sensors,
            ..Configuration::DEFAULT
        }))?;
        for step in 0..SWEPT {
            // The map before has ended milliseconds ago; each begins a little later in the millisecond than that.
            bench.run(TICK_NS + TICK_NS / SWEPT)?;
            bench.map_as(&map_of(59, step as u32), |info| {
                info.sensor = step as u8 % sensors;
            })?;
        }
    }
    bench.command(Command::Configure(Configuration::DEFAULT))
}

/// Statuses, commands, requests on the control endpoint, ticks, log and watchdog at every phase between the packets.
fn disturb(bench: &mut Bench<'_>) -> Result<(), Error> {
    let commands = [
        Command::ReadStatus,
        Command::ReadConfiguration,
        Command::Configure(Configuration::DEFAULT),
        Command::Hold,
    ];
    for round in 0..DISTURBED {
        if round % 2 == 0 {
            bench.ask();
        }
        if round % 3 == 0 {
            bench.send_command(commands[(round / 3) as usize % commands.len()]);
        }
        // Steps that are no part of a millisecond meet the tick at every phase.
        bench.run(round * 37_700 % 1_000_000)?;
        bench.map(&map_of([59, 9, 19, 8][round as usize % 4], round as u32))?;
    }
    Ok(())
}
