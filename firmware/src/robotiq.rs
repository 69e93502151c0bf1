//! A Robotiq 2F-140 as a grip-force line: a state machine with bytes and time in, bytes out. Time in µs.
//!
//! Source: "2F-85 & 2F-140 Instruction Manual" (Robotiq), sections 4.2 to 4.4 (registers), 4.8 (Modbus RTU), 6 (forces). Limits:
//! rFR limits the motor's current while the fingers move; it is no closed-loop force. More force therefore needs a new position
//! request, and less force does not loosen a grip: only opening does. Below 10 N it grips with 10 N. Activation opens and closes
//! the fingers, so it never starts while something is to be held.

use gripline_protocol::LSB_PER_NEWTON;
use gripline_protocol::line::ROBOTIQ_FORCE_N;

use crate::constants::{
    MODBUS_ANSWER_US, MODBUS_BYTE_US, MODBUS_FAILURES_MAX, MODBUS_QUIET_US, MODBUS_SLOT_US, MODBUS_UNIT,
    ROBOTIQ_ACTIVATION_MAX_US, ROBOTIQ_ACTIVATION_PAUSE_US, ROBOTIQ_CLOSING_SPEED, ROBOTIQ_COMMAND,
    ROBOTIQ_ECHO_US, ROBOTIQ_OPENING_SPEED, ROBOTIQ_STATUS,
};
use crate::grip::GripForce;
use crate::line::{GripLine, LineHealth};
use crate::modbus::{ANSWER_MAX, Answer, AnswerError, Request, RequestFrame};

const MIN_LSB: u32 = (ROBOTIQ_FORCE_N[0] * LSB_PER_NEWTON) as u32;
const MAX_LSB: u32 = (ROBOTIQ_FORCE_N[1] * LSB_PER_NEWTON) as u32;
const REGISTER_MAX: u32 = 255;

/// The force register rFR for a force, rounded up: never less force than decided, 10 N at least, 125 N at most.
///
/// The manual gives the ends and no curve between them; a straight line is assumed.
#[must_use]
pub const fn force_register(force: GripForce) -> u8 {
    let force = force.lsb().cast_unsigned();
    let force = if force < MAX_LSB { force } else { MAX_LSB };
    // At most 115 · 4096 · 255 < 2²⁷.
    (force.saturating_sub(MIN_LSB) * REGISTER_MAX).div_ceil(MAX_LSB - MIN_LSB) as u8
}

/// The command registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct MotionCommand {
    /// rACT (bit 0) and rGTO (bit 3).
    action: u8,
    /// rPR: 0 open, 255 closed.
    position: u8,
    /// rSP.
    speed: u8,
    /// rFR.
    force: u8,
}

/// Two positions that both mean "closed", so that every new grip can be a new request.
const CLOSED: [u8; 2] = [255, 254];

const ACTIVE: u8 = 1;
const GO_TO: u8 = 1 << 3;

impl MotionCommand {
    /// rACT falls: the gripper forgets its faults.
    const RESET: Self = Self {
        action: 0,
        position: 0,
        speed: 0,
        force: 0,
    };
    /// rACT rises: the fingers open and close once.
    const ACTIVATE: Self = Self {
        action: ACTIVE,
        ..Self::RESET
    };
    const OPEN: Self = Self {
        action: ACTIVE | GO_TO,
        position: 0,
        speed: ROBOTIQ_OPENING_SPEED,
        force: 0,
    };

    const fn request(self) -> Request {
        Request::Write {
            address: ROBOTIQ_COMMAND,
            values: [
                u16::from_be_bytes([self.action, 0]),
                u16::from_be_bytes([0, self.position]),
                u16::from_be_bytes([self.speed, self.force]),
            ],
        }
    }
}

/// The gripper's status registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GripperStatus {
    /// gACT, gGTO, gSTA and gOBJ as in the register.
    pub bits: u8,
    /// gFLT: 0 none, 5 and 7 activate first, 8 too hot, 9 no request for a second, 10 and above reset needed.
    pub fault: u8,
    /// gPR: the position request that it executes.
    pub echo: u8,
    /// gPO: where the fingers are, 0 open to 255 closed.
    pub position: u8,
    /// gCU: motor current, 10 mA.
    pub current: u8,
}

impl GripperStatus {
    const fn from_registers([state, fault, place]: [u16; 3]) -> Self {
        let ([bits, _], [fault, echo], [position, current]) =
            (state.to_be_bytes(), fault.to_be_bytes(), place.to_be_bytes());
        Self {
            bits,
            // The high half is of the controller beside it, kFLT.
            fault: fault & 0x0F,
            echo,
            position,
            current,
        }
    }

    /// gACT: activated or being so.
    #[must_use]
    pub const fn has_act(self) -> bool {
        self.bits & ACTIVE != 0
    }

    /// Activated (gSTA 3) and without a fault that needs a reset.
    #[must_use]
    pub const fn is_ready(self) -> bool {
        self.has_act() && (self.bits >> 4) & 3 == 3 && !self.needs_reset()
    }

    /// gGTO and gPR: it moves to the position of this command, or is there.
    const fn works_on(self, command: MotionCommand) -> bool {
        self.bits & GO_TO != 0 && self.echo == command.position
    }

    /// gOBJ: something stopped the fingers.
    const fn has_object(self) -> bool {
        matches!(self.bits >> 6, 1 | 2)
    }

    /// gOBJ: the fingers reached their target, and nothing stopped them.
    const fn has_none(self) -> bool {
        self.bits >> 6 == 3
    }

    const fn needs_reset(self) -> bool {
        self.fault >= FAULT_NEEDS_RESET
    }

    /// Whether it follows commands. A pause of our requests sets only a minor fault.
    const fn is_well(self) -> bool {
        matches!(self.fault, 0 | FAULT_SILENCE)
    }
}

const FAULT_SILENCE: u8 = 9;
const FAULT_NEEDS_RESET: u8 = 0x0A;

/// What the grip controller requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Requested {
    /// Nothing was held since the start, and nobody let go: leave the gripper alone.
    Stay,
    Grip(GripForce),
    /// The force fell to zero, or a person lets go.
    Open,
}

/// State of the connection and of the activation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// It does not answer, or not yet.
    Silent,
    /// It answers and is not activated.
    Inactive,
    Resetting,
    Activating {
        until_us: u64,
    },
    Ready,
}

/// The line to one gripper.
///
/// Reads and writes alternate. Each write follows from the last read, so a lost frame never counts as delivered.
#[derive(Debug)]
pub struct Robotiq {
    requested: Requested,
    phase: Phase,
    /// The newest status, and whether it is newer than the last write.
    status: Option<GripperStatus>,
    is_fresh: bool,
    /// The last grip that was written.
    sent: Option<MotionCommand>,
    /// The force register of the grip that the gripper echoed last.
    applied: Option<u8>,
    /// Something stopped the fingers since the grip was requested.
    had_object: bool,
    /// Time since which the gripper has not echoed a grip.
    sent_us: Option<u64>,
    asked: Option<Asked>,
    answer: heapless::Vec<u8, ANSWER_MAX>,
    /// Earliest times of the next request and the next activation.
    next_us: u64,
    activate_us: u64,
    failures: u8,
    health: LineHealth,
    now_us: u64,
}

/// A request in transit, and when it counts as lost.
#[derive(Debug, Clone, Copy)]
struct Asked {
    request: Request,
    until_us: u64,
}

impl Robotiq {
    /// A line that does not know its gripper yet. It reads the status before it commands, so a gripper that already holds
    /// something stays as it is.
    #[must_use]
    pub const fn new(now_us: u64) -> Self {
        Self {
            requested: Requested::Stay,
            phase: Phase::Silent,
            status: None,
            is_fresh: false,
            sent: None,
            applied: None,
            had_object: false,
            sent_us: None,
            asked: None,
            answer: heapless::Vec::new(),
            next_us: now_us,
            activate_us: now_us,
            failures: 0,
            health: LineHealth::Starting,
            now_us,
        }
    }

    /// The gripper's last status.
    #[must_use]
    pub const fn status(&self) -> Option<GripperStatus> {
        self.status
    }

    /// Latest time for the next call of [`Self::poll_transmit`], µs.
    #[must_use]
    pub fn wake_us(&self) -> u64 {
        self.asked.map_or(self.next_us, |asked| asked.until_us)
    }

    /// The next request, when it is time for one. Its bytes go out back to back with the driver enabled.
    pub fn poll_transmit(&mut self, now_us: u64) -> Option<RequestFrame> {
        self.now_us = now_us;
        if let Some(asked) = self.asked {
            if now_us < asked.until_us {
                return None;
            }
            self.failed();
        }
        if now_us < self.next_us {
            return None;
        }
        let command = self
            .status
            .filter(|_| self.is_fresh)
            .and_then(|status| self.command(status));
        let request = command.map_or(
            Request::Read {
                address: ROBOTIQ_STATUS,
            },
            MotionCommand::request,
        );
        if let Some(command) = command {
            self.is_fresh = false;
            // The echo shows the position only. The gripper may have taken it with the previous force: assume the lower force
            // until the gripper confirms.
            let again = self.sent.filter(|before| before.position == command.position);
            self.sent = Some(MotionCommand {
                force: again.map_or(command.force, |before| before.force.min(command.force)),
                ..command
            });
            self.sent_us = self.sent_us.or(Some(now_us));
        }
        let frame = request.frame(MODBUS_UNIT);
        self.answer.clear();
        self.next_us = now_us.saturating_add(MODBUS_SLOT_US);
        let wire_us = (frame.len() + ANSWER_MAX) as u64 * MODBUS_BYTE_US;
        self.asked = Some(Asked {
            request,
            until_us: now_us.saturating_add(wire_us + MODBUS_ANSWER_US),
        });
        Some(frame)
    }

    /// Takes bytes as they arrived from the bus.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) {
        self.now_us = now_us;
        for &byte in bytes {
            // Without a request this is noise, or a late answer.
            let Some(asked) = self.asked else {
                return;
            };
            if self.answer.push(byte).is_err() {
                return;
            }
            match asked.request.answer(MODBUS_UNIT, &self.answer) {
                None => {}
                Some(Ok(answer)) => self.answered(answer),
                // Busy is an answer too, but no good one.
                Some(Err(AnswerError::Crc | AnswerError::Exception(_) | AnswerError::Other)) => self.failed(),
            }
        }
    }

    /// The command that the gripper needs; `None` while it already does so, or is not ready.
    fn command(&self, status: GripperStatus) -> Option<MotionCommand> {
        match (self.phase, self.requested) {
            // Finish an activation that has begun; begin none while something is to be held.
            (Phase::Silent | Phase::Inactive, _)
            | (Phase::Resetting, Requested::Grip(_))
            | (Phase::Ready, Requested::Stay) => None,
            (Phase::Activating { .. }, Requested::Grip(_)) if !status.has_act() => None,
            (Phase::Resetting, _) => Some(MotionCommand::RESET),
            (Phase::Activating { .. }, _) => Some(MotionCommand::ACTIVATE),
            (Phase::Ready, Requested::Open) => {
                (!status.works_on(MotionCommand::OPEN)).then_some(MotionCommand::OPEN)
            }
            (Phase::Ready, Requested::Grip(force)) => self.grip(force_register(force), status),
        }
    }

    /// A grip with this force while the gripper is at `status`. More force, or the first grip after opening or stopping, is a
    /// new position request, so that the motor runs again. Less force needs no new position; the same force needs nothing.
    fn grip(&self, force: u8, status: GripperStatus) -> Option<MotionCommand> {
        let echo = status.echo;
        let grips = status.bits & GO_TO != 0 && CLOSED.contains(&echo);
        let position = match self.applied.filter(|_| grips) {
            Some(applied) if applied == force => return None,
            Some(applied) if applied > force => echo,
            _ if echo == CLOSED[0] => CLOSED[1],
            _ => CLOSED[0],
        };
        Some(MotionCommand {
            action: ACTIVE | GO_TO,
            position,
            speed: ROBOTIQ_CLOSING_SPEED,
            force,
        })
    }

    /// No answer, a damaged one or a refusal. A write may have arrived anyway: the next status shows it.
    fn failed(&mut self) {
        self.asked = None;
        self.is_fresh = false;
        self.next_us = self.next_us.max(self.now_us.saturating_add(MODBUS_QUIET_US));
        self.failures = self.failures.saturating_add(1);
        if self.failures >= MODBUS_FAILURES_MAX {
            self.leave(Phase::Silent);
            self.status = None;
        }
        self.update_health();
    }

    fn answered(&mut self, answer: Answer) {
        self.asked = None;
        self.failures = 0;
        if let Answer::Registers(registers) = answer {
            let status = GripperStatus::from_registers(registers);
            self.status = Some(status);
            self.is_fresh = true;
            self.follow(status);
            self.compare_echo(status);
            if self.phase == Phase::Ready && self.command(status).is_none() {
                // A write that was lost is no longer wanted.
                self.sent_us = None;
            }
            let is_gripping = matches!(self.requested, Requested::Grip(_));
            self.had_object =
                is_gripping && (self.had_object || self.applied.is_some() && status.has_object());
        }
        self.update_health();
    }

    /// Follows the gripper's state.
    fn follow(&mut self, status: GripperStatus) {
        let holding = matches!(self.requested, Requested::Grip(_));
        let begun = match self.phase {
            Phase::Resetting => false,
            Phase::Activating { .. } => status.has_act(),
            _ => true,
        };
        match self.phase {
            _ if holding && !begun => self.leave(Phase::Inactive),
            Phase::Silent | Phase::Inactive if status.is_ready() => self.phase = Phase::Ready,
            Phase::Inactive if !holding && self.now_us >= self.activate_us => {
                self.activate_us = self.now_us.saturating_add(ROBOTIQ_ACTIVATION_PAUSE_US);
                self.phase = Phase::Resetting;
            }
            Phase::Silent | Phase::Inactive => self.phase = Phase::Inactive,
            Phase::Resetting if !status.has_act() => {
                self.phase = Phase::Activating {
                    until_us: self.now_us.saturating_add(ROBOTIQ_ACTIVATION_MAX_US),
                };
            }
            Phase::Activating { .. } if status.is_ready() => self.leave(Phase::Ready),
            Phase::Activating { until_us } if status.needs_reset() || self.now_us >= until_us => {
                self.leave(Phase::Inactive);
            }
            Phase::Ready if !status.is_ready() => self.leave(Phase::Inactive),
            Phase::Resetting | Phase::Activating { .. } | Phase::Ready => {}
        }
    }

    /// Changes the phase and forgets which grip was applied.
    const fn leave(&mut self, phase: Phase) {
        self.phase = phase;
        self.sent = None;
        self.applied = None;
        self.sent_us = None;
    }

    /// Sees from the echo which grip the gripper applies.
    fn compare_echo(&mut self, status: GripperStatus) {
        if let Some(sent) = self.sent
            && status.works_on(sent)
        {
            self.sent = None;
            self.sent_us = None;
            self.applied = (sent.position != MotionCommand::OPEN.position).then_some(sent.force);
        }
    }

    fn update_health(&mut self) {
        let holding = matches!(self.requested, Requested::Grip(_));
        let late = |since: u64| self.now_us.saturating_sub(since) > ROBOTIQ_ECHO_US;
        self.health = match (self.phase, self.status) {
            (Phase::Silent, _) if self.failures >= MODBUS_FAILURES_MAX => LineHealth::NoAnswer,
            (Phase::Inactive, _) if holding => LineHealth::NotActivated,
            (Phase::Ready, Some(status)) if !status.is_well() => LineHealth::GripperFault,
            (Phase::Ready, _) if self.sent_us.is_some_and(late) => LineHealth::NotTaken,
            (Phase::Ready, Some(status)) if self.had_object && status.has_none() => LineHealth::ObjectLost,
            (Phase::Ready, _) => LineHealth::Good,
            _ => LineHealth::Starting,
        };
    }
}

impl GripLine for Robotiq {
    type Error = core::convert::Infallible;

    /// Zero opens the fingers if they held something before.
    fn write(&mut self, force: GripForce) -> Result<(), Self::Error> {
        self.requested = match (self.requested, force) {
            (Requested::Stay, GripForce::ZERO) => Requested::Stay,
            (_, GripForce::ZERO) => Requested::Open,
            (_, force) => Requested::Grip(force),
        };
        if self.requested == Requested::Open {
            self.applied = None;
        }
        Ok(())
    }

    fn release(&mut self) {
        if self.requested == Requested::Stay {
            self.requested = Requested::Open;
        }
    }

    fn health(&self) -> LineHealth {
        self.health
    }
}
