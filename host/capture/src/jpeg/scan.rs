//! The bits of a JPEG, down to the last row of a window: pure. Every code has to be read, since each hangs on the one before;
//! only the brightness within the window becomes numbers and pixels.

use super::header::{COEFFICIENTS, Header, damaged};
use super::huffman::{LOOK, Table, extended};
use super::transform::{self, BLOCK, Block, PLACES, Pixels};

/// Bits that are there at least when they have been filled up, whatever there was: enough for a code and its number, 16 and 15.
const ENOUGH: u32 = 56;

/// The bits between two markers, without the zeros that stand behind bytes of ones. Beyond the end come zeros.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The next bits, from the highest; only `count` of them count.
    next: u64,
    count: u32,
    /// Of them, those beyond the end.
    beyond: u32,
}

impl<'a> Bits<'a> {
    const fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            next: 0,
            count: 0,
            beyond: 0,
        }
    }

    /// Makes sure that there are [`ENOUGH`].
    #[inline]
    fn fill(&mut self) {
        if let Some(bytes) = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk) {
            let word = u64::from_be_bytes(*bytes);
            if !has_ones(word) {
                // Bits of a byte that does not fit any more are said again by the next word.
                self.next |= word >> self.count;
                self.at += ((63 - self.count) / 8) as usize;
                self.count |= ENOUGH;
                return;
            }
        }
        self.fill_slowly();
    }

    #[cold]
    fn fill_slowly(&mut self) {
        self.next &= !(u64::MAX >> self.count);
        while self.count < ENOUGH {
            let byte = match self.bytes.get(self.at..) {
                Some([0xff, 0, ..]) => {
                    self.at += 2;
                    0xff
                }
                // A marker, or the end of the file.
                Some([0xff, ..] | []) | None => {
                    self.beyond += 8;
                    0
                }
                Some([byte, ..]) => {
                    self.at += 1;
                    *byte
                }
            };
            self.next |= u64::from(byte) << (ENOUGH - self.count);
            self.count += 8;
        }
    }

    /// Goes on by up to 31 bits.
    #[inline]
    fn pass(&mut self, bits: u32) {
        self.next <<= bits & 31;
        self.count -= bits;
    }

    /// Whether more bits were taken than there are.
    const fn is_past_the_end(&self) -> bool {
        self.beyond > self.count
    }

    /// Goes on behind the marker of the restart with this number, 0 to 7.
    fn restart(&mut self, number: u8) -> Result<(), String> {
        // What is left of the last byte is padding; a whole byte is one too many.
        let left = self.count.saturating_sub(self.beyond);
        let fills = |byte: &&u8| **byte == 0xff;
        let ones = self.bytes[self.at..].iter().take_while(fills).count();
        let marker = self.bytes.get(self.at + ones);
        if self.is_past_the_end() || left >= 8 || ones == 0 || marker != Some(&(0xd0 + number)) {
            return Err(damaged("a restart is missing"));
        }
        *self = Self {
            at: self.at + ones + 1,
            ..Self::new(self.bytes)
        };
        Ok(())
    }
}

/// Whether one of the eight bytes is 0xff.
const fn has_ones(word: u64) -> bool {
    const EACH: u64 = u64::MAX / 255;
    let zeros = !word;
    zeros.wrapping_sub(EACH) & word & (EACH << 7) != 0
}

/// What is read of a file in which way.
#[derive(Debug, Default)]
pub(super) struct Tables {
    /// Of each component: of first coefficients, and of the others.
    codes: [[Table; 2]; 3],
}

/// The part of a picture that is wanted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// First column and row.
    pub from: [usize; 2],
    /// Columns and rows.
    pub side: usize,
}

impl Tables {
    /// Reads the window's brightness into `grey`, row-major. `file` is what `header` is of.
    ///
    /// # Errors
    /// What is wrong with the bits.
    pub(super) fn read(
        &mut self,
        file: &[u8],
        header: &Header,
        window: Window,
        grey: &mut Vec<u8>,
    ) -> Result<(), String> {
        for (tables, component) in self.codes.iter_mut().zip(&header.components) {
            for ((table, codes), number) in tables.iter_mut().zip(&header.codes).zip(component.codes) {
                table.set(codes[number])?;
            }
        }
        let factors = transform::factors(&header.steps);
        let [across, down] = header.components[0].blocks;
        let [units_x, units_y] = header.units();
        let last_row = window.from[1] + window.side - 1;
        let units_y = units_y.min(last_row / (BLOCK * down) + 1);
        let is_within = |blocks: usize, axis: usize| {
            let from = blocks * BLOCK;
            from + BLOCK > window.from[axis] && from < window.from[axis] + window.side
        };
        let [brightness, colours @ ..] = &self.codes;
        grey.resize(window.side * window.side, 0);

        let mut bits = Bits::new(&file[header.bits_at.min(file.len())..]);
        let mut block = [0.0; COEFFICIENTS];
        let mut first = 0_i32;
        let mut units_left = header.restart;
        let mut restarts = 0_u8;
        for unit_y in 0..units_y {
            for unit_x in 0..units_x {
                if header.restart > 0 {
                    if units_left == 0 {
                        bits.restart(restarts & 7)?;
                        restarts = restarts.wrapping_add(1);
                        units_left = header.restart;
                        first = 0;
                    }
                    units_left -= 1;
                }
                for row in (0..down).map(|row| unit_y * down + row) {
                    for column in (0..across).map(|column| unit_x * across + column) {
                        first = first.wrapping_add(i32::from(first_of(&mut bits, &brightness[0])?));
                        if is_within(column, 0) && is_within(row, 1) {
                            let value = first as f32 * factors[0];
                            let pixels =
                                if others_of::<true>(&mut bits, &brightness[1], &factors, &mut block)? {
                                    block[0] = value;
                                    let pixels = transform::pixels(&block);
                                    block = [0.0; COEFFICIENTS];
                                    pixels
                                } else {
                                    transform::flat(value)
                                };
                            put(&pixels, [column, row], window, grey);
                        } else {
                            pass_others(&mut bits, &brightness[1])?;
                        }
                    }
                }
                for (component, colour) in header.components[1..].iter().zip(colours) {
                    for _ in 0..component.blocks[0] * component.blocks[1] {
                        first_of(&mut bits, &colour[0])?;
                        pass_others(&mut bits, &colour[1])?;
                    }
                }
            }
            if bits.is_past_the_end() {
                return Err(damaged("it ends too early"));
            }
        }
        Ok(())
    }
}

fn no_code() -> String {
    damaged("bits that are no code")
}

/// Symbol behind a look that did not have its number in sight; its code is passed.
#[inline]
fn symbol_of(bits: &mut Bits, table: &Table, look: u32) -> Result<u8, String> {
    let (symbol, length) = if look == 0 {
        table.find(bits.next).ok_or_else(no_code)?
    } else {
        ((look >> 16) as u8, look & 0xff)
    };
    bits.pass(length);
    Ok(symbol)
}

/// The number of 1 to 15 bits that comes next.
#[inline]
fn number_of(bits: &mut Bits, size: u32) -> i16 {
    let number = extended((bits.next >> (u64::BITS - size)) as u32, size);
    bits.pass(size);
    number
}

/// The difference of a block's first coefficient to the last one's.
#[inline]
fn first_of(bits: &mut Bits, table: &Table) -> Result<i16, String> {
    bits.fill();
    let look = table.look(bits.next);
    // There is no run of zeros before it.
    if look & 0xff00 == 0x100 {
        bits.pass(look & 0xff);
        return Ok((look >> 16) as i16);
    }
    if look & 0xff00 != 0 {
        return Err(no_code());
    }
    match symbol_of(bits, table, look)? {
        0 => Ok(0),
        size @ 1..=15 => Ok(number_of(bits, size.into())),
        _ => Err(no_code()),
    }
}

/// The other coefficients of a block: each times its factor into `block`, where it is to be kept. Returns whether there are any.
#[inline]
fn others_of<const KEPT: bool>(
    bits: &mut Bits,
    table: &Table,
    factors: &[f32; 2 * COEFFICIENTS],
    block: &mut Block,
) -> Result<bool, String> {
    let mut at = 0;
    let mut keep = |at: usize, number: i32| {
        if KEPT {
            let place = at & (2 * COEFFICIENTS - 1);
            block[usize::from(PLACES[place] & 63)] = number as f32 * factors[place];
        }
    };
    // At most 15 and one go on from the last but one.
    'fill: while at < COEFFICIENTS - 1 {
        bits.fill();
        // What is there is enough for so many looks.
        for _ in 0..ENOUGH / LOOK {
            let look = table.look(bits.next);
            if look & 0xff00 == 0 {
                bits.fill();
                let symbol = symbol_of(bits, table, look)?;
                let (run, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
                if size > 0 {
                    at += run + 1;
                    let number = number_of(bits, size);
                    keep(at, number.into());
                } else if run == 15 {
                    at += 16;
                } else {
                    return Ok(at > 0);
                }
                continue 'fill;
            }
            at += (look >> 8 & 0xff) as usize;
            bits.pass(look & 0xff);
            keep(at, (look as i32) >> 16);
            if at >= COEFFICIENTS - 1 {
                break 'fill;
            }
        }
    }
    if at < COEFFICIENTS {
        Ok(true)
    } else {
        Err(damaged("a block of more than 64 coefficients"))
    }
}

/// Passes over a block's other coefficients.
fn pass_others(bits: &mut Bits, table: &Table) -> Result<(), String> {
    let nothing = [0.0; 2 * COEFFICIENTS];
    others_of::<false>(bits, table, &nothing, &mut [0.0; COEFFICIENTS]).map(drop)
}

/// Puts what lies within the window of a block where it belongs. `block`: its column and row among blocks.
#[inline]
fn put(pixels: &Pixels, block: [usize; 2], window: Window, grey: &mut [u8]) {
    let [left, top] = [0, 1].map(|axis| (block[axis] * BLOCK) as isize - window.from[axis] as isize);
    let side = window.side as isize;
    if left >= 0 && left + BLOCK as isize <= side {
        for (y, row) in (top..).zip(pixels).filter(|(y, _)| (0..side).contains(y)) {
            let at = (y * side + left) as usize;
            grey[at..at + BLOCK].copy_from_slice(row);
        }
        return;
    }
    for (y, row) in (top..).zip(pixels).filter(|(y, _)| (0..side).contains(y)) {
        for (x, level) in (left..).zip(row).filter(|(x, _)| (0..side).contains(x)) {
            grey[(y * side + x) as usize] = *level;
        }
    }
}
