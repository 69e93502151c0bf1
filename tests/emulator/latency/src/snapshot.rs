//! How many instructions a map takes, by its number of taxels in contact: what the committed snapshot holds.

use std::fmt::Write as _;
use std::path::Path;

use gripline_protocol::ForceMap;

use crate::Error;
use crate::image::{Image, read};
use crate::measure::{Bench, map_of};
use crate::tables::KERNEL;

/// What takes a map in, packet by packet: places, CRC, sums. The interrupt around it also serves what else the bus brings, and
/// what the map's end decides goes by the state of the contact: the static bound is their measure.
const INTAKE: &[&str] = &[
    "Program<K>::head",
    "Program<K>::taxels",
    "ActiveSet::places",
    "RunningCrc::update",
    "dsp::add_pairs",
    "dsp::Dsp",
];

/// Instructions of one map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Count {
    /// Taxels in contact.
    pub contacts: usize,
    /// For its sums.
    pub kernel: u64,
    /// For all that takes it in.
    pub intake: u64,
}

/// The board that counts.
#[derive(Debug)]
pub struct Counter<'a>(Bench<'a>);

impl<'a> Counter<'a> {
    /// Boots.
    ///
    /// # Errors
    /// The board's.
    pub fn new(image: &'a Image, elf: &[u8]) -> Result<Self, Error> {
        Ok(Self(Bench::new(image, elf)?))
    }

    /// Counts one map.
    ///
    /// # Errors
    /// The board's.
    pub fn count(&mut self, map: &ForceMap) -> Result<Count, Error> {
        drop(self.0.counted());
        self.0.map(map)?;
        let counted = self.0.counted();
        Ok(Count {
            contacts: map.active().count().into(),
            kernel: counted.of(KERNEL),
            intake: counted.of(INTAKE),
        })
    }
}

/// Counts a map for every number of contacts.
///
/// # Errors
/// A file that cannot be read, a board that does not run.
pub fn count(path: &Path) -> Result<Vec<Count>, Error> {
    let elf = read(path)?;
    let image = Image::read(&elf)?;
    let mut counter = Counter::new(&image, &elf)?;
    (0..=400)
        .map(|contacts| counter.count(&map_of(contacts, contacts as u32)))
        .collect()
}

/// As it is committed: a line for every number of contacts.
#[must_use]
pub fn text(counts: &[Count]) -> String {
    let mut text = String::from("contacts kernel intake\n");
    for count in counts {
        let _ = writeln!(text, "{} {} {}", count.contacts, count.kernel, count.intake);
    }
    text
}
