//! The line's codes: live zero, monotone, never less grip than decided.

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use gripline_firmware::GripForce;
use gripline_firmware::line::{DAC_LIVE_ZERO, DacCode, GripLine, LineCalibration, PwmLine};
use gripline_protocol::line::{LinePoint, LineSettings};

#[test]
fn no_force_is_two_volts_and_full_scale_is_ten() {
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::ZERO), DacCode(819));
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(40 * 4096)), DacCode::MAX);
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(i32::MAX)), DacCode::MAX);
    assert_eq!(DAC_LIVE_ZERO.code(GripForce::from_lsb(i32::MIN)), DacCode(819));
}

#[test]
fn more_force_is_never_a_lower_code_and_the_code_never_grips_less_than_decided() {
    let mut last = 0;
    for lsb in 0..=40 * 4096 {
        let DacCode(code) = DAC_LIVE_ZERO.code(GripForce::from_lsb(lsb));
        assert!(code >= last);
        let gripped = f64::from(code - 819) * f64::from(40 * 4096) / f64::from(4095 - 819);
        assert!(gripped >= f64::from(lsb) - 1e-6 && gripped < f64::from(lsb) + 51.0);
        last = code;
    }
}

#[test]
fn a_calibration_with_a_bend_goes_through_its_points_and_never_below_the_straight_line_between_them() {
    let mut settings = LineSettings::DEFAULT;
    settings.points[1] = LinePoint {
        force: 4_096,
        code: 2_000,
    };
    settings.points[2].code = 2_500;
    let calibration = LineCalibration::of(&settings);
    for point in settings.points {
        assert_eq!(
            calibration.code(GripForce::from_lsb(point.force)),
            DacCode(point.code)
        );
    }
    for pair in settings.points.windows(2) {
        for lsb in pair[0].force..pair[1].force {
            let share = f64::from(lsb - pair[0].force) / f64::from(pair[1].force - pair[0].force);
            let straight = f64::from(pair[0].code) + share * f64::from(pair[1].code - pair[0].code);
            let code = f64::from(calibration.code(GripForce::from_lsb(lsb)).0);
            assert!(
                code >= straight - 1e-6 && code < straight + 1.0,
                "{lsb}: {code} for {straight}"
            );
        }
    }
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
