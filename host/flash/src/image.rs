//! A firmware image: the bytes that go to flash, and who it is. ELF as the linker leaves it, or a plain binary of the flash from its
//! start.

use gripline_protocol::message::{BOARDS, Hello, IMAGE_IDENTITY_AT, IMAGE_IDENTITY_BYTES, SchemaMismatch};
use object::read::elf::{ElfFile32, ProgramHeader as _};
use object::{Endianness, elf};

/// First address of the flash.
pub const FLASH: u32 = 0x0800_0000;
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

/// Why a file is no image that may be flashed.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ImageError {
    /// The ELF file is broken.
    #[error(
        "found an ELF file that cannot be read ({found}), expected one of `cargo xtask firmware`; build it again"
    )]
    Elf {
        /// What is wrong.
        found: String,
    },
    /// Nothing lies where the chip looks for its interrupt vectors.
    #[error(
        "found {found}, expected an image that begins at {FLASH:#010x}; build it with `cargo xtask firmware`"
    )]
    NoVectors {
        /// What is there.
        found: String,
    },
    /// There is no identity block.
    #[error(
        "found no identity at {:#010x}, expected one of Gripline's firmware; build it with `cargo xtask firmware`, or flash older \
         firmware with a probe",
        FLASH + IMAGE_IDENTITY_AT as u32
    )]
    NoIdentity,
    /// The file ends too early.
    #[error(
        "found {found} bytes, expected at least the {expected} that the image was linked with; copy the file again"
    )]
    CutOff {
        /// Bytes of the file's image.
        found: u32,
        /// Bytes of the linked image.
        expected: u32,
    },
    /// It lies where the settings are, or outside of the flash, or on itself.
    #[error("found bytes from {from:#010x} to {to:#010x}, expected none there: {why}")]
    Place {
        /// First address.
        from: u32,
        /// The address behind the last byte.
        to: u32,
        /// Why not.
        why: &'static str,
    },
    /// It is for another board.
    #[error(
        "found an image for {found}, expected one for {expected}; build it with `cargo xtask firmware --board {expected}`"
    )]
    Board {
        /// The image's board.
        found: String,
        /// The board that is to be flashed.
        expected: String,
    },
    /// It speaks another schema than this host.
    #[error("found an image of another schema: {0}")]
    Schema(SchemaMismatch),
}

impl Image {
    /// Reads an ELF file, or a binary that lies at the start of the flash.
    ///
    /// # Errors
    /// [`ImageError`] that says what is wrong with the file.
    pub fn read(file: &[u8]) -> Result<Self, ImageError> {
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
            return Err(ImageError::NoVectors { found });
        };
        let (identity, linked) = identity(head).ok_or(ImageError::NoIdentity)?;
        let found = parts.last().map_or(0, |part| part.end() - FLASH);
        if found < linked {
            return Err(ImageError::CutOff {
                found,
                expected: linked,
            });
        }
        Ok(Self { identity, parts })
    }

    /// Whether it is for this board, a place in [`BOARDS`], and speaks this host's schema.
    ///
    /// # Errors
    /// [`ImageError`] that names both sides.
    pub fn check(&self, board: u8) -> Result<(), ImageError> {
        if self.identity.board != board {
            return Err(ImageError::Board {
                found: board_name(self.identity.board),
                expected: board_name(board),
            });
        }
        self.identity.check().map_err(ImageError::Schema)
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

fn place(part: &Part, why: &'static str) -> ImageError {
    ImageError::Place {
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
fn of_elf(file: &[u8]) -> Result<Vec<Part>, ImageError> {
    let broken = |found: String| ImageError::Elf { found };
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
            return Err(ImageError::Place {
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
fn of_binary(file: &[u8]) -> Result<Vec<Part>, ImageError> {
    let settings = (SETTINGS.start - FLASH) as usize..(SETTINGS.end - FLASH) as usize;
    let (head, rest) = file.split_at(file.len().min(settings.start));
    let (filler, program) = rest.split_at(rest.len().min(settings.len()));
    if let Some(at) = filler.iter().position(|&byte| byte != 0 && byte != ERASED) {
        let from = SETTINGS.start + at as u32;
        return Err(ImageError::Place {
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
