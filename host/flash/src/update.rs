//! An update, in an order that leaves no half image that runs: the sector of the interrupt vectors is erased first, and the first two
//! words of it (stack pointer and reset vector), without which the chip starts nothing, are written last, when all else has been read
//! back. The sectors of the stored settings are left alone.

use crate::dfu::{Dfu, Wire};
use crate::error::FlashError;
use crate::image::{ENTRY_BYTES, ERASED, FLASH, Image, Part, SETTINGS};
use crate::layout::Sector;

/// What an update is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Erasing, counted in bytes.
    Erase,
    /// Writing, counted in bytes.
    Write,
    /// Reading back, counted in bytes.
    Verify,
}

/// How far it has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What it is at.
    pub step: Step,
    /// Bytes that are done with in this step.
    pub done: u32,
    /// Bytes of this step.
    pub total: u32,
}

/// Puts `image` on a chip with these sectors. It does not start it.
///
/// # Errors
/// [`FlashError`] that says whether the image from before is still there.
pub fn update<W: Wire>(
    dfu: &mut Dfu<W>,
    sectors: &[Sector],
    image: &Image,
    progress: &mut dyn FnMut(Progress),
) -> Result<(), FlashError> {
    let erased = sectors_of(sectors, image)?;
    let total = erased.iter().map(|sector| sector.bytes).sum();
    let mut done = 0;
    for sector in &erased {
        progress(Progress {
            step: Step::Erase,
            done,
            total,
        });
        // The first erasure may have failed before or after it erased.
        dfu.erase(sector.address).map_err(begun)?;
        done += sector.bytes;
    }
    let (entry, rest) = without_entry(image);
    for step in [Step::Write, Step::Verify] {
        let total = rest.iter().map(|part| part.bytes.len() as u32).sum();
        let mut done = 0;
        for part in &rest {
            let addresses = (part.address..).step_by(dfu.transfer_bytes());
            for (address, block) in addresses.zip(part.bytes.chunks(dfu.transfer_bytes())) {
                progress(Progress { step, done, total });
                match step {
                    Step::Write => dfu.write(address, block).map_err(begun)?,
                    Step::Erase | Step::Verify => verify(dfu, address, block)?,
                }
                done += block.len() as u32;
            }
        }
        progress(Progress { step, done, total });
    }
    verify(dfu, FLASH, &[ERASED; ENTRY_BYTES])?;
    dfu.write(FLASH, &entry).map_err(begun)?;
    verify(dfu, FLASH, &entry)
}

fn begun(error: FlashError) -> FlashError {
    FlashError::Dfu {
        error: Box::new(error),
        has_begun: true,
    }
}

/// The sectors that the image lies in, that of the vectors first.
fn sectors_of(sectors: &[Sector], image: &Image) -> Result<Vec<Sector>, FlashError> {
    let mut used: Vec<Sector> = Vec::new();
    for part in &image.parts {
        let mut at = part.address;
        while at < part.end() {
            let sector = sectors.iter().find(|sector| {
                (sector.address..sector.end()).contains(&at)
                    && sector.is_writable
                    && (sector.end() <= SETTINGS.start || sector.address >= SETTINGS.end)
            });
            let Some(sector) = sector else {
                return Err(FlashError::NoRoom {
                    address: at,
                    bytes: part.end() - at,
                });
            };
            if !used.contains(sector) {
                used.push(*sector);
            }
            at = sector.end();
        }
    }
    used.sort_by_key(|sector| sector.address);
    Ok(used)
}

/// The words that let the chip start the image, and everything else.
fn without_entry(image: &Image) -> ([u8; ENTRY_BYTES], Vec<Part>) {
    let mut rest = image.parts.clone();
    let mut entry = [ERASED; ENTRY_BYTES];
    // An image begins with them, as `Image::read` found.
    if let Some(head) = rest.first_mut() {
        let bytes: Vec<u8> = head.bytes.drain(..ENTRY_BYTES).collect();
        entry.copy_from_slice(&bytes);
        head.address += ENTRY_BYTES as u32;
    }
    (entry, rest)
}

fn verify<W: Wire>(dfu: &mut Dfu<W>, address: u32, expected: &[u8]) -> Result<(), FlashError> {
    let read = dfu.read(address, expected.len()).map_err(begun)?;
    if read.len() != expected.len() {
        return Err(FlashError::Short {
            address,
            found: read.len(),
            expected: expected.len(),
        });
    }
    let differs = (address..)
        .zip(read.iter().zip(expected))
        .find(|(_, (found, expected))| found != expected);
    match differs {
        None => Ok(()),
        Some((address, (&found, &expected))) => Err(FlashError::Differs {
            address,
            found,
            expected,
        }),
    }
}
