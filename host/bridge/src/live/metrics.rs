//! The values of a run in Prometheus' text format. Pure.

use std::fmt::Write as _;

use crate::telemetry::{FrameReport, STAGES};

/// Quantiles of the stage times.
pub(crate) const QUANTILES: [f64; 3] = [0.5, 0.99, 0.999];

/// What is told.
#[derive(Debug, Clone, Default)]
pub(crate) struct Values {
    /// The newest frame.
    pub newest: Option<FrameReport>,
    /// Frames so far.
    pub frames: u64,
    /// Frames by what the gate said of them, in the order of [`GATES`].
    pub gate: [u64; 4],
    /// Maps that got no answer.
    pub maps_unanswered: u64,
    /// Answers that were not what the shadow expects.
    pub shadow_mismatches: u64,
    /// Frames that came more than a frame too late.
    pub frames_late: u64,
    /// Pictures and frames that the recorder dropped.
    pub record_dropped: [u64; 2],
    /// [`QUANTILES`] of every stage, µs.
    pub stages_us: [[f64; 3]; STAGES.len()],
}

/// Names of the gate's verdicts.
const GATES: [&str; 4] = ["no_contact", "unchanged", "network", "unhealthy"];
/// Names of the slip states.
const STATES: [&str; 4] = ["NO_CONTACT", "STICK", "INCIPIENT", "SLIP"];

impl Values {
    /// As Prometheus reads them.
    pub(crate) fn text(&self) -> String {
        let mut page = Page(String::new());
        page.metric(
            "frames_total",
            "counter",
            "Frames processed.",
            &[("", self.frames as f64)],
        );
        let label = |name: &str, value: &str| format!("{{{name}=\"{value}\"}}");
        let gates: Vec<_> = GATES
            .iter()
            .zip(self.gate)
            .map(|(gate, count)| (label("verdict", gate), count as f64))
            .collect();
        page.labelled(
            "gate_total",
            "counter",
            "Frames by what the scene gate said of them.",
            &gates,
        );
        for (name, help, count) in [
            (
                "maps_unanswered_total",
                "Maps without an answer from the microcontroller.",
                self.maps_unanswered,
            ),
            (
                "shadow_mismatches_total",
                "Answers that differ from the host's own.",
                self.shadow_mismatches,
            ),
            (
                "frames_late_total",
                "Pictures and maps that were too old and dropped.",
                self.frames_late,
            ),
            (
                "record_pictures_dropped_total",
                "Pictures left out of the recording.",
                self.record_dropped[0],
            ),
            (
                "record_frames_dropped_total",
                "Frames left out of the recording.",
                self.record_dropped[1],
            ),
        ] {
            page.metric(name, "counter", help, &[("", count as f64)]);
        }
        let times: Vec<_> = STAGES
            .iter()
            .zip(self.stages_us)
            .flat_map(|(stage, times_us)| {
                QUANTILES.into_iter().zip(times_us).map(move |(quantile, us)| {
                    (format!("{{stage=\"{stage}\",quantile=\"{quantile}\"}}"), us / 1e6)
                })
            })
            .collect();
        page.labelled(
            "stage_seconds",
            "gauge",
            "Time of each stage over the run.",
            &times,
        );
        if let Some(newest) = &self.newest {
            page.frame(newest);
        }
        page.0
    }
}

struct Page(String);

impl Page {
    fn metric(&mut self, name: &str, kind: &str, help: &str, values: &[(&str, f64)]) {
        let values: Vec<_> = values
            .iter()
            .map(|(label, value)| ((*label).to_owned(), *value))
            .collect();
        self.labelled(name, kind, help, &values);
    }

    fn labelled(&mut self, name: &str, kind: &str, help: &str, values: &[(String, f64)]) {
        // Writing to a String cannot fail.
        let _ = writeln!(
            self.0,
            "# HELP gripline_{name} {help}\n# TYPE gripline_{name} {kind}"
        );
        for (label, value) in values {
            let _ = writeln!(self.0, "gripline_{name}{label} {value}");
        }
    }

    fn frame(&mut self, frame: &FrameReport) {
        for (name, help, value) in [
            (
                "normal_force_newtons",
                "Total normal force.",
                Some(frame.normal_n),
            ),
            ("shear_force_newtons", "Total shear force.", Some(frame.shear_n)),
            (
                "moment_newton_millimetres",
                "Moment about z.",
                Some(frame.moment_nmm),
            ),
            ("line_newtons", "Grip-force line.", Some(frame.line_n)),
            (
                "contact_taxels",
                "Taxels in contact.",
                Some(f64::from(frame.contact)),
            ),
            (
                "stick_ratio",
                "Share of them that sticks; missing when nothing touches.",
                frame.stick_ratio,
            ),
            (
                "latency_seconds",
                "Frame in to map out, newest frame.",
                Some(frame.latency_us / 1e6),
            ),
        ] {
            if let Some(value) = value {
                self.metric(name, "gauge", help, &[("", value)]);
            }
        }
        let states: Vec<_> = STATES
            .iter()
            .map(|state| {
                (
                    format!("{{state=\"{state}\"}}"),
                    f64::from(u8::from(frame.state == *state)),
                )
            })
            .collect();
        self.labelled("slip_state", "gauge", "1 for the present slip state.", &states);
        let faults: Vec<_> = frame
            .faults
            .iter()
            .map(|fault| (format!("{{fault=\"{fault}\"}}"), 1.0))
            .collect();
        self.labelled("fault", "gauge", "Faults that are there or latched.", &faults);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_a_comment_or_a_metric_with_a_number() {
        let values = Values {
            frames: 7,
            gate: [1, 2, 3, 4],
            ..Values::default()
        };
        let text = values.text();
        for line in text.lines().filter(|line| !line.starts_with("# ")) {
            let (name, number) = line.rsplit_once(' ').unwrap();
            assert!(
                name.starts_with("gripline_") && number.parse::<f64>().is_ok(),
                "{line}"
            );
        }
        assert!(text.contains("\ngripline_frames_total 7\n"), "{text}");
        assert!(
            text.contains("gripline_gate_total{verdict=\"network\"} 3\n"),
            "{text}"
        );
        assert!(
            text.contains("gripline_stage_seconds{stage=\"network\",quantile=\"0.999\"} 0\n"),
            "{text}"
        );
    }
}
