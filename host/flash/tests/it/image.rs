//! What is an image, and for whom.

use gripline_flash::error::FlashError;
use gripline_flash::image::{FLASH, Image, SETTINGS};
use gripline_protocol::message::{Hello, IMAGE_IDENTITY_AT, Revision};
use proptest::prelude::*;

/// Bytes of the program behind the settings.
pub(crate) const PROGRAM: usize = 9_001;
const VECTORS: usize = 0x1AC;

/// A binary of the flash: vectors, identity, filler, program. `fill` tells images apart.
pub(crate) fn binary(identity: Hello, fill: u8) -> Vec<u8> {
    let program = (SETTINGS.end - FLASH) as usize;
    let mut bytes = vec![0_u8; program + PROGRAM];
    bytes[..VECTORS].fill(fill);
    bytes[..4].copy_from_slice(&0x1000_4000_u32.to_le_bytes());
    bytes[4..8].copy_from_slice(&0x0800_C145_u32.to_le_bytes());
    for (at, byte) in bytes[program..].iter_mut().enumerate() {
        *byte = (at as u8).wrapping_mul(31) ^ fill;
    }
    let length = (bytes.len() as u32).to_le_bytes();
    let block = identity.to_image();
    bytes[IMAGE_IDENTITY_AT..][..block.len()].copy_from_slice(&block);
    bytes[IMAGE_IDENTITY_AT + block.len()..][..4].copy_from_slice(&length);
    bytes
}

pub(crate) fn identity(board: u8) -> Hello {
    Hello {
        revision: Some(Revision {
            commit: 0x1a2b_3c4d,
            dirty: false,
        }),
        ..Hello::of_this_build(board, 0)
    }
}

/// The same as an ELF file with a segment for each piece: (where it runs, where it is stored, bytes).
fn elf(pieces: &[(u32, u32, &[u8])]) -> Vec<u8> {
    let words = |values: &[u32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let halves = |values: &[u16]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    file.extend(halves(&[2, 40]));
    file.extend(words(&[1, FLASH + 9, 52, 0, 0x0500_0000]));
    file.extend(halves(&[52, 32, pieces.len() as u16, 40, 0, 0]));
    let mut offset = 52 + 32 * pieces.len() as u32;
    for (runs_at, stored_at, bytes) in pieces {
        let size = bytes.len() as u32;
        file.extend(words(&[1, offset, *runs_at, *stored_at, size, size, 5, 4]));
        offset += size;
    }
    for (_, _, bytes) in pieces {
        file.extend_from_slice(bytes);
    }
    file
}

#[test]
fn an_elf_file_and_a_binary_of_it_are_the_same_image() {
    let flat = binary(identity(1), 0x5A);
    let program = (SETTINGS.end - FLASH) as usize;
    let head = IMAGE_IDENTITY_AT + 32;
    // Data runs in RAM and is stored behind the code.
    let of_elf = Image::read(&elf(&[
        (0x1000_4000, SETTINGS.end + 4_096, &flat[program + 4_096..]),
        (FLASH, FLASH, &flat[..head]),
        (SETTINGS.end, SETTINGS.end, &flat[program..program + 4_096]),
        (0x1000_8000, SETTINGS.end + PROGRAM as u32, &[]),
    ]))
    .unwrap();
    let of_binary = Image::read(&flat).unwrap();
    assert_eq!(of_elf, of_binary);
    assert_eq!(of_elf.identity, identity(1));
    assert_eq!(of_elf.parts.len(), 2);
    assert_eq!(of_elf.length() as usize, head + PROGRAM.next_multiple_of(4));
    let erased = [&flat[..program], &flat[program..]].concat();
    let mut other_filler = erased;
    other_filler[head..program].fill(0xFF);
    assert_eq!(Image::read(&other_filler).unwrap(), of_binary);
}

#[test]
fn an_image_for_another_board_or_schema_is_refused_by_name() {
    let image = Image::read(&binary(identity(2), 1)).unwrap();
    image.check(2).unwrap();
    let text = image.check(1).unwrap_err().to_string();
    assert!(
        text.contains("for stm32f427vi") && text.contains("--board stm32f405rg"),
        "{text}"
    );
    let other = Hello {
        schema_version: 99,
        ..identity(1)
    };
    let text = Image::read(&binary(other, 1))
        .unwrap()
        .check(1)
        .unwrap_err()
        .to_string();
    assert!(text.contains("schema 99"), "{text}");
    let forged = Hello {
        schema_hash: 7,
        ..identity(1)
    };
    let refused = Image::read(&binary(forged, 1)).unwrap().check(1);
    assert!(matches!(refused, Err(FlashError::Schema(_))), "{refused:?}");
}

#[test]
fn what_is_no_image_of_ours_is_refused_by_name() {
    let good = binary(identity(1), 0x5A);
    let program = (SETTINGS.end - FLASH) as usize;
    let mut anonymous = good.clone();
    anonymous[IMAGE_IDENTITY_AT] ^= 1;
    let mut on_settings = good.clone();
    on_settings[0x4123] = 7;
    let head = &good[..IMAGE_IDENTITY_AT + 32];
    for (file, words) in [
        (vec![], "nothing at all"),
        (vec![0; 4], "found nothing at all"),
        (b"\x7fELF".to_vec(), "ELF file that cannot be read"),
        (anonymous, "no identity"),
        (on_settings, "from 0x08004123"),
        (good[..good.len() - 5].to_vec(), "copy the file again"),
        (good[..program].to_vec(), "copy the file again"),
        (good[..0x210].to_vec(), "no identity"),
        (elf(&[(SETTINGS.end, SETTINGS.end, head)]), "at 0x0800c000"),
        (
            elf(&[(FLASH, FLASH, head), (FLASH + 4, FLASH + 4, head)]),
            "two parts",
        ),
        (
            elf(&[(FLASH, FLASH, head), (0x0800_4000, 0x0800_4000, head)]),
            "stored settings",
        ),
        (
            elf(&[(0x2000_0000, 0x0700_0000, head)]),
            "the flash lies elsewhere",
        ),
        (
            elf(&[(FLASH, FLASH, head), (0, 0xFFFF_FFFE, head)]),
            "the flash lies elsewhere",
        ),
    ] {
        let text = Image::read(&file).unwrap_err().to_string();
        assert!(text.contains(words), "{words}: {text}");
    }
}

proptest! {
    /// Whatever a file holds, it is read or refused.
    #[test]
    fn any_bytes_are_read_or_refused(mut bytes in proptest::collection::vec(any::<u8>(), 0..2_000), is_elf: bool) {
        if is_elf {
            let start = elf(&[(FLASH, FLASH, &[1, 2, 3])]);
            let length = bytes.len().min(20);
            bytes.splice(..length, start[..52].iter().copied());
        }
        let _ = Image::read(&bytes);
    }
}

/// The image that ships; `cargo xtask test` names it.
#[test]
#[ignore = "needs the image: cargo xtask test"]
fn the_linked_image_says_whom_it_is_for() {
    let path = std::env::var_os("GRIPLINE_IMAGE").expect("GRIPLINE_IMAGE names the image");
    let image = Image::read(&std::fs::read(path).unwrap()).unwrap();
    image.check(2).unwrap();
    println!(
        "{}, {} bytes in {} parts",
        image.identity,
        image.length(),
        image.parts.len()
    );
    assert!(
        image
            .parts
            .iter()
            .all(|part| part.end() <= SETTINGS.start || part.address >= SETTINGS.end)
    );
}
