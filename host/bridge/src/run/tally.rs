//! Counts of a run, per frame and at its end.

use gripline_firmware::sums::stick_ratio_below;
use gripline_network::scene::GateDecision;
use gripline_protocol::SensorId;
use gripline_protocol::message::{GripMode, Status};

use super::summary::{StageSummary, Summary};
use super::under_way::Run;
use super::usage;
use gripline_pipeline::control_loop::{FrameOutcome, Late};
use gripline_recording::Recorder;
use gripline_recording::telemetry::{DEADLINES_US, FrameReport, STAGES};

impl Run {
    /// Counts a frame.
    pub fn count(&mut self, outcome: &FrameOutcome) {
        let summary = &mut self.summary;
        if let Some(fingertip) = summary.fingertips.get_mut(outcome.sensor.index()) {
            fingertip.frames += 1;
            fingertip.maps_unanswered += u64::from(!outcome.answered && outcome.late.is_none());
        }
        let passed = match outcome.late {
            None => STAGES.len(),
            Some(Late::Map) => {
                summary.maps_late += 1;
                STAGES.len() - 2
            }
            Some(Late::Picture) => {
                summary.pictures_late += 1;
                return;
            }
        };
        *match outcome.gate {
            GateDecision::NoContact => &mut summary.gate_no_contact,
            GateDecision::Unchanged => &mut summary.gate_unchanged,
            GateDecision::Infer => &mut summary.gate_network,
            GateDecision::Unhealthy => &mut summary.gate_unhealthy,
        } += 1;
        summary.wire_bytes += outcome.wire_bytes as u64;
        summary.maps_not_taken += u64::from(outcome.is_lost);
        summary.maps_unanswered += u64::from(!outcome.answered && outcome.late.is_none());
        for ((times, us), name) in self
            .stages
            .iter_mut()
            .zip(outcome.stages_us)
            .zip(STAGES)
            .take(passed)
        {
            if (name != "network" || outcome.gate == GateDecision::Infer) && (name != "decode" || us > 0.0) {
                times.push(us);
            }
        }
        for ((late, us), deadline_us) in self.late.iter_mut().zip(outcome.stages_us).zip(DEADLINES_US) {
            *late += u64::from(us > deadline_us);
        }
        if outcome.late.is_some() {
            return;
        }
        self.frame_to_link.push(outcome.latency_us);
        if outcome.gate == GateDecision::Infer {
            self.network_frame_to_link.push(outcome.latency_us);
        }
    }

    pub(super) fn observe(&mut self, report: &FrameReport, status: &Status) {
        let summary = &mut self.summary;
        summary.slip_frames += u64::from(stick_ratio_below(
            &status.sums,
            self.control.session.settings().slip_threshold,
        ));
        if let Some(truth) = &report.truth {
            summary.gross_slip_frames += u64::from(truth.gross_slip && status.mode == GripMode::Hold);
            summary.slip_mm = summary.slip_mm.max(truth.slip_mm);
        }
        if report.contact > 0 && status.mode == GripMode::Hold {
            summary.line_n_min_holding = summary.line_n_min_holding.min(report.line_n);
        }
        summary.line_n_max = summary.line_n_max.max(report.line_n);
        summary.microcontroller_worst_cycles = status.worst_cycles;
    }

    /// Counts and times of the run so far, complete.
    #[must_use]
    pub fn summary(self) -> Summary {
        let seconds = self.started.elapsed().as_secs_f64();
        let stages = STAGES
            .into_iter()
            .zip(&self.stages)
            .zip(DEADLINES_US.into_iter().zip(self.late))
            .map(|((stage, times), (deadline_us, late))| StageSummary {
                stage,
                frames: times.count(),
                median_us: times.quantile_us(0.5),
                p99_us: times.quantile_us(0.99),
                p999_us: times.quantile_us(0.999),
                deadline_us,
                late,
            });
        let line_n_min_holding = self.summary.line_n_min_holding;
        let shadow = self.control.session.shadow();
        let mut fingertips = self.summary.fingertips.clone();
        for (sensor, fingertip) in SensorId::ALL.into_iter().zip(fingertips.iter_mut()) {
            [fingertip.answers_checked, fingertip.shadow_mismatches] = shadow.of(sensor);
        }
        Summary {
            fingertips,
            recording: self.recorder.map(Recorder::finish),
            frames: self.frame,
            seconds,
            frames_per_second: self.frame as f64 / seconds.max(1e-9),
            cpu_share: usage::cpu_s()
                .zip(self.cpu_s)
                .map(|(now_s, then_s)| (now_s - then_s) / seconds.max(1e-9)),
            stages: stages.collect(),
            capture_to_line: self
                .capture_to_line
                .summary(self.summary.microcontroller_worst_cycles),
            frame_to_link_us_median: self.frame_to_link.quantile_us(0.5),
            frame_to_link_us_p99: self.frame_to_link.quantile_us(0.99),
            frame_to_link_us_p999: self.frame_to_link.quantile_us(0.999),
            network_frame_to_link_us_median: self.network_frame_to_link.quantile_us(0.5),
            network_frame_to_link_us_p999: self.network_frame_to_link.quantile_us(0.999),
            answers_checked: self.control.session.shadow().checked(),
            shadow_mismatches: self.control.session.shadow().mismatches(),
            microcontroller_restarts: self.control.session.restarts(),
            clock_jumps: self.control.session.clock_jumps(),
            link_losses: self.control.session.presence().losses,
            link_packets_lost: self.control.session.presence().packets_lost,
            // JSON has no infinity: never held, so nothing to say.
            line_n_min_holding: if line_n_min_holding.is_finite() {
                line_n_min_holding
            } else {
                0.0
            },
            ..self.summary
        }
    }
}
