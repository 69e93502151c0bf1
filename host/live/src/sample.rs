//! A frame for the tests.

use gripline_protocol::SensorId;
use gripline_protocol::message::{FingertipGeometry, MapSums};
use gripline_recording::telemetry::{FrameReport, STAGES, WitnessReport};
use gripline_recording::units::Load;

/// A frame of a 50 Hz run in which nothing touches.
pub(crate) fn report(frame: u64) -> FrameReport {
    FrameReport {
        frame,
        sensor: SensorId::FIRST,
        t_s: frame as f64 / 50.0,
        gate: "no_contact",
        health: Vec::new(),
        normal_n: 0.0,
        shear_x_n: 0.0,
        shear_y_n: 0.0,
        shear_n: 0.0,
        moment_nmm: 0.0,
        centre_of_pressure_mm: None,
        load: Load::of(&MapSums::default(), SensorId::FIRST, &FingertipGeometry::DEFAULT),
        contact: 0,
        stick: 0,
        stick_ratio: None,
        coulomb_slip: false,
        state: "NO_CONTACT",
        slip_evidence: 0.0,
        witnesses: WitnessReport::default(),
        time_to_slip_ms: None,
        line_n: 1.0,
        latency_us: 190.0,
        stages_us: [0.0; STAGES.len()],
        faults: Vec::new(),
        late: None,
        wire_bytes: 72,
        markers: None,
        truth: None,
    }
}
