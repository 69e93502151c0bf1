//! A recorded frame as the view gets it from a run: the microcontroller's status says most of it again.

use gripline_firmware::Fault;
use gripline_network::scene::Verdict;
use gripline_protocol::message::Configuration;
use gripline_protocol::{Health, SENSORS};

use super::messages::Stored;
use crate::cycle::Late;
use crate::telemetry::{FrameReport, LATE, NO_DEVICE, NO_STATUS, STAGES, Truth, health_names, verdict_name};
use crate::units::{Load, centre_of_pressure_mm, millimetres};

/// Everything that a gate can say.
const VERDICTS: [Verdict; 4] = [
    Verdict::NoContact,
    Verdict::Unchanged,
    Verdict::Network,
    Verdict::Unhealthy,
];

impl Stored {
    /// The report, with the microcontroller's settings of that run.
    pub(crate) fn report(&self, settings: &Configuration) -> FrameReport {
        let status = &self.wire;
        let fingertip = &settings.fingertips[usize::from(status.sensor).min(SENSORS - 1)];
        let pitch_mm = millimetres(fingertip.pitch_um);
        let verdict = VERDICTS
            .into_iter()
            .find(|verdict| verdict_name(*verdict) == self.gate);
        let names = Fault::ALL
            .iter()
            .map(|fault| fault.name())
            .chain([NO_DEVICE, NO_STATUS, LATE]);
        let mut stages_us = [0.0; STAGES.len()];
        for (to, from) in stages_us.iter_mut().zip(&self.stages_us) {
            *to = *from;
        }
        FrameReport {
            frame: self.frame,
            sensor: self.sensor,
            t_s: self.t_s,
            gate: verdict.unwrap_or(Verdict::Network),
            health: health_names(Health::from_bits(self.health_bits)),
            normal_n: self.normal_n,
            shear_x_n: self.shear_x_n,
            shear_y_n: self.shear_y_n,
            shear_n: self.shear_n,
            moment_nmm: self.moment_nmm,
            centre_of_pressure_mm: centre_of_pressure_mm(&status.sums, pitch_mm),
            load: Load::of(&status.sums, status.sensor, fingertip),
            contact: self.contact,
            stick: self.stick,
            stick_ratio: self.stick_ratio,
            coulomb_slip: self.coulomb_slip,
            state: status.state.name(),
            time_to_slip_ms: status.time_to_slip_ms,
            line_n: self.line_n,
            latency_us: self.latency_us,
            stages_us,
            faults: names
                .filter(|name| self.faults.iter().any(|fault| fault == name))
                .collect(),
            late: self.late.as_deref().and_then(Late::named).map(Late::name),
            wire_bytes: self.wire_bytes,
            truth: self.truth.as_ref().map(|truth| Truth {
                phase: truth.phase.clone().into(),
                normal_n: truth.normal_n,
                shear_n: truth.shear_n,
                stick_ratio: truth.stick_ratio,
                gross_slip: truth.gross_slip,
                slip_mm: truth.slip_mm,
            }),
        }
    }
}
