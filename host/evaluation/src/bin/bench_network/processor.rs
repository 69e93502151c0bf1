//! Makes this processor look like one with AVX2 and nothing wider, so that engines that choose their instructions by themselves
//! choose as they do there. The processor then traps CPUID, the instruction by which programs ask what it can do, and the kernel
//! sends SIGSEGV instead; the answer is given here. Some processors and virtual machines cannot.

/// Hides what is wider than AVX2 from all that asks from now on, in this thread and in those that it starts. AVX-VNNI stays, as our
/// kernels for AVX2 use it too. Call it before anything asks. Returns whether nothing wider is to be seen: where it never was, too.
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
pub(crate) fn show_no_more_than_avx2() -> bool {
    trap::install();
    !is_x86_feature_detected!("avx512f")
}

/// On other processors there is nothing to hide.
#[cfg(not(all(target_arch = "x86_64", target_os = "linux")))]
pub(crate) fn show_no_more_than_avx2() -> bool {
    true
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
#[expect(
    unsafe_code,
    reason = "a signal's handler that reads and writes the registers of the trapped code"
)]
mod trap {
    use std::arch::x86_64::{__cpuid_count, CpuidResult};
    use std::ffi::{c_int, c_long, c_void};
    use std::mem::zeroed;
    use std::ptr::null_mut;

    use nix::libc;

    /// `arch_prctl(ARCH_SET_CPUID)` of the kernel's asm/prctl.h: 0 traps, 1 does not.
    const ARCH_SET_CPUID: c_long = 0x1012;
    const CPUID: [u8; 2] = [0x0f, 0xa2];

    /// Features of CPUID's leaf 7 (Intel's manual, volume 2A, and its list of extensions): AVX-512 in all its parts, AMX, and in
    /// subleaf 1 AVX-512 BF16, AMX FP16 and COMPLEX, AVX-IFMA, AVX-VNNI-INT8 and INT16, AVX-NE-CONVERT, AVX10.
    const LEAF: u32 = 7;
    const WIDE: [CpuidResult; 2] = [
        CpuidResult {
            eax: 0,
            ebx: bits(&[16, 17, 21, 26, 27, 28, 30, 31]),
            ecx: bits(&[1, 6, 11, 12, 14]),
            edx: bits(&[2, 3, 8, 22, 23, 24, 25]),
        },
        CpuidResult {
            eax: bits(&[5, 21, 23]),
            ebx: 0,
            ecx: 0,
            edx: bits(&[4, 5, 8, 10, 19]),
        },
    ];

    const fn bits(places: &[u32]) -> u32 {
        let (mut sum, mut index) = (0, 0);
        while index < places.len() {
            sum |= 1 << places[index];
            index += 1;
        }
        sum
    }

    /// Traps CPUID from now on, where that can be.
    pub(super) fn install() {
        // SAFETY: the handler calls nothing that allocates or locks; all other fields of the structure may be zero.
        let installed = unsafe {
            let mut action: libc::sigaction = zeroed();
            action.sa_sigaction = answer as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_NODEFER | libc::SA_ONSTACK;
            libc::sigaction(libc::SIGSEGV, &raw const action, null_mut())
        };
        if installed == 0 {
            set(true);
        }
    }

    /// Without effect on a processor or in a virtual machine that cannot trap.
    fn set(trapped: bool) {
        // SAFETY: it changes what CPUID does, and CPUID then ends in `answer`.
        unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_SET_CPUID, c_long::from(!trapped)) };
    }

    /// Answers a trapped CPUID. Any other SIGSEGV ends the program when its instruction is repeated.
    extern "C" fn answer(_: c_int, _: *mut libc::siginfo_t, context: *mut c_void) {
        // SAFETY: with SA_SIGINFO the kernel hands over the context of the code that it stopped, and at its instruction pointer
        // stand the two bytes of an instruction that the processor has just read.
        unsafe {
            let registers = &mut (*context.cast::<libc::ucontext_t>()).uc_mcontext.gregs;
            let instruction = registers[libc::REG_RIP as usize] as *const [u8; 2];
            if *instruction != CPUID {
                libc::signal(libc::SIGSEGV, libc::SIG_DFL);
                return;
            }
            let [leaf, subleaf] =
                [libc::REG_RAX, libc::REG_RCX].map(|register| registers[register as usize] as u32);
            set(false);
            let mut found = __cpuid_count(leaf, subleaf);
            set(true);
            if leaf == LEAF
                && let Some(wide) = WIDE.get(subleaf as usize)
            {
                found.eax &= !wide.eax;
                found.ebx &= !wide.ebx;
                found.ecx &= !wide.ecx;
                found.edx &= !wide.edx;
            }
            for (register, value) in [
                (libc::REG_RAX, found.eax),
                (libc::REG_RBX, found.ebx),
                (libc::REG_RCX, found.ecx),
                (libc::REG_RDX, found.edx),
            ] {
                registers[register as usize] = value.into();
            }
            registers[libc::REG_RIP as usize] += CPUID.len() as i64;
        }
    }
}
