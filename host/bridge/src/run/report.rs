//! The report of a frame for view, programs and recording. Pure.

use gripline_firmware::Fault;
use gripline_network::constants::IMAGE_SIDE;
use gripline_protocol::SENSORS;
use gripline_protocol::message::{FingertipGeometry, Status};

use gripline_link::session::Session;
use gripline_pipeline::control_loop::{FrameOutcome, Late, gate_name};
use gripline_pipeline::pipeline::Pipeline;
use gripline_recording::telemetry::{
    FrameReport, LATE, NO_DEVICE, NO_STATUS, STATUS_OLD_US, Truth, WitnessReport, health_names,
};
use gripline_recording::units::{
    Load, centre_of_pressure_mm, force_n, millimetres, moment_nmm, newtons, ratio, shear_n, stick_ratio,
};
use gripline_recording::{Image, Pictures};

/// Which size of pictures is recorded.
pub(super) fn image(wanted: Pictures, crop: impl Into<Vec<u8>>, pipeline: &Pipeline) -> Option<Image> {
    match wanted {
        Pictures::Full => {
            let [width, height] = pipeline.crop_px();
            Some(Image {
                width,
                height,
                pixels: crop.into(),
            })
        }
        Pictures::Small => pipeline
            .small()
            .map(|small| Image::grey(IMAGE_SIDE, small.to_vec())),
        Pictures::Off => None,
    }
}

/// The host's own faults.
pub(super) fn faults_of(session: &Session) -> Vec<&'static str> {
    let faults = [
        (session.presence().away.is_some(), NO_DEVICE),
        (session.status_age_us() > STATUS_OLD_US, NO_STATUS),
    ];
    let there = faults.into_iter().filter(|(is_there, _)| *is_there);
    there.map(|(_, name)| name).collect()
}

/// Names of the faults that are there or latched, and of the host's own.
pub(super) fn fault_names(status: &Status, host_faults: &[&'static str]) -> Vec<&'static str> {
    let faults = status.faults | status.latched;
    Fault::ALL
        .iter()
        .filter(|fault| faults & fault.bit() != 0)
        .map(|fault| fault.name())
        .chain(host_faults.iter().copied())
        .collect()
}

/// The report of frame number `frame` at `t_s`.
pub(super) fn report_of(
    (frame, t_s): (u64, f64),
    outcome: &FrameOutcome,
    fingertips: &[FingertipGeometry; SENSORS],
    truth: Option<Truth>,
    host_faults: &[&'static str],
) -> FrameReport {
    let status = &outcome.status;
    let sums = &status.sums;
    let fingertip = &fingertips[status.sensor.index()];
    let pitch_mm = millimetres(fingertip.pitch_um);
    let [x, y, z] = force_n(sums);
    FrameReport {
        frame,
        sensor: outcome.sensor,
        t_s,
        gate: gate_name(outcome.gate),
        health: health_names(outcome.health),
        normal_n: z,
        shear_x_n: x,
        shear_y_n: y,
        shear_n: shear_n(sums),
        moment_nmm: moment_nmm(sums, pitch_mm),
        centre_of_pressure_mm: centre_of_pressure_mm(sums, pitch_mm),
        load: Load::of(sums, status.sensor, fingertip),
        contact: sums.contact,
        stick: sums.stick,
        stick_ratio: stick_ratio(sums),
        coulomb_slip: status.coulomb_slip,
        state: status.state.name(),
        slip_evidence: ratio(status.slip_evidence),
        witnesses: WitnessReport::of(&status.witnesses),
        time_to_slip_ms: status.time_to_slip_ms,
        line_n: newtons(status.line),
        latency_us: outcome.latency_us,
        stages_us: outcome.stages_us,
        faults: fault_names(status, host_faults)
            .into_iter()
            .chain(outcome.late.map(|_| LATE))
            .collect(),
        late: outcome.late.map(Late::name),
        wire_bytes: outcome.wire_bytes,
        markers: None,
        truth,
    }
}
