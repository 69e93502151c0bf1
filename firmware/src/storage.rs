//! The settings in flash: two slots. A write touches only the older one, so a power cut at any point leaves either the old or the
//! new settings, complete.
//!
//! A record is words: mark and layout version, number of the write, the settings' values, CRC-32 of all that (as little-endian
//! bytes). The CRC comes last, so a half-written record is invalid. Limits: a slot is erased before every write; flash endures
//! about 10,000 erasures per slot.
//!
//! Why not sequential-storage (8.0.2): under the power cuts of `tests/storage.rs`, 89,502 of them, it lost the settings 10 times,
//! when an erasure of a full sector was torn, and refused every later write (`Corrupted`); this module loses none. Before the
//! line is restored it reads up to 16,428 bytes, this module two records.

use gripline_protocol::configuration::{CONFIGURATION_VALUES, CONFIGURATION_VERSION, Configuration, Values};
use gripline_protocol::crc::crc32;

/// Number of slots.
pub const SLOTS: usize = 2;
/// Words of a record: mark, number, values, CRC.
pub const RECORD_WORDS: usize = HEAD_WORDS + CONFIGURATION_VALUES + 1;
const HEAD_WORDS: usize = 2;
const CRC_WORD: usize = RECORD_WORDS - 1;
/// "gs" in the upper half of a record's first word; the layout's version is the lower half.
const MARK: u32 = 0x6773_0000;
/// Value of erased flash.
const ERASED: u32 = u32::MAX;

/// Two erasable places of flash. Bits are programmed from 1 to 0; only erasing brings them back.
pub trait SettingsFlash {
    /// What can go wrong.
    type Error;

    /// The word at `word` of `slot`.
    fn read(&self, slot: usize, word: usize) -> u32;

    /// Sets every bit of a slot.
    ///
    /// # Errors
    /// The hardware's error; the slot's content is then undefined.
    fn erase(&mut self, slot: usize) -> Result<(), Self::Error>;

    /// Programs one word of an erased slot.
    ///
    /// # Errors
    /// The hardware's error; the word is then undefined.
    fn program(&mut self, slot: usize, word: usize, value: u32) -> Result<(), Self::Error>;
}

/// Why settings were not stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// The flash refused.
    Flash(E),
    /// The record reads back differently than written.
    ReadBack,
}

/// The content of the flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stored {
    /// The newest complete settings in range.
    pub settings: Option<Configuration>,
    /// Something was stored but none of it is usable: worn or damaged flash, or another version's settings.
    pub lost: bool,
    /// Number of the newest complete record; 0 when there is none.
    pub writes: u32,
}

/// Reads the newest settings. Bounded: two records, each read once.
#[must_use]
#[inline(never)]
pub fn load(flash: &impl SettingsFlash) -> Stored {
    let mut best = Stored::default();
    let mut used = false;
    for slot in 0..SLOTS {
        let record = read(flash, slot);
        used |= record[0] != ERASED;
        if let Some((writes, settings)) = decode(&record)
            && writes > best.writes
        {
            best.settings = Some(settings);
            best.writes = writes;
        }
    }
    // An interrupted write leaves a broken record beside a good one: nothing is lost then.
    best.lost = used && best.settings.is_none();
    best
}

/// Writes settings over the older record and reads them back. Returns the number of the write.
///
/// # Errors
/// [`StoreError`]; the newer record is untouched.
#[inline(never)]
pub fn store<F: SettingsFlash>(flash: &mut F, settings: &Configuration) -> Result<u32, StoreError<F::Error>> {
    let [first, second] = [0, 1].map(|slot| decode(&read(flash, slot)).map_or(0, |(writes, _)| writes));
    let slot = usize::from(first > second);
    // 2³² writes outlive the flash.
    let writes = first.max(second).wrapping_add(1);
    let record = encode(writes, settings);
    flash.erase(slot).map_err(StoreError::Flash)?;
    for (word, &value) in record.iter().enumerate() {
        flash.program(slot, word, value).map_err(StoreError::Flash)?;
    }
    if read(flash, slot) == record {
        Ok(writes)
    } else {
        Err(StoreError::ReadBack)
    }
}

type Record = [u32; RECORD_WORDS];

#[inline(never)]
fn read(flash: &impl SettingsFlash, slot: usize) -> Record {
    core::array::from_fn(|word| flash.read(slot, word))
}

fn encode(writes: u32, settings: &Configuration) -> Record {
    let mut record = [0; RECORD_WORDS];
    record[0] = MARK | u32::from(CONFIGURATION_VERSION);
    record[1] = writes;
    for (word, value) in record[HEAD_WORDS..CRC_WORD].iter_mut().zip(settings.values()) {
        *word = value.cast_unsigned();
    }
    record[CRC_WORD] = crc_of(&record[..CRC_WORD]);
    record
}

/// (number of the write, settings); `None` unless the whole record is valid.
#[inline(never)]
fn decode(record: &Record) -> Option<(u32, Configuration)> {
    let writes = record[1];
    let right = record[0] == MARK | u32::from(CONFIGURATION_VERSION)
        && writes != 0
        && record[CRC_WORD] == crc_of(&record[..CRC_WORD]);
    if !right {
        return None;
    }
    let mut values: Values = [0; CONFIGURATION_VALUES];
    for (value, word) in values.iter_mut().zip(&record[HEAD_WORDS..CRC_WORD]) {
        *value = word.cast_signed();
    }
    // The CRC proves what was written, not that it is in range.
    let settings = Configuration::from_values(&values).filter(|settings| settings.check().is_ok())?;
    Some((writes, settings))
}

#[inline(never)]
fn crc_of(words: &[u32]) -> u32 {
    crc32(words.iter().flat_map(|word| word.to_le_bytes()))
}
