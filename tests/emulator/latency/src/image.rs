//! The linked image: its functions, its constants, and every instruction decoded.
//!
//! Limits: Thumb code with mapping symbols (`$t`, `$d`), as the linker leaves them; 32-bit little-endian ELF.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use capstone::arch::arm::{ArchExtraMode, ArchMode, ArmOperandType, ArmReg};
use capstone::prelude::*;
use capstone::{Insn, InsnDetail};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, SymbolKind};

use crate::Error;

const KEPT: [u32; 8] = [
    ArmReg::ARM_REG_R4,
    ArmReg::ARM_REG_R5,
    ArmReg::ARM_REG_R6,
    ArmReg::ARM_REG_R7,
    ArmReg::ARM_REG_R8,
    ArmReg::ARM_REG_R9,
    ArmReg::ARM_REG_R10,
    ArmReg::ARM_REG_R11,
];

/// Registers that the loops of this program look at.
const SP: &str = "sp";

/// Where an instruction may go next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// To the one behind it.
    Next,
    /// To the one behind it or to this address.
    Branch(u32),
    /// To this address.
    Jump(u32),
    /// To this address, and back behind it.
    Call(u32),
    /// To a function whose address is in a register, and back behind it.
    CallRegister,
    /// To an address in a register that is not the link register.
    JumpRegister,
    /// Along a table of offsets that follows it.
    Table,
    /// Back to the caller, or out of an exception.
    Return,
    /// Nowhere: it traps.
    Trap,
}

/// How an instruction changes what may interrupt the running code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Masking {
    /// Not.
    #[default]
    Keeps,
    /// Nothing may any more (`cpsid`).
    DisablesAll,
    /// What could before (`cpsie`, or PRIMASK written).
    EnablesAll,
    /// Only what has a higher priority than it says (BASEPRI_MAX written).
    Raises,
    /// What could before (BASEPRI written).
    Restores,
}

impl Masking {
    fn of(text: &str) -> Self {
        match text {
            _ if text.starts_with("cpsid") => Self::DisablesAll,
            _ if text.starts_with("cpsie") || text.starts_with("msr primask") => Self::EnablesAll,
            _ if text.starts_with("msr basepri_max") => Self::Raises,
            _ if text.starts_with("msr basepri,") => Self::Restores,
            _ => Self::Keeps,
        }
    }
}

/// What an instruction needs of the memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Data {
    /// Words, half-words or bytes that it moves.
    pub transfers: u32,
    /// The address it reads, when the instruction itself says it.
    pub literal: Option<u32>,
    /// Whether it goes by the stack pointer, so that it stays in SRAM.
    pub is_stack: bool,
}

/// A decoded instruction.
#[derive(Debug, Clone)]
pub struct Instruction {
    /// Where it lies.
    pub address: u32,
    /// Bytes: 2 or 4.
    pub size: u32,
    /// The assembler's name without condition and width.
    pub name: String,
    /// As a disassembler prints it.
    pub text: String,
    /// Where it may go.
    pub flow: Flow,
    /// Whether a condition (its own or that of an IT block) may skip it.
    pub is_conditional: bool,
    /// What it moves.
    pub data: Data,
    /// Bytes by which it lowers the stack pointer; negative when it raises it.
    pub stack: i32,
    /// A constant that it puts into a register: (register, value, whether it is the upper half).
    pub constant: Option<(u16, u32, bool)>,
    /// A constant that it adds to a register: (to, from, value).
    pub offset: Option<(u16, u16, u32)>,
    /// The register that its memory operand starts from, and what it adds to it.
    pub base: Option<(u16, u32)>,
    /// Registers that it changes.
    pub writes: Vec<u16>,
    /// What it does to the masks.
    pub masking: Masking,
    /// Its place among the image's instructions.
    pub number: usize,
    /// The place of its function among the image's functions, if it lies in one.
    pub function: Option<usize>,
}

impl Instruction {
    /// The address behind it.
    #[must_use]
    pub fn next(&self) -> u32 {
        self.address + self.size
    }
}

/// A function of the image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Function {
    /// First address.
    pub start: u32,
    /// The address behind its last byte.
    pub end: u32,
    /// Its name, demangled, without the hash.
    pub name: String,
}

/// The image.
#[derive(Debug, Default)]
pub struct Image {
    /// Every instruction by address.
    pub instructions: BTreeMap<u32, Instruction>,
    /// Every function by address.
    pub functions: BTreeMap<u32, Function>,
    /// Loaded bytes, by the address they have when the program runs.
    sections: Vec<(u32, Vec<u8>)>,
    /// Bytes of flash and of RAM that it takes.
    pub flash_bytes: u32,
    /// RAM laid out before the stack, in bytes.
    pub ram_bytes: u32,
    /// Registers that a function leaves as they were (AAPCS: r4 to r11, sp).
    pub kept_by_callees: BTreeSet<u16>,
    /// The register of a function's third argument (AAPCS: r2).
    pub third_argument: u16,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// A file that is no ELF file, or code that does not decode.
    pub fn read(elf: &[u8]) -> Result<Self, Error> {
        let file = object::File::parse(elf).map_err(|error| Error::Image(error.to_string()))?;
        let mut image = Self {
            kept_by_callees: KEPT.into_iter().map(|register| register as u16).collect(),
            third_argument: ArmReg::ARM_REG_R2 as u16,
            ..Self::default()
        };
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else {
                continue;
            };
            if sh_flags & u64::from(object::elf::SHF_ALLOC) == 0 || section.size() == 0 {
                continue;
            }
            let data = section.data().unwrap_or_default();
            let is_ram = !(0x0800_0000..0x1000_0000).contains(&section.address());
            let size = section.size() as u32;
            // What is in RAM with a content is copied there from flash.
            if is_ram {
                image.ram_bytes += size;
            }
            if !data.is_empty() {
                image.flash_bytes += size;
                image.sections.push((section.address() as u32, data.to_vec()));
            }
        }
        let mut marks = BTreeMap::new();
        for symbol in file.symbols() {
            let (Ok(name), address) = (symbol.name(), symbol.address() as u32) else {
                continue;
            };
            match name.get(..2) {
                Some("$t") => drop(marks.insert(address, true)),
                Some("$d") => drop(marks.insert(address, false)),
                _ if symbol.kind() == SymbolKind::Text && symbol.size() > 0 => {
                    let start = address & !1;
                    // The linker's way to a callee that a branch does not reach.
                    let name = match name.strip_prefix("__Thumbv7ABSLongThunk_") {
                        Some(callee) => format!("Thunk of {:#}", rustc_demangle::demangle(callee)),
                        None => format!("{:#}", rustc_demangle::demangle(name)),
                    };
                    let end = start + symbol.size() as u32;
                    image.functions.insert(start, Function { start, end, name });
                }
                _ => {}
            }
        }
        image.decode(&marks)?;
        image.number();
        Ok(image)
    }

    /// Code at this address, behind a vector table with these handlers; for tests.
    #[cfg(test)]
    pub(crate) fn of_code(handlers: &[u32], base: u32, code: &[u16]) -> Self {
        let table = [0].iter().chain(handlers).flat_map(|word| word.to_le_bytes());
        let mut image = Self {
            sections: vec![
                (0x0800_0000, table.collect()),
                (base, code.iter().flat_map(|half| half.to_le_bytes()).collect()),
            ],
            ..Self::default()
        };
        image.decode(&BTreeMap::from([(base, true)])).expect("Thumb code");
        image.number();
        image
    }

    /// Gives every instruction its place, and that of the function that [`Image::function_at`] finds.
    fn number(&mut self) {
        let functions: Vec<&Function> = self.functions.values().collect();
        for (number, one) in self.instructions.values_mut().enumerate() {
            let behind = functions.partition_point(|function| function.start <= one.address);
            one.number = number;
            one.function = behind
                .checked_sub(1)
                .filter(|&before| one.address < functions[before].end);
        }
    }

    fn decode(&mut self, marks: &BTreeMap<u32, bool>) -> Result<(), Error> {
        let decoder = Capstone::new()
            .arm()
            .mode(ArchMode::Thumb)
            .extra_mode([ArchExtraMode::MClass].into_iter())
            .detail(true)
            .build()
            .map_err(|error| Error::Image(error.to_string()))?;
        for (base, bytes) in &self.sections {
            let end = base + bytes.len() as u32;
            let inside: Vec<(u32, bool)> = marks
                .range(*base..end)
                .map(|(&at, &is_code)| (at, is_code))
                .collect();
            for (number, &(start, is_code)) in inside.iter().enumerate() {
                let stop = inside.get(number + 1).map_or(end, |next| next.0);
                if !is_code {
                    continue;
                }
                let (mut at, mut in_block) = (start, 0);
                while at + 2 <= stop {
                    let offset = (at - base) as usize;
                    let size = if bytes[offset + 1] >> 3 >= 0b11101 { 4 } else { 2 };
                    let Some(code) = bytes.get(offset..offset + size) else {
                        break;
                    };
                    if code == [0, 0] && at + 2 == stop {
                        break; // padding
                    }
                    let decoded = decoder
                        .disasm_count(code, at.into(), 1)
                        .map_err(|error| Error::Image(error.to_string()))?;
                    let Some(found) = decoded.iter().next() else {
                        // Padding between functions decodes to nothing and is never reached.
                        at += size as u32;
                        continue;
                    };
                    let detail = decoder
                        .insn_detail(found)
                        .map_err(|error| Error::Image(error.to_string()))?;
                    let name = decoder.insn_name(found.id()).unwrap_or_default();
                    let instruction = instruction(found, &detail, &name, size as u32, in_block > 0);
                    in_block = match instruction.name.as_str() {
                        "it" => {
                            let mask = u32::from(code[0] & 0xF);
                            4 - mask.trailing_zeros()
                        }
                        _ => u32::saturating_sub(in_block, 1),
                    };
                    self.instructions.insert(at, instruction);
                    at += size as u32;
                }
            }
        }
        Ok(())
    }

    /// Where a table of offsets leads: as many entries as lead into the code behind it; `None` where its bytes are not in the image.
    #[must_use]
    pub fn table(&self, one: &Instruction) -> Option<Vec<u32>> {
        let base = one.address + 4;
        let width = if one.name == "tbb" { 1 } else { 2 };
        let (mut targets, mut at, mut first) = (Vec::new(), base, u32::MAX);
        while at < first {
            let offset = match self.bytes(at, width as usize)? {
                [byte] => u32::from(*byte),
                [low, high] => u32::from(*low) | u32::from(*high) << 8,
                _ => return None,
            };
            let target = base + 2 * offset;
            if target <= at {
                break; // padding
            }
            first = first.min(target);
            targets.push(target);
            at += width;
        }
        Some(targets)
    }

    /// The instructions that are reached otherwise than from the one before them: where branches, calls and tables lead, what follows
    /// those, and the first ones of functions. Whoever knows when the core came to these knows of every instruction.
    #[must_use]
    pub fn entries(&self) -> Vec<u32> {
        let mut entries: BTreeSet<u32> = self.functions.keys().copied().collect();
        let mut behind = None;
        for one in self.instructions.values() {
            if behind != Some(one.address) {
                entries.insert(one.address);
            }
            behind = (one.flow == Flow::Next).then(|| one.next());
            match one.flow {
                Flow::Branch(target) | Flow::Jump(target) | Flow::Call(target) => {
                    entries.insert(target);
                }
                Flow::Table => entries.extend(self.table(one).into_iter().flatten()),
                _ => {}
            }
        }
        entries.retain(|address| self.instructions.contains_key(address));
        entries.into_iter().collect()
    }

    /// The function that `address` lies in.
    #[must_use]
    pub fn function_at(&self, address: u32) -> Option<&Function> {
        let (_, function) = self.functions.range(..=address).next_back()?;
        (address < function.end).then_some(function)
    }

    /// The first functions whose name contains `part`.
    pub fn functions_named<'a>(&'a self, part: &'a str) -> impl Iterator<Item = &'a Function> {
        self.functions
            .values()
            .filter(move |function| function.name.contains(part))
    }

    /// The word at `address` as it is loaded.
    #[must_use]
    pub fn word(&self, address: u32) -> Option<u32> {
        let bytes = self.bytes(address, 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    /// Every loaded word, with its address.
    pub fn words(&self) -> impl Iterator<Item = (u32, u32)> {
        self.sections.iter().flat_map(|(base, bytes)| {
            let words = bytes.as_chunks::<4>().0.iter();
            (*base..)
                .step_by(4)
                .zip(words.map(|word| u32::from_le_bytes(*word)))
        })
    }

    /// Loaded bytes.
    #[must_use]
    pub fn bytes(&self, address: u32, length: usize) -> Option<&[u8]> {
        self.sections.iter().find_map(|(base, bytes)| {
            let offset = address.checked_sub(*base)? as usize;
            bytes.get(offset..offset + length)
        })
    }
}

#[allow(
    clippy::too_many_lines,
    reason = "a table: one piece of an instruction after the other"
)]
fn instruction(found: &Insn, detail: &InsnDetail, name: &str, size: u32, in_block: bool) -> Instruction {
    let arch = detail.arch_detail();
    let arm = arch.arm().expect("an ARM decoder");
    let listed_operands: Vec<_> = arm.operands().collect();
    let operands: Vec<ArmOperandType> = listed_operands
        .iter()
        .map(|operand| operand.op_type.clone())
        .collect();
    let address = found.address() as u32;
    let immediate = operands.iter().find_map(|operand| match operand {
        ArmOperandType::Imm(value) => Some(*value as u32),
        _ => None,
    });
    let arguments = found.op_str().unwrap_or_default().to_owned();
    let text = format!("{} {arguments}", found.mnemonic().unwrap_or_default());
    let is_conditional = in_block
        || !matches!(
            arm.cc(),
            capstone::arch::arm::ArmCC::ARM_CC_AL | capstone::arch::arm::ArmCC::ARM_CC_INVALID
        );
    let name = name.trim_end_matches(".w").to_owned();
    let writes_pc = arguments.starts_with("pc,") || arguments.contains("pc}");
    let target = immediate.unwrap_or_default() & !1;
    let flow = match name.as_str() {
        "b" if is_conditional => Flow::Branch(target),
        "b" => Flow::Jump(target),
        "cbz" | "cbnz" => Flow::Branch(target),
        "bl" => Flow::Call(target),
        "blx" => Flow::CallRegister,
        "bx" if arguments == "lr" => Flow::Return,
        "bx" => Flow::JumpRegister,
        "tbb" | "tbh" => Flow::Table,
        "udf" | "trap" | "bkpt" => Flow::Trap,
        "pop" | "ldm" | "ldr" if writes_pc => Flow::Return,
        "mov" | "add" if writes_pc => Flow::JumpRegister,
        _ => Flow::Next,
    };
    let listed = operands
        .iter()
        .filter(|operand| matches!(operand, ArmOperandType::Reg(_)))
        .count() as u32;
    let transfers = match name.as_str() {
        "push" | "pop" | "vpush" | "vpop" => listed,
        "ldm" | "stm" | "ldmdb" | "stmdb" | "vldmia" | "vstmia" | "vldmdb" | "vstmdb" => listed - 1,
        "ldrd" | "strd" => 2,
        "tbb" | "tbh" => 1,
        other if other.starts_with("ldr") || other.starts_with("str") => 1,
        "vldr" | "vstr" => {
            if arguments.starts_with('d') {
                2
            } else {
                1
            }
        }
        "stc" | "ldc" => 16,
        _ => 0,
    };
    let double = if arguments.contains("{d") { 2 } else { 1 };
    let transfers = if name.starts_with('v') && transfers > 0 {
        transfers * double
    } else {
        transfers
    };
    let literal = operands.iter().find_map(|operand| match operand {
        ArmOperandType::Mem(memory) if arguments.contains("[pc") && name.starts_with("ldr") => {
            Some(((address + 4) & !3).wrapping_add_signed(memory.disp()))
        }
        _ => None,
    });
    let words = |count: u32| 4 * count as i32;
    let stack = match name.as_str() {
        "push" | "vpush" => words(transfers),
        "pop" | "vpop" => -words(transfers),
        "stmdb" if arguments.starts_with("sp!") => words(transfers),
        "ldm" if arguments.starts_with("sp!") => -words(transfers),
        "sub" | "subw" if arguments.starts_with("sp,") => immediate.unwrap_or_default() as i32,
        "add" | "addw" if arguments.starts_with("sp,") => -(immediate.unwrap_or_default() as i32),
        "str" | "strd" if arguments.contains("[sp, #-") && arguments.contains("]!") => arguments
            .rsplit_once("#-0x")
            .or_else(|| arguments.rsplit_once("#-"))
            .and_then(|(front, rest)| {
                let digits = rest.trim_end_matches("]!");
                let radix = if arguments.contains("#-0x") { 16 } else { 10 };
                let _ = front;
                i32::from_str_radix(digits, radix).ok()
            })
            .unwrap_or_default(),
        "ldr" | "ldrd" if arguments.contains("[sp], #") => {
            -arguments
                .rsplit_once('#')
                .map_or(0, |(_, digits)| match digits.strip_prefix("0x") {
                    Some(hex) => i32::from_str_radix(hex, 16).unwrap_or_default(),
                    None => digits.parse().unwrap_or_default(),
                })
        }
        _ => 0,
    };
    let register = operands.iter().find_map(|operand| match operand {
        ArmOperandType::Reg(register) => Some(register.0),
        _ => None,
    });
    let registers: Vec<u16> = operands
        .iter()
        .filter_map(|operand| match operand {
            ArmOperandType::Reg(register) => Some(register.0),
            _ => None,
        })
        .collect();
    // Of a memory operand, or the first of those that move several words.
    let base = operands
        .iter()
        .find_map(|operand| match operand {
            ArmOperandType::Mem(memory) => Some((memory.base().0, memory.disp() as u32)),
            _ => None,
        })
        .or_else(|| {
            let moves_several = name.starts_with("ldm") || name.starts_with("stm");
            registers
                .first()
                .filter(|_| moves_several)
                .map(|register| (*register, 0))
        });
    let mut writes: Vec<u16> = listed_operands
        .iter()
        .filter_map(|operand| match (&operand.op_type, operand.access) {
            (ArmOperandType::Reg(register), Some(access)) if !access.is_writable() => {
                let _ = register;
                None
            }
            (ArmOperandType::Reg(register), _) => Some(register.0),
            _ => None,
        })
        .collect();
    // Written back to, or a call, behind which no register is what it was.
    if arguments.contains('!') || arguments.contains("],") {
        writes.extend(base.map(|(register, _)| register));
    }
    let offset = match (name.as_str(), registers.as_slice(), immediate) {
        ("add" | "adds" | "addw", [to], Some(value)) => Some((*to, *to, value)),
        ("add" | "adds" | "addw", [to, from], Some(value)) => Some((*to, *from, value)),
        ("sub" | "subs" | "subw", [to], Some(value)) => Some((*to, *to, value.wrapping_neg())),
        ("sub" | "subs" | "subw", [to, from], Some(value)) => Some((*to, *from, value.wrapping_neg())),
        ("mov", [to, from], None) => Some((*to, *from, 0)),
        _ => None,
    };
    let constant = match (name.as_str(), register, immediate) {
        ("mov" | "movs" | "movw", Some(register), Some(value)) => Some((register, value, false)),
        ("mvn" | "mvns", Some(register), Some(value)) => Some((register, !value, false)),
        ("movt", Some(register), Some(value)) => Some((register, value, true)),
        _ => None,
    };
    let masking = Masking::of(&text);
    let is_stack = arguments.contains(SP) || text.starts_with("push") || text.starts_with("pop");
    Instruction {
        address,
        size,
        name,
        text,
        flow,
        is_conditional,
        data: Data {
            transfers,
            literal,
            is_stack,
        },
        stack,
        constant,
        offset,
        base,
        writes,
        masking,
        // Known once all are read.
        number: 0,
        function: None,
    }
}

/// A file's bytes.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|error| Error::Image(format!("{}: {error}", path.display())))
}
