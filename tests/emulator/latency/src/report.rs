//! Everything that `cargo xtask latency` prints, and what of it the design bounds.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use crate::bound::{Code, Stretch, Walk, short};
use crate::cycles::ENTRY;
use crate::image::{Image, read};
use crate::measure::{Bench, LONGEST_TAIL, Met, Transit, When, map_of};
use crate::misuse::misuse;
use crate::receiver::Receiver;
use crate::source::Sources;
use crate::stack::{FRAME_BYTES, Stack};
use crate::sweep::{self, Length, Raises, Rates};
use crate::tables::{KERNEL, LEFT_OUT, TAKE_AHEAD};
use crate::walks::{Walks, function_of};
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
/// Cycles that the shortest last packet takes at least from when it is asked for: the host may be at its token's end, then
/// come two bit times, SYNC, PID, eight bytes, CRC and EOP, 100 bits of 12 MHz (USB 2.0 sections 7.1.18 and 8.3).
const LAST_PACKET_CYCLES: u64 = 100 * 14;
/// The links that maps come over.
const LINKS: [&str; 2] = ["USB", "the UART"];
/// Where flash and SRAM begin.
const FLASH_START: u32 = 0x0800_0000;
const RAM_START: u32 = 0x1000_0000;
/// Parts that cost less are not printed.
const PART_CYCLES: u64 = 100;
/// The bound over the measured worst case, in hundredths: a looser one proves little.
const RATIO_PERCENT: u64 = 140;
/// Maps a second that the bus must bring and the board must take: dense, of 150 contacts, and of 150 contacts from two fingertips.
const RATES: [(usize, u8, f64); 3] = [(400, 1, 450.0), (150, 1, 1_000.0), (150, 2, 1_000.0)];

/// The figures.
#[derive(Debug)]
pub struct Report {
    /// Of the path alone, from its interrupt to the line, over USB and over the UART.
    pub path_cycles: [u64; 2],
    /// Of the other link's interrupt, whose maps do not count: that over USB, and that over the UART.
    pub foreign_cycles: [u64; 2],
    /// What the path and what blocks it are made of: functions with all that they call, the longest first.
    pub parts: [Vec<(String, u64)>; 2],
    /// Of the path's interrupt to its return, what it does after the line included.
    pub interrupt_cycles: [u64; 2],
    /// Of a full packet's interrupt, from when it asks for the next one; a map's last packet may land before it is done with.
    pub taxels_cycles: u64,
    /// Of the longest stretch that blocks the path.
    pub blocking: Stretch,
    /// All such stretches, the longest first.
    pub stretches: Vec<Stretch>,
    /// Whether the UART's receiver can lose a byte.
    pub receiver: Receiver,
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
    pub quiet: Transit,
    /// The worst way of all, over USB and over the UART.
    pub worst: [Transit; 2],
    /// Longest stretch with the path blocked, measured.
    pub blocking_worst: u64,
    /// Longest stretch with everything but the path blocked, measured.
    pub section_worst: u64,
    /// Timer to tick, least and most.
    pub tick: (u64, u64),
    /// For each number of taxels in a map's last packet: the path's bound and the worst way measured.
    pub tails: [Vec<(u64, Transit)>; 2],
    /// How runs met the stretches that block the path.
    pub met: BTreeMap<u32, Met>,
    /// Maps that demanded more force, with the settings that ship, over USB and over the UART.
    pub raises: [Raises; 2],
    /// Where the worst ways' cycles went, the most first.
    pub worst_spent: [Vec<(String, u64)>; 2],
    /// The worst way behind a packet of the control endpoint.
    pub behind_control: Transit,
    /// Maps a second that the board took.
    pub rates: Rates,
    /// Accesses whose address the walks do not know, and how many of them runs have met; the others count as accesses to the slowest memory.
    pub unknown: (usize, usize),
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

/// What the board was given, and what is kept of it beside the bench's worst cases.
struct Played {
    quiet: Transit,
    raises: [Raises; 2],
    behind_control: Transit,
    rates: Rates,
    dense: u64,
    head: u64,
}

impl Played {
    /// Plays maps of every size with nothing else to do, then everything that may come in between: over USB on one board, over the UART on the
    /// other, at the same time. The first one has then met what both met.
    fn of<'a>(bench: &mut Bench<'a>, other: &mut Bench<'a>, length: Length) -> Result<Self, Error> {
        std::thread::scope(|threads| {
            let over_uart = threads.spawn(|| sweep::over_uart(other, length).map(|raises| (raises, other)));
            let mut played = Self::over_usb(bench, length)?;
            let (raises, other) = over_uart
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            bench.join(other);
            played.raises[1] = raises;
            Ok(played)
        })
    }

    fn over_usb(bench: &mut Bench<'_>, length: Length) -> Result<Self, Error> {
        bench.map(&map_of(400, 1))?;
        drop(bench.counted());
        bench.map(&map_of(400, 2))?;
        let counted = bench.counted();
        for contacts in 0..=400 {
            bench.map(&map_of(contacts, contacts as u32))?;
        }
        let [quiet, _] = bench.worst;
        sweep::branches(bench)?;
        sweep::disturb(bench)?;
        sweep::phases(bench, length)?;
        let raises = sweep::raises(bench, LONGEST_TAIL, length)?;
        let rates = sweep::rates(bench, RATES.map(|(contacts, sensors, _)| (contacts, sensors)))?;
        let behind_control = sweep::behind_control(bench)?;
        misuse(bench)?;
        Ok(Self {
            quiet,
            raises: [raises, Raises::default()],
            behind_control,
            rates,
            dense: counted.of(KERNEL),
            head: counted.of(&["Program<K>::head"]),
        })
    }
}

/// Two boards whose loops are watched: those of last packets, and those that block the path.
fn benches<'a>(image: &'a Image, elf: &[u8], walks: &Walks<'_>) -> Result<[Bench<'a>; 2], Error> {
    let tails = walks.tail_loops();
    let mut benches = [Bench::new(image, elf)?, Bench::new(image, elf)?];
    for bench in &mut benches {
        bench.watch(tails.values(), When::Tail);
        bench.watch(walks.blocked.loops.values(), When::Blocked);
    }
    Ok(benches)
}

impl Report {
    /// Walks, runs, counts.
    ///
    /// # Errors
    /// Files that cannot be read, a board that does not run.
    pub fn make(image_path: &Path, twin_path: &Path, length: Length) -> Result<Self, Error> {
        let elf = read(image_path)?;
        let image = Image::read(&elf)?;
        let sources = Sources::read(image_path)?;
        let before = Walks::over(Code {
            image: &image,
            sources: &sources,
            met: None,
        })?;
        let [mut bench, mut other] = benches(&image, &elf, &before)?;
        let played = Played::of(&mut bench, &mut other, length)?;

        // Once more, now that it is known what the runs met.
        let met = bench.accessed();
        let code = Code {
            met: Some(&met),
            ..before.code
        };
        let walks = Walks::over(code)?;
        let mut findings = walks.findings();
        let blocking = walks.blocking()?;
        let [of_usb_link, _] = walks.foreign_cycles;
        let (receiver, found) = Receiver::of(
            code,
            &walks.uart,
            &function_of(&image, TAKE_AHEAD)?,
            blocking.cycles.max(of_usb_link),
            bench.uart_byte_cycles()?,
        )?;
        findings.extend(found);
        for memories in walks.memories() {
            findings.extend(bench.broken(memories));
        }
        let stack = Stack::of(&image, &sources, &elf)?;
        let stack_measured_bytes = bench
            .stack_used(stack.memory)?
            .max(other.stack_used(stack.memory)?);
        findings.extend(in_flash(&image, &walks.path));
        findings.extend(not_in_image(&image));
        let unknown = walks.unknown();
        let interrupts = &walks.interrupts;
        Ok(Self {
            taxels_cycles: walks.taxels_cycles,
            parts: [&walks.path, &walks.blocked].map(|walk| parts(&image, walk)),
            path_cycles: walks.path_cycles,
            foreign_cycles: walks.foreign_cycles,
            blocking,
            left: walks.left(),
            stretches: walks.stretches.clone(),
            receiver,
            interrupt_cycles: interrupts.each_ref().map(|one| one.cycles + u64::from(ENTRY)),
            stack_worst_bytes: interrupts.iter().map(|one| one.stack).max().unwrap_or_default() + FRAME_BYTES,
            stack,
            stack_measured_bytes,
            findings,
            quiet: played.quiet,
            worst: bench.worst,
            blocking_worst: bench.blocking_worst,
            section_worst: bench.section_worst,
            tick: bench.tick,
            tails: {
                let [usb, uart] = bench.worst_by_tail;
                let [of_usb, of_uart] = walks.tail_cycles();
                [
                    of_usb.iter().copied().zip(usb).collect(),
                    of_uart.iter().copied().zip(uart).collect(),
                ]
            },
            met: bench.met.clone(),
            raises: played.raises,
            worst_spent: bench
                .worst_spent
                .each_ref()
                .map(|spent| by_function(&image, spent)),
            behind_control: played.behind_control,
            rates: played.rates,
            unknown: (unknown.len(), unknown.intersection(&met).count()),
            dense: played.dense,
            head: played.head,
            twin: twin::instructions(twin_path)?,
            flash_bytes: image.flash_bytes,
            ram_bytes: image.ram_bytes,
        })
    }

    /// Cycles at most from a map's last packet to the line, over USB and over the UART.
    #[must_use]
    pub fn bounds(&self) -> [u64; 2] {
        let [usb, uart] = self.path_cycles;
        let [usb_waits, uart_waits] = self.waits();
        [usb + usb_waits, uart + uart_waits]
    }

    /// The same over either.
    #[must_use]
    pub fn bound_cycles(&self) -> u64 {
        self.bounds().into_iter().max().unwrap_or_default()
    }

    /// Cycles at most that the interrupts of the path wait, each while its maps count: for the longest stretch that blocks it, for what the other
    /// link's interrupt does, or, over USB, for the rest of a full packet. For one of them only: who waits comes before what else wants to run,
    /// that of the USB core because that of the UART lies below it then, that of the UART because it comes first of two.
    fn waits(&self) -> [u64; 2] {
        let rest = self.taxels_cycles.saturating_sub(LAST_PACKET_CYCLES);
        let [of_usb, of_uart] = self.foreign_cycles;
        [
            self.blocking.cycles.max(rest).max(of_uart),
            self.blocking.cycles.max(of_usb),
        ]
    }

    /// Cycles at most that the path waits.
    fn blocking_cycles(&self) -> u64 {
        self.waits().into_iter().max().unwrap_or_default()
    }

    /// The worst way measured.
    fn worst_cycles(&self) -> u64 {
        self.worst
            .iter()
            .map(|transit| transit.cycles)
            .max()
            .unwrap_or_default()
    }

    /// The static bound over the measured worst case.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.bound_cycles() as f64 / self.worst_cycles().max(1) as f64
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
        let worst = self.worst_cycles();
        for ((link, transit), bound) in LINKS.into_iter().zip(self.worst).zip(self.bounds()) {
            let found = transit.cycles;
            check(
                found <= PATH_CYCLES,
                &format!("packet to line over {link}, cycles"),
                found.to_string(),
                format!("at most {PATH_CYCLES}"),
            );
            check(
                0 < found && found <= bound,
                &format!("packet to line over {link}, cycles"),
                found.to_string(),
                format!("at most the static bound of {bound}"),
            );
        }
        check(
            self.bound_cycles() <= PATH_CYCLES,
            "packet to line, static bound, cycles",
            self.bound_cycles().to_string(),
            format!("at most {PATH_CYCLES}"),
        );
        check(
            100 * self.bound_cycles() <= RATIO_PERCENT * worst,
            "static bound over the measured worst case",
            format!("{:.2}", self.ratio()),
            format!("at most {:.2}", RATIO_PERCENT as f64 / 100.0),
        );
        check(
            self.blocking_cycles() <= BLOCKING_CYCLES,
            "longest stretch that blocks the path, cycles",
            self.blocking_cycles().to_string(),
            format!("at most {BLOCKING_CYCLES}"),
        );
        for need in &self.receiver.needs {
            check(
                need.found <= need.allowed,
                &format!("the UART's bytes: {}, cycles", need.what),
                need.found.to_string(),
                format!("at most {}, or a byte is lost", need.allowed),
            );
        }
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
        failures.extend(self.failures_of_runs());
        failures.extend(
            self.findings
                .iter()
                .map(|finding| format!("against the static bound: {finding}")),
        );
        failures
    }

    /// What the runs showed that the walks exclude, or the design.
    fn failures_of_runs(&self) -> Vec<String> {
        let mut failures: Vec<String> = Vec::new();
        let mut check = |holds: bool, what: &str, found: String, bound: String| {
            if !holds {
                failures.push(format!("{what}: found {found}, expected {bound}"));
            }
        };
        for stretch in &self.stretches {
            let met = self.met.get(&stretch.at).copied().unwrap_or_default();
            check(
                met.cycles <= stretch.cycles,
                &format!("{}, cycles", stretch.name),
                met.cycles.to_string(),
                format!("at most its static bound of {}", stretch.cycles),
            );
        }
        for (link, raises) in LINKS.into_iter().zip(&self.raises) {
            check(
                raises.raise_all(),
                &format!("maps over {link} that demand more force, of which the line rose before the bound"),
                format!("{} of {}", raises.raised, raises.asked),
                "all".to_owned(),
            );
        }
        for ((link, tails), waits) in LINKS.into_iter().zip(&self.tails).zip(self.waits()) {
            for (taxels, (path, transit)) in tails.iter().enumerate() {
                let bound = path + waits;
                check(
                    transit.cycles <= bound,
                    &format!("packet to line over {link}, last packet of {taxels} taxels, cycles"),
                    transit.cycles.to_string(),
                    format!("at most its static bound of {bound}"),
                );
            }
        }
        for ((contacts, sensors, least), found) in RATES.into_iter().zip(self.rates) {
            check(
                found >= least,
                &format!("maps a second of {contacts} contacts from {sensors} fingertip(s)"),
                format!("{found:.0}"),
                format!("at least {least:.0}"),
            );
        }
        failures
    }

    /// For programs.
    #[must_use]
    pub fn json(&self) -> String {
        let waits = self.waits();
        let tail_bounds = |link: usize| -> Vec<u64> {
            let tails = self.tails[link].iter();
            tails.map(|(path, _)| path + waits[link]).collect()
        };
        let tail_cycles = |link: usize| -> Vec<u64> {
            self.tails[link]
                .iter()
                .map(|(_, transit)| transit.cycles)
                .collect()
        };
        let spent = |link: usize| {
            let parts = self.worst_spent[link].iter().take(10);
            let parts: Vec<String> = parts.map(|(name, cycles)| format!("{name} {cycles}")).collect();
            parts.join(", ")
        };
        format!(
            "{{\"bound_cycles\": {}, \"measured_worst_cycles\": {}, \"masked_worst_cycles\": {}, \"jitter_cycles\": {}, \
             \"instructions_per_taxel\": {:.2}, \"dense_map_instructions\": {}, \"f32_dense_map_instructions\": {}, \
             \"flash_bytes\": {}, \"ram_bytes\": {}, \"stack_worst_bytes\": {}, \"path_cycles\": {}, \
             \"blocking_cycles\": {}, \"measured_quiet_cycles\": {}, \"section_worst_cycles\": {}, \
             \"head_instructions\": {}, \"held_off_cycles\": {}, \"raises_line\": {}, \"raises\": {}, \"raise_worst_cycles\": {}, \
             \"bound_over_measured\": {:.2}, \"tail_bound_cycles\": {:?}, \"tail_measured_cycles\": {:?}, \
             \"worst_waited_cycles\": {}, \"worst_composition\": {:?}, \"uart_bound_cycles\": {}, \"uart_measured_worst_cycles\": {}, \"uart_tail_bound_cycles\": {:?}, \"uart_tail_measured_cycles\": {:?}, \"uart_worst_composition\": {:?}, \"uart_byte_cycles\": {}, \"uart_room_cycles\": {}, \"behind_control_cycles\": {}, \"maps_per_second_dense\": {:.0}, \
             \"maps_per_second_150\": {:.0}, \"maps_per_second_150_two_fingertips\": {:.0}, \"stack_bound_bytes\": {}, \"stack_room_bytes\": {}, \"stack_measured_bytes\": {}, \"usb_measured_worst_cycles\": {}, \"unknown_accesses\": {}, \"unknown_accesses_met\": {}, \"findings\": {:?}}}\n",
            self.bound_cycles(),
            self.worst_cycles(),
            self.blocking_worst,
            self.jitter(),
            self.per_taxel(),
            self.dense,
            self.twin,
            self.flash_bytes,
            self.ram_bytes,
            self.stack_worst_bytes,
            self.path_cycles[0],
            self.blocking_cycles(),
            self.quiet.cycles,
            self.section_worst,
            self.head,
            self.blocking_cycles(),
            self.raises.iter().all(Raises::raise_all),
            self.raises.iter().map(|raises| raises.asked).sum::<u32>(),
            self.raises
                .iter()
                .map(|raises| raises.worst.cycles)
                .max()
                .unwrap_or_default(),
            self.ratio(),
            tail_bounds(0),
            tail_cycles(0),
            self.worst[0].waited,
            spent(0),
            self.bounds()[1],
            self.worst[1].cycles,
            tail_bounds(1),
            tail_cycles(1),
            spent(1),
            self.receiver.byte_cycles,
            self.receiver.room(),
            self.behind_control.cycles,
            self.rates[0],
            self.rates[1],
            self.rates[2],
            self.stack.bound,
            self.stack.room(),
            self.stack_measured_bytes,
            self.worst[0].cycles,
            self.unknown.0,
            self.unknown.1,
            self.findings,
        )
    }

    /// What the measured worst case is made of, each last packet's bound, and how packets met what blocks the path.
    fn composition(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<58} {value}");
        };
        for (link, transit) in self.worst.iter().enumerate() {
            line(
                &format!("the worst case measured over {}", LINKS[link]),
                format!(
                    "{} cycles: {} until its interrupt began, {} in it",
                    transit.cycles,
                    transit.waited,
                    transit.cycles - transit.waited
                ),
            );
            for (name, cycles) in self.worst_spent[link].iter().take(16) {
                line("  of which in", format!("{cycles} {name}"));
            }
        }
        for (link, raises) in LINKS.into_iter().zip(&self.raises) {
            line(
                &format!("maps over {link} that demand more force"),
                format!(
                    "{} of {} raised the line, {} cycles at most",
                    raises.raised, raises.asked, raises.worst.cycles
                ),
            );
        }
        for ((link, tails), waits) in LINKS.into_iter().zip(&self.tails).zip(self.waits()) {
            for (taxels, (path, transit)) in tails.iter().enumerate() {
                line(
                    &format!("  a last packet of {taxels} taxels over {link}"),
                    format!(
                        "bound {} (path {path}), measured {}",
                        path + waits,
                        transit.cycles
                    ),
                );
            }
        }
        line(
            "what blocks the path: static, measured, longest wait",
            String::new(),
        );
        for stretch in &self.stretches {
            let met = self.met.get(&stretch.at).copied().unwrap_or_default();
            line(
                "",
                format!(
                    "{:>5} {:>5} {:>5} {}",
                    stretch.cycles, met.cycles, met.waited, stretch.name
                ),
            );
        }
        line(
            "a byte of the UART",
            format!("{} cycles from the fastest sender", self.receiver.byte_cycles),
        );
        for need in &self.receiver.needs {
            line(
                "",
                format!("{:>5} of {:>5} {}", need.found, need.allowed, need.what),
            );
        }
        line(
            "behind a packet of the control endpoint, measured",
            self.behind_control.cycles.to_string(),
        );
        line(
            "accesses of an address that the walks do not know",
            format!(
                "{}, of which runs met {}; the others count as accesses to the slowest memory",
                self.unknown.0, self.unknown.1
            ),
        );
        line(
            "maps a second: dense, 150 contacts, of two fingertips",
            format!("{:.0}, {:.0}, {:.0}", self.rates[0], self.rates[1], self.rates[2]),
        );
        text
    }

    /// What is measured beside the path: the tick, the sums, the image, the stack.
    fn beside(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<58} {value}");
        };
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
                format!(
                    "{} {}{}",
                    context.bytes,
                    context.name,
                    priority.unwrap_or_default()
                ),
            );
        }
        text
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
            format!("{} (bound of the design {PATH_CYCLES})", self.worst_cycles()),
        );
        line("  static bound", self.bound_cycles().to_string());
        for (link, name) in LINKS.into_iter().enumerate() {
            line(
                &format!("  static bound over {name}"),
                format!(
                    "{}: the path {}, its wait {}",
                    self.bounds()[link],
                    self.path_cycles[link],
                    self.waits()[link]
                ),
            );
            line(
                "      and the rest of its interrupt",
                (self.interrupt_cycles[link] - self.path_cycles[link]).to_string(),
            );
            line(
                "      its interrupt while maps of the other link count",
                self.foreign_cycles[link].to_string(),
            );
        }
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
        line(
            "  static bound over the measured worst case",
            format!("{:.2}", self.ratio()),
        );
        text.push_str(&self.composition());
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<58} {value}");
        };
        for (whose, parts) in ["of the path", "of what blocks it"].into_iter().zip(&self.parts) {
            for (name, cycles) in parts {
                line(whose, format!("{cycles} {name}, with what it calls"));
            }
        }
        text.push_str(&self.beside());
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<58} {value}");
        };
        for left in &self.left {
            line("left out", left.clone());
        }
        for finding in &self.findings {
            line("stands against the bound", finding.clone());
        }
        text
    }
}

/// Functions of the path that run from flash, where wait states would move its time.
fn in_flash(image: &Image, path: &Walk<'_>) -> Vec<String> {
    let copies = path.copies.keys().map(|(at, _)| at);
    let functions = path
        .known
        .keys()
        .chain(copies)
        .filter_map(|at| image.functions.get(at));
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

/// Lines of the tables that name nothing.
fn not_in_image(image: &Image) -> Vec<String> {
    let functions = LEFT_OUT
        .iter()
        .filter(|(part, ..)| image.functions_named(part).next().is_none())
        .map(|(part, ..)| format!("the tables leave out {part}, which is not in the image"));
    functions.collect()
}

/// Cycles by the name of the function, the most first.
fn by_function(image: &Image, spent: &[u64]) -> Vec<(String, u64)> {
    let functions = image.functions.values().zip(spent);
    let mut found: Vec<(String, u64)> = functions
        .filter(|(_, cycles)| **cycles > 0)
        .map(|(function, cycles)| (short(&function.name).to_owned(), *cycles))
        .collect();
    found.sort_by_key(|(_, cycles)| std::cmp::Reverse(*cycles));
    found
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
