//! The way into the chip's own bootloader in its system memory, which takes a new image over USB (AN2606, AN3156).
//!
//! A word in memory that survives a reset asks for it, and the chip restarts: the bootloader finds the chip as a reset leaves it, with
//! the watchdog off. The word is cleared before the jump, so whatever happens there, the next start is one of the program. When the
//! bootloader hands over to a new image, that restarts once more, to begin as a reset leaves it too.
//! Limits: the DAC is off meanwhile, and the fault output low.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;

struct Word(UnsafeCell<MaybeUninit<u32>>);

// SAFETY: written by `restart`, when nothing else uses it, and by `enter_if_asked`, before anything else runs.
unsafe impl Sync for Word {}

#[unsafe(link_section = ".uninit.gripline_bootloader")]
static WORD: Word = Word(UnsafeCell::new(MaybeUninit::uninit()));

/// The next start goes to the bootloader.
const ASKED: u32 = 0xB007_10AD;
/// The start before went to the bootloader.
const VISITED: u32 = 0x0FF2_0AD5;

/// The bootloader's vector table: the start of the system memory (reference manual, section 2.4).
const SYSTEM_MEMORY: u32 = 0x1FFF_0000;
/// The upper twelve bits of an address in SRAM, where its stack must lie.
const SRAM: u32 = 0x200;
/// Reset flags and the one of a reset by software (section 7.3.21).
const RCC_CSR: u32 = 0x4002_3874;
const SOFTWARE_RESET: u32 = 1 << 28;
/// The clock of SYSCFG (section 7.3.14), and what lies at address 0 (section 9.2.1).
const RCC_APB2ENR: u32 = 0x4002_3844;
const SYSCFG_ENABLE: u32 = 1 << 14;
const SYSCFG_MEMRMP: u32 = 0x4001_3800;
const VECTOR_TABLE: u32 = 0xE000_ED08;
/// The core's reset request (ARM DDI 0403, B3.2.6).
const AIRCR: u32 = 0xE000_ED0C;
const REQUEST_RESET: u32 = 0x05FA_0004;

/// Restarts the chip in its bootloader.
pub(crate) fn restart() -> ! {
    // SAFETY: nothing holds a reference into `WORD`.
    unsafe { WORD.0.get().cast::<u32>().write_volatile(ASKED) };
    SCB::sys_reset()
}

/// Jumps to the bootloader when the start before asked for it; otherwise returns. A chip whose system memory does not look like a
/// bootloader starts its program.
///
/// # Safety
/// Called by the start-up code, once, before anything else.
#[unsafe(naked)]
pub(crate) unsafe extern "C" fn enter_if_asked() {
    naked_asm!(
        "ldr r0, ={word}",
        "ldr r1, [r0]",
        "movs r2, #0",
        "str r2, [r0]",
        "ldr r2, ={asked}",
        "cmp r1, r2",
        "beq 1f",
        "ldr r2, ={visited}",
        "cmp r1, r2",
        "bne 9f",
        // Back from the bootloader.
        "ldr r0, ={aircr}",
        "ldr r1, ={request_reset}",
        "dsb",
        "str r1, [r0]",
        "dsb",
        "2:",
        "b 2b",
        // Only a reset by software is ours: what is in the memory after power-on is chance.
        "1:",
        "ldr r1, ={csr}",
        "ldr r1, [r1]",
        "tst r1, #{software_reset}",
        "beq 9f",
        "ldr r3, ={system_memory}",
        "ldrd r1, r2, [r3]",
        "lsr r12, r1, #20",
        "cmp r12, #{sram}",
        "bne 9f",
        "eor r12, r2, r3",
        "lsrs r12, r12, #15",
        "bne 9f",
        "ldr r12, ={visited}",
        "str r12, [r0]",
        // The bootloader expects the system memory at address 0, as BOOT0 would put it there.
        "ldr r0, ={apb2enr}",
        "ldr r12, [r0]",
        "orr r12, r12, #{syscfg_enable}",
        "str r12, [r0]",
        "ldr r12, [r0]",
        "ldr r0, ={memrmp}",
        "mov r12, #1",
        "str r12, [r0]",
        "ldr r0, ={vector_table}",
        "str r3, [r0]",
        "dsb",
        "msr msp, r1",
        "isb",
        "bx r2",
        "9:",
        "bx lr",
        word = sym WORD,
        asked = const ASKED,
        visited = const VISITED,
        aircr = const AIRCR,
        request_reset = const REQUEST_RESET,
        csr = const RCC_CSR,
        software_reset = const SOFTWARE_RESET,
        system_memory = const SYSTEM_MEMORY,
        sram = const SRAM,
        apb2enr = const RCC_APB2ENR,
        syscfg_enable = const SYSCFG_ENABLE,
        memrmp = const SYSCFG_MEMRMP,
        vector_table = const VECTOR_TABLE,
    )
}
