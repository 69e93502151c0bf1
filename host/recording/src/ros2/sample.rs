//! A frame of the loop as the messages of a fingertip. Pure.

use gripline_protocol::constants::SIDE;
use gripline_protocol::{ForceMap, LSB_PER_NEWTON};

use super::messages::{
    DiagnosticStatus, Header, Image, Level, SLIP_STATES, Slip, Time, Vector3, Wrench, WrenchStamped,
};
use super::names::Namespace;
use crate::telemetry::FrameReport;

/// Three f32 a taxel.
const TAXEL_BYTES: usize = 12;

/// A frame: report, map and time.
#[derive(Debug, Clone)]
pub struct Sample {
    /// When the picture was taken, nanoseconds since 1970.
    pub captured_ns: u64,
    /// The pipeline's report.
    pub report: FrameReport,
    /// The map in the wire's units.
    pub map: Box<ForceMap>,
    /// Distance between taxel centres, millimetres.
    pub pitch_mm: f64,
}

impl Sample {
    /// Capture time and frame.
    #[must_use]
    pub fn header(&self, namespace: &Namespace) -> Header {
        Header {
            stamp: Time::from_ns(self.captured_ns),
            frame_id: namespace.frame_id(self.report.sensor),
        }
    }

    /// Force and torque about the map's centre, as the sum over the map; `None` if the frame was late and the map is of an older
    /// one.
    #[must_use]
    pub fn wrench(&self, namespace: &Namespace) -> Option<WrenchStamped> {
        self.report.late.is_none().then(|| WrenchStamped {
            header: self.header(namespace),
            wrench: wrench_of(&self.map, self.pitch_mm),
        })
    }

    /// The map: 20×20 pixels of fx, fy, fz in newtons, in the map's own order and signs: row 0 is the lowest, fz presses into the
    /// skin. `None` as in [`Self::wrench`].
    #[must_use]
    pub fn force_map(&self, namespace: &Namespace) -> Option<Image> {
        self.report.late.is_none().then(|| Image {
            header: self.header(namespace),
            height: SIDE as u32,
            width: SIDE as u32,
            encoding: "32FC3",
            is_bigendian: 0,
            step: (SIDE * TAXEL_BYTES) as u32,
            data: self
                .map
                .dequantise()
                .iter()
                .flatten()
                .flat_map(|force| force.to_le_bytes())
                .collect(),
        })
    }

    /// The slip message.
    #[must_use]
    pub fn slip(&self, namespace: &Namespace) -> Slip {
        let report = &self.report;
        let state = SLIP_STATES.iter().position(|name| *name == report.state);
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Slip {
            header: self.header(namespace),
            fingertip: report.sensor.number(),
            frame: report.frame,
            state: state.unwrap_or_default() as u8,
            slip_evidence: report.slip_evidence,
            stick_ratio: report.stick_ratio.unwrap_or(f64::NAN),
            contact: report.contact,
            stick: report.stick,
            witness_stick_ratio: report.witnesses.stick_ratio,
            witness_unrest: report.witnesses.unrest,
            witness_shear_follows: report.witnesses.shear_follows,
            witness_motion: report.witnesses.motion,
            time_to_slip: report
                .time_to_slip_ms
                .map_or(f64::NAN, |time_ms| f64::from(time_ms) / 1e3),
            line: report.line_n,
            health: owned(&report.health),
            faults: owned(&report.faults),
        }
    }

    /// The health of its picture.
    #[must_use]
    pub fn health(&self, namespace: &Namespace) -> DiagnosticStatus {
        let report = &self.report;
        let doubts = report.health.join(", ");
        let how = if doubts.is_empty() {
            (Level::Ok, "good".to_owned())
        } else {
            (Level::Warning, doubts)
        };
        let name = format!("{namespace}: fingertip {}", report.sensor);
        DiagnosticStatus::new(name, how, "", [("gate", report.gate.to_owned())])
    }
}

/// The faults of a gripper: each with what to do, if known.
#[must_use]
pub fn faults_status(namespace: &Namespace, faults: &[(&str, String)]) -> DiagnosticStatus {
    let names: Vec<_> = faults.iter().map(|(name, _)| *name).collect();
    let how = if names.is_empty() {
        (Level::Ok, "none".to_owned())
    } else {
        (Level::Error, names.join(", "))
    };
    DiagnosticStatus::new(
        format!("{namespace}: faults"),
        how,
        "",
        faults.iter().map(|(name, what)| (*name, what.clone())),
    )
}

/// The sum over a map, in whole steps of the wire and half pitches, so that no rounding depends on the order.
fn wrench_of(map: &ForceMap, pitch_mm: f64) -> Wrench {
    let (mut force, mut torque) = ([0_i64; 3], [0_i64; 3]);
    for (place, taxel) in map.taxels.iter().enumerate() {
        // The map's fz presses into the skin; the frame's z points out of it.
        let [fx, fy, fz] = [i64::from(taxel.x), i64::from(taxel.y), -i64::from(taxel.z)];
        let [x, y] = [place % SIDE, place / SIDE].map(|taxels| 2 * taxels as i64 - (SIDE as i64 - 1));
        for (sum, part) in force.iter_mut().zip([fx, fy, fz]) {
            *sum += part;
        }
        for (sum, part) in torque.iter_mut().zip([y * fz, -x * fz, x * fy - y * fx]) {
            *sum += part;
        }
    }
    let newtons = 1.0 / f64::from(LSB_PER_NEWTON);
    let newton_metres = newtons * pitch_mm / 2e3;
    let vector = |sums: [i64; 3], unit: f64| {
        let [x, y, z] = sums.map(|sum| sum as f64 * unit);
        Vector3 { x, y, z }
    };
    Wrench {
        force: vector(force, newtons),
        torque: vector(torque, newton_metres),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use gripline_protocol::TaxelForce;

    use super::*;
    use crate::telemetry::{STAGES, WitnessReport};
    use crate::units::Load;
    use gripline_protocol::SensorId;

    pub(in crate::ros2) fn sample() -> Sample {
        let mut map = Box::new(ForceMap::EMPTY);
        // Column 12, row 3 of the map: 4 mm to the right and 10.4 mm down.
        map.taxels[3 * SIDE + 12] = TaxelForce {
            x: 4_096,
            y: -2_048,
            z: 8_192,
        };
        Sample {
            captured_ns: 1_700_000_000_250_000_000,
            map,
            pitch_mm: 1.6,
            report: FrameReport {
                frame: 7,
                sensor: SensorId::SECOND,
                t_s: 0.25,
                gate: "network",
                health: vec!["too_dark"],
                normal_n: 2.0,
                shear_x_n: 1.0,
                shear_y_n: -0.5,
                shear_n: 1.118,
                moment_nmm: 0.0,
                centre_of_pressure_mm: None,
                load: Load {
                    force_n: [0.0; 3],
                    moment_nmm: 0.0,
                    centre_of_pressure_mm: None,
                },
                contact: 1,
                stick: 0,
                stick_ratio: Some(0.0),
                coulomb_slip: true,
                state: "SLIP",
                slip_evidence: 0.75,
                witnesses: WitnessReport {
                    stick_ratio: 0.5,
                    unrest: 0.25,
                    shear_follows: 0.125,
                    motion: 0.0,
                },
                time_to_slip_ms: Some(120),
                line_n: 6.5,
                latency_us: 900.0,
                stages_us: [0.0; STAGES.len()],
                faults: vec!["LINE AT CEILING"],
                late: None,
                wire_bytes: 64,
                markers: None,
                truth: None,
            },
        }
    }

    fn near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-12, "{found}, expected {expected}");
    }

    #[test]
    fn the_wrench_is_what_the_object_does_in_a_right_handed_frame_whose_z_leaves_the_skin() {
        let wrench = sample().wrench(&"a".parse().unwrap()).unwrap();
        assert_eq!(
            wrench.header,
            Header {
                stamp: Time {
                    sec: 1_700_000_000,
                    nanosec: 250_000_000
                },
                frame_id: "a/fingertip_1".to_owned()
            }
        );
        let (force, torque) = (wrench.wrench.force, wrench.wrench.torque);
        let [x, y] = [0.004, -0.0104];
        for (found, expected) in [
            (force.x, 1.0),
            (force.y, -0.5),
            (force.z, -2.0),
            // r × f at (x, y, 0).
            (torque.x, y * -2.0),
            (torque.y, -x * -2.0),
            (torque.z, x * -0.5 - y * 1.0),
        ] {
            near(found, expected);
        }
    }

    #[test]
    fn the_force_map_has_the_maps_own_order_and_signs() {
        let image = sample().force_map(&"a".parse().unwrap()).unwrap();
        assert_eq!(
            (
                image.height,
                image.width,
                image.encoding,
                image.step,
                image.data.len()
            ),
            (20, 20, "32FC3", 240, 4_800)
        );
        let at = (3 * 20 + 12) * 12;
        let pressed: Vec<f32> = image.data[at..at + 12]
            .chunks(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(pressed, [1.0, -0.5, 2.0]);
        let others = image.data[..at].iter().chain(&image.data[at + 12..]);
        assert!(others.copied().all(|byte| byte == 0));
    }

    #[test]
    fn slip_says_what_the_report_says() {
        let slip = sample().slip(&"a".parse().unwrap());
        assert_eq!((slip.fingertip, slip.frame, slip.state), (1, 7, 3));
        near(slip.time_to_slip, 0.12);
        assert_eq!(slip.faults, ["LINE AT CEILING"]);
        assert_eq!(slip.health, ["too_dark"]);
        let mut untouched = sample();
        untouched.report.stick_ratio = None;
        untouched.report.time_to_slip_ms = None;
        let slip = untouched.slip(&"a".parse().unwrap());
        assert!(slip.stick_ratio.is_nan() && slip.time_to_slip.is_nan());
    }

    #[test]
    fn of_a_frame_that_came_too_late_there_are_no_forces() {
        let mut late = sample();
        late.report.late = Some("picture");
        let namespace = "a".parse().unwrap();
        assert_eq!(
            (late.wrench(&namespace), late.force_map(&namespace)),
            (None, None)
        );
        assert_eq!(late.slip(&namespace).frame, 7);
    }
}
