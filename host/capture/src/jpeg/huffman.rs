//! Huffman codes of a JPEG (ITU-T T.81, annexes C, F and K.3), and tables that read a code and its number in one look.

use super::header::damaged;

/// Bits of one look: codes with their numbers are seldom longer, and the tables stay in the first cache.
pub(super) const LOOK: u32 = 11;
const LOOKS: usize = 1 << LOOK;
/// The longest code.
const LONGEST: usize = 16;

/// Codes as a file has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Code<'a> {
    /// How many there are of each length from 1.
    counts: &'a [u8; LONGEST],
    /// What they stand for, in order.
    symbols: &'a [u8],
}

impl<'a> Code<'a> {
    /// Reads one and returns what follows it; none where it is cut short.
    pub(super) fn read(bytes: &'a [u8]) -> Option<(Self, &'a [u8])> {
        let (counts, rest) = bytes.split_first_chunk()?;
        let symbols = counts.iter().map(|count| usize::from(*count)).sum();
        let (symbols, rest) = rest.split_at_checked(symbols)?;
        Some((Self { counts, symbols }, rest))
    }
}

/// What one look finds: which coefficient, its number if that is in sight, and how many bits that was.
///
/// Bits 0 to 7: bits to go on by. 8 to 15: for a number in sight, coefficients to go on by, else 0. 16 to 31: the number; else
/// the symbol. 0: the code is longer than the look, or none.
pub(super) type Look = u32;

/// Codes, ready to be read.
#[derive(Debug)]
pub(super) struct Table {
    /// What it was made of.
    counts: [u8; LONGEST],
    symbols: Vec<u8>,
    looks: Box<[Look; LOOKS]>,
    /// For each length, the first 16 bits that are beyond its codes.
    ends: [u32; LONGEST + 1],
    /// What is added to a code of a length to find its symbol.
    offsets: [i32; LONGEST + 1],
}

impl Default for Table {
    fn default() -> Self {
        Self {
            counts: [0; LONGEST],
            symbols: Vec::new(),
            looks: Box::new([0; LOOKS]),
            ends: [0; LONGEST + 1],
            offsets: [0; LONGEST + 1],
        }
    }
}

impl Table {
    /// Makes it read `code`; nothing is to be done where it does already, as from picture to picture of a camera.
    ///
    /// # Errors
    /// When the lengths are those of no code.
    pub(super) fn set(&mut self, code: Code) -> Result<(), String> {
        if self.counts == *code.counts && self.symbols == code.symbols {
            return Ok(());
        }
        // Of those of no code nothing stays behind.
        let mut made = Self::default();
        let mut next = 0_u32;
        let mut place = 0_usize;
        for length in 1..=LONGEST {
            made.offsets[length] = place as i32 - next as i32;
            for _ in 0..code.counts[length - 1] {
                if next >> length != 0 || place >= 256 {
                    return Err(damaged("a table of codes that are too many"));
                }
                made.look_for(next, length as u32, code.symbols[place]);
                next += 1;
                place += 1;
            }
            made.ends[length] = next << (LONGEST - length);
            next <<= 1;
        }
        made.counts = *code.counts;
        made.symbols = code.symbols.to_vec();
        *self = made;
        Ok(())
    }

    /// Enters a code into the looks that begin with it.
    fn look_for(&mut self, code: u32, length: u32, symbol: u8) {
        let Some(free) = LOOK.checked_sub(length) else {
            return;
        };
        let size = u32::from(symbol & 15);
        for rest in 0..1 << free {
            // A number of no bits is the end of a block or a run of zeros, which are rare.
            self.looks[(code << free | rest) as usize] = if size == 0 || size > free {
                length | u32::from(symbol) << 16
            } else {
                let number = extended(rest >> (free - size), size);
                let onward = u32::from(symbol >> 4) + 1;
                (length + size) | onward << 8 | (number as u32) << 16
            };
        }
    }

    /// What the next bits are: the look, for the first [`LOOK`] of `bits`, left-aligned.
    pub(super) fn look(&self, bits: u64) -> Look {
        self.looks[(bits >> (u64::BITS - LOOK)) as usize]
    }

    /// Symbol and length of a code of any length; none where it is none.
    #[cold]
    pub(super) fn find(&self, bits: u64) -> Option<(u8, u32)> {
        let head = (bits >> (u64::BITS - LONGEST as u32)) as u32;
        let length = (1..=LONGEST).find(|length| head < self.ends[*length])?;
        let place = (head >> (LONGEST - length)) as i32 + self.offsets[length];
        let symbol = self.symbols.get(usize::try_from(place).ok()?)?;
        Some((*symbol, length as u32))
    }
}

/// The number of `size` bits, 1 to 15 (F.2.2.1): those that begin with 0 are negative.
pub(super) const fn extended(bits: u32, size: u32) -> i16 {
    let number = bits as i32;
    (if number >> (size - 1) == 0 {
        number - (1 << size) + 1
    } else {
        number
    }) as i16
}

/// The codes of annex K.3 for brightness and colour, which cameras leave out: of first coefficients, and of the others.
pub(super) const fn standard<'a>() -> [[Code<'a>; 4]; 2] {
    const FIRST: [Code; 2] = [
        Code {
            counts: &[0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0],
            symbols: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
        },
        Code {
            counts: &[0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0],
            symbols: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
        },
    ];
    const OTHERS: [Code; 2] = [
        Code {
            counts: &[0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d],
            symbols: &BRIGHTNESS,
        },
        Code {
            counts: &[0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77],
            symbols: &COLOUR,
        },
    ];
    [
        [FIRST[0], FIRST[1], FIRST[0], FIRST[1]],
        [OTHERS[0], OTHERS[1], OTHERS[0], OTHERS[1]],
    ]
}

/// Table K.5.
#[rustfmt::skip]
const BRIGHTNESS: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
    0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

/// Table K.6.
#[rustfmt::skip]
const COLOUR: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
    0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
    0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
    0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_that_are_too_many_leave_nothing_behind() {
        let mut counts = [0; LONGEST];
        counts[0] = 3;
        let mut table = Table::default();
        let too_many = Code {
            counts: &counts,
            symbols: &[1, 2, 3],
        };
        assert!(table.set(too_many).unwrap_err().contains("too many"));
        let none = Code {
            counts: &[0; LONGEST],
            symbols: &[],
        };
        table.set(none).unwrap();
        assert_eq!([table.look(0), table.look(u64::MAX)], [0; 2]);
        assert_eq!(table.find(0), None);
    }
}
