//! Builds the image that is flashed and measures what it takes of the chip, in bytes.
//!
//! Flash is what the programmer writes (vector table, code, constants, initial values); RAM is what is laid out beside the
//! stack (data, bss, and what survives a reset).

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use object::{Object, ObjectSection};

use crate::error::{Error, value_of};
use crate::{hot, process, toolchain};

/// The most that an image may take of the flash, in bytes (DESIGN.md, "Numbers to hold").
const FLASH_MAX: u64 = 128 * 1024;
/// The most that an image may lay out in RAM, stack not counted, in bytes (DESIGN.md, "Numbers to hold").
const RAM_MAX: u64 = 64 * 1024;
/// The memory of the stack, in bytes (memory.x).
const STACK: u64 = 16 * 1024;

/// A supported board: one chip, one feature of `gripline-mcu`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Board {
    Stm32f405rg,
    Stm32f427vi,
}

impl Board {
    pub(crate) const ALL: [Self; 2] = [Self::Stm32f405rg, Self::Stm32f427vi];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Stm32f405rg => "stm32f405rg",
            Self::Stm32f427vi => "stm32f427vi",
        }
    }

    /// Its chip, as probe-rs names it.
    pub(crate) fn chip(self) -> &'static str {
        match self {
            Self::Stm32f405rg => "STM32F405RGTx",
            Self::Stm32f427vi => "STM32F427VITx",
        }
    }

    pub(crate) fn named(name: &str) -> Result<Self, Error> {
        let board = Self::ALL.into_iter().find(|board| board.name() == name);
        board.ok_or_else(|| Error::usage("--board", name, "stm32f405rg or stm32f427vi"))
    }
}

/// What an image takes of its chip, in bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Size {
    pub(crate) flash: u64,
    pub(crate) ram: u64,
}

impl Size {
    fn of(elf: &Path) -> Result<Self, Error> {
        let bytes = fs::read(elf).map_err(|source| Error::file(elf, source))?;
        let file = object::File::parse(&*bytes).map_err(|error| Error::Product {
            what: elf.display().to_string(),
            found: error.to_string(),
            expected: "an ELF file".to_owned(),
        })?;
        let mut size = Self::default();
        for section in file.sections() {
            let name = section.name().unwrap_or_default();
            let bytes = section.size();
            match name {
                ".vector_table" | ".identity" | ".text" | ".rodata" | ".gnu.sgstubs" => size.flash += bytes,
                ".data" | ".hot" | ".tables" => {
                    size.flash += bytes;
                    size.ram += bytes;
                }
                ".bss" | ".uninit" => size.ram += bytes,
                _ => {}
            }
        }
        Ok(size)
    }

    /// Whether the image keeps to what the design allows.
    pub(crate) fn check(self, board: Board) -> Result<(), Error> {
        if self.flash == 0 || self.flash > FLASH_MAX || self.ram > RAM_MAX {
            return Err(Error::Product {
                what: format!("size of the {} image", board.name()),
                found: self.to_string(),
                expected: format!("flash at most {FLASH_MAX}, ram at most {RAM_MAX}"),
            });
        }
        Ok(())
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "flash {} ram {}", self.flash, self.ram)
    }
}

/// `cargo xtask firmware`.
pub(crate) fn command(arguments: &[String]) -> Result<(), Error> {
    let mut board = Board::Stm32f405rg;
    let mut out = None;
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--board" => board = Board::named(value_of("--board", &mut rest)?)?,
            "--out" => out = Some(PathBuf::from(value_of("--out", &mut rest)?)),
            unknown => return Err(Error::usage("argument", unknown, "--board BOARD or --out FILE")),
        }
    }
    let (elf, size) = build(board)?;
    let elf = match out {
        None => elf,
        Some(out) => {
            process::install(&elf, &out)?;
            out
        }
    };
    println!("image {}", elf.display());
    println!("{size}");
    println!("stack {STACK}");
    Ok(())
}

/// The program that is flashed; a binary of the package of the same name.
const IMAGE: &str = "gripline-mcu";
/// The detector in floating point, to compare with; a binary of that package too, and the feature that lets it build.
const TWIN: &str = "f32-twin";

/// Builds the f32 twin for one board's chip.
pub(crate) fn build_twin(board: Board) -> Result<PathBuf, Error> {
    process::run(cargo("rustc", TWIN, board)?.args(["--", "-C", "opt-level=3"]))?;
    let kept = process::products().join("f32-twin.elf");
    process::install(&built(TWIN), &kept)?;
    Ok(kept)
}

fn built(program: &str) -> PathBuf {
    process::build_dir()
        .join(toolchain::MCU.triple)
        .join("firmware")
        .join(program)
}

/// Builds one board's image, keeps it with the other products, checks where the map-to-line path lies, and measures it.
pub(crate) fn build(board: Board) -> Result<(PathBuf, Size), Error> {
    process::run(&mut cargo("build", IMAGE, board)?)?;
    let kept = kept(board);
    process::install(&built(IMAGE), &kept)?;
    hot::check(&kept)?;
    let size = Size::of(&kept)?;
    Ok((kept, size))
}

/// The image that [`build`] kept.
pub(crate) fn product(board: Board) -> Result<PathBuf, Error> {
    process::product(kept(board), "the image")
}

/// Forgets the image that an earlier run kept.
pub(crate) fn discard(board: Board) {
    let _ = fs::remove_file(kept(board));
}

fn kept(board: Board) -> PathBuf {
    process::products().join(format!("firmware-{}.elf", board.name()))
}

/// The binaries' lints, which the workspace's do not reach.
pub(crate) fn lint(board: Board) -> Result<(), Error> {
    for program in [IMAGE, TWIN] {
        process::run(cargo("clippy", program, board)?.args(["--", "-D", "warnings"]))?;
    }
    Ok(())
}

/// A cargo command on one of a board's binaries, with all that it needs to find the core library.
fn cargo(command: &str, program: &str, board: Board) -> Result<Command, Error> {
    let libraries = toolchain::ensure(&toolchain::MCU, false)?;
    let features = match program {
        TWIN => format!("{},{TWIN}", board.name()),
        _ => board.name().to_owned(),
    };
    let mut cargo = process::cargo();
    cargo
        .args([
            command,
            "--package",
            IMAGE,
            "--bin",
            program,
            "--profile",
            "firmware",
        ])
        .args(["--target", toolchain::MCU.triple, "--features", &features])
        .args(libraries.cargo_arguments())
        // These would replace the linker flags of .cargo/config.toml.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS");
    Ok(cargo)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_at_the_bound_passes_and_one_byte_more_does_not() {
        let at = Size {
            flash: FLASH_MAX,
            ram: RAM_MAX,
        };
        assert!(at.check(Board::Stm32f405rg).is_ok());
        assert!(
            Size {
                flash: FLASH_MAX + 1,
                ..at
            }
            .check(Board::Stm32f405rg)
            .is_err()
        );
        assert!(
            Size {
                ram: RAM_MAX + 1,
                ..at
            }
            .check(Board::Stm32f405rg)
            .is_err()
        );
        assert!(
            Size::default().check(Board::Stm32f405rg).is_err(),
            "an empty image is no image"
        );
    }

    #[test]
    fn a_board_is_found_by_its_name_and_no_other() {
        for board in Board::ALL {
            assert_eq!(Board::named(board.name()).ok(), Some(board));
        }
        assert!(Board::named("stm32f4").is_err());
    }
}
