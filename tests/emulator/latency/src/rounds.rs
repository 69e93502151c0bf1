//! How often loops run at most, as they say themselves: `gripline_protocol::rounds::at_most` leaves its number in the image's debug information, with
//! the instructions of the loop that it was put into.

use std::ops::Range;

use addr2line::gimli::{self, AttributeValue, Dwarf, EndianSlice, LittleEndian, UnitOffset};
use object::{Object as _, ObjectSection as _};

use crate::Error;

/// The function that is put into every such loop, as the debug information names it: its first parameter is the number.
const MARK: &str = "next_of_at_most<";

type Slice<'a> = EndianSlice<'a, LittleEndian>;

/// Instructions of loops, each with the number.
#[derive(Debug)]
pub struct Marks(Vec<(Range<u32>, u32)>);

impl Marks {
    /// Of an ELF file.
    ///
    /// # Errors
    /// A file without debug information.
    pub fn read(elf: &[u8]) -> Result<Self, Error> {
        let file = object::File::parse(elf).map_err(|error| Error::Image(error.to_string()))?;
        let section = |id: gimli::SectionId| -> Result<Slice<'_>, gimli::Error> {
            let data = file
                .section_by_name(id.name())
                .and_then(|section| section.data().ok());
            Ok(EndianSlice::new(data.unwrap_or_default(), LittleEndian))
        };
        let dwarf = Dwarf::load(section).map_err(dwarf_error)?;
        let mut marks = Vec::new();
        collect(&dwarf, &mut marks).map_err(dwarf_error)?;
        Ok(Self(marks))
    }

    /// The number of the loop that an instruction belongs to. Of two loops the larger one counts.
    #[must_use]
    pub fn at(&self, address: u32) -> Option<u32> {
        let found = self.0.iter().filter(|(range, _)| range.contains(&address));
        found.map(|(_, most)| *most).max()
    }
}

fn dwarf_error(error: gimli::Error) -> Error {
    Error::Image(format!("debug information: {error}"))
}

fn collect(dwarf: &Dwarf<Slice<'_>>, marks: &mut Vec<(Range<u32>, u32)>) -> Result<(), gimli::Error> {
    let mut headers = dwarf.units();
    while let Some(header) = headers.next()? {
        let unit = dwarf.unit(header)?;
        let mut entries = unit.entries();
        while let Some(entry) = entries.next_dfs()? {
            if entry.tag() != gimli::DW_TAG_inlined_subroutine {
                continue;
            }
            let Some(most) = most(dwarf, &unit, entry.attr_value(gimli::DW_AT_abstract_origin))? else {
                continue;
            };
            let mut ranges = dwarf.die_ranges(&unit, entry)?;
            while let Some(range) = ranges.next()? {
                marks.push((range.begin as u32..range.end as u32, most));
            }
        }
    }
    Ok(())
}

/// The number in the name of what was put in, if that is the mark.
fn most(
    dwarf: &Dwarf<Slice<'_>>,
    unit: &gimli::Unit<Slice<'_>>,
    origin: Option<AttributeValue<Slice<'_>>>,
) -> Result<Option<u32>, gimli::Error> {
    let name = match origin {
        Some(AttributeValue::UnitRef(at)) => name_of(dwarf, unit, at)?,
        Some(AttributeValue::DebugInfoRef(at)) => {
            let mut headers = dwarf.units();
            let mut found = None;
            while let Some(header) = headers.next()? {
                let other = dwarf.unit(header)?;
                if let Some(inside) = at.to_unit_offset(&other.header) {
                    found = name_of(dwarf, &other, inside)?;
                    break;
                }
            }
            found
        }
        _ => None,
    };
    let number = name.as_deref().and_then(|name| name.strip_prefix(MARK));
    Ok(number.and_then(|rest| rest.split([',', '>']).next()?.trim().parse().ok()))
}

fn name_of(
    dwarf: &Dwarf<Slice<'_>>,
    unit: &gimli::Unit<Slice<'_>>,
    at: UnitOffset,
) -> Result<Option<String>, gimli::Error> {
    let entry = unit.entry(at)?;
    let Some(name) = entry.attr_value(gimli::DW_AT_name) else {
        return Ok(None);
    };
    Ok(Some(
        dwarf.attr_string(unit, name)?.to_string_lossy().into_owned(),
    ))
}
