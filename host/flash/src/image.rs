//! A firmware image: the bytes that go to flash, and who it is. ELF as the linker leaves it, or a plain binary of the flash from its
//! start.

use gripline_protocol::message::{BOARDS, Hello, IMAGE_IDENTITY_AT, IMAGE_IDENTITY_BYTES};
use object::read::elf::{ElfFile32, ProgramHeader as _};
use object::{Endianness, elf};

use crate::error::FlashError;
pub use crate::layout::FLASH;

/// Where the firmware keeps its settings: sectors 1 and 2 of 16 KiB (memory.x). No update touches them.
pub const SETTINGS: std::ops::Range<u32> = 0x0800_4000..0x0800_C000;
/// Initial stack pointer and reset vector: without them no chip starts the image.
pub const ENTRY_BYTES: usize = 8;
/// Vectors and identity.
const HEAD_BYTES: usize = IMAGE_IDENTITY_AT + IMAGE_IDENTITY_BYTES + WORD;
/// An erased byte.
pub const ERASED: u8 = 0xFF;
/// Words of 32 bits are what the flash takes.
const WORD: usize = 4;

/// Bytes that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Address of the first.
    pub address: u32,
    /// A multiple of four.
    pub bytes: Vec<u8>,
}

impl Part {
    /// The address behind the last byte.
    #[must_use]
    pub fn end(&self) -> u32 {
        self.address + self.bytes.len() as u32
    }
}

/// An image that may be flashed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Board, schema and commit that it was built for and from.
    pub identity: Hello,
    /// What goes to flash, in the order of its addresses; the first part begins with the interrupt vectors.
    pub parts: Vec<Part>,
}

impl Image {
    /// Reads an ELF file, or a binary that lies at the start of the flash.
    ///
    /// # Errors
    /// [`FlashError`] that says what is wrong with the file.
    pub fn read(file: &[u8]) -> Result<Self, FlashError> {
        let mut parts = if file.starts_with(&elf::ELFMAG) {
            of_elf(file)?
        } else {
            of_binary(file)?
        };
        parts.sort_by_key(|part| part.address);
        for part in &mut parts {
            let length = part.bytes.len().next_multiple_of(WORD);
            part.bytes.resize(length, ERASED);
        }
        for pair in parts.windows(2) {
            if pair[0].end() > pair[1].address {
                return Err(place(&pair[1], "two parts of the image lie there"));
            }
        }
        for part in &parts {
            if part.address < SETTINGS.end && part.end() > SETTINGS.start {
                return Err(place(part, "the stored settings lie there"));
            }
            if part.address % WORD as u32 != 0 {
                return Err(place(part, "the flash takes whole words"));
            }
        }
        let parts = merged(parts);
        let head = parts
            .first()
            .filter(|part| part.address == FLASH && part.bytes.len() >= ENTRY_BYTES);
        let Some(head) = head else {
            let found = parts.first().map_or("nothing at all".to_owned(), |part| {
                format!("{} bytes at {:#010x}", part.bytes.len(), part.address)
            });
            return Err(FlashError::NoVectors { found });
        };
        let (identity, linked) = identity(head).ok_or(FlashError::NoIdentity)?;
        let found = parts.last().map_or(0, |part| part.end() - FLASH);
        if found < linked {
            return Err(FlashError::CutOff {
                found,
                expected: linked,
            });
        }
        Ok(Self { identity, parts })
    }

    /// Whether it is for this board, a place in [`BOARDS`], and speaks this host's schema.
    ///
    /// # Errors
    /// [`FlashError`] that names both sides.
    pub fn check(&self, board: u8) -> Result<(), FlashError> {
        if self.identity.board != board {
            return Err(FlashError::Board {
                found: board_name(self.identity.board),
                expected: board_name(board),
            });
        }
        self.identity.check().map_err(FlashError::Schema)
    }

    /// Bytes that go to flash.
    #[must_use]
    pub fn length(&self) -> u32 {
        self.parts.iter().map(|part| part.bytes.len() as u32).sum()
    }
}

/// The name of a board by its number.
#[must_use]
pub fn board_name(board: u8) -> String {
    match BOARDS.get(usize::from(board)) {
        Some(name) => (*name).to_owned(),
        None => format!("board {board}"),
    }
}

fn place(part: &Part, why: &'static str) -> FlashError {
    FlashError::Place {
        from: part.address,
        to: part.end(),
        why,
    }
}

/// The identity block and the length that the linker put behind it.
fn identity(head: &Part) -> Option<(Hello, u32)> {
    let block = head.bytes.get(IMAGE_IDENTITY_AT..)?;
    let identity = Hello::from_image(block.get(..IMAGE_IDENTITY_BYTES)?)?;
    let length = block.get(IMAGE_IDENTITY_BYTES..)?.first_chunk()?;
    Some((identity, u32::from_le_bytes(*length)))
}

/// What an ELF file loads, by the addresses that it is stored at.
fn of_elf(file: &[u8]) -> Result<Vec<Part>, FlashError> {
    let broken = |found: String| FlashError::Elf { found };
    let elf = ElfFile32::<Endianness>::parse(file).map_err(|error| broken(error.to_string()))?;
    let endian = elf.endian();
    let mut parts = Vec::new();
    for header in elf.elf_program_headers() {
        if header.p_type(endian) != elf::PT_LOAD {
            continue;
        }
        let data = header.data(endian, file);
        let bytes = data.map_err(|()| broken("a segment ends behind the file".to_owned()))?;
        let address = header.p_paddr(endian);
        if bytes.is_empty() {
            continue;
        }
        let part = Part {
            address,
            bytes: bytes.to_vec(),
        };
        if address < FLASH || address.checked_add(bytes.len() as u32 + WORD as u32).is_none() {
            return Err(FlashError::Place {
                from: address,
                to: address.saturating_add(bytes.len() as u32),
                why: "the flash lies elsewhere",
            });
        }
        parts.push(part);
    }
    Ok(parts)
}

/// A binary of the flash: the vectors' sector, then the program; what fills the settings' sectors is no content.
fn of_binary(file: &[u8]) -> Result<Vec<Part>, FlashError> {
    let settings = (SETTINGS.start - FLASH) as usize..(SETTINGS.end - FLASH) as usize;
    let (head, rest) = file.split_at(file.len().min(settings.start));
    let (filler, program) = rest.split_at(rest.len().min(settings.len()));
    if let Some(at) = filler.iter().position(|&byte| byte != 0 && byte != ERASED) {
        let from = SETTINGS.start + at as u32;
        return Err(FlashError::Place {
            from,
            to: from + 1,
            why: "the stored settings lie there",
        });
    }
    let part = |address, bytes: &[u8]| Part {
        address,
        bytes: bytes.to_vec(),
    };
    // Nor is a filler behind vectors and identity.
    let content = head.iter().rposition(|&byte| byte != 0 && byte != ERASED);
    let length = content.map_or(0, |last| (last + 1).max(HEAD_BYTES));
    let head = &head[..head.len().min(length)];
    let parts = [part(FLASH, head), part(SETTINGS.end, program)];
    Ok(parts.into_iter().filter(|part| !part.bytes.is_empty()).collect())
}

/// Parts that touch become one.
fn merged(parts: Vec<Part>) -> Vec<Part> {
    let mut merged: Vec<Part> = Vec::new();
    for part in parts {
        match merged.last_mut() {
            Some(last) if last.end() == part.address => last.bytes.extend(part.bytes),
            _ => merged.push(part),
        }
    }
    merged
}
