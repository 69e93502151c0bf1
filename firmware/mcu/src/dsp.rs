//! The sums over taxels in the Cortex-M4's DSP instructions: two half-words a multiplication, two taxels a round.
//!
//! Computes exactly what [`gripline_firmware::sums::Portable`] computes: the tests on the emulated board compare every sum.
//! Why assembly: the compiler does not use SMLSDX here and spills the sums; it takes 68 instructions a taxel instead of 23½.
//! Limits: a packet that is not aligned to words takes the portable way.

use core::arch::naked_asm;

use gripline_firmware::friction::UNIT_SQUARE;
use gripline_firmware::sums::{Accumulator, Kernel, Portable};
use gripline_protocol::Place;
use gripline_protocol::constants::TAXEL_BYTES;

/// The kernel of this chip.
pub(crate) struct Dsp;

impl Kernel for Dsp {
    #[inline]
    fn add(sums: &mut Accumulator, places: &[Place], bytes: &[[u8; TAXEL_BYTES]]) {
        let count = bytes.len();
        if !bytes.as_ptr().addr().is_multiple_of(align_of::<u32>()) || places.len() < count {
            return portable(sums, places, bytes);
        }
        let pairs = count / 2;
        if pairs > 0 {
            // SAFETY: both slices have two items for every pair, and the bytes are aligned to words.
            unsafe { add_pairs(sums, places.as_ptr(), bytes.as_ptr(), pairs) };
        }
        if let (Some(&place), Some(&bytes)) = (places.get(2 * pairs), bytes.get(2 * pairs)) {
            // A second taxel without force: it adds nothing and is not in contact.
            let last = Pair([bytes, [0; TAXEL_BYTES]]);
            // SAFETY: two items each, and `Pair` is aligned to words.
            unsafe { add_pair(sums, [place; 2].as_ptr(), last.0.as_ptr(), 1) };
        }
    }
}

/// Two taxels, aligned to words.
#[repr(align(4))]
struct Pair([[u8; TAXEL_BYTES]; 2]);

/// For packets from the UART, which may not be aligned.
#[cold]
#[inline(never)]
fn portable(sums: &mut Accumulator, places: &[Place], bytes: &[[u8; TAXEL_BYTES]]) {
    Portable::add(sums, places, bytes);
}

/// The sums of taxels, two a round; what ends a round is given. It relies on the order of [`Accumulator`]'s fields, which is `repr(C)`.
macro_rules! sums {
    ($(#[$about:meta])* $name:ident, $section:literal, [$($first:literal),*], [$($second:literal),*]) => {
        $(#[$about])*
        #[unsafe(naked)]
        #[unsafe(link_section = $section)]
        unsafe extern "C" fn $name(
            sums: &mut Accumulator,
            places: *const Place,
            taxels: *const [u8; TAXEL_BYTES],
            pairs: usize,
        ) {
            naked_asm!(
                "push {{r0, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, lr}}",
                // r4 to r9: sums of fx, fy, fz, moment, column fz, row fz; r0: of (column² + row²) fz.
                "ldm r0, {{r4, r5, r6, r7, r8, r9}}",
                "ldr r0, [r0, #24]",
                "1:",
                // r10 to r12: (fx, fy) and fz of the first taxel with fx of the second in the upper half, (fy, fz) of the second.
                "ldm r2!, {{r10, r11, r12}}",
                "ldr lr, [r1], #4",
                "sxtah r4, r4, r10",
                "add r5, r5, r10, asr #16",
                "sxtah r6, r6, r11",
                "smlsdx r7, lr, r10, r7",
                "smlabb r8, lr, r11, r8",
                "smlatb r9, lr, r11, r9",
                "smuad lr, lr, lr",
                "smlabb r0, lr, r11, r0",
                "ldr lr, [r1], #4",
                "add r4, r4, r11, asr #16",
                "sxtah r5, r5, r12",
                "add r6, r6, r12, asr #16",
                // (fy, fx) of the second.
                "pkhbt r10, r12, r11",
                "smlsd r7, lr, r10, r7",
                "smlabt r8, lr, r12, r8",
                "smlatt r9, lr, r12, r9",
                "smuad lr, lr, lr",
                "smlabt r0, lr, r12, r0",
                $($first,)*
                "mov r10, r0",
                "pop {{r0, r2, r3}}",
                "stm r0!, {{r4, r5, r6, r7, r8, r9, r10}}",
                // r4: not in contact, r5: slips, r6: the square of friction, r8: below, r9: taxels; r7: minus the square of the unit.
                "ldm r0, {{r4, r5, r6, r8, r9}}",
                "add r9, r9, r3, lsl #1",
                "str r9, [r0, #16]",
                "push {{r0}}",
                "movw r7, #{minus_square_low}",
                "movt r7, #{minus_square_high}",
                "2:",
                "ldm r2!, {{r10, r11, r12}}",
                "pkhbt r9, r12, r11",
                // The first taxel: shear squared s, normal force squared; then friction² n − unit² s, whose upper word is negative
                // when it slips. The second product is s (2³² − unit²), so s is taken from that word.
                "smuad r10, r10, r10",
                "smulbb lr, r11, r11",
                "umull r1, r0, lr, r6",
                "umlal r1, r0, r10, r7",
                "sub r0, r0, r10",
                // Negative without contact.
                "sxtah r11, r8, r11",
                "add r4, r4, r11, lsr #31",
                "bic r0, r0, r11",
                "add r5, r5, r0, lsr #31",
                // The second.
                "smuad r9, r9, r9",
                "smultt lr, r12, r12",
                "umull r1, r0, lr, r6",
                "umlal r1, r0, r9, r7",
                "sub r0, r0, r9",
                "add r12, r8, r12, asr #16",
                "add r4, r4, r12, lsr #31",
                "bic r0, r0, r12",
                "add r5, r5, r0, lsr #31",
                $($second,)*
                "pop {{r0}}",
                "strd r4, r5, [r0]",
                "pop {{r4, r5, r6, r7, r8, r9, r10, r11, pc}}",
                minus_square_low = const UNIT_SQUARE.wrapping_neg() & 0xFFFF,
                minus_square_high = const UNIT_SQUARE.wrapping_neg() >> 16,
            )
        }
    };
}

sums! {
    /// Adds two taxels a round.
    ///
    /// # Safety
    /// `places` and `taxels` have 2 × `pairs` items, `pairs` is at least 1, and `taxels` is aligned to four bytes.
    add_pairs, ".hot.add_pairs", ["subs r3, r3, #1", "bne 1b"], ["subs r3, r3, #1", "bne 2b"]
}

sums! {
    /// Adds two taxels: the same without its loops, so that the bound of the path counts one round.
    ///
    /// # Safety
    /// `places` and `taxels` have 2 items, `pairs` is 1, and `taxels` is aligned to four bytes.
    add_pair, ".hot.add_pair", [], []
}
