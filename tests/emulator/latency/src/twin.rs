//! The f32 twin: a plain detector in floating point on the same chip, to compare with.

use std::path::Path;

use gripline_emulator::{Board, Event};

use crate::Error;
use crate::image::{Image, read};

/// The function that does a dense map, and the one that the program ends in.
const FUNCTIONS: [&str; 2] = ["dense_map", "done"];
/// Longer than the twin needs, nanoseconds.
const TIME_NS: u64 = 20_000_000;

/// Instructions from the first of the map's function to the end of the program.
///
/// # Errors
/// A file that cannot be read, a program that does not end.
pub fn instructions(path: &Path) -> Result<u64, Error> {
    let elf = read(path)?;
    let image = Image::read(&elf)?;
    let starts: Vec<u32> = FUNCTIONS
        .iter()
        .filter_map(|name| image.functions.values().find(|one| one.name == *name))
        .map(|one| one.start)
        .collect();
    let missing = |found: &str| Error::Unexpected {
        expected: format!("{FUNCTIONS:?} of the f32 twin"),
        found: found.to_owned(),
    };
    let [start, end] = starts[..] else {
        return Err(missing("not both in the image"));
    };
    let addresses: Vec<u32> = image.instructions.keys().copied().collect();
    let mut board = Board::boot_traced(&elf, &addresses)?;
    board.run_for(TIME_NS)?;
    let (mut count, mut is_counting, mut is_done) = (0, false, false);
    for event in board.take_trace() {
        let Event::Instruction(address) = event else {
            continue;
        };
        is_counting |= address == start;
        is_done |= address == end;
        count += u64::from(is_counting && !is_done);
    }
    if is_done {
        Ok(count)
    } else {
        Err(missing("no end"))
    }
}
