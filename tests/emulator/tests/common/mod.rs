//! Tiny images for the tests: hand-assembled Thumb code in an ELF file.

/// Where the part's flash starts, and the vector table of an image that boots.
pub(crate) const FLASH: u32 = 0x0800_0000;

/// An ELF file for Arm that loads two vectors (a stack and the start of `code`) and then `code` at `base`.
pub(crate) fn elf_at(base: u32, code: &[u16]) -> Vec<u8> {
    const HEADER: u32 = 52;
    const PROGRAM_HEADER: u32 = 32;
    const STACK_TOP: u32 = 0x2000_1000;
    const THUMB: u32 = 1;
    let words = |values: &[u32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let halves = |values: &[u16]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let entry = FLASH + 8 + THUMB;
    let bytes = [words(&[STACK_TOP, entry]), halves(code)].concat();
    let size = bytes.len() as u32;
    [
        b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec(),
        halves(&[2, 40]), // executable, for Arm
        words(&[1, entry, HEADER, 0, 0x0500_0000]),
        halves(&[HEADER as u16, PROGRAM_HEADER as u16, 1, 0, 0, 0]), // one program header, no sections
        words(&[1, HEADER + PROGRAM_HEADER, base, base, size, size, 5, 4]), // loaded, readable and executable
        bytes,
    ]
    .concat()
}
