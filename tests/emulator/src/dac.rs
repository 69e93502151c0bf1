//! The digital-to-analog converter of RM0090 chapter 14, recording every code that reaches an output pin.
//! Units: 12-bit codes, virtual nanoseconds. A code moves from holding register to output at once (the part takes
//! one APB1 cycle), or at the software trigger when the channel asks for one.
//! Limits: no timer or pin triggers, no DMA, no wave generation; a firmware that asks for them gets a complaint.
//! The reset bit in RCC_APB1RSTR does nothing; a reset of the whole part clears everything.

use rigless::chip::parallel::Peer;
use rigless::device::DeviceContext;
use rigless::snapshot::Store;
use rigless::soc::Width;

/// Number of channels: PA4 and PA5.
pub const CHANNELS: usize = 2;

/// A code that appeared on an output pin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DacWrite {
    /// Virtual time since power-on, nanoseconds.
    pub at_ns: u64,
    /// Channel as the manual counts: 1 (PA4) or 2 (PA5).
    pub channel: u8,
    /// The code, 0..=4095.
    pub code: u16,
}

/// One bit or field of `CR` per channel; channel 2's sit 16 bits higher (section 14.5.1).
mod cr {
    pub(super) const EN: u32 = 1;
    pub(super) const TEN: u32 = 1 << 2;
    pub(super) const TSEL: u32 = 0b111 << 3;
    pub(super) const WAVE: u32 = 0b11 << 6;
    pub(super) const DMAEN: u32 = 1 << 12;
    /// Every bit that exists, both channels.
    pub(super) const WRITABLE: u32 = 0x3FFF_3FFF;
    pub(super) const CHANNEL_BITS: usize = 16;
}

/// The two channels of the converter.
#[derive(Debug, Default)]
pub struct Dac {
    control: u32,
    holding: [u16; CHANNELS],
    output: [u16; CHANNELS],
    writes: Vec<DacWrite>,
}

impl Dac {
    /// The code on `channel`'s pin (0-based), or `None` while the channel is off and the pin floats.
    #[must_use]
    pub fn code(&self, channel: usize) -> Option<u16> {
        (self.channel_control(channel) & cr::EN != 0).then(|| self.output[channel])
    }

    /// Takes what was recorded since the last call, oldest first.
    pub fn take_writes(&mut self) -> Vec<DacWrite> {
        std::mem::take(&mut self.writes)
    }

    /// The word at `offset` (section 14.5); what is not there reads zero.
    #[must_use]
    pub fn read_register(&self, offset: u64) -> u32 {
        let [first, second] = self.holding.map(u32::from);
        match offset {
            0x00 => self.control,
            0x08 => first,
            0x0C => first << 4,
            0x10 => first >> 4,
            0x14 => second,
            0x18 => second << 4,
            0x1C => second >> 4,
            0x20 => first | second << 16,
            0x24 => first << 4 | second << 20,
            0x28 => first >> 4 | second >> 4 << 8,
            0x2C => u32::from(self.output[0]),
            0x30 => u32::from(self.output[1]),
            _ => 0,
        }
    }

    /// Writes the word at `offset`. Answers what this model cannot do of what the firmware asked for.
    pub fn write_register(&mut self, offset: u64, value: u32, at_ns: u64) -> Option<&'static str> {
        let low = value as u16;
        let high = (value >> 16) as u16;
        match offset {
            0x00 => return self.write_control(value, at_ns),
            0x04 => {
                for channel in 0..CHANNELS {
                    if value >> channel & 1 != 0 && self.is_triggered(channel) {
                        self.output_holding(channel, at_ns);
                    }
                }
            }
            0x08 => self.hold(0, low, at_ns),
            0x0C => self.hold(0, low >> 4, at_ns),
            0x10 => self.hold(0, (low & 0xFF) << 4, at_ns),
            0x14 => self.hold(1, low, at_ns),
            0x18 => self.hold(1, low >> 4, at_ns),
            0x1C => self.hold(1, (low & 0xFF) << 4, at_ns),
            0x20 => self.hold_both([low, high], at_ns),
            0x24 => self.hold_both([low >> 4, high >> 4], at_ns),
            0x28 => self.hold_both([(low & 0xFF) << 4, low >> 8 << 4], at_ns),
            _ => {}
        }
        None
    }

    fn write_control(&mut self, value: u32, at_ns: u64) -> Option<&'static str> {
        let was_driven = [self.code(0), self.code(1)];
        self.control = value & cr::WRITABLE;
        for (channel, was) in was_driven.into_iter().enumerate() {
            if was.is_none() {
                self.record(channel, at_ns);
            }
        }
        (0..CHANNELS).find_map(|channel| {
            let control = self.channel_control(channel);
            if control & cr::DMAEN != 0 {
                Some("DMA is not modelled")
            } else if control & cr::TEN != 0 && control & cr::WAVE != 0 {
                Some("wave generation is not modelled")
            } else if control & cr::TEN != 0 && control & cr::TSEL != cr::TSEL {
                Some("only the software trigger is modelled")
            } else {
                None
            }
        })
    }

    /// This channel's half of `CR`.
    fn channel_control(&self, channel: usize) -> u32 {
        self.control >> (cr::CHANNEL_BITS * channel)
    }

    fn is_triggered(&self, channel: usize) -> bool {
        self.channel_control(channel) & cr::TEN != 0
    }

    fn hold(&mut self, channel: usize, code: u16, at_ns: u64) {
        self.holding[channel] = code & 0xFFF;
        if !self.is_triggered(channel) {
            self.output_holding(channel, at_ns);
        }
    }

    fn hold_both(&mut self, codes: [u16; CHANNELS], at_ns: u64) {
        for (channel, code) in codes.into_iter().enumerate() {
            self.hold(channel, code, at_ns);
        }
    }

    fn output_holding(&mut self, channel: usize, at_ns: u64) {
        self.output[channel] = self.holding[channel];
        self.record(channel, at_ns);
    }

    /// Records the code on the pin; a channel that is off drives no pin, so there is nothing to record.
    fn record(&mut self, channel: usize, at_ns: u64) {
        if let Some(code) = self.code(channel) {
            self.writes.push(DacWrite {
                at_ns,
                channel: channel as u8 + 1,
                code,
            });
        }
    }
}

impl Store for Dac {}

impl Peer for Dac {
    fn read(&mut self, offset: u64, _: Width, _: &mut DeviceContext<'_>) -> u64 {
        u64::from(self.read_register(offset))
    }

    fn write(&mut self, offset: u64, width: Width, value: u64, context: &mut DeviceContext<'_>) {
        if width != Width::W32 {
            context.tell("any", "registers take whole words only (section 14.5)");
        }
        if let Some(refusal) = self.write_register(offset, value as u32, context.now().0) {
            context.tell("CR", refusal);
        }
    }

    fn reset(&mut self) {
        *self = Self {
            writes: std::mem::take(&mut self.writes),
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CR: u64 = 0x00;
    const SWTRIGR: u64 = 0x04;
    const DHR12R1: u64 = 0x08;
    const DOR1: u64 = 0x2C;
    const DOR2: u64 = 0x30;
    const BOTH_ON: u32 = cr::EN | cr::EN << 16;

    fn both_on() -> Dac {
        let mut dac = Dac::default();
        assert_eq!(dac.write_register(CR, BOTH_ON, 0), None);
        dac.take_writes();
        dac
    }

    fn at_7(channel: u8, code: u16) -> DacWrite {
        DacWrite {
            at_ns: 7,
            channel,
            code,
        }
    }

    #[test]
    fn every_holding_register_puts_its_alignment_of_the_code_on_the_right_pins() {
        // Offset, word with junk wherever the manual reserves bits, codes that must appear (section 14.5.3 to 14.5.11).
        let cases: [(u64, u32, &[DacWrite]); 9] = [
            (0x08, 0xFFFF_FABC, &[at_7(1, 0xABC)]),
            (0x0C, 0xFFFF_ABCF, &[at_7(1, 0xABC)]),
            (0x10, 0xFFFF_FFAB, &[at_7(1, 0xAB0)]),
            (0x14, 0xFFFF_FABC, &[at_7(2, 0xABC)]),
            (0x18, 0xFFFF_ABCF, &[at_7(2, 0xABC)]),
            (0x1C, 0xFFFF_FFAB, &[at_7(2, 0xAB0)]),
            (0x20, 0xF123_FABC, &[at_7(1, 0xABC), at_7(2, 0x123)]),
            (0x24, 0x123F_ABCF, &[at_7(1, 0xABC), at_7(2, 0x123)]),
            (0x28, 0xFFFF_12AB, &[at_7(1, 0xAB0), at_7(2, 0x120)]),
        ];
        for (offset, word, expected) in cases {
            let mut dac = both_on();
            assert_eq!(dac.write_register(offset, word, 7), None);
            assert_eq!(dac.take_writes(), expected, "at offset {offset:#x}");
            for write in expected {
                let channel = usize::from(write.channel - 1);
                assert_eq!(dac.code(channel), Some(write.code), "at offset {offset:#x}");
                assert_eq!(dac.read_register([DOR1, DOR2][channel]), u32::from(write.code));
            }
        }
    }

    #[test]
    fn a_holding_register_reads_back_in_its_own_alignment() {
        let mut dac = both_on();
        dac.write_register(0x20, 0x0123_0ABC, 0);
        let reads =
            [0x08, 0x0C, 0x10, 0x14, 0x18, 0x1C, 0x20, 0x24, 0x28].map(|offset| dac.read_register(offset));
        assert_eq!(
            reads,
            [
                0xABC,
                0xABC0,
                0xAB,
                0x123,
                0x1230,
                0x12,
                0x0123_0ABC,
                0x1230_ABC0,
                0x12AB
            ]
        );
    }

    #[test]
    fn a_channel_that_is_off_drives_nothing_until_it_is_turned_on() {
        let mut dac = Dac::default();
        dac.write_register(DHR12R1, 1000, 3);
        assert_eq!((dac.code(0), dac.take_writes()), (None, vec![]));
        dac.write_register(CR, cr::EN, 5);
        assert_eq!(dac.code(0), Some(1000), "the code waited in the output register");
        assert_eq!(
            dac.take_writes(),
            [DacWrite {
                at_ns: 5,
                channel: 1,
                code: 1000
            }]
        );
        dac.write_register(CR, cr::EN, 6);
        assert_eq!(dac.take_writes(), [], "it was on already");
        dac.write_register(CR, 0, 9);
        assert_eq!((dac.code(0), dac.take_writes()), (None, vec![]));
    }

    #[test]
    fn a_triggered_channel_waits_for_its_software_trigger() {
        let mut dac = Dac::default();
        assert_eq!(dac.write_register(CR, BOTH_ON | cr::TEN | cr::TSEL, 0), None);
        dac.take_writes();
        dac.write_register(DHR12R1, 77, 1);
        assert_eq!((dac.code(0), dac.take_writes()), (Some(0), vec![]));
        dac.write_register(SWTRIGR, 0b10, 2);
        assert_eq!(dac.take_writes(), [], "channel 2 has no trigger selected");
        dac.write_register(SWTRIGR, 0b01, 7);
        assert_eq!((dac.code(0), dac.take_writes()), (Some(77), vec![at_7(1, 77)]));
    }

    #[test]
    fn what_is_not_modelled_is_refused_in_words() {
        for (control, word) in [
            (cr::EN | cr::DMAEN, "DMA"),
            (cr::EN | cr::TEN | cr::TSEL | 1 << 6, "wave"),
            ((cr::EN | cr::TEN) << 16, "software trigger"),
        ] {
            let refusal = Dac::default().write_register(CR, control, 0);
            assert!(
                refusal.is_some_and(|text| text.contains(word)),
                "{control:#x}: {refusal:?}"
            );
        }
    }

    #[test]
    fn a_reset_releases_the_pins_and_keeps_the_record() {
        let mut dac = both_on();
        dac.write_register(DHR12R1, 500, 7);
        dac.reset();
        assert_eq!(
            (dac.code(0), dac.read_register(DOR1), dac.read_register(CR)),
            (None, 0, 0)
        );
        assert_eq!(dac.take_writes(), [at_7(1, 500)]);
    }
}
