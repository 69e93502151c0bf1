//! Whether the map-to-line path lies in SRAM as a whole, with what blocks it: the build of an image fails where a function that the
//! linker script hot.x should have moved is left in the flash, whose wait states would move the path's time.
//!
//! Follows the calls in the linked image's Thumb code. Limits: calls through registers, of which the path has none (`cargo xtask latency`
//! refuses them); a panic may lie anywhere.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

use crate::error::Error;

/// The functions that it begins with: the interrupts of USB and UART, and by a part of its name who blocks them.
const ROOTS: [&str; 3] = ["OTG_FS", "USART1", "7control9from_task"];
/// Parts of the names of functions that end in a reset.
const PANICS: [&str; 4] = ["panic", "_fail", "unwrap_failed", "expect_failed"];
/// What the linker puts before the name of a callee that a branch does not reach.
const THUNK: &str = "__Thumbv7ABSLongThunk_";
/// Where the flash lies.
const FLASH: std::ops::Range<u32> = 0x0800_0000..0x1000_0000;

/// Fails with the names of the functions in flash.
pub(crate) fn check(elf: &Path) -> Result<(), Error> {
    let bytes = std::fs::read(elf).map_err(|source| Error::file(elf, source))?;
    let product = |found: String, expected: &str| Error::Product {
        what: elf.display().to_string(),
        found,
        expected: expected.to_owned(),
    };
    let file = object::File::parse(&*bytes).map_err(|error| product(error.to_string(), "an ELF file"))?;
    let code = Code::of(&file);
    let (mut seen, mut in_flash) = (BTreeSet::new(), BTreeSet::new());
    let is_root =
        |name: &str| ROOTS[..2].contains(&name) || name.contains(ROOTS[2]) && !name.starts_with(THUNK);
    let mut work: Vec<u32> = code
        .functions
        .iter()
        .filter(|(_, (_, name))| is_root(name))
        .map(|(at, _)| *at)
        .collect();
    if work.len() < ROOTS.len() {
        return Err(product(
            format!("{} of {ROOTS:?}", work.len()),
            "the functions that the map-to-line path begins with",
        ));
    }
    while let Some(at) = work.pop() {
        let Some((_, name)) = code.functions.get(&at).filter(|_| seen.insert(at)) else {
            continue;
        };
        if PANICS.iter().any(|part| name.contains(part)) {
            continue;
        }
        if FLASH.contains(&at) {
            in_flash.insert(name.clone());
        }
        work.extend(code.callees(at));
    }
    if in_flash.is_empty() {
        return Ok(());
    }
    Err(product(
        format!("in flash: {in_flash:?}"),
        "every function of the map-to-line path and of what blocks it in SRAM: place it in firmware/mcu/hot.x",
    ))
}

/// The functions of an image and their code.
struct Code<'a> {
    /// End and name by first address.
    functions: BTreeMap<u32, (u32, String)>,
    sections: Vec<(u32, &'a [u8])>,
}

impl<'a> Code<'a> {
    fn of(file: &object::File<'a>) -> Self {
        let functions = file
            .symbols()
            .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
            .filter_map(|symbol| {
                let start = symbol.address() as u32 & !1;
                Some((
                    start,
                    (start + symbol.size() as u32, symbol.name().ok()?.to_owned()),
                ))
            })
            .collect();
        let sections = file
            .sections()
            .filter_map(|section| Some((section.address() as u32, section.data().ok()?)))
            .filter(|(address, _)| *address > 0)
            .collect();
        Self { functions, sections }
    }

    /// The half-word at an address.
    fn half(&self, at: u32) -> Option<u32> {
        self.sections.iter().find_map(|(start, data)| {
            let offset = at.checked_sub(*start)? as usize;
            let bytes = data.get(offset..offset + 2)?;
            Some(u32::from(bytes[0]) | u32::from(bytes[1]) << 8)
        })
    }

    /// Where calls and jumps of a function lead outside of it. Words of data between its code may look like calls, but lead to where no function
    /// begins.
    fn callees(&self, start: u32) -> Vec<u32> {
        let Some((end, name)) = self.functions.get(&start) else {
            return Vec::new();
        };
        if let Some(callee) = name.strip_prefix(THUNK) {
            let found = self.functions.iter().find(|(_, (_, other))| other == callee);
            return found.map(|(at, _)| *at).into_iter().collect();
        }
        (start..*end)
            .step_by(2)
            .filter_map(|at| branch(at, self.half(at)?, self.half(at + 2)?))
            .filter(|target| !(start..*end).contains(target) && self.functions.contains_key(target))
            .collect()
    }
}

/// The target of a BL or of a B with a wide offset (ARM DDI 0403, A7.7.12 and A7.7.18).
fn branch(at: u32, first: u32, second: u32) -> Option<u32> {
    if first >> 11 != 0b11110 || second & 0x9000 != 0x9000 {
        return None;
    }
    let sign = first >> 10 & 1;
    let bit = |place: u32| 1 ^ (second >> place & 1) ^ sign;
    let offset = sign << 24 | bit(13) << 23 | bit(11) << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1;
    let offset = (offset << 7).cast_signed() >> 7;
    Some((at + 4).wrapping_add_signed(offset))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calls_and_jumps_lead_where_a_disassembler_says() {
        // bl and b.w, forwards and backwards, as LLVM's assembler encodes them.
        assert_eq!(branch(0x2000_0476, 0xF002, 0xFEB3), Some(0x2000_31E0));
        assert_eq!(branch(0x2000_323A, 0xF7FD, 0xF9A3), Some(0x2000_0584));
        assert_eq!(branch(0x1000, 0xF000, 0xB800), Some(0x1004));
        // A conditional branch and an instruction of 16 bits are neither.
        assert_eq!(branch(0x1000, 0xF000, 0x8000), None);
        assert_eq!(branch(0x1000, 0xB580, 0xAF00), None);
    }
}
