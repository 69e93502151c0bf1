//! The longest path through a function and all it calls, from the linked image alone: no run, so nothing is left to luck.
//!
//! Every block of a loop counts as often as the table below says, whatever else the loop does; then the longest way
//! through what is left, a graph without loops. Limits: loops and calls without a line in the tables are findings, and a
//! function with a finding has no bound.

use std::collections::{BTreeMap, BTreeSet};

use crate::cycles::{self, Fetch, Memory};
use crate::image::{Flow, Function, Image, Instruction};

/// (part of a function's name, how often a block of its loops runs at most, why).
pub const LOOPS: &[(&str, u32, &str)] = &[
    (
        "Control::packet",
        100,
        "four bits of a bitmap of 400 a round; the other loops here are shorter",
    ),
    ("RunningCrc::update", 16, "words of a packet"),
    ("map_tail", 15, "words of a packet but its CRC"),
    ("map_taxels", 16, "words of a packet"),
    ("map_head", 100, "four bits of a bitmap of 400 a round"),
    ("add_pairs", 5, "pairs of taxels in a packet"),
    ("total_shear", 13, "bits of the upper half of a root of 26 bits"),
    ("SlipDetector::update", 8, "maps of the trend"),
    ("Mcu<K>::evidence", 2, "fingertips"),
    ("Mcu<K>::action", 16, "faults"),
    ("Safety::guard", 16, "faults"),
    ("divide", 4, "sixteen bits a round"),
    ("LineCalibration::code", 8, "points of the calibration table"),
    ("memcpy", 64, "bytes of a packet"),
    ("memclr", 64, "bytes of a packet"),
    ("memset", 64, "bytes of a packet"),
];

/// (part of a function's name, why a map's packet never calls it).
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("Message::from_bytes", "messages, not maps"),
    ("message_fragment", "messages, not maps"),
    ("Configuration::check", "messages, not maps"),
    ("update_bytes", "packets of the USB path lie at aligned addresses"),
    ("Portable", "packets of the USB path lie at aligned addresses"),
];

/// What the walk came to.
#[derive(Debug, Default)]
pub struct Bound {
    /// Cycles at most.
    pub cycles: u64,
    /// Bytes of stack at most.
    pub stack: u32,
    /// Whatever stands against the bound, each once.
    pub findings: BTreeSet<String>,
}

/// The bound of a function.
#[must_use]
pub fn of(image: &Image, function: &Function) -> Bound {
    let mut walk = Walk {
        image,
        known: BTreeMap::new(),
        under_way: Vec::new(),
        findings: BTreeSet::new(),
    };
    let (cycles, stack) = walk.function(function);
    Bound {
        cycles,
        stack,
        findings: walk.findings,
    }
}

struct Walk<'a> {
    image: &'a Image,
    known: BTreeMap<u32, (u64, u32)>,
    under_way: Vec<u32>,
    findings: BTreeSet<String>,
}

impl Walk<'_> {
    fn function(&mut self, function: &Function) -> (u64, u32) {
        if let Some(known) = self.known.get(&function.start) {
            return *known;
        }
        if LEFT_OUT.iter().any(|(name, _)| function.name.contains(name)) {
            return (0, 0);
        }
        if function.name.contains("panic") || function.name.contains("_fail") {
            self.findings.insert(format!("reachable: {}", function.name));
            return (0, 0);
        }
        if self.under_way.contains(&function.start) {
            self.findings.insert(format!("recursion: {}", function.name));
            return (0, 0);
        }
        self.under_way.push(function.start);
        let answer = self.paths(function);
        self.under_way.pop();
        self.known.insert(function.start, answer);
        answer
    }

    fn callee(&mut self, address: u32) -> (u64, u32) {
        match self.image.function_at(address).cloned() {
            Some(function) => self.function(&function),
            None => {
                self.findings
                    .insert(format!("call to {address:#x}, which is no function"));
                (0, 0)
            }
        }
    }

    /// Cost, successors and stack of every instruction, then the longest way.
    fn paths(&mut self, function: &Function) -> (u64, u32) {
        let body: Vec<Instruction> = self
            .image
            .instructions
            .range(function.start..function.end)
            .map(|(_, instruction)| instruction.clone())
            .collect();
        let own_stack: i32 = body.iter().map(|one| one.stack.max(0)).sum();
        let memory = self.memory_of(&body);
        let mut cost = BTreeMap::new();
        let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let mut deepest = 0;
        for one in &body {
            // Any instruction may be the first after a branch: fetched anew, and a taken branch refills.
            let mut fetch = Fetch::default();
            let is_branch = !matches!(one.flow, Flow::Next | Flow::Trap);
            let data = match one.data.literal {
                Some(address) => Memory::of(address),
                None if one.data.is_stack => Memory::Sram,
                None => memory,
            };
            let mut cycles = u64::from(cycles::core(one, is_branch) + cycles::data(one, data));
            let is_entry = Memory::of(one.address) == Memory::Flash || is_branch;
            if is_entry {
                cycles += u64::from(fetch.cost(one));
            }
            let inside = |address: u32| (function.start..function.end).contains(&address);
            let mut targets = Vec::new();
            match one.flow {
                Flow::Next => targets.push(one.next()),
                Flow::Branch(target) => {
                    targets.push(one.next());
                    targets.push(target);
                }
                Flow::Jump(target) => targets.push(target),
                Flow::Call(target) => {
                    let (more, stack) = self.callee(target);
                    cycles += more;
                    deepest = deepest.max(stack);
                    targets.push(one.next());
                }
                Flow::CallRegister => {
                    self.findings.insert(format!(
                        "call through a register in {} at {:#x}",
                        function.name, one.address
                    ));
                    targets.push(one.next());
                }
                Flow::Table => match self.table(one) {
                    Some(found) => targets = found,
                    None => drop(self.findings.insert(format!("jump table in {}", function.name))),
                },
                Flow::JumpRegister if function.name.contains("Thunk") => match self.thunk(&body) {
                    Some(target) => {
                        let (more, stack) = self.callee(target);
                        cycles += more;
                        deepest = deepest.max(stack);
                    }
                    None => drop(self.findings.insert(format!("thunk {}", function.name))),
                },
                Flow::JumpRegister => {
                    self.findings
                        .insert(format!("jump through a register in {}", function.name));
                }
                Flow::Return if one.is_conditional => targets.push(one.next()),
                Flow::Return | Flow::Trap => {}
            }
            // A jump out of the function is a call that does not come back.
            for outside in targets.iter().copied().filter(|target| !inside(*target)) {
                let (more, stack) = self.callee(outside);
                cycles += more;
                deepest = deepest.max(stack);
            }
            targets.retain(|target| inside(*target));
            cost.insert(one.address, cycles);
            next.insert(one.address, targets);
        }
        let longest = self.longest(function, &cost, &next);
        (longest, own_stack as u32 + deepest)
    }

    /// The slowest memory that constants of this function point into; its loads and stores count as going there.
    fn memory_of(&self, body: &[Instruction]) -> Memory {
        let mut registers: BTreeMap<u16, u32> = BTreeMap::new();
        let mut slowest = Memory::Sram;
        let mut saw = |value: u32| {
            let memory = Memory::of(value);
            // Small numbers are no addresses, and constants in flash were copied to SRAM with the code.
            if value >= 0x4000_0000 && memory != Memory::Core && value < 0x6000_0000 {
                slowest = slowest.max(memory);
            }
        };
        for one in body {
            if let Some((register, value, is_upper)) = one.constant {
                let whole = if is_upper {
                    registers.get(&register).copied().unwrap_or_default() & 0xFFFF | value << 16
                } else {
                    value
                };
                registers.insert(register, whole);
                saw(whole);
            }
            if let Some(word) = one.data.literal.and_then(|at| self.image.word(at)) {
                saw(word);
            }
        }
        slowest
    }

    fn thunk(&self, body: &[Instruction]) -> Option<u32> {
        let mut whole = 0;
        for one in body {
            match one.constant {
                Some((_, value, true)) => whole = whole & 0xFFFF | value << 16,
                Some((_, value, false)) => whole = value,
                None => {}
            }
        }
        (whole != 0).then_some(whole & !1)
    }

    /// Where a table of offsets leads: as many entries as lead into the code behind it.
    fn table(&self, one: &Instruction) -> Option<Vec<u32>> {
        let base = one.address + 4;
        let width = if one.name == "tbb" { 1 } else { 2 };
        let (mut targets, mut at, mut first) = (Vec::new(), base, u32::MAX);
        while at < first {
            let offset = match self.image.bytes(at, width as usize)? {
                [byte] => u32::from(*byte),
                [low, high] => u32::from(*low) | u32::from(*high) << 8,
                _ => return None,
            };
            let target = base + 2 * offset;
            first = first.min(target);
            targets.push(target);
            at += width;
        }
        Some(targets)
    }

    /// The longest way from the start, the blocks of loops as often as they may run.
    fn longest(
        &mut self,
        function: &Function,
        cost: &BTreeMap<u32, u64>,
        next: &BTreeMap<u32, Vec<u32>>,
    ) -> u64 {
        let groups = groups(function.start, next);
        let mut group_of = BTreeMap::new();
        for (number, group) in groups.iter().enumerate() {
            for address in group {
                group_of.insert(*address, number);
            }
        }
        let mut longest = vec![0_u64; groups.len()];
        // The groups come callees first, as Tarjan's algorithm finds them.
        for (number, group) in groups.iter().enumerate() {
            let is_loop = group.len() > 1 || group.iter().any(|at| next[at].contains(at));
            let mut own: u64 = group
                .iter()
                .map(|at| cost.get(at).copied().unwrap_or_default())
                .sum();
            if is_loop {
                match LOOPS.iter().find(|(name, _, _)| function.name.contains(name)) {
                    Some((_, rounds, _)) => own *= u64::from(*rounds),
                    None => drop(
                        self.findings
                            .insert(format!("loop without a bound in {}", function.name)),
                    ),
                }
            }
            let behind = group
                .iter()
                .flat_map(|at| &next[at])
                .filter_map(|target| group_of.get(target))
                .filter(|other| **other != number)
                .map(|other| longest[*other])
                .max();
            longest[number] = own + behind.unwrap_or_default();
        }
        group_of.get(&function.start).map_or(0, |number| longest[*number])
    }
}

/// Strongly connected groups of what can be reached from `start`, successors before predecessors (Tarjan).
fn groups(start: u32, next: &BTreeMap<u32, Vec<u32>>) -> Vec<Vec<u32>> {
    let (mut index, mut low): (BTreeMap<u32, usize>, BTreeMap<u32, usize>) = Default::default();
    let (mut stack, mut on_stack): (Vec<u32>, BTreeSet<u32>) = Default::default();
    let mut found = Vec::new();
    let mut work = vec![(start, 0_usize)];
    while let Some((at, edge)) = work.pop() {
        if edge == 0 {
            let number = index.len();
            index.insert(at, number);
            low.insert(at, number);
            stack.push(at);
            on_stack.insert(at);
        }
        let targets = next.get(&at).map(Vec::as_slice).unwrap_or_default();
        if let Some(&target) = targets.get(edge) {
            work.push((at, edge + 1));
            if !index.contains_key(&target) && next.contains_key(&target) {
                work.push((target, 0));
            } else if on_stack.contains(&target) {
                let least = low[&at].min(index[&target]);
                low.insert(at, least);
            }
            continue;
        }
        if low[&at] == index[&at] {
            let mut group = Vec::new();
            while let Some(one) = stack.pop() {
                on_stack.remove(&one);
                group.push(one);
                if one == at {
                    break;
                }
            }
            found.push(group);
        }
        if let Some((above, _)) = work.last() {
            let least = low[above].min(low[&at]);
            low.insert(*above, least);
        }
    }
    found
}
