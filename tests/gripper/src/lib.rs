//! A Robotiq 2F-140 for tests: the Modbus server is the crate rmodbus, which knows nothing of our client; what the
//! registers do is modelled after the gripper's manual. Times in µs, forces in 1/4096 N.
//!
//! The model holds on to what makes this gripper awkward: force counts only while the fingers move, so a new force
//! needs a new position request, and less force never loosens a grip. Activation opens the fingers.
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_panics_doc,
    clippy::new_without_default,
    reason = "only tests call this"
)]

use rmodbus::ModbusProto;
use rmodbus::server::ModbusFrame;
use rmodbus::server::context::ModbusContext;
use rmodbus::server::storage::ModbusStorage;

/// Its address on the bus, as delivered.
pub const UNIT: u8 = 9;
const COMMAND: u16 = 0x03E8;
const STATUS: u16 = 0x07D0;
const NEWTON: i64 = 4_096;
/// How long the fingers take through their activation, and from end to end while moving.
const ACTIVATION_US: u64 = 2_000_000;
const TRAVEL_US: u64 = 600_000;
/// The gripper's own loop: registers change at 200 Hz.
const LOOP_US: u64 = 5_000;

/// Room for the registers up to the last one in use.
const REGISTERS: usize = STATUS as usize + 3;

/// The gripper: [`answer`](Self::answer) requests, [`advance`](Self::advance) time.
pub struct Gripper {
    registers: Box<ModbusStorage<0, 0, REGISTERS, REGISTERS>>,
    /// The position at which an object stops the fingers; none when nothing is between them.
    pub object: Option<u8>,
    activated: bool,
    activating_us: Option<u64>,
    orders: [u8; 6],
    /// Where the fingers are, in 1/1000 of the position register.
    place_milli: u64,
    stopped: bool,
    /// What the object feels, 1/4096 N.
    grip: i64,
    /// The fault that it reports; 0 for none.
    pub fault: u8,
    next_loop_us: u64,
    /// Position requests that made the motor run.
    pub motions: u32,
    /// Activations that were asked for.
    pub activations: u32,
    /// Whether the object was let go since it was first gripped.
    pub dropped: bool,
}

impl Gripper {
    /// Just switched on, with an object between its open fingers.
    #[must_use]
    pub fn new() -> Self {
        Self {
            registers: Box::default(),
            object: Some(120),
            activated: false,
            activating_us: None,
            orders: [0; 6],
            place_milli: 0,
            stopped: false,
            grip: 0,
            fault: 0,
            next_loop_us: 0,
            motions: 0,
            activations: 0,
            dropped: false,
        }
    }

    /// The answer to a frame, or none when the standard says silence (wrong CRC, another unit).
    pub fn answer(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        // rmodbus 0.13 overflows on functions that are none (its response adds 0x80 to them).
        if frame.get(1).is_none_or(|function| *function >= 0x80) {
            return None;
        }
        let mut answer = Vec::new();
        let mut server = ModbusFrame::new(UNIT, frame, ModbusProto::Rtu, &mut answer);
        server.parse().ok()?;
        if server.processing_required {
            if server.readonly {
                server.process_read(&*self.registers).ok()?;
            } else {
                server.process_write(&mut *self.registers).ok()?;
            }
        }
        if !server.response_required {
            return None;
        }
        server.finalize_response().ok()?;
        Some(answer)
    }

    /// Power goes and comes back: the fingers stay where they are, everything else is forgotten.
    pub fn lose_power(&mut self) {
        *self.registers = ModbusStorage::default();
        self.activated = false;
        self.activating_us = None;
        self.orders = [0; 6];
        self.fault = 0;
    }

    /// The object slips out: the fingers close on nothing.
    pub fn lose_object(&mut self) {
        self.object = None;
        self.stopped = false;
        self.grip = 0;
    }

    /// What the object feels, 1/4096 N.
    #[must_use]
    pub fn grip(&self) -> i64 {
        self.grip
    }

    /// Whether it went through its activation.
    #[must_use]
    pub fn is_activated(&self) -> bool {
        self.activated
    }

    /// Its loop, up to `now_us`.
    pub fn advance(&mut self, now_us: u64) {
        while self.next_loop_us <= now_us {
            self.turn(self.next_loop_us);
            self.next_loop_us += LOOP_US;
        }
    }

    fn turn(&mut self, now_us: u64) {
        let mut orders = [0; 6];
        for (place, pair) in (COMMAND..).zip(orders.chunks_exact_mut(2)) {
            pair.copy_from_slice(&self.registers.get_holding(place).unwrap().to_be_bytes());
        }
        let before = std::mem::replace(&mut self.orders, orders);
        let [action, _, _, position, _, force] = orders;
        if action & 1 == 0 {
            self.activated = false;
            self.activating_us = None;
            self.fault = 0;
        } else if before[0] & 1 == 0 {
            self.activations += 1;
            self.activating_us = Some(now_us + ACTIVATION_US);
            self.release();
        }
        if self.activating_us.is_some_and(|end| now_us >= end) {
            self.activating_us = None;
            self.activated = true;
            self.place_milli = 0;
        }
        if self.activated && action & 8 != 0 && self.fault < 10 && self.fault != 8 {
            let asked_again = position != before[3] || before[0] & 8 == 0;
            self.motions += u32::from(asked_again);
            if asked_again {
                self.stopped = false;
            }
            if !self.stopped {
                self.travel(position, force);
            }
        }
        self.tell();
    }

    fn travel(&mut self, position: u8, force: u8) {
        let step = 255_000 * LOOP_US / TRAVEL_US;
        let goal = u64::from(position) * 1_000;
        if goal < self.place_milli {
            self.release();
            self.place_milli = self.place_milli.saturating_sub(step).max(goal);
        } else {
            let wall = self.object.map_or(u64::MAX, |place| u64::from(place) * 1_000);
            self.place_milli = (self.place_milli + step)
                .min(goal)
                .min(wall.max(self.place_milli));
            if self.place_milli >= wall {
                // 10 to 125 N over 0 to 255, and never less than it already was.
                let newtons_255 = 10 * 255 + 115 * i64::from(force);
                self.grip = self.grip.max((newtons_255 * NEWTON + 254) / 255);
                self.stopped = true;
            }
        }
    }

    fn release(&mut self) {
        self.dropped |= self.grip > 0;
        self.grip = 0;
        self.stopped = false;
    }

    fn tell(&mut self) {
        let [action, _, _, position, _, _] = self.orders;
        let state = match (self.activated, self.activating_us) {
            (true, _) => 3,
            (_, Some(_)) => 1,
            _ => 0,
        };
        let place = (self.place_milli / 1_000) as u8;
        let object = match (self.stopped, place == position) {
            (true, _) => 2,
            (_, true) => 3,
            _ => 0,
        };
        let bits = action & 9 | state << 4 | object << 6;
        let registers = [[bits, 0], [self.fault, position], [place, 0]];
        for (register, bytes) in (STATUS..).zip(registers) {
            self.registers
                .set_input(register, u16::from_be_bytes(bytes))
                .unwrap();
        }
    }
}
