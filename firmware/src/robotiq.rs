//! A Robotiq 2F-140 as a grip-force line: a state machine with bytes and time in, bytes out. Time in µs.
//!
//! Source: "2F-85 & 2F-140 Instruction Manual" (Robotiq), sections 4.2 to 4.4 (registers), 4.8 (Modbus RTU), 6 (forces).
//! Limits: rFR limits the motor's current while the fingers move; it is no closed-loop force. More force therefore
//! needs a new position request, and less force does not loosen a grip: that takes opening. Below 10 N it grips with
//! 10 N. Activation opens and closes the fingers, so it is never begun while something is to be held.

use gripline_protocol::LSB_PER_NEWTON;
use gripline_protocol::line::ROBOTIQ_FORCE_N;

use crate::constants::{
    MODBUS_ANSWER_US, MODBUS_BYTE_US, MODBUS_FAILURES_MAX, MODBUS_QUIET_US, MODBUS_SLOT_US, MODBUS_UNIT,
    ROBOTIQ_ACTIVATION_MAX_US, ROBOTIQ_ACTIVATION_PAUSE_US, ROBOTIQ_CLOSING_SPEED, ROBOTIQ_COMMAND,
    ROBOTIQ_ECHO_US, ROBOTIQ_OPENING_SPEED, ROBOTIQ_STATUS,
};
use crate::grip::GripForce;
use crate::line::{GripLine, LineHealth};
use crate::modbus::{ANSWER_MAX, Answer, AnswerError, REQUEST_MAX, Request};

const LEAST_LSB: u32 = (ROBOTIQ_FORCE_N[0] * LSB_PER_NEWTON) as u32;
const MOST_LSB: u32 = (ROBOTIQ_FORCE_N[1] * LSB_PER_NEWTON) as u32;
const REGISTER_MAX: u32 = 255;

/// The force register rFR for a force, rounded up: never less grip than was decided, 10 N at least, 125 N at most.
///
/// The manual gives the ends and no curve between them; a straight line is assumed.
#[must_use]
pub const fn force_register(force: GripForce) -> u8 {
    let force = force.lsb().cast_unsigned();
    let force = if force < MOST_LSB { force } else { MOST_LSB };
    // At most 115 · 4096 · 255 < 2²⁷.
    (force.saturating_sub(LEAST_LSB) * REGISTER_MAX).div_ceil(MOST_LSB - LEAST_LSB) as u8
}

/// The command registers, as they are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Orders {
    /// rACT (bit 0) and rGTO (bit 3).
    action: u8,
    /// rPR: 0 open, 255 closed.
    position: u8,
    /// rSP.
    speed: u8,
    /// rFR.
    force: u8,
}

/// Two positions that mean "closed", so that every new grip can be a new request.
const CLOSED: [u8; 2] = [255, 254];

const ACTIVE: u8 = 1;
const GO_TO: u8 = 1 << 3;

impl Orders {
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

/// What the gripper says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GripperStatus {
    /// gACT, gGTO, gSTA and gOBJ as they stand in the register.
    pub bits: u8,
    /// gFLT: 0 none, 5 and 7 activation is wanted first, 8 too hot, 9 it heard nothing for a second, 10 and above
    /// only a reset helps.
    pub fault: u8,
    /// gPR: the position request that it works on.
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

    /// Activated (gSTA 3) and in no fault that only a reset ends.
    #[must_use]
    pub const fn is_ready(self) -> bool {
        self.has_act() && (self.bits >> 4) & 3 == 3 && !self.needs_reset()
    }

    /// gGTO and gPR: it goes to the position of these orders, or stands there.
    const fn works_on(self, orders: Orders) -> bool {
        self.bits & GO_TO != 0 && self.echo == orders.position
    }

    const fn needs_reset(self) -> bool {
        self.fault >= FAULT_NEEDS_RESET
    }

    /// Whether it does what it is told; after a silence of ours it only notes the silence.
    const fn is_well(self) -> bool {
        matches!(self.fault, 0 | FAULT_SILENCE)
    }
}

const FAULT_SILENCE: u8 = 9;
const FAULT_NEEDS_RESET: u8 = 0x0A;

/// What the controller wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wish {
    /// Nothing was held since the start: whatever the gripper does, let it.
    Stay,
    Grip(GripForce),
    /// The force came down to zero: let go.
    Open,
}

/// How far the gripper has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// It has not answered yet, or not any more.
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
/// Reading and writing take turns, and what is written next follows from what was read last, so that nothing that gets
/// lost on the way is believed to have arrived.
#[derive(Debug)]
pub struct Robotiq {
    wish: Wish,
    phase: Phase,
    /// The newest status, and whether it is newer than the last write.
    status: Option<GripperStatus>,
    is_fresh: bool,
    /// The last grip that was written.
    offered: Option<Orders>,
    /// The force register of the grip that the gripper echoed last.
    applied: Option<u8>,
    /// Since when a grip is offered that the gripper does not echo.
    offered_us: Option<u64>,
    asked: Option<Asked>,
    answer: [u8; ANSWER_MAX],
    answer_length: usize,
    /// Not before: the next request, the next activation.
    next_us: u64,
    activate_us: u64,
    failures: u8,
    health: LineHealth,
    now_us: u64,
}

/// A request on its way, and when it counts as lost.
#[derive(Debug, Clone, Copy)]
struct Asked {
    request: Request,
    until_us: u64,
}

impl Robotiq {
    /// A line that knows nothing of its gripper: it asks before it orders, so that one that already holds something is
    /// taken over as it is.
    #[must_use]
    pub const fn new(now_us: u64) -> Self {
        Self {
            wish: Wish::Stay,
            phase: Phase::Silent,
            status: None,
            is_fresh: false,
            offered: None,
            applied: None,
            offered_us: None,
            asked: None,
            answer: [0; ANSWER_MAX],
            answer_length: 0,
            next_us: now_us,
            activate_us: now_us,
            failures: 0,
            health: LineHealth::Starting,
            now_us,
        }
    }

    /// What the gripper said last.
    #[must_use]
    pub const fn status(&self) -> Option<GripperStatus> {
        self.status
    }

    /// When [`Self::poll_transmit`] has to be called at the latest, µs.
    #[must_use]
    pub fn wake_us(&self) -> u64 {
        self.asked.map_or(self.next_us, |asked| asked.until_us)
    }

    /// The next request's length, when it is time for one. Its bytes go out back to back with the driver enabled.
    pub fn poll_transmit(&mut self, now_us: u64, frame: &mut [u8; REQUEST_MAX]) -> Option<usize> {
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
        let orders = self
            .status
            .filter(|_| self.is_fresh)
            .and_then(|status| self.orders(status));
        let request = orders.map_or(
            Request::Read {
                address: ROBOTIQ_STATUS,
            },
            Orders::request,
        );
        if let Some(orders) = orders {
            self.is_fresh = false;
            // The echo tells positions only. While one is on its way the gripper may have taken it with the force of
            // before: the least of them is what it can be relied on to have pushed with.
            let again = self.offered.filter(|before| before.position == orders.position);
            self.offered = Some(Orders {
                force: again.map_or(orders.force, |before| before.force.min(orders.force)),
                ..orders
            });
            self.offered_us = self.offered_us.or(Some(now_us));
        }
        let length = request.frame(MODBUS_UNIT, frame);
        self.answer_length = 0;
        self.next_us = now_us.saturating_add(MODBUS_SLOT_US);
        let wire_us = (length + ANSWER_MAX) as u64 * MODBUS_BYTE_US;
        self.asked = Some(Asked {
            request,
            until_us: now_us.saturating_add(wire_us + MODBUS_ANSWER_US),
        });
        Some(length)
    }

    /// Takes bytes as they came from the bus.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) {
        self.now_us = now_us;
        for &byte in bytes {
            // What nobody asked for is noise, or an answer that comes too late.
            let Some(asked) = self.asked else {
                return;
            };
            let Some(place) = self.answer.get_mut(self.answer_length) else {
                return;
            };
            *place = byte;
            self.answer_length += 1;
            match asked
                .request
                .answer(MODBUS_UNIT, &self.answer[..self.answer_length])
            {
                None => {}
                Some(Ok(answer)) => self.answered(answer),
                // Busy is an answer too, but no good one.
                Some(Err(AnswerError::Crc | AnswerError::Exception(_) | AnswerError::Other)) => self.failed(),
            }
        }
    }

    /// What the gripper has to be told; nothing while it does what it should, or is not ready.
    fn orders(&self, status: GripperStatus) -> Option<Orders> {
        match (self.phase, self.wish) {
            // An activation that has begun is finished; none begins while something is to be held.
            (Phase::Silent | Phase::Inactive, _)
            | (Phase::Resetting, Wish::Grip(_))
            | (Phase::Ready, Wish::Stay) => None,
            (Phase::Activating { .. }, Wish::Grip(_)) if !status.has_act() => None,
            (Phase::Resetting, _) => Some(Orders::RESET),
            (Phase::Activating { .. }, _) => Some(Orders::ACTIVATE),
            (Phase::Ready, Wish::Open) => (!status.works_on(Orders::OPEN)).then_some(Orders::OPEN),
            (Phase::Ready, Wish::Grip(force)) => self.grip(force_register(force), status),
        }
    }

    /// A grip with this force while the gripper is at `status`: more force, or the first since it was opened or
    /// stopped (by whomever), is a new request that makes the motor run again; less is not, and the same is nothing.
    fn grip(&self, force: u8, status: GripperStatus) -> Option<Orders> {
        let echo = status.echo;
        let grips = status.bits & GO_TO != 0 && CLOSED.contains(&echo);
        let position = match self.applied.filter(|_| grips) {
            Some(applied) if applied == force => return None,
            Some(applied) if applied > force => echo,
            _ if echo == CLOSED[0] => CLOSED[1],
            _ => CLOSED[0],
        };
        Some(Orders {
            action: ACTIVE | GO_TO,
            position,
            speed: ROBOTIQ_CLOSING_SPEED,
            force,
        })
    }

    /// No answer, a damaged one or a refusal. What was written may have arrived all the same: the next status tells.
    fn failed(&mut self) {
        self.asked = None;
        self.is_fresh = false;
        self.next_us = self.next_us.max(self.now_us.saturating_add(MODBUS_QUIET_US));
        self.failures = self.failures.saturating_add(1);
        if self.failures >= MODBUS_FAILURES_MAX {
            self.leave(Phase::Silent);
            self.status = None;
        }
        self.judge();
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
        }
        self.judge();
    }

    /// Where the gripper stands now.
    fn follow(&mut self, status: GripperStatus) {
        let holding = matches!(self.wish, Wish::Grip(_));
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

    /// What was applied before counts no more in another phase.
    const fn leave(&mut self, phase: Phase) {
        self.phase = phase;
        self.offered = None;
        self.applied = None;
        self.offered_us = None;
    }

    /// Learns from the echo which grip the gripper works on.
    fn compare_echo(&mut self, status: GripperStatus) {
        if let Some(offered) = self.offered
            && status.works_on(offered)
        {
            self.offered = None;
            self.offered_us = None;
            self.applied = (offered.position != Orders::OPEN.position).then_some(offered.force);
        }
    }

    fn judge(&mut self) {
        let holding = matches!(self.wish, Wish::Grip(_));
        let late = |since: u64| self.now_us.saturating_sub(since) > ROBOTIQ_ECHO_US;
        self.health = match (self.phase, self.status) {
            (Phase::Silent, _) if self.failures >= MODBUS_FAILURES_MAX => LineHealth::NoAnswer,
            (Phase::Inactive, _) if holding => LineHealth::NotActivated,
            (Phase::Ready, Some(status)) if !status.is_well() => LineHealth::GripperFault,
            (Phase::Ready, _) if self.offered_us.is_some_and(late) => LineHealth::NotTaken,
            (Phase::Ready, _) => LineHealth::Good,
            _ => LineHealth::Starting,
        };
    }
}

impl GripLine for Robotiq {
    type Error = core::convert::Infallible;

    /// Zero opens the fingers once they held something, and means nothing before.
    fn write(&mut self, force: GripForce) -> Result<(), Self::Error> {
        self.wish = match (self.wish, force) {
            (Wish::Stay, GripForce::ZERO) => Wish::Stay,
            (_, GripForce::ZERO) => Wish::Open,
            (_, force) => Wish::Grip(force),
        };
        if self.wish == Wish::Open {
            self.applied = None;
        }
        Ok(())
    }

    fn health(&self) -> LineHealth {
        self.health
    }
}
