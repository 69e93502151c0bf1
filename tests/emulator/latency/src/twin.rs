//! The f32 twin: a plain detector in floating point on the same chip, to compare with.

use std::path::Path;

use gripline_emulator::{Board, EventKind};

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
    let mut board = Board::boot_traced(&elf, &starts)?;
    board.run_for(TIME_NS)?;
    let trace = board.take_trace();
    let first = |address| {
        let arrival = trace
            .iter()
            .find(|event| event.kind == EventKind::Arrival(address));
        arrival.map(|event| event.retired)
    };
    match (first(start), first(end)) {
        (Some(from), Some(to)) => Ok(to - from),
        _ => Err(missing("no end")),
    }
}
