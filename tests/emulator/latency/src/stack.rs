//! The worst stack of every context (the tasks without priority, each interrupt, faults) and of all of them nested, over the linked
//! image alone. Bytes.
//!
//! A function takes all that its instructions lower the stack pointer by, and the most that anything it calls takes. An interrupt takes
//! its exception's frame too; of each priority one is under way at most. A call through a register goes to the constant that its
//! register holds, or to any function whose address the image keeps; tasks are polled by their own executor alone.
//! Limits: a recursion, a stack pointer that is computed, a handler without a priority in the table here is a finding, and with a finding
//! there is no bound.

use std::collections::{BTreeMap, BTreeSet};

use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags};

use crate::Error;
use crate::image::{Flow, Function, Image, Instruction};
use crate::source::Sources;

/// Bytes that an exception puts on the stack, floating-point registers and a gap for alignment included.
pub const FRAME_BYTES: u32 = 26 * 4 + 4;
/// The priorities of the interrupts (`firmware/mcu/src/priority.rs`): the same for some that never interrupt each other. Limits:
/// they stand here a second time; the emulated board does not let the interrupt controller be read.
pub const PRIORITIES: &[(&str, u8)] = &[
    ("OTG_FS", 2),
    ("UART4", 3),
    ("USART1", 3),
    ("UART5", 4),
    ("TIM5", 4),
    ("USART2", 5),
];
/// The functions that poll tasks, and the module whose tasks they poll; none for all other tasks.
const EXECUTORS: &[(&str, Option<&str>)] = &[
    ("UART5", Some("gripline_mcu::control_task")),
    ("Executor::run", None),
];
/// Where tasks are polled.
const POLL: &str = "TaskStorage<F>::poll";
/// Where the program begins; where faults end, with a stack of their own; where unexpected exceptions end.
const START: &str = "Reset";
const FAULT: &str = "HardFault";
/// The fault's handler takes the stack from its start; the chip's bootloader has one of its own, and does not return.
const OWN_STACK: &[&str] = &[FAULT, "bootloader::enter_if_asked"];
const UNEXPECTED: &str = "DefaultHandler";
/// Flash's first address: the vectors, of which the first 16 are the core's.
const VECTORS: u32 = 0x0800_0000;
const CORE_VECTORS: u32 = 16;
const ALL_VECTORS: u32 = 107;
/// The lowest address of the stack's memory: below it there is none.
const MEMORY: u32 = 0x1000_0000;

/// A context and its worst stack.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Context {
    /// The function that it begins with.
    pub name: String,
    /// Its interrupts' priority; none for tasks and faults.
    pub priority: Option<u8>,
    /// Without the exception's frame.
    pub bytes: u32,
    /// The functions of the deepest way, outermost first, each with what it takes itself.
    pub chain: Vec<(String, u32)>,
}

/// The stack of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stack {
    /// Every context, tasks first, then by priority.
    pub contexts: Vec<Context>,
    /// All contexts nested, at most.
    pub bound: u32,
    /// The highest address of the stack's memory, and the lowest.
    pub memory: (u32, u32),
    /// What stands against the bound.
    pub findings: BTreeSet<String>,
}

impl Stack {
    /// Of an ELF file that `image` and `sources` were read from.
    ///
    /// # Errors
    /// A file without the symbols of its stack, or without the function that begins.
    pub fn of(image: &Image, sources: &Sources, elf: &[u8]) -> Result<Self, Error> {
        let file = object::File::parse(elf).map_err(|error| Error::Image(error.to_string()))?;
        let symbol = |name: &str| {
            let found = file.symbols().find(|symbol| symbol.name() == Ok(name));
            found
                .map(|symbol| symbol.address() as u32)
                .ok_or_else(|| Error::Image(format!("no symbol {name}")))
        };
        let memory = (symbol("_stack_start")?, symbol("_stack_end")?);
        let mut walk = Walk {
            image,
            known: BTreeMap::new(),
            under_way: Vec::new(),
            taken: taken(image),
            tasks: tasks(image, sources),
            findings: BTreeSet::new(),
        };
        if memory.1 != MEMORY {
            walk.findings.insert(format!(
                "the stack ends at {:#010x}, expected the lowest address of its memory, {MEMORY:#010x}",
                memory.1
            ));
        }
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else {
                continue;
            };
            let (start, end) = (section.address(), section.address() + section.size());
            let is_there = sh_flags & u64::from(object::elf::SHF_ALLOC) != 0
                && start < end
                && start < memory.0.into()
                && end > memory.1.into();
            if is_there {
                let name = section.name().unwrap_or_default();
                walk.findings.insert(format!("{name} lies in the stack's memory"));
            }
        }

        let mut contexts = vec![walk.context(&named(image, START)?, None)];
        let unexpected = named(image, UNEXPECTED)?;
        let mut handlers: BTreeSet<u32> = BTreeSet::new();
        for number in 1..ALL_VECTORS {
            let Some(address) = image.word(VECTORS + 4 * number).filter(|address| *address != 0) else {
                continue;
            };
            let Some(handler) = image.function_at(address & !1).cloned() else {
                continue;
            };
            if [START, FAULT].contains(&handler.name.as_str()) || handler.start == unexpected.start {
                continue;
            }
            let priority = PRIORITIES.iter().find(|(name, _)| *name == handler.name);
            if priority.is_none() || number < CORE_VECTORS {
                walk.findings
                    .insert(format!("handler {} without a known priority", handler.name));
            }
            if handlers.insert(handler.start) {
                let context = walk.context(&handler, priority.map(|(_, priority)| *priority));
                contexts.push(context);
            }
        }
        contexts[1..].sort_by_key(|context| (context.priority, context.name.clone()));
        contexts.push(walk.context(&unexpected, None));
        let mut of_priority: BTreeMap<u8, u32> = BTreeMap::new();
        for context in &contexts {
            if let Some(priority) = context.priority {
                let most = of_priority.entry(priority).or_default();
                *most = context.bytes.max(*most);
            }
        }
        let unexpected_bytes = contexts.last().map_or(0, |context| context.bytes);
        let nested: u32 = of_priority.values().map(|bytes| bytes + FRAME_BYTES).sum();
        // An unexpected exception above all, and the frame of a fault in it, which then takes the stack from its start.
        let bound = contexts[0].bytes + nested + unexpected_bytes + 2 * FRAME_BYTES;
        Ok(Self {
            contexts,
            bound,
            memory,
            findings: walk.findings,
        })
    }

    /// What does not hold, after a run that took `measured` bytes.
    #[must_use]
    pub fn failures(&self, measured: u32) -> Vec<String> {
        let mut failures: Vec<String> = self
            .findings
            .iter()
            .map(|finding| format!("against the stack's bound: {finding}"))
            .collect();
        for (what, found, limit) in [
            ("stack of all contexts, bytes", self.bound, self.room()),
            ("stack of a run, bytes", measured, self.bound),
        ] {
            if found > limit {
                failures.push(format!("{what}: found {found}, expected at most {limit}"));
            }
        }
        failures
    }

    /// Bytes that the link leaves for it.
    #[must_use]
    pub const fn room(&self) -> u32 {
        self.memory.0 - self.memory.1
    }
}

fn named(image: &Image, name: &str) -> Result<Function, Error> {
    let found = image.functions.values().find(|function| function.name == name);
    found
        .cloned()
        .ok_or_else(|| Error::Image(format!("no function {name}")))
}

/// What a function comes to.
#[derive(Debug, Clone, Default)]
struct Deepest {
    own: u32,
    bytes: u32,
    next: Option<u32>,
}

struct Walk<'a> {
    image: &'a Image,
    known: BTreeMap<u32, Deepest>,
    under_way: Vec<u32>,
    /// Functions whose address the image keeps, tasks not among them.
    taken: BTreeSet<u32>,
    /// The polled functions, and the module of each.
    tasks: BTreeMap<u32, BTreeSet<String>>,
    findings: BTreeSet<String>,
}

impl Walk<'_> {
    fn context(&mut self, function: &Function, priority: Option<u8>) -> Context {
        let bytes = self.function(function);
        let mut chain = Vec::new();
        let mut at = Some(function.start);
        while let Some(start) = at {
            let Some(deepest) = self.known.get(&start) else {
                break;
            };
            let name = self.image.functions.get(&start).map(|one| one.name.clone());
            chain.push((name.unwrap_or_default(), deepest.own));
            at = deepest.next;
        }
        Context {
            name: function.name.clone(),
            priority,
            bytes,
            chain,
        }
    }

    /// Bytes at most from the entry of a function.
    fn function(&mut self, function: &Function) -> u32 {
        if let Some(known) = self.known.get(&function.start) {
            return known.bytes;
        }
        if self.under_way.contains(&function.start) {
            let names: Vec<&str> = self
                .under_way
                .iter()
                .skip_while(|start| **start != function.start)
                .filter_map(|start| self.image.functions.get(start))
                .map(|one| one.name.as_str())
                .collect();
            self.findings.insert(format!("recursion: {}", names.join(" > ")));
            return 0;
        }
        self.under_way.push(function.start);
        let body: Vec<&Instruction> = self
            .image
            .instructions
            .range(function.start..function.end)
            .map(|(_, one)| one)
            .collect();
        let own = self.own(function, &body);
        let (mut most, mut next) = (0, None);
        for callee in self.callees(function, &body) {
            let Some(callee) = self.image.function_at(callee).cloned() else {
                self.findings.insert(format!(
                    "{} calls {callee:#x}, where no function is",
                    function.name
                ));
                continue;
            };
            let bytes = self.function(&callee);
            if bytes >= most {
                (most, next) = (bytes, Some(callee.start));
            }
        }
        self.under_way.pop();
        let deepest = Deepest {
            own,
            bytes: own + most,
            next,
        };
        self.known.insert(function.start, deepest);
        own + most
    }

    /// What the function's instructions lower the stack pointer by, all together.
    fn own(&mut self, function: &Function, body: &[&Instruction]) -> u32 {
        let mut own = 0;
        for one in body {
            let lowers = one.stack > 0;
            own += one.stack.max(0) as u32;
            let is_repeated = |other: &&&Instruction| match other.flow {
                Flow::Branch(target) | Flow::Jump(target) => {
                    other.address >= one.address && (function.start..=one.address).contains(&target)
                }
                _ => false,
            };
            if lowers && body.iter().any(|other| is_repeated(&other)) {
                self.findings.insert(format!(
                    "the stack pointer may be lowered in a loop: {} at {:#x}",
                    function.name, one.address
                ));
            }
            let takes_its_own = OWN_STACK.iter().any(|name| function.name.ends_with(name));
            if computes_stack_pointer(&one.text) && one.stack == 0 && !takes_its_own {
                self.findings.insert(format!(
                    "the stack pointer is computed: {} at {:#x} ({})",
                    function.name, one.address, one.text
                ));
            }
        }
        own
    }

    fn callees(&mut self, function: &Function, body: &[&Instruction]) -> BTreeSet<u32> {
        let mut callees = BTreeSet::new();
        for one in body {
            match one.flow {
                Flow::Call(target) => {
                    callees.insert(target);
                }
                Flow::Jump(target) | Flow::Branch(target)
                    if !(function.start..function.end).contains(&target) =>
                {
                    callees.insert(target);
                }
                Flow::CallRegister | Flow::JumpRegister => {
                    let register = one.text.rsplit(' ').next().unwrap_or_default();
                    let constants = constants(self.image, body, register);
                    if constants.is_empty() {
                        callees.extend(self.any_callee(function));
                    } else {
                        callees.extend(constants.iter().map(|address| address & !1));
                    }
                }
                _ => {}
            }
        }
        callees
    }

    /// Where a call through a register may lead.
    fn any_callee(&self, function: &Function) -> Vec<u32> {
        let executor = EXECUTORS.iter().find(|(name, _)| function.name.ends_with(name));
        let Some((_, module)) = executor else {
            return self.taken.iter().copied().collect();
        };
        let is_of =
            |modules: &BTreeSet<String>, module: &str| modules.iter().any(|name| name.contains(module));
        let others: Vec<&str> = EXECUTORS.iter().filter_map(|(_, module)| *module).collect();
        self.tasks
            .iter()
            .filter(|(_, modules)| match module {
                Some(module) => is_of(modules, module),
                None => !others.iter().any(|module| is_of(modules, module)),
            })
            .map(|(start, _)| *start)
            .chain(self.taken.iter().copied())
            .collect()
    }
}

/// Whether an instruction sets the stack pointer from another register than a frame pointer.
fn computes_stack_pointer(text: &str) -> bool {
    let Some((name, operands)) = text.split_once(' ') else {
        return false;
    };
    let mut operands = operands.split(", ");
    let sets = operands.next() == Some("sp") && !name.starts_with("cmp") && !name.starts_with("str");
    let from = operands.next().unwrap_or_default();
    let is_plain = matches!(from, "r7" | "sp") || from.starts_with('#');
    sets && !is_plain || name == "msr" && text.contains("msp")
}

/// The constants that a register may hold in a function; none when something else may be in it.
fn constants(image: &Image, body: &[&Instruction], register: &str) -> BTreeSet<u32> {
    let (mut found, mut low, mut id) = (BTreeSet::new(), None, None);
    let is_first = |one: &Instruction| {
        let operands = one.text.split_once(' ').map_or("", |(_, operands)| operands);
        operands.split(", ").next() == Some(register)
    };
    for one in body.iter().filter(|one| is_first(one)) {
        match (one.constant, one.data.literal) {
            (Some((register, value, true)), _) => {
                id = Some(register);
                if let Some(low) = low.take() {
                    found.insert(value << 16 | low & 0xFFFF);
                }
            }
            (Some((register, value, false)), _) => {
                (id, low) = (Some(register), Some(value));
            }
            (None, Some(address)) => {
                id = one.writes.first().copied();
                found.extend(image.word(address));
            }
            (None, None) => {}
        }
    }
    let is_other = |one: &&Instruction| {
        let is_epilogue = one.name == "pop" || one.text.contains("sp!") || one.flow == Flow::Return;
        let is_constant = is_first(one) && (one.constant.is_some() || one.data.literal.is_some());
        id.is_some_and(|id| one.writes.contains(&id)) && !is_constant && !is_epilogue
    };
    if body.iter().any(is_other) {
        return BTreeSet::new();
    }
    found.retain(|address| image.function_at(address & !1).is_some());
    found
}

/// Functions whose address the image keeps: in its data, or in the constants of its code. Handlers and tasks are not among them.
fn taken(image: &Image) -> BTreeSet<u32> {
    let mut taken = BTreeSet::new();
    let mut take = |address: u32| {
        let function = image.functions.get(&(address & !1)).filter(|_| address & 1 == 1);
        if let Some(function) = function.filter(|one| !one.name.ends_with(POLL)) {
            taken.insert(function.start);
        }
    };
    for (address, word) in image.words() {
        let is_vector = (VECTORS..VECTORS + 4 * ALL_VECTORS).contains(&address);
        if !is_vector && !image.instructions.contains_key(&address) {
            take(word);
        }
    }
    let mut low: BTreeMap<u16, u32> = BTreeMap::new();
    for one in image.instructions.values() {
        // The linker's way to a callee keeps no address for others.
        let is_thunk = |function: &Function| function.name.starts_with("Thunk of ");
        if image.function_at(one.address).is_some_and(is_thunk) {
            continue;
        }
        match one.constant {
            Some((register, value, false)) => drop(low.insert(register, value)),
            Some((register, value, true)) => {
                if let Some(low) = low.get(&register) {
                    take(value << 16 | low & 0xFFFF);
                }
            }
            None => {}
        }
    }
    taken
}

/// The functions that executors poll, and the names of what was put into each.
fn tasks(image: &Image, sources: &Sources) -> BTreeMap<u32, BTreeSet<String>> {
    let mut tasks = BTreeMap::new();
    for function in image.functions_named(POLL) {
        let names = image
            .instructions
            .range(function.start..function.end)
            .flat_map(|(address, _)| sources.places(*address))
            .map(|place| place.function)
            .collect();
        tasks.insert(function.start, names);
    }
    tasks
}
