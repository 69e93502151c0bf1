//! A recorded frame as the view gets it from a run: the microcontroller's status says most of it again.

use gripline_firmware::Fault;
use gripline_network::scene::GateDecision;
use gripline_protocol::Health;
use gripline_protocol::message::Configuration;

use gripline_pipeline::control_loop::Late;
use gripline_pipeline::control_loop::gate_name;
use gripline_recording::RecordedStatus;
use gripline_recording::telemetry::{
    FrameReport, LATE, NO_DEVICE, NO_STATUS, STAGES, Truth, WitnessReport, health_names,
};
use gripline_recording::units::{Load, centre_of_pressure_mm, millimetres, ratio};

/// Everything that a gate can say.
const VERDICTS: [GateDecision; 4] = [
    GateDecision::NoContact,
    GateDecision::Unchanged,
    GateDecision::Infer,
    GateDecision::Unhealthy,
];

/// The report of a recorded frame, with the microcontroller's settings of that run.
pub(in crate::commands) fn report_of(stored: &RecordedStatus, settings: &Configuration) -> FrameReport {
    let status = &stored.wire;
    let fingertip = &settings.fingertips[status.sensor.index()];
    let pitch_mm = millimetres(fingertip.pitch_um);
    let verdict = VERDICTS
        .into_iter()
        .find(|verdict| gate_name(*verdict) == stored.gate);
    let names = Fault::ALL
        .iter()
        .map(|fault| fault.name())
        .chain([NO_DEVICE, NO_STATUS, LATE]);
    let mut stages_us = [0.0; STAGES.len()];
    for (to, from) in stages_us.iter_mut().zip(&stored.stages_us) {
        *to = *from;
    }
    FrameReport {
        frame: stored.frame,
        sensor: stored.sensor,
        t_s: stored.t_s,
        gate: gate_name(verdict.unwrap_or(GateDecision::Infer)),
        health: health_names(Health::from_bits(stored.health_bits)),
        normal_n: stored.normal_n,
        shear_x_n: stored.shear_x_n,
        shear_y_n: stored.shear_y_n,
        shear_n: stored.shear_n,
        moment_nmm: stored.moment_nmm,
        centre_of_pressure_mm: centre_of_pressure_mm(&status.sums, pitch_mm),
        load: Load::of(&status.sums, status.sensor, fingertip),
        contact: stored.contact,
        stick: stored.stick,
        stick_ratio: stored.stick_ratio,
        coulomb_slip: stored.coulomb_slip,
        state: status.state.name(),
        slip_evidence: ratio(status.slip_evidence),
        witnesses: WitnessReport::of(&status.witnesses),
        time_to_slip_ms: status.time_to_slip_ms,
        line_n: stored.line_n,
        latency_us: stored.latency_us,
        stages_us,
        faults: names
            .filter(|name| stored.faults.iter().any(|fault| fault == name))
            .collect(),
        late: stored.late.as_deref().and_then(Late::named).map(Late::name),
        wire_bytes: stored.wire_bytes,
        markers: None,
        truth: stored.truth.as_ref().map(|truth| Truth {
            phase: truth.phase.clone().into(),
            normal_n: truth.normal_n,
            shear_n: truth.shear_n,
            stick_ratio: truth.stick_ratio,
            gross_slip: truth.gross_slip,
            slip_mm: truth.slip_mm,
        }),
    }
}
