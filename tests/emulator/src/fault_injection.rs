//! Fault injection: the instruction that touches a given address is overwritten, until the next reset. Which task
//! that is follows from the address: the DAC's is the map-to-line path's, the watchdog's the idle loop's.

use gripline_emulator_wire::FaultInjection;
use rigless::emulator::{Access, Host};
use rigless::soc::Width;

/// The function that every panic of the firmware ends in.
pub(crate) const PANIC: &str = "gripline_panic";

/// `b .` in Thumb (ARM DDI 0403, A7.7.12, encoding T2).
const BRANCH_TO_ITSELF: u16 = 0xE7FE;
/// `udf #0` (A7.7.194, encoding T1).
const UNDEFINED: u16 = 0xDE00;
/// `push {r0-r7, lr}` (A7.7.99, encoding T1) and a branch back to it.
const PUSH_FOR_EVER: [u16; 2] = [0xB5FF, 0xE7FD];
/// Where the jump to the panic stands: the end of the memory for code in RAM, which no image fills.
const ISLAND: u64 = 0x2001_FFF0;
/// `bx r12` (A7.7.20).
const BRANCH_BY_REGISTER: u16 = 0x4760;
/// `movw r12, #…` and `movt r12, #…` without the number (A7.7.76, encoding T3; A7.7.79), and the place of the register.
const MOVE_LOW: u16 = 0xF240;
const MOVE_HIGH: u16 = 0xF2C0;
const R12: u16 = 12 << 8;

/// A fault that was asked for, or that lasts.
#[derive(Debug, Default)]
pub(crate) struct Injector {
    asked: Option<(FaultInjection, u32)>,
    /// Where the image's panics go, if it says so.
    panics_at: Option<u32>,
    /// Address and half-word of what was overwritten.
    overwritten: Vec<(u64, u64)>,
    /// The restarts before.
    resets: usize,
}

impl Injector {
    pub(crate) fn new(panics_at: Option<u32>) -> Self {
        Self {
            panics_at,
            ..Self::default()
        }
    }

    /// At the next touch of `address`.
    pub(crate) fn ask(&mut self, fault: FaultInjection, address: u32) {
        self.asked = Some((fault, address));
    }

    /// After every access that the core made.
    pub(crate) fn settled(&mut self, access: &Access, host: &mut dyn Host) {
        let (Some((fault, address)), Some(at)) = (self.asked, access.program_counter) else {
            return;
        };
        if u64::from(address) != access.address {
            return;
        }
        self.asked = None;
        let code = match (fault, self.panics_at) {
            (FaultInjection::Hang, _) => vec![BRANCH_TO_ITSELF],
            (FaultInjection::StackOverflow, _) => PUSH_FOR_EVER.to_vec(),
            // An image that does not say where its panics go has none that differ from a fault.
            (FaultInjection::UndefinedInstruction, _) | (FaultInjection::Panic, None) => vec![UNDEFINED],
            // Four bytes at the place itself; whatever is reached by a branch behind it stays what it was.
            (FaultInjection::Panic, Some(target)) => branch(at, target.into()).unwrap_or_else(|| {
                for (place, half_word) in (ISLAND..).step_by(2).zip(jump(target)) {
                    put(host, place, half_word.into());
                }
                branch(at, ISLAND).unwrap_or_else(|| jump(target))
            }),
        };
        for (at, half_word) in (at..).step_by(2).zip(code) {
            if let Ok(before) = host.read(at, Width::W16) {
                self.overwritten.push((at, before));
                put(host, at, half_word.into());
            }
        }
    }

    /// At every stop, with the restarts so far: the first one after the fault heals it.
    pub(crate) fn restarted(&mut self, resets: usize, host: &mut dyn Host) {
        if resets != self.resets {
            self.resets = resets;
            for (at, before) in self.overwritten.drain(..) {
                put(host, at, before);
            }
        }
    }
}

/// `b.w` (A7.7.12, encoding T4), if the target is within 16 MiB.
fn branch(at: u64, target: u64) -> Option<Vec<u16>> {
    let offset = target.cast_signed() - (at.cast_signed() + 4);
    if !(-(1 << 24)..1 << 24).contains(&offset) {
        return None;
    }
    let bit = |place: u32| (offset >> place & 1) as u16;
    let sign = bit(24);
    let [first, second] = [bit(23), bit(22)].map(|bit| !(bit ^ sign) & 1);
    let high = 0xF000 | sign << 10 | (offset >> 12 & 0x3FF) as u16;
    let low = 0x9000 | first << 13 | second << 11 | (offset >> 1 & 0x7FF) as u16;
    Some(vec![high, low])
}

/// The half-words of a jump to anywhere: `movw r12`, `movt r12`, `bx r12`.
fn jump(target: u32) -> Vec<u16> {
    let moved = |name: u16, half: u32| {
        let half = half as u16;
        [
            name | half >> 12 | (half >> 11 & 1) << 10,
            (half >> 8 & 7) << 12 | R12 | half & 0xFF,
        ]
    };
    // The lowest bit says Thumb.
    let target = target | 1;
    let mut code = moved(MOVE_LOW, target & 0xFFFF).to_vec();
    code.extend(moved(MOVE_HIGH, target >> 16));
    code.push(BRANCH_BY_REGISTER);
    code
}

/// Code lies in flash or in RAM.
fn put(host: &mut dyn Host, at: u64, half_word: u64) {
    let programmed = host.program(at, Width::W16, half_word);
    if programmed.is_err() {
        // RAM: the start-up code brings the right code back by itself as well.
        let _ = host.write(at, Width::W16, half_word);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As an assembler writes `b.w .+0x1000` and `b.w .-0x1000`.
    #[test]
    fn a_branch_is_what_an_assembler_writes() {
        assert_eq!(branch(0x2000_0000, 0x2000_1000), Some(vec![0xF000, 0xBFFE]));
        assert_eq!(branch(0x2000_1000, 0x2000_0000), Some(vec![0xF7FE, 0xBFFE]));
        assert_eq!(branch(0x2000_0000, 0x0800_0000), None);
    }

    /// As an assembler writes `movw r12, #0xABCD; movt r12, #0x1234; bx r12`.
    #[test]
    fn a_jump_is_what_an_assembler_writes() {
        assert_eq!(jump(0x1234_ABCC), [0xF64A, 0x3CCD, 0xF2C1, 0x2C34, 0x4760]);
    }
}
