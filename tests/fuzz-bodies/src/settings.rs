//! Any bits in flash: what is loaded is in range, and a good record is found beside any other.

use gripline_firmware::storage::{RECORD_WORDS, SLOTS, SettingsFlash, load, store};
use gripline_protocol::configuration::{CONFIGURATION_VALUES, Configuration};

/// Flash in memory.
struct Memory([[u32; RECORD_WORDS]; SLOTS]);

impl SettingsFlash for Memory {
    type Error = ();

    fn read(&self, slot: usize, word: usize) -> u32 {
        self.0[slot][word]
    }

    fn erase(&mut self, slot: usize) -> Result<(), ()> {
        self.0[slot].fill(u32::MAX);
        Ok(())
    }

    fn program(&mut self, slot: usize, word: usize, value: u32) -> Result<(), ()> {
        self.0[slot][word] &= value;
        Ok(())
    }
}

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let mut words = input.chunks(4).map(|chunk| {
        let mut word = [0xFF; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        u32::from_le_bytes(word)
    });
    let mut values = [0_i32; CONFIGURATION_VALUES];
    for (value, standard) in values.iter_mut().zip(Configuration::DEFAULT.values()) {
        *value = standard.wrapping_add_unsigned(words.next().unwrap_or(0));
    }
    let mut flash = Memory([[u32::MAX; RECORD_WORDS]; SLOTS]);
    for slot in &mut flash.0 {
        slot.fill_with(|| words.next().unwrap_or(u32::MAX));
    }
    let found = load(&flash);
    if let Some(settings) = found.settings {
        assert_eq!(settings.check(), Ok(()), "only settings in range are loaded");
    }
    let Some(wanted) = Configuration::from_values(&values) else {
        return;
    };
    assert_eq!(
        wanted.values(),
        values,
        "numbers make the settings that make the numbers"
    );
    if wanted.check().is_ok() && found.writes < u32::MAX && store(&mut flash, &wanted).is_ok() {
        assert_eq!(load(&flash).settings, Some(wanted), "what was stored is found");
    }
}
