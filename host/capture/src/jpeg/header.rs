//! What stands in a JPEG before its pixels (ITU-T T.81, annex B): size, components, tables. Pure; borrows from the file.

use super::huffman::{self, Code};

/// Tables of one kind that a file can have at once.
const TABLES: usize = 4;
/// Coefficients of a block.
pub(super) const COEFFICIENTS: usize = 64;

/// One of brightness and colours.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Component {
    id: u8,
    /// Blocks of a unit of the scan, across and down.
    pub blocks: [usize; 2],
    quantisation: usize,
    /// Numbers of its tables of Huffman codes: of the first coefficient, and of the others.
    pub codes: [usize; 2],
}

/// Everything up to the first scan's bits.
#[derive(Debug)]
pub(super) struct Header<'a> {
    /// Columns and rows.
    pub pixels: [usize; 2],
    /// The kind that [`super::scan`] reads: sequential Huffman codes, 8 bits, brightness first and at full resolution, in a scan
    /// of its own or with all colours. Of others only what stands above is known.
    pub is_plain: bool,
    /// Those of the first scan: one, or three.
    pub components: Vec<Component>,
    /// Of the first component, in the order of the zigzag.
    pub steps: [u16; COEFFICIENTS],
    /// Codes of first coefficients, and of the others.
    pub codes: [[Code<'a>; TABLES]; 2],
    /// Units of the scan between two restarts; 0 without.
    pub restart: usize,
    /// Where the bits begin.
    pub bits_at: usize,
}

/// What is said of a file that ends or speaks nonsense.
pub(super) fn damaged(what: &str) -> String {
    format!("found a damaged JPEG ({what})")
}

/// Segments under way.
struct Reader<'a> {
    header: Header<'a>,
    steps: [Option<[u16; COEFFICIENTS]>; TABLES],
    has_frame: bool,
    has_colours: bool,
    /// Adobe's word on colours, 1 for brightness and two colours.
    adobe: Option<u8>,
}

impl<'a> Header<'a> {
    /// Reads up to the bits of the first scan.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub(super) fn read(file: &'a [u8]) -> Result<Self, String> {
        if !file.starts_with(&[0xff, 0xd8]) {
            return Err("found no JPEG (it does not begin with SOI)".to_owned());
        }
        let mut reader = Reader {
            header: Header {
                pixels: [0; 2],
                is_plain: true,
                components: Vec::new(),
                steps: [0; COEFFICIENTS],
                codes: huffman::standard(),
                restart: 0,
                bits_at: 0,
            },
            steps: [None; TABLES],
            has_frame: false,
            has_colours: false,
            adobe: None,
        };
        let mut at = 2;
        loop {
            let cut = || {
                damaged(if reader.has_frame {
                    "no scan"
                } else {
                    "no frame header"
                })
            };
            let [0xff, marker, ..] = file.get(at..).ok_or_else(cut)? else {
                return Err(cut());
            };
            // Fill bytes may stand before a marker.
            if *marker == 0xff {
                at += 1;
                continue;
            }
            let [high, low, ..] = file.get(at + 2..).ok_or_else(cut)? else {
                return Err(cut());
            };
            let length = usize::from(u16::from_be_bytes([*high, *low]));
            let content = file.get(at + 4..at + 2 + length.max(2)).ok_or_else(cut)?;
            match marker {
                // SOF0 to SOF15 without the tables that share the range.
                0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(marker) => {
                    reader.frame(*marker, content)?;
                    if !reader.header.is_plain {
                        return Ok(reader.header);
                    }
                }
                0xc4 => reader.codes(content)?,
                0xdb => reader.steps(content)?,
                0xdd => {
                    let [high, low] = *content else {
                        return Err(damaged("a restart interval of a wrong length"));
                    };
                    reader.header.restart = usize::from(u16::from_be_bytes([high, low]));
                }
                0xee if content.starts_with(b"Adobe") => reader.adobe = content.get(11).copied(),
                0xda if reader.has_frame => {
                    reader.scan(content)?;
                    reader.header.bits_at = at + 2 + length;
                    return Ok(reader.header);
                }
                0xda | 0xd9 => return Err(cut()),
                _ => {}
            }
            at += 2 + length;
        }
    }

    /// Whether colours have fewer numbers than the brightness down, and not as few across.
    pub(super) fn is_tall(&self) -> bool {
        let blocks = self.components.first().map_or([1; 2], |first| first.blocks);
        self.components.len() > 1 && blocks[1] > blocks[0]
    }

    /// Units of the scan, across and down: 8×8 pixels for each block of the first component.
    pub(super) fn units(&self) -> [usize; 2] {
        let blocks = self.components.first().map_or([1; 2], |first| first.blocks);
        [0, 1].map(|axis| self.pixels[axis].div_ceil(8 * blocks[axis].max(1)))
    }
}

impl<'a> Reader<'a> {
    /// SOF: size and components.
    fn frame(&mut self, marker: u8, content: &'a [u8]) -> Result<(), String> {
        let short = || damaged("no frame header");
        let [bits, y1, y0, x1, x0, count, components @ ..] = content else {
            return Err(short());
        };
        let header = &mut self.header;
        header.pixels = [[*x1, *x0], [*y1, *y0]].map(|bytes| usize::from(u16::from_be_bytes(bytes)));
        if components.len() < 3 * usize::from(*count) {
            return Err(short());
        }
        header.components = components
            .chunks_exact(3)
            .take(usize::from(*count))
            .map(|component| Component {
                id: component[0],
                blocks: [component[1] >> 4, component[1] & 15].map(usize::from),
                quantisation: usize::from(component[2]),
                codes: [0; 2],
            })
            .collect();
        let is_first_the_finest = header.components.first().is_some_and(|first| {
            let fits = |component: &Component| {
                (0..2).all(|axis| {
                    let blocks = component.blocks[axis];
                    blocks > 0 && blocks <= first.blocks[axis] && first.blocks[axis] <= 4
                })
            };
            header.components.iter().all(fits)
        });
        header.is_plain = !self.has_frame
            && [0xc0, 0xc1].contains(&marker)
            && *bits == 8
            && [1, 3].contains(&header.components.len())
            && is_first_the_finest
            && !header.components.iter().map(|c| c.id).eq(*b"RGB");
        self.has_frame = true;
        self.has_colours = header.components.len() > 1;
        Ok(())
    }

    /// DHT: tables of codes, one after the other.
    fn codes(&mut self, mut content: &'a [u8]) -> Result<(), String> {
        while let Some((kind, rest)) = content.split_first() {
            let (code, rest) = Code::read(rest).ok_or_else(|| damaged("a table of codes is cut short"))?;
            let (class, number) = (usize::from(kind >> 4), usize::from(kind & 15));
            let place = self.header.codes.get_mut(class).and_then(|of| of.get_mut(number));
            *place.ok_or_else(|| damaged("a table of codes without a place"))? = code;
            content = rest;
        }
        Ok(())
    }

    /// DQT: steps of quantisation, one table after the other.
    fn steps(&mut self, mut content: &'a [u8]) -> Result<(), String> {
        while let Some((kind, rest)) = content.split_first() {
            let bytes = if kind >> 4 == 0 { 1 } else { 2 };
            let short = || damaged("a table of steps is cut short");
            let (table, rest) = rest.split_at_checked(bytes * COEFFICIENTS).ok_or_else(short)?;
            let mut steps = [0; COEFFICIENTS];
            for (step, value) in steps.iter_mut().zip(table.chunks_exact(bytes)) {
                *step = value.iter().fold(0, |step, byte| step << 8 | u16::from(*byte));
            }
            let place = self.steps.get_mut(usize::from(kind & 15));
            *place.ok_or_else(|| damaged("a table of steps without a place"))? = Some(steps);
            content = rest;
        }
        Ok(())
    }

    /// SOS: which tables of codes the components take.
    fn scan(&mut self, content: &[u8]) -> Result<(), String> {
        let header = &mut self.header;
        let wrong = || damaged("a scan header that does not fit");
        let (count, rest) = content.split_first().ok_or_else(wrong)?;
        if *count == 1 {
            // A component alone has a block a unit, whatever it says of itself (A.2.2).
            header.components.truncate(1);
            header.components[0].blocks = [1; 2];
        }
        // Colours without a brightness, or scan after scan.
        let has_no_brightness = self.adobe.is_some_and(|colours| colours != 1) && self.has_colours;
        header.is_plain = !has_no_brightness && usize::from(*count) == header.components.len();
        if !header.is_plain {
            return Ok(());
        }
        let chosen = rest.chunks_exact(2).take(header.components.len());
        for (component, chosen) in header.components.iter_mut().zip(chosen.clone()) {
            if component.id != chosen[0] {
                return Err(wrong());
            }
            component.codes = [chosen[1] >> 4, chosen[1] & 15].map(usize::from);
            if component.codes.iter().any(|number| *number >= TABLES) {
                return Err(wrong());
            }
        }
        if chosen.len() < header.components.len() {
            return Err(wrong());
        }
        let first = header.components[0].quantisation;
        header.steps = (self.steps.get(first).copied().flatten())
            .ok_or_else(|| damaged("no table of steps for the brightness"))?;
        Ok(())
    }
}
