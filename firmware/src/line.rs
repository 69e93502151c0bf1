//! The grip-force line: from force to what the gripper's input sees, behind one trait.
//!
//! A DAC with a live zero: code `zero` is 0 N, so that a broken wire (0 V) can be told from "no force". Default wiring:
//! the DAC's 0–3.3 V through an op-amp with gain 3.03 to 0–10 V, of which 2–10 V are used.
//! Limits: 12-bit DAC, monotone, saturates at full scale.

use embedded_hal::pwm::SetDutyCycle;
use gripline_protocol::LSB_PER_NEWTON;

use crate::grip::GripForce;

/// Where the grip force goes.
pub trait GripLine {
    /// What can go wrong while writing.
    type Error;

    /// Puts a force on the line.
    ///
    /// # Errors
    /// As the hardware says; the line then keeps its last value.
    fn write(&mut self, force: GripForce) -> Result<(), Self::Error>;
}

/// Largest code of a 12-bit DAC.
pub const DAC_CODE_MAX: u16 = 4_095;

/// How force becomes a DAC code: a straight line from (0 N, `zero_code`) to (`full_scale`, `full_code`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineCalibration {
    zero_code: u16,
    full_code: u16,
    full_scale: GripForce,
}

/// 2–10 V after the op-amp (codes 819 to 4095) for 0–40 N.
pub const DAC_LIVE_ZERO: LineCalibration = LineCalibration {
    zero_code: 819,
    full_code: DAC_CODE_MAX,
    full_scale: GripForce::from_lsb(40 * LSB_PER_NEWTON),
};

impl LineCalibration {
    /// `None` unless `zero_code < full_code <= 4095` and `full_scale > 0`.
    #[must_use]
    pub const fn new(zero_code: u16, full_code: u16, full_scale: GripForce) -> Option<Self> {
        if zero_code < full_code && full_code <= DAC_CODE_MAX && full_scale.lsb() > 0 {
            Some(Self {
                zero_code,
                full_code,
                full_scale,
            })
        } else {
            None
        }
    }

    /// The code for a force, rounded up: never less grip than was decided.
    #[must_use]
    pub const fn code(&self, force: GripForce) -> u16 {
        let full = self.full_scale.lsb().cast_unsigned() as u64;
        let force = force.lsb().cast_unsigned() as u64;
        let force = if force < full { force } else { full };
        let span = (self.full_code - self.zero_code) as u64;
        self.zero_code + (force * span).div_ceil(full) as u16
    }
}

/// A line on any PWM output of embedded-hal: duty 20 % is 0 N, 100 % is full scale (the live zero of 2–10 V).
#[derive(Debug)]
pub struct PwmLine<P> {
    pwm: P,
    full_scale: GripForce,
}

impl<P: SetDutyCycle> PwmLine<P> {
    /// `full_scale` is the force at 100 % duty.
    pub const fn new(pwm: P, full_scale: GripForce) -> Self {
        Self { pwm, full_scale }
    }
}

impl<P: SetDutyCycle> GripLine for PwmLine<P> {
    type Error = P::Error;

    fn write(&mut self, force: GripForce) -> Result<(), Self::Error> {
        let max = u64::from(self.pwm.max_duty_cycle());
        let full = u64::from(self.full_scale.lsb().max(1).cast_unsigned());
        let force = u64::from(force.lsb().cast_unsigned()).min(full);
        let zero = max / 5;
        let duty = zero + ((max - zero) * force).div_ceil(full);
        self.pwm.set_duty_cycle(duty as u16)
    }
}
