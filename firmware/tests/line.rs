//! The line's codes: live zero, monotone, never less grip than decided.

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use gripline_firmware::GripForce;
use gripline_firmware::line::{DAC_LIVE_ZERO, GripLine, LineCalibration, PwmLine};

#[test]
fn no_force_is_two_volts_and_full_scale_is_ten() {
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::ZERO), 819);
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(40 * 4096)), 4095);
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(i32::MAX)), 4095);
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(i32::MIN)), 819);
}

#[test]
fn more_force_is_never_a_lower_code_and_the_code_never_grips_less_than_decided() {
    let mut last = 0;
    for lsb in 0..=40 * 4096 {
        let code = DAC_LIVE_ZERO.code(GripForce::from_lsb(lsb));
        assert!(code >= last);
        let gripped = f64::from(code - 819) * f64::from(40 * 4096) / f64::from(4095 - 819);
        assert!(gripped >= f64::from(lsb) - 1e-6 && gripped < f64::from(lsb) + 51.0);
        last = code;
    }
}

#[test]
fn a_calibration_that_makes_no_sense_is_refused() {
    let force = GripForce::from_lsb(4096);
    assert!(LineCalibration::new(800, 4000, force).is_some());
    assert!(LineCalibration::new(4000, 4000, force).is_none());
    assert!(LineCalibration::new(0, 4096, force).is_none());
    assert!(LineCalibration::new(0, 4095, GripForce::ZERO).is_none());
}

struct Pwm(u16);

impl ErrorType for Pwm {
    type Error = core::convert::Infallible;
}

impl SetDutyCycle for &mut Pwm {
    fn max_duty_cycle(&self) -> u16 {
        1_000
    }
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Self::Error> {
        self.0 = duty;
        Ok(())
    }
}

#[test]
fn the_pwm_line_has_a_live_zero_of_a_fifth() {
    let mut pwm = Pwm(0);
    let full = GripForce::from_lsb(10 * 4096);
    for (lsb, duty) in [(0, 200), (5 * 4096, 600), (10 * 4096, 1_000), (20 * 4096, 1_000)] {
        PwmLine::new(&mut pwm, full)
            .write(GripForce::from_lsb(lsb))
            .unwrap();
        assert_eq!(pwm.0, duty);
    }
}
