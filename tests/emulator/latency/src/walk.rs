//! A recorded run, step by step: which instruction ran, what it cost at most, in which exception, with which masks.

use std::collections::BTreeSet;

use gripline_emulator::Event;

use crate::cycles::{self, Fetch, Memory};
use crate::image::{Flow, Image, Instruction};

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
    Call(u32),
    Exception(u32),
}

/// Goes along a record.
#[derive(Debug)]
pub struct Walk<'a> {
    image: &'a Image,
    handlers: BTreeSet<u32>,
    frames: Vec<Frame>,
    is_masked: bool,
    fetch: Fetch,
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
            image,
            handlers,
            frames: Vec::new(),
            is_masked: false,
            fetch: Fetch::default(),
            pending: None,
            landed: Landed::default(),
        }
    }

    /// Hands every completed step of these events to `see`; the last instruction waits for the next call.
    ///
    /// # Panics
    /// On an address that is not in the image; only those of the image are traced.
    pub fn take(&mut self, events: &[Event], mut see: impl FnMut(Step<'a>)) {
        for event in events {
            match *event {
                Event::Delivery => self.landed.deliveries += 1,
                Event::UartByte => self.landed.uart_bytes += 1,
                Event::Access(address) => {
                    if let Some((_, access, _)) = &mut self.pending {
                        *access = Some(address);
                    }
                }
                Event::Instruction(address) => {
                    let instruction = self.image.instructions.get(&address).expect("it was asked for");
                    if let Some((before, access, landed)) = self.pending.take() {
                        see(self.step(before, access, landed, address));
                    }
                    self.pending = Some((instruction, None, std::mem::take(&mut self.landed)));
                }
            }
        }
    }

    fn step(
        &mut self,
        instruction: &'a Instruction,
        access: Option<u32>,
        landed: Landed,
        next: u32,
    ) -> Step<'a> {
        let exception = self.frames.iter().rev().find_map(|frame| match frame {
            Frame::Exception(handler) => Some(*handler),
            Frame::Call(_) => None,
        });
        let is_masked = self.is_masked;
        match (instruction.name.as_str(), instruction.text.as_str()) {
            (_, text) if text.starts_with("cpsid") => self.is_masked = true,
            // A restored mask counts as lifted: sections inside sections end with the outermost one.
            (_, text) if text.starts_with("cpsie") || text.starts_with("msr primask") => {
                self.is_masked = false;
            }
            _ => {}
        }
        let mut cycles = self.fetch.cost(instruction);
        let memory = access.map_or_else(
            || instruction.data.literal.map_or(Memory::Coupled, Memory::of),
            Memory::of,
        );
        cycles += cycles::data(instruction, memory);
        let is_taken = next != instruction.next();
        cycles += cycles::core(instruction, is_taken);
        if is_taken {
            self.fetch.lose();
        }
        let enters = self.follow(instruction, next, &mut cycles);
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
        let is_handler = self.handlers.contains(&next);
        match instruction.flow {
            Flow::Call(_) | Flow::CallRegister => self.frames.push(Frame::Call(instruction.next())),
            Flow::Return | Flow::JumpRegister => match self.frames.last() {
                Some(Frame::Call(back)) if *back == next => {
                    self.frames.pop();
                    return false;
                }
                Some(Frame::Exception(_)) if matches!(instruction.flow, Flow::Return) => {
                    self.frames.pop();
                    *cycles += cycles::EXIT;
                    self.fetch.lose();
                    if is_handler {
                        self.enter(next, cycles);
                    }
                    return is_handler;
                }
                Some(Frame::Call(_)) if is_handler => {
                    self.frames.pop();
                    self.enter(next, cycles);
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
            self.enter(next, cycles);
            return true;
        }
        false
    }

    fn enter(&mut self, handler: u32, cycles: &mut u32) {
        self.frames.push(Frame::Exception(handler));
        *cycles += cycles::ENTRY;
        self.fetch.lose();
    }

    /// The names of the functions under way, outermost first.
    #[must_use]
    pub fn depth(&self) -> usize {
        self.frames.len()
    }
}
