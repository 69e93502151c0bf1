//! The work per taxel in the Cortex-M4's own instructions: two half-words a multiplication, two taxels a round.
//!
//! Twin of [`gripline_firmware::sums::Portable`], and equal to it: the tests on the emulated board compare every sum.
//! The compiler finds neither SMLSDX nor UMAAL here, spills its sums, and takes 68 instructions for what takes 21.
//! Limits: packets that lie at an address that words may not have go the portable way.

use core::arch::naked_asm;

use gripline_firmware::sums::{Accumulator, Kernel, Portable};
use gripline_protocol::Place;
use gripline_protocol::constants::TAXEL_BYTES;

/// This chip's kernel.
pub(crate) struct Dsp;

impl Kernel for Dsp {
    #[inline]
    fn add(sums: &mut Accumulator, places: &[Place], bytes: &[[u8; TAXEL_BYTES]]) {
        let count = bytes.len();
        if !bytes.as_ptr().addr().is_multiple_of(align_of::<u32>()) || places.len() < count {
            return Portable::add(sums, places, bytes);
        }
        let pairs = count / 2;
        if pairs > 0 {
            // SAFETY: both slices have two items for every pair, the bytes lie as words must, and places are words.
            unsafe { add_pairs(sums, places.as_ptr(), bytes.as_ptr(), pairs) };
        }
        let (Some(place), Some(&[x0, x1, y0, y1, z0, z1])) = (places.get(2 * pairs), bytes.get(2 * pairs))
        else {
            return;
        };
        // One that is left over, with one that has no force and is in no contact.
        let places = [*place, Place::default()];
        let words = [
            u32::from_le_bytes([x0, x1, y0, y1]),
            u32::from_le_bytes([z0, z1, 0, 0]),
            0,
        ];
        // SAFETY: a pair of both, in words.
        unsafe { add_pairs(sums, places.as_ptr(), words.as_ptr().cast(), 1) };
    }
}

/// Adds two taxels a round. The sums go by the order of [`Accumulator`]'s fields, which is fixed.
///
/// # Safety
/// `places` and `taxels` have 2 × `pairs` items, `pairs` is at least 1, and `taxels` is aligned to four bytes.
#[unsafe(naked)]
#[unsafe(link_section = ".hot.add_pairs")]
unsafe extern "C" fn add_pairs(
    sums: &mut Accumulator,
    places: *const Place,
    taxels: *const [u8; TAXEL_BYTES],
    pairs: usize,
) {
    naked_asm!(
        "push {{r0, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, lr}}",
        // r4 to r9: sums of fx, fy, fz, moment, column fz, row fz.
        "ldm r0, {{r4, r5, r6, r7, r8, r9}}",
        "1:",
        // r10 to r12: (fx, fy) and fz of the first taxel with fx of the second in the upper half, (fy, fz) of the second.
        "ldm r2!, {{r10, r11, r12}}",
        "ldrd lr, r0, [r1], #8",
        "sxtah r4, r4, r10",
        "add r5, r5, r10, asr #16",
        "sxtah r6, r6, r11",
        "smlsdx r7, lr, r10, r7",
        "smlabb r8, lr, r11, r8",
        "smlatb r9, lr, r11, r9",
        "add r4, r4, r11, asr #16",
        "sxtah r5, r5, r12",
        "add r6, r6, r12, asr #16",
        // (fy, fx) of the second.
        "pkhbt r10, r12, r11",
        "smlsd r7, r0, r10, r7",
        "smlabt r8, r0, r12, r8",
        "smlatt r9, r0, r12, r9",
        "subs r3, r3, #1",
        "bne 1b",
        "pop {{r0, r2, r3}}",
        "stm r0!, {{r4, r5, r6, r7, r8, r9}}",
        // r4: not in contact, r5: slips, r6 and r7: the square of friction, r8: below, r9: taxels.
        "ldm r0, {{r4, r5, r6, r7, r8, r9}}",
        "add r9, r9, r3, lsl #1",
        "str r9, [r0, #20]",
        "push {{r0}}",
        "2:",
        "ldm r2!, {{r10, r11, r12}}",
        "pkhbt r9, r12, r11",
        // The first taxel: shear squared, four normal forces squared, the bound.
        "smuad r10, r10, r10",
        "smulbb lr, r11, r11",
        "lsl lr, lr, #2",
        "umull r1, r0, lr, r6",
        "mov r1, #2",
        "umaal r1, r0, lr, r7",
        // Negative without contact; the flag C says that it sticks.
        "sxtah r11, r8, r11",
        "add r4, r4, r11, lsr #31",
        "cmp r0, r10",
        "sbc r1, r1, r1",
        "bic r1, r1, r11, asr #31",
        "sub r5, r5, r1",
        // The second.
        "smuad r9, r9, r9",
        "smultt lr, r12, r12",
        "lsl lr, lr, #2",
        "umull r1, r0, lr, r6",
        "mov r1, #2",
        "umaal r1, r0, lr, r7",
        "add r12, r8, r12, asr #16",
        "add r4, r4, r12, lsr #31",
        "cmp r0, r9",
        "sbc r1, r1, r1",
        "bic r1, r1, r12, asr #31",
        "sub r5, r5, r1",
        "subs r3, r3, #1",
        "bne 2b",
        "pop {{r0}}",
        "strd r4, r5, [r0]",
        "pop {{r4, r5, r6, r7, r8, r9, r10, r11, pc}}",
    )
}
