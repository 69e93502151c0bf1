//! The static half: every walk over the linked image that a bound stands on.

use std::collections::{BTreeMap, BTreeSet};

use crate::Error;
use crate::bound::{Bound, Code, Loop, Stretch, Walk};
use crate::cycles::{ENTRY, EXIT, Memory};
use crate::image::{Function, Image};
use crate::tables::{EXCEPTED, Left, TAIL_TAXELS, WRITE_LINE};

/// The priority of the path's interrupt as the masks count it (`priority::PATH`).
const PATH_PRIORITY: u32 = 2 << 4;
/// The register of the USB core (RM0090, OTG_FS_DOEPCTL1) whose write asks for the next packet.
const NEXT_PACKET: u32 = 0x5000_0B20;

/// The path for each size of last packet.
#[derive(Debug)]
struct Tails<'a> {
    walks: Vec<Walk<'a>>,
    cycles: Vec<u64>,
}

impl<'a> Tails<'a> {
    fn of(code: Code<'a>, start: &Function, write: &Function) -> Self {
        let (walks, cycles) = (0..=TAIL_TAXELS)
            .map(|taxels| {
                let mut walk = Walk::new(code, Left::Tail).ending_with(write).with_tail(taxels);
                let cycles = walk.function(start).cycles + u64::from(ENTRY);
                (walk, cycles)
            })
            .unzip();
        Self { walks, cycles }
    }
}

/// All of them, and what they came to.
#[derive(Debug)]
pub struct Walks<'a> {
    /// What they went over.
    pub code: Code<'a>,
    /// The UART's interrupt.
    pub uart: Function,
    /// From the interrupt to the line.
    pub path: Walk<'a>,
    /// What blocks the path.
    pub blocked: Walk<'a>,
    whole: Walk<'a>,
    foreign: Walk<'a>,
    full: Walk<'a>,
    tails: [Tails<'a>; 2],
    excepted: Vec<Stretch>,
    /// Of the path, from its interrupt to the line, over USB and over the UART. Cycles.
    pub path_cycles: [u64; 2],
    /// Of those interrupts to their return.
    pub interrupts: [Bound; 2],
    /// Of the same while maps of the other link count. Cycles.
    pub foreign_cycles: [u64; 2],
    /// Of a full packet's interrupt, from when it asks for the next one. Cycles.
    pub taxels_cycles: u64,
    /// The stretches that block the path, the longest first.
    pub stretches: Vec<Stretch>,
}

impl<'a> Walks<'a> {
    /// Over this code.
    ///
    /// # Errors
    /// An image without the functions that the bound stands on.
    pub fn over(code: Code<'a>) -> Result<Self, Error> {
        let usb = function_of(code.image, "OTG_FS")?;
        let uart = function_of(code.image, "USART1")?;
        let write = function_of(code.image, WRITE_LINE)?;
        let links = [&usb, &uart];
        let mut path = Walk::new(code, Left::Tail).ending_with(&write);
        let mut whole = Walk::new(code, Left::Tail);
        let mut foreign = Walk::new(code, Left::Foreign);
        let mut full = Walk::new(code, Left::Taxels);
        let mut blocked = Walk::new(code, Left::Blocked);
        let is_excepted = |stretch: &Stretch| EXCEPTED.iter().any(|(part, _)| stretch.name.contains(part));
        let (excepted, stretches): (Vec<Stretch>, Vec<Stretch>) = blocked
            .blocking_stretches(PATH_PRIORITY)
            .into_iter()
            .partition(is_excepted);
        Ok(Self {
            path_cycles: links.map(|from| path.function(from).cycles + u64::from(ENTRY)),
            interrupts: links.map(|from| whole.function(from)),
            foreign_cycles: links.map(|from| foreign.function(from).cycles + u64::from(ENTRY + EXIT)),
            taxels_cycles: full.after_store(&usb, NEXT_PACKET)?,
            tails: links.map(|from| Tails::of(code, from, &write)),
            code,
            uart,
            path,
            blocked,
            whole,
            foreign,
            full,
            excepted,
            stretches,
        })
    }

    /// The longest stretch that blocks the path.
    ///
    /// # Errors
    /// An image without one.
    pub fn blocking(&self) -> Result<Stretch, Error> {
        self.stretches.first().cloned().ok_or_else(|| Error::Unexpected {
            expected: "a stretch that blocks the path".to_owned(),
            found: "none".to_owned(),
        })
    }

    /// Of the path, for each number of taxels in a map's last packet, over USB and over the UART. Cycles.
    #[must_use]
    pub fn tail_cycles(&self) -> [&[u64]; 2] {
        self.tails.each_ref().map(|tails| tails.cycles.as_slice())
    }

    /// The walks of the bounds.
    fn all(&self) -> [&Walk<'a>; 5] {
        [&self.path, &self.whole, &self.foreign, &self.full, &self.blocked]
    }

    /// Whatever stands against the bounds.
    #[must_use]
    pub fn findings(&self) -> Vec<String> {
        let findings = self.all().into_iter().flat_map(|walk| &walk.findings);
        findings.cloned().collect()
    }

    /// The memories that accesses were priced with, walk by walk.
    pub fn memories(&self) -> impl Iterator<Item = &BTreeMap<u32, Memory>> {
        self.all().into_iter().map(|walk| &walk.memories)
    }

    /// Instructions that access an address that is not known.
    #[must_use]
    pub fn unknown(&self) -> BTreeSet<u32> {
        let unknown = self.all().into_iter().flat_map(|walk| &walk.unknown);
        unknown.copied().collect()
    }

    /// The loops of last packets, each with the most rounds of any.
    #[must_use]
    pub fn tail_loops(&self) -> BTreeMap<u32, Loop> {
        let mut loops: BTreeMap<u32, Loop> = BTreeMap::new();
        let walks = self.tails.iter().flat_map(|tails| &tails.walks);
        for one in walks.flat_map(|walk| walk.loops.values()) {
            let known = loops.entry(one.header).or_insert_with(|| one.clone());
            known.rounds = known.rounds.max(one.rounds);
        }
        loops
    }

    /// What the walks left out, and why.
    #[must_use]
    pub fn left(&self) -> Vec<String> {
        let walks = [&self.path, &self.foreign, &self.blocked];
        let mut left: Vec<String> = walks.iter().flat_map(|walk| &walk.left).cloned().collect();
        left.extend(self.excepted.iter().filter_map(|stretch| {
            let (_, why) = EXCEPTED.iter().find(|(part, _)| stretch.name.contains(part))?;
            Some(format!("{}: {} cycles, {why}", stretch.name, stretch.cycles))
        }));
        left.sort();
        left.dedup();
        left
    }
}

/// The function whose name ends so.
///
/// # Errors
/// An image without it.
pub fn function_of(image: &Image, name: &str) -> Result<Function, Error> {
    let found = image
        .functions_named(name)
        .find(|function| function.name.ends_with(name) && !function.name.contains("Thunk"));
    found.cloned().ok_or_else(|| Error::Unexpected {
        expected: format!("the function {name}"),
        found: "none".to_owned(),
    })
}
