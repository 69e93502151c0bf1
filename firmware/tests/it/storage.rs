//! The settings in flash: read back over power cycles, and whole after a power cut at any operation.

use gripline_firmware::storage::{RECORD_WORDS, SLOTS, SettingsFlash, StoreError, Stored, load, store};
use gripline_protocol::message::Configuration;
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;

/// Words of a slot: more than a record, as on the chip.
const SLOT_WORDS: usize = 128;

/// What an operation under which the power goes leaves behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Torn {
    /// It had not begun.
    Before,
    /// Every bit on its way has gone over or not, by chance.
    Half(u64),
    /// It was done.
    After,
}

#[derive(Debug, PartialEq, Eq)]
struct PowerCut;

/// Flash that programs bits from 1 to 0 only, and may lose power at one operation.
#[derive(Clone)]
struct Flash {
    slots: [[u32; SLOT_WORDS]; SLOTS],
    operations: usize,
    cut: Option<(usize, Torn)>,
    /// Word that programming never reaches.
    worn: Option<(usize, usize)>,
}

impl Flash {
    fn new() -> Self {
        Self {
            slots: [[u32::MAX; SLOT_WORDS]; SLOTS],
            operations: 0,
            cut: None,
            worn: None,
        }
    }

    fn powered_up(&self) -> Self {
        Self {
            operations: 0,
            cut: None,
            ..self.clone()
        }
    }

    /// Sets words to what the operation makes of them, as far as the power lasts.
    fn operate(&mut self, slot: usize, words: &[(usize, u32)]) -> Result<(), PowerCut> {
        let torn = match self.cut {
            Some((at, torn)) if at == self.operations => Some(torn),
            Some((at, _)) if at < self.operations => return Err(PowerCut),
            _ => None,
        };
        self.operations += 1;
        let mut chance = Pcg64Mcg::new(match torn {
            Some(Torn::Half(seed)) => seed.into(),
            _ => 0,
        });
        for &(word, value) in words {
            let cell = &mut self.slots[slot][word];
            match torn {
                None | Some(Torn::After) => *cell = value,
                Some(Torn::Before) => {}
                Some(Torn::Half(_)) => {
                    let mask: u32 = chance.random();
                    *cell = *cell & !mask | value & mask;
                }
            }
        }
        if torn.is_some() { Err(PowerCut) } else { Ok(()) }
    }
}

impl SettingsFlash for Flash {
    type Error = PowerCut;

    fn read(&self, slot: usize, word: usize) -> u32 {
        self.slots[slot][word]
    }

    fn erase(&mut self, slot: usize) -> Result<(), PowerCut> {
        let all: Vec<_> = (0..SLOT_WORDS).map(|word| (word, u32::MAX)).collect();
        self.operate(slot, &all)
    }

    fn program(&mut self, slot: usize, word: usize, value: u32) -> Result<(), PowerCut> {
        let value = if self.worn == Some((slot, word)) {
            u32::MAX
        } else {
            self.slots[slot][word] & value
        };
        self.operate(slot, &[(word, value)])
    }
}

fn settings(number: u16) -> Configuration {
    Configuration {
        friction: 4_000 + number,
        ceiling: 100_000 - i32::from(number),
        ..Configuration::DEFAULT
    }
}

/// Flash after this many writes, the newest of them `settings(writes)`.
fn written(writes: u16) -> Flash {
    let mut flash = Flash::new();
    for number in 1..=writes {
        assert_eq!(store(&mut flash, &settings(number)), Ok(number.into()));
    }
    flash
}

#[test]
fn a_new_chip_has_no_settings_and_none_were_lost() {
    assert_eq!(load(&Flash::new()), Stored::default());
}

#[test]
fn settings_are_read_back_over_a_power_cycle_and_the_newest_count() {
    for writes in 1..6 {
        let stored = load(&written(writes).powered_up());
        assert_eq!(
            (stored.settings, stored.lost, stored.writes),
            (Some(settings(writes)), false, writes.into())
        );
    }
}

/// Every operation of a write, each cut before it begins, in its middle in many ways, and after it.
#[test]
fn a_power_cut_at_any_operation_leaves_the_old_settings_or_the_new_ones_whole() {
    for writes in 0..4 {
        let before = written(writes);
        let old = (writes > 0).then(|| settings(writes));
        let new = settings(writes + 1);
        let mut whole = before.powered_up();
        store(&mut whole, &new).unwrap();
        // One erasure and a word at a time.
        assert_eq!(whole.operations, 1 + RECORD_WORDS);
        let mut newer = 0;
        for operation in 0..whole.operations {
            let halves = (0..40).map(Torn::Half);
            for torn in [Torn::Before, Torn::After].into_iter().chain(halves) {
                let mut flash = before.powered_up();
                flash.cut = Some((operation, torn));
                assert_eq!(store(&mut flash, &new), Err(StoreError::Flash(PowerCut)));
                let found = load(&flash.powered_up());
                assert!(
                    found.settings == old || found.settings == Some(new),
                    "{writes} writes, operation {operation} {torn:?}: {found:?}"
                );
                assert!(!found.lost || old.is_none(), "operation {operation} {torn:?}");
                newer += usize::from(found.settings == Some(new));
                // The next write works, whatever was left.
                let mut next = flash.powered_up();
                store(&mut next, &settings(77)).unwrap();
                assert_eq!(load(&next).settings, Some(settings(77)));
            }
        }
        assert!(newer >= 1, "the cut after the last word leaves the new settings");
    }
}

#[test]
fn a_worn_word_is_noticed_and_the_settings_of_before_stay() {
    let mut flash = written(3);
    // The fourth write goes to slot 1; its CRC is in the last word, which is never all ones here.
    flash.worn = Some((1, RECORD_WORDS - 1));
    assert_eq!(store(&mut flash, &settings(4)), Err(StoreError::ReadBack));
    assert_eq!(load(&flash).settings, Some(settings(3)));
}

#[test]
fn two_damaged_records_are_settings_lost_and_not_settings_of_their_own() {
    let mut flash = written(2);
    for slot in 0..SLOTS {
        flash.slots[slot][7] ^= 0x10;
    }
    assert_eq!(
        load(&flash),
        Stored {
            lost: true,
            ..Stored::default()
        }
    );
}

#[test]
fn settings_of_another_layout_are_not_read_as_ours() {
    let mut flash = written(1);
    flash.slots[0][0] += 1;
    assert_eq!((load(&flash).settings, load(&flash).lost), (None, true));
}

proptest! {
    /// Damage is noticed wherever it is: the CRC covers all of a record.
    #[test]
    fn a_flipped_bit_never_changes_a_setting(word in 0..RECORD_WORDS, bit in 0..32) {
        let mut flash = written(1);
        flash.slots[0][word] ^= 1_u32 << bit;
        prop_assert_eq!(load(&flash).settings, None);
    }
}
