//! A recorded run, step by step: which instruction ran, what it cost at most, in which exception, with which masks.
//!
//! Limits: a return that its condition may have skipped, with an exception right behind it, counts as a return.

use std::collections::BTreeSet;

use gripline_emulator::{Event, EventKind};

use crate::Error;
use crate::cycles::{self, Fetch, Memory};
use crate::image::{Flow, Image, Instruction, Masking};

/// One instruction that ran.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// The instruction.
    pub instruction: &'a Instruction,
    /// The peripheral that it accessed.
    pub access: Option<u32>,
    /// Cycles at most, the way into or out of an exception behind it included.
    pub cycles: u32,
    /// The handlers that run, the innermost last; none in a task without priority.
    pub exception: Option<u32>,
    /// Whether interrupts were masked while it ran.
    pub is_masked: bool,
    /// Bulk packets that landed in the FIFO just before it.
    pub deliveries: u32,
    /// Bytes that landed in the UART's receiver just before it.
    pub uart_bytes: u32,
    /// Whether it entered an exception behind this instruction.
    pub enters: bool,
}

/// What landed before an instruction: bulk packets and bytes of the UART.
#[derive(Debug, Clone, Copy, Default)]
struct Landed {
    deliveries: u32,
    uart_bytes: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Frame {
    /// Where it returns to.
    Call(u32),
    /// The same of a call that its condition may have skipped, or that may be over. It lies right below an exception, whose end tells.
    PerhapsCall(u32),
    /// The handler, and the instruction that it returns to where nothing watches the core's arrival there.
    Exception(u32, Option<u32>),
}

/// Goes along a record.
#[derive(Debug)]
pub struct Walk<'a> {
    /// The instructions in the order of their addresses, and the cycles of the core for each.
    code: Vec<(&'a Instruction, u32)>,
    handlers: BTreeSet<u32>,
    frames: Vec<Frame>,
    /// The handler of the innermost exception.
    exception: Option<u32>,
    is_masked: bool,
    fetch: Fetch,
    /// Instructions that the core had run when the pending one ended.
    retired: u64,
    pending: Option<(&'a Instruction, Option<u32>, Landed)>,
    landed: Landed,
}

impl<'a> Walk<'a> {
    /// From power-on.
    #[must_use]
    pub fn new(image: &'a Image) -> Self {
        // The vector table: 16 of the core, 91 of the chip.
        let handlers = (1..107)
            .filter_map(|number| image.word(0x0800_0000 + 4 * number))
            .map(|address| address & !1)
            .collect();
        Self {
            code: image
                .instructions
                .values()
                .map(|one| (one, cycles::core(one)))
                .collect(),
            handlers,
            frames: Vec::new(),
            exception: None,
            is_masked: false,
            fetch: Fetch::default(),
            retired: 0,
            pending: None,
            landed: Landed::default(),
        }
    }

    /// Hands every completed step of these events to `see`; the last instruction waits for the next call. The core's arrivals at
    /// [`Image::entries`] were watched: what it ran in between follows from their counts.
    ///
    /// # Errors
    /// Events that do not fit the image: it runs what is not in it, or comes to an instruction that nothing leads to.
    pub fn take(&mut self, events: &[Event], mut see: impl FnMut(Step<'a>)) -> Result<(), Error> {
        for event in events {
            while self.pending.is_some() && self.retired < event.retired {
                let next = self.unwatched().ok_or_else(|| self.lost(event))?;
                self.begin(next, &mut see);
            }
            match event.kind {
                EventKind::Delivery => self.landed.deliveries += 1,
                EventKind::UartByte => self.landed.uart_bytes += 1,
                EventKind::Access(address) => {
                    if let Some((_, access, _)) = &mut self.pending {
                        *access = Some(address);
                    }
                }
                EventKind::Arrival(address) => {
                    if self.pending.is_none() {
                        self.retired = event.retired;
                    }
                    if self.retired != event.retired || !self.leads_to(address) {
                        return Err(self.lost(event));
                    }
                    let instruction = self.at(address).ok_or_else(|| self.lost(event))?;
                    self.begin(instruction, &mut see);
                }
            }
        }
        Ok(())
    }

    /// The pending instruction ends, this one begins.
    fn begin(&mut self, instruction: &'a Instruction, see: &mut impl FnMut(Step<'a>)) {
        if let Some((before, access, landed)) = self.pending.take() {
            see(self.step(before, access, landed, instruction.address));
        }
        self.retired += 1;
        self.pending = Some((instruction, None, std::mem::take(&mut self.landed)));
    }

    /// Whether the core may come to this address behind the pending instruction; where a jump leads is not asked.
    fn leads_to(&self, address: u32) -> bool {
        self.pending.is_none_or(|(before, ..)| {
            before.flow != Flow::Next || before.next() == address || self.handlers.contains(&address)
        })
    }

    /// What runs behind the pending instruction where nothing watches the core's arrival.
    fn unwatched(&self) -> Option<&'a Instruction> {
        let (before, ..) = self.pending?;
        match before.flow {
            Flow::Next => {
                let (next, _) = self.code.get(before.number + 1)?;
                (next.address == before.next()).then_some(next)
            }
            Flow::Return => match self.frames.last()? {
                Frame::Exception(_, back) => self.at((*back)?),
                Frame::Call(_) | Frame::PerhapsCall(_) => None,
            },
            _ => None,
        }
    }

    fn at(&self, address: u32) -> Option<&'a Instruction> {
        let place = self.code.binary_search_by_key(&address, |(one, _)| one.address);
        place.ok().map(|place| self.code[place].0)
    }

    fn lost(&self, event: &Event) -> Error {
        let before = self.pending.map_or("nothing".to_owned(), |(before, ..)| {
            format!("{:#x} {}, number {}", before.address, before.text, self.retired)
        });
        Error::Unexpected {
            expected: "an instruction of the image, behind the one before".to_owned(),
            found: format!("{event:x?} after {before}"),
        }
    }

    fn step(
        &mut self,
        instruction: &'a Instruction,
        access: Option<u32>,
        landed: Landed,
        next: u32,
    ) -> Step<'a> {
        let exception = self.exception;
        let is_masked = self.is_masked;
        match instruction.masking {
            Masking::DisablesAll => self.is_masked = true,
            // A restored mask counts as lifted: sections inside sections end with the outermost one.
            Masking::EnablesAll => self.is_masked = false,
            _ => {}
        }
        let mut cycles = self.fetch.cost(instruction);
        let memory = access.map_or_else(
            || instruction.data.literal.map_or(Memory::Coupled, Memory::of),
            Memory::of,
        );
        cycles += cycles::data(instruction, memory);
        let is_taken = next != instruction.next();
        cycles += self.code[instruction.number].1;
        if is_taken {
            cycles += cycles::REFILL;
            self.fetch.lose();
        }
        let enters =
            (is_taken || instruction.flow != Flow::Next) && self.follow(instruction, next, &mut cycles);
        Step {
            instruction,
            access,
            cycles,
            exception,
            is_masked,
            deliveries: landed.deliveries,
            uart_bytes: landed.uart_bytes,
            enters,
        }
    }

    /// Keeps calls and exceptions in order; whether an exception was entered.
    fn follow(&mut self, instruction: &Instruction, next: u32, cycles: &mut u32) -> bool {
        let enters = self.change_frames(instruction, next, cycles);
        self.exception = self.frames.iter().rev().find_map(|frame| match frame {
            Frame::Exception(handler, _) => Some(*handler),
            Frame::Call(_) | Frame::PerhapsCall(_) => None,
        });
        enters
    }

    fn change_frames(&mut self, instruction: &Instruction, next: u32, cycles: &mut u32) -> bool {
        let back = (instruction.flow == Flow::Next).then(|| instruction.next());
        if instruction.is_conditional && next == instruction.next() {
            return false;
        }
        let is_handler = self.handlers.contains(&next);
        match instruction.flow {
            Flow::Call(_) | Flow::CallRegister if instruction.is_conditional && is_handler => {
                self.frames.push(Frame::PerhapsCall(instruction.next()));
            }
            Flow::Call(_) | Flow::CallRegister => self.frames.push(Frame::Call(instruction.next())),
            Flow::Return | Flow::JumpRegister => match self.frames.last().copied() {
                Some(Frame::Call(back)) if back == next => {
                    self.frames.pop();
                    return false;
                }
                Some(Frame::Exception(_, back)) if matches!(instruction.flow, Flow::Return) => {
                    self.frames.pop();
                    *cycles += cycles::EXIT;
                    self.fetch.lose();
                    if is_handler {
                        self.enter(next, back, cycles);
                    } else if let Some(Frame::PerhapsCall(back)) = self.frames.last().copied() {
                        self.frames.pop();
                        if next != back {
                            self.frames.push(Frame::Call(back));
                        }
                    }
                    return is_handler;
                }
                Some(Frame::Call(back)) if is_handler => {
                    self.frames.pop();
                    // A jump through a register returns, or goes on to another function.
                    if instruction.flow == Flow::JumpRegister {
                        self.frames.push(Frame::PerhapsCall(back));
                    }
                    self.enter(next, None, cycles);
                    return true;
                }
                _ => {}
            },
            _ => {}
        }
        let is_expected = match instruction.flow {
            Flow::Jump(target) | Flow::Branch(target) | Flow::Call(target) => next == target,
            Flow::CallRegister | Flow::JumpRegister | Flow::Table | Flow::Return => !is_handler,
            Flow::Next | Flow::Trap => false,
        } || (next == instruction.next() && !is_handler);
        if is_handler && !is_expected {
            self.enter(next, back, cycles);
            return true;
        }
        false
    }

    fn enter(&mut self, handler: u32, back: Option<u32>, cycles: &mut u32) {
        self.frames.push(Frame::Exception(handler, back));
        *cycles += cycles::ENTRY;
        self.fetch.lose();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: u32 = 0x0800_0100;
    const HANDLER: u32 = BASE + 0x20;
    const OTHER_HANDLER: u32 = BASE + 0x2A;
    /// A task that may call what r3 says, and calls a function through a thunk; a handler that may call what r3 says.
    const CODE: &[u16] = &[
        0x2000, // 00 movs r0, #0
        0x2101, // 02 movs r1, #1
        0x2202, // 04 movs r2, #2
        0xBF08, // 06 it eq
        0x4798, // 08 blxeq r3
        0x2303, // 0a movs r3, #3
        0xF000, 0xF802, // 0c bl 14
        0xE7FE, // 10 b 10
        0xBF00, // 12 nop
        0x4760, // 14 bx r12, the thunk
        0xBF00, // 16 nop
        0x2404, // 18 movs r4, #4, the function behind it
        0x4770, // 1a bx lr
        0xBF00, 0xBF00, // 1c
        0xB580, // 20 push {r7, lr}, the handler
        0x2505, // 22 movs r5, #5
        0xBF08, // 24 it eq
        0x4798, // 26 blxeq r3
        0xBD80, // 28 pop {r7, pc}
        0xBF08, // 2a it eq, another handler
        0x4770, // 2c bxeq lr
        0x2606, // 2e movs r6, #6
        0x4770, // 30 bx lr
    ];

    /// What ran, as offsets, with whether the handler did, of arrivals (offset, number of the instruction).
    fn ran(arrivals: &[(u32, u64)]) -> Result<Vec<(u32, bool)>, Error> {
        let image = Image::of_code(&[BASE | 1, HANDLER | 1, OTHER_HANDLER | 1], BASE, CODE);
        let watched = image.entries();
        let events: Vec<Event> = arrivals
            .iter()
            .map(|&(offset, retired)| Event {
                retired,
                kind: EventKind::Arrival(BASE + offset),
            })
            .collect();
        for event in &events {
            let EventKind::Arrival(address) = event.kind else {
                unreachable!()
            };
            let is_function = [HANDLER, OTHER_HANDLER, BASE, BASE + 0x18].contains(&address);
            assert!(watched.contains(&address) || is_function, "{address:#x}");
        }
        let mut steps = Vec::new();
        let mut walk = Walk::new(&image);
        walk.take(&events, |step| {
            steps.push((step.instruction.address - BASE, step.exception.is_some()));
        })?;
        Ok(steps)
    }

    fn of(steps: &[(u32, bool)], in_handler: bool) -> Vec<u32> {
        let kept = steps.iter().filter(|step| step.1 == in_handler);
        kept.map(|step| step.0).collect()
    }

    #[test]
    fn what_runs_between_two_arrivals_follows_from_their_numbers() {
        let steps = ran(&[(0, 0), (0xA, 5), (0x14, 7), (0x18, 8), (0x10, 10), (0x10, 11)]).unwrap();
        let expected = [0, 2, 4, 6, 8, 0xA, 0xC, 0x14, 0x18, 0x1A, 0x10];
        assert_eq!(of(&steps, false), expected);
        assert_eq!(steps.len(), expected.len());
    }

    #[test]
    fn an_exception_in_the_middle_of_a_block_comes_back_to_it() {
        // Two instructions of the task, five of the handler, three of the task.
        let steps = ran(&[(0, 0), (0x20, 2), (0x28, 6), (0xA, 10)]).unwrap();
        assert_eq!(of(&steps, true), [0x20, 0x22, 0x24, 0x26, 0x28]);
        assert_eq!(of(&steps, false), [0, 2, 4, 6, 8]);
    }

    #[test]
    fn a_call_that_its_condition_skips_is_none() {
        // The handler's call is skipped: its return is that of the exception. The task's is too: the next call returns behind itself.
        let steps = ran(&[
            (0, 0),
            (0x20, 1),
            (0x28, 5),
            (0xA, 10),
            (0x14, 12),
            (0x18, 13),
            (0x10, 15),
            (0x10, 16),
        ])
        .unwrap();
        assert_eq!(of(&steps, true), [0x20, 0x22, 0x24, 0x26, 0x28]);
        assert_eq!(
            of(&steps, false),
            [0, 2, 4, 6, 8, 0xA, 0xC, 0x14, 0x18, 0x1A, 0x10]
        );
    }

    #[test]
    fn a_return_that_its_condition_skips_is_none() {
        let steps = ran(&[(0, 0), (0x2A, 1), (0x2E, 3), (0xA, 9)]).unwrap();
        assert_eq!(of(&steps, true), [0x2A, 0x2C, 0x2E, 0x30]);
        assert_eq!(of(&steps, false), [0, 2, 4, 6, 8]);
    }

    #[test]
    fn an_exception_between_a_call_and_what_it_calls_forgets_no_frame() {
        for call in [
            // Behind the call that a condition may skip, which is made: to the function, and back.
            vec![(0, 0), (0x20, 5), (0x28, 9), (0x18, 10), (0xA, 12), (0x20, 13)],
            // The same, which is skipped.
            vec![(0, 0), (0x20, 5), (0x28, 9), (0xA, 10), (0x20, 11)],
            // Behind the thunk, whose jump goes on to the function.
            vec![
                (0xA, 0),
                (0x14, 2),
                (0x20, 3),
                (0x28, 7),
                (0x18, 8),
                (0x10, 10),
                (0x20, 11),
            ],
        ] {
            let steps = ran(&call).unwrap();
            assert_eq!(of(&steps, true), [0x20, 0x22, 0x24, 0x26, 0x28], "{call:x?}");
        }
    }

    #[test]
    fn an_exception_behind_the_return_of_such_a_call_ends_no_other_one() {
        // The handler's call is made; exceptions come right behind it, and right behind the return of what it called.
        let made = [
            (0, 0),
            (0x20, 1),
            (0x2A, 5),
            (0x2E, 7),
            (0x18, 9),
            (0x2A, 11),
            (0x2E, 13),
            (0x28, 15),
            (0xA, 20),
        ];
        // It is skipped; the exception comes again as the handler returns.
        let skipped = [
            (0, 0),
            (0x20, 1),
            (0x2A, 5),
            (0x2E, 7),
            (0x28, 9),
            (0x2A, 10),
            (0x2E, 12),
            (0xA, 18),
        ];
        for arrivals in [&made[..], &skipped] {
            let steps = ran(arrivals).unwrap();
            assert_eq!(of(&steps, false), [0, 2, 4, 6, 8], "{arrivals:x?}");
        }
    }

    #[test]
    fn an_arrival_that_nothing_leads_to_is_an_error() {
        // More instructions than lead on from the thunk, and fewer than lead to it.
        for arrivals in [
            [(0xA, 0), (0x14, 2), (0x10, 12)],
            [(0xA, 0), (0x14, 1), (0x18, 2)],
        ] {
            let error = ran(&arrivals).unwrap_err().to_string();
            assert!(error.contains("expected an instruction of the image"), "{error}");
        }
    }
}
