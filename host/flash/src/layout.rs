//! The sectors of a chip, as its bootloader names them in a string descriptor (UM0424, section 10.3.2):
//! `@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg`.

/// First address of the flash.
pub const FLASH: u32 = 0x0800_0000;
/// The name that the flash has there.
pub const INTERNAL_FLASH: &str = "@Internal Flash";

/// A sector: what is erased at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sector {
    /// First address.
    pub address: u32,
    /// Length.
    pub bytes: u32,
    /// It may be erased and written.
    pub is_writable: bool,
}

impl Sector {
    /// The address behind it.
    #[must_use]
    pub fn end(&self) -> u32 {
        self.address + self.bytes
    }
}

/// The sectors that the string names, in the order of their addresses; `None` when it is not one of the internal flash.
#[must_use]
pub fn sectors(name: &str) -> Option<Vec<Sector>> {
    let rest = name.strip_prefix(INTERNAL_FLASH)?;
    let mut fields = rest.split('/').skip(1);
    let mut sectors = Vec::new();
    while let Some(address) = fields.next() {
        let mut address = u32::from_str_radix(address.trim().strip_prefix("0x")?, 16).ok()?;
        for group in fields.next()?.split(',') {
            let (count, size) = group.trim().split_once('*')?;
            let kind = size.chars().last()?;
            let size = &size[..size.len() - kind.len_utf8()];
            let unit = size.chars().last()?;
            let (digits, factor) = match unit {
                'K' => (&size[..size.len() - 1], 1 << 10),
                'M' => (&size[..size.len() - 1], 1 << 20),
                'B' | ' ' => (&size[..size.len() - 1], 1),
                _ => (size, 1),
            };
            let bytes = digits.parse::<u32>().ok()?.checked_mul(factor)?;
            // Bits of the letter: readable, erasable, writable.
            let rights = (kind as u32) & 0b111;
            for _ in 0..count.parse::<u16>().ok()? {
                sectors.push(Sector {
                    address,
                    bytes,
                    is_writable: rights & 0b110 == 0b110,
                });
                address = address.checked_add(bytes)?;
            }
        }
    }
    (!sectors.is_empty()).then_some(sectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sectors_of_both_boards_are_read() {
        let one = sectors("@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg").unwrap();
        assert_eq!(one.len(), 12);
        assert_eq!(one.iter().map(|sector| sector.bytes).sum::<u32>(), 1 << 20);
        assert_eq!((one[3].address, one[3].bytes), (0x0800_C000, 16 << 10));
        assert_eq!((one[5].address, one[5].bytes), (0x0802_0000, 128 << 10));
        assert!(one.iter().all(|sector| sector.is_writable));
        let two =
            sectors("@Internal Flash   /0x08000000/04*016Kg,01*064Kg,07*128Kg,04*016Kg,01*064Kg,07*128Kg");
        assert_eq!(two.unwrap().last().unwrap().end(), 0x0820_0000);
    }

    #[test]
    fn what_may_not_be_written_and_other_memories_are_told_apart() {
        let fixed = sectors("@Internal Flash /0x08000000/01*016Ka,01*016Kg").unwrap();
        assert_eq!(
            fixed.iter().map(|sector| sector.is_writable).collect::<Vec<_>>(),
            [false, true]
        );
        for other in [
            "@Option Bytes  /0x1FFFC000/01*016 e",
            "@Internal Flash",
            "@Internal Flash /8000000/01*016Kg",
            "@Internal Flash /0x08000000/",
            "@Internal Flash /0x08000000/16Kg",
            "@Internal Flash /0x08000000/01*9999Mg",
            "@Internal Flash /0x08000000/01*",
            "",
        ] {
            assert_eq!(sectors(other), None, "{other}");
        }
    }
}
