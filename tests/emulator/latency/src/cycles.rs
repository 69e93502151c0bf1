//! What an instruction costs at most, in core cycles, and what the memories add.
//!
//! Source of the core's figures: Cortex-M4 technical reference manual (ARM DDI 0439, table 3-1), each at the upper end of
//! its range; the pipeline refills in three cycles; loads and stores are never overlapped. Memories as on the STM32F4 at
//! 168 MHz (RM0090 table 10): five wait states of the flash, paid for every line of 128 bits and after every taken
//! branch, no cache, no prefetch (the ART accelerator is worth nothing); SRAM without wait states, but code in it comes
//! over the system bus: a cycle more for every word fetched and for every word moved while it runs.

use crate::image::{Flow, Instruction};

/// Cycles to fill the pipeline after a taken branch, the most of the manual's "1 to 3".
pub const REFILL: u32 = 3;
/// Cycles that the flash adds to a fetch or a load: five wait states and the cycle of the line itself.
pub const FLASH: u32 = 6;
/// Cycles that fetching a word over the system bus adds.
pub const SYSTEM_BUS: u32 = 1;
/// Cycles that an access to a peripheral on the AHB adds (USB core: FIFO and registers).
pub const AHB: u32 = 4;
/// Cycles that an access to the core's own peripherals adds.
pub const CORE_PERIPHERAL: u32 = 3;
/// Cycles that an access over the 84 MHz bus adds: two of its clocks, one to fall into step, two of the bridge.
pub const APB2: u32 = 8;
/// Cycles that an access over the 42 MHz bus adds: the same with its slower clock.
pub const APB1: u32 = 16;
/// Cycles to enter an exception: 12 with memory that does not wait, 17 for the floating-point registers, and the vector
/// out of the flash.
pub const ENTRY: u32 = 12 + 17 + FLASH;
/// Cycles to leave one: 10, and 17 for the floating-point registers.
pub const EXIT: u32 = 10 + 17;
/// Cycles that a barrier waits at most for a write under way to the slowest bus.
const BARRIER: u32 = 4 + APB1;

/// Which memory an address belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Memory {
    /// Core-coupled memory, on a bus of its own.
    Coupled,
    /// SRAM, on the system bus.
    Sram,
    /// The core's own peripherals.
    Core,
    /// The USB core and the ports.
    Ahb,
    /// Flash, as data.
    Flash,
    /// The 84 MHz bus.
    Apb2,
    /// The 42 MHz bus.
    Apb1,
}

impl Memory {
    /// The one that takes longest.
    pub const SLOWEST: Self = Self::Apb1;

    /// The memory at an address.
    #[must_use]
    pub fn of(address: u32) -> Self {
        match address {
            0x1000_0000..0x1001_0000 => Self::Coupled,
            0x2000_0000..0x4000_0000 => Self::Sram,
            0x4000_0000..0x4001_0000 => Self::Apb1,
            0x4001_0000..0x4002_0000 => Self::Apb2,
            0x4002_0000..0xE000_0000 => Self::Ahb,
            0xE000_0000.. => Self::Core,
            _ => Self::Flash,
        }
    }

    /// Cycles that it adds to every access.
    #[must_use]
    pub fn wait(self) -> u32 {
        match self {
            Self::Coupled | Self::Sram => 0,
            Self::Core => CORE_PERIPHERAL,
            Self::Ahb => AHB,
            Self::Flash => FLASH,
            Self::Apb2 => APB2,
            Self::Apb1 => APB1,
        }
    }
}

/// Cycles of the core alone, when every memory answers at once; a branch that is taken takes [`REFILL`] more.
#[must_use]
pub fn core(instruction: &Instruction) -> u32 {
    let moved = instruction.data.transfers;
    match instruction.name.as_str() {
        "udiv" | "sdiv" => 12,
        "mla" | "mls" | "cps" | "cpsid" | "cpsie" | "mrs" | "msr" => 2,
        "dmb" | "dsb" | "isb" => BARRIER,
        "vdiv" | "vsqrt" => 15,
        "vmla" | "vmls" | "vfma" | "vfms" | "vnmla" | "vnmls" | "vfnma" | "vfnms" => 4,
        name if name.starts_with('v') && moved == 0 => 2,
        _ => 1 + moved,
    }
}

/// What fetching costs: knows which line or word was fetched last.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fetch {
    last: Option<u32>,
}

impl Fetch {
    /// A branch was taken: nothing that was fetched counts any more.
    pub fn lose(&mut self) {
        self.last = None;
    }

    /// Cycles to fetch an instruction.
    pub fn cost(&mut self, instruction: &Instruction) -> u32 {
        let is_flash = Memory::of(instruction.address) == Memory::Flash;
        let unit = if is_flash { 16 } else { 4 };
        let (first, last) = (instruction.address / unit, (instruction.next() - 1) / unit);
        let fetched = match self.last {
            None => last - first + 1,
            // In SRAM a word comes every cycle, and no instruction needs more than one a cycle.
            Some(_) if !is_flash => 0,
            Some(seen) => (first..=last).filter(|unit| *unit != seen).count() as u32,
        };
        self.last = Some(last);
        fetched * if is_flash { FLASH } else { SYSTEM_BUS }
    }
}

/// What moving data costs beyond the core's own cycles; `memory` is where it goes.
#[must_use]
pub fn data(instruction: &Instruction, memory: Memory) -> u32 {
    let moved = instruction.data.transfers;
    let table = if matches!(instruction.flow, Flow::Table) {
        Memory::of(instruction.address).wait()
    } else {
        0
    };
    let is_shared = !matches!(memory, Memory::Coupled | Memory::Flash);
    let contention = if is_shared && Memory::of(instruction.address) == Memory::Sram {
        moved * SYSTEM_BUS
    } else {
        0
    };
    moved * memory.wait() + contention + table
}
