//! The longest path through a function and all it calls, from the linked image alone: no run, so nothing is left to luck.
//!
//! A loop counts as often as it says itself ([`crate::rounds`]) or [`MACHINE_LOOPS`] does, with its longest way round; loops inside loops likewise. Where an access goes is
//! known when its address is a constant; other addresses are of data, all of which lies in the core-coupled memory. Runs check that where
//! they meet such an access, and one that no run met costs what the slowest memory does ([`Code::met`]).
//! Limits: a loop, a panic, a call through a register or a recursion without a line in the tables here is a finding, and
//! with a finding there is no bound. [`crate::measure`] checks the tables against every run.

use std::collections::{BTreeMap, BTreeSet};

use crate::Error;
use crate::cycles::{self, Fetch, Memory};
use crate::image::{Flow, Function, Image, Instruction, Masking};
use crate::source::{Place, Sources};
use crate::tables::{CALLS, COPY, LEFT_OUT, Left, MACHINE_LOOPS, MachineLoop, OF_TAIL, SKIPPED, TAIL_TAXELS};

/// A loop of the image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loop {
    /// The first instruction of a round.
    pub header: u32,
    /// Its instructions.
    pub body: BTreeSet<u32>,
    /// How often the first instruction runs at most.
    pub rounds: u32,
    /// The function it lies in, and why it has no more rounds.
    pub why: String,
}

/// What the walk came to.
#[derive(Debug, Default, Clone)]
pub struct Bound {
    /// Cycles at most.
    pub cycles: u64,
    /// Bytes of stack at most.
    pub stack: u32,
    /// Every way through it ends where the walk does ([`Walk::ending_with`]), so that its caller does not go on.
    pub is_end: bool,
}

/// What is walked over.
#[derive(Debug, Clone, Copy)]
pub struct Code<'a> {
    /// The linked image.
    pub image: &'a Image,
    /// What stands in its source.
    pub sources: &'a Sources,
    /// Instructions whose accesses runs met, if there were runs. Any other one that accesses an address that is not known costs what the slowest
    /// memory does.
    pub met: Option<&'a BTreeSet<u32>>,
}

/// Walks over one image.
#[derive(Debug)]
pub struct Walk<'a> {
    image: &'a Image,
    sources: &'a Sources,
    met: Option<&'a BTreeSet<u32>>,
    /// Functions that were walked through.
    pub known: BTreeMap<u32, Bound>,
    /// The same of functions that copy, by how many bytes they copy, where the caller has put a constant into the register for it.
    pub copies: BTreeMap<(u32, u32), Bound>,
    /// The bytes that are copied under way.
    copied: Option<u32>,
    under_way: Vec<u32>,
    left_out: Left,
    /// Taxels of the map's last packet.
    tail_taxels: u32,
    /// The function with whose return the walk ends.
    end: Option<u32>,
    /// Loops that the walks met, by their first instruction.
    pub loops: BTreeMap<u32, Loop>,
    /// The memory that an instruction's access was priced with.
    pub memories: BTreeMap<u32, Memory>,
    /// Of these, the ones whose address is not known.
    pub unknown: BTreeSet<u32>,
    /// Whatever stands against the bounds, each once.
    pub findings: BTreeSet<String>,
    /// Functions left out and why, each once.
    pub left: BTreeSet<String>,
}

/// What blocks the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// The running code's priority.
    Priority,
    /// The mask of all interrupts.
    All,
    /// The mask of the path's own interrupt.
    Own,
}

/// A stretch of code with the path blocked.
#[derive(Debug, Clone)]
pub struct Stretch {
    /// Where, and what it calls.
    pub name: String,
    /// The instruction that begins it.
    pub at: u32,
    /// What blocks the path.
    pub block: Block,
    /// Cycles at most.
    pub cycles: u64,
}

type Graph = BTreeMap<u32, Vec<u32>>;

/// The interrupt controller's words that mask and unmask the path's interrupts, numbers 67 and 37 (ARM DUI 0553, NVIC_ICER and NVIC_ISER;
/// RM0090, table 62).
const NVIC_MASK: [u32; 2] = [0xE000_E188, 0xE000_E184];
const NVIC_UNMASK: [u32; 2] = [0xE000_E108, 0xE000_E104];

impl<'a> Walk<'a> {
    /// Of a path that never comes to what `left_out` names.
    #[must_use]
    pub fn new(code: Code<'a>, left_out: Left) -> Self {
        Self {
            image: code.image,
            sources: code.sources,
            met: code.met,
            known: BTreeMap::new(),
            copies: BTreeMap::new(),
            copied: None,
            under_way: Vec::new(),
            left_out,
            tail_taxels: TAIL_TAXELS,
            end: None,
            loops: BTreeMap::new(),
            memories: BTreeMap::new(),
            unknown: BTreeSet::new(),
            findings: BTreeSet::new(),
            left: BTreeSet::new(),
        }
    }

    /// The same for a last packet of so many taxels.
    #[must_use]
    pub fn with_tail(mut self, taxels: u32) -> Self {
        self.tail_taxels = taxels;
        self
    }

    /// The same; what comes after a function's return does not count. A way that does not lead there counts whole.
    #[must_use]
    pub fn ending_with(mut self, function: &Function) -> Self {
        self.end = Some(function.start);
        self
    }

    /// Of what is left of a function after it stores a word at `address`: the longest of all such places, to its return.
    ///
    /// # Errors
    /// A function without such a store.
    pub fn after_store(&mut self, function: &Function, address: u32) -> Result<u64, Error> {
        let places = self.accesses(function, &self.body(function), "str", address);
        self.after(function, &places, &format!("a store at {address:#x}"))
    }

    /// The same after a call.
    ///
    /// # Errors
    /// A function without such a call.
    pub fn after_call(&mut self, function: &Function, callee: &Function) -> Result<u64, Error> {
        let body = self.body(function);
        let calls = body.values().filter(|one| one.flow == Flow::Call(callee.start));
        let places = calls.map(|one| one.address).collect();
        self.after(function, &places, &format!("a call of {}", callee.name))
    }

    fn after(&mut self, function: &Function, places: &BTreeSet<u32>, what: &str) -> Result<u64, Error> {
        let body = self.body(function);
        let behind = places.iter().filter_map(|at| body.get(at).map(Instruction::next));
        let lengths = behind.map(|at| self.paths(function, &body, at, |_| false).0);
        lengths.max().ok_or_else(|| missing(function, what))
    }

    /// From a function's first instruction to its load of a word at `address`, that one included.
    ///
    /// # Errors
    /// A function without such a load.
    pub fn until_load(&mut self, function: &Function, address: u32) -> Result<u64, Error> {
        let body = self.body(function);
        let loads = self.accesses(function, &body, "ldr", address);
        if loads.is_empty() {
            return Err(missing(function, &format!("a load at {address:#x}")));
        }
        let next: Graph = body
            .values()
            .map(|one| (one.address, self.successors(function, &body, one)))
            .collect();
        let mut leads = loads.clone();
        loop {
            let leads_on = |targets: &Vec<u32>| targets.iter().any(|at| leads.contains(at));
            let more = next.iter().filter(|(_, targets)| leads_on(targets));
            let all: BTreeSet<u32> = more.map(|(at, _)| *at).chain(loads.iter().copied()).collect();
            if all == leads {
                break;
            }
            leads = all;
        }
        let is_end = |one: &Instruction| loads.contains(&one.address) || !leads.contains(&one.address);
        Ok(self.paths(function, &body, function.start, is_end).0)
    }

    /// Whether no way of this walk comes to a function.
    fn is_left_out(&mut self, function: &Function) -> bool {
        let left_out = self.left_out;
        let found = LEFT_OUT.iter().find(|(name, left, _)| {
            (*left == left_out || *left == Left::Always) && function.name.contains(name)
        });
        if let Some((name, _, why)) = found {
            self.left.insert(format!("{name}: {why}"));
        }
        found.is_some()
    }

    /// The bound of a function.
    pub fn function(&mut self, function: &Function) -> Bound {
        let known = match self.copied {
            Some(bytes) => self.copies.get(&(function.start, bytes)),
            None => self.known.get(&function.start),
        };
        if let Some(known) = known {
            return known.clone();
        }
        if self.is_left_out(function) {
            return Bound::default();
        }
        if ["panic", "_fail", "unwrap_failed", "expect_failed"]
            .iter()
            .any(|part| function.name.contains(part))
        {
            let from = self.under_way.iter().rev().take(2);
            let from: Vec<&str> = from.map(|at| self.image.functions[at].name.as_str()).collect();
            self.findings
                .insert(format!("panic reachable: {} from {from:?}", function.name));
            return Bound::default();
        }
        if self.under_way.contains(&function.start) {
            self.findings.insert(format!("recursion: {}", function.name));
            return Bound::default();
        }
        self.under_way.push(function.start);
        let body = self.body(function);
        let (longest, stack) = self.paths(function, &body, function.start, |_| false);
        let is_end =
            self.end == Some(function.start) || self.end.is_some() && !self.can_return(function, &body);
        let own_stack: i32 = body.values().map(|one| one.stack.max(0)).sum();
        self.under_way.pop();
        let bound = Bound {
            cycles: longest,
            stack: own_stack as u32 + stack,
            is_end,
        };
        match self.copied {
            Some(bytes) => self.copies.insert((function.start, bytes), bound.clone()),
            None => self.known.insert(function.start, bound.clone()),
        };
        bound
    }

    /// The bound of what is called with these constants in registers.
    fn called(&mut self, address: u32, constants: Option<&Constants>) -> Bound {
        let copies = |function: &Function| function.name.contains(COPY);
        let is_copy = self.image.function_at(address).is_some_and(copies);
        let length = constants.and_then(|known| known.get(&self.image.third_argument));
        let outer = self.copied;
        if let (true, None, Some(Value::Exact(bytes))) = (is_copy, outer, length) {
            self.copied = Some(*bytes);
        }
        let bound = self.callee(address);
        self.copied = outer;
        bound
    }

    /// Every stretch of the image in which the path is blocked: by its priority, by the mask of all interrupts, or by that of its own.
    pub fn blocking_stretches(&mut self, priority: u32) -> Vec<Stretch> {
        let functions: Vec<Function> = self.image.functions.values().cloned().collect();
        let mut stretches = Vec::new();
        for function in &functions {
            if let Some((part, why)) = SKIPPED.iter().find(|(part, _)| function.name.contains(part)) {
                self.left.insert(format!("{part}: {why}"));
                continue;
            }
            let body = self.body(function);
            let [masks, unmasks] = [NVIC_MASK, NVIC_UNMASK].map(|words| -> BTreeSet<u32> {
                let stores = words.map(|word| self.accesses(function, &body, "str", word));
                stores.into_iter().flatten().collect()
            });
            for one in body.values() {
                let is_raised = |one: &Instruction| {
                    one.masking == Masking::Raises && Self::raised_to(&body, one) <= priority
                };
                let is_masked = |one: &Instruction| one.masking == Masking::DisablesAll;
                let block = if is_masked(one) {
                    Block::All
                } else if is_raised(one) {
                    Block::Priority
                } else if masks.contains(&one.address) {
                    Block::Own
                } else {
                    continue;
                };
                let is_end = |other: &Instruction| match block {
                    Block::All => other.masking == Masking::EnablesAll,
                    Block::Priority => other.masking == Masking::Restores,
                    Block::Own => unmasks.contains(&other.address),
                };
                let inside = self.inside(function, &body, one.next(), is_end);
                let is_over = |at: &u32| is_end(&body[at]) || body[at].flow == Flow::Return;
                if !inside.iter().any(is_over) {
                    self.left.insert(format!(
                        "{} at {:#x}: ends in a reset",
                        function.name, one.address
                    ));
                    continue;
                }
                self.under_way.push(function.start);
                let (cycles, _) = self.paths(function, &body, one.next(), is_end);
                self.under_way.pop();
                // A mask inside another one would end the stretch with its own end, too early.
                let is_nested = inside.iter().any(|at| {
                    let other = &body[at];
                    is_masked(other) || other.masking == Masking::Raises || masks.contains(at)
                });
                if is_nested {
                    self.findings.insert(format!(
                        "a mask inside another one in {} at {:#x}",
                        function.name, one.address
                    ));
                }
                let calls: BTreeSet<&str> = inside
                    .iter()
                    .filter_map(|at| match body[at].flow {
                        Flow::Call(target) | Flow::Jump(target) => self.image.function_at(target),
                        _ => None,
                    })
                    .filter(|callee| callee.start != function.start)
                    .map(|callee| short(callee.name.trim_start_matches("Thunk of ")))
                    .collect();
                stretches.push(Stretch {
                    name: format!("{} {calls:?} at {:#x}", function.name, one.address),
                    at: one.address,
                    block,
                    cycles,
                });
            }
        }
        stretches.sort_by_key(|stretch| std::cmp::Reverse(stretch.cycles));
        stretches
    }

    /// The instructions of a function that can be reached before `is_end`, that one included.
    fn inside(
        &mut self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
        start: u32,
        is_end: impl Fn(&Instruction) -> bool,
    ) -> BTreeSet<u32> {
        let (mut seen, mut work) = (BTreeSet::new(), vec![start]);
        while let Some(at) = work.pop() {
            let Some(one) = body.get(&at).filter(|_| seen.insert(at)) else {
                continue;
            };
            if !is_end(one) {
                let next = self.successors(function, body, one);
                work.extend(next.into_iter().filter(|target| body.contains_key(target)));
            }
        }
        seen
    }

    /// The instructions of a function with such a name, a load's or a store's, that access this address.
    fn accesses(
        &self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
        name: &str,
        address: u32,
    ) -> BTreeSet<u32> {
        // An address in the same 64 KiB is a constant of the function.
        let is_near = |one: &Instruction| match one.constant {
            Some((_, value, true)) => value == address >> 16,
            Some((_, value, false)) => value >> 16 == address >> 16,
            None => one
                .data
                .literal
                .and_then(|literal| self.image.word(literal))
                .is_some_and(|value| value >> 16 == address >> 16),
        };
        if !body.values().any(is_near) {
            return BTreeSet::new();
        }
        let known = self.constants_of_all(function, body);
        body.values()
            .filter(|one| one.name.starts_with(name))
            .filter(|one| {
                let base = one
                    .base
                    .and_then(|(base, offset)| Some((known.get(&one.address)?.get(&base)?, offset)));
                matches!(base, Some((Value::Exact(base), offset)) if base.wrapping_add(offset) == address)
            })
            .map(|one| one.address)
            .collect()
    }

    /// The priority that an instruction raises the running code to: the constant last put into its register.
    fn raised_to(body: &BTreeMap<u32, Instruction>, at: &Instruction) -> u32 {
        let register = at.text.rsplit(' ').next().unwrap_or_default();
        let constant = body
            .range(..at.address)
            .rev()
            .map(|(_, one)| one)
            .find(|one| one.text.contains(&format!(" {register},")))
            .and_then(|one| one.constant);
        constant.map_or(0, |(_, value, _)| value)
    }

    fn body(&self, function: &Function) -> BTreeMap<u32, Instruction> {
        self.image
            .instructions
            .range(function.start..function.end)
            .map(|(at, instruction)| (*at, instruction.clone()))
            .collect()
    }

    fn callee(&mut self, address: u32) -> Bound {
        match self.image.function_at(address).cloned() {
            Some(function) if function.start == address => self.function(&function),
            _ => {
                self.findings
                    .insert(format!("call to {address:#x}, where no function begins"));
                Bound::default()
            }
        }
    }

    /// Cost and successors of every instruction, then the longest way from `start`; and the deepest stack of a callee.
    fn paths(
        &mut self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
        start: u32,
        is_end: impl Fn(&Instruction) -> bool,
    ) -> (u64, u32) {
        let mut next = Graph::new();
        let mut leaving: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        // What can be reached.
        let mut work = vec![start];
        while let Some(at) = work.pop() {
            if next.contains_key(&at) {
                continue;
            }
            let Some(one) = body.get(&at) else {
                self.findings
                    .insert(format!("code that does not decode at {at:#x}"));
                continue;
            };
            let mut targets = if is_end(one) {
                Vec::new()
            } else {
                self.successors(function, body, one)
            };
            let (inside, outside): (Vec<u32>, Vec<u32>) = targets
                .drain(..)
                .partition(|target| (function.start..function.end).contains(target));
            work.extend(&inside);
            leaving.insert(at, outside);
            next.insert(at, inside);
        }
        let constants = self.constants(function, body, start, &next);
        let mut cost = BTreeMap::new();
        let mut deepest = 0;
        for at in next.keys() {
            let one = &body[at];
            let mut cycles = self.price(one, constants.get(at));
            if !is_end(one) {
                let mut callees: Vec<u32> = leaving[at].clone();
                match one.flow {
                    Flow::Call(target) => callees.push(target),
                    Flow::CallRegister => callees.extend(self.resolve(function, one)),
                    _ => {}
                }
                let mut max = 0;
                for callee in callees {
                    let bound = self.called(callee, constants.get(at));
                    max = max.max(bound.cycles);
                    deepest = deepest.max(bound.stack);
                }
                cycles += max;
            }
            cost.insert(*at, cycles);
        }
        let nodes: BTreeSet<u32> = next.keys().copied().collect();
        (self.longest(function, start, &nodes, &next, &cost), deepest)
    }

    /// What an instruction may lead to; addresses outside of the function are calls that do not come back.
    fn successors(
        &mut self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
        one: &Instruction,
    ) -> Vec<u32> {
        match one.flow {
            Flow::Next | Flow::Call(_) | Flow::CallRegister => {
                let is_last = match one.flow {
                    Flow::Call(target) => {
                        self.is_noreturn(target) || self.is_never_called(target) || self.is_end(target)
                    }
                    _ => false,
                };
                if is_last { Vec::new() } else { vec![one.next()] }
            }
            Flow::Branch(target) => vec![one.next(), target],
            Flow::Jump(target) => vec![target],
            Flow::Table => self.image.table(one).unwrap_or_else(|| {
                self.findings.insert(format!("jump table in {}", function.name));
                Vec::new()
            }),
            Flow::JumpRegister if function.name.contains("Thunk") => {
                let target = thunk(body);
                if target.is_none() {
                    self.findings.insert(format!("thunk {}", function.name));
                }
                target.into_iter().collect()
            }
            Flow::JumpRegister => self.resolve(function, one),
            Flow::Return if one.is_conditional => vec![one.next()],
            Flow::Return | Flow::Trap => Vec::new(),
        }
    }

    /// Whether no way of this walk leads on from such a call, because none comes to it.
    fn is_never_called(&mut self, target: u32) -> bool {
        let callee = self.image.function_at(target).cloned();
        callee.is_some_and(|callee| self.is_left_out(&callee))
    }

    /// Whether the walk ends in what is called.
    fn is_end(&mut self, target: u32) -> bool {
        self.end.is_some() && self.callee(target).is_end
    }

    /// Whether a way leads through a function that does not end where the walk does.
    fn can_return(&mut self, function: &Function, body: &BTreeMap<u32, Instruction>) -> bool {
        let (mut seen, mut work) = (BTreeSet::new(), vec![function.start]);
        while let Some(at) = work.pop() {
            let Some(one) = body.get(&at).filter(|_| seen.insert(at)) else {
                continue;
            };
            if one.flow == Flow::Return {
                return true;
            }
            for target in self.successors(function, body, one) {
                let is_inside = (function.start..function.end).contains(&target);
                if !is_inside && !self.is_end(target) {
                    return true;
                }
                work.push(target);
            }
        }
        false
    }

    fn is_noreturn(&self, target: u32) -> bool {
        self.image
            .function_at(target)
            .is_some_and(|callee| callee.name.contains("panic") || callee.name.contains("_fail"))
    }

    /// Where a call through a register leads, when a table says.
    fn resolve(&mut self, function: &Function, one: &Instruction) -> Vec<u32> {
        let places = self.sources.places(one.address);
        let found = CALLS.iter().find(|(part, _, _)| {
            function.name.contains(part) || places.iter().any(|place| place.function.contains(part))
        });
        let Some((_, targets, why)) = found else {
            self.findings.insert(format!(
                "call through a register in {} at {:#x} ({})",
                function.name,
                one.address,
                places
                    .first()
                    .map(|place| place.text.as_str())
                    .unwrap_or_default(),
            ));
            return Vec::new();
        };
        self.left
            .insert(format!("{}: calls {targets:?}, {why}", short(&function.name)));
        let addresses: Vec<u32> = targets
            .iter()
            .flat_map(|target| self.image.functions_named(target))
            .map(|callee| callee.start)
            .collect();
        if addresses.is_empty() {
            self.findings.insert(format!(
                "{targets:?}, which {} calls, is not in the image",
                function.name
            ));
        }
        addresses
    }

    /// Cycles of one instruction, calls not counted.
    fn price(&mut self, one: &Instruction, constants: Option<&Constants>) -> u64 {
        // Any instruction may be the first after a branch: fetched anew, and a taken branch refills.
        let mut fetch = Fetch::default();
        let is_branch = !matches!(one.flow, Flow::Next | Flow::Trap);
        let based = constants.and_then(|known| {
            let (base, offset) = one.base?;
            known.get(&base).map(|value| value.memory(offset))
        });
        let memory = match one.data.literal {
            Some(address) => Memory::of(address),
            None => based.unwrap_or_else(|| self.of_unknown(one)),
        };
        if one.data.transfers > 0 {
            let known = self.memories.entry(one.address).or_insert(memory);
            *known = (*known).max(memory);
            if one.data.literal.is_none() && based.is_none() && !one.data.is_stack {
                self.unknown.insert(one.address);
            }
        }
        let refill = if is_branch { cycles::REFILL } else { 0 };
        let mut cycles = u64::from(cycles::core(one) + refill + cycles::data(one, memory));
        if Memory::of(one.address) == Memory::Flash || is_branch {
            cycles += u64::from(fetch.cost(one));
        }
        cycles
    }

    /// The memory that an access to an unknown address is priced with. Stacks lie in the core-coupled memory (`memory.x`).
    fn of_unknown(&self, one: &Instruction) -> Memory {
        let is_met = self.met.is_none_or(|met| met.contains(&one.address));
        if one.data.is_stack || is_met {
            Memory::Coupled
        } else {
            Memory::SLOWEST
        }
    }

    /// Constants in registers before every instruction of a function.
    fn constants_of_all(
        &self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
    ) -> BTreeMap<u32, Constants> {
        let mut whole = Graph::new();
        for one in body.values() {
            let mut targets: Vec<u32> = match one.flow {
                Flow::Branch(target) => vec![one.next(), target],
                Flow::Jump(target) => vec![target],
                Flow::Return | Flow::Trap | Flow::JumpRegister if !one.is_conditional => Vec::new(),
                Flow::Table => self.image.table(one).unwrap_or_default(),
                _ => vec![one.next()],
            };
            targets.retain(|target| body.contains_key(target));
            whole.insert(one.address, targets);
        }
        self.constants(function, body, function.start, &whole)
    }

    /// Constants in registers before every instruction, over all ways that lead there.
    fn constants(
        &self,
        function: &Function,
        body: &BTreeMap<u32, Instruction>,
        start: u32,
        next: &Graph,
    ) -> BTreeMap<u32, Constants> {
        let mut before: BTreeMap<u32, Constants> = BTreeMap::from([(start, Constants::new())]);
        // A stretch inside a function begins with what the whole function knows there.
        if start != function.start {
            let known = self.constants_of_all(function, body);
            before.insert(start, known.get(&start).cloned().unwrap_or_default());
        }
        let mut work = vec![start];
        while let Some(at) = work.pop() {
            let Some(one) = body.get(&at) else { continue };
            let mut after = before[&at].clone();
            self.step(one, &mut after);
            for target in next.get(&at).into_iter().flatten() {
                let merged = match before.get(target) {
                    None => after.clone(),
                    Some(known) => known
                        .iter()
                        .filter_map(|(register, value)| {
                            let other = after.get(register)?;
                            let merged = if other == value {
                                *value
                            } else {
                                Value::In(value.memory(0).max(other.memory(0)))
                            };
                            Some((*register, merged))
                        })
                        .collect(),
                };
                if before.get(target) != Some(&merged) {
                    before.insert(*target, merged);
                    work.push(*target);
                }
            }
        }
        before
    }

    fn step(&self, one: &Instruction, known: &mut Constants) {
        let value = match (one.constant, one.offset, one.data.literal) {
            (Some((register, value, true)), _, _) => known.get(&register).map(|low| {
                let Value::Exact(low) = *low else {
                    return (register, *low);
                };
                (register, Value::Exact(low & 0xFFFF | value << 16))
            }),
            (Some((register, value, false)), _, _) => Some((register, Value::Exact(value))),
            (None, Some((to, from, value)), _) => known.get(&from).map(|base| match *base {
                Value::Exact(base) => (to, Value::Exact(base.wrapping_add(value))),
                Value::In(memory) => (to, Value::In(memory)),
            }),
            (None, None, Some(address)) => {
                let register = one.writes.first().copied();
                register.zip(self.image.word(address).map(Value::Exact))
            }
            _ => None,
        };
        for register in &one.writes {
            known.remove(register);
        }
        if matches!(one.flow, Flow::Call(_) | Flow::CallRegister) {
            // The callee keeps r4 to r11 for its caller.
            known.retain(|register, _| self.image.kept_by_callees.contains(register));
        }
        if let Some((register, value)) = value.filter(|_| !one.is_conditional) {
            known.insert(register, value);
        }
    }

    /// The longest way from `start` to anywhere in `nodes`, loops as often as they may run.
    fn longest(
        &mut self,
        function: &Function,
        start: u32,
        nodes: &BTreeSet<u32>,
        next: &Graph,
        cost: &BTreeMap<u32, u64>,
    ) -> u64 {
        let groups = groups(start, next);
        let mut group_of = BTreeMap::new();
        for (number, group) in groups.iter().enumerate() {
            for address in group {
                group_of.insert(*address, number);
            }
        }
        // The groups come successors first, as Tarjan's algorithm finds them.
        let mut longest = vec![0_u64; groups.len()];
        for (number, group) in groups.iter().enumerate() {
            let is_loop = group.len() > 1 || next[&group[0]].contains(&group[0]);
            let own = if is_loop {
                self.round(function, start, group, nodes, next, cost)
            } else {
                cost[&group[0]]
            };
            let behind = group
                .iter()
                .flat_map(|at| &next[at])
                .filter_map(|target| group_of.get(target))
                .filter(|other| **other != number)
                .map(|other| longest[*other])
                .max();
            longest[number] = own + behind.unwrap_or_default();
        }
        group_of.get(&start).map_or(0, |number| longest[*number])
    }

    /// All rounds of a loop.
    fn round(
        &mut self,
        function: &Function,
        start: u32,
        group: &[u32],
        nodes: &BTreeSet<u32>,
        next: &Graph,
        cost: &BTreeMap<u32, u64>,
    ) -> u64 {
        let body: BTreeSet<u32> = group.iter().copied().collect();
        let mut headers: BTreeSet<u32> = nodes
            .difference(&body)
            .flat_map(|at| &next[at])
            .filter(|target| body.contains(target))
            .copied()
            .collect();
        if body.contains(&start) {
            headers.insert(start);
        }
        let Some(&header) = headers.first() else { return 0 };
        // One round: the loop without its ways back.
        let mut inner = Graph::new();
        for at in &body {
            let targets = next[at].iter().copied();
            inner.insert(
                *at,
                targets
                    .filter(|target| body.contains(target) && *target != header)
                    .collect(),
            );
        }
        if headers.len() > 1 {
            self.findings.insert(format!(
                "loop with two entries in {} at {header:#x}",
                function.name
            ));
        }
        let way = self.longest(function, header, &body, &inner, cost);
        // Its own instructions, those of loops inside not counted.
        let inside: BTreeSet<u32> = groups(header, &inner)
            .into_iter()
            .filter(|group| group.len() > 1 || inner[&group[0]].contains(&group[0]))
            .flatten()
            .collect();
        let own: BTreeSet<u32> = body.difference(&inside).copied().collect();
        let found = self.rounds_of(function, &own);
        let is_tested_first = Self::is_tested_first(header, &body, next);
        let found = found.map(|(rounds, says_so, why)| (rounds + u32::from(says_so && is_tested_first), why));
        let Some((rounds, why)) = found else {
            let places: Vec<Place> = own.iter().flat_map(|at| self.sources.places(*at)).collect();
            let texts: BTreeSet<&str> = places
                .iter()
                .filter(|place| !place.file.contains("/library/"))
                .map(|place| place.text.as_str())
                .collect();
            self.findings.insert(format!(
                "loop without a bound in {} at {header:#x}: {texts:?}",
                function.name
            ));
            return way;
        };
        let one = self.loops.entry(header).or_insert_with(|| Loop {
            header,
            body,
            rounds,
            why: format!("{}: {why}", short(&function.name)),
        });
        one.rounds = one.rounds.max(rounds);
        way * u64::from(rounds)
    }

    /// Whether a loop may be left by the first branch behind its first instruction, which then runs once more than the rest.
    fn is_tested_first(header: u32, body: &BTreeSet<u32>, next: &Graph) -> bool {
        let mut at = header;
        while let [only] = next[&at].as_slice() {
            if *only == header || !body.contains(only) {
                return false;
            }
            at = *only;
        }
        let targets = &next[&at];
        targets.iter().any(|target| !body.contains(target)) && !targets.contains(&header)
    }

    /// How often a loop of these instructions runs at most, those of loops inside it left out; whether it says so itself, and why.
    fn rounds_of(&self, function: &Function, own: &BTreeSet<u32>) -> Option<(u32, bool, &'static str)> {
        let is_tail = self.left_out == Left::Tail;
        if let Some(max) = own.iter().filter_map(|at| self.sources.rounds(*at)).max() {
            let stands_in = |part: &str| {
                let mut places = own.iter().flat_map(|at| self.sources.places(*at));
                function.name.contains(part) || places.any(|place| place.function.contains(part))
            };
            let fewer = OF_TAIL
                .iter()
                .find(|one| is_tail && one.says == max && stands_in(one.function));
            return Some(match fewer {
                Some(one) => ((one.rounds)(self.tail_taxels), true, one.why),
                None => (max, true, "the loop says so"),
            });
        }
        let fits = |one: &&MachineLoop| {
            let starts = |at: &u32| self.image.instructions[at].text.starts_with(one.instruction);
            function.name.contains(one.function) && own.iter().any(starts)
        };
        MACHINE_LOOPS.iter().find(fits).map(|one| {
            let rounds = match self.copied {
                _ if is_tail => (one.of_tail)(self.tail_taxels),
                Some(bytes) => (one.of_copy)(bytes),
                _ => one.most,
            };
            (rounds, false, one.why)
        })
    }
}

type Constants = BTreeMap<u16, Value>;

/// What is known of a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Value {
    /// This.
    Exact(u32),
    /// An address in this memory, or in a faster one.
    In(Memory),
}

impl Value {
    fn memory(self, offset: u32) -> Memory {
        match self {
            Self::Exact(base) => Memory::of(base.wrapping_add(offset)),
            Self::In(memory) => memory,
        }
    }
}

fn missing(function: &Function, what: &str) -> Error {
    Error::Unexpected {
        expected: format!("{what} in {}", function.name),
        found: "none".to_owned(),
    }
}

fn thunk(body: &BTreeMap<u32, Instruction>) -> Option<u32> {
    let mut whole = 0;
    for one in body.values() {
        match one.constant {
            Some((_, value, true)) => whole = whole & 0xFFFF | value << 16,
            Some((_, value, false)) => whole = value,
            None => {}
        }
    }
    (whole != 0).then_some(whole & !1)
}

/// The last two parts of a name.
#[must_use]
pub fn short(name: &str) -> &str {
    let end = name
        .rfind("::")
        .map_or(0, |end| name[..end].rfind("::").map_or(0, |at| at + 2));
    &name[end..]
}

/// Strongly connected groups of what can be reached from `start`, successors before predecessors (Tarjan).
fn groups(start: u32, next: &Graph) -> Vec<Vec<u32>> {
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
                let lowest = low[&at].min(index[&target]);
                low.insert(at, lowest);
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
            let lowest = low[above].min(low[&at]);
            low.insert(*above, lowest);
        }
    }
    found
}
