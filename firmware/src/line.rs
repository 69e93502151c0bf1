//! The grip-force line: converts force to the gripper's input, behind one trait with three implementations: a DAC with a live zero,
//! PWM, and a [gripper on a bus](crate::robotiq).
//!
//! With a live zero, 0 N is a voltage above 0 V, so a broken wire differs from "no force". Default wiring: the
//! DAC's 0–3.3 V through an op-amp with gain 3.03 to 0–10 V, of which 2–10 V are used.
//! Limits: 12-bit DAC, monotone, saturates at full scale.

use embedded_hal::pwm::SetDutyCycle;
pub use gripline_protocol::line::DAC_CODE_MAX;
use gripline_protocol::line::{LINE_POINTS, LinePoint, LineSettings};
use gripline_protocol::rounds::at_most;

use crate::grip::GripForce;

/// An output for the grip force.
///
/// Every line has these properties, and one test suite (`tests/lines.rs`) checks them all. A higher force never gives a lower
/// output. The output is never less than written, up to full scale. An unreachable line keeps its value, and takes the newest force
/// when it is reachable again. A line that never got a force above zero moves nothing before a release.
pub trait GripLine {
    /// What can go wrong while writing.
    type Error;

    /// Writes a force to the line.
    ///
    /// # Errors
    /// The hardware's error; the line then keeps its last value.
    fn write(&mut self, force: GripForce) -> Result<(), Self::Error>;

    /// A person lets go. It opens a gripper that held something before the line's first force; a plain voltage is open already.
    fn release(&mut self) {}

    /// Whether writes arrive. A plain voltage gives no feedback.
    fn health(&self) -> LineHealth {
        LineHealth::Good
    }
}

/// Whether the gripper follows the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum LineHealth {
    /// It works, as far as known.
    #[default]
    Good = 0,
    /// Just switched on, or during activation.
    Starting = 1,
    /// No answer, or no readable one.
    NoAnswer = 2,
    /// It needs an activation, which opens its fingers: release first.
    NotActivated = 3,
    /// It reports a fault of its own.
    GripperFault = 4,
    /// It answers but does not follow commands.
    NotTaken = 5,
    /// It follows commands, held something, and reports that nothing is between its fingers any more.
    ObjectLost = 6,
}

impl LineHealth {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 7] = [
        Self::Good,
        Self::Starting,
        Self::NoAnswer,
        Self::NotActivated,
        Self::GripperFault,
        Self::NotTaken,
        Self::ObjectLost,
    ];
}

/// A code of the 12-bit DAC behind an analog line: 0 to [`DAC_CODE_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DacCode(pub u16);

impl DacCode {
    /// The largest.
    pub const MAX: Self = Self(DAC_CODE_MAX);
}

/// Force to DAC code: linear between the points of a table, the first of which is 0 N.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineCalibration {
    points: [LinePoint; LINE_POINTS],
}

/// 2–10 V after the op-amp (codes 819 to 4095) for 0–40 N.
pub const DAC_LIVE_ZERO: LineCalibration = LineCalibration::of(&LineSettings::DEFAULT);

impl LineCalibration {
    /// The table of settings that passed `Configuration::check`. A table that does not rise gives wrong codes, but none above the
    /// DAC's range.
    #[must_use]
    pub const fn of(settings: &LineSettings) -> Self {
        Self {
            points: settings.points,
        }
    }

    /// The code for a force, rounded up: never less force than decided. Forces above full scale give the last point's code.
    #[must_use]
    pub fn code(&self, force: GripForce) -> DacCode {
        for place in at_most::<{ LINE_POINTS - 1 }, _>(1..LINE_POINTS) {
            let (low, high) = (self.points[place - 1], self.points[place]);
            if force.lsb() < high.force {
                // Forces are below 2¹⁹ and codes below 2¹², so the product fits u32.
                let share = force.lsb().wrapping_sub(low.force).cast_unsigned();
                let span = high.force.wrapping_sub(low.force).cast_unsigned();
                let rise = u32::from(high.code.wrapping_sub(low.code));
                let span = if span == 0 { 1 } else { span };
                let code = u32::from(low.code) + share.wrapping_mul(rise).div_ceil(span);
                return if code < u32::from(DAC_CODE_MAX) {
                    DacCode(code as u16)
                } else {
                    DacCode::MAX
                };
            }
        }
        DacCode(self.points[LINE_POINTS - 1].code).min(DacCode::MAX)
    }
}

/// A DAC.
pub trait DacOutput {
    /// Shows `code`.
    fn show(&mut self, code: DacCode);

    /// Keeps the force that the line must output again after a reset.
    fn keep(&mut self, force: GripForce);
}

/// A line on a DAC.
#[derive(Debug)]
pub struct DacLine<D> {
    dac: D,
    calibration: LineCalibration,
    shown: GripForce,
}

impl<D: DacOutput> DacLine<D> {
    /// Shows `force` at once.
    pub fn start(mut dac: D, calibration: LineCalibration, force: GripForce) -> Self {
        dac.show(calibration.code(force));
        dac.keep(force);
        Self {
            dac,
            calibration,
            shown: force,
        }
    }
}

impl<D: DacOutput> GripLine for DacLine<D> {
    type Error = core::convert::Infallible;

    #[inline]
    fn write(&mut self, force: GripForce) -> Result<(), Self::Error> {
        if force == self.shown {
            return Ok(());
        }
        // A reset may come between any two of these: what is kept is never less than what is shown.
        if force > self.shown {
            self.dac.keep(force);
        }
        self.dac.show(self.calibration.code(force));
        if force < self.shown {
            self.dac.keep(force);
        }
        self.shown = force;
        Ok(())
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
