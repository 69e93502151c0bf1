//! The RS-485 pair between a [`Robotiq`] and a [`Gripper`], byte by byte at 115,200 baud, with everything that can go
//! wrong on it. The server's end tells frames apart by 1.75 ms of silence, as the standard says. Times in µs.

use std::collections::VecDeque;

use gripline_firmware::GripForce;
use gripline_firmware::constants::{MODBUS_BYTE_US, MODBUS_SILENCE_US, MODBUS_SLOT_US};
use gripline_firmware::line::GripLine;
use gripline_firmware::robotiq::Robotiq;
use gripline_gripper::Gripper;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

/// How finely time passes.
const STEP_US: u64 = 50;

/// What is wrong with the bus.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct BusFault {
    /// Nothing passes either way.
    pub(crate) cut: bool,
    /// Bytes in a thousand that vanish on their way, in both directions.
    pub(crate) dropped: u32,
    /// Bytes in a thousand with a flipped bit.
    pub(crate) flipped: u32,
    /// Every answer comes so much later.
    pub(crate) slow_us: u64,
    /// Every answer is this exception instead.
    pub(crate) exception: Option<u8>,
    /// Every answer's CRC is wrong.
    pub(crate) wrong_crc: bool,
}

pub(crate) struct Bus {
    pub(crate) line: Robotiq,
    pub(crate) gripper: Gripper,
    pub(crate) fault: BusFault,
    pub(crate) now_us: u64,
    /// Starts of all requests.
    pub(crate) requests_us: Vec<u64>,
    to_gripper: VecDeque<(u64, u8)>,
    to_line: VecDeque<(u64, u8)>,
    frame: Vec<u8>,
    heard_us: u64,
    rng: Pcg64Mcg,
    slowest_us: u64,
    /// The least that the object felt since the last look.
    pub(crate) min_grip: i64,
}

impl Bus {
    pub(crate) fn new() -> Self {
        Self {
            line: Robotiq::new(0),
            gripper: Gripper::new(),
            fault: BusFault::default(),
            now_us: 0,
            requests_us: Vec::new(),
            to_gripper: VecDeque::new(),
            to_line: VecDeque::new(),
            frame: Vec::new(),
            heard_us: 0,
            rng: Pcg64Mcg::seed_from_u64(485),
            slowest_us: 0,
            min_grip: 0,
        }
    }

    /// With a gripper that went through its activation.
    pub(crate) fn ready() -> Self {
        let mut bus = Self::new();
        bus.write(0);
        bus.pass(4_000_000);
        assert!(bus.gripper.is_activated(), "activated within 4 s");
        bus
    }

    /// A microcontroller that starts again beside a gripper that goes on.
    pub(crate) fn restart(&mut self) {
        self.line = Robotiq::new(self.now_us);
        self.to_gripper.clear();
        self.to_line.clear();
    }

    pub(crate) fn write(&mut self, lsb: i32) {
        let Ok(()) = self.line.write(GripForce::from_lsb(lsb));
    }

    pub(crate) fn pass(&mut self, us: u64) {
        let end_us = self.now_us + us;
        self.min_grip = self.gripper.grip();
        while self.now_us < end_us {
            self.now_us += STEP_US;
            self.step();
            self.min_grip = self.min_grip.min(self.gripper.grip());
        }
    }

    fn step(&mut self) {
        self.gripper.advance(self.now_us);
        while let Some((_, byte)) = due(&mut self.to_gripper, self.now_us) {
            self.frame.push(byte);
            self.heard_us = self.now_us;
        }
        if !self.frame.is_empty() && self.now_us - self.heard_us >= MODBUS_SILENCE_US {
            let frame = std::mem::take(&mut self.frame);
            if let Some(answer) = self.gripper.answer(&frame) {
                let answer = self.spoilt(answer);
                self.slowest_us = self.slowest_us.max(self.fault.slow_us);
                let start_us = self.now_us + self.fault.slow_us;
                self.put(&answer, start_us, false);
            }
        }
        while let Some((_, byte)) = due(&mut self.to_line, self.now_us) {
            self.line.receive(&[byte], self.now_us);
        }
        if self.now_us >= self.line.wake_us()
            && let Some(request) = self.line.poll_transmit(self.now_us)
        {
            if let Some(last_us) = self.requests_us.last() {
                assert!(
                    self.now_us - last_us >= MODBUS_SLOT_US,
                    "faster than the gripper's 200 Hz"
                );
            }
            let may_collide = self.to_line.is_empty() || self.slowest_us > 0;
            assert!(may_collide, "a request while the gripper speaks");
            self.requests_us.push(self.now_us);
            self.put(&request, self.now_us, true);
        }
        assert!(self.line.wake_us() > self.now_us, "time does not stand still");
    }

    fn spoilt(&self, mut answer: Vec<u8>) -> Vec<u8> {
        if let Some(code) = self.fault.exception {
            answer = vec![answer[0], answer[1] | 0x80, code];
            // Bitwise, for a check of its own (Modbus over serial line V1.02, section 6.2.2).
            let mut crc = 0xFFFF_u16;
            for &byte in &answer {
                crc ^= u16::from(byte);
                for _ in 0..8 {
                    crc = if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 };
                }
            }
            answer.extend(crc.to_le_bytes());
        }
        if self.fault.wrong_crc {
            *answer.last_mut().unwrap() ^= 0x10;
        }
        answer
    }

    fn put(&mut self, bytes: &[u8], start_us: u64, to_gripper: bool) {
        let fault = self.fault;
        let mut at_us = start_us;
        for &byte in bytes {
            at_us += MODBUS_BYTE_US;
            let mut hit = |per_mille: u32| self.rng.random_range(0..1_000) < per_mille;
            let (dropped, flipped) = (fault.cut || hit(fault.dropped), hit(fault.flipped));
            let byte = if flipped {
                byte ^ 1 << self.rng.random_range(0..8)
            } else {
                byte
            };
            if !dropped {
                let wire = if to_gripper {
                    &mut self.to_gripper
                } else {
                    &mut self.to_line
                };
                wire.push_back((at_us, byte));
            }
        }
    }
}

fn due(wire: &mut VecDeque<(u64, u8)>, now_us: u64) -> Option<(u64, u8)> {
    wire.pop_front_if(|(at_us, _)| *at_us <= now_us)
}
